"""Projection of pixels to ground points under both models, with Jacobians.

Columns of ``jac_shared``, by errors that all points of an image share::

    0:3  camera position, ENU (m)          7:9   focal lengths fx, fy (px)
    3:6  small rotation, camera axes (rad) 9:11  principal point (px)
    6    elevation of the ground (m)       11:   distortion coefficients, where they are uncertain
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft import equations
from aerodft.geometry import (
    PINHOLE_PARAMETERS,
    Ground,
    camera_angles,
    from_rotation_vector,
    intrinsics_covariance,
    jacobians,
    lat_lon,
    matrix,
    multiply,
    rays_by_intrinsics,
    rays_with_jacobian,
    rotate,
    skew,
)
from aerodft.model import CODE_OF, Camera, FloatArray, GeoOrigin, IntArray, Pose, PoseBatch, ProjectionModel, Status


def to_ground_frame(pose: Pose, points_enu_m: FloatArray) -> FloatArray:
    """ENU points ``(..., 3)`` in the camera's ground frame: X right, Y ahead, Z up, origin at its foot.

    Poses ``(n,)`` take points ``(n, k, 3)``.
    """
    _, _, heading = camera_angles(pose.wxyz)
    foot = pose.position_enu_m[..., :2]
    if heading.ndim:
        heading, foot = heading[..., None], foot[..., None, :]
    sin, cos = np.sin(heading), np.cos(heading)
    east, north = points_enu_m[..., 0] - foot[..., 0], points_enu_m[..., 1] - foot[..., 1]
    return np.stack([east * cos - north * sin, east * sin + north * cos, points_enu_m[..., 2]], axis=-1)


def ground_frame_pose(pose: Pose) -> Pose:
    """One pose in its own ground frame: above the origin, heading 0."""
    _, _, heading = camera_angles(pose.wxyz)
    rotation = from_rotation_vector(np.array([0.0, 0.0, heading]))
    axes = matrix(rotation)
    enu_from_axes = np.eye(6)
    enu_from_axes[:3, :3] = axes
    return replace(
        pose,
        position_enu_m=pose.position_enu_m * [0.0, 0.0, 1.0],
        wxyz=multiply(rotation, pose.wxyz),
        cov=enu_from_axes @ pose.cov @ enu_from_axes.T,
        lens_cov=enu_from_axes @ pose.lens_cov,
        velocity_enu_mps=axes @ pose.velocity_enu_mps,
    )


def lat_lon_alt(origin: GeoOrigin, points_enu_m: FloatArray) -> FloatArray:
    """Latitude, longitude (rad) and altitude (m MSL) ``(..., 3)`` of ENU points; NaN where the origin's is unknown."""
    plane = np.nan if origin.alt_msl_m is None else origin.alt_msl_m
    lat_lon_rad = lat_lon(origin, points_enu_m[..., :2])
    return np.concatenate([lat_lon_rad, (plane + points_enu_m[..., 2])[..., None]], axis=-1)


def position_columns(poses: PoseBatch, groups: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
    """Position numbers of a ``MeasurementColumn`` for each group of points: ground frame, ENU, WGS84, range.

    Reported ups and altitudes count from the station's elevation 0, those of the groups from the measured plane.

    Args:
        poses: The ``(n,)`` poses of the points' images.
        groups: ENU points ``(n, g, q, 3)``.
    """
    count = len(poses)
    enu_m = np.concatenate([each.reshape(count, -1, 3) for each in groups], axis=1)
    sight = enu_m - poses.pose.position_enu_m[:, None]
    station_m = enu_m.copy()
    station_m[..., 2] += poses.plane_elevation_m[:, None]
    numbers = {"ground_m": to_ground_frame(poses.pose, enu_m), "enu_m": station_m}
    origins = [variant.origin for variant in poses.variants]
    if any(origin is not None for origin in origins):
        numbers["geo"] = _lat_lon_alt_columns(poses, origins, station_m)
    numbers["range_m"] = np.sqrt(sight[..., 0] ** 2 + sight[..., 1] ** 2 + sight[..., 2] ** 2)
    ends = np.cumsum([each.shape[1] * each.shape[2] for each in groups])[:-1]
    split = {name: np.split(values, ends, axis=1) for name, values in numbers.items()}
    return [
        {name: own[index].reshape(*each.shape[:3], *own[index].shape[2:]) for name, own in split.items()}
        for index, each in enumerate(groups)
    ]


def _lat_lon_alt_columns(poses: PoseBatch, origins: Sequence[GeoOrigin | None], enu_m: FloatArray) -> FloatArray:
    """WGS84 columns ``(n, k, 3)`` as in ``lat_lon_alt``; NaN where an image's ENU origin is unknown."""
    variants_by_origin: dict[GeoOrigin, list[int]] = {}
    for index, origin in enumerate(origins):
        if origin is not None:
            variants_by_origin.setdefault(origin, []).append(index)
    lat_lon_alts = np.full(enu_m.shape, np.nan)
    for origin, variants in variants_by_origin.items():
        rows = np.isin(poses.variant_index, variants)
        lat_lon_alts[rows] = lat_lon_alt(origin, enu_m[rows])
    return lat_lon_alts


POSITION, ROTATION, ELEVATION = slice(0, 3), slice(3, 6), 6
INTRINSICS = slice(7, None)
FOCAL, PRINCIPAL_POINT, DISTORTION = slice(7, 9), slice(9, 11), slice(11, None)

_MIN_DEPRESSION_RAD = 1e-9  # rays closer to the horizontal never reach the ground

Codes = npt.NDArray[np.uint8]
Rows = int | slice | tuple[int | slice | IntArray, ...]


def shared_count(camera: Camera) -> int:
    """Number of errors that all points of an image share."""
    return INTRINSICS.start + len(intrinsics_covariance(camera))


@dataclass(frozen=True, slots=True)
class GroundPoints:
    """Ground points of pixels with their Jacobians.

    Attributes:
        points_enu_m: ``(..., 3)``; NaN where ``status`` is not ok.
        jac_shared: ``(..., 3, s)``, see the module.
        jac_px: ``(..., 3, 2)`` by the point's own pixel.
        status: ``(...)`` indices into ``CODES``.
        depression_rad: ``(...)`` angle of the ray below the horizon; negative above it.
    """

    points_enu_m: FloatArray
    jac_shared: FloatArray
    jac_px: FloatArray
    status: Codes
    depression_rad: FloatArray

    def take(self, columns: IntArray) -> "GroundPoints":
        """Points ``(n, *columns.shape)`` of ``(n, k)`` by their columns; a view where these are consecutive."""
        indices = columns.ravel()
        if np.array_equal(indices, np.arange(indices[0], indices[0] + len(indices))):
            selected = self[:, indices[0] : indices[0] + len(indices)]
        else:
            selected = self[:, indices]
        parts = (getattr(selected, each.name) for each in fields(selected))
        return GroundPoints(*(part.reshape(len(part), *columns.shape, *part.shape[2:]) for part in parts))

    def __getitem__(self, rows: Rows | None) -> "GroundPoints":
        return GroundPoints(
            self.points_enu_m[rows],
            self.jac_shared[rows],
            self.jac_px[rows],
            self.status[rows],
            self.depression_rad[rows],
        )


@dataclass(frozen=True, slots=True)
class _GroundContact:
    """Ground points of rays and their Jacobians, as ``ground.GroundHits`` and ``GroundJacobians``."""

    points_enu_m: FloatArray
    jac_direction: FloatArray
    jac_position: FloatArray
    jac_elevation: FloatArray
    status: Codes


@dataclass(frozen=True, slots=True)
class PixelRays:
    """Rays of pixels in camera axes with their Jacobians.

    Attributes:
        rays_cam: ``(..., 3)``, see ``lens.Rays``.
        jac_px: ``(..., 3, 2)``.
        jac_intrinsics: ``(..., 3, m)``.
    """

    rays_cam: FloatArray
    jac_px: FloatArray
    jac_intrinsics: FloatArray


@dataclass(frozen=True, slots=True)
class Directions:
    """Ray directions in ENU ``(..., 3)`` with Jacobians by the shared errors and by the pixels."""

    directions_enu: FloatArray
    jac_shared: FloatArray
    jac_px: FloatArray


def project(
    camera: Camera,
    pose: Pose,
    pixels_px: npt.ArrayLike,
    elevation_m: npt.ArrayLike,
    model: ProjectionModel,
    ground: Ground | None = None,
    magnification: FloatArray | None = None,
) -> GroundPoints:
    """Intersect the rays of pixels with the surface ``elevation_m`` above the ground.

    Args:
        camera: The camera.
        pose: One pose, or ``(n,)``. Its position's third component is the height above the elevation 0.
        pixels_px: ``(..., 2)`` of one pose; ``(k, 2)`` or ``(n, k, 2)`` of ``(n,)``. Outside the image:
            ``OUT_OF_IMAGE``.
        elevation_m: Height of the measured surface, ``(...)``, ``(k,)`` or ``(n, k)``.
        model: ``pinhole``, or the paper's ``dft``, which is for level ground only.
        ground: Ground below the elevation; None for the level plane at 0.
        magnification: ``(n,)`` focal lengths of the images over the camera's; None for 1.

    Returns:
        The points, in ENU, with Jacobians, ``(...)`` or ``(n, k)``; misses are NaN with a status.
    """
    pixels = np.asarray(pixels_px, dtype=np.float64)
    shape = pixels.shape[:-1] if pose.wxyz.ndim == 1 else (len(pose.wxyz), pixels.shape[-2])
    elevation = np.broadcast_to(np.asarray(elevation_m, dtype=np.float64), shape)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        if model is ProjectionModel.PINHOLE:
            projected = _pinhole(pixel_rays(camera, pixels, magnification), pose, elevation, ground)
        else:
            projected = _dft(camera, pose, pixels, elevation, magnification)
    size = np.array([camera.width_px, camera.height_px])
    inside = np.all((pixels >= -PIXEL_CENTRE_OFFSET_PX) & (pixels <= size - PIXEL_CENTRE_OFFSET_PX), axis=-1)
    status = np.where(inside, projected.status, CODE_OF[Status.OUT_OF_IMAGE]).astype(np.uint8)
    points = np.where((status == CODE_OF[Status.OK])[..., None], projected.points_enu_m, np.nan)
    return GroundPoints(points, projected.jac_shared, projected.jac_px, status, projected.depression_rad)


def pixel_rays(camera: Camera, pixels_px: FloatArray, magnification: FloatArray | None = None) -> PixelRays:
    """Rays of ``pixels_px (..., 2)``; ``(k, 2)`` or ``(n, k, 2)`` with the magnifications ``(n,)`` of images."""
    if magnification is None:
        rays = rays_with_jacobian(camera, pixels_px)
        return PixelRays(rays.rays_cam, rays.jac_px, rays_by_intrinsics(camera, pixels_px))
    # A pixel of a zoomed image has the ray of the pixel nearer to the principal point in an unzoomed one.
    centre, scale = np.array([camera.cx_px, camera.cy_px]), magnification[:, None, None]
    unzoomed_px = np.where(scale == 1.0, pixels_px, centre + (pixels_px - centre) / scale)
    rays, jac_intrinsics = rays_with_jacobian(camera, unzoomed_px), rays_by_intrinsics(camera, unzoomed_px).copy()
    jac_intrinsics[..., :PINHOLE_PARAMETERS] /= scale[..., None]
    return PixelRays(rays.rays_cam, rays.jac_px / scale[..., None], jac_intrinsics)


def scale_changes(
    camera: Camera, pixels_px: FloatArray, magnification: FloatArray | None, rays: PixelRays
) -> FloatArray:
    """Share ``(k,)`` or ``(n, k)`` by which one std of the distortion's errors changes the lens's scale at pixels.

    Rays are linear over these errors where it is small. NaN where a lens with such an error has no ray.

    Args:
        camera: The camera.
        pixels_px: ``(k, 2)`` or ``(n, k, 2)``.
        magnification: ``(n,)`` of the images, as for ``pixel_rays``.
        rays: The pixels' rays.
    """
    squares = np.zeros(rays.rays_cam.shape[:-1])
    variances, axes = np.linalg.eigh(intrinsics_covariance(camera)[PINHOLE_PARAMETERS:, PINHOLE_PARAMETERS:])
    for error in (axes * np.sqrt(np.maximum(variances, 0.0))).T:
        changed = replace(camera, distortion=tuple((camera.distortion + error).tolist()))
        change = pixel_rays(changed, pixels_px, magnification).jac_px - rays.jac_px
        squares += np.sum(np.square(change), axis=(-2, -1))
    return np.asarray(np.sqrt(squares / np.sum(np.square(rays.jac_px), axis=(-2, -1))))


def pixel_directions(rays: PixelRays, pose: Pose) -> Directions:
    """Directions in ENU ``(..., 3)`` of rays of one pose; ``(k, 3)`` or ``(n, k, 3)`` of poses ``(n,)``."""
    rotation = _per_point(pose, matrix(pose.wxyz))
    directions = rotate(rotation, rays.rays_cam)
    jac_direction, jac_position = np.broadcast_to(np.eye(3), (*directions.shape, 3)), np.zeros((*directions.shape, 3))
    by = jac_direction, jac_position, np.zeros(directions.shape)
    return Directions(directions, *_ground_jacobians(rotation, rays, by))


def _pinhole(rays: PixelRays, pose: Pose, elevation: FloatArray, ground: Ground | None) -> GroundPoints:
    rotation, position = _per_point(pose, matrix(pose.wxyz)), _per_point(pose, pose.position_enu_m)
    direction = rotate(rotation, rays.rays_cam)
    depression = np.arctan2(-direction[..., 2], np.hypot(direction[..., 0], direction[..., 1]))
    contact = (
        _level(position, direction, elevation) if ground is None else _uneven(position, direction, elevation, ground)
    )
    shared, jac_px = _ground_jacobians(
        rotation, rays, (contact.jac_direction, contact.jac_position, contact.jac_elevation)
    )
    return GroundPoints(contact.points_enu_m, shared, jac_px, contact.status, depression)


def _per_point(pose: Pose, values: FloatArray) -> FloatArray:
    """Values of each pose with an axis for the points of its image."""
    return values if pose.wxyz.ndim == 1 else values[:, None]


def _ground_jacobians(
    rotation: FloatArray, rays: PixelRays, by: tuple[FloatArray, FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """``jac_shared`` and ``jac_px`` of points that depend on rays.

    Args:
        rotation: ``(..., 3, 3)`` from the camera's axes to ENU.
        rays: The rays.
        by: Derivatives of the points by direction and position ``(..., 3, 3)`` and by elevation ``(..., 3)``.
    """
    jac_direction, jac_position, jac_elevation = by
    # A small rotation w in camera axes moves a ray r by w x r = -skew(r) w.
    by_errors = np.concatenate([-skew(rays.rays_cam), rays.jac_intrinsics, rays.jac_px], axis=-1)
    image_rotation = rotation if rotation.ndim == 2 else rotation[:, 0]  # noqa: PLR2004 - one for each image
    by_ray = (jac_direction.reshape(*image_rotation.shape[:-2], -1, 3) @ image_rotation).reshape(jac_direction.shape)
    by_all = by_ray @ by_errors
    intrinsics = slice(3, by_errors.shape[-1] - 2)
    shared = np.empty((*jac_elevation.shape, INTRINSICS.start + rays.jac_intrinsics.shape[-1]))
    shared[..., POSITION], shared[..., ROTATION] = jac_position, by_all[..., :3]
    shared[..., ELEVATION], shared[..., INTRINSICS] = jac_elevation, by_all[..., intrinsics]
    return shared, np.ascontiguousarray(by_all[..., intrinsics.stop :])


def _level(position: FloatArray, direction: FloatArray, elevation: FloatArray) -> _GroundContact:
    """Intersection of rays with level ground, and its Jacobians, finite also for rays that go up."""
    down = direction[..., 2]
    reach = (elevation - position[..., 2]) / down
    points = position + reach[..., None] * direction
    points[..., 2] = elevation  # exactly, not within rounding
    jac_elevation = direction / down[..., None]
    along_plane = np.zeros((*direction.shape, 3))
    along_plane[..., 0, 0] = along_plane[..., 1, 1] = along_plane[..., 2, 2] = 1.0
    along_plane[..., 2] -= jac_elevation
    status = _level_status(position[..., 2], elevation, -down)
    return _GroundContact(points, reach[..., None, None] * along_plane, along_plane, jac_elevation, status)


def _uneven(position: FloatArray, direction: FloatArray, elevation: FloatArray, ground: Ground) -> _GroundContact:
    hits = ground.meet(position, direction, elevation)
    by = jacobians(position, direction, hits)
    return _GroundContact(hits.points_enu_m, by.jac_direction, by.jac_position, by.jac_elevation, hits.status)


def _dft(
    camera: Camera, pose: Pose, pixels: FloatArray, elevation: FloatArray, magnification: FloatArray | None
) -> GroundPoints:
    tilt, _, heading = (_per_point(pose, angle) for angle in camera_angles(pose.wxyz))
    position = _per_point(pose, pose.position_enu_m)
    scale = 1.0 if magnification is None else magnification[:, None]
    fx_px, fy_px = scale * camera.fx_px, scale * camera.fy_px
    hfov, vfov = 2 * np.arctan(camera.width_px / 2 / fx_px), 2 * np.arctan(camera.height_px / 2 / fy_px)
    height = position[..., 2] - elevation
    step_h, step_v = hfov / camera.width_px, vfov / camera.height_px
    phi = np.broadcast_to(equations.rotation_angle(pixels[..., 0], camera.width_px, hfov), elevation.shape)
    psi = equations.vertical_angle(pixels[..., 1], tilt, camera.height_px, vfov)
    ahead = equations.ground_ahead(height, psi)
    right = equations.ground_right(ahead, phi)
    cos, sin = np.cos(heading), np.sin(heading)

    def east_north(right_m: FloatArray, ahead_m: FloatArray) -> FloatArray:
        return np.stack([right_m * cos + ahead_m * sin, ahead_m * cos - right_m * sin], axis=-1)

    from_foot = east_north(right, ahead)
    points = np.concatenate([position[..., :2] + from_foot, elevation[..., None]], axis=-1)

    steepness = height / np.cos(psi) ** 2
    by_psi, by_phi = east_north(steepness * np.tan(phi), steepness), east_north(ahead / np.cos(phi) ** 2, 0.0 * ahead)
    by_height = east_north(np.tan(psi) * np.tan(phi), np.tan(psi))
    shared = np.zeros((*elevation.shape, 3, shared_count(camera)))
    shared[..., :2, 0:2] = np.eye(2)
    shared[..., :2, 2] = by_height
    shared[..., :2, 3], shared[..., :2, 4] = by_psi, by_phi
    columns, rows = phi / step_h, (psi - tilt) / step_v  # pixel offsets from the image's centre
    shared[..., :2, 5] = by_phi * (rows * step_h)[..., None] - by_psi * (columns * step_v)[..., None]
    # A clockwise rotation about the vertical moves points around the foot exactly, whatever the paper's approximations.
    down = -_per_point(pose, matrix(pose.wxyz)[..., 2, :])
    by_heading = np.stack([from_foot[..., 1], -from_foot[..., 0]], axis=-1)
    by_heading -= (shared[..., :2, ROTATION] @ down[..., None])[..., 0]
    shared[..., :2, ROTATION] += by_heading[..., None] * down[..., None, :]
    # The paper's angles are proportional to the field of view, 2 atan(width / 2 f).
    shared[..., :2, 7] = -by_phi * (columns / (fx_px**2 + (camera.width_px / 2) ** 2))[..., None]
    shared[..., :2, 8] = -by_psi * (rows / (fy_px**2 + (camera.height_px / 2) ** 2))[..., None]
    shared[..., :2, ELEVATION] = -by_height
    shared[..., 2, ELEVATION] = 1.0
    jac_px = np.zeros((*elevation.shape, 3, 2))
    jac_px[..., :2, 0] = by_phi * np.asarray(step_h)[..., None]
    jac_px[..., :2, 1] = -by_psi * np.asarray(step_v)[..., None]
    shared[..., PRINCIPAL_POINT] = -jac_px
    depression = np.pi / 2 - np.abs(psi)
    return GroundPoints(points, shared, jac_px, _level_status(position[..., 2], elevation, depression), depression)


def _level_status(camera_up_m: FloatArray, elevation: FloatArray, down: FloatArray) -> Codes:
    """Statuses on level ground; ``down`` is positive for rays that go down, NaN without a ray."""
    return np.select(
        np.broadcast_arrays(np.isnan(down), elevation >= camera_up_m, down <= _MIN_DEPRESSION_RAD),
        [CODE_OF[status] for status in (Status.BEYOND_LENS_MODEL, Status.BELOW_SURFACE, Status.ABOVE_HORIZON)],
        default=CODE_OF[Status.OK],
    ).astype(np.uint8)
