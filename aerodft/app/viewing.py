"""What a page looks at: one image with its pose, or a recording's images with theirs, and what is measured in them."""

import shlex
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from aerodft.adapters.images import encode_jpeg, read_camera_image
from aerodft.adapters.wire.events import IMAGE_SCHEMA, decode_images
from aerodft.adapters.wire.measurement import measurement_payload
from aerodft.app.measure import PROBES, ImageProbe, recorded_setup, requests_of
from aerodft.app.recordings import StationRecording
from aerodft.app.river import river_question, survey_image
from aerodft.conventions import SECOND_NS
from aerodft.dft import Request, Setup, Share, advice, explain, measure
from aerodft.errors import NoAnswerError, UsageError
from aerodft.geometry import matrix, pixels_from_rays
from aerodft.model import Image, ImageArray, Measurement, PoseBatch, PoseSample, ProbeKind
from aerodft.vision.river import RiverHints, RiverView
from replay.recordings import PixelStore

Document = dict[str, Any]

_JPEG_QUALITY: Final = 95
_KEPT_SCENES: Final = 64
_VERTICAL_POINTS: Final = 33
_MOST_POINTS: Final = 256
_MOST_NAME: Final = 64
_MOST_STROKES: Final = 64
_SPACING_M: Final = 1.0


def measured_document(measurement: Measurement, budget: Sequence[Share] | None) -> Document:
    """A measurement as ``aerodft.measurement/1``, as ``aerodft measure --json`` prints it.

    Args:
        measurement: The measurement.
        budget: Where its variance comes from, which it then says together with what to improve; None to say neither.
    """
    document = measurement_payload(measurement)
    if budget is not None:
        document["budget"] = [{"source": part.source, "std": part.std, "share": part.share} for part in budget]
        document["advice"] = advice(tuple(budget))
    return document


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewedImage:
    """One image of a view.

    Attributes:
        stamp_ns: UTC where it is known.
        seconds: Since the first image.
    """

    stamp_ns: int
    seconds: float


class View(ABC):
    """Images, each with a camera pose, by their number from 0."""

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
    def scene(self, number: int) -> tuple[Setup, PoseSample]:
        """Camera, ground and pose of an image."""

    @abstractmethod
    def command(self, number: int) -> tuple[str, ...]:
        """Words of the command line that measures in an image, without its probes."""

    def jpeg(self, number: int) -> bytes:
        """An image for the eye; raises as ``pixels`` does."""
        image = Image(stamp_ns=0, arrival_ns=0, index=number, pixels=lambda: self.pixels(number))
        return encode_jpeg(image, _JPEG_QUALITY)

    def river(self, number: int, hints: RiverHints, hinted: int) -> Document:
        """The river in an image, as ``aerodft river --json`` has it.

        Args:
            number: Of the image.
            hints: What a person says is water or land.
            hinted: Number of the image that the hints are of; they are carried on the water's plane.

        Returns:
            Banks, transects and width; where there is none its ``status`` says why.

        Raises:
            NoAnswerError: An image has no pose.
        """
        here, there = self._river_view(number), self._river_view(hinted)
        told = hints if number == hinted else hints.carried(there.plane, here.plane)
        return survey_image(here, river_question(told, _SPACING_M, None)).document

    def _river_view(self, number: int) -> RiverView:
        setup, sample = self.scene(number)
        if sample.pose is None:
            raise NoAnswerError("the image has no pose", got="; ".join(sample.reasons))
        return RiverView(number, setup, sample, partial(self.pixels, number))

    def measure(self, number: int, probes: Sequence[ImageProbe], *, with_budget: bool = False) -> list[Document]:
        """Measure in an image.

        Args:
            number: Of the image.
            probes: What to measure.
            with_budget: Whether each says where its uncertainty comes from.

        Returns:
            A document a probe, as ``aerodft measure --json`` prints it; ``command`` is the command line that gives it.

        Raises:
            AerodftError: There is no such image, or a probe makes no sense.
        """
        setup, sample = self.scene(number)
        requests = requests_of(probes)
        documents = []
        for found, request in zip(measure(setup, PoseBatch.of([sample]), requests)[0], requests, strict=True):
            budget = explain(setup, sample, request) if with_budget else None
            command = shlex.join([*self.command(number), "--probe", _words(request)])
            documents.append(measured_document(found, budget) | {"command": command})
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
        found = measure(setup, PoseBatch.of([sample]), requests_of([base]))[0][0]
        if found.enu_m is None or sample.pose is None:
            return []
        foot = np.asarray(found.enu_m[0], dtype=np.float64)
        rises_m = np.linspace(0.0, 0.95, _VERTICAL_POINTS) * max(sample.pose.position_enu_m[2] - foot[2], 0.0)
        points = foot + rises_m[:, None] * [0.0, 0.0, 1.0]
        directions = (points - sample.pose.position_enu_m) @ matrix(sample.pose.wxyz)
        pixels = pixels_from_rays(setup.camera, directions)
        return [(u, v) for u, v in pixels.tolist() if np.isfinite(u) and np.isfinite(v)]


def _words(request: Request) -> str:
    """A request as the option ``--probe`` takes it."""
    pixels = " ".join(f"{u!r},{v!r}" for u, v in request.pixels)
    return f"{request.probe.kind} {pixels} name={request.probe.name}"


def probe_of(document: object, std_px: float) -> ImageProbe:
    """A probe as a page asks for it.

    Args:
        document: ``kind``, ``pixels`` as a list of ``[u, v]``, and perhaps a ``name`` without spaces.
        std_px: Of each pixel coordinate.

    Raises:
        UsageError: It is something else.
    """
    if not isinstance(document, Mapping) or not set(document) <= {"kind", "pixels", "name"}:
        raise UsageError("a probe", got=repr(document)[:80], expected="kind, pixels and perhaps a name")
    kind, pixels, name = (document.get(key) for key in ("kind", "pixels", "name"))
    if not isinstance(kind, str) or kind not in PROBES:
        raise UsageError("a probe's kind", got=repr(kind)[:40], expected=f"one of {', '.join(PROBES)}")
    if not isinstance(pixels, list) or len(pixels) > _MOST_POINTS or not all(map(_is_pixel, pixels)):
        raise UsageError("a probe's pixels", got=repr(pixels)[:80], expected=f"up to {_MOST_POINTS} pairs of numbers")
    if name is not None and not (
        isinstance(name, str) and 0 < len(name) <= _MOST_NAME and not any(map(str.isspace, name))
    ):
        raise UsageError("a probe's name", got=repr(name)[:80], expected=f"up to {_MOST_NAME} letters, no space")
    return PROBES[ProbeKind(kind)]([(u, v) for u, v in pixels], name=name, std_px=std_px)


def hints_of(document: object) -> RiverHints:
    """What a person says is water or land, as a page asks for it.

    Args:
        document: ``water`` and ``land``: lists of strokes, which are lists of ``[u, v]``.

    Raises:
        UsageError: It is something else.
    """
    strokes = [document.get(side) for side in ("water", "land")] if isinstance(document, Mapping) else []
    if not strokes or not all(isinstance(each, list) and len(each) <= _MOST_STROKES for each in strokes):
        raise UsageError(
            "the hints", got=repr(document)[:80], expected=f"water and land, up to {_MOST_STROKES} strokes"
        )
    for stroke in (stroke for side in strokes for stroke in side or ()):
        if not isinstance(stroke, list) or not 0 < len(stroke) <= _MOST_POINTS or not all(map(_is_pixel, stroke)):
            raise UsageError("a stroke", got=repr(stroke)[:80], expected=f"1 to {_MOST_POINTS} pairs of numbers")
    water, land = strokes
    return RiverHints.of(water or [], land or [])


def _is_pixel(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(type(each) in {int, float} for each in value)  # noqa: PLR2004 - u and v


@dataclass(frozen=True, kw_only=True)
class StillView(View):
    """One image file.

    Attributes:
        path: The file, of the camera's size.
        setup: Camera, ground and model.
        sample: The pose.
        words: Words of the command line that say camera and pose.
    """

    path: Path
    setup: Setup
    sample: PoseSample
    words: tuple[str, ...] = field(repr=False)

    @property
    def title(self) -> str:
        """The file's name."""
        return self.path.name

    @property
    def images(self) -> Sequence[ViewedImage]:
        """The one image."""
        return (ViewedImage(stamp_ns=0, seconds=0.0),)

    @cached_property
    def _pixels(self) -> ImageArray:
        return read_camera_image(self.path, self.setup.camera, "the camera file must be of the image's mode")

    def pixels(self, number: int) -> ImageArray:
        """See ``View``."""
        self._check(number)
        return self._pixels

    def scene(self, number: int) -> tuple[Setup, PoseSample]:
        """See ``View``."""
        self._check(number)
        return self.setup, self.sample

    def command(self, number: int) -> tuple[str, ...]:
        """See ``View``."""
        self._check(number)
        return ("aerodft", "measure", *self.words)

    def _check(self, number: int) -> None:
        if number != 0:
            raise NoAnswerError("no such image", where=self.path, got=number, expected="0, the only one")


class RecordingView(View):
    """The images of a recording, with the poses that its telemetry gives them.

    Args:
        recording: Made by a station.

    Raises:
        NoAnswerError: No image was recorded.
        InputError: The recording is damaged.
    """

    def __init__(self, recording: StationRecording) -> None:
        self._recording = recording
        store, reader = PixelStore(recording.reader), recording.reader
        payloads = [message.data for message in reader.messages(wanted=lambda each: each.schema == IMAGE_SCHEMA)]
        found = [(image, store.pixels(image)) for image in decode_images(payloads)] if len(store) else []
        self._images = sorted(
            ((image, pixels) for image, pixels in found if pixels is not None), key=lambda each: each[0].stamp_ns
        )
        if not self._images:
            hint = "record.image_hz says how many are recorded"
            raise NoAnswerError("the recording holds no image", where=recording.path, hint=hint)
        self._scene = lru_cache(maxsize=_KEPT_SCENES)(self._scene_at)

    @property
    def title(self) -> str:
        """The station's name."""
        return self._recording.station

    @cached_property
    def images(self) -> Sequence[ViewedImage]:
        """Those whose pixels were recorded."""
        first_ns = self._images[0][0].stamp_ns
        return tuple(
            ViewedImage(stamp_ns=image.stamp_ns, seconds=(image.stamp_ns - first_ns) / SECOND_NS)
            for image, _ in self._images
        )

    def pixels(self, number: int) -> ImageArray:
        """See ``View``."""
        self._image(number)
        return self._images[number][1]()

    def scene(self, number: int) -> tuple[Setup, PoseSample]:
        """See ``View``."""
        return self._scene(self._image(number).stamp_ns)

    def command(self, number: int) -> tuple[str, ...]:
        """See ``View``."""
        stamp_ns = self._image(number).stamp_ns
        return ("aerodft", "measure", "--recording", str(self._recording.path), "--at", str(stamp_ns))

    def _scene_at(self, stamp_ns: int) -> tuple[Setup, PoseSample]:
        return recorded_setup(self._recording.path, at_ns=stamp_ns)

    def _image(self, number: int) -> Image:
        if not 0 <= number < len(self._images):
            expected = f"0 to {len(self._images) - 1}"
            raise NoAnswerError("no such image", where=self._recording.path, got=number, expected=expected)
        return self._images[number][0]
