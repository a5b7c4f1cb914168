"""Images with their poses, whatever they are of, and what is measured in them."""

import shlex
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from aerodft.adapters.images import encode_jpeg
from aerodft.adapters.wire.measurement import encode_measurement
from aerodft.adapters.wire.pose import summary_payload
from aerodft.app.diagnose import Diagnosis
from aerodft.app.measure import Distance, ImageProbe, measured_document, requests_of, with_pixels_noted
from aerodft.app.viewing.overlay import scene_overlay
from aerodft.app.viewing.pose_finder import PoseFinder, Scene
from aerodft.app.viewing.station_file import add_probe
from aerodft.dft import Request, explain, measure
from aerodft.errors import UsageError
from aerodft.geometry import matrix, pixels_from_rays
from aerodft.model import Camera, Image, ImageArray, Measurement, PoseBatch
from replay.export import MapCrs, geojson_text, map_features

Document: TypeAlias = dict[str, Any]

_JPEG_QUALITY: Final = 95
_VERTICAL_POINTS: Final = 33
_SPACING_M: Final = 1.0


def doctor_document(found: Diagnosis) -> Document:
    """What ``View.doctor`` says of a diagnosis."""
    return {"problems": found.problems, "notes": found.notes, "clock": found.report.clock.host_minus_utc_s}


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewedImage:
    """One image of a view.

    Attributes:
        stamp_ns: UTC where it is known.
        seconds: From the start, as ``measure`` and ``frames`` count them.
    """

    stamp_ns: int
    seconds: float


class View(ABC):
    """Images, each with a camera pose, by their number from 0.

    Attributes:
        station_file: The station's configuration, which probes are saved into; None where there is none.
        std_px: Of each pixel coordinate that people click; None for the assumed 1 px, which measurements say.
        finder: Finds the pose from what is known of the view; None where the camera moves.
    """

    station_file: Path | None = None
    std_px: float | None = None
    finder: PoseFinder | None = None

    @property
    @abstractmethod
    def title(self) -> str:
        """What people call it."""

    @property
    @abstractmethod
    def images(self) -> Sequence[ViewedImage]:
        """All images in the order of time."""

    @abstractmethod
    def pixels(self, number: int) -> ImageArray:
        """An image, ``(height, width, 3)`` BGR.

        Raises:
            InputError: It cannot be decoded.
        """

    @abstractmethod
    def scene(self, number: int) -> Scene:
        """Camera, ground and pose of an image."""

    @property
    @abstractmethod
    def camera(self) -> Camera:
        """The camera that took the images."""

    @abstractmethod
    def options(self, number: int) -> Mapping[str, str]:
        """Options of the command line that measures in an image, by their names, without its probes."""

    def jpeg(self, number: int) -> bytes:
        """An image for the eye; raises as ``pixels`` does."""
        image = Image(stamp_ns=0, arrival_ns=0, index=number, pixels=lambda: self.pixels(number))
        return encode_jpeg(image, _JPEG_QUALITY)

    def river(self, number: int, strokes: Document, hinted: int) -> Document:
        """The river in an image; arguments, result and errors as those of ``river_in``."""
        from aerodft.app.viewing.river import river_in  # slow to load, and most pages look for no river

        return river_in(self, number, strokes, hinted)

    def calibrate(self, evidence: Document, unknowns: Sequence[str], *, accept: bool, use: bool) -> Document:
        """Find the camera's pose from what is known of the view of a fixed camera.

        Args:
            evidence: Landmarks, lengths, heights, verticals and the horizon, see ``evidence_of``.
            unknowns: What to find, by the names of ``calibrate``.
            accept: Whether observations may contradict each other, which makes the stds larger.
            use: Whether images are measured with it from now on, and it is written to a file (``file``).

        Returns:
            The document of ``aerodft calibrate --json``; its ``marks`` say where the calibrated camera sees what was
            marked (``seen_px``, ``expected_px``), its ``overlay`` is that of ``overlay``, its ``file_text``
            is that of a calibration file.

        Raises:
            AerodftError: It makes no sense, or this is no fixed camera.
        """
        if self.finder is None:
            raise UsageError("there is nothing to calibrate", expected="images of a fixed camera")
        return self.finder.calibrate(evidence, unknowns, accept=accept, use=use)

    def doctor(self) -> Document | None:
        """What is wrong with the telemetry, in sentences, as ``aerodft doctor`` says it; None where there is none.

        Returns:
            ``problems`` and ``notes``, lists of sentences; ``clock``: arrival minus the vehicle's UTC in seconds, None
            where it is not known.

        Raises:
            AerodftError: A recording is damaged.
        """
        return None

    def measured(self, number: int) -> list[Document]:
        """What a station's probes measured in an image, as it published it; nothing in one that is of no station."""
        del number
        return []

    def seen(self, number: int) -> Document:
        """What is known of an image without asking for anything.

        Returns:
            ``pose``: as in a measurement, with ``status`` and ``reasons``; None where nobody has said it yet.
            ``measurements``: those of the station's probes.

        Raises:
            NoAnswerError: There is no such image.
        """
        _, sample = self.scene(number)
        pose = summary_payload(sample) | {"status": sample.status, "reasons": sample.reasons}
        return {"pose": pose, "measurements": self.measured(number)}

    def overlay(self, number: int) -> Document:
        """Horizon, ground grid and footprint of an image, see ``scene_overlay``.

        Raises:
            NoAnswerError: There is no such image.
        """
        return scene_overlay(*self.scene(number))

    def sampling_m(self, number: int, probe: ImageProbe) -> tuple[float, float] | None:
        """Ground sampling distance at a probe's last pixel: metres from one pixel to the next, across and down.

        Returns:
            None where there is no ground.

        Raises:
            NoAnswerError: There is no such image.
        """
        setup, sample = self.scene(number)
        u, v = np.asarray(probe.pixels, dtype=np.float64)[-1].tolist()
        sides = ([(u - 0.5, v), (u + 0.5, v)], [(u, v - 0.5), (u, v + 0.5)])
        poses, distances = PoseBatch.from_samples([sample]), requests_of([Distance(side) for side in sides])
        across, down = measure(setup, poses, distances)[0]
        return None if across.value is None or down.value is None else (across.value, down.value)

    def save_probe(self, number: int, probe: ImageProbe, *, is_tracked: bool) -> Path:
        """Have a station measure something from its next start on.

        Args:
            number: Of the image.
            probe: What; it needs a name.
            is_tracked: Whether its pixels are of that image, and followed over the ground; else they are fixed.

        Returns:
            The station's file, to which the probe was added.

        Raises:
            AerodftError: No station's file is known, or it cannot take the probe.
        """
        if self.station_file is None:
            hint = "name the station's file when the page is opened"
            raise UsageError("there is no station to save the probe for", hint=hint)
        add_probe(self.station_file, probe, at_ns=self.scene(number)[1].stamp_ns if is_tracked else None)
        return self.station_file

    def measure(self, number: int, probes: Sequence[ImageProbe], *, with_budget: bool = False) -> list[Document]:
        """Measure in an image.

        Args:
            number: Of the image.
            probes: What to measure.
            with_budget: Whether each says where its uncertainty comes from.

        Returns:
            A document a probe, as ``aerodft measure --json`` prints it; ``command`` is the command line that gives it;
            with a budget also ``geojson``, a text, None where no place is known.

        Raises:
            AerodftError: There is no such image, or a probe makes no sense.
        """
        setup, sample = self.scene(number)
        sample, requests = with_pixels_noted(sample, self.std_px), requests_of(probes)
        documents = []
        for found, request in zip(measure(setup, PoseBatch.from_samples([sample]), requests)[0], requests, strict=True):
            budget = explain(setup, sample, request) if with_budget else None
            command = _command(self.options(number), request)
            documents.append(measured_document(found, budget) | {"command": command})
            if with_budget:
                documents[-1]["geojson"] = _geojson(found)
        return documents

    def vertical_px(self, number: int, base: ImageProbe) -> list[tuple[float, float]]:
        """Pixels ``(u, v)`` along the vertical line that stands on the ground at a pixel, up to the camera's height.

        Args:
            number: Of the image.
            base: A position on the ground.

        Returns:
            From the base up; empty where the base is not on the ground.
        """
        setup, sample = self.scene(number)
        found = measure(setup, PoseBatch.from_samples([sample]), requests_of([base]))[0][0]
        if found.enu_m is None or sample.pose is None:
            return []
        foot = np.asarray(found.enu_m[0], dtype=np.float64)
        rises_m = np.linspace(0.0, 0.95, _VERTICAL_POINTS) * max(sample.pose.position_enu_m[2] - foot[2], 0.0)
        points = foot + rises_m[:, None] * [0.0, 0.0, 1.0]
        directions = (points - sample.pose.position_enu_m) @ matrix(sample.pose.wxyz)
        pixels = pixels_from_rays(setup.camera, directions)
        return [(u, v) for u, v in pixels.tolist() if np.isfinite(u) and np.isfinite(v)]


def _command(options: Mapping[str, str], request: Request) -> str:
    """The command line that gives a measurement."""
    pixels = " ".join(f"{u!r},{v!r}" for u, v in request.pixels)
    probe = f"{request.probe.kind} {pixels} name={request.probe.name}"
    words = (word for name, value in {**options, "probe": probe}.items() for word in (f"--{name}", value))
    return shlex.join(["aerodft", "measure", *words])


def _geojson(measurement: Measurement) -> str | None:
    """The measurement as a map of one feature; None where its place is not known."""
    if measurement.geo is None:
        return None
    return "".join(geojson_text(map_features([encode_measurement(measurement)]), MapCrs.wgs84()))
