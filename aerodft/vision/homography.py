"""Homographies of image pairs, robustly, and how well they are known."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from aerodft.geometry.robust import robust_std
from aerodft.model.arrays import FloatArray
from aerodft.vision.matches import ImagePair, Matches
from aerodft.vision.rotation import FREE, PlaneMotion

FEWEST = 30
"""Points that a homography is made of, at least."""

STRAY_PX = 0.5
"""A point that is farther off lies on something else: water that flows, a tree, a walker."""

_NOISE_PX = 0.05  # what tracking is never better than
_DRAWS, _CONFIDENCE = 500, 0.999
_ROUNDS = 4
_STUDENT = 5.0  # degrees of freedom of the residuals' t distribution


def plane_motion(pairs: Iterable[ImagePair]) -> PlaneMotion:
    """The homography that most points of each pair follow; pairs without one are left out."""
    fits = []
    for pair in pairs:
        start = _consensus(pair.matches)
        if start is not None:
            near = _off_px(start, pair.matches) < 2 * STRAY_PX
            if np.count_nonzero(near) >= FEWEST:
                fits.append((pair, pair.matches.where(near), start))
    return motion_of(fits)


def motion_of(fits: Sequence[tuple[ImagePair, Matches, FloatArray]]) -> PlaneMotion:
    """Maximum-likelihood homographies, under t-distributed errors.

    Args:
        fits: Pairs, those of their points that move together, and about what homography they follow.
    """
    found = [_refined(start, matches) for _, matches, start in fits]
    return PlaneMotion(
        start_ns=np.array([pair.start_ns for pair, _, _ in fits], dtype=np.int64),
        end_ns=np.array([pair.end_ns for pair, _, _ in fits], dtype=np.int64),
        homography=np.array([homography for homography, _ in found]).reshape(-1, 3, 3),
        cov=np.array([cov for _, cov in found]).reshape(-1, FREE, FREE),
    )


def _consensus(matches: Matches) -> FloatArray | None:
    if len(matches) < FEWEST:
        return None
    stray = STRAY_PX * float(np.median(matches.px))
    found, _ = cv2.findHomography(matches.earlier, matches.later, cv2.USAC_MAGSAC, stray, None, _DRAWS, _CONFIDENCE)
    return np.asarray(found / found[2, 2]) if np.shape(found) == (3, 3) and found[2, 2] != 0 else None


def _off_px(homography: FloatArray, matches: Matches) -> FloatArray:
    at, _ = _carried(homography, matches.earlier)
    return np.asarray(np.linalg.norm(at - matches.later, axis=-1) / matches.px)


def _refined(h: FloatArray, matches: Matches) -> tuple[FloatArray, FloatArray]:
    """The homography ``(3, 3)``, and the covariance ``(8, 8)`` of its free elements."""
    for _ in range(_ROUNDS):
        at, by = _carried(h, matches.earlier)
        off_px = (matches.later - at) / matches.px[:, None]
        std_px = max(robust_std(off_px), _NOISE_PX)
        weight = (_STUDENT + 2) / (_STUDENT + np.sum(off_px**2, axis=-1) / std_px**2)
        jac = (by / matches.px[:, None, None]).reshape(-1, FREE)
        weighted = (jac * np.repeat(weight, 2)[:, None]).T
        information = weighted @ jac
        h = h + np.append(np.linalg.solve(information, weighted @ off_px.ravel()), 0.0).reshape(3, 3)
    return h, np.linalg.inv(information) * std_px**2


def _carried(h: FloatArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points ``(n, 2)`` under a homography, and their derivatives ``(n, 2, 8)`` by its free elements."""
    one = np.column_stack([xy, np.ones(len(xy))])
    moved = one @ h.T
    at = moved[:, :2] / moved[:, 2:]
    by = np.zeros((len(xy), 2, 9))
    by[:, 0, :3] = by[:, 1, 3:6] = one / moved[:, 2:]
    by[:, :, 6:] = -at[:, :, None] * (one / moved[:, 2:])[:, None, :]
    return at, by[..., :FREE]
