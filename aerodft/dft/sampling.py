"""Intervals where first order is not enough: the stated errors are drawn, and every draw is measured.

The draws are a fixed Sobol sequence, so that the same input gives the same bytes. A scalar's interval is the central
95 % of what the draws give: near the horizon it is long on the far side, as the truth's distribution is.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtri

from aerodft.dft.projection import ELEVATION, FOCAL, POSITION, PRINCIPAL_POINT, ROTATION, SHARED
from aerodft.dft.quantities import Sight
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.geometry.rotation import from_rotation_vector, matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose

DRAWS = 1024


@lru_cache(maxsize=16)
def standard_draws(dimensions: int) -> FloatArray:
    """``(DRAWS, dimensions)`` standard normal draws, always the same ones, symmetric in every dimension."""
    from scipy.stats import qmc  # noqa: PLC0415 - takes a second to load, and most commands never draw

    half = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(20)).random(DRAWS // 2)
    normal = ndtri(np.clip(half, 1e-9, 1 - 1e-9))
    draws = np.concatenate([normal, -normal])
    draws.setflags(write=False)
    return draws


def draw_sights(
    camera: Camera,
    pose: Pose,
    pixels_px: FloatArray,
    elevation_m: float,
    shared_cov: FloatArray,
    std_px: float,
) -> Sight:
    """What each draw of the stated errors would have seen, with the pinhole model.

    Args:
        camera: The camera; its lens is taken as linear over the pixels' errors.
        pose: The pose.
        pixels_px: ``(k, 2)``.
        elevation_m: Of the measured plane.
        shared_cov: ``(10, 10)``, ordered as in ``projection``.
        std_px: Of each pixel coordinate.

    Returns:
        ``DRAWS`` sights; points are NaN where a draw's ray misses the plane.
    """
    count = len(pixels_px)
    draws = standard_draws(SHARED + 2 * count)
    shared = draws[:, :SHARED] @ _root(shared_cov).T
    own = std_px * draws[:, SHARED:].reshape(DRAWS, count, 2) - shared[:, None, PRINCIPAL_POINT]
    rays = rays_with_jacobian(camera, pixels_px)
    rays_cam = rays.rays_cam + np.einsum("kij,nkj->nki", rays.jac_px, own)
    rays_cam += shared[:, None, FOCAL, None] * rays.jac_focal
    rotations = matrix(pose.wxyz) @ matrix(from_rotation_vector(shared[:, ROTATION]))
    directions = np.einsum("nij,nkj->nki", rotations, rays_cam)
    cameras = pose.position_enu_m + shared[:, POSITION]
    planes = elevation_m + shared[:, ELEVATION]
    down = directions[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (planes - cameras[:, 2])[:, None] / down
        points = cameras[:, None] + reach[..., None] * directions
    points[(down >= 0) | (reach <= 0)] = np.nan
    return Sight(cameras, directions, points)


@dataclass(frozen=True, slots=True)
class Spread:
    """A scalar over all draws: the central 95 %, and the share of draws without an answer."""

    low: float
    high: float
    missing: float


def spread(values: FloatArray) -> Spread:
    """The central 95 % of ``values (n,)``; draws without an answer count as beyond everything."""
    ordered = np.sort(np.where(np.isnan(values), np.inf, values))
    tail = 0.025 * (len(ordered) - 1)
    low, high = np.quantile(ordered, [0.025, 0.975]) if np.isfinite(ordered[-1]) else _ends(ordered, tail)
    return Spread(float(low), float(high), float(np.mean(np.isnan(values))))


def _ends(ordered: FloatArray, tail: float) -> tuple[float, float]:
    return float(ordered[int(tail)]), float(ordered[-1 - int(tail)])


def _root(cov: FloatArray) -> FloatArray:
    """A square root of a covariance that may be singular."""
    variances, axes = np.linalg.eigh(cov)
    return np.asarray(axes * np.sqrt(np.clip(variances, 0.0, None)))
