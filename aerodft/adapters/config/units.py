"""Degrees and seconds at the edge, so that what is written reads back to the same bits."""

import math

from aerodft.conventions import SECOND_NS

_NEIGHBOURS = 6


def to_deg(angle_rad: float) -> float:
    """The shortest number of degrees whose ``math.radians`` is exactly ``angle_rad``.

    Where no double has that image (it cannot have come from degrees), the nearest one.
    """
    angle_deg = math.degrees(angle_rad)
    for digits in range(1, 16):
        candidate = round(angle_deg, digits)
        if math.radians(candidate) == angle_rad:
            return candidate
    below = above = angle_deg
    for _ in range(_NEIGHBOURS):
        for candidate in (below, above):
            if math.radians(candidate) == angle_rad:
                return candidate
        below, above = math.nextafter(below, -math.inf), math.nextafter(above, math.inf)
    return angle_deg


def to_ns(duration_s: float) -> int:
    """Seconds to the nearest nanosecond."""
    return round(duration_s * SECOND_NS)


def to_s(duration_ns: int) -> float:
    """Nanoseconds to seconds; exact both ways below eleven days."""
    return duration_ns / SECOND_NS


def to_percent(share: float) -> float:
    """The shortest number of percent that is a hundred times ``share`` and, divided, gives it back exactly."""
    percent = 100 * share
    return next((each for digits in range(16) if (each := round(percent, digits)) / 100 == share), percent)
