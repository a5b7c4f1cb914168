"""Compiled loops over many pixels: undistortion, and intersection of rays with level ground.

All of them are in this module because numba's disk cache renews a function only when its own file changes. So that the
compiler vectorises, pixel pairs are read from flat arrays and pixels that fail are left to a second, slower loop.
"""

import math
from typing import TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from aerodft.jit import njit_fused, njit_ieee
from aerodft.model import FloatArray

Number = TypeVar("Number", float, FloatArray)
Float32Array: TypeAlias = npt.NDArray[np.float32]
BrownLens: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], float]
"""fx, fy, cx and cy; k1, k2, p1, p2, k3, k4, k5, k6; and the radius up to which the model is one to one."""
FisheyeLens: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], float]
"""fx, fy, cx and cy; k1, k2, k3, k4; and the angle from the axis up to which the model is one to one."""

RAY_X, RAY_Y, RAY_Z, PITCH = 0, 1, 2, 3  # planes of a ray table
RANGE, X, Y, GSD = 0, 1, 2, 3  # planes of what ``meet_dense`` writes

_MAX_RADIUS_DOUBLINGS = 64
_BISECTION_STEPS = 12  # bring Newton's start within 2e-4 of the valid radius
_NEWTON_STEPS = 16
_STEP_TOLERANCE, _RESIDUAL_TOLERANCE = 1e-14, 1e-11  # in units of the focal length, or rad, as in ``lens``
_FAST_NEWTON_STEPS = 5
_FAST_STEP = 1e-8  # a last Newton step of this size leaves an error of the order of its square
_BLOCK_PIXELS = 512  # as many as stay in the nearest cache from one loop to the next


@njit_fused
def meet_dense(
    table: Float32Array, ground_from_cam: Float32Array, height_m: np.float32, limit_m: np.float32, out: Float32Array
) -> None:
    """Intersect the rays of all pixels of an image with level ground.

    Args:
        table: ``(4, n)``: unit rays in camera axes, and the square root of each pixel's solid angle; NaN for no ray.
        ground_from_cam: ``(3, 3)`` rotation from camera axes to those of the ground, the third upwards.
        height_m: Height of the camera above the ground.
        limit_m: Maximum range.
        out: ``(4, n)``: range, first and second coordinate from the camera's foot, sampling distance; NaN for misses.
    """
    xx, xy, xz = ground_from_cam[0, 0], ground_from_cam[0, 1], ground_from_cam[0, 2]
    yx, yy, yz = ground_from_cam[1, 0], ground_from_cam[1, 1], ground_from_cam[1, 2]
    zx, zy, zz = ground_from_cam[2, 0], ground_from_cam[2, 1], ground_from_cam[2, 2]
    miss, nothing, one = np.float32(math.nan), np.float32(0.0), np.float32(1.0)
    per_height = one / height_m
    for k in range(table.shape[1]):
        x, y, z = table[RAY_X, k], table[RAY_Y, k], table[RAY_Z, k]
        down = -(zx * x + zy * y + zz * z)
        range_m = height_m / down
        range_m = range_m if (down > nothing) & (range_m <= limit_m) else miss
        out[RANGE, k] = range_m
        out[X, k] = range_m * (xx * x + xy * y + xz * z)
        out[Y, k] = range_m * (yx * x + yy * y + yz * z)
        out[GSD, k] = table[PITCH, k] * range_m * np.sqrt(range_m * per_height)


@njit_fused
def meet_pinhole(pixels_px: FloatArray, ground_from_pixel: FloatArray, foot_m: FloatArray, out_m: FloatArray) -> None:
    """Intersect the rays of pixels ``(n, 2)`` of a lens without distortion with level ground.

    Args:
        pixels_px: ``(n, 2)``.
        ground_from_pixel: ``(3, 3)`` homogeneous pixel to ray, third component upwards, in units of the height.
        foot_m: ``(3,)`` the point of the ground below the camera.
        out_m: ``(n, 3)``; NaN for rays that do not go down.
    """
    m = ground_from_pixel
    east_m, north_m, up_m = foot_m[0], foot_m[1], foot_m[2]  # in the loop, reading these would take a third of its time
    pixels, points = pixels_px.reshape(-1), out_m.reshape(-1)
    for k in range(len(pixels_px)):
        u, v = pixels[2 * k], pixels[2 * k + 1]
        up = m[2, 0] * u + m[2, 1] * v + m[2, 2]
        reach = -1.0 / up if up < 0.0 else math.nan
        points[3 * k] = east_m + reach * (m[0, 0] * u + m[0, 1] * v + m[0, 2])
        points[3 * k + 1] = north_m + reach * (m[1, 0] * u + m[1, 1] * v + m[1, 2])
        points[3 * k + 2] = up_m if up < 0.0 else math.nan


@njit_fused
def meet_brown(
    pixels_px: FloatArray,
    lens: BrownLens,
    ground_from_ray: FloatArray,
    foot_m: FloatArray,
    out_m: FloatArray,
) -> None:
    """Ground points of pixels through a lens with Brown's distortion.

    Args:
        pixels_px: ``(n, 2)``.
        lens: The lens.
        ground_from_ray: ``(3, 3)`` camera axes to axes with the third upwards, in units of the height.
        foot_m: ``(3,)`` the point of the ground below the camera.
        out_m: ``(n, 3)``; NaN for rays that do not go down, and where the model has no inverse.
    """
    intrinsics, coefficients, limit = lens
    size = min(_BLOCK_PIXELS, len(pixels_px))
    distorted, undistorted = np.empty((size, 2)), np.empty((size, 2))
    for first in range(0, len(pixels_px), _BLOCK_PIXELS):
        count = min(_BLOCK_PIXELS, len(pixels_px) - first)
        normalise(pixels_px[first : first + count], intrinsics, distorted)
        undistort(distorted[:count], coefficients, limit, undistorted)
        meet_pinhole(undistorted[:count], ground_from_ray, foot_m, out_m[first : first + count])


@njit_fused
def normalise(pixels_px: FloatArray, intrinsics: tuple[float, ...], out: FloatArray) -> None:
    """Pixels ``(n, 2)`` from the principal point in focal lengths, ``(n, 2)``; intrinsics are fx, fy, cx, cy in px."""
    fx, fy, cx, cy = intrinsics
    per_x, per_y = 1.0 / fx, 1.0 / fy
    pixels, normalised = pixels_px.reshape(-1), out.reshape(-1)
    for k in range(len(pixels_px)):
        normalised[2 * k], normalised[2 * k + 1] = (pixels[2 * k] - cx) * per_x, (pixels[2 * k + 1] - cy) * per_y


def brown(coefficients: tuple[float, ...], x: Number, y: Number) -> tuple[Number, Number, Number, Number, Number]:
    """Brown's distortion with derivatives: xd, yd; d xd / dx, d xd / dy = d yd / dx, d yd / dy."""
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
    s = x * x + y * y
    over, under = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
    radial = over / under
    slope = (k1 + s * (2 * k2 + s * 3 * k3) - radial * (k4 + s * (2 * k5 + s * 3 * k6))) / under
    xd = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    yd = y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    xy = 2 * (x * y * slope + p1 * x + p2 * y)
    yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    return xd, yd, xx, xy, yy


_brown = njit_ieee(brown)


@njit_ieee
def _newton(coefficients: tuple[float, ...], xd: float, yd: float, x: float, y: float) -> tuple[float, float, bool]:
    """Newton step from ``x, y`` to the inverse of ``xd, yd``, and whether the Jacobian's determinant is positive."""
    model_x, model_y, xx, xy, yy = _brown(coefficients, x, y)
    det = xx * yy - xy * xy
    error_x, error_y = model_x - xd, model_y - yd
    return (yy * error_x - xy * error_y) / det, (xx * error_y - xy * error_x) / det, det > 0.0


@njit_ieee
def undistort(distorted: FloatArray, coefficients: tuple[float, ...], limit: float, out: FloatArray) -> None:
    """Invert Brown's distortion by Newton's method.

    Args:
        distorted: ``(n, 2)`` in units of the focal length.
        coefficients: k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV.
        limit: Radius up to which the model is one to one.
        out: ``(n, 2)`` or more, of which the first are written; NaN where the model has no inverse.
    """
    xy_d, xy = distorted.reshape(-1), out.reshape(-1)
    for k in range(len(distorted)):
        xd, yd = xy_d[2 * k], xy_d[2 * k + 1]
        x, y, step_x, step_y, upright = xd, yd, 0.0, 0.0, True
        for _ in range(_FAST_NEWTON_STEPS):
            step_x, step_y, upright = _newton(coefficients, xd, yd, x, y)
            x, y = x - step_x, y - step_y
        good = (abs(step_x) < _FAST_STEP) & (abs(step_y) < _FAST_STEP) & upright & (x * x + y * y <= limit * limit)
        xy[2 * k] = x if good else math.nan
        xy[2 * k + 1] = y if good else math.nan
    for k in range(len(distorted)):
        if math.isnan(xy[2 * k]):
            xy[2 * k], xy[2 * k + 1] = _undistort_one(xy_d[2 * k], xy_d[2 * k + 1], coefficients, limit)


@njit_ieee
def _undistort_one(xd: float, yd: float, coefficients: tuple[float, ...], limit: float) -> tuple[float, float]:
    """Undistorted point by Newton's method from the inverse of the radial part; NaN where there is none."""
    radius_d = math.sqrt(xd * xd + yd * yd)
    scale = _radial_inverse(radius_d, coefficients, limit) / radius_d if radius_d > 0.0 else 1.0
    x, y = xd * scale, yd * scale
    for _ in range(_NEWTON_STEPS):
        step_x, step_y, _ = _newton(coefficients, xd, yd, x, y)
        x, y = x - step_x, y - step_y
        if not (abs(step_x) > _STEP_TOLERANCE or abs(step_y) > _STEP_TOLERANCE):
            break
    model_x, model_y, xx, xy, yy = _brown(coefficients, x, y)
    near = abs(model_x - xd) < _RESIDUAL_TOLERANCE and abs(model_y - yd) < _RESIDUAL_TOLERANCE
    if near and x * x + y * y <= limit * limit and xx * yy > xy * xy:
        return x, y
    return math.nan, math.nan


@njit_ieee
def _radial_inverse(radius_d: float, coefficients: tuple[float, ...], limit: float) -> float:
    """Approximate radius in [0, limit] that the radial part distorts to ``radius_d``; the limit where none does."""
    k1, k2, _, _, k3, k4, k5, k6 = coefficients
    radial_only = (k1, k2, 0.0, 0.0, k3, k4, k5, k6)
    low, high = 0.0, limit
    if math.isinf(limit):
        high = 1.0
        for _ in range(_MAX_RADIUS_DOUBLINGS):
            if _brown(radial_only, high, 0.0)[0] < radius_d:
                high = 2.0 * high
    for _ in range(_BISECTION_STEPS):
        middle = (low + high) / 2.0
        if _brown(radial_only, middle, 0.0)[0] < radius_d:
            low = middle
        else:
            high = middle
    return (low + high) / 2.0


@njit_fused
def meet_fisheye(
    pixels_px: FloatArray, lens: FisheyeLens, ground_from_ray: FloatArray, foot_m: FloatArray, out_m: FloatArray
) -> None:
    """Ground points of pixels through a fisheye lens; arguments as in ``meet_brown``."""
    (fx, fy, cx, cy), coefficients, limit = lens
    m = ground_from_ray
    for k in range(len(pixels_px)):
        x, y = (pixels_px[k, 0] - cx) / fx, (pixels_px[k, 1] - cy) / fy
        radius = math.sqrt(x * x + y * y)
        angle = _fisheye_angle(radius, coefficients, limit)
        scale = math.sin(angle) / radius if radius > 0.0 else 1.0
        x, y, z = x * scale, y * scale, math.cos(angle)
        up = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z
        reach = -1.0 / up if up < 0.0 else math.nan
        out_m[k, 0] = foot_m[0] + reach * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z)
        out_m[k, 1] = foot_m[1] + reach * (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z)
        out_m[k, 2] = foot_m[2] if up < 0.0 else math.nan


@njit_fused
def fisheye_angles(radii: FloatArray, coefficients: tuple[float, ...], limit: float, out: FloatArray) -> None:
    """Angles ``(n,)`` from the axis at distorted radii ``(n,)``; NaN where the model has no inverse."""
    for k in range(len(radii)):
        out[k] = _fisheye_angle(radii[k], coefficients, limit)


@njit_fused
def _fisheye(angle: float, coefficients: tuple[float, ...]) -> tuple[float, float]:
    """Distorted radius, and its derivative by the angle from the axis."""
    k1, k2, k3, k4 = coefficients
    s = angle * angle
    value = angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    return value, 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))


@njit_fused
def _fisheye_angle(radius: float, coefficients: tuple[float, ...], limit: float) -> float:
    """Angle from the axis at a distorted radius; NaN beyond the limit."""
    angle = _fisheye_newton(radius, min(radius, limit), coefficients, limit)
    if math.isnan(angle):
        angle = _fisheye_newton(radius, _fisheye_bisect(radius, coefficients, limit), coefficients, limit)
    return angle


@njit_fused
def _fisheye_newton(radius: float, angle: float, coefficients: tuple[float, ...], limit: float) -> float:
    for _ in range(_NEWTON_STEPS):
        value, slope = _fisheye(angle, coefficients)
        before = angle
        angle = min(max(angle - (value - radius) / slope, 0.0), limit)
        if not abs(angle - before) > _STEP_TOLERANCE:
            break
    return angle if abs(_fisheye(angle, coefficients)[0] - radius) < _RESIDUAL_TOLERANCE else math.nan


@njit_fused
def _fisheye_bisect(radius: float, coefficients: tuple[float, ...], limit: float) -> float:
    low, high = 0.0, limit
    for _ in range(_BISECTION_STEPS):
        middle = (low + high) / 2.0
        if _fisheye(middle, coefficients)[0] < radius:
            low = middle
        else:
            high = middle
    return (low + high) / 2.0
