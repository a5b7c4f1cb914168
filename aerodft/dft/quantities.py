"""Scalars of probes (range, length, area, height, bearing) and their gradients; leading axes are batches."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.equations import object_height
from aerodft.model import BoolArray, FloatArray, IntArray, read_only

_COLLINEAR: Final = 1e-10
"""Fraction of the square of a polygon's size: a smaller doubled area means that a corner lies on a side."""
_MIN_SEGMENT_STDS: Final = 12
"""Standard deviations of a pixel: a segment of a smoothed line is longer, so that its direction is known."""
_UP, _DOWN = read_only([0.0, 0.0, 1.0]), read_only([0.0, 0.0, -1.0])
_EAST, _LEVEL = read_only([1.0, 0.0, 0.0]), read_only([1.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class RayGeometry:
    """Camera position, and for each pixel of a probe the ray's direction and its point on the measured plane.

    Attributes:
        camera_enu_m: ``(..., 3)``.
        directions_enu: ``(..., k, 3)``, of any length.
        points_enu_m: ``(..., k, 3)``; NaN for rays that miss.
    """

    camera_enu_m: FloatArray
    directions_enu: FloatArray
    points_enu_m: FloatArray


@dataclass(frozen=True, slots=True)
class Gradient:
    """Partial derivatives of a scalar.

    By the camera ``(..., 3)``, directions ``(..., k, 3)`` and points ``(..., k, 3)``.
    """

    by_camera: FloatArray
    by_directions: FloatArray
    by_points: FloatArray


def slant_range(geometry: RayGeometry) -> FloatArray:
    """Distance ``(...)`` from the camera to the first point, m."""
    sight = geometry.points_enu_m[..., 0, :] - geometry.camera_enu_m
    return np.asarray(np.sqrt(_dot(sight, sight)))


def ground_distance(geometry: RayGeometry) -> FloatArray:
    """Horizontal distance ``(...)`` between the first two points, m."""
    points_m = geometry.points_enu_m
    east, north = (points_m[..., 1, axis] - points_m[..., 0, axis] for axis in (0, 1))
    return np.asarray(np.sqrt(east * east + north * north))


def polyline_length(geometry: RayGeometry) -> FloatArray:
    """Horizontal length ``(...)`` of the open line through all points, m."""
    steps = np.diff(geometry.points_enu_m[..., :2], axis=-2)
    return _ordered_sum(np.sqrt(steps[..., 0] * steps[..., 0] + steps[..., 1] * steps[..., 1]))


def median_width(geometry: RayGeometry) -> FloatArray:
    """Median ``(...)`` of the horizontal distances of consecutive pairs of points, m."""
    return np.asarray(np.median(_pair_widths(geometry.points_enu_m), axis=-1))


def polygon_area(geometry: RayGeometry) -> FloatArray:
    """Horizontal area ``(...)`` of the closed polygon of all points, m^2, in either orientation (shoelace formula)."""
    return np.abs(_signed_area(geometry.points_enu_m))


def upright_height(geometry: RayGeometry) -> FloatArray:
    """Height ``(...)`` of an upright object, base as the first pixel and top as the second, m.

    Where the top's ray is closest on the map to the vertical through the base, above the base; NaN where the ray leads
    away from the vertical, or straight down. Heading and image column do not matter.
    """
    base, ray = geometry.points_enu_m[..., 0, :], geometry.directions_enu[..., 1, :]
    along = ray[..., :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = _ordered_sum((base - geometry.camera_enu_m)[..., :2] * along) / _ordered_sum(along * along)
    top = geometry.camera_enu_m[..., 2] + reach * ray[..., 2]
    return np.asarray(np.where(reach > 0, top - base[..., 2], np.nan))


def bearing(geometry: RayGeometry) -> FloatArray:
    """Azimuth ``(...)`` from the first to the second point, or of one pixel's ray: clockwise from north, [0, 2 pi)."""
    points, directions = geometry.points_enu_m, geometry.directions_enu
    away = directions[..., 0, :] if points.shape[-2] == 1 else points[..., 1, :] - points[..., 0, :]
    return np.asarray(np.arctan2(away[..., 0], away[..., 1]) % (2 * np.pi))


def lateral_offset(geometry: RayGeometry) -> tuple[FloatArray, Gradient]:
    """Horizontal distance (m, signed) by which the top's ray passes the vertical through the base; its gradient.

    0 for an upright object, and for one seen from straight above.
    """
    base, ray = geometry.points_enu_m[..., 0, :], geometry.directions_enu[..., 1, :]
    to_base, along = (base - geometry.camera_enu_m) * _LEVEL, ray * _LEVEL
    square = _dot(along, along)
    has_azimuth = square > 0
    square = np.where(has_azimuth, square, 1.0)
    length = np.sqrt(square)
    offset = np.where(has_azimuth, to_base[..., 0] * along[..., 1] - to_base[..., 1] * along[..., 0], 0.0) / length
    by_points, by_directions = np.zeros_like(geometry.points_enu_m), np.zeros_like(geometry.directions_enu)
    by_points[..., 0, 0], by_points[..., 0, 1] = along[..., 1] / length, -along[..., 0] / length
    across = np.stack([-to_base[..., 1], to_base[..., 0], np.zeros_like(offset)], axis=-1)
    turn = across / length[..., None] - (offset / square)[..., None] * along
    by_directions[..., 1, :] = np.where(has_azimuth[..., None], turn, 0.0)
    return offset, Gradient(-by_points[..., 0, :], by_directions, by_points)


def range_gradient(geometry: RayGeometry) -> Gradient:
    """Gradient of ``slant_range``; straight down where the camera is in the point."""
    by_points, by_directions = _no_derivatives(geometry)
    by_points[..., 0, :] = _unit(geometry.points_enu_m[..., 0, :] - geometry.camera_enu_m, _DOWN)
    return Gradient(-by_points[..., 0, :], by_directions, by_points)


def length_gradient(geometry: RayGeometry) -> Gradient:
    """Gradient of ``polyline_length`` and of ``ground_distance``.

    Coincident points have no direction: the one away from the camera, where points are least certain, replaces it.
    """
    points, (by_points, by_directions) = geometry.points_enu_m, _no_derivatives(geometry)
    away = _unit((points[..., 0, :] - geometry.camera_enu_m) * _LEVEL, _EAST)
    units = _unit(np.diff(points, axis=-2) * _LEVEL, away[..., None, :])
    by_points[..., 1:, :] += units
    by_points[..., :-1, :] -= units
    return Gradient(np.zeros_like(away), by_directions, by_points)


def median_gradient(geometry: RayGeometry) -> Gradient:
    """Gradient of ``median_width``: of the pair in the middle, or of the mean of two.

    Other pairs do not matter while the order stays. Coincident points are treated as in ``length_gradient``.
    """
    points, (by_points, by_directions) = geometry.points_enu_m, _no_derivatives(geometry)
    order = np.argsort(_pair_widths(points), axis=-1, kind="stable")
    count = order.shape[-1]
    weight = np.zeros(order.shape)
    for row in {(count - 1) // 2, count // 2}:
        middle = order[..., row : row + 1]
        np.put_along_axis(weight, middle, np.take_along_axis(weight, middle, axis=-1) + (1.0 if count % 2 else 0.5), -1)
    away = _unit((points[..., 0, :] - geometry.camera_enu_m) * _LEVEL, _EAST)
    units = _unit((points[..., 1::2, :] - points[..., ::2, :]) * _LEVEL, away[..., None, :]) * weight[..., None]
    by_points[..., 1::2, :], by_points[..., ::2, :] = units, -units
    return Gradient(np.zeros_like(away), by_directions, by_points)


def area_gradient(geometry: RayGeometry) -> Gradient:
    """Gradient of ``polygon_area``."""
    points, (by_points, by_directions) = geometry.points_enu_m, _no_derivatives(geometry)
    before, after = np.roll(points, 1, axis=-2), np.roll(points, -1, axis=-2)
    by_points[..., 0] = (after[..., 1] - before[..., 1]) / 2
    by_points[..., 1] = (before[..., 0] - after[..., 0]) / 2
    by_points *= np.sign(_signed_area(points))[..., None, None]
    return Gradient(np.zeros_like(points[..., 0, :]), by_directions, by_points)


def height_gradient(geometry: RayGeometry) -> Gradient:
    """Gradient of ``upright_height``; zero where the object is seen from straight above."""
    base, ray = geometry.points_enu_m[..., 0, :], geometry.directions_enu[..., 1, :]
    by_points, by_directions = _no_derivatives(geometry)
    along, to_base = ray * _LEVEL, (base - geometry.camera_enu_m) * _LEVEL
    square = _dot(along, along)
    has_azimuth = (square > 0)[..., None]  # from straight above there is no height
    square = np.where(square > 0, square, 1.0)
    slope, reach = (ray[..., 2] / square)[..., None], (_dot(to_base, along) / square)[..., None]
    by_points[..., 0, :] = np.where(has_azimuth, slope * along - _UP, 0.0)
    by_directions[..., 1, :] = np.where(has_azimuth, slope * (to_base - 2 * reach * along) + reach * _UP, 0.0)
    return Gradient(-by_points[..., 0, :], by_directions, by_points)


def bearing_gradient(geometry: RayGeometry) -> Gradient:
    """Gradient of ``bearing``; not finite for coincident points and a ray straight down."""
    by_points, by_directions = _no_derivatives(geometry)
    one_ray, points = by_points.shape[-2] == 1, geometry.points_enu_m
    away = geometry.directions_enu[..., 0, :] if one_ray else points[..., 1, :] - points[..., 0, :]
    level = away * _LEVEL
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.stack([away[..., 1], -away[..., 0], np.zeros_like(away[..., 0])], axis=-1)
        turn = turn / _dot(level, level)[..., None]
    if one_ray:
        by_directions[..., 0, :] = turn
    else:
        by_points[..., 0, :], by_points[..., 1, :] = -turn, turn
    return Gradient(np.zeros_like(away), by_directions, by_points)


def paper_height(
    geometry: RayGeometry, heading_rad: FloatArray, elevation_m: FloatArray
) -> tuple[FloatArray, Gradient]:
    """Eq. 8 and its gradient; NaN unless both base and top are seen against the ground.

    Args:
        geometry: Base and top.
        heading_rad: ``(...)`` of the camera.
        elevation_m: ``(...)`` of the ground.
    """
    ahead = np.stack([np.sin(heading_rad), np.cos(heading_rad), np.zeros_like(heading_rad)], axis=-1)
    away = np.sum((geometry.points_enu_m - geometry.camera_enu_m[..., None, :]) * ahead[..., None, :], axis=-1)
    base, top = away[..., 0], away[..., 1]
    height = geometry.camera_enu_m[..., 2] - elevation_m
    by_points = np.zeros_like(geometry.points_enu_m)
    with np.errstate(divide="ignore", invalid="ignore"):  # a top straight below has no height
        by_points[..., 0, :] = (-height / top)[..., None] * ahead
        by_points[..., 1, :] = (height * base / top**2)[..., None] * ahead
        by_height = (1 - base / top)[..., None] * _UP
        by_camera = by_height - by_points.sum(axis=-2)
        by_points[..., 0, :] -= by_height
        value = np.asarray(object_height(height, base, top))
    return value, Gradient(by_camera, np.zeros_like(by_points), by_points)


def paper_bearing(geometry: RayGeometry) -> tuple[FloatArray, Gradient]:
    """Bearing by ground points: from the camera's foot, or from the first to the second; and its gradient."""
    if geometry.points_enu_m.shape[-2] > 1:
        return bearing(geometry), bearing_gradient(geometry)
    ray = RayGeometry(
        geometry.camera_enu_m, geometry.points_enu_m - geometry.camera_enu_m[..., None, :], geometry.points_enu_m
    )
    by = bearing_gradient(ray).by_directions
    return bearing(ray), Gradient(-by[..., 0, :], np.zeros_like(by), by)


def smooth_lines(pixels_px: FloatArray, std_px: FloatArray) -> FloatArray:
    """Lines ``(p, q, 2)`` smoothed by moving averages so wide that segments are longer than the pixels' noise.

    A window that removes more than noise of ``std_px (p,)``, as of a bend or a real zigzag, is halved; a line of which
    none removes less is kept as it is.
    """
    squares = np.sum(np.square(np.diff(pixels_px, axis=1)), axis=-1)
    step_px = np.sqrt(np.maximum(np.mean(squares, axis=-1) - 4 * std_px**2, std_px**2 / 4))
    half_window = np.floor(_MIN_SEGMENT_STDS * std_px / step_px + 0.5).astype(np.int64)
    lines, rough = pixels_px.copy(), np.flatnonzero(half_window)
    while len(rough):
        smooth, excess = _moving_average(pixels_px[rough], std_px[rough], half_window[rough])
        is_noise = excess <= 0
        lines[rough[is_noise]] = smooth[is_noise]
        half_window //= 2
        rough = rough[~is_noise & (half_window[rough] > 0)]
    return lines


def _moving_average(pixels_px: FloatArray, std_px: FloatArray, half_window: IntArray) -> tuple[FloatArray, FloatArray]:
    """Moving averages ``(p, q, 2)`` of lines; by how much ``(p,)`` the squares that they remove exceed noise, px^2."""
    vertex, last = np.arange(pixels_px.shape[1]), pixels_px.shape[1] - 1
    half = np.minimum(half_window[:, None], np.minimum(vertex, last - vertex))
    line, sums = np.arange(len(pixels_px))[:, None], np.pad(np.cumsum(pixels_px, axis=1), ((0, 0), (1, 0), (0, 0)))
    counts = 2 * half + 1
    smooth = (sums[line, vertex + half + 1] - sums[line, vertex - half]) / counts[..., None]
    noise = np.sum(np.square(pixels_px - smooth), axis=(1, 2))
    max_noise = 2 * std_px**2 * (np.sum(1 - 1 / counts, axis=1) + 2 * np.sqrt(last))
    return smooth, np.asarray(noise - max_noise)


def crosses_itself(points_enu_m: FloatArray) -> BoolArray:
    """Whether closed polygons ``(..., k, 3)`` cross or touch themselves on the map.

    A corner repeated in a row counts once. Sides that fold back on each other, and fewer than three corners, touch.
    """
    polygons = points_enu_m[..., :2].reshape(-1, *points_enu_m.shape[-2:-1], 2)
    crosses = np.zeros(len(polygons), dtype=np.bool_)
    is_new = np.any(polygons != np.roll(polygons, 1, axis=-2), axis=-1)
    for pattern in np.unique(is_new, axis=0):
        same_pattern = np.all(is_new == pattern, axis=-1)
        crosses[same_pattern] = _polygons_touch(polygons[same_pattern][:, pattern])
    return crosses.reshape(points_enu_m.shape[:-2])


def _polygons_touch(corners: FloatArray) -> BoolArray:
    """Whether polygons ``(n, k, 2)`` without repeated corners touch themselves."""
    count = corners.shape[1]
    if count < 3:  # noqa: PLR2004 - corners of a triangle
        return np.ones(len(corners), dtype=np.bool_)
    ends, tiny = np.roll(corners, -1, axis=1), (_COLLINEAR * np.max(np.ptp(corners, axis=1), axis=-1) ** 2)[:, None]
    onward = np.roll(ends, -1, axis=1)
    goes_back = np.sum((ends - corners) * (onward - ends), axis=-1) < 0
    back = (np.abs(_doubled_areas(corners, ends, onward)) <= tiny) & goes_back
    first, second = np.triu_indices(count, 2)
    not_adjacent = (first != 0) | (second != count - 1)  # the last side and the first are neighbours
    first, second = first[not_adjacent], second[not_adjacent]
    meet = _segments_intersect(corners[:, first], ends[:, first], corners[:, second], ends[:, second], tiny)
    return np.asarray(np.any(back, axis=-1) | np.any(meet, axis=-1))


def _segments_intersect(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, tiny: FloatArray) -> BoolArray:
    """Whether segments from ``a`` to ``b`` and from ``c`` to ``d``, ``(n, m, 2)`` each, intersect."""
    sides = [_signs(_doubled_areas(*three), tiny) for three in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]
    crossing = (sides[0] * sides[1] < 0) & (sides[2] * sides[3] < 0)
    touching = np.zeros(crossing.shape, dtype=np.bool_)
    for side, start, end, point in zip(sides, (a, a, c, c), (b, b, d, d), (c, d, a, b), strict=True):
        touching |= (side == 0) & np.all((np.minimum(start, end) <= point) & (point <= np.maximum(start, end)), axis=-1)
    return np.asarray(crossing | touching)


def _doubled_areas(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Doubled signed areas ``(...)`` of triangles."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def _signs(turns: FloatArray, tiny: FloatArray) -> FloatArray:
    return np.where(np.abs(turns) <= tiny, 0.0, np.sign(turns))


def _no_derivatives(geometry: RayGeometry) -> tuple[FloatArray, FloatArray]:
    """Zero derivatives by points and by directions."""
    return np.zeros(geometry.points_enu_m.shape), np.zeros(geometry.directions_enu.shape)


def _pair_widths(points: FloatArray) -> FloatArray:
    offset = points[..., 1::2, :2] - points[..., ::2, :2]
    return np.asarray(np.sqrt(offset[..., 0] * offset[..., 0] + offset[..., 1] * offset[..., 1]))


def _signed_area(points: FloatArray) -> FloatArray:
    x, y = points[..., 0] - points[..., :1, 0], points[..., 1] - points[..., :1, 1]  # far away, products lose digits
    return _ordered_sum(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1)) / 2


def _ordered_sum(values: FloatArray) -> FloatArray:
    """Sum over the last axis in fixed order: bit-identical in any batch."""
    total = np.zeros(values.shape[:-1])
    for column in range(values.shape[-1]):
        total = total + values[..., column]
    return total


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def _unit(vectors: FloatArray, default: FloatArray) -> FloatArray:
    length = np.sqrt(_dot(vectors, vectors))[..., None]
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), default)
