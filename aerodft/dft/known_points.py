"""Ends of a probe that are surveyed points: each brings its own height, and its pixel where none is given."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeAlias

from aerodft.conventions import LARGEST
from aerodft.dft.probe_kinds import PROBE_KINDS
from aerodft.errors import Reason, UsageError, counted
from aerodft.model import KnownPoint, ProbeKind

_MOST_NAMES: Final = 12  # of points in a sentence

Px: TypeAlias = tuple[float, float]
End: TypeAlias = Px | KnownPoint
"""A pixel ``(u, v)``, or a surveyed point."""
Elevations: TypeAlias = float | tuple[float, ...]


def probe_end(end: Px | str, points: Mapping[str, KnownPoint]) -> End:
    """The end of a probe: a pixel, or text.

    Args:
        end: ``(u, v)``; or ``"u,v"``, ``"@NAME"``, or ``"u,v@NAME"``, a pixel at the height of a surveyed point.
        points: Surveyed points by name, whose heights count from the measured plane.

    Raises:
        UsageError: The text is none of these, no point has that name, or nobody knows where the point is seen.
    """
    if not isinstance(end, str):
        return end
    pixel, at, name = end.partition("@")
    if not at:
        return _pixel(pixel)
    if name not in points:
        what = f"@{name}, and no surveyed point has a height above the measured plane"
        expected = (
            f"one of {_listed(points)}"
            if points
            else "level ground at a fixed height, and landmarks or a calibration that was made from some"
        )
        raise UsageError("a surveyed point", got=f"@{name}" if points else Reason(what), expected=expected)
    point = replace(points[name], pixel=_pixel(pixel)) if pixel else points[name]
    if point.pixel is None:
        raise UsageError("a surveyed point", got=f"@{name} without a known pixel", expected=f"u,v@{name}")
    return point


def at_own_heights(
    kind: ProbeKind, ends: Sequence[End], elevation_m: Elevations, elevation_std_m: Elevations
) -> tuple[tuple[Px, ...], Elevations, Elevations]:
    """Pixels, elevations and their standard deviations of a probe, of whose ends some are surveyed points.

    Args:
        kind: Of the probe.
        ends: Its ends.
        elevation_m: Of those that are no surveyed points: one for all, or one for each in their order.
        elevation_std_m: Likewise.

    Raises:
        UsageError: There are more or fewer elevations than ends without a name, or a point's pixel is not known.
    """
    pixels = tuple(end.pixel if isinstance(end, KnownPoint) else end for end in ends)
    if None in pixels:
        raise UsageError("a surveyed point", got=Reason("its pixel is not known"), expected="one whose pixel is known")
    on_ground = ends[: PROBE_KINDS[kind].on_ground(len(ends))]
    surveyed = [end for end in on_ground if isinstance(end, KnownPoint)]
    if surveyed:
        elevation_m = _filled(on_ground, elevation_m, [point.elevation_m for point in surveyed])
        elevation_std_m = _filled(on_ground, elevation_std_m, [point.elevation_std_m for point in surveyed])
    return tuple(pixel for pixel in pixels if pixel is not None), elevation_m, elevation_std_m


def _filled(ends: Sequence[End], unnamed: Elevations, surveyed: Sequence[float]) -> tuple[float, ...]:
    """One number for each end: a surveyed point's own, or the next of those of ends without a name."""
    count = len(ends) - len(surveyed)
    if isinstance(unnamed, tuple) and len(unnamed) != count:
        got = f"{counted(len(unnamed), 'elevation')} beside {counted(len(surveyed), 'surveyed point')}"
        few = {0: "none: each end has a height of its own", 1: "one elevation, of the end without a name"}
        expected = few.get(count, f"one elevation, or {count}, of the ends without a name")
        raise UsageError("the elevations", got=got, expected=expected)
    of_pixels, of_points = iter(unnamed if isinstance(unnamed, tuple) else [unnamed] * count), iter(surveyed)
    return tuple(next(of_points if isinstance(end, KnownPoint) else of_pixels) for end in ends)


def _listed(points: Mapping[str, KnownPoint]) -> str:
    return ", ".join(list(points)[:_MOST_NAMES]) + (", ..." if len(points) > _MOST_NAMES else "")


def _pixel(text: str) -> Px:
    words = text.split(",")
    if len(words) != 2:  # noqa: PLR2004 - u and v
        raise UsageError("a pixel", got=repr(text), expected="a pixel as u,v, a point as @NAME, or u,v@NAME")
    return _finite(words[0]), _finite(words[1])


def _finite(word: str) -> float:
    try:
        value = float(word) if word.isascii() and "_" not in word else math.nan
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        raise UsageError("a pixel", got=repr(word), expected="a finite number")
    return value
