"""Poses from the angles and standard deviations that people say."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aerodft.geometry.rotation import camera_attitude, from_rotation_vector, matrix, multiply
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose, PoseStd


def pose_covariance(enu_wxyz_cam: FloatArray, std: PoseStd | Sequence[PoseStd]) -> FloatArray:
    """6 x 6 covariance (ENU position, small rotation in camera axes) of independent stds, ``(..., 6, 6)``.

    Tilt, pan and roll are rotations about the camera's x, y and z; the heading's is about the vertical.

    Args:
        enu_wxyz_cam: ``(..., 4)``.
        std: One for all of them, or of ``(n, 4)`` one each.
    """
    stds = [std] if isinstance(std, PoseStd) else std
    rows = np.array([[each.height_agl_m**2, each.horizontal_m**2, each.heading_rad**2] for each in stds])
    about = np.array([[each.tilt_rad**2, each.pan_rad**2, each.roll_rad**2] for each in stds])
    if isinstance(std, PoseStd):
        rows, about = rows[0], about[0]
    up_cam = matrix(enu_wxyz_cam)[..., 2, :]
    cov = np.zeros((*up_cam.shape[:-1], 6, 6))
    cov[..., range(3), range(3)] = rows[..., [1, 1, 0]]
    cov[..., range(3, 6), range(3, 6)] = about
    cov[..., 3:, 3:] += rows[..., 2, None, None] * up_cam[..., :, None] * up_cam[..., None, :]
    return cov


def moved_on(pose: Pose, elapsed_s: float) -> Pose:
    """One pose some time later (or earlier, below 0), by its velocity and its rate of turn."""
    turn = from_rotation_vector(pose.rate_cam_radps * elapsed_s)
    position = pose.position_enu_m + pose.velocity_enu_mps * elapsed_s
    return replace(pose, position_enu_m=position, wxyz=multiply(pose.wxyz, turn))


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
