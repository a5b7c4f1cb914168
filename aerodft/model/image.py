"""Video frames and stills, called images because a frame is a coordinate frame; and compressed ones as they came."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from aerodft.model.arrays import ImageArray


class StampClock(StrEnum):
    """Whose clock a stamp was read from."""

    UTC = "utc"
    HOST = "host"  # this machine's arrival time; mapped to the vehicle's UTC before a pose is looked up


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image:
    """An image and its stamp; the pixels come only when somebody asks for them.

    Attributes:
        index: Running number in its source, from 0.
        stamp_ns: When it was taken, by ``clock``, time offset applied.
        arrival_ns: When it reached this machine (for files: the stamp).
        width_px: Width; None for a stamp without pixels (telemetry-only evaluation).
        height_px: Height, likewise.
        pixels: Gives ``(height, width, 3)`` uint8 BGR, or None where there are no pixels.
    """

    index: int
    stamp_ns: int
    arrival_ns: int
    clock: StampClock = StampClock.UTC
    width_px: int | None = None
    height_px: int | None = None
    pixels: Callable[[], ImageArray] | None = None

    def known_at(self, stamp_ns: int) -> "Image":
        """The same with its stamp in UTC, without its pixels."""
        return Image(
            index=self.index,
            stamp_ns=stamp_ns,
            arrival_ns=self.arrival_ns,
            width_px=self.width_px,
            height_px=self.height_px,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoPacket:
    """One image of an H.264 stream that refers to no later one.

    Attributes:
        data: In Annex B form; key images have their parameter sets in front.
        is_key: Whether decoding can begin here.
        stamp_ns: Of the image.
        arrival_ns: When the image reached this machine: that of its ``Image``, where it became one.
        index: Of that image; None where it became none.
    """

    data: bytes
    is_key: bool
    stamp_ns: int
    arrival_ns: int
    index: int | None = None
