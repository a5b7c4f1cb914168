"""How well the slant range of every pixel is known, on level and on tilted ground.

A ray ``d`` of length 1 meets a plane with the normal ``n``, ``h`` from the camera, at the range ``r = h / a`` with
``a = -n . d``. To first order it becomes longer by ``n / a`` with the camera's position, by ``(r / a) (d x n)`` with a
small rotation in camera axes, and by ``(r / a) (n + a d) / |q|`` with the ray ``q`` before it got the length 1.
"""

import numpy as np

from aerodft.dft.covariance import shared_covariance
from aerodft.dft.maps.depth import ray_table
from aerodft.dft.projection import ELEVATION, INTRINSICS, POSITION, ROTATION
from aerodft.geometry import RAY_Z, Float32Array, Plane, matrix, rays_by_intrinsics, rays_from_pixels
from aerodft.model import Camera, FloatArray, Pose

_AT_ONCE = 1 << 17  # pixels: some 100 MB


def range_std(camera: Camera, pose: Pose, plane: Plane, elevation_std_m: float = 0.0) -> Float32Array:
    """Standard deviation of the slant range of every pixel, from pose, intrinsics and the ground's height.

    First order, as the engine's for single pixels: above 5 % of the range it is too small on the far side. The pixel's
    middle itself is exact: who points to something in the image adds the error of pointing.

    Args:
        camera: The camera, with how well its intrinsics are known.
        pose: One pose, with its covariance.
        plane: The ground, see ``depth_map.measured_plane``.
        elevation_std_m: Of the ground's height, all of it together.

    Returns:
        ``(height, width)`` m, float32; NaN where the ray meets no ground.
    """
    height_m = float(plane.normal_enu @ pose.position_enu_m) - plane.offset_m
    std_m = np.full(camera.height_px * camera.width_px, np.nan, dtype=np.float32)
    shared_cov = shared_covariance(camera, pose, elevation_std_m)
    if height_m > 0:
        table = ray_table(camera)
        for first in range(0, len(std_m), _AT_ONCE):
            block = np.arange(first, min(first + _AT_ONCE, len(std_m)))
            rays_cam = table[: RAY_Z + 1, block].T.astype(np.float64)
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # no ray, level rays
                jac = _range_by_pose(pose, plane, height_m, rays_cam, shared_cov.shape[-1])
                if np.any(shared_cov[INTRINSICS, INTRINSICS]):
                    pixels = np.stack([block % camera.width_px, block // camera.width_px], axis=-1).astype(np.float64)
                    jac[:, INTRINSICS] = _range_by_intrinsics(camera, pose, plane, height_m, pixels)
                variance = np.sum((jac @ shared_cov) * jac, axis=-1)
                meets = rays_cam @ (plane.normal_enu @ matrix(pose.wxyz)) < 0
                std_m[block] = np.where(meets, np.sqrt(np.maximum(variance, 0.0)), np.nan)
    return std_m.reshape(camera.height_px, camera.width_px)


def _range_by_pose(pose: Pose, plane: Plane, height_m: float, rays_cam: FloatArray, count: int) -> FloatArray:
    """Derivatives ``(n, count)`` by what all pixels share, see ``projection``; zeros for the intrinsics."""
    normal_cam = plane.normal_enu @ matrix(pose.wxyz)
    steep = -(rays_cam @ normal_cam)[:, None]
    jac = np.zeros((len(rays_cam), count))
    jac[:, POSITION] = plane.normal_enu / steep
    jac[:, ROTATION] = (height_m / steep**2) * np.cross(rays_cam, normal_cam)
    jac[:, ELEVATION] = -plane.normal_enu[2] / steep[:, 0]
    return jac


def _range_by_intrinsics(
    camera: Camera, pose: Pose, plane: Plane, height_m: float, pixels_px: FloatArray
) -> FloatArray:
    """Derivatives ``(n, m)`` of the ranges of pixels ``(n, 2)`` by the intrinsics."""
    normal_cam = plane.normal_enu @ matrix(pose.wxyz)
    rays = rays_from_pixels(camera, pixels_px)
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    rays_cam = rays / length
    steep = -(rays_cam @ normal_cam)[:, None]
    by_ray = height_m / steep**2 * (normal_cam + steep * rays_cam) / length
    return np.asarray(np.einsum("ni,nij->nj", by_ray, rays_by_intrinsics(camera, pixels_px)))
