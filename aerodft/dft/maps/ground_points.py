"""Many pixels, or one again and again, to points of level ground at one pose, as fast as it goes; covariances too."""

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

_AT_ONCE = 1 << 12  # pixels whose derivatives stay in the cache


@dataclass(frozen=True, slots=True, eq=False)
class GroundMap:
    """Pixels to level ground at one pose; what ``project`` gives, without Jacobians and statuses.

    Attributes:
        camera: The camera.
        ground_from_ray: ``(3, 3)``: from rays in camera axes to ENU, in camera heights.
        foot_enu_m: ``(3,)`` the point of the ground below the camera.
        ground_from_pixel: ``(3, 3)``: the same from homogeneous pixels; None for a lens with distortion.
        brown: What a lens with Brown's distortion is; None for any other.
        fisheye: What a fisheye lens is; None for any other.
    """

    camera: Camera
    ground_from_ray: FloatArray
    foot_enu_m: FloatArray
    ground_from_pixel: FloatArray | None
    brown: BrownLens | None = None
    fisheye: FisheyeLens | None = None

    @classmethod
    def at(cls, camera: Camera, pose: Pose, elevation_m: float = 0.0) -> "GroundMap":
        """The map of one pose to the horizontal plane at ``elevation_m``; pinhole model.

        From below the plane nothing is seen of it.
        """
        height = float(pose.position_enu_m[2]) - elevation_m
        scale = np.array([height, height, 1.0]) if height > 0 else np.full(3, np.nan)
        ground_from_ray = scale[:, None] * matrix(pose.wxyz)
        foot = np.array([*pose.position_enu_m[:2], elevation_m])
        if _is_straight(camera):
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
    """Covariances ``(..., 3, 3)`` of the points of level ground that pixels ``(..., 2)`` show, by first order.

    Each is of all errors together: those of pose, intrinsics and elevation, which all points share, and its pixel's
    own. What it gives where the ray does not go down means nothing: the points there are NaN.
    """
    flat = pixels_px.reshape(-1, 2)
    shared_cov = shared_covariance(camera, pose, np.array(elevation_std_m))[None]
    found = np.empty((len(flat), 3, 3))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for first in range(0, len(flat), _AT_ONCE):
            own = slice(first, first + _AT_ONCE)
            seen = project(camera, pose, flat[own], elevation_m, ProjectionModel.PINHOLE)
            count = len(seen.status)
            stds = np.zeros(count), np.full(count, std_px**2)
            found[own] = point_covariances(seen.jac_shared[None], seen.jac_px[None], shared_cov, *stds)[0]
    return found.reshape(*pixels_px.shape[:-1], 3, 3)


def _is_straight(camera: Camera) -> bool:
    """Whether the lens has no distortion."""
    return camera.lens is LensModel.BROWN and not any(camera.distortion)


def _ray_from_pixel(camera: Camera) -> FloatArray:
    """``(3, 3)``: from homogeneous pixels to rays in camera axes, of a lens without distortion."""
    return np.array(
        [
            [1 / camera.fx_px, 0.0, -camera.cx_px / camera.fx_px],
            [0.0, 1 / camera.fy_px, -camera.cy_px / camera.fy_px],
            [0.0, 0.0, 1.0],
        ]
    )


def _intrinsics_of(camera: Camera) -> tuple[float, float, float, float]:
    """fx, fy, cx and cy, as the compiled loops take them."""
    return float(camera.fx_px), float(camera.fy_px), float(camera.cx_px), float(camera.cy_px)


def _brown_lens(camera: Camera) -> BrownLens:
    """A lens with Brown's distortion, as the compiled loops take it."""
    coefficients = tuple(map(float, padded_distortion(camera, 8)))
    return _intrinsics_of(camera), coefficients, brown_limit(coefficients)


def _fisheye_lens(camera: Camera) -> FisheyeLens:
    """A fisheye lens, as the compiled loops take it."""
    coefficients = tuple(map(float, padded_distortion(camera, 4)))
    return _intrinsics_of(camera), coefficients, fisheye_limit(coefficients)
