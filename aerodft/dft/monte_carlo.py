"""Intervals where first order is not enough: the stated errors are drawn, and every draw is measured.

The draws are a fixed Sobol sequence, so that the same input gives the same bytes. A scalar's interval is the central
95 % of what the draws give: near the horizon it is long on the far side, as the truth's distribution is. The pinhole
model is drawn only; the lens is taken as linear over the errors of pixels and intrinsics.

A camera's turn about the vertical is drawn apart from how it leans, and composed with that: ``Rz(turn) exp(lean) R``.
An unknown heading moves points around the camera's foot, however large its error is, and nothing else.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, TypeAlias

import numpy as np

from aerodft.dft.covariance import CHI2_2D_95
from aerodft.dft.probe_kinds import PROBE_KINDS
from aerodft.dft.projection import ELEVATION, INTRINSICS, ROTATION, PixelRays
from aerodft.dft.quantities import RayGeometry
from aerodft.geometry import Ground, camera_angles, matrix
from aerodft.jit import njit, njit_fused
from aerodft.model import BoolArray, FloatArray, IntArray, Pose, ProbeKind

DRAWS: Final = 1024
_SEED: Final = 20
_EVEN: Final = 64
_AT_ONCE: Final = 32 * DRAWS
"""So many draws of rays stay in the cache together."""

_EVERY: Final = slice(None)
_FEW: Final = np.r_[0:8, DRAWS // 2 : DRAWS // 2 + 8]
"""Eight draws, each of another eighth of every error, and their mirror images."""

_TURN: Final = ROTATION.stop - 1
_SINGULAR: Final = 1e-12
"""Of an error's variance: what is less than this share of it follows from the errors before it."""
_ROUNDING: Final = 1e-14
"""Of a rotation's variance: what rounding makes of it about other axes."""

_NARROW: Final = 1e-6
"""Of a squared trace: a determinant that is smaller than this share of it is known to half of its digits only."""


_DrawnRays: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""What each of ``d`` draws would have seen of ``m`` probes: cameras ``(m, 3, d)``; directions and points of pixels
``(m, q, 3, d)``, NaN where a ray misses."""


@lru_cache(maxsize=16)
def standard_draws(dimensions: int) -> FloatArray:
    """``(DRAWS, dimensions)`` standard normal draws, always the same ones, symmetric in every dimension."""
    from scipy.special import ndtri  # noqa: PLC0415 - half a second with what follows, and most commands never draw
    from scipy.stats import qmc  # noqa: PLC0415

    half = qmc.Sobol(min(dimensions, _EVEN), scramble=True, rng=np.random.default_rng(_SEED)).random(DRAWS // 2)
    if dimensions > _EVEN:  # in more dimensions so few points of the sequence go together
        more = qmc.LatinHypercube(dimensions - _EVEN, rng=np.random.default_rng(_SEED)).random(DRAWS // 2)
        half = np.concatenate([half, more], axis=1)
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
        ranges: ``(p, k)`` slant ranges of the points that lie on the ground.
        is_known: ``(p,)`` whether these are known well enough; the rest is NaN where they are not.
        scalar: ``(p,)``; NaN for a position.
        cov_enu_m2: ``(p, 3, 3)`` of the first point on the ground: its 95 % ellipse holds 95 % of the draws.
    """

    ranges: Interval
    is_known: BoolArray
    scalar: Interval
    cov_enu_m2: FloatArray


def draw(probes: Uncertain, most_half_m: FloatArray, centre: FloatArray, first_enu_m: FloatArray) -> Drawn:
    """Draw the stated errors.

    Args:
        probes: The probes.
        most_half_m: ``(p, k)`` half of the widest interval of a slant range that is known well enough, of the points
            that lie on the ground: the first ``k``.
        centre: ``(p,)`` their values without errors; NaN for a position.
        first_enu_m: ``(p, 3)`` their first points without errors.
    """
    count, on_ground = most_half_m.shape
    scalars, ranges = np.full((2, count), np.nan), np.empty((2, count, on_ground))
    cov, is_known = np.full((count, 3, 3), np.nan), np.empty(count, dtype=np.bool_)
    kind = PROBE_KINDS[probes.kind]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for own, every in _draws(probes, _EVERY):
            ranges[:, own] = _central(_ranges(every, on_ground))
            is_known[own] = np.all(Interval(*ranges[:, own]).half <= most_half_m[own], axis=-1)
            known = np.flatnonzero(is_known[own])
            if not len(known):
                continue
            rows, seen = own.start + known, every if is_known[own].all() else tuple(part[known] for part in every)
            if kind.scalar is not None:
                values = kind.scalar(RayGeometry(*(np.moveaxis(part, -1, 1) for part in seen)))
                if kind.is_angle:
                    values = _on_turn_of(centre[rows, None], values)
                scalars[:, rows] = _around(values, centre[rows])
            if on_ground:
                cov[rows] = _scatters(np.ascontiguousarray(seen[-1][:, 0]), first_enu_m[rows])
    return Drawn(Interval(*ranges), is_known, Interval(*scalars), cov)


def draw_ranges(probes: Uncertain, on_ground: int, every: int) -> Interval:
    """A quick look at slant ranges ``(p, k)`` alone, by only every so many-th draw."""
    some = slice(None, None, every)
    return Interval(*np.concatenate([_central(_ranges(seen, on_ground)) for _, seen in _draws(probes, some)], axis=1))


def beyond_first_order(probes: Uncertain, by_shared: FloatArray, by_px: FloatArray, first: FloatArray) -> FloatArray:
    """What a few draws differ by from first order ``(p, c, 16)``: infinite where a draw has no answer.

    Args:
        probes: The probes.
        by_shared: ``(p, c, s)`` derivatives of their value, or of the east and north of a position.
        by_px: ``(p, c, q, 2)``.
        first: ``(p, c)`` those without errors.
    """
    kind, count = PROBE_KINDS[probes.kind], by_shared.shape[-1]
    normal = standard_draws(count + 2 * by_px.shape[2]).T[:, _FEW]
    roots, poses = _roots(probes)
    turned = by_shared.copy()
    turned[..., ROTATION] = by_shared[..., ROTATION] @ matrix(probes.pose.wxyz)[probes.image].swapaxes(-1, -2)
    own = probes.std_px[:, None, None] * by_px.reshape(*first.shape, -1)
    linear = first[..., None] + (turned @ roots[poses]) @ normal[:count] + own @ normal[count:]
    if kind.scalar is None:
        found = np.concatenate([points[:, 0, :2] for _, (_, _, points) in _draws(probes, _FEW)])
    else:
        values = _values(probes, _FEW)
        found = (_on_turn_of(first, values) if kind.is_angle else values)[:, None]
    return np.where(np.isfinite(found), found - linear, np.inf)


@dataclass(frozen=True, slots=True)
class DrawnLengths:
    """What noise makes of ``p`` lines.

    Attributes:
        longer_m: ``(p,)`` how much longer the pixels' noise makes them.
        interval: ``(p,)`` 95 % of their errors, from all that is uncertain, about 0.
    """

    longer_m: FloatArray
    interval: Interval


def draw_lengths(smooth: Uncertain) -> DrawnLengths:
    """Draw lines whose vertices are hardly farther apart than their pixels' noise.

    A vertex that is off across the line makes it longer, whichever side it is off to: noise that is drawn about noisy
    vertices would do so twice. It is drawn about smoothed ones, whose steps are nearly as long as the true ones.

    Args:
        smooth: The lines through smoothed pixels.
    """
    sure = replace(smooth, std_px=np.zeros_like(smooth.std_px))
    exact = replace(sure, shared_cov=np.zeros_like(smooth.shared_cov), elevation_std_m=np.zeros_like(smooth.std_px))
    noisy, shared = _values(smooth, _EVERY), _values(sure, _EVERY)
    longer_m = np.nanmean(noisy - shared, axis=-1)
    return DrawnLengths(longer_m, Interval(*_central(noisy - _values(exact, _FEW)[:, :1] - longer_m[:, None])))


def _values(probes: Uncertain, some: slice | IntArray) -> FloatArray:
    """What draws of probes of a kind that has a scalar come to, ``(p, d)``."""
    scalar, found = PROBE_KINDS[probes.kind].scalar, []
    assert scalar is not None  # noqa: S101 - the callers' own condition, for the type checker
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found += [scalar(RayGeometry(*(np.moveaxis(part, -1, 1) for part in seen))) for _, seen in _draws(probes, some)]
    return np.concatenate(found)


def _on_turn_of(middle_rad: FloatArray, angles_rad: FloatArray) -> FloatArray:
    """Angles within half a turn of ``middle_rad``."""
    return middle_rad + np.remainder(angles_rad - middle_rad + np.pi, 2 * np.pi) - np.pi


def _roots(probes: Uncertain) -> tuple[FloatArray, IntArray]:
    """Roots ``(u, s, s)`` of covariances of the shared errors, and which of them each probe ``(p,)`` has.

    Rotations are about east, north and up. The turn about the vertical comes last, so that no other error is drawn
    otherwise for it; horizontal axes turn with the camera, so that headings make no difference.
    """
    image = probes.image
    is_new = np.ones(len(image), dtype=np.bool_)
    is_new[1:] = (image[1:] != image[:-1]) | (probes.elevation_std_m[1:] != probes.elevation_std_m[:-1])
    cov = probes.shared_cov[image[is_new]]
    cov[:, ELEVATION, ELEVATION] += np.square(probes.elevation_std_m[is_new])
    wxyz = probes.pose.wxyz[image[is_new]]
    _, _, heading = camera_angles(wxyz)
    level = np.zeros((len(cov), 3, 3))  # right, ahead and up in ENU
    level[:, 0, 0] = level[:, 1, 1] = np.cos(heading)
    level[:, 1, 0] = np.sin(heading)
    level[:, 0, 1], level[:, 2, 2] = -level[:, 1, 0], 1.0
    turn = level @ matrix(wxyz)
    cov[:, ROTATION] = turn @ cov[:, ROTATION]
    cov[..., ROTATION] = cov[..., ROTATION] @ turn.swapaxes(-1, -2)
    least = _SINGULAR * np.diagonal(cov, axis1=1, axis2=2)
    lean = slice(ROTATION.start, _TURN)  # axes that nothing leans about have the turn's rounding errors
    least[:, lean] += _ROUNDING * np.trace(cov[:, ROTATION, ROTATION], axis1=1, axis2=2)[:, None]
    order = np.r_[:_TURN, ROTATION.stop : cov.shape[-1], _TURN]
    roots = np.empty(cov.shape)
    roots[:, order] = _semidefinite_roots(np.ascontiguousarray(cov[:, order[:, None], order]), least[:, order])
    roots[:, ROTATION] = level.swapaxes(-1, -2) @ roots[:, ROTATION]
    return roots, np.cumsum(is_new) - 1


@njit
def _semidefinite_roots(covs: FloatArray, least: FloatArray) -> FloatArray:
    """Lower triangles ``(u, s, s)`` of which covariances ``(u, s, s)``, that may be singular, are the squares.

    Variances of ``least (u, s)`` and less, beside what follows from the errors before, are none.
    """
    roots = np.zeros(covs.shape)
    for u in range(len(covs)):
        root = roots[u]
        for j in range(covs.shape[1]):
            pivot = covs[u, j, j]
            for k in range(j):
                pivot -= root[j, k] * root[j, k]
            if not pivot > least[u, j]:
                continue
            root[j, j] = math.sqrt(pivot)
            for i in range(j + 1, covs.shape[1]):
                rest = covs[u, i, j]
                for k in range(j):
                    rest -= root[i, k] * root[j, k]
                root[i, j] = rest / root[j, j]
    return roots


def _draws(probes: Uncertain, some: slice | IntArray) -> Iterator[tuple[slice, _DrawnRays]]:
    """The draws, all or some of them, of some probes after the other."""
    image, rays, errors = probes.image, probes.rays, probes.shared_cov.shape[-1]
    pixels = rays.rays_cam.shape[1]
    draws = np.ascontiguousarray(standard_draws(errors + 2 * pixels).T[:, some])
    roots, poses = _roots(probes)
    is_bent = np.any(probes.shared_cov[:, INTRINSICS, INTRINSICS])
    by_px = probes.std_px[:, None, None, None] * rays.by_px
    by_intrinsics = np.ascontiguousarray(rays.by_intrinsics[..., slice(None if is_bent else 0)])
    wxyz, cameras_m = probes.pose.wxyz[image], probes.pose.position_enu_m[image]
    size = draws.shape[1]
    most = max(_AT_ONCE // (size * pixels), 1)
    # Each piece is drawn into the memory of the one before: new memory takes longer than draws.
    room = np.empty((most, 3, size)), np.empty((most, size)), *np.empty((2, most, pixels, 3, size))
    for first in range(0, len(image), most):
        own = slice(first, first + most)
        pose, place = (poses[own], roots, wxyz[own]), (cameras_m[own], probes.elevation_m[own])
        pixel_rays = rays.rays_cam[own], by_px[own], by_intrinsics[own]
        cameras, elevations, directions, points = (part[: len(image) - first] for part in room)
        _see(pose, place, pixel_rays, draws, (cameras, elevations, directions, points))
        if probes.surface is not None:
            starts, away = np.moveaxis(cameras, 1, -1)[:, None], np.moveaxis(directions, 2, -1)
            points = np.moveaxis(probes.surface.meet(starts, away, elevations[:, None]).points_enu_m, -1, 2)
        yield own, (cameras, directions, np.ascontiguousarray(points))


@njit_fused
def _see(
    shared_by: tuple[IntArray, FloatArray, FloatArray],
    places: tuple[FloatArray, FloatArray],
    rays: tuple[FloatArray, FloatArray, FloatArray],
    draws: FloatArray,
    seen: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> None:
    """What ``m`` probes would have seen, draw by draw.

    Args:
        shared_by: ``(m,)`` whose draws of shared errors each probe has; roots ``(u, s, s)`` of these errors'
            covariances; rotations ``(m, 4)``.
        places: Cameras ``(m, 3)`` and elevations ``(m,)``.
        rays: ``(m, q, 3)`` in camera axes; by standard deviations of the pixels ``(m, q, 3, 2)``; by the intrinsics.
        draws: ``(s + 2 q, d)`` standard normal ones.
        seen: Receives cameras ``(m, 3, d)``, elevations ``(m, d)``, directions ``(m, q, 3, d)``, and points
            ``(m, q, 3, d)`` of the level planes at the elevations.
    """
    (poses, roots, wxyz), (camera_m, elevation_m), (rays_cam, by_px, by_intrinsics) = shared_by, places, rays
    cameras, elevations, directions, points = seen
    (count, pixels, _), size, errors = rays_cam.shape, draws.shape[1], roots.shape[1]
    shared, turn, ray = np.empty((errors, size)), np.empty((9, size)), np.empty((3, size))
    last = -1
    for m in range(count):
        if poses[m] != last:
            last = poses[m]
            shared[:] = 0.0
            for i in range(errors):
                _add(roots[last, i], draws, shared[i])
            _turn(wxyz[m], shared[3:6], turn)
        elevations[m] = elevation_m[m] + shared[6]
        for axis in range(3):
            cameras[m, axis] = camera_m[m, axis] + shared[axis]
        for k in range(pixels):
            for axis in range(3):
                ray[axis] = rays_cam[m, k, axis]
                _add(by_px[m, k, axis], draws[errors + 2 * k :], ray[axis])
                _add(by_intrinsics[m, k, axis], shared[7:], ray[axis])
            _meet(cameras[m], elevations[m], turn, ray, directions[m, k], points[m, k])


@njit_fused
def _add(factors: FloatArray, values: FloatArray, total: FloatArray) -> None:
    """Add to ``total (d,)`` the first of ``values (..., d)``, each times its factor."""
    for i in range(len(factors)):
        factor, row = factors[i], values[i]
        if factor != 0.0:
            for d in range(len(total)):
                total[d] += factor * row[d]


@njit_fused
def _turn(wxyz: FloatArray, errors_rad: FloatArray, found: FloatArray) -> None:
    """Rows of the matrices ``(9, d)`` of a rotation after errors ``(3, d)`` about east and north, then about up."""
    b, c, e, f = wxyz
    for d in range(errors_rad.shape[1]):  # by itself: what calls for sines takes one draw at a time
        x, y = errors_rad[0, d], errors_rad[1, d]
        angle = math.sqrt(x * x + y * y)
        found[0, d] = math.cos(angle / 2)
        found[1, d] = math.sin(angle / 2) / angle if angle > 0.0 else 0.5
        found[2, d] = math.cos(errors_rad[2, d] / 2)
        found[3, d] = math.sin(errors_rad[2, d] / 2)
    for d in range(errors_rad.shape[1]):
        x, y, cosine, sine = found[1, d] * errors_rad[0, d], found[1, d] * errors_rad[1, d], found[2, d], found[3, d]
        s, p, q, r = cosine * found[0, d], cosine * x - sine * y, cosine * y + sine * x, sine * found[0, d]
        w, x = s * b - p * c - q * e - r * f, s * c + p * b + q * f - r * e  # a quaternion's product
        y, z = s * e - p * f + q * b + r * c, s * f + p * e - q * c + r * b
        found[0, d], found[4, d], found[8, d] = (
            1 - 2 * (y * y + z * z),
            1 - 2 * (x * x + z * z),
            1 - 2 * (x * x + y * y),
        )
        found[1, d], found[3, d] = 2 * (x * y - w * z), 2 * (x * y + w * z)
        found[6, d], found[2, d] = 2 * (x * z - w * y), 2 * (x * z + w * y)
        found[5, d], found[7, d] = 2 * (y * z - w * x), 2 * (y * z + w * x)


@njit_fused
def _meet(
    camera: FloatArray, elevation: FloatArray, turn: FloatArray, ray: FloatArray, away: FloatArray, points: FloatArray
) -> None:
    """Turn rays ``(3, d)`` in camera axes into directions ``away``, and find their points on level planes."""
    for axis in range(3):
        by_x, by_y, by_z = turn[3 * axis], turn[3 * axis + 1], turn[3 * axis + 2]
        for d in range(len(elevation)):
            away[axis, d] = by_x[d] * ray[0, d] + by_y[d] * ray[1, d] + by_z[d] * ray[2, d]
    for d in range(len(elevation)):
        reach = (elevation[d] - camera[2, d]) / away[2, d]
        if not (away[2, d] < 0.0 and reach > 0.0):
            reach = np.nan
        points[0, d] = camera[0, d] + reach * away[0, d]
        points[1, d] = camera[1, d] + reach * away[1, d]
        points[2, d] = camera[2, d] + reach * away[2, d]


@njit_fused
def _ranges(seen: _DrawnRays, count: int) -> FloatArray:
    """Slant ranges ``(m, count, d)`` of the first points."""
    cameras, _, points = seen
    found = np.empty((len(points), count, points.shape[3]))
    for m in range(len(points)):
        for k in range(count):
            camera, point, out = cameras[m], points[m, k], found[m, k]
            for d in range(len(out)):
                x, y, z = point[0, d] - camera[0, d], point[1, d] - camera[1, d], point[2, d] - camera[2, d]
                out[d] = math.sqrt(x * x + y * y + z * z)
    return found


def _central(values: FloatArray) -> FloatArray:
    """Low and high end ``(2, ...)`` of the central 95 % of ``values (..., d)``; NaN are beyond everything."""
    return _ends(np.ascontiguousarray(values).reshape(-1, values.shape[-1])).reshape(2, *values.shape[:-1])


def _around(values: FloatArray, centre: FloatArray) -> FloatArray:
    """Ends ``(2, m)`` of 95 % of ``values (m, d)``: the central ones, or those next to ``centre (m,)`` outside of them.

    Of two pixels in one place all draws are apart: what they hold is 95 % of the draws, and the distance 0.
    """
    low, high = ends = _central(values)
    for row in np.flatnonzero((centre < low) | (centre > high)).tolist():
        own, last = np.sort(np.where(np.isnan(values[row]), np.inf, values[row])), values.shape[1] - 1
        if centre[row] < low[row]:
            low[row], at = centre[row], np.searchsorted(own, centre[row]) + 0.95 * last
            high[row] = own[min(math.ceil(at), last)]
        else:
            high[row], at = centre[row], np.searchsorted(own, centre[row]) - 0.95 * last
            low[row] = own[max(math.floor(at), 0)]
    return ends


@njit
def _ends(rows: FloatArray) -> FloatArray:
    tail = 0.025 * (rows.shape[1] - 1)
    first, part = int(tail), tail % 1
    low, high = _outermost(rows, first, 1.0), -_outermost(rows, first, -1.0)
    for r in range(len(rows)):
        if math.isfinite(high[0, r]):
            low[0, r] += part * (low[1, r] - low[0, r])
            high[0, r] -= part * (high[0, r] - high[1, r])
    return np.stack((low[0], high[0]))


@njit
def _outermost(rows: FloatArray, place: int, sign: float) -> FloatArray:
    """What would stand at a place and at the next one ``(2, r)`` if ``sign * rows (r, d)`` were sorted.

    NaN are beyond everything, as infinity is: ``sign`` times that.
    """
    found, kept = np.empty((2, len(rows))), np.empty(place + 3)  # the smallest so far, from the largest of them
    for r in range(len(rows)):
        kept[:-1], kept[-1] = np.inf, -np.inf
        for value in rows[r]:
            signed = sign * (np.inf if math.isnan(value) else value)
            if signed < kept[0]:
                for at in range(place + 2):  # without a branch: several at once
                    kept[at] = max(min(signed, kept[at]), kept[at + 1])
        found[0, r], found[1, r] = kept[1], kept[0]
    return found


def _scatters(points_m: FloatArray, middle_m: FloatArray) -> FloatArray:
    """Second moments ``(m, 3, 3)`` of draws ``(m, 3, d)`` about ``(m, 3)``, scaled so that 95 % ellipses hold 95 %.

    Their shapes are those of the nearer 95 %: a few draws near the horizon would stretch them without bound. Of a point
    whose range is known well enough, more draws than these meet the ground.
    """
    count = points_m.shape[-1]
    far = _squares(points_m, middle_m, np.tile(np.eye(2), (len(points_m), 1, 1)))
    farthest = -_outermost(far, count - int(0.95 * count) - 1, -1.0)[1]
    moment = _moments(points_m, middle_m, far <= farthest[:, None])
    squares = _squares(points_m, middle_m, _inverse(moment[:, :2, :2]))
    scale = -_outermost(squares, count - math.ceil(0.95 * count), -1.0)[0] / CHI2_2D_95
    return np.asarray(moment * scale[:, None, None])


@njit_fused
def _squares(points: FloatArray, middle: FloatArray, inverse: FloatArray) -> FloatArray:
    """Squared horizontal distances ``(m, d)`` by the inverses ``(m, 2, 2)`` of second moments."""
    found = np.empty((len(points), points.shape[2]))
    for m in range(len(points)):
        point, out = points[m], found[m]
        a, b, c = inverse[m, 0, 0], inverse[m, 0, 1] + inverse[m, 1, 0], inverse[m, 1, 1]
        for d in range(len(out)):
            x, y = point[0, d] - middle[m, 0], point[1, d] - middle[m, 1]
            out[d] = (a * x + b * y) * x + c * y * y
    return found


@njit_fused
def _moments(points: FloatArray, middle: FloatArray, is_meant: BoolArray) -> FloatArray:
    """Second moments ``(m, 3, 3)`` of those draws that are meant, ``(m, d)``."""
    found = np.empty((len(points), 3, 3))
    for m in range(len(points)):
        count, xx, xy, xz, yy, yz, zz = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for d in range(points.shape[2]):
            x, y, z = points[m, 0, d] - middle[m, 0], points[m, 1, d] - middle[m, 1], points[m, 2, d] - middle[m, 2]
            if is_meant[m, d]:
                count += 1
                xx, xy, xz, yy, yz, zz = xx + x * x, xy + x * y, xz + x * z, yy + y * y, yz + y * z, zz + z * z
        found[m] = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) / count
    return found


def _inverse(moments: FloatArray) -> FloatArray:
    """Of symmetric ``(m, 2, 2)``; their pseudo-inverses where these are narrow."""
    det = moments[:, 0, 0] * moments[:, 1, 1] - moments[:, 0, 1] * moments[:, 1, 0]
    trace = moments[:, 0, 0] + moments[:, 1, 1]
    found = np.array([[1.0, -1.0], [-1.0, 1.0]]) * moments[:, ::-1, ::-1] / det[:, None, None]
    is_narrow = ~(det > _NARROW * trace * trace)
    if is_narrow.any():
        found[is_narrow] = np.linalg.pinv(moments[is_narrow])
    return found
