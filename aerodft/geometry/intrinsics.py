"""How pixels depend on the intrinsics, on the pose and on the points seen; and how well intrinsics are known.

Parameters are ordered as OpenCV's calibrations have them: fx, fy, cx, cy, then the distortion coefficients.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from aerodft.geometry.lens import distorted_with_jacobian, padded, rays_with_jacobian
from aerodft.model import Camera, FloatArray, LensModel, read_only

PINHOLE_PARAMETERS: Final = 4
"""fx, fy, cx, cy: all that is uncertain where distortion is taken as exact."""


@lru_cache(maxsize=16)
def intrinsics_covariance(camera: Camera) -> FloatArray:
    """``(m, m)`` covariance of the intrinsics; ``m`` is 4 where the distortion is taken as exact.

    From ``camera.covariance`` where there is one; else fx and fy are off together, by the same share, and all others
    each on its own, as ``camera.std`` says.
    """
    if camera.covariance:
        return read_only(np.array(camera.covariance))
    std = camera.std
    bent = std.distortion if any(std.distortion) else ()
    cov = np.zeros((PINHOLE_PARAMETERS + len(bent), PINHOLE_PARAMETERS + len(bent)))
    focal = np.array([1.0, camera.fy_px / camera.fx_px]) * std.focal_px
    cov[:2, :2] = np.outer(focal, focal)
    cov[2:, 2:] = np.diag(np.square([std.principal_point_px, std.principal_point_px, *bent]))
    return read_only(cov)


def rays_by_intrinsics(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """Derivative ``(..., 3, m)`` of the rays (``lens.Rays.rays_cam``) of pixels ``(..., 2)`` by the intrinsics.

    A parameter that would move a ray's pixel by so much moves the pixel's ray as a pixel that is off by the opposite
    does.
    """
    pixels = np.asarray(pixels_px, dtype=np.float64)
    rays = rays_with_jacobian(camera, pixels)
    distorted = (pixels - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px]
    return np.asarray(-rays.jac_px @ pixels_by_intrinsics(camera, rays.rays_cam, distorted))


def pixels_by_intrinsics(camera: Camera, rays_cam: FloatArray, distorted: FloatArray) -> FloatArray:
    """Derivative ``(..., 2, m)`` of the pixels of rays ``(..., 3)`` by the intrinsics.

    Args:
        camera: The camera.
        rays_cam: In camera axes, of any length.
        distorted: ``(..., 2)``: their pixels, from the principal point, in focal lengths.
    """
    count = len(intrinsics_covariance(camera))
    by = np.zeros((*distorted.shape, count))
    by[..., 0, 0], by[..., 1, 1] = distorted[..., 0], distorted[..., 1]
    by[..., 0, 2] = by[..., 1, 3] = 1.0
    if count > PINHOLE_PARAMETERS:
        bend = _fisheye_bend if camera.lens is LensModel.FISHEYE else _brown_bend
        by_coefficients = bend(camera, rays_cam)[..., : len(camera.distortion)]
        by[..., PINHOLE_PARAMETERS:] = np.array([[camera.fx_px], [camera.fy_px]]) * by_coefficients
    return by


def _brown_bend(camera: Camera, rays_cam: FloatArray) -> FloatArray:
    """Derivative ``(..., 2, 8)`` of the distorted by the coefficients."""
    k1, k2, _, _, k3, k4, k5, k6 = padded(camera, 8)
    x, y = rays_cam[..., 0] / rays_cam[..., 2], rays_cam[..., 1] / rays_cam[..., 2]
    s = x * x + y * y
    over, under = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
    powers = np.stack([s, s * s, s**3], axis=-1) / under[..., None]
    above, below = powers, -powers * (over / under)[..., None]
    by = np.empty((*x.shape, 2, 8))
    for axis, along in enumerate((x, y)):
        by[..., axis, [0, 1, 4]] = along[..., None] * above
        by[..., axis, [5, 6, 7]] = along[..., None] * below
    by[..., 0, 2] = by[..., 1, 3] = 2 * x * y
    by[..., 1, 2], by[..., 0, 3] = s + 2 * y * y, s + 2 * x * x
    return by


def _fisheye_bend(_: Camera, rays_cam: FloatArray) -> FloatArray:
    """Derivative ``(..., 2, 4)`` of the distorted by the coefficients."""
    sideways = np.hypot(rays_cam[..., 0], rays_cam[..., 1])
    angle = np.arctan2(sideways, rays_cam[..., 2])
    outward = rays_cam[..., :2] / np.where(sideways > 0, sideways, 1.0)[..., None]
    return np.asarray(outward[..., None] * angle[..., None, None] ** np.array([3, 5, 7, 9]))


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
        """``(..., 2, m)`` pixels by the intrinsics, see ``intrinsics_covariance``."""
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
