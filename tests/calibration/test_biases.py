"""Biases against closed forms: which way each one turns, and how its uncertainty enters a pose."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from aerodft.geometry import camera_angles, camera_pose
from aerodft.model import BiasValues, Calibration, PoseBatch, PoseSample, PoseStd, Status
from calibration.flight import BiasCalibrator

DEG = math.pi / 180
STD = PoseStd(
    height_agl_m=1.0, horizontal_m=2.0, tilt_rad=0.02, pan_rad=0.02, roll_rad=0.02, heading_rad=0.05, time_s=0.1
)


def sample(tilt_deg=50.0, heading_deg=30.0, roll_deg=0.0, **rest):
    pose = camera_pose(
        height_agl_m=40.0,
        tilt_rad=tilt_deg * DEG,
        roll_rad=roll_deg * DEG,
        heading_rad=heading_deg * DEG,
        std=STD,
        east_m=7.0,
        north_m=-3.0,
    )
    return PoseSample(stamp_ns=5, status=Status.OK, pose=pose, std=STD, **rest)


def refined(given=None, bias_cov=None, **biases):
    found = Calibration(id="sha256:x", bias=BiasValues(**biases), bias_cov=bias_cov)
    return BiasCalibrator(found).refine(PoseBatch.from_samples([given or sample()]))[0]


def angles_deg(refined_sample):
    return np.degrees(camera_angles(refined_sample.pose.wxyz))


@pytest.mark.parametrize("tilt_deg", [0.0, 1.0, 50.0, 89.0])
def test_a_tilt_bias_raises_the_tilt(tilt_deg):
    assert_allclose(angles_deg(refined(sample(tilt_deg), tilt_rad=DEG)), [tilt_deg + 1.0, 0.0, 30.0], atol=1e-9)


def test_a_roll_bias_lowers_the_cameras_right_side():
    found = refined(roll_rad=2 * DEG)
    assert_allclose(angles_deg(found), [50.0, 2.0, 30.0], atol=1e-9)
    right_enu = Rotation.from_quat(found.pose.wxyz, scalar_first=True).apply([1.0, 0.0, 0.0])
    assert right_enu[2] < 0


def test_a_heading_bias_turns_clockwise():
    found = refined(heading_rad=10 * DEG)
    assert_allclose(angles_deg(found), [50.0, 0.0, 40.0], atol=1e-9)
    axis_enu = Rotation.from_quat(found.pose.wxyz, scalar_first=True).apply([0.0, 0.0, 1.0])
    assert_allclose(math.degrees(math.atan2(axis_enu[0], axis_enu[1])), 40.0)


def test_a_height_bias_raises_the_camera_and_nothing_else():
    assert_allclose(refined(height_m=1.5).pose.position_enu_m, [7.0, -3.0, 41.5])


def test_all_together_at_a_rolled_pose():
    found = refined(sample(roll_deg=0.0), tilt_rad=DEG, heading_rad=-4 * DEG, height_m=-2.0)
    assert_allclose(angles_deg(found), [51.0, 0.0, 26.0], atol=1e-9)
    assert found.pose.position_enu_m[2] == pytest.approx(38.0)
    assert found.calibration == "sha256:x"
    assert found.stamp_ns == 5


def test_the_calibrations_covariance_takes_the_telemetrys_place():
    """Against samples: biases drawn from the covariance, applied to the pose, as errors in camera axes."""
    root = np.diag([0.3, 0.4 * DEG, 0.5 * DEG, 2 * DEG]) @ np.array(
        [[1, 0, 0, 0], [0.6, 0.8, 0, 0], [0, 0, 1, 0], [0, -0.5, 0, math.sqrt(0.75)]]
    )
    given = sample()
    found = refined(given, tilt_rad=DEG, bias_cov=np.pad(root @ root.T, (0, 4)))
    rng = np.random.default_rng(1)
    errors = []
    centre = Rotation.from_quat(found.pose.wxyz, scalar_first=True)
    for height, tilt, roll, heading in (root @ rng.normal(size=(4, 4000))).T:
        drawn = refined(given, height_m=height, tilt_rad=DEG + tilt, roll_rad=roll, heading_rad=heading)
        turned = centre.inv() * Rotation.from_quat(drawn.pose.wxyz, scalar_first=True)
        errors.append([drawn.pose.position_enu_m[2] - 40.0, *turned.as_rotvec()])
    expected = np.cov(np.array(errors).T)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert_allclose(found.pose.cov[2:, 2:] / scale, expected / scale, atol=0.06)
    assert_allclose(found.pose.cov[:2, :2], given.pose.cov[:2, :2])
    std = found.std
    assert_allclose(
        [std.height_agl_m, std.tilt_rad, std.pan_rad, std.roll_rad, std.heading_rad],
        [*np.sqrt(np.diag(root @ root.T))[:2], 0.0, *np.sqrt(np.diag(root @ root.T))[2:]],
    )
    assert (std.horizontal_m, std.time_s) == (2.0, 0.1)


def test_without_a_covariance_the_telemetrys_stays():
    given = sample()
    found = refined(given, tilt_rad=DEG)
    assert_allclose(found.pose.cov, given.pose.cov)
    assert found.std == STD


def test_what_is_not_ok_passes_unchanged():
    calibrator = BiasCalibrator(Calibration(id="x", bias=BiasValues(height_m=1.0)))
    lost = PoseSample(stamp_ns=1, status=Status.STALE_TELEMETRY)
    low = PoseSample(stamp_ns=1, status=Status.BELOW_MIN_HEIGHT, pose=sample().pose)
    bad = PoseBatch.from_samples([lost, low])
    assert calibrator.refine(bad) is bad
    mixed = calibrator.refine(PoseBatch.from_samples([lost, sample(), low]))
    assert (mixed[0].status, mixed[0].pose, mixed[0].calibration) == (lost.status, None, None)
    assert mixed[1].pose.position_enu_m[2] == 41.0
    assert (mixed[2].status, mixed[2].calibration) == (low.status, None)
    assert_allclose(mixed[2].pose.position_enu_m, low.pose.position_enu_m)


def test_above_a_slope_the_corrected_height_still_goes_with_the_place():
    """A camera that is off by 2 m along a 20 % slope, at a known height above it, is off by 0.4 m of height as well."""
    level = sample()
    carried = np.eye(6)
    carried[2, :2] = 0.2, 0.1
    over_slope = replace(level, pose=replace(level.pose, cov=carried @ level.pose.cov @ carried.T))
    cov = refined(over_slope, bias_cov=np.diag([0.25, *[0.0] * 7])).pose.cov[:3, :3]
    place = np.diag([STD.horizontal_m**2] * 2)
    rise = np.array([0.2, 0.1])
    assert_allclose(cov[2, :2], rise @ place)
    assert_allclose(cov[2, 2], 0.25 + rise @ place @ rise)
