"""Points that a plane carries from one image to another, by the homography that each group of them follows."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.geometry.robust import robust_std
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.vision.plane_errors import FREE, by_elements, change_between, changed
from aerodft.vision.straight import carried

_STRAY_PX: Final = 1.0  # what is farther off moves by itself, or lies on something else
_TOGETHER_PX: Final = 0.8
_LAYERS: Final = 2  # land, and water that flows
_STEPS: Final = 4  # that are told apart: water does not flow everywhere alike
_EXPLAINED: Final = 0.6  # of the points: where fewer go with a step, a step is not how they go
_DRAWS: Final = 1000
_CONFIDENCE: Final = 0.999
_LEAST_STD_PX: Final = 0.05  # no tracker is better on real images
_ROUNDS: Final = 4
_STUDENT: Final = 5.0  # degrees of freedom of the residuals' t distribution
_ALIKE: Final = 3.0  # points whose windows overlap are off alike: so many say as much as one
_UNKNOWN: Final = 1e4  # variance of elements that nothing is known of


@dataclass(frozen=True, slots=True, eq=False)
class PlaneGroup:
    """Points that move alike.

    Attributes:
        homography: ``(3, 3)`` that they follow.
        cov: ``(8, 8)`` of that, as in ``plane_errors``.
        members: ``(n,)``: which they are.
    """

    homography: FloatArray
    cov: FloatArray
    members: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """Points of the plane in two images, and what is known of its homography without them.

    Attributes:
        then: ``(n, 2)`` straight small pixels.
        now: ``(n, 2)`` likewise.
        unit: ``(3, 3)`` intrinsics that elements are in units of.
        foretold: ``(3, 3)``.
        foretold_cov: ``(8, 8)`` of that; None where nothing is known.
    """

    then: FloatArray
    now: FloatArray
    unit: FloatArray
    foretold: FloatArray
    foretold_cov: FloatArray | None


def groups_of(seen: Matched, off_px: FloatArray, fewest: int, fewest_foretold: int) -> list[PlaneGroup]:
    """What moves alike, at most four groups.

    One homography bends between land and water that has only just begun to flow away; a common step does not: first
    it is tried to part all points by their steps.

    Args:
        seen: The points.
        off_px: ``(n, 2)`` how far each is off the expected.
        fewest: Points that a group has, at least.
        fewest_foretold: Likewise, of groups that telemetry helps with.
    """
    if seen.foretold_cov is not None:
        parts = _apart(off_px, fewest_foretold)
        found = [_fitted(seen, seen.foretold, part) for part in parts]
        found = [group for group in found if np.count_nonzero(group.members) >= fewest_foretold]
        explained = sum((group.members for group in found), np.zeros(len(off_px), dtype=np.bool_))
        if np.count_nonzero(explained) >= max(_EXPLAINED * len(off_px), fewest):
            return found
    groups: list[PlaneGroup] = []
    left = np.arange(len(seen.then))
    while len(left) >= fewest and len(groups) < _LAYERS:
        found_h, agreeing = cv2.findHomography(
            seen.then[left], seen.now[left], cv2.USAC_MAGSAC, _STRAY_PX, None, _DRAWS, _CONFIDENCE
        )
        if np.shape(found_h) != (3, 3) or np.count_nonzero(agreeing) < fewest or not found_h[2, 2]:
            break
        keep = agreeing[:, 0] > 0
        groups.append(_fitted(seen, np.asarray(found_h / found_h[2, 2], dtype=np.float64), left[keep]))
        left = left[~keep]
        fewest = fewest_foretold if seen.foretold_cov is not None else fewest
    return [group for group in groups if np.count_nonzero(group.members) >= fewest_foretold]


def _apart(off_px: FloatArray, fewest: int) -> list[IntArray]:
    """Groups of points that have moved apart, each as one: the indices of each, the largest first."""
    left = np.arange(len(off_px))
    parts: list[IntArray] = []
    while len(left) >= fewest and len(parts) < _STEPS:
        apart = np.linalg.norm(off_px[left][:, None] - off_px[left], axis=-1) < _TOGETHER_PX
        best = int(np.argmax(np.sum(apart, axis=1)))
        middle = np.mean(off_px[left[apart[best]]], axis=0)
        near = np.linalg.norm(off_px[left] - middle, axis=-1) < _TOGETHER_PX
        if np.count_nonzero(near) < fewest:
            break
        parts.append(left[near])
        left = left[~near]
    return parts


def _fitted(seen: Matched, start: FloatArray, rows: IntArray) -> PlaneGroup:
    """The most likely homography of some points and all that agree with them."""
    first = _refined(seen, start, rows)
    near = np.flatnonzero(first.members)
    return _refined(seen, first.homography, near) if len(near) else first


def _refined(seen: Matched, start: FloatArray, rows: IntArray) -> PlaneGroup:
    """The most likely homography of some points, under t-distributed errors and what is foretold."""
    then, now, unit = seen.then[rows], seen.now[rows], seen.unit
    prior = np.eye(FREE) / _UNKNOWN if seen.foretold_cov is None else np.linalg.inv(seen.foretold_cov)
    homography, cov = start, np.eye(FREE)
    for _ in range(_ROUNDS):
        at = carried(homography, then)
        off = now - at
        std_px = max(robust_std(off) * math.sqrt(_corrected(len(then))), _LEAST_STD_PX)
        weight = (_STUDENT + 2) / (_STUDENT + np.sum(off**2, axis=-1) / std_px**2) / (_ALIKE * std_px**2)
        jac = by_elements(unit, at).reshape(-1, FREE)
        weighted = (jac * np.repeat(weight, 2)[:, None]).T
        cov = np.linalg.inv(weighted @ jac + prior)
        known = np.zeros(FREE) if seen.foretold_cov is None else prior @ change_between(homography, seen.foretold, unit)
        homography = changed(homography, cov @ (weighted @ off.ravel() + known), unit)
    members = np.linalg.norm(carried(homography, seen.then) - seen.now, axis=-1) < _STRAY_PX
    return PlaneGroup(homography, np.asarray(cov), np.asarray(members))


def _corrected(points: int) -> float:
    """Over what a variance of residuals is too small, because a homography has been fitted to them."""
    return 2 * points / max(2 * points - FREE, 1)
