"""Joint first-order propagation: all points of one measurement share the pose's error, each has its own pixel's."""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.dft.projection import ELEVATION, FOCAL, PRINCIPAL_POINT, SHARED, GroundPoints
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import Ellipse95
from aerodft.model.pose import Pose

Z95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

CHI2_2D_95 = 5.991464547107979
"""95 % quantile of chi-square with two degrees of freedom."""


@dataclass(frozen=True, slots=True)
class Gradient:
    """How a scalar depends on its points and, directly, on the camera's position.

    Attributes:
        points: ``(k, 3)`` derivative by each ground point.
        position: ``(3,)`` derivative by the camera's position, the points held.
    """

    points: FloatArray
    position: FloatArray


def shared_covariance(camera: Camera, pose: Pose, elevation_std_m: float) -> FloatArray:
    """``(10, 10)`` covariance of the errors that all points have in common, ordered as in ``projection``.

    A stamp that is off by ``dt`` is a pose that is off by ``dt`` times the camera's motion.
    """
    motion = np.concatenate([pose.velocity_enu_mps, pose.rate_cam_radps])
    cov = np.zeros((SHARED, SHARED))
    cov[:6, :6] = pose.cov + pose.time_std_s**2 * motion[:, None] * motion
    cov[FOCAL, FOCAL] = (camera.std.focal_px / camera.fx_px) ** 2
    cov[PRINCIPAL_POINT, PRINCIPAL_POINT] = np.eye(2) * camera.std.principal_point_px**2
    cov[ELEVATION, ELEVATION] = elevation_std_m**2
    return cov


def scalar_std(ground: GroundPoints, gradient: Gradient, shared_cov: FloatArray, std_px: float) -> float:
    """Standard deviation of a scalar of the ``(k,)`` points."""
    shared = np.einsum("ki,kij->j", gradient.points, ground.jac_shared)
    shared[:3] += gradient.position
    own = np.einsum("ki,kij->kj", gradient.points, ground.jac_px)
    return math.sqrt(max(float(shared @ shared_cov @ shared) + std_px**2 * float(np.sum(own * own)), 0.0))


def point_covariance(ground: GroundPoints, index: int, shared_cov: FloatArray, std_px: float) -> FloatArray:
    """``(3, 3)`` ENU covariance (m^2) of one point."""
    jac, own = ground.jac_shared[index], ground.jac_px[index]
    return np.asarray(jac @ shared_cov @ jac.T + std_px**2 * own @ own.T)


def ellipse95(cov_enu_m2: FloatArray) -> Ellipse95:
    """The 95 % ellipse of the horizontal part; azimuth of the major axis clockwise from north, in [0, pi)."""
    variances, axes = np.linalg.eigh(cov_enu_m2[:2, :2])
    minor, major = np.sqrt(CHI2_2D_95 * np.clip(variances, 0.0, None))
    azimuth = math.atan2(axes[0, 1], axes[1, 1]) % math.pi
    return Ellipse95(semi_major_m=float(major), semi_minor_m=float(minor), azimuth_rad=azimuth)
