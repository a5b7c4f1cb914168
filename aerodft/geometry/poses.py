"""Poses from the angles and standard deviations that people say."""

import numpy as np

from aerodft.geometry.rotation import camera_attitude, matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose, PoseStd


def pose_covariance(enu_wxyz_cam: FloatArray, std: PoseStd) -> FloatArray:
    """6 x 6 covariance (ENU position, small rotation in camera axes) of independent stds, ``(..., 6, 6)``.

    Tilt, pan and roll are rotations about the camera's x, y and z; the heading's is about the vertical.
    """
    up_cam = matrix(enu_wxyz_cam)[..., 2, :]
    cov = np.zeros((*up_cam.shape[:-1], 6, 6))
    cov[..., range(3), range(3)] = [std.horizontal_m**2, std.horizontal_m**2, std.height_agl_m**2]
    cov[..., 3:, 3:] = np.diag([std.tilt_rad**2, std.pan_rad**2, std.roll_rad**2])
    cov[..., 3:, 3:] += std.heading_rad**2 * up_cam[..., :, None] * up_cam[..., None, :]
    return cov


def camera_pose(
    *,
    height_agl_m: float,
    tilt_rad: float,
    roll_rad: float = 0.0,
    heading_rad: float = 0.0,
    std: PoseStd | None = None,
    east_m: float = 0.0,
    north_m: float = 0.0,
) -> Pose:
    """The pose of a camera at ``(east_m, north_m)`` and ``height_agl_m`` above the measured plane."""
    std = std or PoseStd()
    wxyz = camera_attitude(tilt_rad, roll_rad, heading_rad)
    return Pose(
        position_enu_m=np.array([east_m, north_m, height_agl_m]),
        wxyz=wxyz,
        cov=pose_covariance(wxyz, std),
        time_std_s=std.time_s,
    )
