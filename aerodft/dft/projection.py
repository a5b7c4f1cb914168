"""Pixels to ground points under both projection models, with everything that they depend on.

Columns of ``jac_shared`` (one error that all points of an image have in common)::

    0:3  camera position, ENU (m)          6    relative focal length
    3:6  small rotation, camera axes (rad) 7:9  principal point (px)
    9    elevation of the plane (m)
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft import equations
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.geometry.rotation import camera_angles, matrix, skew
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose
from aerodft.model.status import CODE_OF, Status

SHARED = 10
POSITION, ROTATION = slice(0, 3), slice(3, 6)
FOCAL, PRINCIPAL_POINT, ELEVATION = 6, slice(7, 9), 9


@dataclass(frozen=True, slots=True)
class GroundPoints:
    """Ground points of pixels.

    Attributes:
        points_enu_m: ``(..., 3)``; NaN where ``status`` is not ok.
        jac_shared: ``(..., 3, 10)``, see the module.
        jac_px: ``(..., 3, 2)`` by the point's own pixel.
        status: ``(...)`` indices into ``CODES``.
        depression_rad: ``(...)`` of the ray below the horizon; negative above it.
    """

    points_enu_m: FloatArray
    jac_shared: FloatArray
    jac_px: FloatArray
    status: npt.NDArray[np.uint8]
    depression_rad: FloatArray

    def __getitem__(self, rows: slice) -> "GroundPoints":
        return GroundPoints(
            self.points_enu_m[rows],
            self.jac_shared[rows],
            self.jac_px[rows],
            self.status[rows],
            self.depression_rad[rows],
        )


def project(
    camera: Camera, pose: Pose, pixels_px: FloatArray, elevation_m: npt.ArrayLike, model: ProjectionModel
) -> GroundPoints:
    """Meet the rays of ``pixels_px (..., 2)`` with the horizontal plane at ``elevation_m`` (broadcasts to ``(...)``).

    Args:
        camera: The camera.
        pose: One pose; its position's third component is the height above the elevation 0.
        pixels_px: Pixels; anything outside the image is ``OUT_OF_IMAGE``.
        elevation_m: Height of the plane.
        model: ``pinhole`` or the paper's ``dft``.

    Returns:
        The points, in ENU, with Jacobians; misses are NaN with a status.
    """
    pixels = np.asarray(pixels_px, dtype=np.float64)
    elevation = np.broadcast_to(np.asarray(elevation_m, dtype=np.float64), pixels.shape[:-1])
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        solve = _pinhole if model is ProjectionModel.PINHOLE else _dft
        points, jac_shared, jac_px, depression = solve(camera, pose, pixels, elevation)
    status = _status(camera, pose, pixels, elevation, depression)
    points = np.where((status == CODE_OF[Status.OK])[..., None], points, np.nan)
    return GroundPoints(points, jac_shared, jac_px, status, depression)


_Solution = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _pinhole(camera: Camera, pose: Pose, pixels: FloatArray, elevation: FloatArray) -> _Solution:
    rays = rays_with_jacobian(camera, pixels)
    rotation = matrix(pose.wxyz)
    direction = rays.rays_cam @ rotation.T
    down = direction[..., 2]
    reach = (elevation - pose.position_enu_m[2]) / down
    points = pose.position_enu_m + reach[..., None] * direction
    points[..., 2] = elevation  # exactly, not within rounding
    along_plane = np.eye(3) - direction[..., :, None] * np.array([0.0, 0.0, 1.0]) / down[..., None, None]
    by_ray = reach[..., None, None] * (along_plane @ rotation)
    jac_px = by_ray @ rays.jac_px
    shared = np.zeros((*pixels.shape[:-1], 3, SHARED))
    shared[..., POSITION] = along_plane
    shared[..., ROTATION] = -by_ray @ skew(rays.rays_cam)
    shared[..., FOCAL] = np.einsum("...ij,...j->...i", by_ray, rays.jac_focal)
    shared[..., PRINCIPAL_POINT] = -jac_px
    shared[..., ELEVATION] = direction / down[..., None]
    depression = np.arctan2(-down, np.hypot(direction[..., 0], direction[..., 1]))
    return points, shared, jac_px, depression


def _dft(camera: Camera, pose: Pose, pixels: FloatArray, elevation: FloatArray) -> _Solution:
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
    shared = np.zeros((*pixels.shape[:-1], 3, SHARED))
    shared[..., :2, 0:2] = np.eye(2)
    shared[..., :2, 2] = by_height
    shared[..., :2, 3], shared[..., :2, 4] = by_psi, by_phi
    across, up = phi / step_h, (psi - tilt) / step_v  # pixel offsets from the image's centre
    shared[..., :2, 5] = by_phi * (up * step_h)[..., None] - by_psi * (across * step_v)[..., None]
    shared[..., :2, FOCAL] = -by_phi * phi[..., None] - by_psi * (psi - tilt)[..., None]
    shared[..., :2, ELEVATION] = -by_height
    shared[..., 2, ELEVATION] = 1.0
    jac_px = np.zeros((*pixels.shape[:-1], 3, 2))
    jac_px[..., :2, 0], jac_px[..., :2, 1] = by_phi * step_h, -by_psi * step_v
    shared[..., PRINCIPAL_POINT] = -jac_px
    return points, shared, jac_px, np.pi / 2 - np.abs(psi)


def _status(
    camera: Camera, pose: Pose, pixels: FloatArray, elevation: FloatArray, depression: FloatArray
) -> npt.NDArray[np.uint8]:
    size = np.array([camera.width_px, camera.height_px])
    inside = np.all((pixels >= -PIXEL_CENTRE_OFFSET_PX) & (pixels <= size - PIXEL_CENTRE_OFFSET_PX), axis=-1)
    return np.select(
        [~inside, np.isnan(depression), elevation >= pose.position_enu_m[2], depression <= 0],
        [
            CODE_OF[status]
            for status in (Status.OUT_OF_IMAGE, Status.BEYOND_LENS_MODEL, Status.BELOW_SURFACE, Status.ABOVE_HORIZON)
        ],
        default=CODE_OF[Status.OK],
    ).astype(np.uint8)
