"""Exact projection between pixels and rays: intrinsics, and the distortion of ``LENS_MODELS``.

Intrinsics are in the order of OpenCV's calibrations: fx, fy, cx, cy, then the distortion coefficients.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from aerodft.geometry.lenses import LENS_MODELS, Coefficients
from aerodft.model import Camera, FloatArray, read_only

_CACHE_LIMIT = 512  # enough for an image's fixed probes; larger arrays take the compiled loop and no cache
PINHOLE_PARAMETERS: Final = 4
"""fx, fy, cx, cy: all that is uncertain where distortion is taken as exact."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays in camera axes and their Jacobian by the pixel.

    Attributes:
        rays_cam: ``(..., 3)``, not normalised; NaN where the lens model has no inverse.
        jac_px: ``(..., 3, 2)`` derivative by the pixel; by the intrinsics see ``rays_by_intrinsics``.
    """

    rays_cam: FloatArray
    jac_px: FloatArray


def rays_from_pixels(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """Rays ``(..., 3)`` in camera axes, not normalised, of pixels ``(..., 2)``; NaN where the lens has no inverse."""
    pixels = np.asarray(pixels_px, dtype=np.float64)
    if pixels.size <= _CACHE_LIMIT:
        return rays_with_jacobian(camera, pixels).rays_cam
    lens = LENS_MODELS[camera.lens]
    return lens.rays(all_coefficients(camera), _normalised_pixels(camera, pixels))


def rays_with_jacobian(camera: Camera, pixels_px: FloatArray) -> Rays:
    """Rays of pixels ``(..., 2)`` with Jacobian; small arrays are cached, hence read-only."""
    pixels = np.asarray(pixels_px, dtype=np.float64)
    return (
        _cached_rays(camera, pixels.shape, pixels.tobytes()) if pixels.size <= _CACHE_LIMIT else _rays(camera, pixels)
    )


@lru_cache(maxsize=64)
def _cached_rays(camera: Camera, shape: tuple[int, ...], pixels: bytes) -> Rays:
    rays = _rays(camera, np.frombuffer(pixels).reshape(shape))
    for array in (rays.rays_cam, rays.jac_px):
        array.setflags(write=False)
    return rays


def _rays(camera: Camera, pixels_px: FloatArray) -> Rays:
    focal = np.array([camera.fx_px, camera.fy_px])
    lens = LENS_MODELS[camera.lens]
    rays, jac = lens.undistort(all_coefficients(camera), _normalised_pixels(camera, pixels_px))
    return Rays(rays, jac / focal)


def _normalised_pixels(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """Pixels from the principal point in focal lengths, ``(..., 2)``."""
    return np.asarray((pixels_px - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px])


def pixels_from_rays(camera: Camera, rays_cam: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` of rays ``(..., 3)`` of any length in camera axes.

    NaN behind the camera and where the distortion model is no longer one to one. May lie outside the image.
    """
    distorted, _ = distorted_with_jacobian(camera, rays_cam)
    return np.asarray(distorted * [camera.fx_px, camera.fy_px] + [camera.cx_px, camera.cy_px])


def distorted_with_jacobian(camera: Camera, rays_cam: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Image points of rays, from the principal point in focal lengths ``(..., 2)``; Jacobian ``(..., 2, 3)``.

    NaN where ``pixels_from_rays`` is.
    """
    rays = np.asarray(rays_cam, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = LENS_MODELS[camera.lens].distort(all_coefficients(camera), rays)
    if np.all(found.is_valid):
        return found.points, found.jac_ray
    is_valid = found.is_valid[..., None]
    return np.where(is_valid, found.points, np.nan), np.where(is_valid[..., None], found.jac_ray, np.nan)


@lru_cache(maxsize=64)
def axis_focal_px(camera: Camera) -> float:
    """Pixels that a ray at the optical axis moves per radian, along the image's rows."""
    _, jac = distorted_with_jacobian(camera, np.array([0.0, 0.0, 1.0]))
    return float(camera.fx_px * jac[0, 0])


def all_coefficients(camera: Camera) -> Coefficients:
    """All distortion coefficients of the camera's lens model, those that it leaves out as 0."""
    return (*camera.distortion, *([0.0] * (len(camera.lens.coefficients) - len(camera.distortion))))


@lru_cache(maxsize=16)
def intrinsics_covariance(camera: Camera) -> FloatArray:
    """Covariance ``(m, m)`` of the intrinsics; ``m`` is 4 where the distortion is taken as exact.

    It is ``camera.covariance`` if there is one; otherwise diagonal from ``camera.std``, but for fx and fy, which are
    fully correlated.
    """
    if camera.covariance:
        return read_only(np.array(camera.covariance))
    std = camera.std
    distortion_std = std.distortion if any(std.distortion) else ()
    cov = np.zeros((PINHOLE_PARAMETERS + len(distortion_std), PINHOLE_PARAMETERS + len(distortion_std)))
    focal = np.array([1.0, camera.fy_px / camera.fx_px]) * std.focal_px
    cov[:2, :2] = np.outer(focal, focal)
    cov[2:, 2:] = np.diag(np.square([std.principal_point_px, std.principal_point_px, *distortion_std]))
    return read_only(cov)


def rays_by_intrinsics(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """Jacobian ``(..., 3, m)`` of the rays (``Rays.rays_cam``) of pixels ``(..., 2)`` by the intrinsics.

    By the implicit function theorem: the pixel stays fixed, so d ray = -(d ray / d pixel) (d pixel / d intrinsics).
    """
    pixels = np.asarray(pixels_px, dtype=np.float64)
    rays = rays_with_jacobian(camera, pixels)
    distorted = (pixels - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px]
    return np.asarray(-rays.jac_px @ pixels_by_intrinsics(camera, rays.rays_cam, distorted))


def pixels_by_intrinsics(camera: Camera, rays_cam: FloatArray, distorted: FloatArray) -> FloatArray:
    """Jacobian ``(..., 2, m)`` of the pixels of rays ``(..., 3)`` by the intrinsics.

    Args:
        camera: The camera.
        rays_cam: In camera axes, of any length.
        distorted: ``(..., 2)`` pixels of the rays, from the principal point in focal lengths.
    """
    count = len(intrinsics_covariance(camera))
    by = np.zeros((*distorted.shape, count))
    by[..., 0, 0], by[..., 1, 1] = distorted[..., 0], distorted[..., 1]
    by[..., 0, 2] = by[..., 1, 3] = 1.0
    if count > PINHOLE_PARAMETERS:
        lens = LENS_MODELS[camera.lens]
        by_coefficients = lens.by_coefficients(all_coefficients(camera), rays_cam)[..., : len(camera.distortion)]
        by[..., PINHOLE_PARAMETERS:] = np.array([[camera.fx_px], [camera.fy_px]]) * by_coefficients
    return by


@dataclass(frozen=True, slots=True, eq=False)
class Reprojection:
    """Pixels of points with their Jacobians; NaN behind the camera and beyond the valid part of the lens.

    Attributes:
        camera: The camera.
        rays_cam: ``(..., 3)`` to the points, in camera axes.
        distorted: ``(..., 2)`` pixels from the principal point in focal lengths.
        jac_point: ``(..., 2, 3)`` pixels by the point (ENU); its negative is that by the camera's position.
        jac_rotation: ``(..., 2, 3)`` pixels by a small rotation of the camera, in its axes.
    """

    camera: Camera
    rays_cam: FloatArray
    distorted: FloatArray
    jac_point: FloatArray
    jac_rotation: FloatArray

    @property
    def pixels_px(self) -> FloatArray:
        """Pixels ``(..., 2)``."""
        lens = self.camera
        return np.asarray(self.distorted * [lens.fx_px, lens.fy_px] + [lens.cx_px, lens.cy_px])

    @property
    def jac_intrinsics(self) -> FloatArray:
        """Jacobian ``(..., 2, m)`` of the pixels by the intrinsics, see ``intrinsics_covariance``."""
        return pixels_by_intrinsics(self.camera, self.rays_cam, self.distorted)


def reproject(
    camera: Camera, position_enu_m: FloatArray, rotation: FloatArray, points_enu_m: FloatArray
) -> Reprojection:
    """Project points ``(..., 3)`` into a camera, with Jacobians.

    Args:
        camera: The camera.
        position_enu_m: ``(3,)``.
        rotation: ``(3, 3)`` from camera axes to ENU.
        points_enu_m: ``(..., 3)``.
    """
    rays = (points_enu_m - position_enu_m) @ rotation
    distorted, by_ray = distorted_with_jacobian(camera, rays)
    by_ray = np.array([[camera.fx_px], [camera.fy_px]]) * by_ray
    jac_point = (by_ray.reshape(-1, 3) @ rotation.T).reshape(by_ray.shape)
    return Reprojection(camera, rays, distorted, jac_point, _rotation_jacobian(by_ray, rays[..., None, :]))


def _rotation_jacobian(a: FloatArray, b: FloatArray) -> FloatArray:
    """Derivatives by a small rotation w of the camera from those ``a`` by the ray ``b``: ``(a x b) . w``."""
    out = np.empty(a.shape)
    for one, two, three in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., one] = a[..., two] * b[..., three] - a[..., three] * b[..., two]
    return out
