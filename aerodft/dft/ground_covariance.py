"""Many pixels to points of level ground with a covariance each, at one pose; first order, as fast as it goes."""

from dataclasses import dataclass

import numpy as np

from aerodft.dft.ground_map import brown_lens, fisheye_lens, is_straight, ray_from_pixel
from aerodft.dft.projection import ELEVATION
from aerodft.dft.uncertainty import shared_covariance
from aerodft.geometry.dense import RAY_ROWS, RAYS_AT_ONCE, brown_rays
from aerodft.geometry.fisheye import fisheye_rays
from aerodft.geometry.intrinsics import PINHOLE_PARAMETERS
from aerodft.geometry.rotation import matrix, skew
from aerodft.geometry.spread import Matrix, Quadratic, spread_rays, spread_straight
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera, LensModel
from aerodft.model.pose import Pose

_UP = 2
_CENTRE = slice(8, 10)  # cx and cy, where the elevation's error is part of the camera's
_PINHOLE = 6 + PINHOLE_PARAMETERS
_EXPLAINED = 1e-15  # of a variance: what is left of it is rounding


@dataclass(frozen=True, slots=True, eq=False)
class GroundCovariance:
    """Pixels to level ground at one pose, with the covariance of each point.

    What ``project``, ``shared_covariance`` and ``point_covariances`` give, without statuses and for many pixels.

    Attributes:
        camera: The camera.
        enu_from_cam: Rotation.
        camera_m: East, north, and height above the plane; NaN where that is not above 0.
        factors: ``(r, 10 + c)``, see ``spread_rays``.
        forms: See ``spread_straight``; None for a lens with distortion, or whose distortion is uncertain.
    """

    camera: Camera
    enu_from_cam: Matrix
    camera_m: tuple[float, float, float]
    factors: FloatArray
    forms: tuple[Quadratic, ...] | None

    @classmethod
    def at(
        cls, camera: Camera, pose: Pose, *, std_px: float, elevation_m: float = 0.0, elevation_std_m: float = 0.0
    ) -> "GroundCovariance":
        """The map of one pose to the horizontal plane at ``elevation_m``; pinhole model.

        Args:
            camera: The camera, with what its intrinsics are uncertain by.
            pose: The pose with its covariance.
            std_px: Of each coordinate of each pixel.
            elevation_m: Of the plane. From below it nothing is seen of it.
            elevation_std_m: Its standard deviation.
        """
        above = float(pose.position_enu_m[_UP]) - elevation_m
        height = above if above > 0 else np.nan
        east, north = pose.position_enu_m[:2].tolist()
        cov = _common_covariance(camera, pose, elevation_std_m, std_px)
        straight = is_straight(camera) and len(cov) == _PINHOLE
        rotation = matrix(pose.wxyz)
        return cls(
            camera,
            _matrix(rotation),
            (east, north, height),
            _factors(cov),
            _forms(camera, rotation, height, cov) if straight else None,
        )

    def points_and_covariances(self, pixels_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """East and north ``(..., 2)`` of pixels ``(..., 2)`` and their covariances ``(..., 2, 2)`` (m^2).

        Pixels may lie beside the image. NaN at and above the horizon, and beyond the valid part of the lens.
        """
        pixels = np.ascontiguousarray(pixels_px, dtype=np.float64)
        points, covs = np.empty_like(pixels), np.empty((*pixels.shape, 2))
        flat = pixels.reshape(-1, 2), points.reshape(-1, 2), covs.reshape(-1, 2, 2)
        if self.forms is None:
            self._spread_rays(*flat)
        else:
            self._spread_straight(self.forms, *flat)
        return points, covs

    def _spread_straight(
        self, forms: tuple[Quadratic, ...], pixels: FloatArray, points: FloatArray, covs: FloatArray
    ) -> None:
        east, north, height = self.camera_m
        rows = np.array(self.enu_from_cam) @ ray_from_pixel(self.camera) * [[height], [height], [1.0]]
        spread_straight(pixels, _matrix(rows), forms, (east, north), points, covs)

    def _spread_rays(self, pixels: FloatArray, points: FloatArray, covs: FloatArray) -> None:
        bent = self.factors.shape[1] - _PINHOLE
        rays, bends = np.empty((RAY_ROWS, RAYS_AT_ONCE)), np.empty((2 * bent, RAYS_AT_ONCE))
        for first in range(0, len(pixels), RAYS_AT_ONCE):
            rows = slice(first, first + RAYS_AT_ONCE)
            if self.camera.lens is LensModel.FISHEYE:
                fisheye_rays(pixels[rows], fisheye_lens(self.camera), rays, bends)
            else:
                brown_rays(pixels[rows], brown_lens(self.camera), rays, bends)
            spread_rays((rays, bends), self.enu_from_cam, self.camera_m, self.factors, points[rows], covs[rows])


def _common_covariance(camera: Camera, pose: Pose, elevation_std_m: float, std_px: float) -> FloatArray:
    """``(10 + c, 10 + c)`` of position, rotation, and intrinsics.

    To one point it makes no difference whether the ground is raised or the camera lowered, and whether its pixel or
    the principal point is off.
    """
    cov = shared_covariance(camera, pose, elevation_std_m)
    cov[_UP] -= cov[ELEVATION]
    cov[:, _UP] -= cov[:, ELEVATION]
    cov = np.delete(np.delete(cov, ELEVATION, axis=0), ELEVATION, axis=1)
    cov[_CENTRE, _CENTRE] += np.eye(2) * std_px**2
    return cov


def _factors(cov: FloatArray) -> FloatArray:
    """``(r, s)`` whose product with itself is ``cov (s, s)``, which may be singular: Cholesky's, largest pivot first.

    What is independent stays apart, so most of them are 0.
    """
    variances = np.diag(cov).copy()
    rest, factors = cov.copy(), []
    for _ in range(len(cov)):
        left = np.diag(rest) / np.where(variances > 0, variances, 1.0)
        pivot = int(np.argmax(left))
        if left[pivot] < _EXPLAINED:
            break
        factors.append(rest[pivot] / np.sqrt(rest[pivot, pivot]))
        rest = rest - np.outer(factors[-1], factors[-1])
        rest[pivot], rest[:, pivot] = 0.0, 0.0
    return np.array(factors).reshape(-1, len(cov))


def _forms(camera: Camera, rotation: FloatArray, height_m: float, cov: FloatArray) -> tuple[Quadratic, ...]:
    """``spread_straight``'s.

    The ray that is as long as its range is linear in where it ends, and every error moves it by something linear in it.
    """
    by_ray = np.zeros((_PINHOLE, 3, 3))
    by_ray[3:6] = rotation @ skew(np.eye(3))
    by_ray[6, :, 0], by_ray[7, :, 1] = -rotation[:, :2].T / [[camera.fx_px], [camera.fy_px]]
    by_ray[8, :, 2], by_ray[9, :, 2] = by_ray[6, :, 0], by_ray[7, :, 1]
    by = by_ray @ rotation.T @ np.diag([1.0, 1.0, -height_m])
    by[range(3), range(3), 2] = 1.0
    products = np.einsum("kl,kai,lbj->abij", cov, by, by)
    scale = np.array([1.0, 1.0, 1 / height_m])
    products = products * (scale[:, None] * scale)[..., None, None]
    return tuple(_quadratic(products[a, b]) for a, b in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)))


def _quadratic(product: FloatArray) -> Quadratic:
    (xx, xy, x), (yx, yy, y), (x_too, y_too, one) = product.tolist()
    return xx, xy + yx, yy, x + x_too, y + y_too, one


def _matrix(rows: FloatArray) -> Matrix:
    (a, b, c), (d, e, f), (g, h, i) = rows.tolist()
    return (a, b, c), (d, e, f), (g, h, i)
