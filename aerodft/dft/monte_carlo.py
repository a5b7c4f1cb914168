"""Monte-Carlo intervals where first order is not enough: errors are drawn, and every draw is measured.

The draws are a fixed Latin hypercube, so that the same input gives the same bytes. A scalar's interval is the central
95 % of the draws; near the horizon it is skewed to the far side. Its ends are freed from most of the noise of so few
draws by first order, whose own ends are known, over the same draws (a control variate). Only the pinhole model is
drawn, with a lens that is linear over the errors of pixels and intrinsics, but for focal lengths, which enter as their
inverse.

The heading is drawn apart from all other errors of the rotation and composed with them, ``Rz(heading) exp(others) R``:
an unknown heading, however large its error, only moves points around the camera's foot, and an error about an inclined
axis, as the optical one, stays one rotation about it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from statistics import NormalDist
from typing import Final, TypeAlias

import numpy as np

from aerodft.dft.covariance import CHI2_2D_95, Z95
from aerodft.dft.probe_kinds import PROBE_KINDS
from aerodft.dft.projection import ELEVATION, FOCAL, INTRINSICS, ROTATION, PixelRays
from aerodft.dft.quantities import RayGeometry
from aerodft.geometry import UNKNOWN_HEADING_VAR, Ground, camera_angles, matrix
from aerodft.jit import njit, njit_fused, njit_ieee
from aerodft.model import BoolArray, FloatArray, IntArray, Pose, ProbeKind

DRAWS: Final = 768
_SEED: Final = 10
"""With this one 95 % intervals of 754 values of every kind end off by 1.5 % of half of their length, root mean square,
and by 12 % at most; their widths are off by 1.1 and 6.7 %."""
_WINDOW: Final = 0.02
"""Share of the draws, to either side of an end, that decide it together."""
_RAYS_PER_CHUNK: Final = 32 * DRAWS
"""Ray draws that fit the cache together."""

_SAMPLE: Final = 32
"""Sixteen draws, one from each sixteenth of every error's distribution, and their mirror images."""

_FOCAL: Final = FOCAL.start
_VERTICAL_ROTATION: Final = ROTATION.stop - 1
_MIN_PIVOT: Final = 1e-12
"""Fraction of an error's variance: a smaller pivot means that the errors before determine it."""
_ROTATION_ROUNDING: Final = 1e-14
"""Fraction of a rotation's variance that rounding leaks to other axes."""
_MAX_VERTICAL_VAR: Final = math.radians(5) ** 2
"""Variance about the vertical that is not the heading's and that tilt does not determine; more counts as heading."""

_MIN_DETERMINANT: Final = 1e-6
"""Fraction of the squared trace: a smaller determinant has lost half of its digits."""


_RayDraws: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""``d`` draws of ``m`` probes: cameras ``(m, 3, d)``, directions and ground points of pixels ``(m, q, 3, d)``; points
are NaN where a ray misses."""
_Jacobians: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
_Roots: TypeAlias = tuple[FloatArray, IntArray]
"""Roots ``(u, s, s + 1)`` of unique covariances of the shared errors, and each probe's index ``(p,)`` in them."""


@lru_cache(maxsize=32)
def standard_draws(dimensions: int, count: int = DRAWS) -> FloatArray:
    """Fixed standard normal draws ``(count, dimensions)``, symmetric in every dimension.

    Half of them are a Latin hypercube, whose first dimensions are uncorrelated (R. L. Iman, W. J. Conover, "A
    distribution-free approach to inducing rank correlation among input variables", 1982), half are its mirror image.
    """
    half, inverse = count // 2, NormalDist().inv_cdf
    points = np.random.default_rng(_SEED).standard_normal((dimensions, half)).T
    uncorrelated = slice(half // 8)
    points[:, uncorrelated] = np.linalg.qr(points[:, uncorrelated])[0]
    quantiles = np.array([inverse((place + 0.25) / half) for place in range(half)])
    normal = quantiles[points.argsort(axis=0).argsort(axis=0)]
    draws = np.asfortranarray(np.concatenate([normal, -normal]))
    draws.setflags(write=False)
    return draws


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawInput:
    """``p`` probes of one kind to be drawn, with ``q`` pixels each.

    Attributes:
        kind: Kind of the probes.
        pose: The ``(n,)`` poses of the images.
        shared_cov: ``(n, s, s)``, without the probes' own elevation errors.
        heading_std_rad: ``(n,)`` standard deviations of the headings, which ``shared_cov`` includes.
        rays: Of the probes' pixels, ``(p, q)``.
        focal_px: ``(n, 2)`` focal lengths fx, fy of the images.
        surface: Ground that elevations are above; None for the level plane at 0.
        image: ``(p,)`` index of each probe's image, ascending.
        elevation_m: ``(p, q)`` of the measured surface.
        elevation_std_m: ``(p,)`` of the errors that all elevations of a probe share.
        own_elevation_std_m: ``(p, e)`` of the elevations' own errors, which the pixels have in turn.
        std_px: ``(p,)`` of each pixel coordinate.
    """

    kind: ProbeKind
    pose: Pose
    shared_cov: FloatArray
    heading_std_rad: FloatArray
    rays: PixelRays
    focal_px: FloatArray
    surface: Ground | None
    image: IntArray
    elevation_m: FloatArray
    elevation_std_m: FloatArray
    own_elevation_std_m: FloatArray
    std_px: FloatArray


@dataclass(frozen=True, slots=True)
class Interval:
    """Central 95 % intervals of a scalar over all draws, ``(...)``; draws without a value lie beyond both ends."""

    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FirstOrder:
    """Values of ``p`` probes and their first order.

    Attributes:
        value: ``(p,)`` without errors.
        jac: Derivatives by the shared errors ``(p, s)``, the pixels ``(p, q, 2)``, elevations of their own ``(p, e)``.
        std: ``(p,)`` first-order standard deviations.
    """

    value: FloatArray
    jac: _Jacobians
    std: FloatArray


def draw(probes: DrawInput, first: FirstOrder | None, first_enu_m: FloatArray) -> tuple[Interval, FloatArray]:
    """Intervals of values, and covariances of the first points, from all draws.

    Args:
        probes: The probes.
        first: Of the values; None for positions.
        first_enu_m: ``(p, 3)`` first points without errors.

    Returns:
        ``(p,)`` intervals of the values, NaN for positions; ``(p, 3, 3)`` covariances whose 95 % ellipses hold 95 % of
        the draws, NaN without a point on the ground, or where too many draws miss it.
    """
    count, kind = len(first_enu_m), PROBE_KINDS[probes.kind]
    scalars, cov = np.full((2, count), np.nan), np.full((count, 3, 3), np.nan)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        roots = _covariance_roots(probes)
        for chunk, draws in _draws(probes, roots, DRAWS):
            if first is not None and kind.scalar is not None:
                values = kind.scalar(RayGeometry(*(np.moveaxis(part, -1, 1) for part in draws)))
                if kind.is_angle:
                    values = _unwrap_around(first.value[chunk, None], values)
                by_shared, by_px, by_elevation = (each[chunk, None] for each in first.jac)
                linear = (
                    _linear_draws(probes, roots, chunk, (by_shared, by_px, by_elevation), DRAWS)[:, 0]
                    / first.std[chunk, None]
                )
                scalars[:, chunk] = _interval_with(values, linear, first.value[chunk])
            if kind.on_ground(draws[-1].shape[1]):
                cov[chunk] = _scaled_moments(np.ascontiguousarray(draws[-1][:, 0]), first_enu_m[chunk])
    return Interval(*scalars), cov


def linearity_errors(probes: DrawInput, jac: _Jacobians, first: FloatArray) -> FloatArray:
    """Differences ``(p, c, 32)`` of a few draws from first order; infinite where a draw has no value.

    Args:
        probes: The probes.
        jac: Derivatives of the value, or of the east and north of a position, by the shared errors ``(p, c, s)``, the
            pixels ``(p, c, q, 2)`` and the elevations of their own ``(p, c, e)``.
        first: ``(p, c)`` values without errors.
    """
    kind, roots = PROBE_KINDS[probes.kind], _covariance_roots(probes)
    linear = first[..., None] + _linear_draws(probes, roots, slice(None), jac, _SAMPLE)
    if kind.scalar is None:
        drawn = np.concatenate([points[:, 0, :2] for _, (_, _, points) in _draws(probes, roots, _SAMPLE)])
    else:
        values = _values(probes, roots, _SAMPLE)
        drawn = (_unwrap_around(first, values) if kind.is_angle else values)[:, None]
    return np.where(np.isfinite(drawn), drawn - linear, np.inf)


def _linear_draws(probes: DrawInput, roots: _Roots, rows: slice, jac: _Jacobians, size: int) -> FloatArray:
    """Draws ``(m, c, d)`` of the errors of ``c`` first-order functions of ``m`` probes.

    Args:
        probes: The probes.
        roots: Of their covariances.
        rows: Which of them.
        jac: Derivatives by the shared errors ``(m, c, s)``, the pixels ``(m, c, q, 2)`` and the elevations of their own
            ``(m, c, e)``.
        size: How many draws.
    """
    (jac_shared, jac_px, jac_elevation), (factors, poses) = jac, roots
    normal = standard_draws(factors.shape[-1] + 2 * jac_px.shape[2] + jac_elevation.shape[2], size).T
    enu_from_cam = matrix(probes.pose.wxyz[probes.image[rows]])
    jac_enu = jac_shared.copy()
    jac_enu[..., ROTATION] = jac_shared[..., ROTATION] @ enu_from_cam.swapaxes(-1, -2)
    px = probes.std_px[rows, None, None] * jac_px.reshape(*jac_px.shape[:2], -1)
    own = probes.own_elevation_std_m[rows, None] * jac_elevation
    return np.asarray(np.concatenate([jac_enu @ factors[poses[rows]], px, own], axis=-1) @ normal)


@dataclass(frozen=True, slots=True)
class NoiseBias:
    """Mean change of ``p`` values by pixel noise, and their interval without it.

    Attributes:
        bias: ``(p,)`` mean of the values with noise minus those without.
        interval: ``(p,)`` 95 % of the errors of the values from all inputs, about 0.
    """

    bias: FloatArray
    interval: Interval


def draw_biases(denoised: DrawInput) -> NoiseBias:
    """Mean changes of values by pixel noise: largest for lines whose segments are hardly longer than the noise.

    Noise across a line makes it longer to either side. Drawn about noisy vertices it would do so twice: it is drawn
    about denoised ones, whose segments are nearly as long as the true ones.

    Args:
        denoised: Probes through denoised pixels, of a kind that has a scalar.
    """
    no_noise = replace(
        denoised,
        std_px=np.zeros_like(denoised.std_px),
        own_elevation_std_m=np.zeros_like(denoised.own_elevation_std_m),
    )
    exact = replace(
        no_noise, shared_cov=np.zeros_like(denoised.shared_cov), elevation_std_m=np.zeros_like(denoised.std_px)
    )
    roots = _covariance_roots(denoised)
    noisy, shared = (_values(each, roots, DRAWS) for each in (denoised, no_noise))
    middle = _values(exact, _covariance_roots(exact), _SAMPLE)[:, :1]
    by_noise, by_all = noisy - shared, noisy - middle
    if PROBE_KINDS[denoised.kind].is_angle:
        by_noise, by_all = (_unwrap_around(np.zeros(1), each) for each in (by_noise, by_all))
    bias = np.nanmean(by_noise, axis=-1)
    return NoiseBias(bias, Interval(*central_interval(by_all - bias[:, None])))


def _values(probes: DrawInput, roots: _Roots, count: int) -> FloatArray:
    """Values ``(p, d)`` of draws, for a kind that has a scalar."""
    scalar, found = PROBE_KINDS[probes.kind].scalar, []
    assert scalar is not None  # noqa: S101 - the callers' own condition, for the type checker
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found += [
            scalar(RayGeometry(*(np.moveaxis(part, -1, 1) for part in seen)))
            for _, seen in _draws(probes, roots, count)
        ]
    return np.concatenate(found)


def _unwrap_around(middle_rad: FloatArray, angles_rad: FloatArray) -> FloatArray:
    """Angles shifted by whole turns to within half a turn of ``middle_rad``."""
    return middle_rad + np.remainder(angles_rad - middle_rad + np.pi, 2 * np.pi) - np.pi


def _covariance_roots(probes: DrawInput) -> _Roots:
    """Roots of the covariances of the shared errors of probes.

    Rotations are about east, north and up. Rotation about the vertical is last, and of that the heading, so that their
    variance leaves the draws of all other errors unchanged; the factorisation is in axes that turn with the camera,
    independent of its heading.
    """
    image = probes.image
    is_new = np.ones(len(image), dtype=np.bool_)
    is_new[1:] = (image[1:] != image[:-1]) | (probes.elevation_std_m[1:] != probes.elevation_std_m[:-1])
    cov = probes.shared_cov[image[is_new]]
    cov[:, ELEVATION, ELEVATION] += np.square(probes.elevation_std_m[is_new])
    wxyz = probes.pose.wxyz[image[is_new]]
    _, _, heading = camera_angles(wxyz)
    enu_from_level = np.zeros((len(cov), 3, 3))  # right, ahead and up in ENU
    enu_from_level[:, 0, 0] = enu_from_level[:, 1, 1] = np.cos(heading)
    enu_from_level[:, 1, 0] = np.sin(heading)
    enu_from_level[:, 0, 1], enu_from_level[:, 2, 2] = -enu_from_level[:, 1, 0], 1.0
    enu_from_cam = enu_from_level @ matrix(wxyz)
    cov[:, ROTATION] = enu_from_cam @ cov[:, ROTATION]
    cov[..., ROTATION] = cov[..., ROTATION] @ enu_from_cam.swapaxes(-1, -2)
    min_pivot = _MIN_PIVOT * np.diagonal(cov, axis1=1, axis2=2)
    tilt = slice(ROTATION.start, _VERTICAL_ROTATION)  # axes without variance have rounding errors of the rotation
    min_pivot[:, tilt] += _ROTATION_ROUNDING * np.trace(cov[:, ROTATION, ROTATION], axis1=1, axis2=2)[:, None]
    order = np.r_[:_VERTICAL_ROTATION, ROTATION.stop : cov.shape[-1], _VERTICAL_ROTATION]
    roots = np.zeros((*cov.shape[:2], cov.shape[2] + 1))
    roots[:, order, :-1] = _semidefinite_roots(np.ascontiguousarray(cov[:, order[:, None], order]), min_pivot[:, order])
    vertical_var = np.square(roots[:, _VERTICAL_ROTATION, -2])
    heading_var = np.minimum(np.square(probes.heading_std_rad[image[is_new]]), UNKNOWN_HEADING_VAR)
    other_var = np.clip(vertical_var - heading_var, 0.0, _MAX_VERTICAL_VAR)
    roots[:, _VERTICAL_ROTATION, -2:] = np.sqrt(np.stack([other_var, vertical_var - other_var], axis=-1))
    roots[:, ROTATION] = enu_from_level.swapaxes(-1, -2) @ roots[:, ROTATION]
    return roots, np.cumsum(is_new) - 1


@njit
def _semidefinite_roots(covs: FloatArray, min_pivot: FloatArray) -> FloatArray:
    """Lower Cholesky factors ``(u, s, s)`` of covariances that may be singular.

    Pivots of ``min_pivot (u, s)`` and less count as 0.
    """
    roots = np.zeros(covs.shape)
    for u in range(len(covs)):
        root = roots[u]
        for j in range(covs.shape[1]):
            pivot = covs[u, j, j]
            for k in range(j):
                pivot -= root[j, k] * root[j, k]
            if not pivot > min_pivot[u, j]:
                continue
            root[j, j] = math.sqrt(pivot)
            for i in range(j + 1, covs.shape[1]):
                rest = covs[u, i, j]
                for k in range(j):
                    rest -= root[i, k] * root[j, k]
                root[i, j] = rest / root[j, j]
    return roots


def _draws(probes: DrawInput, roots: _Roots, size: int) -> Iterator[tuple[slice, _RayDraws]]:
    """Draws of probes, ``d = size`` of each, chunk by chunk."""
    image, rays, (factors, poses) = probes.image, probes.rays, roots
    pixels, own_std_m = rays.rays_cam.shape[1], probes.own_elevation_std_m
    draws = standard_draws(factors.shape[-1] + 2 * pixels + own_std_m.shape[1], size).T
    is_lens_uncertain = np.any(probes.shared_cov[:, INTRINSICS, INTRINSICS])
    jac_px = probes.std_px[:, None, None, None] * rays.jac_px
    jac_intrinsics = np.ascontiguousarray(rays.jac_intrinsics[..., slice(None if is_lens_uncertain else 0)])
    wxyz, cameras_m = probes.pose.wxyz[image], probes.pose.position_enu_m[image]
    focal_px = probes.focal_px[image]
    batch = max(_RAYS_PER_CHUNK // (size * pixels), 1)
    # Chunks reuse one buffer: allocating takes longer than drawing.
    buffers = np.empty((batch, 3, size)), np.empty((batch, pixels, size)), *np.empty((2, batch, pixels, 3, size))
    for first in range(0, len(image), batch):
        chunk = slice(first, first + batch)
        pose, place = (
            (poses[chunk], factors, wxyz[chunk], focal_px[chunk]),
            (cameras_m[chunk], probes.elevation_m[chunk], own_std_m[chunk]),
        )
        pixel_rays = rays.rays_cam[chunk], jac_px[chunk], jac_intrinsics[chunk]
        cameras, elevations, directions, points = (part[: len(image) - first] for part in buffers)
        _draw_rays(pose, place, pixel_rays, draws, (cameras, elevations, directions, points))
        if probes.surface is not None:
            starts, away = np.moveaxis(cameras, 1, -1)[:, None], np.moveaxis(directions, 2, -1)
            points = np.moveaxis(probes.surface.meet(starts, away, elevations).points_enu_m, -1, 2)
        yield chunk, (cameras, directions, np.ascontiguousarray(points))


@njit_fused
def _draw_rays(
    shared_by: tuple[IntArray, FloatArray, FloatArray, FloatArray],
    places: tuple[FloatArray, FloatArray, FloatArray],
    rays: tuple[FloatArray, FloatArray, FloatArray],
    draws: FloatArray,
    out: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> None:
    """Compute ``d`` draws of the rays and level ground points of ``m`` probes.

    Args:
        shared_by: ``(m,)`` index of each probe's root; roots ``(u, s, s + 1)`` of covariances of the shared errors,
            the heading last; rotations ``(m, 4)``; focal lengths ``(m, 2)``.
        places: Cameras ``(m, 3)``, elevations ``(m, q)``, and standard deviations ``(m, e)`` of the elevations that the
            pixels have in turn.
        rays: ``(m, q, 3)`` in camera axes; by standard deviations of the pixels ``(m, q, 3, 2)``; by the intrinsics.
        draws: ``(s + 1 + 2 q + e, d)`` standard normal draws.
        out: Receives cameras ``(m, 3, d)``, elevations ``(m, q, d)``, directions ``(m, q, 3, d)``, and points
            ``(m, q, 3, d)`` of the level planes at the elevations.
    """
    (poses, roots, wxyz, focal_px), (camera_m, elevation_m, own_std_m), (rays_cam, jac_px, jac_intrinsics) = (
        shared_by,
        places,
        rays,
    )
    cameras, elevations, directions, points = out
    (count, pixels, _), size, errors = rays_cam.shape, draws.shape[1], roots.shape[1]
    shared, rotation, ray = np.empty((errors, size)), np.empty((9, size)), np.empty((3, size))
    heading = np.empty(size)
    last = -1
    for m in range(count):
        if poses[m] != last:
            last = poses[m]
            shared[:] = 0.0
            for i in range(errors):
                _add_scaled(roots[last, i, :errors], draws, shared[i])
            for axis in range(2 if jac_intrinsics.shape[3] else 0):
                _as_ray_scale(focal_px[m, axis], shared[_FOCAL + axis])
            heading[:] = roots[last, _VERTICAL_ROTATION, errors] * draws[errors]
            _rotation_matrices(wxyz[m], shared[3:6], heading, rotation)
        for axis in range(3):
            cameras[m, axis] = camera_m[m, axis] + shared[axis]
        for k in range(pixels):
            elevations[m, k] = elevation_m[m, k] + shared[6]
            if own_std_m.shape[1]:
                own = k % own_std_m.shape[1]
                _add_scaled(own_std_m[m, own : own + 1], draws[errors + 1 + 2 * pixels + own :], elevations[m, k])
            for axis in range(3):
                ray[axis] = rays_cam[m, k, axis]
                _add_scaled(jac_px[m, k, axis], draws[errors + 1 + 2 * k :], ray[axis])
                _add_scaled(jac_intrinsics[m, k, axis], shared[7:], ray[axis])
            _intersect_level(cameras[m], elevations[m, k], rotation, ray, directions[m, k], points[m, k])


@njit_fused
def _as_ray_scale(focal_px: float, errors_px: FloatArray) -> None:
    """Replace errors ``e (d,)`` of a focal length ``f`` by ``e f / (f + e)``, over which rays are linear.

    A pixel at the offset ``x`` from the principal point has the slope
    ``x / (f + e) = x / f - (x / f**2) e f / (f + e)``.
    NaN where no focal length is left.
    """
    for d in range(len(errors_px)):
        actual_px = focal_px + errors_px[d]
        errors_px[d] = errors_px[d] * focal_px / actual_px if actual_px > 0.0 else np.nan


@njit_fused
def _add_scaled(factors: FloatArray, values: FloatArray, total: FloatArray) -> None:
    """Add ``factors[i] * values[i]`` to ``total (d,)`` for each factor; ``values`` is ``(..., d)``."""
    for i in range(len(factors)):
        factor, row = factors[i], values[i]
        if factor != 0.0:
            for d in range(len(total)):
                total[d] += factor * row[d]


@njit_fused
def _rotation_matrices(wxyz: FloatArray, errors_rad: FloatArray, heading_rad: FloatArray, rows: FloatArray) -> None:
    """Rotation matrices ``(9, d)``, by rows, of ``wxyz`` after errors ``(3, d)`` in ENU, then ``(d,)`` about up."""
    b, c, e, f = wxyz
    for d in range(errors_rad.shape[1]):  # a loop of its own: sines are not vectorised
        x, y, z = errors_rad[0, d], errors_rad[1, d], errors_rad[2, d]
        angle = math.sqrt(x * x + y * y + z * z)
        rows[0, d] = math.cos(angle / 2)
        rows[1, d] = math.sin(angle / 2) / angle if angle > 0.0 else 0.5
        rows[2, d] = math.cos(heading_rad[d] / 2)
        rows[3, d] = math.sin(heading_rad[d] / 2)
    for d in range(errors_rad.shape[1]):
        a, scale, cosine, sine = rows[0, d], rows[1, d], rows[2, d], rows[3, d]
        x, y, z = scale * errors_rad[0, d], scale * errors_rad[1, d], scale * errors_rad[2, d]
        s, p, q, r = cosine * a - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * a
        w, x = s * b - p * c - q * e - r * f, s * c + p * b + q * f - r * e  # a quaternion's product
        y, z = s * e - p * f + q * b + r * c, s * f + p * e - q * c + r * b
        rows[0, d], rows[4, d], rows[8, d] = (
            1 - 2 * (y * y + z * z),
            1 - 2 * (x * x + z * z),
            1 - 2 * (x * x + y * y),
        )
        rows[1, d], rows[3, d] = 2 * (x * y - w * z), 2 * (x * y + w * z)
        rows[6, d], rows[2, d] = 2 * (x * z - w * y), 2 * (x * z + w * y)
        rows[5, d], rows[7, d] = 2 * (y * z - w * x), 2 * (y * z + w * x)


@njit_fused
def _intersect_level(
    camera: FloatArray, elevation: FloatArray, axes: FloatArray, ray: FloatArray, away: FloatArray, points: FloatArray
) -> None:
    """Directions ``away`` of rays ``(3, d)`` in camera axes, and their points on level planes."""
    for axis in range(3):
        by_x, by_y, by_z = axes[3 * axis], axes[3 * axis + 1], axes[3 * axis + 2]
        for d in range(len(elevation)):
            away[axis, d] = by_x[d] * ray[0, d] + by_y[d] * ray[1, d] + by_z[d] * ray[2, d]
    for d in range(len(elevation)):
        reach = (elevation[d] - camera[2, d]) / away[2, d]
        if not (away[2, d] < 0.0 and reach > 0.0):
            reach = np.nan
        points[0, d] = camera[0, d] + reach * away[0, d]
        points[1, d] = camera[1, d] + reach * away[1, d]
        points[2, d] = camera[2, d] + reach * away[2, d]


def central_interval(values: FloatArray, linear: FloatArray | None = None) -> FloatArray:
    """Ends ``(2, ...)`` of the central 95 % of ``values (..., d)``; NaN lie beyond both ends.

    About an end the sorted draws lie along a line over sorted standard normal ones: over their expectations, or over
    means of these and of first order, ``linear (..., d)``, which has the noise of the same errors. Where that line is
    at the known end of the normal distribution, there is the end of the values (a control variate; T. C. Hesterberg,
    B. L. Nelson, "Control variates for probability and quantile estimation", 1998). Means quarter the variance of the
    noise of linear values; where first order tells nothing of the values, they add less than the line takes off.
    """
    size = values.shape[-1]
    drawn, normal = np.sort(values, axis=-1).reshape(-1, size), _normal_quantiles(size)[None]
    if linear is not None:
        normal = (np.sort(linear, axis=-1).reshape(-1, size) + normal) / 2
    low, high = _window(0.025, size), _window(0.975, size)
    ends = np.stack([_on_lines(drawn[:, low], normal[:, low], -Z95), _on_lines(drawn[:, high], normal[:, high], Z95)])
    missing = ~np.isfinite(ends)  # some draws of the window have no value
    if missing.any():
        ends[missing] = _quantile_ends(drawn)[missing]
    return ends.reshape(2, *values.shape[:-1])


def _quantile_ends(values: FloatArray) -> FloatArray:
    """Ends ``(2, ...)`` of the central 95 % of ``values (..., d)``, between two draws; NaN lie beyond both ends."""
    drawn, tail = np.sort(values, axis=-1), 0.025 * (values.shape[-1] - 1)
    place = int(tail)
    outer, inner = drawn[..., [place, -1 - place]], drawn[..., [place + 1, -2 - place]]
    ends = outer + tail % 1 * (inner - outer)
    return np.moveaxis(np.where(np.isfinite(ends), ends, np.inf), -1, 0)


def _interval_with(values: FloatArray, linear: FloatArray, centre: FloatArray) -> FloatArray:
    """Ends ``(2, m)`` of 95 % of ``values (m, d)``: the central ones, moved outwards to contain ``centre (m,)``.

    The distance of two equal pixels is 0, but positive in all draws: its interval holds 0 and 95 % of the draws.
    """
    low, high = ends = central_interval(values, linear)
    for row in np.flatnonzero((centre < low) | (centre > high)).tolist():
        sorted_row, last = np.sort(np.where(np.isnan(values[row]), np.inf, values[row])), values.shape[1] - 1
        if centre[row] < low[row]:
            low[row], at = centre[row], np.searchsorted(sorted_row, centre[row]) + 0.95 * last
            high[row] = sorted_row[min(math.ceil(at), last)]
        else:
            high[row], at = centre[row], np.searchsorted(sorted_row, centre[row]) - 0.95 * last
            low[row] = sorted_row[max(math.floor(at), 0)]
    return ends


@lru_cache(maxsize=4)
def _normal_quantiles(size: int) -> FloatArray:
    """Standard normal values ``(size,)`` in the middles of equally likely parts."""
    return np.array([NormalDist().inv_cdf((place + 0.5) / size) for place in range(size)])


def _window(share: float, size: int) -> slice:
    """Sorted draws, of ``size``, about that below which is a share of them."""
    return slice(round((share - _WINDOW) * size), round((share + _WINDOW) * size))


@njit_ieee
def _on_lines(values: FloatArray, over: FloatArray, at: float) -> FloatArray:
    """Values ``(r,)`` at ``at`` of least-squares lines of sorted ``values (r, k)`` over ``over (r or 1, k)``.

    From the first to the last of the values; not finite where one of them is not.
    """
    found = np.empty(len(values))
    for r in range(len(values)):
        y, x = values[r], over[r % len(over)]
        middle, mean = x.mean(), y.mean()
        slope = ((x - middle) * y).sum() / ((x - middle) * (x - middle)).sum()
        found[r] = mean + slope * (at - middle)
        if math.isfinite(found[r]):
            found[r] = min(max(found[r], y[0]), y[-1])
    return found


def _scaled_moments(points_m: FloatArray, middle_m: FloatArray) -> FloatArray:
    """Second moments ``(m, 3, 3)`` of draws ``(m, 3, d)`` about ``(m, 3)``, scaled so that 95 % ellipses hold 95 %.

    Their shapes are of the nearer 95 % of the draws, because a few draws near the horizon would stretch them without
    bound. NaN where fewer meet the ground.
    """
    count = points_m.shape[-1]
    squares_m2 = _squared_distances(points_m, middle_m, np.tile(np.eye(2), (len(points_m), 1, 1)))
    last = int(0.95 * count) - 1
    farthest_m2 = np.partition(squares_m2, last, axis=-1)[:, last, None]
    moment = _second_moments(points_m, middle_m, squares_m2 <= farthest_m2)
    squares = _squared_distances(points_m, middle_m, _symmetric_inverses(moment[:, :2, :2]))
    window = _window(0.95, count)
    expected = -2 * np.log1p(-(np.arange(count)[window] + 0.5) / count)  # of two normal errors
    scale = _on_lines(np.sort(squares, axis=-1)[:, window], expected[None], CHI2_2D_95) / CHI2_2D_95
    return np.asarray(moment * scale[:, None, None])


@njit_fused
def _squared_distances(points: FloatArray, middle: FloatArray, inverse: FloatArray) -> FloatArray:
    """Squared horizontal distances ``(m, d)`` in the metric ``inverse (m, 2, 2)``."""
    squares = np.empty((len(points), points.shape[2]))
    for m in range(len(points)):
        point, out = points[m], squares[m]
        a, b, c = inverse[m, 0, 0], inverse[m, 0, 1] + inverse[m, 1, 0], inverse[m, 1, 1]
        for d in range(len(out)):
            x, y = point[0, d] - middle[m, 0], point[1, d] - middle[m, 1]
            out[d] = (a * x + b * y) * x + c * y * y
    return squares


@njit_fused
def _second_moments(points: FloatArray, middle: FloatArray, is_used: BoolArray) -> FloatArray:
    """Second moments ``(m, 3, 3)`` of the draws in use, ``(m, d)``."""
    moments = np.empty((len(points), 3, 3))
    for m in range(len(points)):
        count, xx, xy, xz, yy, yz, zz = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for d in range(points.shape[2]):
            x, y, z = points[m, 0, d] - middle[m, 0], points[m, 1, d] - middle[m, 1], points[m, 2, d] - middle[m, 2]
            if is_used[m, d]:
                count += 1
                xx, xy, xz, yy, yz, zz = xx + x * x, xy + x * y, xz + x * z, yy + y * y, yz + y * z, zz + z * z
        moments[m] = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) / count
    return moments


def _symmetric_inverses(moments: FloatArray) -> FloatArray:
    """Inverses of symmetric ``(m, 2, 2)``; pseudo-inverses where nearly singular."""
    det = moments[:, 0, 0] * moments[:, 1, 1] - moments[:, 0, 1] * moments[:, 1, 0]
    trace = moments[:, 0, 0] + moments[:, 1, 1]
    inverses = np.array([[1.0, -1.0], [-1.0, 1.0]]) * moments[:, ::-1, ::-1] / det[:, None, None]
    is_singular = det <= _MIN_DETERMINANT * trace * trace
    if is_singular.any():
        inverses[is_singular] = np.linalg.pinv(moments[is_singular])
    return inverses
