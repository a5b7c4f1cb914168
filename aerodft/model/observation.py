"""Pixels of one probe at one image stamp, whoever found them."""

from dataclasses import dataclass
from typing import Final

from aerodft.model.image import StampClock

VISION: Final = "vision"
"""The source of observations that aerodft itself made in an image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """One probe's pixels at one stamp.

    Attributes:
        name: The probe's name.
        stamp_ns: The stamp of the image that was looked at, by ``clock``.
        pixels: ``((u, v), ...)``.
        std_px: Standard deviation of each coordinate; None where the probe's own applies.
        image: Index of the image, where known.
        source: Who observed: a file's name, a topic, ``vision``.
        arrival_ns: When it reached this machine (for files: the stamp).
    """

    name: str
    stamp_ns: int
    arrival_ns: int
    pixels: tuple[tuple[float, float], ...]
    std_px: float | None = None
    clock: StampClock = StampClock.UTC
    image: int | None = None
    source: str = ""
