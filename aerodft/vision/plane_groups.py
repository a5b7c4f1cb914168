"""Points that a plane carries from one image to another, by the homography that each group of them follows."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.vision.straight import carried

FREE: Final = 8
"""Elements of a homography."""

_STRAY_PX: Final = 1.0  # what is farther off moves by itself, or lies on something else
_TOGETHER_PX: Final = 0.8
_LAYERS: Final = 2  # land, and water that flows
_DRAWS: Final = 1000
_CONFIDENCE: Final = 0.999
_LEAST_STD_PX: Final = 0.05  # no tracker is better on real images


@dataclass(frozen=True, slots=True, eq=False)
class PlaneGroup:
    """Points that move alike.

    Attributes:
        homography: ``(3, 3)`` that they follow.
        members: ``(n,)``: which they are.
        std_px: Of one coordinate of one of them.
    """

    homography: FloatArray
    members: BoolArray
    std_px: float


def drifting_apart(then: FloatArray, now: FloatArray, off_px: FloatArray, fewest: int) -> list[PlaneGroup]:
    """Two groups of points that have moved apart, each as one: ``off_px (n, 2)`` is how far off the expected they are.

    One homography bends between land and water that has only just begun to flow away; a common step does not. Empty
    where there are not two such steps.
    """
    left, parts = np.arange(len(off_px)), []
    for _ in range(_LAYERS):
        if len(left) < fewest:
            return []
        apart = np.linalg.norm(off_px[left][:, None] - off_px[left], axis=-1) < _TOGETHER_PX
        best = int(np.argmax(np.sum(apart, axis=1)))
        middle = np.mean(off_px[left[apart[best]]], axis=0)
        near = np.linalg.norm(off_px[left] - middle, axis=-1) < _TOGETHER_PX
        if np.count_nonzero(near) < fewest:
            return []
        parts.append(left[near])
        left = left[~near]
    groups = [group for part in parts for group in groups_of(then, now, fewest, part)[:1]]
    return groups if len(groups) == _LAYERS else []


def groups_of(then: FloatArray, now: FloatArray, fewest: int, among: IntArray | None = None) -> list[PlaneGroup]:
    """Homographies that at least so many of the points ``(n, 2)`` follow each, at most two, the largest group first."""
    groups: list[PlaneGroup] = []
    left = np.arange(len(then)) if among is None else among
    while len(left) >= fewest and len(groups) < _LAYERS:
        found, agreeing = cv2.findHomography(
            then[left], now[left], cv2.USAC_MAGSAC, _STRAY_PX, None, _DRAWS, _CONFIDENCE
        )
        if np.shape(found) != (3, 3) or np.count_nonzero(agreeing) < fewest:
            break
        homography, keep = np.asarray(found, dtype=np.float64), agreeing[:, 0] > 0
        members = np.zeros(len(then), dtype=np.bool_)
        members[left[keep]] = True
        off = carried(homography, then[members]) - now[members]
        std_px = math.sqrt(float(np.sum(off**2)) / max(2 * len(off) - FREE, 1))
        groups.append(PlaneGroup(homography, members, std_px))
        left = left[~keep]
    return groups


def carried_std_px(group: PlaneGroup, then: FloatArray, at: FloatArray) -> FloatArray:
    """How well points ``(..., 2)`` are known that a group of ``then (n, 2)`` carries; far away from it, worse.

    Returns:
        ``(...)``, the larger of both coordinates' standard deviations.
    """
    jac = _by_elements(group.homography, then[group.members]).reshape(-1, FREE)
    scale = 1 / np.maximum(np.linalg.norm(jac, axis=0), 1e-12)
    by_sights = _by_elements(group.homography, at) * scale @ np.linalg.pinv(jac * scale)
    std_px = max(group.std_px, _LEAST_STD_PX)
    return np.asarray(std_px * np.max(np.linalg.norm(by_sights, axis=-1), axis=-1))


def _by_elements(homography: FloatArray, points: FloatArray) -> FloatArray:
    """Derivatives ``(..., 2, 8)`` of points ``(..., 2)`` that a homography carries, by its first eight elements."""
    one = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    depth = one @ homography[2]
    at = (one @ homography[:2].T) / depth[..., None]
    by = np.zeros((*points.shape[:-1], 2, 9))
    by[..., 0, :3] = by[..., 1, 3:6] = one / depth[..., None]
    by[..., :, 6:] = -at[..., :, None] * (one / depth[..., None])[..., None, :]
    return by[..., :FREE]
