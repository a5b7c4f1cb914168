"""Intervals where first order is not enough: the stated errors are drawn, and every draw is measured.

The draws are a fixed Sobol sequence, so that the same input gives the same bytes. A scalar's interval is the central
95 % of what the draws give: near the horizon it is long on the far side, as the truth's distribution is. The pinhole
model is drawn only; the lens is taken as linear over the errors of pixels and intrinsics.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from aerodft.dft.projection import ELEVATION, INTRINSICS, POSITION, ROTATION, PixelRays
from aerodft.dft.quantities import KINDS, Sight, slant_range
from aerodft.dft.uncertainty import CHI2_2D_95
from aerodft.geometry.ground import Ground
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import Pose
from aerodft.model.probe import ProbeKind

DRAWS: Final = 1024
_SEED: Final = 20
_RAYS_AT_ONCE: Final = 24
"""So many rays' draws stay in the cache together."""


@lru_cache(maxsize=16)
def standard_draws(dimensions: int) -> FloatArray:
    """``(DRAWS, dimensions)`` standard normal draws, always the same ones, symmetric in every dimension."""
    from scipy.special import ndtri  # noqa: PLC0415 - half a second with what follows, and most commands never draw
    from scipy.stats import qmc  # noqa: PLC0415

    half = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(_SEED)).random(DRAWS // 2)
    normal = ndtri(np.clip(half, 1e-9, 1 - 1e-9))
    draws = np.asfortranarray(np.concatenate([normal, -normal]))
    draws.setflags(write=False)
    return draws


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertain:
    """Probes of one kind that are to be drawn: ``p`` of them, with ``q`` pixels each.

    Attributes:
        kind: What is measured.
        pose: The ``(n,)`` poses of the images.
        shared_cov: ``(n, s, s)``, without what probes know of their own elevation.
        rays: Of the probes' pixels, ``(p, q)``.
        surface: What elevations are counted from; None for the level plane at 0.
        image: ``(p,)`` which image each is seen in, ascending.
        elevation_m: ``(p,)`` of the measured surface.
        elevation_std_m: ``(p,)``.
        std_px: ``(p,)`` of each pixel coordinate.
    """

    kind: ProbeKind
    pose: Pose
    shared_cov: FloatArray
    rays: PixelRays
    surface: Ground | None
    image: IntArray
    elevation_m: FloatArray
    elevation_std_m: FloatArray
    std_px: FloatArray


@dataclass(frozen=True, slots=True)
class Interval:
    """The central 95 % of a scalar over all draws, ``(...)``; draws without an answer count as beyond everything."""

    low: FloatArray
    high: FloatArray

    @property
    def half(self) -> FloatArray:
        """Half of its width; NaN where both ends are beyond everything."""
        return (self.high - self.low) / 2


@dataclass(frozen=True, slots=True)
class Drawn:
    """What drawing the errors of ``p`` probes gave.

    Attributes:
        scalar: ``(p,)``; NaN for a position.
        ranges: ``(p, k)`` slant ranges of the points that lie on the ground.
        cov_enu_m2: ``(p, 3, 3)`` of the first point: its 95 % ellipse holds 95 % of the draws.
    """

    scalar: Interval
    ranges: Interval
    cov_enu_m2: FloatArray


def draw(probes: Uncertain, on_ground: int, centre: FloatArray, first_enu_m: FloatArray) -> Drawn:
    """Draw the stated errors.

    Args:
        probes: The probes.
        on_ground: How many of their points, from the first, lie on the ground.
        centre: ``(p,)`` their values without errors; NaN for a position.
        first_enu_m: ``(p, 3)`` their first points without errors.
    """
    count = len(probes.image)
    ends, ranges = np.full((2, count), np.nan), np.empty((2, count, on_ground))
    cov = np.empty((count, 3, 3))
    scalar = KINDS[probes.kind].scalar
    for own, sights in _sights(probes, 1):
        found = _range_intervals(sights, on_ground)
        ranges[0, own], ranges[1, own] = found.low, found.high
        if scalar is not None:
            values = scalar(sights)
            if probes.kind is ProbeKind.BEARING:  # on the same turn as without errors
                middle = centre[own, None]
                values = middle + np.remainder(values - middle + np.pi, 2 * np.pi) - np.pi
            interval = _interval(values)
            ends[0, own], ends[1, own] = interval.low, interval.high
        cov[own] = _scatters(sights.points_enu_m[..., 0, :], first_enu_m[own])
    return Drawn(Interval(*ends), Interval(*ranges), cov)


def draw_ranges(probes: Uncertain, on_ground: int, every: int) -> Interval:
    """A quick look at slant ranges ``(p, k)`` alone, by only every so many-th draw."""
    found = [_range_intervals(sights, on_ground) for _, sights in _sights(probes, every)]
    return Interval(np.concatenate([each.low for each in found]), np.concatenate([each.high for each in found]))


def _sights(probes: Uncertain, every: int) -> Iterator[tuple[slice, Sight]]:
    """What each draw of the stated errors would have seen of some probes ``(m, DRAWS / every)`` after the other.

    Points are NaN where a draw's ray misses the ground.
    """
    errors, pixels = probes.shared_cov.shape[-1], probes.rays.rays_cam.shape[1]
    draws = standard_draws(errors + 2 * pixels).T[:, ::every]
    own_draws = np.ascontiguousarray(draws[errors:]).reshape(pixels, 2, -1)
    is_bent = np.any(probes.shared_cov[:, INTRINSICS, INTRINSICS])
    most = max(_RAYS_AT_ONCE // pixels, 1)
    for first in range(0, len(probes.image), most):
        own = slice(first, first + most)
        shared, rotations, poses = _drawn_poses(probes, own, draws[:errors])
        by_px = probes.std_px[own, None, None, None] * probes.rays.by_px[own]
        rays_cam = by_px @ own_draws  # (m, q, 3, d)
        rays_cam += probes.rays.rays_cam[own][..., None]
        if is_bent:
            by = probes.rays.by_intrinsics[own]
            bent = by.reshape(len(by), -1, by.shape[-1]) @ shared[poses, INTRINSICS]
            rays_cam += bent.reshape(rays_cam.shape)
        turns = rotations[poses][:, None]  # (m, 1, 3, 3, d)
        directions = np.empty(rays_cam.shape)
        for row in range(3):
            directions[:, :, row] = turns[:, :, row, 0] * rays_cam[:, :, 0]
            directions[:, :, row] += turns[:, :, row, 1] * rays_cam[:, :, 1]
            directions[:, :, row] += turns[:, :, row, 2] * rays_cam[:, :, 2]
        cameras = (probes.pose.position_enu_m[probes.image[own], :, None] + shared[poses, POSITION])[:, None]
        elevations = (probes.elevation_m[own, None] + shared[poses, ELEVATION])[:, None]
        points = _meet(cameras, directions, elevations, probes.surface)
        yield own, Sight(_last(cameras[:, 0]), _last(directions), _last(points))


def _last(vectors: FloatArray) -> FloatArray:
    """``(m, q, 3, d)`` as ``(m, d, q, 3)``, and ``(m, 3, d)`` as ``(m, d, 3)``, where they are."""
    return np.moveaxis(vectors, -1, 1)


def _drawn_poses(probes: Uncertain, own: slice, draws: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Draws of what some probes share with others of their image.

    Returns:
        Shared errors ``(u, s, d)``, turns ``(u, 3, 3, d)`` from camera axes to ENU, and which of the ``u`` each probe
        has.
    """
    keys = np.stack([probes.image[own], probes.elevation_std_m[own]], axis=-1)
    of_images, poses = np.unique(keys, axis=0, return_inverse=True)
    images = of_images[:, 0].astype(np.int64)
    cov = probes.shared_cov[images]
    cov[:, ELEVATION, ELEVATION] += np.square(of_images[:, 1])
    variances, axes = np.linalg.eigh(cov)  # a covariance may be singular
    roots = axes * np.sqrt(np.clip(variances, 0.0, None))[:, None]
    shared = (roots.reshape(-1, len(draws)) @ draws).reshape(len(images), len(draws), -1)
    turned = _matrices(shared[:, ROTATION])
    rotations = matrix(probes.pose.wxyz[images]) @ turned.reshape(len(images), 3, -1)
    return shared, rotations.reshape(turned.shape), poses.reshape(-1)


def _matrices(rotvec_rad: FloatArray) -> FloatArray:
    """Rotation matrices ``(u, 3, 3, d)`` of rotation vectors ``(u, 3, d)``."""
    x, y, z = (rotvec_rad[:, axis] for axis in range(3))
    half = np.sqrt(x * x + y * y + z * z) / 2
    w, share = np.cos(half), 0.5 * np.sinc(half / np.pi)  # sin(half) / angle, regular at 0
    x, y, z = x * share, y * share, z * share
    found = np.empty((len(x), 3, 3, x.shape[-1]))
    found[:, 0, 0], found[:, 0, 1], found[:, 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    found[:, 1, 0], found[:, 1, 1], found[:, 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    found[:, 2, 0], found[:, 2, 1], found[:, 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return found


def _meet(cameras: FloatArray, directions: FloatArray, elevations: FloatArray, surface: Ground | None) -> FloatArray:
    """Points ``(m, q, 3, d)`` of rays from cameras ``(m, 1, 3, d)`` on surfaces at elevations ``(m, 1, d)``."""
    if surface is not None:
        met = surface.meet(np.moveaxis(cameras, 2, -1), np.moveaxis(directions, 2, -1), elevations)
        return np.moveaxis(met.points_enu_m, -1, 2)
    down = directions[:, :, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (elevations - cameras[:, :, 2]) / down
        reach[(down >= 0) | (reach <= 0)] = np.nan
        return np.asarray(cameras + reach[:, :, None] * directions)


def _range_intervals(sights: Sight, on_ground: int) -> Interval:
    """Of the slant ranges ``(m, k)`` of the first points."""
    points = sights.points_enu_m
    count = len(points)
    found = [
        _interval(slant_range(Sight(sights.camera_enu_m, points[..., :0, :], points[..., k : k + 1, :])))
        for k in range(on_ground)
    ]
    if not found:
        return Interval(np.empty((count, 0)), np.empty((count, 0)))
    return Interval(*(np.stack([getattr(each, end) for each in found], axis=-1) for end in ("low", "high")))


def _interval(values: FloatArray) -> Interval:
    """The central 95 % of ``values (m, d)``; NaN are beyond everything."""
    count = values.shape[-1]
    tail = 0.025 * (count - 1)
    first, part = int(tail), tail % 1
    ordered = np.sort(values, axis=-1)
    ends = ordered[:, [first, first + 1, count - 2 - first, count - 1 - first]]
    low, next_low, next_high, high = np.where(np.isnan(ends), np.inf, ends).T
    with np.errstate(invalid="ignore"):
        is_open = ~np.isfinite(high)
        inner = high - part * (high - next_high)
        return Interval(np.where(is_open, low, low + part * (next_low - low)), np.where(is_open, high, inner))


def _scatters(draws_enu_m: FloatArray, centre_enu_m: FloatArray) -> FloatArray:
    """Second moments ``(m, 3, 3)`` about the measured points, scaled so that their 95 % ellipses hold 95 % of draws.

    Their shapes are those of the nearer 95 %: a few draws near the horizon would stretch them without bound. Infinite
    where more draws have no point than an ellipse may leave out: the point is refused for its range anyway.
    """
    away = np.moveaxis(draws_enu_m, -1, 1) - centre_enu_m[:, :, None]  # (m, 3, d)
    count = away.shape[-1]
    with np.errstate(invalid="ignore", over="ignore"):
        far = away[:, 0] ** 2 + away[:, 1] ** 2  # squared
        far[np.isnan(far)] = np.inf
        last = int(0.95 * count) - 1
        is_near = far <= np.partition(far, last, axis=-1)[:, last, None]
        nearest = np.where(is_near[:, None], away, 0.0)
        moment = nearest @ nearest.swapaxes(-1, -2) / np.count_nonzero(is_near, axis=-1)[:, None, None]
        holds = np.count_nonzero(np.isinf(far), axis=-1) <= math.floor(0.05 * count)
        inverse = np.linalg.pinv(np.where(holds[:, None, None], moment[:, :2, :2], 0.0))
        east, north = away[:, 0], away[:, 1]
        squared = east * (east * inverse[:, 0, 0, None] + 2 * north * inverse[:, 0, 1, None])
        squared += north * north * inverse[:, 1, 1, None]
        squared[np.isnan(squared)] = np.inf
        last = math.ceil(0.95 * count) - 1
        scale = np.partition(squared, last, axis=-1)[:, last] / CHI2_2D_95
        return np.where(holds[:, None, None], moment * scale[:, None, None], np.inf)
