"""Many pixels, or one again and again, to points of level ground at one pose; points alone, as fast as it goes."""

from dataclasses import dataclass

import numpy as np

from aerodft.geometry import (
    BrownLens,
    FisheyeLens,
    brown_limit,
    fisheye_limit,
    matrix,
    meet_brown,
    meet_fisheye,
    meet_straight,
    padded,
)
from aerodft.model import Camera, FloatArray, LensModel, Pose


@dataclass(frozen=True, slots=True, eq=False)
class GroundMap:
    """Pixels to level ground at one pose; what ``project`` gives, without Jacobians and statuses.

    Attributes:
        camera: The camera.
        ground_from_ray: ``(3, 3)``: from rays in camera axes to ENU, in camera heights.
        foot_m: ``(2,)`` east and north below the camera.
        ground_from_pixel: ``(3, 3)``: the same from homogeneous pixels; None for a lens with distortion.
        brown: What a lens with Brown's distortion is; None for any other.
        fisheye: What a fisheye lens is; None for any other.
    """

    camera: Camera
    ground_from_ray: FloatArray
    foot_m: FloatArray
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
        foot = np.array(pose.position_enu_m[:2])
        if _is_straight(camera):
            return cls(camera, ground_from_ray, foot, ground_from_ray @ _ray_from_pixel(camera))
        if camera.lens is LensModel.FISHEYE:
            return cls(camera, ground_from_ray, foot, None, fisheye=_fisheye_lens(camera))
        return cls(camera, ground_from_ray, foot, None, brown=_brown_lens(camera))

    def points_en_m(self, pixels_px: FloatArray) -> FloatArray:
        """East and north ``(..., 2)`` of pixels ``(..., 2)``, in the image or beside it.

        NaN at and above the horizon, and beyond the valid part of the lens.
        """
        pixels = np.ascontiguousarray(pixels_px, dtype=np.float64)
        points = np.empty_like(pixels)
        flat, out = pixels.reshape(-1, 2), points.reshape(-1, 2)
        if self.ground_from_pixel is not None:
            meet_straight(flat, self.ground_from_pixel, self.foot_m, out)
        elif self.brown is not None:
            meet_brown(flat, self.brown, self.ground_from_ray, self.foot_m, out)
        elif self.fisheye is not None:
            meet_fisheye(flat, self.fisheye, self.ground_from_ray, self.foot_m, out)
        return points


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
    coefficients = tuple(map(float, padded(camera, 8)))
    return _intrinsics_of(camera), coefficients, brown_limit(coefficients)


def _fisheye_lens(camera: Camera) -> FisheyeLens:
    """A fisheye lens, as the compiled loops take it."""
    coefficients = tuple(map(float, padded(camera, 4)))
    return _intrinsics_of(camera), coefficients, fisheye_limit(coefficients)
