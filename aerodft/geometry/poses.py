"""Camera poses and their covariance from angles and standard deviations; extrapolation of a pose."""

import math
from dataclasses import astuple, replace
from typing import Final

import numpy as np

from aerodft.geometry.rotation import camera_attitude, from_rotation_vector, matrix, multiply
from aerodft.model import FloatArray, Pose, PoseStd

UNKNOWN_HEADING_VAR: Final = (2 * math.pi) ** 2
"""Variance of an unknown heading, one turn of std: larger values would only drown the other errors numerically."""


def pose_covariance(enu_wxyz_cam: FloatArray, std: PoseStd | FloatArray) -> FloatArray:
    """Covariance ``(..., 6, 6)`` of poses (ENU position, small rotation in camera axes) from independent stds.

    Tilt, pan and roll are rotations about the camera's x, y and z; the heading's is about the vertical, a turn at most.

    Args:
        enu_wxyz_cam: ``(..., 4)``.
        std: One for all poses, or ``(..., 7)`` in the order of the fields of ``PoseStd``; broadcast.
    """
    std = np.array(astuple(std)) if isinstance(std, PoseStd) else std
    # Python's square: numpy's differs in the last bit once in a thousand, and recomputing must give identical bytes.
    variances = np.array([each**2 for each in std.ravel().tolist()]).reshape(std.shape)
    height, horizontal, tilt, pan, roll, heading, _ = np.moveaxis(variances, -1, 0)
    up_cam = matrix(enu_wxyz_cam)[..., 2, :]
    cov = np.zeros((*up_cam.shape[:-1], 6, 6))
    for axis, variance in enumerate((horizontal, horizontal, height, tilt, pan, roll)):
        cov[..., axis, axis] = variance
    heading = np.minimum(heading, UNKNOWN_HEADING_VAR)
    cov[..., 3:, 3:] += heading[..., None, None] * up_cam[..., :, None] * up_cam[..., None, :]
    return cov


def extrapolate_pose(pose: Pose, elapsed_s: float) -> Pose:
    """The pose extrapolated by ``elapsed_s`` (negative: backwards) with its velocity and its angular rate."""
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
    """Pose of a camera at ``(east_m, north_m)``, ``height_agl_m`` above the measured plane."""
    std = std or PoseStd()
    wxyz = camera_attitude(tilt_rad, roll_rad, heading_rad)
    return Pose(
        position_enu_m=np.array([east_m, north_m, height_agl_m]),
        wxyz=wxyz,
        cov=pose_covariance(wxyz, std),
        time_std_s=std.time_s,
    )
