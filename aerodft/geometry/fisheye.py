"""The hot loops over many pixels of a fisheye lens (the equidistant polynomial): met with level ground, and as rays.

All of them stand in this module, as in ``dense``.
"""

import math
from typing import TypeAlias

from aerodft.geometry.jit import njit_fused
from aerodft.model.arrays import FloatArray

FisheyeLens: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], float]
"""fx, fy, cx and cy; k1, k2, k3, k4; and the angle from the axis up to which the model is one to one."""

RAYS_AT_ONCE = 2048
"""Columns of a ray table, as in ``dense``."""

_STEPS, _BISECTIONS = 16, 12
_CONVERGED, _ACCEPTED = 1e-14, 1e-11  # rad, and in units of the focal length, as in ``lens``


@njit_fused
def meet_fisheye(
    pixels_px: FloatArray, lens: FisheyeLens, ground_from_ray: FloatArray, foot_m: FloatArray, out_m: FloatArray
) -> None:
    """As ``dense.meet_brown``, through a fisheye lens."""
    (fx, fy, cx, cy), coefficients, limit = lens
    m = ground_from_ray
    for k in range(len(pixels_px)):
        x, y = (pixels_px[k, 0] - cx) / fx, (pixels_px[k, 1] - cy) / fy
        radius = math.sqrt(x * x + y * y)
        angle = _angle(radius, coefficients, limit)
        scale = math.sin(angle) / radius if radius > 0.0 else 1.0
        x, y, z = x * scale, y * scale, math.cos(angle)
        up = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z
        reach = -1.0 / up if up < 0.0 else math.nan
        out_m[k, 0] = foot_m[0] + reach * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z)
        out_m[k, 1] = foot_m[1] + reach * (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z)


@njit_fused
def fisheye_rays(pixels_px: FloatArray, lens: FisheyeLens, rays: FloatArray, bends: FloatArray) -> None:
    """As ``dense.brown_rays``; rays of unit length."""
    (fx, fy, cx, cy), coefficients, limit = lens
    for k in range(len(pixels_px)):
        xd, yd = (pixels_px[k, 0] - cx) / fx, (pixels_px[k, 1] - cy) / fy
        radius = math.sqrt(xd * xd + yd * yd)
        angle = _angle(radius, coefficients, limit)
        out_x, out_y = (xd / radius, yd / radius) if radius > 0.0 else (1.0, 0.0)
        sine, cosine, slope = math.sin(angle), math.cos(angle), 1.0 / _distort(angle, coefficients)[1]
        along = cosine * slope
        across = sine / radius if radius > 0.0 else slope
        rays[0, k], rays[1, k], rays[2, k] = out_x * sine, out_y * sine, cosine
        mixed = (along - across) * out_x * out_y
        rays[3, k], rays[4, k] = (along * out_x * out_x + across * out_y * out_y) / fx, mixed / fy
        rays[5, k], rays[6, k] = mixed / fx, (along * out_y * out_y + across * out_x * out_x) / fy
        rays[7, k], rays[8, k] = -sine * slope * out_x / fx, -sine * slope * out_y / fy
        rays[9, k], rays[10, k] = xd, yd
        power = angle
        for row in range(0, len(bends), 2):
            power = power * angle * angle
            bends[row, k], bends[row + 1, k] = fx * out_x * power, fy * out_y * power


@njit_fused
def _distort(angle: float, coefficients: tuple[float, ...]) -> tuple[float, float]:
    """Distorted radius, and its derivative by the angle."""
    k1, k2, k3, k4 = coefficients
    s = angle * angle
    value = angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    return value, 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))


@njit_fused
def _angle(radius: float, coefficients: tuple[float, ...], limit: float) -> float:
    """Angle from the axis of what is seen at a distorted radius; NaN beyond the limit."""
    angle = _newton(radius, min(radius, limit), coefficients, limit)
    if math.isnan(angle):
        angle = _newton(radius, _bisect(radius, coefficients, limit), coefficients, limit)
    return angle


@njit_fused
def _newton(radius: float, angle: float, coefficients: tuple[float, ...], limit: float) -> float:
    for _ in range(_STEPS):
        value, slope = _distort(angle, coefficients)
        before = angle
        angle = min(max(angle - (value - radius) / slope, 0.0), limit)
        if not abs(angle - before) > _CONVERGED:
            break
    return angle if abs(_distort(angle, coefficients)[0] - radius) < _ACCEPTED else math.nan


@njit_fused
def _bisect(radius: float, coefficients: tuple[float, ...], limit: float) -> float:
    low, high = 0.0, limit
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2.0
        if _distort(middle, coefficients)[0] < radius:
            low = middle
        else:
            high = middle
    return (low + high) / 2.0
