"""Many images as columns: those of a recording are read, and written again, without an object for each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from aerodft.model.arrays import IntArray
from aerodft.model.image import Image, StampClock


@dataclass(frozen=True, slots=True, eq=False)
class ImageRows(Sequence[Image]):
    """``n`` images without pixels that differ in whole numbers only, in order of arrival; fields as in ``Image``.

    Attributes:
        indices: ``(n,)``.
        stamp_ns: ``(n,)`` by ``clock``.
        arrival_ns: ``(n,)`` not decreasing.
        clock: Of all.
        width_px: Likewise.
        height_px: Likewise.
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
            columns = self.indices[index], self.stamp_ns[index], self.arrival_ns[index]
            return ImageRows(*columns, self.clock, self.width_px, self.height_px)
        return self._image(int(self.indices[index]), int(self.stamp_ns[index]), int(self.arrival_ns[index]))

    def __iter__(self) -> Iterator[Image]:
        return map(self._image, self.indices.tolist(), self.stamp_ns.tolist(), self.arrival_ns.tolist())

    @property
    def common(self) -> tuple[StampClock, int | None, int | None]:
        """What all of them share."""
        return self.clock, self.width_px, self.height_px

    def rows(self, start: int, stop: int) -> "ImageRows":
        """Images ``start`` to ``stop`` (half-open)."""
        return self[start:stop]

    def _image(self, index: int, stamp_ns: int, arrival_ns: int) -> Image:
        return Image(
            index=index,
            stamp_ns=stamp_ns,
            arrival_ns=arrival_ns,
            clock=self.clock,
            width_px=self.width_px,
            height_px=self.height_px,
        )


def joined_images(parts: Sequence[Image | ImageRows]) -> Sequence[Image]:
    """Images that came one by one or together, in order of arrival: together where all of them can be."""
    rows = [part for part in parts if isinstance(part, ImageRows)]
    if rows and len(rows) == len(parts) and len({part.common for part in rows}) == 1:
        return _joined(rows)
    each = [image for part in parts for image in (part if isinstance(part, ImageRows) else (part,))]
    return sorted(each, key=lambda image: image.arrival_ns)


def _joined(parts: Sequence[ImageRows]) -> ImageRows:
    columns = [(part.indices, part.stamp_ns, part.arrival_ns) for part in parts]
    indices, stamp_ns, arrival_ns = (np.concatenate(own) for own in zip(*columns, strict=True))
    order = np.argsort(arrival_ns, kind="stable")
    return ImageRows(indices[order], stamp_ns[order], arrival_ns[order], *parts[0].common)


def image_indices(images: Sequence[Image]) -> IntArray:
    """Their running numbers ``(n,)``."""
    if isinstance(images, ImageRows):
        return images.indices
    return np.array([image.index for image in images], dtype=np.int64)
