"""Scenes whose truth is known without the engine: explicit rotations, OpenCV's projection, closed forms.

ENU axes, metres, radians, pixels. Of ``aerodft`` only the values that describe a camera and a pose are used.
"""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from aerodft.model import LensModel, Pose, PoseSample, Status

_EXACT = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-10)


def camera_axes(tilt_rad, roll_rad, heading_rad):
    """The camera's right, down and forward in ENU, as the columns of ``(3, 3)``."""
    ahead = np.array([np.sin(heading_rad), np.cos(heading_rad), 0.0])
    level_right = np.array([np.cos(heading_rad), -np.sin(heading_rad), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    forward = np.sin(tilt_rad) * ahead - np.cos(tilt_rad) * up
    level_down = -np.cos(tilt_rad) * ahead - np.sin(tilt_rad) * up
    right = np.cos(roll_rad) * level_right + np.sin(roll_rad) * level_down
    down = np.cos(roll_rad) * level_down - np.sin(roll_rad) * level_right
    return np.column_stack([right, down, forward])


def opencv_matrix(camera):
    return np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])


def opencv_pixels(camera, axes_enu, position_enu_m, points_enu_m):
    """Pixels ``(n, 2)`` of points ``(n, 3)``, by OpenCV."""
    points = np.ascontiguousarray(points_enu_m, dtype=np.float64).reshape(-1, 1, 3)
    to_camera = axes_enu.T
    rvec = Rotation.from_matrix(to_camera).as_rotvec()  # cv2.Rodrigues is 5e-6 rad off near half a turn
    tvec = -to_camera @ position_enu_m
    project = cv2.fisheye.projectPoints if camera.lens is LensModel.FISHEYE else cv2.projectPoints
    pixels, _ = project(points, rvec, tvec, opencv_matrix(camera), np.array(camera.distortion or (0.0,) * 4))
    return pixels.reshape(-1, 2)


def opencv_rays(camera, pixels_px):
    """Rays ``(n, 3)`` in camera axes of a Brown camera's pixels ``(n, 2)``, by OpenCV's iteration (to 1e-6 px)."""
    pixels = np.ascontiguousarray(pixels_px, dtype=np.float64).reshape(-1, 1, 2)
    coefficients = np.array(camera.distortion or (0.0,) * 4)
    across = cv2.undistortPoints(pixels, opencv_matrix(camera), coefficients, criteria=_EXACT).reshape(-1, 2)
    return np.column_stack([across, np.ones(len(across))])


def depression_rad(directions_enu):
    """How far directions ``(..., 3)`` point below the horizon."""
    return np.arctan2(-directions_enu[..., 2], np.hypot(directions_enu[..., 0], directions_enu[..., 1]))


def sample_of(axes_enu, position_enu_m, cov=None):
    """A pose sample for the engine, from a rotation matrix."""
    wxyz = Rotation.from_matrix(axes_enu).as_quat(scalar_first=True)
    stated = {} if cov is None else {"cov": cov}
    pose = Pose(position_enu_m=np.asarray(position_enu_m, dtype=np.float64), wxyz=wxyz, **stated)
    return PoseSample(stamp_ns=0, status=Status.OK, pose=pose)


def as_pixels(pixels_px):
    return tuple(map(tuple, np.asarray(pixels_px).tolist()))
