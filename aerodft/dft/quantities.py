"""What a probe's points amount to: one scalar, and how it depends on them. Batch-first: leading axes are samples.

Ray geometry is a camera position, and for each pixel a ray direction and the point where it meets the measured plane.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.equations import object_height
from aerodft.model import BoolArray, FloatArray, read_only

_ROUNDING: Final = 1e-10
"""Of the square of a polygon's size: a corner that is nearer to a side than this share of the size lies on it."""
_UP, _DOWN = read_only([0.0, 0.0, 1.0]), read_only([0.0, 0.0, -1.0])
_EAST, _LEVEL = read_only([1.0, 0.0, 0.0]), read_only([1.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class RayGeometry:
    """What is seen of one probe.

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
    """Derivatives of a scalar, the others held.

    By the camera ``(..., 3)``, directions ``(..., k, 3)`` and points ``(..., k, 3)``.
    """

    by_camera: FloatArray
    by_directions: FloatArray
    by_points: FloatArray


def slant_range(geometry: RayGeometry) -> FloatArray:
    """Distance ``(...)`` from the camera to the first point, m."""
    away = geometry.points_enu_m[..., 0, :] - geometry.camera_enu_m
    return np.asarray(np.sqrt(_dot(away, away)))


def ground_distance(geometry: RayGeometry) -> FloatArray:
    """Horizontal distance ``(...)`` of the first two points, m."""
    apart = geometry.points_enu_m[..., 1, :2] - geometry.points_enu_m[..., 0, :2]
    return np.asarray(np.sqrt(apart[..., 0] * apart[..., 0] + apart[..., 1] * apart[..., 1]))


def polyline_length(geometry: RayGeometry) -> FloatArray:
    """Horizontal length ``(...)`` of the open line through all points, m."""
    steps = np.diff(geometry.points_enu_m[..., :2], axis=-2)
    return _total(np.sqrt(steps[..., 0] * steps[..., 0] + steps[..., 1] * steps[..., 1]))


def median_width(geometry: RayGeometry) -> FloatArray:
    """Median ``(...)`` of the horizontal distances of the first and second point, the third and fourth, ..., m."""
    return np.asarray(np.median(_pair_widths(geometry.points_enu_m), axis=-1))


def polygon_area(geometry: RayGeometry) -> FloatArray:
    """Horizontal area ``(...)`` of the closed polygon of all points, m^2, whichever way round (shoelace formula)."""
    return np.abs(_signed_area(geometry.points_enu_m))


def upright_height(geometry: RayGeometry) -> FloatArray:
    """Height ``(...)`` of an upright object whose base is the first pixel and whose top the second, m.

    The point of the vertical through the base that is closest to the top's ray, above the base; NaN where the ray
    leads away from it, or straight down. Only the ray's
    horizontal direction decides where it passes the vertical, so that neither heading nor image column matter.
    """
    base, ray = geometry.points_enu_m[..., 0, :], geometry.directions_enu[..., 1, :]
    along = ray[..., :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = _total((base - geometry.camera_enu_m)[..., :2] * along) / _total(along * along)
    top = geometry.camera_enu_m[..., 2] + reach * ray[..., 2]
    return np.asarray(np.where(reach > 0, top - base[..., 2], np.nan))


def bearing(geometry: RayGeometry) -> FloatArray:
    """Azimuth ``(...)`` from the first to the second point, or of one pixel's ray: clockwise from north, [0, 2 pi)."""
    points, directions = geometry.points_enu_m, geometry.directions_enu
    away = directions[..., 0, :] if points.shape[-2] == 1 else points[..., 1, :] - points[..., 0, :]
    return np.asarray(np.arctan2(away[..., 0], away[..., 1]) % (2 * np.pi))


def lateral_offset(geometry: RayGeometry) -> tuple[FloatArray, Gradient]:
    """How far to the side of the vertical through the base the top's ray passes, m on the map, and its derivatives.

    0 for an object that is upright, and for one that is seen from straight above.
    """
    base, ray = geometry.points_enu_m[..., 0, :], geometry.directions_enu[..., 1, :]
    to_base, along = (base - geometry.camera_enu_m) * _LEVEL, ray * _LEVEL
    square = _dot(along, along)
    seen = square > 0
    square = np.where(seen, square, 1.0)
    length = np.sqrt(square)
    off = np.where(seen, to_base[..., 0] * along[..., 1] - to_base[..., 1] * along[..., 0], 0.0) / length
    by_points, by_directions = np.zeros_like(geometry.points_enu_m), np.zeros_like(geometry.directions_enu)
    by_points[..., 0, 0], by_points[..., 0, 1] = along[..., 1] / length, -along[..., 0] / length
    across = np.stack([-to_base[..., 1], to_base[..., 0], np.zeros_like(off)], axis=-1)
    turn = across / length[..., None] - (off / square)[..., None] * along
    by_directions[..., 1, :] = np.where(seen[..., None], turn, 0.0)
    return off, Gradient(-by_points[..., 0, :], by_directions, by_points)


def range_gradient(geometry: RayGeometry) -> Gradient:
    """Derivatives of ``slant_range``; of a camera in the point itself, those straight down."""
    by_points, by_directions = _no_derivatives(geometry)
    by_points[..., 0, :] = _unit(geometry.points_enu_m[..., 0, :] - geometry.camera_enu_m, _DOWN)
    return Gradient(-by_points[..., 0, :], by_directions, by_points)


def length_gradient(geometry: RayGeometry) -> Gradient:
    """Derivatives of ``polyline_length``, and of ``ground_distance``.

    Two points in one have no direction; the one away from the camera, in which points are known worst, stands in.
    """
    points, (by_points, by_directions) = geometry.points_enu_m, _no_derivatives(geometry)
    away = _unit((points[..., 0, :] - geometry.camera_enu_m) * _LEVEL, _EAST)
    units = _unit(np.diff(points, axis=-2) * _LEVEL, away[..., None, :])
    by_points[..., 1:, :] += units
    by_points[..., :-1, :] -= units
    return Gradient(np.zeros_like(away), by_directions, by_points)


def median_gradient(geometry: RayGeometry) -> Gradient:
    """Derivatives of ``median_width``: those of the pair in the middle, or of the mean of the two.

    The others do nothing as long as their order stays. Two points in one as in ``length_gradient``.
    """
    points, (by_points, by_directions) = geometry.points_enu_m, _no_derivatives(geometry)
    order = np.argsort(_pair_widths(points), axis=-1, kind="stable")
    count = order.shape[-1]
    share = np.zeros(order.shape)
    for row in {(count - 1) // 2, count // 2}:
        middle = order[..., row : row + 1]
        np.put_along_axis(share, middle, np.take_along_axis(share, middle, axis=-1) + (1.0 if count % 2 else 0.5), -1)
    away = _unit((points[..., 0, :] - geometry.camera_enu_m) * _LEVEL, _EAST)
    units = _unit((points[..., 1::2, :] - points[..., ::2, :]) * _LEVEL, away[..., None, :]) * share[..., None]
    by_points[..., 1::2, :], by_points[..., ::2, :] = units, -units
    return Gradient(np.zeros_like(away), by_directions, by_points)


def area_gradient(geometry: RayGeometry) -> Gradient:
    """Derivatives of ``polygon_area``."""
    points, (by_points, by_directions) = geometry.points_enu_m, _no_derivatives(geometry)
    before, after = np.roll(points, 1, axis=-2), np.roll(points, -1, axis=-2)
    by_points[..., 0] = (after[..., 1] - before[..., 1]) / 2
    by_points[..., 1] = (before[..., 0] - after[..., 0]) / 2
    by_points *= np.sign(_signed_area(points))[..., None, None]
    return Gradient(np.zeros_like(points[..., 0, :]), by_directions, by_points)


def height_gradient(geometry: RayGeometry) -> Gradient:
    """Derivatives of ``upright_height``; none where it is seen from straight above."""
    base, ray = geometry.points_enu_m[..., 0, :], geometry.directions_enu[..., 1, :]
    by_points, by_directions = _no_derivatives(geometry)
    along, to_base = ray * _LEVEL, (base - geometry.camera_enu_m) * _LEVEL
    square = _dot(along, along)
    seen = (square > 0)[..., None]  # from straight above there is no height, and nothing that it depends on
    square = np.where(square > 0, square, 1.0)
    slope, reach = (ray[..., 2] / square)[..., None], (_dot(to_base, along) / square)[..., None]
    by_points[..., 0, :] = np.where(seen, slope * along - _UP, 0.0)
    by_directions[..., 1, :] = np.where(seen, slope * (to_base - 2 * reach * along) + reach * _UP, 0.0)
    return Gradient(-by_points[..., 0, :], by_directions, by_points)


def bearing_gradient(geometry: RayGeometry) -> Gradient:
    """Derivatives of ``bearing``; two points in one, and a ray straight down, have no direction."""
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
    """Eq. 8 and its derivatives; NaN unless base and top are both seen against the ground.

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
    """Of the ground point from the camera's foot, or of the second from the first, and derivatives."""
    if geometry.points_enu_m.shape[-2] > 1:
        return bearing(geometry), bearing_gradient(geometry)
    ray = RayGeometry(
        geometry.camera_enu_m, geometry.points_enu_m - geometry.camera_enu_m[..., None, :], geometry.points_enu_m
    )
    by = bearing_gradient(ray).by_directions
    return bearing(ray), Gradient(-by[..., 0, :], np.zeros_like(by), by)


def crosses_itself(points_enu_m: FloatArray) -> BoolArray:
    """Whether closed polygons ``(..., k, 3)`` cross or touch themselves, on the map: their area would be another.

    Corners that are named twice in a row count once. Sides that go back on each other, and fewer than three corners,
    touch as well.
    """
    polygons = points_enu_m[..., :2].reshape(-1, *points_enu_m.shape[-2:-1], 2)
    found = np.zeros(len(polygons), dtype=np.bool_)
    is_new = np.any(polygons != np.roll(polygons, 1, axis=-2), axis=-1)
    for pattern in np.unique(is_new, axis=0):
        alike = np.all(is_new == pattern, axis=-1)
        found[alike] = _touch(polygons[alike][:, pattern])
    return found.reshape(points_enu_m.shape[:-2])


def _touch(corners: FloatArray) -> BoolArray:
    """Whether polygons ``(n, k, 2)`` whose corners all differ from the next one touch themselves."""
    count = corners.shape[1]
    if count < 3:  # noqa: PLR2004 - corners of a triangle
        return np.ones(len(corners), dtype=np.bool_)
    ends, tiny = np.roll(corners, -1, axis=1), (_ROUNDING * np.max(np.ptp(corners, axis=1), axis=-1) ** 2)[:, None]
    onward = np.roll(ends, -1, axis=1)
    goes_back = np.sum((ends - corners) * (onward - ends), axis=-1) < 0
    back = (np.abs(_turns(corners, ends, onward)) <= tiny) & goes_back
    first, second = np.triu_indices(count, 2)
    apart = (first != 0) | (second != count - 1)  # the last side and the first are neighbours
    first, second = first[apart], second[apart]
    meet = _meet(corners[:, first], ends[:, first], corners[:, second], ends[:, second], tiny)
    return np.asarray(np.any(back, axis=-1) | np.any(meet, axis=-1))


def _meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, tiny: FloatArray) -> BoolArray:
    """Whether segments from ``a`` to ``b`` and from ``c`` to ``d``, ``(n, m, 2)`` each, have a point in common."""
    sides = [_signs(_turns(*three), tiny) for three in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]
    crossing = (sides[0] * sides[1] < 0) & (sides[2] * sides[3] < 0)
    touching = np.zeros(crossing.shape, dtype=np.bool_)
    for side, start, end, point in zip(sides, (a, a, c, c), (b, b, d, d), (c, d, a, b), strict=True):
        touching |= (side == 0) & np.all((np.minimum(start, end) <= point) & (point <= np.maximum(start, end)), axis=-1)
    return np.asarray(crossing | touching)


def _turns(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Twice the signed areas ``(...)`` of triangles."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def _signs(turns: FloatArray, tiny: FloatArray) -> FloatArray:
    return np.where(np.abs(turns) <= tiny, 0.0, np.sign(turns))


def _no_derivatives(geometry: RayGeometry) -> tuple[FloatArray, FloatArray]:
    """Zeros by the points and by the directions."""
    return np.zeros(geometry.points_enu_m.shape), np.zeros(geometry.directions_enu.shape)


def _pair_widths(points: FloatArray) -> FloatArray:
    apart = points[..., 1::2, :2] - points[..., ::2, :2]
    return np.asarray(np.sqrt(apart[..., 0] * apart[..., 0] + apart[..., 1] * apart[..., 1]))


def _signed_area(points: FloatArray) -> FloatArray:
    x, y = points[..., 0] - points[..., :1, 0], points[..., 1] - points[..., :1, 1]  # far away, products lose digits
    return _total(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1)) / 2


def _total(values: FloatArray) -> FloatArray:
    """Sum over the last axis, one after the other: the same to the last bit for any batch."""
    total = np.zeros(values.shape[:-1])
    for column in range(values.shape[-1]):
        total = total + values[..., column]
    return total


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def _unit(vectors: FloatArray, otherwise: FloatArray) -> FloatArray:
    length = np.sqrt(_dot(vectors, vectors))[..., None]
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), otherwise)
