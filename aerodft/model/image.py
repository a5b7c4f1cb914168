"""Images (video frames and stills; a frame is a coordinate frame), packets of a stream, and observations in images.

An observation is the pixels of a probe, or the outline of an object, at one image stamp.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, TypeAlias, overload

import numpy as np

from aerodft.model.arrays import Batch, ImageArray, IntArray
from aerodft.model.telemetry import RawBlock

VISION: Final = "vision"
"""Source of observations by aerodft's own detectors."""

Box = tuple[float, float, float, float]


class StampClock(StrEnum):
    """The clock that a stamp was read from."""

    UTC = "utc"
    HOST = "host"  # this machine's arrival time; mapped to the vehicle's UTC before a pose is looked up


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image:
    """An image and its stamp; its pixels are decoded on demand.

    Attributes:
        index: Running number in its source, from 0.
        stamp_ns: When it was taken, by ``clock``, time offset applied.
        arrival_ns: When it reached this machine (for files: the stamp).
        width_px: Width; None for a stamp without pixels (telemetry-only evaluation).
        height_px: Height in pixels; None where no pixels are known.
        pixels: Function that decodes ``(height, width, 3)`` uint8 BGR; None without pixels.
    """

    index: int
    stamp_ns: int
    arrival_ns: int
    clock: StampClock = StampClock.UTC
    width_px: int | None = None
    height_px: int | None = None
    pixels: Callable[[], ImageArray] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ImageRows(Batch, Sequence[Image]):
    """Columns of ``n`` images without pixels in order of arrival, as a recording has them; fields as in ``Image``.

    Attributes:
        indices: ``(n,)``.
        stamp_ns: ``(n,)`` by ``clock``.
        arrival_ns: ``(n,)`` not decreasing.
        clock: Common to all images, as are ``width_px`` and ``height_px``.
        width_px: Width.
        height_px: Height.
    """

    indices: IntArray
    stamp_ns: IntArray
    arrival_ns: IntArray
    clock: StampClock
    width_px: int | None
    height_px: int | None

    def __len__(self) -> int:
        return len(self.indices)

    @overload
    def __getitem__(self, index: int) -> Image: ...

    @overload
    def __getitem__(self, index: slice) -> "ImageRows": ...

    def __getitem__(self, index: int | slice) -> "Image | ImageRows":
        if isinstance(index, slice):
            return self.rows(index)
        return self._image(int(self.indices[index]), int(self.stamp_ns[index]), int(self.arrival_ns[index]))

    def __iter__(self) -> Iterator[Image]:
        return map(self._image, self.indices.tolist(), self.stamp_ns.tolist(), self.arrival_ns.tolist())

    @property
    def common(self) -> tuple[StampClock, int | None, int | None]:
        """Clock, width and height, common to all images."""
        return self.clock, self.width_px, self.height_px

    def _image(self, index: int, stamp_ns: int, arrival_ns: int) -> Image:
        return Image(
            index=index,
            stamp_ns=stamp_ns,
            arrival_ns=arrival_ns,
            clock=self.clock,
            width_px=self.width_px,
            height_px=self.height_px,
        )


def concatenate_images(parts: Sequence[Image | ImageRows]) -> Sequence[Image]:
    """Images and columns of images in order of arrival; as columns if all parts are columns with equal ``common``."""
    rows = [part for part in parts if isinstance(part, ImageRows)]
    if rows and len(rows) == len(parts) and len({part.common for part in rows}) == 1:
        joined = ImageRows.concatenate(rows)
        return joined.rows(np.argsort(joined.arrival_ns, kind="stable"))
    images = [image for part in parts for image in (part if isinstance(part, ImageRows) else (part,))]
    return sorted(images, key=lambda image: image.arrival_ns)


def image_indices(images: Sequence[Image]) -> IntArray:
    """Running numbers ``(n,)`` of images in their source."""
    if isinstance(images, ImageRows):
        return images.indices
    return np.array([image.index for image in images], dtype=np.int64)


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoPacket:
    """An image of an H.264 stream that refers to no later image.

    Attributes:
        data: In Annex B form; key images have their parameter sets in front.
        is_key: Whether decoding can begin here.
        stamp_ns: Of the image.
        arrival_ns: When it reached this machine, as of its ``Image``.
        index: Of its ``Image``; None where there is none.
    """

    data: bytes
    is_key: bool
    stamp_ns: int
    arrival_ns: int
    index: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """Pixels of a probe, or the outline of its object, at one stamp.

    Attributes:
        name: The probe's name.
        stamp_ns: The image's stamp, by ``clock``.
        pixels: ``((u, v), ...)``; empty with an outline.
        std_px: Standard deviation of each coordinate; None for the probe's own.
        image: Index of the image, where known.
        source: Observer: a file's name, a topic, ``vision``.
        arrival_ns: When it reached this machine (for files: the stamp).
        box: Left, top, right and bottom limits of an object: its edges, not the centres of its outermost pixels.
        contour: Corners of its closed outline, exact as ``box``. At most one of box, contour and pixels is given.
        unseen: Why a detector found nothing; empty where unknown.
    """

    name: str
    stamp_ns: int
    arrival_ns: int
    pixels: tuple[tuple[float, float], ...]
    std_px: float | None = None
    clock: StampClock = StampClock.UTC
    image: int | None = None
    source: str = ""
    box: Box | None = None
    contour: tuple[tuple[float, float], ...] = ()
    unseen: str = ""

    @classmethod
    def in_image(
        cls,
        image: Image,
        name: str,
        pixels: tuple[tuple[float, float], ...] = (),
        *,
        std_px: float | None = None,
        contour: tuple[tuple[float, float], ...] = (),
        unseen: str = "",
    ) -> "Observation":
        """An observation by one of aerodft's own detectors in an image."""
        return cls(
            name=name,
            stamp_ns=image.stamp_ns,
            arrival_ns=image.arrival_ns,
            pixels=pixels,
            clock=image.clock,
            image=image.index,
            source=VISION,
            std_px=std_px,
            contour=contour,
            unseen=unseen,
        )

    @property
    def has_outline(self) -> bool:
        """Whether the outline of an object was observed, not pixels."""
        return self.box is not None or bool(self.contour)

    @property
    def is_empty(self) -> bool:
        """Whether the observer found nothing."""
        return not self.pixels and not self.has_outline


Event: TypeAlias = RawBlock | Image | Observation
Arrival: TypeAlias = Event | ImageRows
"""An event, or the columns of many images."""
