"""Corrections of the telemetry that a calibration found, applied to every pose."""

from dataclasses import astuple, replace

import numpy as np

from aerodft.geometry.rotation import from_rotation_vector, matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import Calibration
from aerodft.model.pose import Pose
from aerodft.model.pose_batch import HORIZONTAL, TIME, PoseBatch
from calibration.live_model import (
    EAST,
    NORTH,
    TIME_OFFSET,
    TURNS,
    BiasedPoses,
    biases_of,
    propagated,
    relocated,
    stds_of,
)


class BiasCalibrator:
    """Implements ``service.ports.Calibrator`` with the fixed biases of one calibration.

    The calibration's covariance takes the place of the telemetry's for height and attitude, and for place and time
    where it has them: it says how well the corrected pose is known. The time offset itself moves the images' stamps,
    before poses are looked up.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._biases, self._cov, self._with_lens = biases_of(calibration)

    def refine(self, poses: PoseBatch) -> PoseBatch:
        """The corrected poses with the calibration's id; samples that are not ok pass unchanged."""
        return poses.where_ok(self._refined)

    def _refined(self, poses: PoseBatch) -> PoseBatch:
        biases = np.tile(self._biases, (len(poses), 1))
        biased = BiasedPoses.of(poses.pose, np.zeros(len(poses), dtype=np.int64))
        pose, std = biased.corrected(biases), poses.std
        if self._cov is not None:
            pose, std = self._known(biased, biases, pose, self._cov), self._stds(std, self._cov)
        named = poses.all_varied(lambda sample: replace(sample, calibration=self._calibration.id))
        refined = replace(named, pose=pose, std=std)
        return relocated(refined) if np.any(self._biases[[EAST, NORTH]]) else refined

    def _known(self, biased: BiasedPoses, biases: FloatArray, pose: Pose, bias_cov: FloatArray) -> Pose:
        """The corrected poses with how well they are known."""
        by_bias = biased.by_biases(biases, pose.wxyz)
        # Here a pose is looked up at its corrected stamp: its rate is about the axes before the turn.
        by_bias[:, 3:, TIME_OFFSET] = pose.rate_cam_radps @ matrix(from_rotation_vector(self._biases[TURNS]))
        noise = np.array(astuple(self._calibration.noise))
        cov = propagated(by_bias, bias_cov) + biased.noise_covariance(pose.wxyz, noise)
        if not bias_cov[EAST, EAST] + bias_cov[NORTH, NORTH]:
            place = by_bias[:, :3, [EAST, NORTH]]
            cov[:, :3, :3] += propagated(place, pose.cov[:, :2, :2])
        return replace(
            pose,
            cov=cov,
            lens_cov=pose.lens_cov if self._with_lens is None else by_bias @ self._with_lens,
            time_std_s=0.0 if bias_cov[TIME_OFFSET, TIME_OFFSET] else pose.time_std_s,
        )

    def _stds(self, before: FloatArray, bias_cov: FloatArray) -> FloatArray:
        """``(n, 7)`` as ``PoseBatch.std``: the telemetry's for place and time where the calibration has none."""
        known = stds_of(np.diag(bias_cov))
        std = np.tile(known, (len(before), 1))
        for column in (HORIZONTAL, TIME):
            std[:, column] = known[column] or before[:, column]
        noise = replace(self._calibration.noise, time_s=0.0)
        return np.hypot(std, astuple(noise))
