"""Joint first-order propagation: all points of one measurement share the pose's error, each has its own pixel's."""

from dataclasses import dataclass

import numpy as np

from aerodft.dft.loops import SharedErrors, spread
from aerodft.dft.projection import ELEVATION, INTRINSICS, GroundPoints, shared_count
from aerodft.geometry.intrinsics import intrinsics_covariance
from aerodft.model.arrays import FloatArray, FloatLike
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose

Z95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

CHI2_2D_95 = 5.991464547107979
"""95 % quantile of chi-square with two degrees of freedom."""


def shared_covariance(camera: Camera, pose: Pose, elevation_std_m: FloatLike) -> FloatArray:
    """``(..., s, s)`` covariance of the errors that all points have in common, ordered as in ``projection``.

    A stamp that is off by ``dt`` is a pose that is off by ``dt`` times the camera's motion.

    Args:
        camera: The camera.
        pose: One pose, or as many as elevations.
        elevation_std_m: ``(...)``.
    """
    motion = np.concatenate([pose.velocity_enu_mps, pose.rate_cam_radps], axis=-1)
    time_var = np.square(pose.time_std_s)
    count = shared_count(camera)
    cov = np.zeros((*np.shape(elevation_std_m), count, count))
    cov[..., :6, :6] = pose.cov + time_var[..., None, None] * motion[..., :, None] * motion[..., None, :]
    cov[..., ELEVATION, ELEVATION] = np.square(elevation_std_m)
    cov[..., INTRINSICS, INTRINSICS] = intrinsics_covariance(camera)
    if pose.lens_cov.shape[-1] == count - INTRINSICS.start:
        cov[..., :6, INTRINSICS] = pose.lens_cov
        cov[..., INTRINSICS, :6] = pose.lens_cov.swapaxes(-1, -2)
    return cov


@dataclass(frozen=True, slots=True)
class PointSpread:
    """How well points are known; NaN for misses.

    Attributes:
        cov_enu_m2: ``(n, k, 3, 3)``.
        range_m: ``(n, k)`` from the camera.
        range_std_m: ``(n, k)``.
    """

    cov_enu_m2: FloatArray
    range_m: FloatArray
    range_std_m: FloatArray


def point_spread(
    ground: GroundPoints,
    camera_enu_m: FloatArray,
    shared_cov: FloatArray,
    elevation_std_m: FloatArray,
    std_px: FloatArray,
) -> PointSpread:
    """How well ``n`` images' ``k`` points each are known.

    Args:
        ground: The points, ``(n, k)``.
        camera_enu_m: ``(n, 3)``.
        shared_cov: ``(n, s, s)``, with 0 for the elevation.
        elevation_std_m: ``(k,)``.
        std_px: ``(k,)`` of each pixel coordinate.
    """
    sight = ground.points_enu_m - camera_enu_m[:, None]
    range_m = np.sqrt(sight[..., 0] ** 2 + sight[..., 1] ** 2 + sight[..., 2] ** 2)
    cov, variance = np.empty((*range_m.shape, 3, 3)), np.empty(range_m.shape)
    jacobians, errors = (ground.jac_shared, ground.jac_px), SharedErrors.of(shared_cov)
    unit = sight / range_m[..., None]
    spread(jacobians, errors, np.square(elevation_std_m), np.square(std_px), unit, cov, variance)
    return PointSpread(cov, range_m, np.sqrt(np.maximum(variance, 0.0)))


def ellipses95(cov_enu_m2: FloatArray) -> FloatArray:
    """Semi-major, semi-minor axis (m) and azimuth (rad) ``(..., 3)`` of the 95 % ellipses of the horizontal parts.

    The azimuth is that of the major axis, clockwise from north, in [0, pi).
    """
    east, north, both = cov_enu_m2[..., 0, 0], cov_enu_m2[..., 1, 1], cov_enu_m2[..., 0, 1]
    middle, off = (east + north) / 2, np.hypot((east - north) / 2, both)
    axes = np.sqrt(CHI2_2D_95 * np.clip(np.stack([middle + off, middle - off], axis=-1), 0.0, None))
    azimuth = np.arctan2(2 * both, north - east) / 2 % np.pi
    return np.concatenate([axes, azimuth[..., None]], axis=-1)
