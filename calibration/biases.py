"""Corrections of the telemetry that a calibration found, applied to every pose."""

import math
from dataclasses import replace

import numpy as np

from aerodft.geometry.poses import pose_covariance
from aerodft.geometry.rotation import from_rotation_vector, matrix, multiply, right_jacobian
from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import BIASES, Calibration
from aerodft.model.pose import Pose, PoseSample, PoseStd
from aerodft.model.status import Status
from calibration.live_model import relocated, slope_of

_HEIGHT, _TILT, _ROLL, _HEADING, _PAN, _EAST, _NORTH, _TIME = range(len(BIASES))


class BiasCalibrator:
    """Implements ``service.ports.Calibrator`` with the fixed biases of one calibration.

    The calibration's covariance takes the place of the telemetry's for height and attitude, and for place and time
    where it has them: it says how well the corrected pose is known. The time offset itself moves the images' stamps,
    before poses are looked up.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration

    def refine(self, sample: PoseSample) -> PoseSample:
        """The corrected pose with the calibration's id; a sample that is not ok passes unchanged."""
        if sample.pose is None or sample.status is not Status.OK:
            return sample
        found, pose = self._calibration, sample.pose
        turned = multiply(pose.wxyz, from_rotation_vector(self._in_camera()))
        about_vertical = np.array([0.0, 0.0, -found.heading_bias_rad])
        wxyz = multiply(from_rotation_vector(about_vertical), turned)
        place = np.array([found.east_bias_m, found.north_bias_m])
        up = found.height_bias_m + float(slope_of(pose) @ place)
        corrected = replace(pose, position_enu_m=pose.position_enu_m + np.append(place, up), wxyz=wxyz)
        if found.bias_cov is not None:
            corrected = self._known(corrected, found.bias_cov)
        refined = replace(sample, pose=corrected, std=self._stds(sample), calibration=found.id)
        return relocated(refined, corrected) if np.any(place) else refined

    def _in_camera(self) -> FloatArray:
        found = self._calibration
        return np.array([found.tilt_bias_rad, found.pan_bias_rad, found.roll_bias_rad])

    def _known(self, pose: Pose, bias_cov: FloatArray) -> Pose:
        """The corrected pose with how well it is known."""
        by_bias, slope = self._by_biases(pose), slope_of(pose)
        follows = np.eye(6)
        follows[2, :2] = slope
        cov = by_bias @ bias_cov @ by_bias.T + follows @ pose_covariance(pose.wxyz, self._calibration.noise) @ follows.T
        if not bias_cov[_EAST, _EAST] + bias_cov[_NORTH, _NORTH]:
            place = follows[:3, :2]
            cov[:3, :3] += place @ pose.cov[:2, :2] @ place.T
        lens = self._calibration.lens_cov
        return replace(
            pose,
            cov=cov,
            lens_cov=pose.lens_cov if lens is None else by_bias @ lens,
            time_std_s=0.0 if bias_cov[_TIME, _TIME] else pose.time_std_s,
        )

    def _by_biases(self, pose: Pose) -> FloatArray:
        """``(6, 8)``: errors of the corrected pose, as ``Pose.cov`` counts them, by the biases."""
        by_bias = np.zeros((6, len(BIASES)))
        by_bias[[2, 0, 1], [_HEIGHT, _EAST, _NORTH]] = 1.0
        by_bias[2, [_EAST, _NORTH]] = slope_of(pose)
        by_bias[3:, [_TILT, _PAN, _ROLL]] = right_jacobian(self._in_camera())
        by_bias[3:, _HEADING] = -matrix(pose.wxyz)[2]  # clockwise is about straight down
        by_bias[:3, _TIME] = pose.velocity_enu_mps
        by_bias[3:, _TIME] = matrix(from_rotation_vector(self._in_camera())).T @ pose.rate_cam_radps
        return by_bias

    def _stds(self, sample: PoseSample) -> PoseStd:
        cov, noise, before = self._calibration.bias_cov, self._calibration.noise, sample.std
        if cov is None:
            return before
        std = np.sqrt(np.diag(cov))
        horizontal_m = math.hypot(std[_EAST], std[_NORTH]) / math.sqrt(2)
        return PoseStd(
            height_agl_m=math.hypot(std[_HEIGHT], noise.height_agl_m),
            horizontal_m=math.hypot(horizontal_m or before.horizontal_m, noise.horizontal_m),
            tilt_rad=math.hypot(std[_TILT], noise.tilt_rad),
            pan_rad=math.hypot(std[_PAN], noise.pan_rad),
            roll_rad=math.hypot(std[_ROLL], noise.roll_rad),
            heading_rad=math.hypot(std[_HEADING], noise.heading_rad),
            time_s=float(std[_TIME]) or before.time_s,
        )
