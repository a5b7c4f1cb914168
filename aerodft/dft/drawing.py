"""Intervals where first order is not enough: the stated errors are drawn, and every draw is measured.

The draws are a fixed Sobol sequence, so that the same input gives the same bytes. A scalar's interval is the central
95 % of what the draws give: near the horizon it is long on the far side, as the truth's distribution is. The pinhole
model is drawn only; the lens is taken as linear over the errors of pixels and intrinsics.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.dft.projection import ELEVATION, INTRINSICS, POSITION, ROTATION, PixelRays
from aerodft.dft.quantities import KINDS, Sight
from aerodft.dft.uncertainty import CHI2_2D_95
from aerodft.geometry.ground import Ground
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import Pose
from aerodft.model.probe import ProbeKind

DRAWS: Final = 1024
_SEED: Final = 20
_RAYS_AT_ONCE: Final = 16
"""So many rays' draws stay in the cache together."""


_NARROW: Final = 1e-6
"""Of a squared trace: a determinant that is smaller than this share of it is known to half of its digits only."""


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
    scalars, ranges = np.full((2, count), np.nan), np.empty((2, count, on_ground))
    cov = np.empty((count, 3, 3))
    scalar = KINDS[probes.kind].scalar
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for own, seen in _draws(probes, 1):
            ranges[:, own] = _central(seen.ranges_m(on_ground))
            if scalar is not None:
                values = scalar(seen.sight)
                if probes.kind is ProbeKind.BEARING:  # on the same turn as without errors
                    middle = centre[own, None]
                    values = middle + np.remainder(values - middle + np.pi, 2 * np.pi) - np.pi
                scalars[:, own] = _central(values)
            cov[own] = _scatters(seen.points_enu_m[:, 0] - first_enu_m[own, :, None])
    return Drawn(Interval(*scalars), Interval(*ranges), cov)


def draw_ranges(probes: Uncertain, on_ground: int, every: int) -> Interval:
    """A quick look at slant ranges ``(p, k)`` alone, by only every so many-th draw."""
    return Interval(*np.concatenate([_central(seen.ranges_m(on_ground)) for _, seen in _draws(probes, every)], axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class _Draws:
    """What each of ``d`` draws of the stated errors would have seen of ``m`` probes; NaN where a ray misses.

    Attributes:
        cameras_enu_m: ``(m, 3, d)``.
        directions_enu: ``(m, q, 3, d)``.
        points_enu_m: ``(m, q, 3, d)``.
    """

    cameras_enu_m: FloatArray
    directions_enu: FloatArray
    points_enu_m: FloatArray

    @property
    def sight(self) -> Sight:
        """As ``(m, d)`` sights."""
        parts = self.cameras_enu_m, self.directions_enu, self.points_enu_m
        return Sight(*(np.moveaxis(part, -1, 1) for part in parts))

    def ranges_m(self, count: int) -> FloatArray:
        """Slant ranges ``(m, count, d)`` of the first points."""
        away = self.points_enu_m[:, :count] - self.cameras_enu_m[:, None]
        return np.asarray(np.sqrt(np.einsum("mqid,mqid->mqd", away, away)))


def _draws(probes: Uncertain, every: int) -> Iterator[tuple[slice, _Draws]]:
    """The draws of some probes after the other."""
    errors, pixels = probes.shared_cov.shape[-1], probes.rays.rays_cam.shape[1]
    draws = standard_draws(errors + 2 * pixels).T[:, ::every]
    own_draws = np.ascontiguousarray(draws[errors:]).reshape(pixels, 2, -1)
    is_bent = np.any(probes.shared_cov[:, INTRINSICS, INTRINSICS])
    most = max(_RAYS_AT_ONCE // pixels, 1)
    for first in range(0, len(probes.image), most):
        own = slice(first, first + most)
        shared, rotations, poses = _drawn_poses(probes, own, draws[:errors])
        rays_cam = (probes.std_px[own, None, None, None] * probes.rays.by_px[own]) @ own_draws  # (m, q, 3, d)
        rays_cam += probes.rays.rays_cam[own][..., None]
        directions = np.empty(rays_cam.shape)
        for pose, (start, stop) in enumerate(pairwise(np.flatnonzero(np.diff(poses, prepend=-1, append=-2)).tolist())):
            rays = rays_cam[start:stop]  # of one pose: copies of its draws for each would not stay in the cache
            if is_bent:
                by = probes.rays.by_intrinsics[own][start:stop]
                rays += (by.reshape(-1, by.shape[-1]) @ shared[pose, INTRINSICS]).reshape(rays.shape)
            np.einsum("ijd,mqjd->mqid", rotations[pose], rays, out=directions[start:stop])
        cameras = probes.pose.position_enu_m[probes.image[own], :, None] + shared[poses, POSITION]
        elevations = probes.elevation_m[own, None] + shared[poses, ELEVATION]
        yield own, _Draws(cameras, directions, _meet(cameras, directions, elevations, probes.surface))


def _drawn_poses(probes: Uncertain, own: slice, draws: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Draws of what some probes share with those of their image before them.

    Returns:
        Shared errors ``(u, s, d)``, turns ``(u, 3, 3, d)`` from camera axes to ENU, and which of the ``u`` each probe
        has.
    """
    image, elevation_std = probes.image[own], probes.elevation_std_m[own]
    is_new = np.ones(len(image), dtype=np.bool_)
    is_new[1:] = (image[1:] != image[:-1]) | (elevation_std[1:] != elevation_std[:-1])
    cov = probes.shared_cov[image[is_new]]
    cov[:, ELEVATION, ELEVATION] += np.square(elevation_std[is_new])
    variances, axes = np.linalg.eigh(cov)  # a covariance may be singular
    roots = axes * np.sqrt(np.clip(variances, 0.0, None))[:, None]
    shared = (roots.reshape(-1, len(draws)) @ draws).reshape(*cov.shape[:2], -1)
    return shared, _turned(probes.pose.wxyz[image[is_new]], shared[:, ROTATION]), np.cumsum(is_new) - 1


def _turned(wxyz: FloatArray, rotvec_rad: FloatArray) -> FloatArray:
    """Matrices ``(u, 3, 3, d)`` of rotations ``(u, 4)`` after rotation vectors ``(u, 3, d)``."""
    half = np.sqrt(np.einsum("uid,uid->ud", rotvec_rad, rotvec_rad)) / 2
    small = np.empty((len(half), 4, half.shape[-1]))
    small[:, 0] = np.cos(half)
    share = np.sin(half)
    np.divide(share, 2 * half, out=share, where=half > 0)
    np.copyto(share, 0.5, where=half == 0)
    np.multiply(rotvec_rad, share[:, None], out=small[:, 1:])
    w, x, y, z = wxyz.T
    times = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])  # a quaternion's product
    both = math.sqrt(2) * times.transpose(2, 0, 1) @ small
    pairs = both[:, :, None] * both[:, None]
    (ww, wx, wy, wz), (_, xx, xy, xz), (_, _, yy, yz), (_, _, _, zz) = pairs.transpose(1, 2, 0, 3)
    del ww
    found = np.empty((len(half), 3, 3, half.shape[-1]))
    found[:, 0, 0], found[:, 1, 1], found[:, 2, 2] = 1 - (yy + zz), 1 - (xx + zz), 1 - (xx + yy)
    found[:, 0, 1], found[:, 1, 0] = xy - wz, xy + wz
    found[:, 2, 0], found[:, 0, 2] = xz - wy, xz + wy
    found[:, 1, 2], found[:, 2, 1] = yz - wx, yz + wx
    return found


def _meet(cameras: FloatArray, directions: FloatArray, elevations: FloatArray, surface: Ground | None) -> FloatArray:
    """Points ``(m, q, 3, d)`` of rays from cameras ``(m, 3, d)`` on surfaces at elevations ``(m, d)``."""
    if surface is not None:
        starts, rays = np.moveaxis(cameras, 1, -1)[:, None], np.moveaxis(directions, 2, -1)
        return np.moveaxis(surface.meet(starts, rays, elevations[:, None]).points_enu_m, -1, 2)
    down = directions[:, :, 2]
    reach = (elevations - cameras[:, 2])[:, None] / down
    np.copyto(reach, np.nan, where=(down >= 0) | (reach <= 0))
    points = reach[:, :, None] * directions
    points += cameras[:, None]
    return points


def _central(values: FloatArray) -> FloatArray:
    """Low and high end ``(2, ...)`` of the central 95 % of ``values (..., d)``; NaN are beyond everything."""
    count = values.shape[-1]
    tail = 0.025 * (count - 1)
    first, part = int(tail), tail % 1
    places = [first, first + 1, count - 2 - first, count - 1 - first]
    ends = np.partition(values, places, axis=-1)[..., places]
    ends[np.isnan(ends)] = np.inf
    low, next_low, next_high, high = np.moveaxis(ends, -1, 0)
    is_open = ~np.isfinite(high)
    low = np.where(is_open, low, low + part * (next_low - low))
    return np.stack([low, np.where(is_open, high, high - part * (high - next_high))])


def _scatters(away_m: FloatArray) -> FloatArray:
    """Second moments ``(m, 3, 3)`` of what draws ``(m, 3, d)`` are away, scaled so that 95 % ellipses hold 95 %.

    Their shapes are those of the nearer 95 %: a few draws near the horizon would stretch them without bound. Infinite
    where more draws have no point than an ellipse may leave out: the point is refused for its range anyway.
    """
    count = away_m.shape[-1]
    most, level = int(0.95 * count), away_m[:, :2]
    far = np.einsum("mid,mid->md", level, level)
    last, first_beyond = _ordered(far, most - 1)
    holds = ~np.isnan(first_beyond)
    is_near = far <= last[:, None]
    nearest = np.where(is_near[:, None], away_m, 0.0)
    moment = nearest @ nearest.copy().swapaxes(-1, -2)  # of one array with itself it would take three times as long
    moment /= is_near.sum(axis=-1)[:, None, None]
    inverse = _inverse(np.where(holds[:, None, None], moment[:, :2, :2], 0.0))
    scale, _ = _ordered(np.einsum("mid,mid->md", inverse @ level, level), math.ceil(0.95 * count) - 1) / CHI2_2D_95
    return np.where(holds[:, None, None], moment * scale[:, None, None], np.inf)


def _inverse(moments: FloatArray) -> FloatArray:
    """Of symmetric ``(m, 2, 2)``; their pseudo-inverses where these are narrow, or none at all."""
    det = moments[:, 0, 0] * moments[:, 1, 1] - moments[:, 0, 1] * moments[:, 1, 0]
    trace = moments[:, 0, 0] + moments[:, 1, 1]
    found = np.array([[1.0, -1.0], [-1.0, 1.0]]) * moments[:, ::-1, ::-1] / det[:, None, None]
    is_narrow = ~(det > _NARROW * trace * trace)
    if is_narrow.any():
        found[is_narrow] = np.linalg.pinv(moments[is_narrow])
    return found


def _ordered(values: FloatArray, place: int) -> FloatArray:
    """What would stand at a place and at the next one ``(2, m)`` if ``values (m, d)`` were sorted."""
    return np.partition(values, [place, place + 1], axis=-1)[:, place : place + 2].T
