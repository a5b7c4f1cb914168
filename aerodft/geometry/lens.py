"""Exact projection between pixels and rays: intrinsics, and OpenCV's Brown (up to rational) and fisheye distortion.

The forward models are those of OpenCV's ``calib3d`` ("Camera Calibration and 3D Reconstruction" and "Fisheye camera
model"). The inverse is Newton's method inside the radius up to which the forward model is one to one, NaN outside it.

Intrinsics are in the order of OpenCV's calibrations: fx, fy, cx, cy, then the distortion coefficients.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt
from numpy.polynomial import Polynomial

from aerodft.geometry.kernels import brown, fisheye_angles, undistort
from aerodft.model import Camera, FloatArray, LensModel, read_only

_MIN_RECIPROCAL_ROOT = 1e-9  # smaller reciprocals are of roots beyond any image

_CACHE_LIMIT = 512  # enough for an image's fixed probes; larger arrays take the compiled loop and no cache
_Projection = tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]
PINHOLE_PARAMETERS: Final = 4
"""fx, fy, cx, cy: all that is uncertain where distortion is taken as exact."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays in camera axes and their Jacobian by the pixel.

    Attributes:
        rays_cam: ``(..., 3)``, not normalised; NaN where the lens model has no inverse.
        jac_px: ``(..., 3, 2)`` derivative by the pixel; by the intrinsics see ``rays_by_intrinsics``.
    """

    rays_cam: FloatArray
    jac_px: FloatArray


def rays_from_pixels(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """Rays ``(..., 3)`` in camera axes, not normalised, of pixels ``(..., 2)``; NaN where the lens has no inverse."""
    pixels = np.asarray(pixels_px, dtype=np.float64)
    if pixels.size <= _CACHE_LIMIT or camera.lens is LensModel.FISHEYE:
        return rays_with_jacobian(camera, pixels).rays_cam
    # For whole images the unused Jacobian would take three quarters of the time.
    return _with_unit_depth(_undistorted(padded_distortion(camera, 8), _normalised_pixels(camera, pixels)))


def rays_with_jacobian(camera: Camera, pixels_px: FloatArray) -> Rays:
    """Rays of pixels ``(..., 2)`` with Jacobian; small arrays are cached, hence read-only."""
    pixels = np.asarray(pixels_px, dtype=np.float64)
    return (
        _cached_rays(camera, pixels.shape, pixels.tobytes()) if pixels.size <= _CACHE_LIMIT else _rays(camera, pixels)
    )


@lru_cache(maxsize=64)
def _cached_rays(camera: Camera, shape: tuple[int, ...], pixels: bytes) -> Rays:
    rays = _rays(camera, np.frombuffer(pixels).reshape(shape))
    for array in (rays.rays_cam, rays.jac_px):
        array.setflags(write=False)
    return rays


def _rays(camera: Camera, pixels_px: FloatArray) -> Rays:
    focal = np.array([camera.fx_px, camera.fy_px])
    distorted = _normalised_pixels(camera, pixels_px)
    if camera.lens is LensModel.FISHEYE:
        rays, jac = _fisheye_rays(padded_distortion(camera, 4), distorted)
    else:
        rays, jac = _brown_rays(padded_distortion(camera, 8), distorted)
    return Rays(rays, jac / focal)


def _normalised_pixels(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """Pixels from the principal point in focal lengths, ``(..., 2)``."""
    return np.asarray((pixels_px - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px])


def pixels_from_rays(camera: Camera, rays_cam: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` of rays ``(..., 3)`` of any length in camera axes.

    NaN behind the camera and where the distortion model is no longer one to one. May lie outside the image.
    """
    distorted, _ = distorted_with_jacobian(camera, rays_cam)
    return np.asarray(distorted * [camera.fx_px, camera.fy_px] + [camera.cx_px, camera.cy_px])


def distorted_with_jacobian(camera: Camera, rays_cam: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Image points of rays, from the principal point in focal lengths ``(..., 2)``; Jacobian ``(..., 2, 3)``.

    NaN where ``pixels_from_rays`` is.
    """
    rays = np.asarray(rays_cam, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        solve = _fisheye_distorted if camera.lens is LensModel.FISHEYE else _brown_distorted
        distorted, jac, valid = solve(camera, rays)
    if np.all(valid):
        return distorted, jac
    return np.where(valid[..., None], distorted, np.nan), np.where(valid[..., None, None], jac, np.nan)


def _brown_distorted(camera: Camera, rays: FloatArray) -> _Projection:
    coefficients, z = padded_distortion(camera, 8), rays[..., 2]
    xy = rays[..., :2] / z[..., None]
    jac = np.zeros((*xy.shape, 3))
    if not any(coefficients):
        jac[..., 0, 0] = jac[..., 1, 1] = 1 / z
        jac[..., 2] = -xy / z[..., None]
        return xy, jac, z > 0
    distorted, by_xy = _brown(coefficients, xy)
    jac[..., :2] = by_xy / z[..., None, None]
    jac[..., 2] = -np.einsum("...ij,...j->...i", jac[..., :2], xy)
    off_axis = np.hypot(rays[..., 0], rays[..., 1])
    return distorted, jac, (z > 0) & (off_axis <= brown_limit(coefficients) * z)


def _fisheye_distorted(camera: Camera, rays: FloatArray) -> _Projection:
    polynomial, limit = _fisheye_polynomial(padded_distortion(camera, 4)), fisheye_limit(padded_distortion(camera, 4))
    off_axis, z = np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2]
    angle = np.arctan2(off_axis, z)
    on_axis = off_axis == 0
    outward = rays[..., :2] / np.where(on_axis, 1.0, off_axis)[..., None]
    scale = np.where(on_axis, 1 / z, polynomial(angle) / off_axis)
    slope = polynomial.deriv()(angle) / (off_axis**2 + z**2)
    jac = np.empty((*rays.shape[:-1], 2, 3))
    radial = slope * z - scale
    jac[..., :2] = (
        scale[..., None, None] * np.eye(2) + radial[..., None, None] * outward[..., :, None] * outward[..., None, :]
    )
    jac[..., 2] = -(slope * off_axis)[..., None] * outward
    return rays[..., :2] * scale[..., None], jac, angle <= limit


def padded_distortion(camera: Camera, count: int) -> tuple[float, ...]:
    """The camera's distortion coefficients, padded_distortion with zeros to ``count``."""
    return (*camera.distortion, *([0.0] * (count - len(camera.distortion))))


def _brown(coefficients: tuple[float, ...], xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distorted points ``(..., 2)`` and their Jacobian ``(..., 2, 2)``."""
    xd, yd, xx, cross, yy = brown(coefficients, xy[..., 0], xy[..., 1])
    jac = np.empty((*xd.shape, 2, 2))
    jac[..., 0, 0], jac[..., 1, 1] = xx, yy
    jac[..., 0, 1] = jac[..., 1, 0] = cross
    return np.stack([xd, yd], axis=-1), jac


@lru_cache(maxsize=64)
def brown_limit(coefficients: tuple[float, ...]) -> float:
    """Undistorted radius (tangent of the angle) up to which the radial part increases."""
    k1, k2, _, _, k3, k4, k5, k6 = coefficients
    over, under = np.array([1, k1, k2, k3]), np.array([1, k4, k5, k6])
    by_square = np.convolve(_slope(over), under) - np.convolve(over, _slope(under))
    turning = np.convolve(over, under)
    turning[1:] += 2 * by_square
    return float(np.sqrt(min(_first_positive_root(turning), _first_positive_root(under))))


def _slope(coefficients: FloatArray) -> FloatArray:
    return coefficients[1:] * np.arange(1, len(coefficients))


def _first_positive_root(coefficients: FloatArray) -> float:
    """Smallest positive root of a polynomial, constant term first; infinite where there is none.

    Solved as the reversed polynomial, in which a tiny last coefficient does no harm.
    """
    roots = np.roots(coefficients)
    real = roots[np.abs(np.imag(roots)) < 1e-9 * (1 + np.abs(roots))].real
    largest = max(real[real > _MIN_RECIPROCAL_ROOT], default=0.0)
    return float(1 / largest) if largest > 0 else np.inf


def _brown_rays(coefficients: tuple[float, ...], distorted: FloatArray) -> tuple[FloatArray, FloatArray]:
    xy = _undistorted(coefficients, distorted)
    _, forward = _brown(coefficients, xy)
    jac = np.zeros((*xy.shape[:-1], 3, 2))
    jac[..., :2, :] = _inverse_2x2(forward)
    return _with_unit_depth(xy), jac


def _undistorted(coefficients: tuple[float, ...], distorted: FloatArray) -> FloatArray:
    return distorted if not any(coefficients) else _invert_brown(coefficients, distorted)


def _with_unit_depth(xy: FloatArray) -> FloatArray:
    """Rays ``(..., 3)`` of unit depth through ``xy (..., 2)``; NaN in all components where ``xy`` is."""
    return np.concatenate([xy, np.where(np.isnan(xy[..., :1]), np.nan, 1.0)], axis=-1)


def _invert_brown(coefficients: tuple[float, ...], distorted: FloatArray) -> FloatArray:
    xy = np.empty(distorted.shape)
    flat = np.ascontiguousarray(distorted).reshape(-1, 2)
    undistort(flat, tuple(map(float, coefficients)), brown_limit(coefficients), xy.reshape(-1, 2))
    return xy


def _fisheye_polynomial(coefficients: tuple[float, ...]) -> Polynomial:
    k1, k2, k3, k4 = coefficients
    return Polynomial([0, 1, 0, k1, 0, k2, 0, k3, 0, k4])


@lru_cache(maxsize=64)
def fisheye_limit(coefficients: tuple[float, ...]) -> float:
    """Angle from the axis up to which the distorted radius increases, at most half a turn."""
    slope = np.asarray(_fisheye_polynomial(coefficients).deriv().coef, dtype=np.float64)
    return min(_first_positive_root(slope), np.pi)


def _fisheye_rays(coefficients: tuple[float, ...], distorted: FloatArray) -> tuple[FloatArray, FloatArray]:
    polynomial, limit = _fisheye_polynomial(coefficients), fisheye_limit(coefficients)
    radius = np.linalg.norm(distorted, axis=-1)
    angle = np.empty(np.shape(radius))
    fisheye_angles(np.reshape(radius, -1), tuple(map(float, coefficients)), limit, angle.reshape(-1))
    with np.errstate(divide="ignore"):  # at the limit itself the derivative may be 0
        slope = np.asarray(1 / polynomial.deriv()(angle))
    outward = distorted / np.where(radius > 0, radius, 1.0)[..., None]
    sine_over_radius = np.where(radius > 0, np.sin(angle) / np.where(radius > 0, radius, 1.0), 1.0)
    rays = np.concatenate([distorted * sine_over_radius[..., None], np.cos(angle)[..., None]], axis=-1)
    radial = np.concatenate([outward * np.cos(angle)[..., None], -np.sin(angle)[..., None]], axis=-1)
    jac = radial[..., :, None] * (outward * slope[..., None])[..., None, :]
    across = np.eye(2) - outward[..., :, None] * outward[..., None, :]
    jac[..., :2, :] += across * sine_over_radius[..., None, None]
    jac[..., :2, :] = np.where((radius > 0)[..., None, None], jac[..., :2, :], np.eye(2) * slope[..., None, None])
    return rays, jac


def _inverse_2x2(matrices: FloatArray) -> FloatArray:
    a, b, c, d = (matrices[..., i, j] for i in (0, 1) for j in (0, 1))
    adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(adjugate / _determinant_2x2(matrices)[..., None, None])


def _determinant_2x2(matrices: FloatArray) -> FloatArray:
    return np.asarray(matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0])


@lru_cache(maxsize=16)
def intrinsics_covariance(camera: Camera) -> FloatArray:
    """Covariance ``(m, m)`` of the intrinsics; ``m`` is 4 where the distortion is taken as exact.

    It is ``camera.covariance`` if there is one; otherwise diagonal from ``camera.std``, but for fx and fy, which are
    fully correlated.
    """
    if camera.covariance:
        return read_only(np.array(camera.covariance))
    std = camera.std
    distortion_std = std.distortion if any(std.distortion) else ()
    cov = np.zeros((PINHOLE_PARAMETERS + len(distortion_std), PINHOLE_PARAMETERS + len(distortion_std)))
    focal = np.array([1.0, camera.fy_px / camera.fx_px]) * std.focal_px
    cov[:2, :2] = np.outer(focal, focal)
    cov[2:, 2:] = np.diag(np.square([std.principal_point_px, std.principal_point_px, *distortion_std]))
    return read_only(cov)


def rays_by_intrinsics(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """Jacobian ``(..., 3, m)`` of the rays (``Rays.rays_cam``) of pixels ``(..., 2)`` by the intrinsics.

    By the implicit function theorem: the pixel stays fixed, so d ray = -(d ray / d pixel) (d pixel / d intrinsics).
    """
    pixels = np.asarray(pixels_px, dtype=np.float64)
    rays = rays_with_jacobian(camera, pixels)
    distorted = (pixels - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px]
    return np.asarray(-rays.jac_px @ pixels_by_intrinsics(camera, rays.rays_cam, distorted))


def pixels_by_intrinsics(camera: Camera, rays_cam: FloatArray, distorted: FloatArray) -> FloatArray:
    """Jacobian ``(..., 2, m)`` of the pixels of rays ``(..., 3)`` by the intrinsics.

    Args:
        camera: The camera.
        rays_cam: In camera axes, of any length.
        distorted: ``(..., 2)`` pixels of the rays, from the principal point in focal lengths.
    """
    count = len(intrinsics_covariance(camera))
    by = np.zeros((*distorted.shape, count))
    by[..., 0, 0], by[..., 1, 1] = distorted[..., 0], distorted[..., 1]
    by[..., 0, 2] = by[..., 1, 3] = 1.0
    if count > PINHOLE_PARAMETERS:
        derivative = _fisheye_by_coefficients if camera.lens is LensModel.FISHEYE else _brown_by_coefficients
        by_coefficients = derivative(camera, rays_cam)[..., : len(camera.distortion)]
        by[..., PINHOLE_PARAMETERS:] = np.array([[camera.fx_px], [camera.fy_px]]) * by_coefficients
    return by


def _brown_by_coefficients(camera: Camera, rays_cam: FloatArray) -> FloatArray:
    """Derivative ``(..., 2, 8)`` of the distorted points by the coefficients."""
    k1, k2, _, _, k3, k4, k5, k6 = padded_distortion(camera, 8)
    x, y = rays_cam[..., 0] / rays_cam[..., 2], rays_cam[..., 1] / rays_cam[..., 2]
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


def _fisheye_by_coefficients(_: Camera, rays_cam: FloatArray) -> FloatArray:
    """Derivative ``(..., 2, 4)`` of the distorted points by the coefficients."""
    off_axis = np.hypot(rays_cam[..., 0], rays_cam[..., 1])
    angle = np.arctan2(off_axis, rays_cam[..., 2])
    radial = rays_cam[..., :2] / np.where(off_axis > 0, off_axis, 1.0)[..., None]
    return np.asarray(radial[..., None] * angle[..., None, None] ** np.array([3, 5, 7, 9]))


@dataclass(frozen=True, slots=True, eq=False)
class Reprojection:
    """Pixels of points with their Jacobians; NaN behind the camera and beyond the valid part of the lens.

    Attributes:
        camera: The camera.
        rays_cam: ``(..., 3)`` to the points, in camera axes.
        distorted: ``(..., 2)`` pixels from the principal point in focal lengths.
        jac_point: ``(..., 2, 3)`` pixels by the point (ENU); its negative is that by the camera's position.
        jac_rotation: ``(..., 2, 3)`` pixels by a small rotation of the camera, in its axes.
    """

    camera: Camera
    rays_cam: FloatArray
    distorted: FloatArray
    jac_point: FloatArray
    jac_rotation: FloatArray

    @property
    def pixels_px(self) -> FloatArray:
        """Pixels ``(..., 2)``."""
        lens = self.camera
        return np.asarray(self.distorted * [lens.fx_px, lens.fy_px] + [lens.cx_px, lens.cy_px])

    @property
    def jac_intrinsics(self) -> FloatArray:
        """Jacobian ``(..., 2, m)`` of the pixels by the intrinsics, see ``intrinsics_covariance``."""
        return pixels_by_intrinsics(self.camera, self.rays_cam, self.distorted)


def reproject(
    camera: Camera, position_enu_m: FloatArray, rotation: FloatArray, points_enu_m: FloatArray
) -> Reprojection:
    """Project points ``(..., 3)`` into a camera, with Jacobians.

    Args:
        camera: The camera.
        position_enu_m: ``(3,)``.
        rotation: ``(3, 3)`` from camera axes to ENU.
        points_enu_m: ``(..., 3)``.
    """
    rays = (points_enu_m - position_enu_m) @ rotation
    distorted, by_ray = distorted_with_jacobian(camera, rays)
    by_ray = np.array([[camera.fx_px], [camera.fy_px]]) * by_ray
    jac_point = (by_ray.reshape(-1, 3) @ rotation.T).reshape(by_ray.shape)
    return Reprojection(camera, rays, distorted, jac_point, _rotation_jacobian(by_ray, rays[..., None, :]))


def _rotation_jacobian(a: FloatArray, b: FloatArray) -> FloatArray:
    """Derivatives by a small rotation w of the camera from those ``a`` by the ray ``b``: ``(a x b) . w``."""
    out = np.empty(a.shape)
    for one, two, three in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., one] = a[..., two] * b[..., three] - a[..., three] * b[..., two]
    return out
