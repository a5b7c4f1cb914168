"""Intersection of rays with a level or tilted plane, and Jacobians of ground points for any ground.

A ray leaves the camera at ``c`` along ``d`` (of any length) and meets a surface with the normal ``n`` at
``p = c + s d``. To first order ``p`` moves along the surface only, by ``M = I - d n^T / (n . d)``: by ``s M`` with the
direction, by ``M`` with the camera, and by ``d n_up / (n . d)`` where the surface is raised.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from aerodft.model import CODE_OF, FloatArray, Status, read_only

_UP = read_only([0.0, 0.0, 1.0])
_NORM_TOL = 1e-9  # of a unit normal


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Tilted ground: all points ``p`` in ENU with ``normal_enu . p = offset_m``.

    Attributes:
        normal_enu: ``(3,)``, unit, pointing up.
        offset_m: Distance of the plane from the origin along the normal.
    """

    normal_enu: FloatArray
    offset_m: float

    def __post_init__(self) -> None:
        normal = read_only(self.normal_enu, trailing=(3,))
        if not (
            abs(float(np.linalg.norm(normal)) - 1.0) < _NORM_TOL and normal[2] > 0.0 and math.isfinite(self.offset_m)
        ):
            raise ValueError(f"got normal {normal} and offset {self.offset_m}, expected a unit normal that points up")
        object.__setattr__(self, "normal_enu", normal)

    @classmethod
    def sloping(cls, point_enu_m: npt.ArrayLike, slope_rad: float, uphill_azimuth_rad: float) -> "Plane":
        """The plane through ``point_enu_m (3,)`` that rises at ``slope_rad`` towards ``uphill_azimuth_rad``.

        Args:
            point_enu_m: Any point of the ground.
            slope_rad: Angle between the ground and the horizontal, below a right angle.
            uphill_azimuth_rad: Clockwise from north. An aspect, as maps of slopes have it, points the other way.

        Raises:
            ValueError: The slope is vertical or more.
        """
        back, up = -math.sin(slope_rad), math.cos(slope_rad)
        normal = np.array([back * math.sin(uphill_azimuth_rad), back * math.cos(uphill_azimuth_rad), up])
        return cls(normal, float(normal @ np.asarray(point_enu_m, dtype=np.float64)))

    def raised(self, by_m: float) -> "Plane":
        """The parallel plane that is ``by_m`` higher, along the vertical."""
        return Plane(self.normal_enu, self.offset_m + by_m * float(self.normal_enu[2]))

    @property
    def has_edges(self) -> bool:
        """False: nothing on a plane is occluded."""
        return False

    def meet(self, camera_enu_m: FloatArray, directions_enu: FloatArray, elevation_m: npt.ArrayLike) -> "GroundHits":
        """Intersect rays with the plane raised by ``elevation_m``; the horizon is the plane's own."""
        raised = self.offset_m + np.asarray(elevation_m, dtype=np.float64) * self.normal_enu[2]
        return _intersect_plane(camera_enu_m, directions_enu, self.normal_enu, raised)

    def height_at(self, east_north_m: FloatArray) -> FloatArray:
        """Height of the plane ``(...)`` at east and north ``(..., 2)``; known everywhere."""
        return np.asarray((self.offset_m - east_north_m @ self.normal_enu[:2]) / self.normal_enu[2])


@dataclass(frozen=True, slots=True, eq=False)
class GroundHits:
    """First intersections of rays with the ground.

    Attributes:
        points_enu_m: ``(..., 3)``; NaN where ``status`` is not ok.
        range_m: ``(...)`` slant range from the camera; NaN where ``status`` is not ok.
        normal_enu: ``(..., 3)`` unit normals of the ground, pointing up; NaN where ``status`` is not ok.
        status: ``(...)`` indices into ``model.status.CODES``.
        curvature_per_m: The ground at the horizontal distance ``r`` from the camera lies ``curvature_per_m r^2`` lower
            than ``points_enu_m`` says, because the earth curves away from the camera's horizontal plane.
    """

    points_enu_m: FloatArray
    range_m: FloatArray
    normal_enu: FloatArray
    status: npt.NDArray[np.uint8]
    curvature_per_m: float = 0.0


class Ground(Protocol):
    """Ground that is not level: a ``Plane``, or ``terrain.Terrain``."""

    @property
    def has_edges(self) -> bool:
        """Whether neighbouring rays may meet ground far apart (occlusion), which no derivative tells."""
        ...

    def meet(self, camera_enu_m: FloatArray, directions_enu: FloatArray, elevation_m: npt.ArrayLike) -> GroundHits:
        """Intersect rays with the surface ``elevation_m (...)`` above the ground; otherwise as ``meet_level``."""
        ...

    def height_at(self, east_north_m: FloatArray) -> FloatArray:
        """Height of the ground ``(...)`` at east and north ``(..., 2)``; NaN where it is unknown."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class GroundJacobians:
    """Jacobians of ``GroundHits.points_enu_m``; NaN where no ground is hit.

    Attributes:
        jac_direction: ``(..., 3, 3)`` by the components of the ray's direction, of its own length (m).
        jac_position: ``(..., 3, 3)`` by the camera's position in ENU.
        jac_elevation: ``(..., 3)`` by the height of the ground, all of it raised together.
    """

    jac_direction: FloatArray
    jac_position: FloatArray
    jac_elevation: FloatArray


def meet_level(camera_enu_m: FloatArray, directions_enu: FloatArray, elevation_m: npt.ArrayLike) -> GroundHits:
    """Intersect rays with horizontal planes.

    Args:
        camera_enu_m: Where the rays start, ``(..., 3)``.
        directions_enu: Their directions, ``(..., 3)``, of any length; NaN where there is no ray.
        elevation_m: Heights of the planes, ``(...)``. All three broadcast.

    Returns:
        The points, exactly at ``elevation_m``. ``BEYOND_LENS_MODEL`` without a ray, ``BELOW_SURFACE`` for a camera on
        or below the plane, ``ABOVE_HORIZON`` where the ray never reaches it.

    Raises:
        ValueError: A position or an elevation is not finite.
    """
    elevation = np.asarray(elevation_m, dtype=np.float64)
    hits = _intersect_plane(camera_enu_m, directions_enu, _UP, elevation)
    points = hits.points_enu_m
    points[..., 2] = np.where(np.isnan(points[..., 2]), np.nan, elevation)  # exactly, not within rounding
    return hits


def _intersect_plane(camera: FloatArray, directions: FloatArray, normal: FloatArray, offset: FloatArray) -> GroundHits:
    """Intersect rays with the planes ``normal . p = offset``; misses as in ``meet_level``."""
    camera = require_finite(camera, "camera position")
    directions = np.asarray(directions, dtype=np.float64)
    above = camera @ normal - require_finite(offset, "elevation")
    length = np.linalg.norm(directions, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        along = directions @ normal
        reach = np.asarray(-above / along)
        points = camera + reach[..., None] * directions
        range_m = reach * length
        # A ray that is parallel to the plane within rounding has no finite range.
        misses = [~(length > 0), above <= 0, (along >= 0) | ~np.isfinite(range_m)]
    codes = [CODE_OF[each] for each in (Status.BEYOND_LENS_MODEL, Status.BELOW_SURFACE, Status.ABOVE_HORIZON)]
    status = np.select(np.broadcast_arrays(*misses), codes, CODE_OF[Status.OK]).astype(np.uint8)
    hit = status == CODE_OF[Status.OK]
    return GroundHits(
        np.where(hit[..., None], points, np.nan),
        np.where(hit, range_m, np.nan),
        np.where(hit[..., None], normal, np.nan),
        status,
    )


def require_finite(values: npt.ArrayLike, what: str) -> FloatArray:
    """Values as float64, checked to be finite.

    Raises:
        ValueError: One of them, ``what``, is not finite.
    """
    array = np.asarray(values, dtype=np.float64)
    if not np.all(np.isfinite(array)):
        raise ValueError(f"got a {what} of {array[~np.isfinite(array)][0]}, expected a finite one")
    return array


def jacobians(camera_enu_m: FloatArray, directions_enu: FloatArray, hits: GroundHits) -> GroundJacobians:
    """Jacobians of ground points found by ``meet_level`` or by a ``Ground``.

    On terrain they hold for the patch that is hit, and not across an occluding edge.

    Args:
        camera_enu_m: ``(..., 3)`` as for the intersection.
        directions_enu: ``(..., 3)`` as for the intersection.
        hits: The ground points found.
    """
    camera, directions = np.asarray(camera_enu_m, dtype=np.float64), np.asarray(directions_enu, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        reach = hits.range_m / np.linalg.norm(directions, axis=-1)
        ground = hits.normal_enu / hits.normal_enu[..., 2:]  # upward component 1: raising it by 1 m moves it by 1
        normal_seen = ground.copy()  # in the camera's uncurved axes ground falls away with distance
        normal_seen[..., :2] += 2 * hits.curvature_per_m * (hits.points_enu_m - camera)[..., :2]
        along = np.sum(normal_seen * directions, axis=-1)
        jac_elevation = np.asarray(directions / along[..., None])
        jac_position = np.eye(3) - jac_elevation[..., :, None] * ground[..., None, :]
        jac_direction = reach[..., None, None] * (np.eye(3) - jac_elevation[..., :, None] * normal_seen[..., None, :])
    if hits.curvature_per_m:
        for jac in (jac_position, jac_direction):
            jac[..., 2, :] = -np.einsum("...i,...ij->...j", ground[..., :2], jac[..., :2, :])
        jac_elevation[..., 2] = 1.0 - np.sum(ground[..., :2] * jac_elevation[..., :2], axis=-1)
    return GroundJacobians(jac_direction, jac_position, jac_elevation)
