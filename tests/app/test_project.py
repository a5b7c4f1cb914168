"""Points to pixels: against OpenCV's ``projectPoints``, and poses that are equal, copied or read back."""

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

import aerodft as ad

CAMERA = ad.load_camera(Path(__file__).parents[2] / "configs/cameras/demo-1080p.toml")
POSE = ad.CameraPose(height_m=12.0, tilt_deg=55.0, roll_deg=2.0, heading_deg=130.0, std=ad.PoseStd(tilt_deg=0.2))


def by_opencv(points_m):
    """Pixels of ground-frame points by OpenCV: camera axes right, down and ahead, tilted and rolled."""
    tilt, roll = np.radians([POSE.tilt_deg, POSE.roll_deg])
    ahead = np.array([0.0, np.sin(tilt), -np.cos(tilt)])
    right = np.array([1.0, 0.0, 0.0])
    down = np.cross(ahead, right)
    right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
    rotation = np.stack([right, down, ahead])
    matrix = np.array([[CAMERA.fx_px, 0, CAMERA.cx_px], [0, CAMERA.fy_px, CAMERA.cy_px], [0, 0, 1]])
    away_m = (np.asarray(points_m) - [0, 0, POSE.height_m]) @ rotation.T
    pixels, _ = cv2.projectPoints(away_m, np.zeros(3), np.zeros(3), matrix, np.array(CAMERA.distortion))
    return pixels[:, 0]


def test_pixels_are_those_of_opencv():
    points_m = np.random.default_rng(45).uniform([-6, 8, -0.5], [6, 30, 3], (500, 3))
    pixels = ad.project(CAMERA, POSE, points_m)
    np.testing.assert_allclose(pixels, by_opencv(points_m), atol=1e-6)


def test_the_jacobian_is_that_of_differences():
    points_m, step_m = np.array([[-3.0, 20.0, 0.4], [5.0, 12.0, 1.0]]), 1e-4
    _, jacobian = ad.project(CAMERA, POSE, points_m, jacobian=True)
    steps = [ad.project(CAMERA, POSE, points_m + sign * step_m * np.eye(3)[k]) for k in range(3) for sign in (1, -1)]
    by_steps = np.stack([(steps[2 * k] - steps[2 * k + 1]) / (2 * step_m) for k in range(3)], axis=-1)
    np.testing.assert_allclose(jacobian, by_steps, atol=1e-6)


def test_it_inverts_ground_points_and_a_point_behind_has_no_pixel():
    pixels = np.array([[300.0, 500.0], [960.0, 540.0], [1700.0, 900.0]])
    np.testing.assert_allclose(ad.project(CAMERA, POSE, ad.ground_points(CAMERA, POSE, pixels)), pixels, atol=1e-6)
    assert np.isnan(ad.project(CAMERA, POSE, [0.0, -50.0, 40.0])).all()


@pytest.mark.parametrize("points", ["abc", [1.0, 2.0], None, [[1, 2, 3], [4, 5]]])
def test_what_are_no_points_is_misuse(points):
    with pytest.raises(ad.UsageError, match="expected points"):
        ad.project(CAMERA, POSE, points)


def test_a_pose_that_is_read_back_equals_the_first():
    covariance = np.diag([0.1, 0.1, 0.2, 1e-4, 1e-4, 1e-4])
    poses = [POSE, ad.CameraPose(height_m=12.0, tilt_deg=55.0, covariance=covariance)]
    copies = [pickle.loads(pickle.dumps(pose)) for pose in poses]  # noqa: S301 - of our own
    assert copies == poses
    assert set(copies) == set(poses)
    assert poses[0] != poses[1]
    assert pickle.loads(pickle.dumps(CAMERA)) == CAMERA  # noqa: S301 - as above
