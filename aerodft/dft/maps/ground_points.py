"""Mapping of many pixels to level ground at one pose by compiled kernels, and the points' covariances."""

from dataclasses import dataclass

import numpy as np

from aerodft.dft.covariance import point_covariances, shared_covariance
from aerodft.dft.projection import project
from aerodft.geometry import (
    BrownLens,
    FisheyeLens,
    brown_limit,
    fisheye_limit,
    matrix,
    meet_brown,
    meet_fisheye,
    meet_pinhole,
    padded_distortion,
)
from aerodft.model import Camera, FloatArray, LensModel, Pose, ProjectionModel

_BLOCK_SIZE = 1 << 12  # pixels per block, so that their derivatives stay in the cache


@dataclass(frozen=True, slots=True, eq=False)
class GroundMap:
    """Map from pixels to level ground at one pose: ``project`` without Jacobians and statuses.

    Attributes:
        camera: The camera.
        ground_from_ray: ``(3, 3)`` from rays in camera axes to ENU, horizontal axes scaled by the camera's height.
        foot_enu_m: ``(3,)`` ground point below the camera.
        ground_from_pixel: ``(3, 3)`` from homogeneous pixels to ENU, scaled so; None for a lens with distortion.
        brown: Parameters of a Brown lens; None for any other.
        fisheye: Parameters of a fisheye lens; None for any other.
    """

    camera: Camera
    ground_from_ray: FloatArray
    foot_enu_m: FloatArray
    ground_from_pixel: FloatArray | None
    brown: BrownLens | None = None
    fisheye: FisheyeLens | None = None

    @classmethod
    def at(cls, camera: Camera, pose: Pose, elevation_m: float = 0.0) -> "GroundMap":
        """Build the map of one pose to the horizontal plane at ``elevation_m``; pinhole model.

        From below the plane nothing is seen of it.
        """
        height = float(pose.position_enu_m[2]) - elevation_m
        scale = np.array([height, height, 1.0]) if height > 0 else np.full(3, np.nan)
        ground_from_ray = scale[:, None] * matrix(pose.wxyz)
        foot = np.array([*pose.position_enu_m[:2], elevation_m])
        if _is_undistorted(camera):
            return cls(camera, ground_from_ray, foot, ground_from_ray @ _ray_from_pixel(camera))
        if camera.lens is LensModel.FISHEYE:
            return cls(camera, ground_from_ray, foot, None, fisheye=_fisheye_lens(camera))
        return cls(camera, ground_from_ray, foot, None, brown=_brown_lens(camera))

    def points_enu_m(self, pixels_px: FloatArray) -> FloatArray:
        """Ground points ``(..., 3)`` of pixels ``(..., 2)``, in the image or beside it.

        NaN at and above the horizon, and beyond the valid part of the lens.
        """
        pixels = np.ascontiguousarray(pixels_px, dtype=np.float64)
        points = np.empty((*pixels.shape[:-1], 3))
        flat, out = pixels.reshape(-1, 2), points.reshape(-1, 3)
        if self.ground_from_pixel is not None:
            meet_pinhole(flat, self.ground_from_pixel, self.foot_enu_m, out)
        elif self.brown is not None:
            meet_brown(flat, self.brown, self.ground_from_ray, self.foot_enu_m, out)
        elif self.fisheye is not None:
            meet_fisheye(flat, self.fisheye, self.ground_from_ray, self.foot_enu_m, out)
        return points


def ground_covariances(
    camera: Camera, pose: Pose, pixels_px: FloatArray, elevation_m: float, elevation_std_m: float, std_px: float
) -> FloatArray:
    """Propagate to first order the covariances ``(..., 3, 3)`` of pixels ``(..., 2)`` on level ground.

    Each sums the errors of pose, intrinsics and elevation, which all points share, and of the pixel. Values where
    the ray does not go down mean nothing: the points there are NaN.
    """
    flat = pixels_px.reshape(-1, 2)
    shared_cov = shared_covariance(camera, pose, np.array(elevation_std_m))[None]
    cov = np.empty((len(flat), 3, 3))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for first in range(0, len(flat), _BLOCK_SIZE):
            block = slice(first, first + _BLOCK_SIZE)
            points = project(camera, pose, flat[block], elevation_m, ProjectionModel.PINHOLE)
            count = len(points.status)
            variances = np.zeros(count), np.full(count, std_px**2)
            cov[block] = point_covariances(points.jac_shared[None], points.jac_px[None], shared_cov, *variances)[0]
    return cov.reshape(*pixels_px.shape[:-1], 3, 3)


def _is_undistorted(camera: Camera) -> bool:
    """Whether the lens has no distortion."""
    return camera.lens is LensModel.BROWN and not any(camera.distortion)


def _ray_from_pixel(camera: Camera) -> FloatArray:
    """Inverse camera matrix ``(3, 3)`` of a lens without distortion."""
    return np.array(
        [
            [1 / camera.fx_px, 0.0, -camera.cx_px / camera.fx_px],
            [0.0, 1 / camera.fy_px, -camera.cy_px / camera.fy_px],
            [0.0, 0.0, 1.0],
        ]
    )


def _intrinsics(camera: Camera) -> tuple[float, float, float, float]:
    """fx, fy, cx and cy of a camera for the compiled kernels."""
    return float(camera.fx_px), float(camera.fy_px), float(camera.cx_px), float(camera.cy_px)


def _brown_lens(camera: Camera) -> BrownLens:
    """Intrinsics, coefficients and validity limit of a Brown lens for the compiled kernels."""
    coefficients = tuple(map(float, padded_distortion(camera, 8)))
    return _intrinsics(camera), coefficients, brown_limit(coefficients)


def _fisheye_lens(camera: Camera) -> FisheyeLens:
    """Intrinsics, coefficients and validity limit of a fisheye lens for the compiled kernels."""
    coefficients = tuple(map(float, padded_distortion(camera, 4)))
    return _intrinsics(camera), coefficients, fisheye_limit(coefficients)
