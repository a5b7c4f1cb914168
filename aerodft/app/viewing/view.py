"""Images with their poses, whatever they are of; what is measured in them, and what is made of what people click."""

import shlex
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
import tomli_w

from aerodft.adapters.config.station import parse_station
from aerodft.adapters.files import whole_file
from aerodft.adapters.images import encode_jpeg
from aerodft.adapters.wire.measurement import encode_measurement
from aerodft.adapters.wire.pose import summary_payload
from aerodft.app.diagnose import Diagnosis
from aerodft.app.measure import Distance, ImageProbe, measured_document, requests_of, with_stds_noted
from aerodft.app.viewing.overlay import scene_overlay
from aerodft.dft import Request, Setup, explain, measure
from aerodft.errors import AerodftError, InputError, UsageError
from aerodft.geometry import matrix, pixels_from_rays
from aerodft.model import Camera, Image, ImageArray, KnownPoint, Measurement, PoseBatch, PoseSample
from replay.export import MapCrs, geojson_text, map_features, parse_measurement

if TYPE_CHECKING:
    from aerodft.app.calibrate import CalibrationResult
    from aerodft.reports.calibration import Mark

Document: TypeAlias = dict[str, Any]
Scene: TypeAlias = tuple[Setup, PoseSample]

_JPEG_QUALITY: Final = 95
_VERTICAL_POINTS: Final = 33
_MARKED: Final = "what was marked"

PHOTOGRAPH: Final = "photograph"
"""Key of a command line's options that is the photograph itself, which is typed before them."""


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


class PoseFinder:
    """Finds the pose of a camera that does not move, and keeps the one that people chose to measure with.

    Args:
        camera: The camera.
        file: Where a calibration is written that is measured with.
        scene_with: Camera, ground and pose with a calibration file.
        scene: Those that are known before; None where they are not.

    Attributes:
        scene: Camera, ground and pose that are measured with.
        used_file: The calibration file that they are of; None before one was chosen.
    """

    def __init__(
        self, camera: Camera, file: Path, scene_with: Callable[[Path], Scene], scene: Scene | None = None
    ) -> None:
        self._camera = camera
        self._file = file.absolute()
        self._scene_with = scene_with
        self.scene = scene
        self.used_file: Path | None = None

    def calibrate(
        self, evidence: dict[str, Any], unknowns: Sequence[str], *, accept: bool, use: bool
    ) -> dict[str, Any]:
        """Find the pose; arguments, result and errors as those of ``View.calibrate``."""
        from aerodft.reports.calibration import rows_of  # slow to load, see ``_found``

        with TemporaryDirectory() as folder:
            marked, file = Path(folder) / "evidence.toml", Path(folder) / "calibration.toml"
            marked.write_bytes(tomli_w.dumps(evidence).encode())
            found = self._found(marked, unknowns, accept=accept)
            document = found.document(is_saved=True)
            document["reasons"] = [each.replace(str(marked), _MARKED) for each in document["reasons"]]
            document["marks"] = [_mark_document(row.mark) for row in rows_of(found.fit)]
            if found.refusal(is_saved=True) is None:
                found.save(file)
                document |= {
                    "file_text": file.read_text(encoding="utf-8"),
                    "overlay": scene_overlay(*self._scene_with(file)),
                }
                if use:
                    document["file"] = str(self._use(found))
        return document

    def _found(self, marked: Path, unknowns: Sequence[str], *, accept: bool) -> "CalibrationResult":
        from aerodft.app.calibrate import calibrate  # slow to load, and most pages find no pose

        try:
            return calibrate(marked, self._camera, unknowns, accept_misfit=accept, check=False)
        except AerodftError as error:
            hint, got, expected = error.hint, error.got, error.expected
            raise type(error)(error.what, where=_MARKED, got=got, expected=expected, hint=hint) from None

    def _use(self, found: "CalibrationResult") -> Path:
        """Write a calibration, and measure with it from now on."""
        found.save(self._file)
        self.scene, self.used_file = self._scene_with(self._file), self._file
        return self._file


def _mark_document(mark: "Mark") -> dict[str, Any]:
    """An observation by its name, with its pixels and where the calibrated camera sees them, None where it does not."""
    pixels = {"seen_px": mark.seen_px, "expected_px": mark.expected_px}
    found = {key: [None if np.isnan(each).any() else each.tolist() for each in rows] for key, rows in pixels.items()}
    return {"name": mark.name, "kind": mark.kind, **found}


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

        return river_in(self.scene, self.pixels, number, strokes, hinted)

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

    def points(self, number: int) -> Mapping[str, KnownPoint]:
        """Surveyed points by name, whose heights count from the plane that is measured in an image.

        Args:
            number: Of the image.

        Raises:
            AerodftError: There is no such image, or nothing is known of its pose.
        """
        return self.scene(number)[0].points

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
        sample, requests = with_stds_noted(sample, self.std_px), requests_of(probes)
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
        foot = np.array(found.enu_m[0]) - [0.0, 0.0, sample.plane_elevation_m]
        rises_m = np.linspace(0.0, 0.95, _VERTICAL_POINTS) * max(sample.pose.position_enu_m[2] - foot[2], 0.0)
        points = foot + rises_m[:, None] * [0.0, 0.0, 1.0]
        directions = (points - sample.pose.position_enu_m) @ matrix(sample.pose.wxyz)
        pixels = pixels_from_rays(setup.camera, directions)
        return [(u, v) for u, v in pixels.tolist() if np.isfinite(u) and np.isfinite(v)]


def _command(options: Mapping[str, str], request: Request) -> str:
    """The command line that gives a measurement."""
    pixels = " ".join(f"{u!r},{v!r}" for u, v in request.pixels)
    elevations = "".join(
        f" {key}={','.join(map(repr, value)) if isinstance(value, tuple) else repr(value)}"
        for key, value in (
            ("elevation", request.probe.elevation_m),
            ("elevation_std", request.probe.elevation_std_m),
        )
        if value != 0.0
    )
    probe = f"{request.probe.kind} {pixels}{elevations} name={request.probe.name}"
    photo = [options[PHOTOGRAPH]] if PHOTOGRAPH in options else []
    named = {name: value for name, value in options.items() if name != PHOTOGRAPH} | {"probe": probe}
    words = (word for name, value in named.items() for word in (f"--{name.replace('_', '-')}", value))
    return shlex.join(["aerodft", "measure", *photo, *words])


def _geojson(measurement: Measurement) -> str | None:
    """The measurement as a map of one feature; None where its place is not known."""
    if measurement.geo is None:
        return None
    item = parse_measurement(encode_measurement(measurement))
    return "".join(geojson_text(map_features([item]), MapCrs.wgs84()))


def add_probe(path: Path, probe: ImageProbe, *, at_ns: int | None) -> None:
    """Add a probe at the end of a station's file, which stays as it is otherwise.

    Args:
        path: The file.
        probe: What to measure.
        at_ns: Stamp (UTC) of the image that its pixels are of, from which they are followed over the ground; None where
            they are fixed in the image.

    Raises:
        UsageError: The probe has no name.
        InputError: The file cannot be read or written.
        ConfigError: It cannot take the probe: it has one of that name, or the name is none for a key.
    """
    if probe.name is None:
        raise UsageError("a probe of a station", got="no name", expected="a name of its own")
    pixels = np.asarray(probe.pixels, dtype=np.float64).tolist()
    table: dict[str, object] = {"name": probe.name, "kind": str(probe.kind), "pixels": pixels}
    table |= {key: each for key in ("elevation_m", "elevation_std_m") if (each := getattr(probe, key)) != 0.0}
    if at_ns is not None:
        table |= {"tracked": True, "at": str(at_ns)}
    try:
        before = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError("the station's file cannot be read", where=path, got=error) from error
    after = f"{before.rstrip()}\n\n{tomli_w.dumps({'probe': [table]})}"
    parse_station(after.encode(), where=str(path), folder=path.parent)
    with whole_file(path, overwrite=True) as partial:
        partial.write_text(after, encoding="utf-8")
