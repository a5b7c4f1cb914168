"""Landmarks that disagree with the rest: another height datum, a shift, each other's pixels, out of sight."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from aerodft.adapters.config.evidence import EvidenceFile, StatedObservation
from aerodft.errors import InputError
from aerodft.geometry import rays_from_pixels, reproject
from aerodft.model import Evidence, FloatArray, GroundPoint, Landmark, SlantRange
from calibration.pose import Result, State

INTERCHANGED: Final = "look interchanged"
_MIN_SHIFT_M: Final = 10.0  # by which datums differ at least, where it matters
_SAME_M, _SAME = 2.0, 0.05  # how well the shifts of several landmarks agree
_NEAR_STDS, _NEAR_PX = 6.0, 3.0
_MIN_KEPT: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class _Stray:
    """A landmark that disagrees, known in all three dimensions."""

    landmark: Landmark
    stated: StatedObservation
    near_px: float

    @property
    def place_m(self) -> FloatArray:
        """``(3,)``."""
        return np.array(self.landmark.position_m, dtype=np.float64)


def common_error(found: EvidenceFile, result: Result) -> InputError | None:
    """A common error of all rejected landmarks, seen from the camera of the others; None if there is none."""
    state, kept = result.solution.state, result.solution.kept
    landmarks = [isinstance(each, Landmark) for each in found.known.evidence]
    if not result.weakest.is_determined or np.count_nonzero(kept & landmarks) < _MIN_KEPT:
        return None
    misfit = max(result.solution.misfit, 1.0)
    strays = [
        _Stray(evidence, stated, max(_NEAR_PX, _NEAR_STDS * misfit * evidence.std_px))
        for evidence, stated, is_kept in zip(found.known.evidence, found.stated, kept, strict=True)
        if not is_kept and isinstance(evidence, Landmark) and None not in evidence.position_m
    ]
    if not strays:
        return None
    return _raised(found, state, strays) or _shifted(found, state, strays) or _swapped(found, state, strays)


def unseen_error(found: EvidenceFile, result: Result) -> InputError | None:
    """The first observation that the camera cannot see from where all others place it; None if it sees all."""
    state = result.solution.state
    for evidence, stated, is_kept in zip(found.known.evidence, found.stated, result.solution.kept, strict=True):
        if is_kept or not result.weakest.is_determined:
            continue
        if isinstance(evidence, Landmark) and None not in evidence.position_m and _is_behind(state, evidence):
            what, expected = "its place is behind the camera", "a place in view"
        elif above := _above_horizon(state, evidence):
            what, expected = f"its {above} is above the horizon", "pixel and place on the same side of it"
        else:
            continue
        return InputError(
            f"{stated.label}: {what}, as the other observations have it",
            where=found.path,
            got=f"{evidence.name}, {_shown(stated)}",
            expected=expected,
            hint="correct its pixel or its place, or remove it",
        )
    return None


def _raised(found: EvidenceFile, state: State, strays: Sequence[_Stray]) -> InputError | None:
    """Heights of all strays that are off by one number."""
    ups_m = np.array([_height_seen(state, each) for each in strays])
    off_m = np.array([each.place_m[2] for each in strays]) - ups_m
    if not _agree(off_m[:, None]):
        return None
    typical_m = float(np.median(off_m))
    moved = np.array([[*each.place_m[:2], each.place_m[2] - typical_m] for each in strays])
    if not _all_near(state, strays, moved):
        return None
    return InputError(
        f"{_names(strays)}: height",
        where=found.path,
        got=f"{abs(typical_m):.1f} m {'above' if typical_m > 0 else 'below'} where the other landmarks' camera sees it",
        expected="heights of one datum",
        hint="are they of two datums, above the ellipsoid and above the sea?"
        if len(strays) > 1
        else "correct its height, or its place along the line of sight",
    )


def _shifted(found: EvidenceFile, state: State, strays: Sequence[_Stray]) -> InputError | None:
    """Places of all strays that are shifted by one vector, which a single stray cannot tell."""
    if len(strays) == 1:
        return None
    seen = [state.ground_points(np.array([each.landmark.pixel]), each.place_m[2]) for each in strays]
    off_m = np.array([each.place_m[:2] - ground.points_enu_m[0, :2] for each, ground in zip(strays, seen, strict=True)])
    if not _agree(off_m):
        return None
    east_m, north_m = np.median(off_m, axis=0)
    got = f"{abs(east_m):.1f} m {'east' if east_m > 0 else 'west'} and {abs(north_m):.1f} m"
    return InputError(
        f"{_names(strays)}: place",
        where=found.path,
        got=f"{got} {'north' if north_m > 0 else 'south'} of where the other landmarks' camera sees it",
        expected="places of one datum and projection",
        hint="convert them to one coordinate reference system",
    )


def _swapped(found: EvidenceFile, state: State, strays: Sequence[_Stray]) -> InputError | None:
    """Two strays that have each other's pixel."""
    for first, second in combinations(strays, 2):
        pixels = reproject(state.camera, state.position_m, state.rotation, np.stack([first.place_m, second.place_m]))
        one, other = pixels.pixels_px
        if (
            math.dist(one, second.landmark.pixel) <= second.near_px
            and math.dist(other, first.landmark.pixel) <= first.near_px
        ):
            return InputError(
                f"{first.stated.label} and {second.stated.label} {INTERCHANGED}",
                where=found.path,
                got=f"{first.landmark.name} where {second.landmark.name} is seen, and the other way round",
                expected="each at its own pixel",
                hint="swap the two pixels",
            )
    return None


def _height_seen(state: State, stray: _Stray) -> float:
    """Height at which the pixel's ray passes the landmark's vertical, m; NaN where it points away from it."""
    ray = state.rotation @ rays_from_pixels(state.camera, np.array(stray.landmark.pixel))
    away = stray.place_m[:2] - state.position_m[:2]
    along = float(away @ ray[:2] / (ray[:2] @ ray[:2]))
    return float(state.position_m[2] + along * ray[2]) if along > 0 else math.nan


def _all_near(state: State, strays: Sequence[_Stray], places_m: FloatArray) -> bool:
    """Whether strays are seen at their pixels if they are at these places ``(n, 3)``."""
    pixels = reproject(state.camera, state.position_m, state.rotation, places_m).pixels_px
    return all(
        math.dist(pixel, each.landmark.pixel) <= each.near_px for pixel, each in zip(pixels, strays, strict=True)
    )


def _agree(off_m: FloatArray) -> bool:
    """Whether shifts ``(n, d)`` are finite, equal, and large enough to be one."""
    if not np.all(np.isfinite(off_m)):
        return False
    typical_m = np.median(off_m, axis=0)
    size_m = float(np.linalg.norm(typical_m))
    apart_m = float(np.max(np.linalg.norm(off_m - typical_m, axis=1)))
    return size_m >= _MIN_SHIFT_M and apart_m <= _SAME_M + _SAME * size_m


def _is_behind(state: State, landmark: Landmark) -> bool:
    away = np.array(landmark.position_m, dtype=np.float64) - state.position_m
    return float(state.rotation[:, 2] @ away) <= 0


def _above_horizon(state: State, evidence: Evidence) -> str:
    """Which of a pixel and its place lies above the horizon while the other lies below it; empty if they agree."""
    if isinstance(evidence, Landmark):
        up_m = evidence.position_m[2]
    elif isinstance(evidence, GroundPoint | SlantRange):
        up_m = state.elevation_m
    else:
        return ""
    ray = state.rotation @ rays_from_pixels(state.camera, np.array(evidence.pixel))
    if up_m is None or not np.isfinite(ray[2]):
        return ""
    is_place_above, is_pixel_above = up_m >= float(state.position_m[2]), float(ray[2]) >= 0
    if is_place_above == is_pixel_above:
        return ""
    return "place" if is_place_above else "pixel"


def _names(strays: Sequence[_Stray]) -> str:
    names = [each.landmark.name for each in strays]
    if len(names) > 4:  # noqa: PLR2004 - a sentence, no list
        return f"{', '.join(names[:3])} and {len(names) - 3} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _shown(stated: StatedObservation) -> str:
    pixel = f"pixel [{', '.join(f'{value:.10g}' for value in stated.pixels[0])}]"
    if stated.place is None:
        return pixel
    return f"{pixel} at [{', '.join('?' if value is None else f'{value:.10g}' for value in stated.place)}]"
