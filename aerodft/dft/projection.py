"""Pixels to ground points under both projection models, with everything that they depend on.

Columns of ``jac_shared`` (one error that all points of an image have in common)::

    0:3  camera position, ENU (m)          7:9   focal lengths fx, fy (px)
    3:6  small rotation, camera axes (rad) 9:11  principal point (px)
    6    elevation of the ground (m)       11:   distortion coefficients, where they are uncertain
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft import equations
from aerodft.dft.loops import depend
from aerodft.geometry.ground import Ground, jacobians
from aerodft.geometry.intrinsics import intrinsics_covariance, rays_by_intrinsics
from aerodft.geometry.lens import Rays, rays_with_jacobian
from aerodft.geometry.rotation import camera_angles, matrix, turned
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose
from aerodft.model.status import CODE_OF, Status

POSITION, ROTATION, ELEVATION = slice(0, 3), slice(3, 6), 6
INTRINSICS = slice(7, None)
FOCAL, PRINCIPAL_POINT, DISTORTION = slice(7, 9), slice(9, 11), slice(11, None)

_LEVEL = 1e-9  # rad: what comes down by less, comes down nowhere

Codes = npt.NDArray[np.uint8]
Rows = int | slice | tuple[int | slice, ...]


def shared_count(camera: Camera) -> int:
    """How many errors all points of an image have in common."""
    return INTRINSICS.start + len(intrinsics_covariance(camera))


@dataclass(frozen=True, slots=True)
class GroundPoints:
    """Ground points of pixels.

    Attributes:
        points_enu_m: ``(..., 3)``; NaN where ``status`` is not ok.
        jac_shared: ``(..., 3, s)``, see the module.
        jac_px: ``(..., 3, 2)`` by the point's own pixel.
        status: ``(...)`` indices into ``CODES``.
        depression_rad: ``(...)`` of the ray below the horizon; negative above it.
    """

    points_enu_m: FloatArray
    jac_shared: FloatArray
    jac_px: FloatArray
    status: Codes
    depression_rad: FloatArray

    def __getitem__(self, rows: Rows | None) -> "GroundPoints":
        return GroundPoints(
            self.points_enu_m[rows],
            self.jac_shared[rows],
            self.jac_px[rows],
            self.status[rows],
            self.depression_rad[rows],
        )


@dataclass(frozen=True, slots=True)
class _Met:
    """Where rays meet the ground, and what that depends on; as ``ground.GroundHits`` and ``GroundJacobians``."""

    points_enu_m: FloatArray
    by_direction: FloatArray
    by_position: FloatArray
    by_elevation: FloatArray
    status: Codes


def project(
    camera: Camera,
    pose: Pose,
    pixels_px: FloatArray,
    elevation_m: npt.ArrayLike,
    model: ProjectionModel,
    ground: Ground | None = None,
    *,
    of_each: bool = False,
) -> GroundPoints:
    """Meet the rays of ``pixels_px (..., 2)`` with the surface that lies ``elevation_m (...)`` above the ground.

    Args:
        camera: The camera.
        pose: Its position's third component is the height above the elevation 0. With the pinhole model and level
            ground several poses ``(n,)``, each with all pixels: what is found is then ``(n, ...)``.
        pixels_px: Pixels; anything outside the image is ``OUT_OF_IMAGE``.
        elevation_m: Height of the measured surface.
        model: ``pinhole`` or the paper's ``dft``, which knows level ground only.
        ground: What the elevation is counted from; None for the level plane at 0.
        of_each: Whether of ``pixels_px (n, ..., 2)`` each of several poses has its own.

    Returns:
        The points, in ENU, with Jacobians; misses are NaN with a status.
    """
    pixels = np.asarray(pixels_px, dtype=np.float64)
    elevation = np.broadcast_to(np.asarray(elevation_m, dtype=np.float64), pixels.shape[:-1])
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        if model is ProjectionModel.PINHOLE:
            found = _pinhole(camera, pose, pixels, elevation, ground, of_each=of_each)
        else:
            found = _dft(camera, pose, pixels, elevation)
    size = np.array([camera.width_px, camera.height_px])
    inside = np.all((pixels >= -PIXEL_CENTRE_OFFSET_PX) & (pixels <= size - PIXEL_CENTRE_OFFSET_PX), axis=-1)
    status = np.where(inside, found.status, CODE_OF[Status.OUT_OF_IMAGE]).astype(np.uint8)
    points = np.where((status == CODE_OF[Status.OK])[..., None], found.points_enu_m, np.nan)
    return GroundPoints(points, found.jac_shared, found.jac_px, status, found.depression_rad)


def _pinhole(
    camera: Camera,
    pose: Pose,
    pixels: FloatArray,
    elevation: FloatArray,
    ground: Ground | None,
    *,
    of_each: bool,
) -> GroundPoints:
    rays = rays_with_jacobian(camera, pixels)
    rotation = matrix(pose.wxyz)
    direction = turned(_over(rotation, pixels[0] if of_each else pixels, 2), rays.rays_cam)
    depression = np.arctan2(-direction[..., 2], np.hypot(direction[..., 0], direction[..., 1]))
    met = _level(pose, direction, elevation) if ground is None else _uneven(pose, direction, elevation, ground)
    by = met.by_direction, met.by_position, met.by_elevation
    shared, own = dependence_of_rays(camera, rotation, pixels, rays, by, of_each=of_each)
    return GroundPoints(met.points_enu_m, shared, own, met.status, depression)


def _over(values: FloatArray, pixels: FloatArray, trailing: int) -> FloatArray:
    """What there is one of for each pose ``(..., *trailing)``, over all pixels of its image."""
    lead = values.shape[: values.ndim - trailing]
    return values.reshape(*lead, *([1] * (pixels.ndim - 1)), *values.shape[values.ndim - trailing :])


def dependence_of_rays(
    camera: Camera,
    rotation: FloatArray,
    pixels: FloatArray,
    rays: Rays,
    by: tuple[FloatArray, FloatArray, FloatArray],
    *,
    of_each: bool,
) -> tuple[FloatArray, FloatArray]:
    """``GroundPoints.jac_shared`` and ``jac_px`` of what depends on rays.

    Args:
        camera: The camera.
        rotation: ``(..., 3, 3)`` from its axes to ENU.
        pixels: ``(..., 2)``, as in ``project``.
        rays: Theirs.
        by: What depends on them, by their direction, the camera's position ``(..., 3, 3)``, and elevation ``(..., 3)``.
        of_each: As in ``project``.
    """
    by_direction, by_position, by_elevation = by
    shape, images = by_elevation.shape[:-1], rotation.size // 9
    seen = (images if of_each else 1, pixels[..., 0].size // (images if of_each else 1))
    by_intrinsics = rays_by_intrinsics(camera, pixels)
    size = INTRINSICS.start + by_intrinsics.shape[-1]
    shared, own = np.empty((*shape, 3, size)), np.empty((*shape, 3, 2))
    flat = (images, seen[1])
    depend(
        (
            by_direction.reshape(*flat, 3, 3),
            by_position.reshape(*flat, 3, 3),
            by_elevation.reshape(*flat, 3),
        ),
        rotation.reshape(-1, 3, 3),
        np.array(rays.rays_cam).reshape(*seen, 3),
        np.array(rays.jac_px).reshape(*seen, 3, 2),
        np.array(by_intrinsics).reshape(*seen, 3, by_intrinsics.shape[-1]),
        shared.reshape(*flat, 3, size),
        own.reshape(*flat, 3, 2),
    )
    return shared, own


def _level(pose: Pose, direction: FloatArray, elevation: FloatArray) -> _Met:
    """As ``meet_level`` with its Jacobians; derivatives also where the ray goes up."""
    position = _over(pose.position_enu_m, direction[(0,) * (pose.wxyz.ndim - 1)], 1)
    down = direction[..., 2]
    reach = (elevation - position[..., 2]) / down
    points = position + reach[..., None] * direction
    points[..., 2] = elevation  # exactly, not within rounding
    by_elevation = direction / down[..., None]
    along_plane = np.zeros((*direction.shape, 3))
    along_plane[..., 0, 0] = along_plane[..., 1, 1] = along_plane[..., 2, 2] = 1.0
    along_plane[..., 2] -= by_elevation
    status = _level_status(position[..., 2], elevation, -down)
    return _Met(points, reach[..., None, None] * along_plane, along_plane, by_elevation, status)


def _uneven(pose: Pose, direction: FloatArray, elevation: FloatArray, ground: Ground) -> _Met:
    hits = ground.meet(pose.position_enu_m, direction, elevation)
    by = jacobians(pose.position_enu_m, direction, hits)
    return _Met(hits.points_enu_m, by.by_direction, by.by_position, by.by_elevation, hits.status)


def _dft(camera: Camera, pose: Pose, pixels: FloatArray, elevation: FloatArray) -> GroundPoints:
    tilt, _, heading = camera_angles(pose.wxyz)
    height = pose.position_enu_m[2] - elevation
    step_h, step_v = camera.hfov_rad / camera.width_px, camera.vfov_rad / camera.height_px
    phi = equations.rotation_angle(pixels[..., 0], camera.width_px, camera.hfov_rad)
    psi = equations.vertical_angle(pixels[..., 1], tilt, camera.height_px, camera.vfov_rad)
    ahead = equations.ground_ahead(height, psi)
    right = equations.ground_right(ahead, phi)
    axes = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])  # right, ahead in EN
    foot = pose.position_enu_m[:2]
    east_north = foot + np.stack([right, ahead], axis=-1) @ axes.T
    points = np.concatenate([east_north, elevation[..., None]], axis=-1)

    by_psi = np.stack([height / np.cos(psi) ** 2 * np.tan(phi), height / np.cos(psi) ** 2], axis=-1) @ axes.T
    by_phi = np.stack([ahead / np.cos(phi) ** 2, np.zeros_like(ahead)], axis=-1) @ axes.T
    by_height = np.stack([np.tan(psi) * np.tan(phi), np.tan(psi)], axis=-1) @ axes.T
    shared = np.zeros((*pixels.shape[:-1], 3, shared_count(camera)))
    shared[..., :2, 0:2] = np.eye(2)
    shared[..., :2, 2] = by_height
    shared[..., :2, 3], shared[..., :2, 4] = by_psi, by_phi
    across, up = phi / step_h, (psi - tilt) / step_v  # pixel offsets from the image's centre
    shared[..., :2, 5] = by_phi * (up * step_h)[..., None] - by_psi * (across * step_v)[..., None]
    # Turned about the vertical, clockwise, points go round the foot: exactly, whatever the equations make of a pixel.
    down = -matrix(pose.wxyz)[2]
    by_heading = np.stack([east_north[..., 1] - foot[1], foot[0] - east_north[..., 0]], axis=-1)
    by_heading -= shared[..., :2, ROTATION] @ down
    shared[..., :2, ROTATION] += by_heading[..., None] * down
    # Angles are in proportion to the field of view, 2 atan(width / 2 f).
    shared[..., :2, 7] = -by_phi * (across / (camera.fx_px**2 + (camera.width_px / 2) ** 2))[..., None]
    shared[..., :2, 8] = -by_psi * (up / (camera.fy_px**2 + (camera.height_px / 2) ** 2))[..., None]
    shared[..., :2, ELEVATION] = -by_height
    shared[..., 2, ELEVATION] = 1.0
    jac_px = np.zeros((*pixels.shape[:-1], 3, 2))
    jac_px[..., :2, 0], jac_px[..., :2, 1] = by_phi * step_h, -by_psi * step_v
    shared[..., PRINCIPAL_POINT] = -jac_px
    depression = np.pi / 2 - np.abs(psi)
    return GroundPoints(
        points, shared, jac_px, _level_status(pose.position_enu_m[2], elevation, depression), depression
    )


def _level_status(camera_up_m: FloatArray, elevation: FloatArray, down: FloatArray) -> Codes:
    """By anything that is positive for rays that go down, and NaN where there is no ray."""
    return np.select(
        np.broadcast_arrays(np.isnan(down), elevation >= camera_up_m, down <= _LEVEL),
        [CODE_OF[status] for status in (Status.BEYOND_LENS_MODEL, Status.BELOW_SURFACE, Status.ABOVE_HORIZON)],
        default=CODE_OF[Status.OK],
    ).astype(np.uint8)
