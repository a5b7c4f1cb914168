"""Compressed video as it came, one image a packet."""

from dataclasses import dataclass


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
