"""Points of the world to pixels, with what the pixels depend on: what calibrations are made of."""

from dataclasses import dataclass

import numpy as np

from aerodft.geometry.intrinsics import pixels_by_intrinsics
from aerodft.geometry.lens import distorted_with_jacobian
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera


@dataclass(frozen=True, slots=True, eq=False)
class Reprojection:
    """Pixels of points, with their derivatives; NaN behind the camera and beyond the valid part of the lens.

    Attributes:
        camera: What sees them.
        rays_cam: ``(..., 3)`` to the points, in camera axes.
        distorted: ``(..., 2)``: their pixels, from the principal point, in focal lengths.
        by_point: ``(..., 2, 3)`` pixels by the point (ENU); by the camera's position it is the opposite.
        by_rotation: ``(..., 2, 3)`` pixels by a small rotation of the camera, in its axes.
    """

    camera: Camera
    rays_cam: FloatArray
    distorted: FloatArray
    by_point: FloatArray
    by_rotation: FloatArray

    @property
    def pixels_px(self) -> FloatArray:
        """``(..., 2)``."""
        lens = self.camera
        return np.asarray(self.distorted * [lens.fx_px, lens.fy_px] + [lens.cx_px, lens.cy_px])

    @property
    def by_intrinsics(self) -> FloatArray:
        """``(..., 2, m)`` pixels by the intrinsics, see ``intrinsics.intrinsics_covariance``."""
        return pixels_by_intrinsics(self.camera, self.rays_cam, self.distorted)


def reproject(
    camera: Camera, position_enu_m: FloatArray, rotation: FloatArray, points_enu_m: FloatArray
) -> Reprojection:
    """Project points ``(..., 3)`` into a camera.

    Args:
        camera: The camera.
        position_enu_m: ``(3,)``.
        rotation: ``(3, 3)``: from camera axes to ENU.
        points_enu_m: ``(..., 3)``.
    """
    rays = (points_enu_m - position_enu_m) @ rotation
    distorted, by_ray = distorted_with_jacobian(camera, rays)
    by_ray = np.array([[camera.fx_px], [camera.fy_px]]) * by_ray
    by_point = (by_ray.reshape(-1, 3) @ rotation.T).reshape(by_ray.shape)
    return Reprojection(camera, rays, distorted, by_point, _cross(by_ray, rays[..., None, :]))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a x b``: a camera that turns by w sees a ray r turn by -w x r, of which a derivative takes ``(a x r) . w``."""
    out = np.empty(a.shape)
    for one, two, three in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., one] = a[..., two] * b[..., three] - a[..., three] * b[..., two]
    return out
