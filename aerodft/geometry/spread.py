"""The hot loops over the covariances of many ground points.

All of them stand in this module, as in ``dense``. A ground point's error is linear in the errors of its ray and of the
camera: with the ray ``q`` in ENU, the camera ``h`` above the ground, ``s = h / -q_z`` and ``a = q_xy / -q_z``, it is
``s [I a] dq + [I a] dx`` for an error ``dx`` of the camera's position; what raises the ground lowers the camera.
"""

import math
from typing import TypeAlias

import numpy as np

from aerodft.geometry.jit import njit_fused
from aerodft.model.arrays import FloatArray

Quadratic: TypeAlias = tuple[float, float, float, float, float, float]
"""Factors of x^2, xy, y^2, x, y and 1."""

_Row: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = tuple[_Row, _Row, _Row]

RAYS_AT_ONCE = 2048
"""Columns of a ray table, as in ``dense``: a constant, so that the compiler sees that rows do not overlap."""

_BLOCK = 128  # points whose derivatives stay in the nearest cache
_HEIGHT, _ROTATION, _FOCAL, _CENTRE, _BENDS = 2, 3, 6, 8, 10  # rows of derivatives; the first two are east and north


@njit_fused
def _at(form: Quadratic, x: float, y: float) -> float:
    return (form[0] * x + (form[1] * y + form[3])) * x + ((form[2] * y + form[4]) * y + form[5])


@njit_fused
def spread_straight(
    pixels_px: FloatArray,
    ground_from_pixel: Matrix,
    forms: tuple[Quadratic, ...],
    foot_m: tuple[float, float],
    out_m: FloatArray,
    cov_m2: FloatArray,
) -> None:
    """Ground points of a lens without distortion, and their covariances.

    Args:
        pixels_px: ``(n, 2)``.
        ground_from_pixel: ``(3, 3)``: homogeneous pixel to a ray whose third component is upwards, in heights.
        forms: Covariance of ``s dq + dx`` as a function of the point's own east and north from the camera's foot: EE,
            EN, NN; then EU and NU divided by the height, and UU divided by its square.
        foot_m: Below the camera.
        out_m: ``(n, 2)``; NaN for rays that do not go down.
        cov_m2: ``(n, 2, 2)``; NaN as ``out_m``.
    """
    m = ground_from_pixel
    ee, en, nn, eu, nu, uu = forms
    given, points, covs = pixels_px.reshape(-1), out_m.reshape(-1), cov_m2.reshape(-1)
    block = np.empty(5 * _BLOCK)
    for first in range(0, len(pixels_px), _BLOCK):  # three short loops: one's factors fill the registers
        count = min(_BLOCK, len(pixels_px) - first)
        pixel, point, cov = given[2 * first :], points[2 * first :], covs[4 * first :]
        for k in range(count):
            u, v = pixel[2 * k], pixel[2 * k + 1]
            up = m[2][0] * u + (m[2][1] * v + m[2][2])
            reach = -1.0 / up if up < 0.0 else math.nan
            x = reach * (m[0][0] * u + (m[0][1] * v + m[0][2]))
            y = reach * (m[1][0] * u + (m[1][1] * v + m[1][2]))
            block[k], block[_BLOCK + k] = x, y
            point[2 * k], point[2 * k + 1] = foot_m[0] + x, foot_m[1] + y
        for k in range(count):
            x, y = block[k], block[_BLOCK + k]
            block[2 * _BLOCK + k], block[3 * _BLOCK + k] = _at(eu, x, y), _at(nu, x, y)
            block[4 * _BLOCK + k] = _at(uu, x, y)
        for k in range(count):
            x, y = block[k], block[_BLOCK + k]
            by_x, by_y, by_up = block[2 * _BLOCK + k], block[3 * _BLOCK + k], block[4 * _BLOCK + k]
            across = y * (x * by_up + by_x) + (x * by_y + _at(en, x, y))
            cov[4 * k] = x * (x * by_up + 2.0 * by_x) + _at(ee, x, y)
            cov[4 * k + 1] = across
            cov[4 * k + 2] = across
            cov[4 * k + 3] = y * (y * by_up + 2.0 * by_y) + _at(nn, x, y)


@njit_fused
def spread_rays(
    rays: tuple[FloatArray, FloatArray],
    enu_from_cam: Matrix,
    camera_m: _Row,
    factors: FloatArray,
    out_m: FloatArray,
    cov_m2: FloatArray,
) -> None:
    """Points of at most ``RAYS_AT_ONCE`` rays of any lens, and their covariances.

    Args:
        rays: What ``dense.brown_rays`` writes.
        enu_from_cam: ``(3, 3)`` rotation.
        camera_m: East, north, and height above the ground; NaN for a camera that is not above it.
        factors: ``(r, 10 + c)``, whose product with itself is the covariance of position, small rotation in camera
            axes, fx, fy, cx, cy (with the pixel's own error), and ``c`` distortion coefficients.
        out_m: ``(n, 2)``; NaN for rays that do not go down.
        cov_m2: ``(n, 2, 2)``; NaN as ``out_m``.
    """
    size = factors.shape[1]
    table, bends = rays[0].reshape(-1), rays[1].reshape(-1)
    points, covs = out_m.reshape(-1), cov_m2.reshape(-1)
    east, north = np.zeros(size * _BLOCK), np.zeros(size * _BLOCK)
    east[:_BLOCK], north[_BLOCK : 2 * _BLOCK] = 1.0, 1.0
    sums, by_east, by_north = np.empty(3 * _BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    for first in range(0, len(out_m), _BLOCK):
        count = min(_BLOCK, len(out_m) - first)
        for axis, rows in enumerate((east, north)):
            _differentiate(table[first:], count, enu_from_cam[axis], enu_from_cam[2], camera_m[2], rows)
            for index in range(size - _BENDS):
                _bend(bends[2 * index * RAYS_AT_ONCE + first :], count, rows, rows[(_BENDS + index) * _BLOCK :])
        sums[:] = 0.0
        for row in range(len(factors)):
            by_east[:], by_north[:] = 0.0, 0.0
            for index in range(size):
                if factors[row, index] != 0.0:
                    _add(east[index * _BLOCK :], factors[row, index], by_east)
                    _add(north[index * _BLOCK :], factors[row, index], by_north)
            _add_square(by_east, by_north, sums)
        for k in range(count):
            points[2 * (first + k)] = camera_m[0] + camera_m[2] * east[2 * _BLOCK + k]
            points[2 * (first + k) + 1] = camera_m[1] + camera_m[2] * north[2 * _BLOCK + k]
            covs[4 * (first + k)] = sums[k]
            covs[4 * (first + k) + 1] = sums[_BLOCK + k]
            covs[4 * (first + k) + 2] = sums[_BLOCK + k]
            covs[4 * (first + k) + 3] = sums[2 * _BLOCK + k]


@njit_fused
def _differentiate(
    table: FloatArray,
    count: int,
    along: _Row,
    upwards: _Row,
    height_m: float,
    rows: FloatArray,
) -> None:
    """One ground coordinate's derivatives by the height, the rotation, the focal lengths and the principal point."""
    for k in range(count):
        x, y, z = table[k], table[RAYS_AT_ONCE + k], table[2 * RAYS_AT_ONCE + k]
        up = upwards[0] * x + upwards[1] * y + upwards[2] * z
        reach = -1.0 / up if up < 0.0 else math.nan
        away = reach * (along[0] * x + along[1] * y + along[2] * z)
        scale = reach * height_m
        by_x = scale * (along[0] + away * upwards[0])
        by_y = scale * (along[1] + away * upwards[1])
        by_z = scale * (along[2] + away * upwards[2])
        by_u = (
            by_x * table[3 * RAYS_AT_ONCE + k] + by_y * table[5 * RAYS_AT_ONCE + k] + by_z * table[7 * RAYS_AT_ONCE + k]
        )
        by_v = (
            by_x * table[4 * RAYS_AT_ONCE + k] + by_y * table[6 * RAYS_AT_ONCE + k] + by_z * table[8 * RAYS_AT_ONCE + k]
        )
        rows[_HEIGHT * _BLOCK + k] = away
        rows[_ROTATION * _BLOCK + k] = by_z * y - by_y * z
        rows[(_ROTATION + 1) * _BLOCK + k] = by_x * z - by_z * x
        rows[(_ROTATION + 2) * _BLOCK + k] = by_y * x - by_x * y
        rows[_FOCAL * _BLOCK + k] = -by_u * table[9 * RAYS_AT_ONCE + k]
        rows[(_FOCAL + 1) * _BLOCK + k] = -by_v * table[10 * RAYS_AT_ONCE + k]
        rows[_CENTRE * _BLOCK + k] = -by_u
        rows[(_CENTRE + 1) * _BLOCK + k] = -by_v


@njit_fused
def _bend(bends: FloatArray, count: int, rows: FloatArray, row: FloatArray) -> None:
    """By a distortion coefficient: as by a principal point that is off by what it moves."""
    for k in range(count):
        row[k] = rows[_CENTRE * _BLOCK + k] * bends[k] + rows[(_CENTRE + 1) * _BLOCK + k] * bends[RAYS_AT_ONCE + k]


@njit_fused
def _add(values: FloatArray, factor: float, sums: FloatArray) -> None:
    for k in range(_BLOCK):
        sums[k] += factor * values[k]


@njit_fused
def _add_square(by_east: FloatArray, by_north: FloatArray, sums: FloatArray) -> None:
    for k in range(_BLOCK):
        sums[k] += by_east[k] * by_east[k]
        sums[_BLOCK + k] += by_east[k] * by_north[k]
        sums[2 * _BLOCK + k] += by_north[k] * by_north[k]
