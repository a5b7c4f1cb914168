"""Joint first-order propagation: all points of one measurement share the pose's error, each has its own pixel's."""

import math

import numpy as np

from aerodft.dft.projection import ELEVATION, INTRINSICS, POSITION, GroundPoints, shared_count
from aerodft.geometry.intrinsics import intrinsics_covariance
from aerodft.model.arrays import FloatArray, FloatLike
from aerodft.model.camera import Camera
from aerodft.model.measurement import Ellipse95
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
        pose: One pose.
        elevation_std_m: ``(...)``.
    """
    motion = np.concatenate([pose.velocity_enu_mps, pose.rate_cam_radps])
    count = shared_count(camera)
    cov = np.zeros((*np.shape(elevation_std_m), count, count))
    cov[..., :6, :6] = pose.cov + pose.time_std_s**2 * motion[:, None] * motion
    cov[..., ELEVATION, ELEVATION] = np.square(elevation_std_m)
    cov[..., INTRINSICS, INTRINSICS] = intrinsics_covariance(camera)
    if pose.lens_cov.shape[-1] == count - INTRINSICS.start:
        cov[..., :6, INTRINSICS] = pose.lens_cov
        cov[..., INTRINSICS, :6] = pose.lens_cov.T
    return cov


def point_covariances(ground: GroundPoints, shared_cov: FloatArray, std_px: FloatArray) -> FloatArray:
    """``(k, 3, 3)`` ENU covariance (m^2) of each of the points, with ``shared_cov (k, s, s)``, ``std_px (k,)``."""
    jac, own = ground.jac_shared, ground.jac_px
    by_pixel = np.square(std_px)[:, None, None] * own @ own.swapaxes(-1, -2)
    return np.asarray(jac @ shared_cov @ jac.swapaxes(-1, -2) + by_pixel)


def slant_ranges(
    ground: GroundPoints, camera_enu_m: FloatArray, shared_cov: FloatArray, std_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance of each of the points from the camera and its standard deviation, ``(k,)`` each, NaN for misses."""
    sight = ground.points_enu_m - camera_enu_m
    range_m = np.linalg.norm(sight, axis=-1)
    unit = sight / range_m[:, None]
    shared = np.einsum("ki,kij->kj", unit, ground.jac_shared)
    shared[:, POSITION] -= unit
    own = np.einsum("ki,kij->kj", unit, ground.jac_px)
    variance = np.einsum("ki,kij,kj->k", shared, shared_cov, shared) + np.square(std_px) * np.sum(own * own, axis=-1)
    return range_m, np.sqrt(np.maximum(variance, 0.0))


def ellipse95(cov_enu_m2: FloatArray) -> Ellipse95:
    """The 95 % ellipse of the horizontal part; azimuth of the major axis clockwise from north, in [0, pi)."""
    variances, axes = np.linalg.eigh(cov_enu_m2[:2, :2])
    minor, major = np.sqrt(CHI2_2D_95 * np.clip(variances, 0.0, None))
    azimuth = math.atan2(axes[0, 1], axes[1, 1]) % math.pi
    return Ellipse95(semi_major_m=float(major), semi_minor_m=float(minor), azimuth_rad=azimuth)
