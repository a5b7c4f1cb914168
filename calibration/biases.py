"""Corrections of height, tilt, roll and heading that a calibration found, applied to every pose."""

from dataclasses import replace

import numpy as np

from aerodft.geometry.rotation import from_rotation_vector, matrix, multiply
from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import Calibration
from aerodft.model.pose import Pose, PoseSample, PoseStd
from aerodft.model.status import Status


class BiasCalibrator:
    """Implements ``service.ports.Calibrator`` with the fixed biases of one calibration.

    The calibration's covariance takes the place of the telemetry's for height and attitude: it says how well the
    corrected pose is known.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration

    def refine(self, sample: PoseSample) -> PoseSample:
        """The corrected pose with the calibration's id; a sample that is not ok passes unchanged."""
        if sample.pose is None or sample.status is not Status.OK:
            return sample
        found, pose = self._calibration, sample.pose
        in_camera = np.array([found.tilt_bias_rad, 0.0, found.roll_bias_rad])
        turned = multiply(pose.wxyz, from_rotation_vector(in_camera))
        about_vertical = np.array([0.0, 0.0, -found.heading_bias_rad])
        wxyz = multiply(from_rotation_vector(about_vertical), turned)
        position = pose.position_enu_m + np.array([0.0, 0.0, found.height_bias_m])
        corrected = replace(pose, position_enu_m=position, wxyz=wxyz, cov=self._covariance(pose, wxyz))
        return replace(sample, pose=corrected, std=self._stds(sample), calibration=found.id)

    def _covariance(self, pose: Pose, wxyz: FloatArray) -> FloatArray:
        if self._calibration.bias_cov is None:
            return pose.cov
        by_bias = np.zeros((6, 4))
        by_bias[2, 0] = by_bias[3, 1] = by_bias[5, 2] = 1.0
        by_bias[3:, 3] = -matrix(wxyz)[2, :]  # clockwise is about straight down
        cov = by_bias @ self._calibration.bias_cov @ by_bias.T
        slope = pose.cov[2, :2] @ np.linalg.pinv(pose.cov[:2, :2])  # a height above sloping ground goes with the place
        follows = np.vstack([np.eye(2), slope])
        cov[:3, :3] += follows @ pose.cov[:2, :2] @ follows.T
        return np.asarray(cov)

    def _stds(self, sample: PoseSample) -> PoseStd:
        cov = self._calibration.bias_cov
        if cov is None:
            return sample.std
        height, tilt, roll, heading = np.sqrt(np.diag(cov)).tolist()
        return replace(sample.std, height_agl_m=height, tilt_rad=tilt, pan_rad=0.0, roll_rad=roll, heading_rad=heading)
