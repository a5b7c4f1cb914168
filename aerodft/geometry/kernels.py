"""The hot loops over all pixels of an image, and over many pixels at once: undistorted, and met with level ground.

All of them stand in this module: code that is kept on disk is renewed only when its own file changes. Pairs are taken
from flat arrays, two numbers a step, and what fails is left to a second loop: so the compiler takes several at once.
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

_DOUBLINGS = 64
_BISECTIONS = 12  # brings Newton's start within 2e-4 of the valid radius
_STEPS = 16
_CONVERGED, _ACCEPTED = 1e-14, 1e-11  # in units of the focal length, or rad, as in ``lens``
_FIRST_STEPS = 5
_SETTLED = 1e-8  # a step of Newton's that leaves an error of the order of its square
_BLOCK = 512  # pixels that stay in the nearest cache from one loop to the next


@njit_fused
def meet_dense(
    table: Float32Array, turn: Float32Array, height_m: np.float32, limit_m: np.float32, out: Float32Array
) -> None:
    """Meet the rays of a whole image with level ground.

    Args:
        table: ``(4, n)``: unit rays in camera axes, and the square root of each pixel's solid angle; NaN for no ray.
        turn: ``(3, 3)`` rotation from camera axes to those of the ground, the third upwards.
        height_m: Of the camera above the ground.
        limit_m: Longest range.
        out: ``(4, n)``: range, first and second coordinate from the camera's foot, sampling distance; NaN for misses.
    """
    xx, xy, xz = turn[0, 0], turn[0, 1], turn[0, 2]
    yx, yy, yz = turn[1, 0], turn[1, 1], turn[1, 2]
    zx, zy, zz = turn[2, 0], turn[2, 1], turn[2, 2]
    miss, nothing, one = np.float32(math.nan), np.float32(0.0), np.float32(1.0)
    per_height = one / height_m
    for k in range(table.shape[1]):
        x, y, z = table[RAY_X, k], table[RAY_Y, k], table[RAY_Z, k]
        down = -(zx * x + zy * y + zz * z)
        away = height_m / down
        away = away if (down > nothing) & (away <= limit_m) else miss
        out[RANGE, k] = away
        out[X, k] = away * (xx * x + xy * y + xz * z)
        out[Y, k] = away * (yx * x + yy * y + yz * z)
        out[GSD, k] = table[PITCH, k] * away * np.sqrt(away * per_height)


@njit_fused
def meet_straight(pixels_px: FloatArray, ground_from_pixel: FloatArray, foot_m: FloatArray, out_m: FloatArray) -> None:
    """Meet the rays of ``pixels_px (n, 2)`` of a lens without distortion with level ground, into ``out_m (n, 3)``.

    Args:
        pixels_px: Pixels.
        ground_from_pixel: ``(3, 3)``: homogeneous pixel to a ray whose third component is upwards, in heights.
        foot_m: ``(3,)`` the point of the ground below the camera.
        out_m: NaN for rays that do not go down.
    """
    m = ground_from_pixel
    given, points = pixels_px.reshape(-1), out_m.reshape(-1)
    for k in range(len(pixels_px)):
        u, v = given[2 * k], given[2 * k + 1]
        up = m[2, 0] * u + m[2, 1] * v + m[2, 2]
        reach = -1.0 / up if up < 0.0 else math.nan
        points[3 * k] = foot_m[0] + reach * (m[0, 0] * u + m[0, 1] * v + m[0, 2])
        points[3 * k + 1] = foot_m[1] + reach * (m[1, 0] * u + m[1, 1] * v + m[1, 2])
        points[3 * k + 2] = foot_m[2] if up < 0.0 else math.nan


@njit_fused
def meet_brown(
    pixels_px: FloatArray,
    lens: BrownLens,
    ground_from_ray: FloatArray,
    foot_m: FloatArray,
    out_m: FloatArray,
) -> None:
    """Ground points of pixels, through a lens with Brown's distortion.

    Args:
        pixels_px: ``(n, 2)``.
        lens: What it is.
        ground_from_ray: ``(3, 3)``: ray in camera axes to one whose third component is upwards, in heights.
        foot_m: ``(3,)`` the point of the ground below the camera.
        out_m: ``(n, 3)``; NaN for rays that do not go down, and where the model has no inverse.
    """
    intrinsics, coefficients, limit = lens
    size = min(_BLOCK, len(pixels_px))
    distorted, straight = np.empty((size, 2)), np.empty((size, 2))
    for first in range(0, len(pixels_px), _BLOCK):
        count = min(_BLOCK, len(pixels_px) - first)
        normalise(pixels_px[first : first + count], intrinsics, distorted)
        undistort(distorted[:count], coefficients, limit, straight)
        meet_straight(straight[:count], ground_from_ray, foot_m, out_m[first : first + count])


@njit_fused
def normalise(pixels_px: FloatArray, intrinsics: tuple[float, ...], out: FloatArray) -> None:
    """Pixels ``(n, 2)`` to ``(n, 2)`` in units of the focal length from the principal point; fx, fy, cx, cy in px."""
    fx, fy, cx, cy = intrinsics
    per_x, per_y = 1.0 / fx, 1.0 / fy
    given, found = pixels_px.reshape(-1), out.reshape(-1)
    for k in range(len(pixels_px)):
        found[2 * k], found[2 * k + 1] = (given[2 * k] - cx) * per_x, (given[2 * k + 1] - cy) * per_y


def brown(coefficients: tuple[float, ...], x: Number, y: Number) -> tuple[Number, Number, Number, Number, Number]:
    """Brown's distortion, and its derivatives: xd, yd; d xd / dx, d xd / dy = d yd / dx, d yd / dy."""
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
    """Newton's step from ``x, y`` towards the inverse of ``xd, yd``, and whether the model is upright there."""
    got_x, got_y, xx, xy, yy = _brown(coefficients, x, y)
    det = xx * yy - xy * xy
    miss_x, miss_y = got_x - xd, got_y - yd
    return (yy * miss_x - xy * miss_y) / det, (xx * miss_y - xy * miss_x) / det, det > 0.0


@njit_ieee
def undistort(distorted: FloatArray, coefficients: tuple[float, ...], limit: float, out: FloatArray) -> None:
    """Invert Brown's distortion by Newton's method.

    Args:
        distorted: ``(n, 2)`` in units of the focal length.
        coefficients: k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV.
        limit: Radius up to which the model is one to one.
        out: ``(n, 2)`` or more, of which the first are written; NaN where the model has no inverse.
    """
    given, found = distorted.reshape(-1), out.reshape(-1)
    for k in range(len(distorted)):
        xd, yd = given[2 * k], given[2 * k + 1]
        x, y, step_x, step_y, upright = xd, yd, 0.0, 0.0, True
        for _ in range(_FIRST_STEPS):
            step_x, step_y, upright = _newton(coefficients, xd, yd, x, y)
            x, y = x - step_x, y - step_y
        good = (abs(step_x) < _SETTLED) & (abs(step_y) < _SETTLED) & upright & (x * x + y * y <= limit * limit)
        found[2 * k] = x if good else math.nan
        found[2 * k + 1] = y if good else math.nan
    for k in range(len(distorted)):
        if math.isnan(found[2 * k]):
            found[2 * k], found[2 * k + 1] = _undistort_surely(given[2 * k], given[2 * k + 1], coefficients, limit)


@njit_ieee
def _undistort_surely(xd: float, yd: float, coefficients: tuple[float, ...], limit: float) -> tuple[float, float]:
    """Undistorted pixel by Newton's steps, started where the radial part alone has its inverse."""
    radius_d = math.sqrt(xd * xd + yd * yd)
    scale = _radius(radius_d, coefficients, limit) / radius_d if radius_d > 0.0 else 1.0
    x, y = xd * scale, yd * scale
    for _ in range(_STEPS):
        step_x, step_y, _ = _newton(coefficients, xd, yd, x, y)
        x, y = x - step_x, y - step_y
        if not (abs(step_x) > _CONVERGED or abs(step_y) > _CONVERGED):
            break
    got_x, got_y, xx, xy, yy = _brown(coefficients, x, y)
    near = abs(got_x - xd) < _ACCEPTED and abs(got_y - yd) < _ACCEPTED
    if near and x * x + y * y <= limit * limit and xx * yy > xy * xy:
        return x, y
    return math.nan, math.nan


@njit_ieee
def _radius(radius_d: float, coefficients: tuple[float, ...], limit: float) -> float:
    """Approximate radius in [0, limit] that is distorted to ``radius_d``; the limit where that is beyond it."""
    k1, k2, _, _, k3, k4, k5, k6 = coefficients
    radial_only = (k1, k2, 0.0, 0.0, k3, k4, k5, k6)
    low, high = 0.0, limit
    if math.isinf(limit):
        high = 1.0
        for _ in range(_DOUBLINGS):
            if _brown(radial_only, high, 0.0)[0] < radius_d:
                high = 2.0 * high
    for _ in range(_BISECTIONS):
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
    """Ground points of pixels, through a fisheye lens."""
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
    """Angles ``(n,)`` from the axis of what is seen at distorted radii ``(n,)``; NaN where the model has no inverse."""
    for k in range(len(radii)):
        out[k] = _fisheye_angle(radii[k], coefficients, limit)


@njit_fused
def _fisheye(angle: float, coefficients: tuple[float, ...]) -> tuple[float, float]:
    """Distorted radius, and its derivative by the angle."""
    k1, k2, k3, k4 = coefficients
    s = angle * angle
    value = angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    return value, 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))


@njit_fused
def _fisheye_angle(radius: float, coefficients: tuple[float, ...], limit: float) -> float:
    """Angle from the axis of what is seen at a distorted radius; NaN beyond the limit."""
    angle = _fisheye_newton(radius, min(radius, limit), coefficients, limit)
    if math.isnan(angle):
        angle = _fisheye_newton(radius, _fisheye_bisect(radius, coefficients, limit), coefficients, limit)
    return angle


@njit_fused
def _fisheye_newton(radius: float, angle: float, coefficients: tuple[float, ...], limit: float) -> float:
    for _ in range(_STEPS):
        value, slope = _fisheye(angle, coefficients)
        before = angle
        angle = min(max(angle - (value - radius) / slope, 0.0), limit)
        if not abs(angle - before) > _CONVERGED:
            break
    return angle if abs(_fisheye(angle, coefficients)[0] - radius) < _ACCEPTED else math.nan


@njit_fused
def _fisheye_bisect(radius: float, coefficients: tuple[float, ...], limit: float) -> float:
    low, high = 0.0, limit
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2.0
        if _fisheye(middle, coefficients)[0] < radius:
            low = middle
        else:
            high = middle
    return (low + high) / 2.0
