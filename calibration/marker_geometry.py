"""Which sightings of markers can be true together, and how far a pose misses the markers that it has not seen."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.geometry.lens import pixels_from_rays, rays_from_pixels
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.evidence import EvidenceSet, Landmark
from aerodft.model.marker import MarkerSighting, marker_name
from aerodft.model.measurement import ProjectionModel
from calibration.result import Result, calibrate
from calibration.state import State

_SIZE: Final = 0.25  # by which a marker may look larger or smaller than it is
_STDS: Final = 5.0  # and what its corners' errors may add
_MOST: Final = 0.5  # share of the markers that can be false


@dataclass(frozen=True, slots=True)
class Miss:
    """How far a pose that has not seen a marker misses its centre.

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
    """What geometry says of sightings.

    Attributes:
        known: The evidence without what cannot be true.
        false: Why a sighting cannot be true, by id.
        misses: Of each of the others, where the rest determines the camera without it.
        is_checked: There is more evidence than unknowns, so that a false one would have been noticed.
    """

    known: EvidenceSet
    false: dict[int, str]
    misses: tuple[Miss, ...]
    is_checked: bool


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of the evidence: the arguments of ``calibration.result.calibrate``."""

    camera: Camera
    names: tuple[str, ...]
    model: ProjectionModel = ProjectionModel.PINHOLE

    def answer(self, known: EvidenceSet) -> Result:
        """The calibration."""
        return calibrate(known, self.camera, self.names, self.model)


def judge(
    known: EvidenceSet,
    seen: Mapping[int, MarkerSighting],
    sides_m: Mapping[int, float],
    question: Question,
) -> Judgement:
    """Leave out sightings that no camera explains together with the rest.

    A marker is false where most of its landmarks are outliers of the calibration, or where it looks much larger or
    smaller than it is.

    Args:
        known: All evidence; a marker's landmarks are named as :func:`aerodft.model.marker.marker_name` has it.
        seen: The sightings by id.
        sides_m: Of the markers whose size is known, by id.
        question: What is asked.

    Raises:
        ValueError: As ``calibration.result.calibrate``.
    """
    false: dict[int, str] = {}
    result = question.answer(known)
    while result.weakest.is_determined:
        left = [marker for marker in seen if marker not in false]
        found = _far(result, known, left) or _of_wrong_size(result.solution.state, known, seen, left, sides_m)
        if not found or len(false) + len(found) > _MOST * len(seen):
            break
        false |= found
        known = _without(known, *found)
        result = question.answer(known)
    trusted = [marker for marker in seen if marker not in false]
    misses = tuple(_misses(known, trusted, seen, question)) if result.weakest.is_determined else ()
    return Judgement(known, false, misses, is_checked=result.solution.dof > 0)


def _rows(known: EvidenceSet, marker: int) -> list[int]:
    """Which of the evidence is a marker's."""
    name = marker_name(marker)
    return [index for index, each in enumerate(known.evidence) if each.name == name or each.name.startswith(f"{name} ")]


def _without(known: EvidenceSet, *markers: int) -> EvidenceSet:
    gone = {row for marker in markers for row in _rows(known, marker)}
    return replace(known, evidence=tuple(each for row, each in enumerate(known.evidence) if row not in gone))


def _far(result: Result, known: EvidenceSet, markers: list[int]) -> dict[int, str]:
    found = {}
    for marker in markers:
        left = [result.left[row] for row in _rows(known, marker)]
        if 2 * sum(each.is_outlier for each in left) > len(left):
            px = max(each.px for each in left)
            off = f"{px:.0f} px from where" if math.isfinite(px) else "not where"
            found[marker] = f"it is {off} its surveyed place would be seen"
    return found


def _of_wrong_size(
    state: State,
    known: EvidenceSet,
    seen: Mapping[int, MarkerSighting],
    markers: list[int],
    sides_m: Mapping[int, float],
) -> dict[int, str]:
    found = {}
    for marker in markers:
        centre_m = _centre_m(known, marker)
        if marker not in sides_m or centre_m is None:
            continue
        distance_m = float(np.linalg.norm(centre_m - state.position_m))
        angle, angle_std = _apparent_side(state.camera, seen[marker])
        ratio = angle * distance_m / sides_m[marker]
        if abs(math.log(ratio)) > math.log1p(_SIZE) + _STDS * angle_std / angle:
            side_m = angle * distance_m
            found[marker] = f"it looks {side_m:.2g} m wide at its surveyed place, and is {sides_m[marker]:.2g} m"
    return found


def _apparent_side(camera: Camera, seen: MarkerSighting) -> tuple[float, float]:
    """A square's side over its distance, with its std: of all directions on it, one is square to the line of sight."""
    rays = rays_from_pixels(camera, np.array([seen.pixel, *seen.corners]))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    centre, corners = rays[0], rays[1:]
    across = corners / (corners @ centre)[:, None] - centre
    edges = np.stack([across[1] - across[0] + across[2] - across[3], across[3] - across[0] + across[2] - across[1]]) / 2
    return float(np.linalg.svd(edges, compute_uv=False)[0]), seen.corner_std_px / camera.fx_px


def _centre_m(known: EvidenceSet, marker: int) -> FloatArray | None:
    """Of its landmarks; None where there is none of known place."""
    evidence = (known.evidence[row] for row in _rows(known, marker))
    places = [each.position_m for each in evidence if isinstance(each, Landmark)]
    return np.mean(np.array(places, dtype=np.float64), axis=0) if places else None


def _misses(
    known: EvidenceSet, markers: list[int], seen: Mapping[int, MarkerSighting], question: Question
) -> Iterator[Miss]:
    for marker in markers:
        without = question.answer(_without(known, marker))
        centre_m = _centre_m(known, marker)
        if centre_m is None or not without.weakest.is_determined:
            continue
        state, pixel = without.solution.state, np.array(seen[marker].pixel)
        towards = centre_m - state.position_m
        expected = pixels_from_rays(state.camera, state.rotation.T @ towards)
        ray = state.rotation @ rays_from_pixels(state.camera, pixel)
        px = float(np.linalg.norm(expected - pixel))
        away_m = float(np.linalg.norm(np.cross(towards, ray)) / np.linalg.norm(ray))
        yield Miss(marker, px if math.isfinite(px) else math.inf, away_m)
