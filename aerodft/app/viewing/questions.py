"""What a page asks for, as it comes over the wire: probes, strokes and landmarks, checked before anything is done."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from aerodft.app.measure import PROBES, ImageProbe
from aerodft.errors import UsageError
from aerodft.model import ProbeKind
from aerodft.vision.river import RiverHints

_MOST_POINTS: Final = 256
_MOST_NAME: Final = 64
_MOST_STROKES: Final = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Landmark:
    """A surveyed point and where it is seen.

    Attributes:
        name: Unique.
        pixel: ``(u, v)``.
        place_m: East, north and up, in metres of one local frame.
    """

    name: str
    pixel: tuple[float, float]
    place_m: tuple[float, float, float]


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
    if name is not None and not _is_name(name):
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


def landmark_of(document: object) -> Landmark:
    """A landmark as a page asks for it.

    Args:
        document: ``name`` without spaces, ``pixel`` ``[u, v]``, ``place_m`` ``[east, north, up]``.

    Raises:
        UsageError: It is something else.
    """
    parts = document if isinstance(document, Mapping) else {}
    name, pixel, place_m = (parts.get(key) for key in ("name", "pixel", "place_m"))
    if not _is_name(name):
        raise UsageError("a landmark's name", got=repr(name)[:80], expected=f"up to {_MOST_NAME} letters, no space")
    if not _are_numbers(pixel, 2) or not _are_numbers(place_m, 3):
        got = repr([pixel, place_m])[:80]
        raise UsageError(f"landmark {name}", got=got, expected="a pixel u, v and a place east, north, up in metres")
    (u, v), (east, north, up) = parts["pixel"], parts["place_m"]
    return Landmark(name=parts["name"], pixel=(u, v), place_m=(east, north, up))


def _is_name(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= _MOST_NAME and value.isprintable() and " " not in value


def _are_numbers(value: object, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(type(each) in {int, float} for each in value)


def _is_pixel(value: object) -> bool:
    return _are_numbers(value, 2)
