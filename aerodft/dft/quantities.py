"""What a probe's points amount to: one scalar, and how it depends on them. Batch-first: leading axes are samples.

A sight is a camera position, and for each pixel a ray direction and the point where it meets the measured plane.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerodft.model.arrays import FloatArray
from aerodft.model.probe import ProbeKind


@dataclass(frozen=True, slots=True)
class Sight:
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
    """Derivatives of a scalar, the others held: by the camera ``(3,)``, directions ``(k, 3)`` and points ``(k, 3)``."""

    by_camera: FloatArray
    by_directions: FloatArray
    by_points: FloatArray


def slant_range(sight: Sight) -> FloatArray:
    """Distance ``(...)`` from the camera to the first point, m."""
    return np.asarray(np.linalg.norm(sight.points_enu_m[..., 0, :] - sight.camera_enu_m, axis=-1))


def ground_distance(sight: Sight) -> FloatArray:
    """Horizontal distance ``(...)`` of the first two points, m."""
    apart = sight.points_enu_m[..., 1, :2] - sight.points_enu_m[..., 0, :2]
    return np.asarray(np.linalg.norm(apart, axis=-1))


def polyline_length(sight: Sight) -> FloatArray:
    """Horizontal length ``(...)`` of the open line through all points, m."""
    steps = np.diff(sight.points_enu_m[..., :2], axis=-2)
    return np.asarray(np.linalg.norm(steps, axis=-1).sum(axis=-1))


def polygon_area(sight: Sight) -> FloatArray:
    """Horizontal area ``(...)`` of the closed polygon of all points, m^2, whichever way round (shoelace formula)."""
    return np.abs(_signed_area(sight.points_enu_m))


def upright_height(sight: Sight) -> FloatArray:
    """Height ``(...)`` of an upright object whose base is the first pixel and whose top the second, m.

    The point of the vertical through the base that is closest to the top's ray, above the base; NaN where the ray
    leads away from it, or straight down. Only the ray's
    horizontal direction decides where it passes the vertical, so that neither heading nor image column matter.
    """
    base, ray = sight.points_enu_m[..., 0, :], sight.directions_enu[..., 1, :]
    along = ray[..., :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.sum((base - sight.camera_enu_m)[..., :2] * along, axis=-1) / np.sum(along * along, axis=-1)
    top = sight.camera_enu_m[..., 2] + reach * ray[..., 2]
    return np.asarray(np.where(reach > 0, top - base[..., 2], np.nan))


def bearing(sight: Sight) -> FloatArray:
    """Azimuth ``(...)`` from the first to the second point, or of one pixel's ray: clockwise from north, [0, 2 pi)."""
    points, directions = sight.points_enu_m, sight.directions_enu
    away = directions[..., 0, :] if points.shape[-2] == 1 else points[..., 1, :] - points[..., 0, :]
    return np.asarray(np.arctan2(away[..., 0], away[..., 1]) % (2 * np.pi))


def beside(sight: Sight) -> tuple[float, Gradient]:
    """How far to the side of the vertical through the base the top's ray passes, m on the map, and its derivatives.

    One sight (no leading axes); 0 for an object that is upright.
    """
    base, ray = sight.points_enu_m[0], sight.directions_enu[1]
    to_base, along = (base - sight.camera_enu_m) * [1, 1, 0], ray * [1, 1, 0]
    length = float(np.linalg.norm(along))
    by_points, by_directions = np.zeros_like(sight.points_enu_m), np.zeros_like(sight.directions_enu)
    if length == 0:
        return 0.0, Gradient(np.zeros(3), by_directions, by_points)
    off = float(to_base[0] * along[1] - to_base[1] * along[0]) / length
    by_points[0] = np.array([along[1], -along[0], 0.0]) / length
    by_directions[1] = np.array([-to_base[1], to_base[0], 0.0]) / length - off * along / length**2
    return off, Gradient(-by_points[0], by_directions, by_points)


SCALARS: dict[ProbeKind, Callable[[Sight], FloatArray]] = {
    ProbeKind.RANGE: slant_range,
    ProbeKind.DISTANCE: ground_distance,
    ProbeKind.WIDTH: ground_distance,
    ProbeKind.LENGTH: polyline_length,
    ProbeKind.AREA: polygon_area,
    ProbeKind.HEIGHT: upright_height,
    ProbeKind.BEARING: bearing,
}
"""The scalar of each kind; a ``position`` has none."""


def gradient(kind: ProbeKind, sight: Sight) -> Gradient:
    """Analytic derivatives of one sight's (no leading axes) scalar.

    Two points in one have no direction; the one away from the camera, in which points are known worst, stands in.
    """
    points = sight.points_enu_m
    none = np.zeros_like(points)
    if kind is ProbeKind.RANGE:
        unit = _unit(points[0] - sight.camera_enu_m, np.array([0.0, 0.0, -1.0]))
        by_points = none.copy()
        by_points[0] = unit
        return Gradient(-unit, none, by_points)
    if kind is ProbeKind.HEIGHT:
        return _height_gradient(sight)
    if kind is ProbeKind.BEARING:
        return _bearing_gradient(sight)
    by_points = _area_gradient(points) if kind is ProbeKind.AREA else _length_gradient(sight)
    return Gradient(np.zeros(3), none, by_points)


def _length_gradient(sight: Sight) -> FloatArray:
    points = sight.points_enu_m
    away = _unit((points[0] - sight.camera_enu_m) * [1, 1, 0], np.array([1.0, 0.0, 0.0]))
    steps = np.diff(points, axis=0) * [1, 1, 0]
    units = np.array([_unit(step, away) for step in steps])
    by_points = np.zeros_like(points)
    by_points[1:] += units
    by_points[:-1] -= units
    return by_points


def _area_gradient(points: FloatArray) -> FloatArray:
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    by_points = np.zeros_like(points)
    by_points[:, 0] = (after[:, 1] - before[:, 1]) / 2
    by_points[:, 1] = (before[:, 0] - after[:, 0]) / 2
    return by_points * np.sign(_signed_area(points))


def _height_gradient(sight: Sight) -> Gradient:
    base, ray = sight.points_enu_m[0], sight.directions_enu[1]
    along, to_base = ray * [1, 1, 0], (base - sight.camera_enu_m) * [1, 1, 0]
    square = along @ along
    if square == 0:  # seen from straight above there is no height, and nothing that it depends on
        return Gradient(np.zeros(3), np.zeros_like(sight.directions_enu), np.zeros_like(sight.points_enu_m))
    reach = float(to_base @ along) / square
    by_points, by_directions = np.zeros_like(sight.points_enu_m), np.zeros_like(sight.directions_enu)
    by_points[0] = ray[2] * along / square - [0, 0, 1]
    by_directions[1] = ray[2] * (to_base - 2 * reach * along) / square + [0, 0, reach]
    return Gradient(np.array([0, 0, 1]) - ray[2] * along / square, by_directions, by_points)


def _bearing_gradient(sight: Sight) -> Gradient:
    by_points, by_directions = np.zeros_like(sight.points_enu_m), np.zeros_like(sight.directions_enu)
    one_ray = len(by_points) == 1
    east, north, _ = sight.directions_enu[0] if one_ray else sight.points_enu_m[1] - sight.points_enu_m[0]
    with np.errstate(divide="ignore", invalid="ignore"):  # two points in one, and straight down, have no direction
        turn = np.array([north, -east, 0.0]) / (east * east + north * north)
    if one_ray:
        by_directions[0] = turn
    else:
        by_points[0], by_points[1] = -turn, turn
    return Gradient(np.zeros(3), by_directions, by_points)


def _signed_area(points: FloatArray) -> FloatArray:
    x, y = points[..., 0], points[..., 1]
    return np.asarray(np.sum(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1), axis=-1) / 2)


def _unit(vector: FloatArray, otherwise: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0 else otherwise
