"""Which sightings of markers can be true together, and how far a pose misses the markers that it has not seen."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri, fdtri

from aerodft.geometry import pixels_from_rays, rays_from_pixels
from aerodft.model import Camera, EvidenceSet, FloatArray, Landmark, MarkerSighting, marker_name
from calibration.pose import LIMIT, Result, State

SIZE: Final = 0.25  # by which a marker may look larger or smaller than it is
STDS: Final = 5.0  # and what its corners' errors may add
_MAX_FALSE: Final = 0.5  # share of the markers that can be false
_MISFIT: Final = 4.0  # times the stated stds: what is larger is no bad luck, and no survey a little worse than stated
_MAX_MISFIT: Final = 10.0
_SURE: Final = 0.99  # that one explanation is better than the next, by the ratio of their variances
_CHANCE: Final = 1e-4  # of a true explanation to be as bad
_MIN_VARIANCE: Final = 0.1  # a fit that is better still is luck

Answer = Callable[[EvidenceSet], Result]


@dataclass(frozen=True, slots=True)
class Miss:
    """Distance by which a pose without a marker misses the marker's centre.

    Attributes:
        id: Of the marker.
        px: In the image; infinite where the pose does not see it.
        away_m: Between the surveyed centre and the ray of the pixel, square to the ray.
    """

    id: int
    px: float
    away_m: float


@dataclass(frozen=True, slots=True)
class Judgement:
    """Sightings of markers judged by their geometry.

    Attributes:
        known: The evidence without what cannot be true.
        false: Why a sighting cannot be true, by id.
        misses: Of each of the others, where the rest determines the camera without it.
        is_checked: There is more evidence than unknowns, so that a false one would have been noticed.
        conflict: Why the evidence cannot be used, though nothing tells which part of it is false; empty where it
            can.
    """

    known: EvidenceSet
    false: dict[int, str]
    misses: tuple[Miss, ...]
    is_checked: bool
    conflict: str


def judge(
    known: EvidenceSet,
    seen: Mapping[int, MarkerSighting],
    sides_m: Mapping[int, float],
    answer: Answer,
) -> Judgement:
    """Leave out sightings that no camera explains together with the rest.

    A marker is false if it is the only one without which everything agrees, if most of its landmarks are outliers of
    the calibration, or if it looks much larger or smaller than it is.

    Args:
        known: All evidence; a marker's landmarks are named as :func:`aerodft.model.marker_name` has it.
        seen: The sightings by id.
        sides_m: Of the markers whose size is known, by id.
        answer: The calibration of evidence: ``calibration.pose.calibrate`` with its other arguments.

    Raises:
        ValueError: Unknowns that there are not, or that exclude each other.
    """
    false: dict[int, str] = {}
    result = answer(known)
    while _determined(result):
        left = [marker for marker in seen if marker not in false]
        found = _disagreeing(result, known, left, answer) or _of_wrong_size(result, seen, left, sides_m)
        if not found or len(false) + len(found) > _MAX_FALSE * len(seen):
            break
        false |= found
        known = _without(known, *found)
        result = answer(known)
    trusted = [marker for marker in seen if marker not in false]
    misses = tuple(_misses(known, trusted, seen, answer)) if _determined(result) else ()
    why_not = _conflict(result, seen, trusted, sides_m)
    return Judgement(known, false, misses, is_checked=result.solution.dof > 0, conflict=why_not)


def _determined(result: Result) -> bool:
    """Whether the evidence would determine every unknown if its errors were as stated."""
    return result.weakest.std_share <= LIMIT * result.solution.sigma_scale


def _conflict(
    result: Result, seen: Mapping[int, MarkerSighting], trusted: list[int], sides_m: Mapping[int, float]
) -> str:
    if not _determined(result):
        return ""
    if result.solution.misfit > _MAX_MISFIT:
        return "no camera explains them all, and they are too few to tell which one is wrong"
    if _of_wrong_size(result, seen, trusted, sides_m):
        ratio = np.median([seen_m / sides_m[marker] for marker, seen_m, _ in _looks(result, seen, trusted, sides_m)])
        return f"where they should be, they look {ratio:.2g} times as large as side_m"
    return ""


def _agrees(result: Result) -> bool:
    """Whether nothing stands off, and errors are not much larger than stated."""
    return bool(np.all(result.solution.kept)) and result.solution.misfit < _MISFIT


def _disagreeing(result: Result, known: EvidenceSet, markers: list[int], answer: Answer) -> dict[int, str]:
    """Markers that do not fit: the one without which all the rest agrees, or else those that the fit rejected."""
    if _agrees(result):
        return {}
    without = {marker: answer(rest) for marker in markers if (rest := _without(known, marker)).evidence}
    if not without:
        return {}
    best, *others = sorted(without, key=lambda marker: _variance(without[marker]))
    explained = without[best]
    if _agrees(explained) and explained.solution.dof > 0 and _determined(explained):
        if all(_variance(without[other]) > _worse_than(explained) for other in others):
            return {best: _off(_distance_px(explained.solution.state, known, best))}
        return {}
    found = {}
    for marker in markers:
        left = [result.left[row] for row in _rows(known, marker)]
        if 2 * sum(each.is_outlier for each in left) > len(left):
            found[marker] = _off(_distance_px(result.solution.state, known, marker))
    return found


def _variance(result: Result) -> float:
    """Variance of the residuals in stated units; infinite where one was rejected, or nothing is to spare."""
    solution = result.solution
    return solution.chi2 / solution.dof if solution.dof > 0 and np.all(solution.kept) else math.inf


def _worse_than(best: Result) -> float:
    """The variance beyond which another explanation is not as good as the best one.

    By what both leave, however the stds were stated; or, where the best one shows that these hold, by them.
    """
    dof, p_value = best.solution.dof, best.solution.p_value or 0.0
    limit = float(fdtri(dof, dof, _SURE)) * max(_variance(best), _MIN_VARIANCE)
    return min(limit, float(chdtri(dof, _CHANCE)) / dof) if p_value > 1 - _SURE else limit


def _off(px: float) -> str:
    return f"it is {f'{px:.0f} px from' if math.isfinite(px) else 'not'} where its surveyed place would be seen"


def _distance_px(state: State, known: EvidenceSet, marker: int) -> float:
    """Root mean square over its landmarks between where they are and where they should be; infinite out of sight."""
    landmarks = [each for row in _rows(known, marker) if isinstance(each := known.evidence[row], Landmark)]
    pixels = np.array([each.pixel for each in landmarks])
    away_m = np.array([each.position_m for each in landmarks], dtype=np.float64) - state.position_m
    off_px = np.linalg.norm(pixels_from_rays(state.camera, away_m @ state.rotation) - pixels, axis=-1)
    px = float(np.sqrt(np.mean(off_px**2)))
    return px if math.isfinite(px) else math.inf


def _rows(known: EvidenceSet, marker: int) -> list[int]:
    """Which of the evidence is a marker's."""
    name = marker_name(marker)
    return [index for index, each in enumerate(known.evidence) if each.name == name or each.name.startswith(f"{name} ")]


def _without(known: EvidenceSet, *markers: int) -> EvidenceSet:
    rejected = {row for marker in markers for row in _rows(known, marker)}
    return replace(known, evidence=tuple(each for row, each in enumerate(known.evidence) if row not in rejected))


def _of_wrong_size(
    result: Result, seen: Mapping[int, MarkerSighting], markers: list[int], sides_m: Mapping[int, float]
) -> dict[int, str]:
    return {
        marker: f"it looks {seen_m:.2g} m wide at its surveyed place, and is {sides_m[marker]:.2g} m"
        for marker, seen_m, std in _looks(result, seen, markers, sides_m)
        if abs(math.log(seen_m / sides_m[marker])) > math.log1p(SIZE) + STDS * std
    }


def _looks(
    result: Result, seen: Mapping[int, MarkerSighting], markers: list[int], sides_m: Mapping[int, float]
) -> Iterator[tuple[int, float, float]]:
    """Id, apparent side (m) and that one's relative std of each marker whose side is known."""
    state = result.solution.state
    for marker in markers:
        centre_m = _centre_m(result.problem.known, marker)
        if marker in sides_m and centre_m is not None:
            angle, angle_std = apparent_side(state.camera, seen[marker])
            yield marker, angle * float(np.linalg.norm(centre_m - state.position_m)), angle_std / angle


def apparent_side(camera: Camera, seen: MarkerSighting) -> tuple[float, float]:
    """A square's side over its distance, with its std: of all directions on it, one is square to the line of sight."""
    rays = rays_from_pixels(camera, np.array([seen.pixel, *seen.corners]))
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    centre, corners = rays[0], rays[1:]
    across = corners / (corners @ centre)[:, None] - centre
    edges = np.stack([across[1] - across[0] + across[2] - across[3], across[3] - across[0] + across[2] - across[1]]) / 2
    return float(np.linalg.svd(edges, compute_uv=False)[0]), seen.corner_std_px / camera.fx_px


def _centre_m(known: EvidenceSet, marker: int) -> FloatArray | None:
    """Mean place ``(3,)`` of a marker's landmarks; None where none has a known place."""
    evidence = (known.evidence[row] for row in _rows(known, marker))
    places = [each.position_m for each in evidence if isinstance(each, Landmark)]
    return np.mean(np.array(places, dtype=np.float64), axis=0) if places else None


def _misses(
    known: EvidenceSet, markers: list[int], seen: Mapping[int, MarkerSighting], answer: Answer
) -> Iterator[Miss]:
    for marker in markers:
        rest, centre_m = _without(known, marker), _centre_m(known, marker)
        if centre_m is None or not rest.evidence:
            continue
        without = answer(rest)
        if not _determined(without):
            continue
        state, pixel = without.solution.state, np.array(seen[marker].pixel)
        towards = centre_m - state.position_m
        expected = pixels_from_rays(state.camera, state.rotation.T @ towards)
        ray = state.rotation @ rays_from_pixels(state.camera, pixel)
        px = float(np.linalg.norm(expected - pixel))
        away_m = float(np.linalg.norm(np.cross(towards, ray)) / np.linalg.norm(ray))
        yield Miss(marker, px if math.isfinite(px) else math.inf, away_m)
