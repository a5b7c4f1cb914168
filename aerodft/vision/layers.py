"""What moves on a plane by itself, told from the plane: land from the water that flows beside it.

A homography has two degrees of freedom more than a camera over a known plane, enough to pass between the motions of
land and water as if they were one. With the normal and about the turn known, from telemetry, each is found by itself:
``X2 ~ R' X1 + s n'X1`` is linear in a small turn and in ``s``, and three points give both.
"""

from collections.abc import Sequence

import numpy as np

from aerodft.geometry.rotation import from_rotation_vector, inverse, matrix, skew
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.vision.homography import FEWEST, motion_of
from aerodft.vision.matches import ImagePair, Matches
from aerodft.vision.rotation import PlaneMotion

_LAYERS = 2
_NEAR_PX = 0.6  # of what a motion foretells: water that flows by a pixel is told from land
_DRAWS = 150
_LEAST_SHARE = 0.2  # of a pair's points: smaller groups are strays
_POINTS = 3  # that give a motion
_ROUNDS = 3


def layered_motion(pairs: Sequence[ImagePair], rotvec_rad: FloatArray, normal_cam: FloatArray) -> PlaneMotion:
    """The homographies of what moves alike in each pair: one or two of a pair, none where nothing does.

    Args:
        pairs: ``n`` image pairs.
        rotvec_rad: ``(n, 3)`` about how the camera turned, ``earlier_SO3_later``.
        normal_cam: ``(n, 3)`` the plane's normal in the earlier camera's axes.
    """
    draws = np.random.default_rng(0)
    fits: list[tuple[ImagePair, Matches, FloatArray]] = []
    for pair, turn, normal in zip(pairs, rotvec_rad, normal_cam, strict=True):
        back = matrix(inverse(from_rotation_vector(turn)))
        left = pair.matches
        fewest = max(FEWEST, _LEAST_SHARE * len(left))
        for _ in range(_LAYERS):
            found = _layer(left, back, normal, draws) if len(left) >= fewest else None
            if found is None or np.count_nonzero(found[0]) < fewest:
                break
            fits.append((pair, left.where(found[0]), found[1]))
            left = left.where(~found[0])
    return motion_of(fits)


def _layer(
    matches: Matches, back: FloatArray, normal_cam: FloatArray, draws: np.random.Generator
) -> tuple[BoolArray, FloatArray] | None:
    """The largest group that one motion explains ``(n,)``, and its homography ``(3, 3)``."""
    jac, off = _equations(matches, back, normal_cam)
    picks = draws.integers(0, len(matches), (_DRAWS, _POINTS))
    system, right = jac[picks].reshape(_DRAWS, 6, 6), off[picks].reshape(_DRAWS, 6, 1)
    whole = np.abs(np.linalg.det(system)) > 0
    if not np.any(whole):
        return None
    motions = np.linalg.solve(system[whole], right[whole])[..., 0]
    misfit = np.einsum("pij,dj->dpi", jac, motions) - off
    near = np.sum(misfit**2, axis=-1) < _NEAR_PX**2
    best = int(np.argmax(np.sum(near, axis=1)))
    group, motion = near[best], motions[best]
    for _ in range(_ROUNDS):
        if np.count_nonzero(group) < FEWEST:
            return None
        motion = np.linalg.lstsq(jac[group].reshape(-1, 6), off[group].ravel(), rcond=None)[0]
        group = np.sum((jac @ motion - off) ** 2, axis=-1) < _NEAR_PX**2
    homography = (np.eye(3) - skew(motion[:3])) @ back + np.outer(motion[3:], normal_cam)
    return group, homography / homography[2, 2]


def _equations(matches: Matches, back: FloatArray, normal_cam: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``(n, 2, 6)`` and ``(n, 2)``, in pixels: linear in a turn in the later camera's axes, and in the shift."""
    one = np.ones(len(matches))
    rays = np.column_stack([matches.earlier, one])
    turned = rays @ back.T
    by = np.concatenate([skew(turned), (rays @ normal_cam)[:, None, None] * np.eye(3)], axis=-1)
    scale = (matches.px * turned[:, 2])[:, None]
    jac = (by[:, :2] - matches.later[..., None] * by[:, 2:]) / scale[..., None]
    return jac, (matches.later * turned[:, 2:] - turned[:, :2]) / scale
