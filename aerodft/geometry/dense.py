"""The hot loops over all pixels of an image, and over many pixels at once: undistorted, and met with level ground.

All of them stand in this module: code that is kept on disk is renewed only when its own file changes.
"""

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from aerodft.geometry.jit import njit_ieee
from aerodft.model.arrays import FloatArray

Float32Array: TypeAlias = npt.NDArray[np.float32]

RAY_X, RAY_Y, RAY_Z, PITCH = 0, 1, 2, 3  # planes of a ray table
RANGE, X, Y, GSD = 0, 1, 2, 3  # planes of what ``meet_dense`` writes

_STEPS = 16
_CONVERGED, _ACCEPTED = 1e-14, 1e-11  # in units of the focal length, as in ``lens``


@njit_ieee
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


@njit_ieee
def meet_straight(pixels_px: FloatArray, ground_from_pixel: FloatArray, foot_m: FloatArray, out_m: FloatArray) -> None:
    """Meet the rays of ``pixels_px (n, 2)`` of a lens without distortion with level ground, into ``out_m (n, 2)``.

    Args:
        pixels_px: Pixels.
        ground_from_pixel: ``(3, 3)``: homogeneous pixel to a ray whose third component is upwards, in heights.
        foot_m: ``(2,)`` below the camera.
        out_m: NaN for rays that do not go down.
    """
    m = ground_from_pixel
    for k in range(len(pixels_px)):
        u, v = pixels_px[k, 0], pixels_px[k, 1]
        up = m[2, 0] * u + m[2, 1] * v + m[2, 2]
        reach = -1.0 / up if up < 0.0 else math.nan
        out_m[k, 0] = foot_m[0] + reach * (m[0, 0] * u + m[0, 1] * v + m[0, 2])
        out_m[k, 1] = foot_m[1] + reach * (m[1, 0] * u + m[1, 1] * v + m[1, 2])


@njit_ieee
def undistort(distorted: FloatArray, coefficients: tuple[float, ...], limit: float, out: FloatArray) -> None:
    """Invert Brown's distortion by Newton's method, started at the distorted point.

    Args:
        distorted: ``(n, 2)`` in units of the focal length.
        coefficients: k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV.
        limit: Radius up to which the model is one to one.
        out: ``(n, 2)``; NaN where it does not converge to a valid point, which does not mean that there is none.
    """
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
    for k in range(len(distorted)):
        x, y = distorted[k, 0], distorted[k, 1]
        good = False
        for _ in range(_STEPS):
            s = x * x + y * y
            over, under = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
            radial = over / under
            slope = (k1 + s * (2 * k2 + s * 3 * k3) - radial * (k4 + s * (2 * k5 + s * 3 * k6))) / under
            miss_x = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x) - distorted[k, 0]
            miss_y = y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y - distorted[k, 1]
            xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
            xy = 2 * (x * y * slope + p1 * x + p2 * y)
            yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
            det = xx * yy - xy * xy
            good = (abs(miss_x) < _ACCEPTED) & (abs(miss_y) < _ACCEPTED) & (det > 0.0) & (s <= limit * limit)
            step_x, step_y = (yy * miss_x - xy * miss_y) / det, (xx * miss_y - xy * miss_x) / det
            x, y = x - step_x, y - step_y
            if not (abs(step_x) > _CONVERGED or abs(step_y) > _CONVERGED):
                break
        out[k, 0] = x if good else math.nan
        out[k, 1] = y if good else math.nan
