"""Brown's distortion as in OpenCV ("Camera Calibration and 3D Reconstruction"): radial, tangential, rational.

The inverse is Newton's method inside the radius up to which the forward model is one to one, NaN outside it.
"""

from functools import lru_cache

import numpy as np

from aerodft.geometry.kernels import brown, meet_brown, undistort
from aerodft.geometry.lenses.model import Coefficients, Distorted, Intrinsics, Lens, first_positive_root
from aerodft.model import FloatArray, LensModel


class _Brown(Lens):
    def distort(self, coefficients: Coefficients, rays_cam: FloatArray) -> Distorted:
        z = rays_cam[..., 2]
        xy = rays_cam[..., :2] / z[..., None]
        jac = np.zeros((*xy.shape, 3))
        if not any(coefficients):
            jac[..., 0, 0] = jac[..., 1, 1] = 1 / z
            jac[..., 2] = -xy / z[..., None]
            return Distorted(xy, jac, z > 0)
        distorted, by_xy = distort_plane(coefficients, xy)
        jac[..., :2] = by_xy / z[..., None, None]
        jac[..., 2] = -np.einsum("...ij,...j->...i", jac[..., :2], xy)
        off_axis = np.hypot(rays_cam[..., 0], rays_cam[..., 1])
        return Distorted(distorted, jac, (z > 0) & (off_axis <= valid_radius(coefficients) * z))

    def undistort(self, coefficients: Coefficients, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        xy = undistort_plane(coefficients, points)
        _, forward = distort_plane(coefficients, xy)
        jac = np.zeros((*xy.shape[:-1], 3, 2))
        jac[..., :2, :] = inverse_2x2(forward)
        return _with_unit_depth(xy), jac

    def rays(self, coefficients: Coefficients, points: FloatArray) -> FloatArray:
        # For whole images the unused Jacobian would take three quarters of the time.
        return _with_unit_depth(undistort_plane(coefficients, points))

    def by_coefficients(self, coefficients: Coefficients, rays_cam: FloatArray) -> FloatArray:
        return plane_by_coefficients(coefficients, rays_cam[..., :2] / rays_cam[..., 2:])

    def is_pinhole(self, coefficients: Coefficients) -> bool:
        return not any(coefficients)

    def meet_level(
        self,
        coefficients: Coefficients,
        intrinsics: Intrinsics,
        pixels_px: FloatArray,
        ground: tuple[FloatArray, FloatArray],
        out_m: FloatArray,
    ) -> None:
        coefficients = tuple(map(float, coefficients))
        meet_brown(pixels_px, (intrinsics, coefficients, valid_radius(coefficients)), *ground, out_m)


def distort_plane(coefficients: Coefficients, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distorted points ``(..., 2)`` of points on the plane at unit depth, and their Jacobian ``(..., 2, 2)``."""
    xd, yd, xx, cross, yy = brown(coefficients, xy[..., 0], xy[..., 1])
    jac = np.empty((*xd.shape, 2, 2))
    jac[..., 0, 0], jac[..., 1, 1] = xx, yy
    jac[..., 0, 1] = jac[..., 1, 0] = cross
    return np.stack([xd, yd], axis=-1), jac


def undistort_plane(coefficients: Coefficients, distorted: FloatArray) -> FloatArray:
    """Points ``(..., 2)`` on the plane at unit depth of distorted ones; NaN where there are none."""
    if not any(coefficients):
        return distorted
    xy = np.empty(distorted.shape)
    flat = np.ascontiguousarray(distorted).reshape(-1, 2)
    undistort(flat, tuple(map(float, coefficients)), valid_radius(coefficients), xy.reshape(-1, 2))
    return xy


def plane_by_coefficients(coefficients: Coefficients, xy: FloatArray) -> FloatArray:
    """Derivative ``(..., 2, 8)`` of the distorted points of ``xy (..., 2)`` by the coefficients."""
    k1, k2, _, _, k3, k4, k5, k6 = coefficients
    x, y = xy[..., 0], xy[..., 1]
    s = x * x + y * y
    over, under = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
    powers = np.stack([s, s * s, s**3], axis=-1) / under[..., None]
    above, below = powers, -powers * (over / under)[..., None]
    by = np.empty((*x.shape, 2, 8))
    for axis, along in enumerate((x, y)):
        by[..., axis, [0, 1, 4]] = along[..., None] * above
        by[..., axis, [5, 6, 7]] = along[..., None] * below
    by[..., 0, 2] = by[..., 1, 3] = 2 * x * y
    by[..., 1, 2], by[..., 0, 3] = s + 2 * y * y, s + 2 * x * x
    return by


@lru_cache(maxsize=64)
def valid_radius(coefficients: Coefficients) -> float:
    """Undistorted radius (tangent of the angle) up to which the radial part increases."""
    k1, k2, _, _, k3, k4, k5, k6 = coefficients
    over, under = np.array([1, k1, k2, k3]), np.array([1, k4, k5, k6])
    by_square = np.convolve(_slope(over), under) - np.convolve(over, _slope(under))
    turning = np.convolve(over, under)
    turning[1:] += 2 * by_square
    return float(np.sqrt(min(first_positive_root(turning), first_positive_root(under))))


def inverse_2x2(matrices: FloatArray) -> FloatArray:
    """Inverses ``(..., 2, 2)``; not finite where there is none."""
    a, b, c, d = (matrices[..., i, j] for i in (0, 1) for j in (0, 1))
    adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(adjugate / (a * d - b * c)[..., None, None])


def _slope(coefficients: FloatArray) -> FloatArray:
    return coefficients[1:] * np.arange(1, len(coefficients))


def _with_unit_depth(xy: FloatArray) -> FloatArray:
    """Rays ``(..., 3)`` of unit depth through ``xy (..., 2)``; NaN in all components where ``xy`` is."""
    return np.concatenate([xy, np.where(np.isnan(xy[..., :1]), np.nan, 1.0)], axis=-1)


BROWN = _Brown(
    model=LensModel.BROWN, ideal="a pinhole", wire_names=(("", 0), ("plumb_bob", 5), ("rational_polynomial", 8))
)
"""The entry."""
