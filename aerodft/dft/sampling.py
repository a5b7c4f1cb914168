"""Intervals where first order is not enough: the stated errors are drawn, and every draw is measured.

The draws are a fixed Sobol sequence, so that the same input gives the same bytes. A scalar's interval is the central
95 % of what the draws give: near the horizon it is long on the far side, as the truth's distribution is.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from aerodft.dft.projection import ELEVATION, INTRINSICS, POSITION, ROTATION
from aerodft.dft.quantities import Sight
from aerodft.dft.seen import Seen
from aerodft.dft.sobol import MOST_DIMENSIONS, scrambled_sobol
from aerodft.geometry.intrinsics import rays_by_intrinsics
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.geometry.rotation import from_rotation_vector, matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose

DRAWS = 1024
_SEED = 20
_FEW_PIXELS = 4  # 100 kB of draws


def _points(dimensions: int) -> FloatArray:
    if dimensions <= MOST_DIMENSIONS:
        return scrambled_sobol(dimensions, DRAWS // 2, _SEED)
    from scipy.stats import qmc  # noqa: PLC0415 - 40 MB and 0.4 s, and few probes have so many pixels

    points: FloatArray = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(_SEED)).random(DRAWS // 2)
    return points


@lru_cache(maxsize=16)
def standard_draws(dimensions: int) -> FloatArray:
    """``(DRAWS, dimensions)`` standard normal draws, always the same ones, symmetric in every dimension."""
    from scipy.special import ndtri  # noqa: PLC0415 - 12 MB and 0.1 s, and most commands never draw

    half = _points(dimensions)
    normal = ndtri(np.clip(half, 1e-9, 1 - 1e-9))
    draws = np.concatenate([normal, -normal])
    draws.setflags(write=False)
    return draws


def draw_sights(seen: Seen, every: int = 1) -> Sight:
    """What each draw of the stated errors would have seen, with the pinhole model.

    The lens is taken as linear over the errors of pixels and intrinsics.

    Args:
        seen: The probe.
        every: Only every so many-th draw, for a quick look.

    Returns:
        ``DRAWS / every`` sights; points are NaN where a draw's ray misses the ground.
    """
    count, errors = len(seen.pixels_px), len(seen.shared_cov)
    shared, rotations = _drawn_poses(seen.pose, seen.shared_cov.tobytes(), errors + 2 * count)
    shared, rotations = shared[::every], rotations[::every]
    drawn_pixels = _remembered_pixels if count <= _FEW_PIXELS else _drawn_pixels
    moved = drawn_pixels(seen.camera, seen.pixels_px.tobytes(), seen.std_px, errors)[:, ::every]
    if np.any(seen.shared_cov[INTRINSICS, INTRINSICS]):
        moved = moved + shared[:, INTRINSICS] @ rays_by_intrinsics(seen.camera, seen.pixels_px).swapaxes(-1, -2)
    rays_cam = rays_with_jacobian(seen.camera, seen.pixels_px).rays_cam + moved.transpose(1, 0, 2)
    directions = rays_cam @ rotations.swapaxes(-1, -2)
    cameras = seen.pose.position_enu_m + shared[:, POSITION]
    elevations = seen.elevation_m + shared[:, ELEVATION]
    if seen.surface is None:
        points = _meet_level(cameras, directions, elevations)
    else:
        points = seen.surface.meet(cameras[:, None], directions, elevations[:, None]).points_enu_m
    return Sight(cameras, directions, points)


def _drawn_pixels(camera: Camera, pixels: bytes, std_px: float, errors: int) -> FloatArray:
    """What draws of its ``k`` pixels' own errors add to a probe's rays: ``(k, DRAWS, 3)``, not to be written to."""
    pixels_px = np.frombuffer(pixels).reshape(-1, 2)
    draws = standard_draws(errors + 2 * len(pixels_px))
    own = std_px * draws[:, errors:].reshape(len(draws), -1, 2)
    jac_px = rays_with_jacobian(camera, pixels_px).jac_px
    moved = own.transpose(1, 0, 2) @ jac_px.swapaxes(-1, -2)  # a product for each pixel
    moved.setflags(write=False)
    return np.asarray(moved)


_remembered_pixels = lru_cache(maxsize=16)(_drawn_pixels)  # fixed probes ask for the same in every image


@lru_cache(maxsize=4)
def _drawn_poses(pose: Pose, shared_cov: bytes, dimensions: int) -> tuple[FloatArray, FloatArray]:
    """Draws of the shared errors ``(DRAWS, s)``, and ``(DRAWS, 3, 3)`` to ENU: the same for most probes of an image."""
    cov = np.frombuffer(shared_cov).reshape(math.isqrt(len(shared_cov) // 8), -1)
    shared = standard_draws(dimensions)[:, : len(cov)] @ _root(cov).T
    return shared, matrix(pose.wxyz) @ matrix(from_rotation_vector(shared[:, ROTATION]))


def _meet_level(cameras: FloatArray, directions: FloatArray, elevations: FloatArray) -> FloatArray:
    down, points = directions[..., 2], np.empty(directions.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (elevations - cameras[:, 2])[:, None] / down
        for axis in range(3):  # in a third of the time that all of them at once take
            points[..., axis] = cameras[:, None, axis] + reach * directions[..., axis]
    points[(down >= 0) | (reach <= 0)] = np.nan
    return points


@dataclass(frozen=True, slots=True)
class Spread:
    """A scalar over all draws: the central 95 %."""

    low: float
    high: float


def spread(values: FloatArray) -> Spread:
    """The central 95 % of ``values (n,)``; draws without an answer count as beyond everything."""
    ordered = np.sort(np.where(np.isnan(values), np.inf, values))
    tail = 0.025 * (len(ordered) - 1)
    first, part = int(tail), tail % 1
    low, high = ordered[first : first + 2].tolist(), ordered[-2 - first : len(ordered) - first].tolist()
    if not math.isfinite(high[1]):
        return Spread(low[0], high[1])
    return Spread(low[0] + part * (low[1] - low[0]), high[1] - part * (high[1] - high[0]))


def _root(cov: FloatArray) -> FloatArray:
    """A square root of a covariance that may be singular."""
    variances, axes = np.linalg.eigh(cov)
    return np.asarray(axes * np.sqrt(np.clip(variances, 0.0, None)))
