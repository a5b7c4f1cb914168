"""Points of the world to pixels, with what the pixels depend on: what calibrations are made of."""

from dataclasses import dataclass

import numpy as np

from aerodft.geometry.intrinsics import pixels_by_intrinsics
from aerodft.geometry.lens import distorted_with_jacobian
from aerodft.geometry.rotation import skew
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera


@dataclass(frozen=True, slots=True, eq=False)
class Reprojection:
    """Pixels of points, with their derivatives; NaN behind the camera and beyond the valid part of the lens.

    Attributes:
        pixels_px: ``(..., 2)``.
        by_point: ``(..., 2, 3)`` by the point (ENU); by the camera's position it is the opposite.
        by_rotation: ``(..., 2, 3)`` by a small rotation of the camera, in its axes.
        by_intrinsics: ``(..., 2, m)``, see ``intrinsics.intrinsics_covariance``.
    """

    pixels_px: FloatArray
    by_point: FloatArray
    by_rotation: FloatArray
    by_intrinsics: FloatArray


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
    focal = np.array([camera.fx_px, camera.fy_px])
    by_ray = focal[:, None] * by_ray
    return Reprojection(
        distorted * focal + [camera.cx_px, camera.cy_px],
        by_ray @ rotation.T,
        by_ray @ skew(rays),  # a camera that turns by w sees a ray r turn by -w x r = r x w
        pixels_by_intrinsics(camera, rays, distorted),
    )
