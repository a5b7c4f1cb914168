"""Landmarks and pixels that belong together otherwise than a file has them."""

import math
from itertools import permutations
from typing import Final

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from aerodft.geometry import rays_from_pixels
from aerodft.model import Camera, FloatArray, IntArray

_MIN_LANDMARKS: Final = 6  # three give a pose, three more say that it is no chance
_MAX_LANDMARKS: Final = 16  # 3,360 orders of three pixels: half a second
_NEAR_SHARE: Final = 0.03
"""Distance of a pixel from its landmark by a pose of three others, with the errors of all, as a share of the image's
diagonal. Chosen: half of it misses clicks with a std of 3 px, twice of it matches more orders. A fit decides."""


def other_order(places_m: FloatArray, pixels: FloatArray, camera: Camera) -> IntArray | None:
    """Index of the pixel of each landmark ``(n,)`` in the order in which one camera sees all; None where none does.

    A pose follows from three landmarks at each order of three pixels (P3P).

    Args:
        places_m: ``(n, 3)`` landmarks, east, north and up.
        pixels: ``(n, 2)`` pixels, in whatever order.
        camera: The camera.
    """
    rays = rays_from_pixels(camera, pixels)
    if not _MIN_LANDMARKS <= len(pixels) <= _MAX_LANDMARKS or not np.all(rays[:, 2] > 0):
        return None
    seen = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    near = _NEAR_SHARE * math.hypot(camera.width_px, camera.height_px) / camera.fx_px
    points_m = places_m - places_m.mean(axis=0)
    three = _wide_triangle(points_m)
    best, least = None, np.inf
    for order in permutations(range(len(seen)), 3):
        for away in _distances(points_m, seen, three, order):
            if not np.all(np.min(away, axis=1) <= near):
                continue
            rows, columns = linear_sum_assignment(away)
            total = float(np.sum(away[rows, columns]))
            if total < least and np.all(away[rows, columns] <= near):
                best, least = columns.astype(np.int64), total
    return best


def _wide_triangle(points_m: FloatArray) -> list[int]:
    """Three landmarks far apart: the farthest from the middle, from it, and from the line of both."""
    first = int(np.argmax(np.linalg.norm(points_m, axis=1)))
    from_first = points_m - points_m[first]
    second = int(np.argmax(np.linalg.norm(from_first, axis=1)))
    third = int(np.argmax(np.linalg.norm(np.cross(from_first, from_first[second]), axis=1)))
    return [first, second, third]


def _distances(points_m: FloatArray, seen: FloatArray, three: list[int], order: tuple[int, ...]) -> list[FloatArray]:
    """Distances ``(n, n)`` of projected landmarks from pixels, in focal lengths, by each pose of three of them."""
    try:
        _, rotations, translations = cv2.solveP3P(points_m[three], seen[list(order)], np.eye(3), None, cv2.SOLVEPNP_P3P)
    except cv2.error:  # three landmarks in a line
        return []
    found = []
    for rotation, translation in zip(rotations, translations, strict=True):
        in_camera = points_m @ cv2.Rodrigues(rotation)[0].T + translation.ravel()
        if np.all(in_camera[:, 2] > 0):
            projected = in_camera[:, :2] / in_camera[:, 2:]
            found.append(np.linalg.norm(projected[:, None] - seen, axis=-1))
    return found
