"""Poses corrected by what telemetry is off by, and the biases of a calibration applied to every pose."""

import math
from dataclasses import fields, replace

import numpy as np

from aerodft.geometry.geodesy import lat_lon
from aerodft.geometry.poses import pose_covariance
from aerodft.geometry.rotation import from_rotation_vector, matrix, multiply, right_jacobian
from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import BIASES, Calibration
from aerodft.model.pose import Pose, PoseSample, PoseStd
from aerodft.model.status import Status

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
        wxyz = turned_by(pose.wxyz, self._in_camera(), found.heading_bias_rad)
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
        slope = slope_of(pose)
        by_bias = by_biases(self._in_camera(), -matrix(pose.wxyz)[2], pose.velocity_enu_mps, pose.rate_cam_radps)
        by_bias[2, [_EAST, _NORTH]] = slope
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

    def _stds(self, sample: PoseSample) -> PoseStd:
        cov, noise, before = self._calibration.bias_cov, self._calibration.noise, sample.std
        if cov is None:
            return before
        height, tilt, roll, heading, pan, east, north, time = np.sqrt(np.diag(cov)).tolist()
        found = PoseStd(
            height_agl_m=height,
            horizontal_m=math.hypot(east, north) / math.sqrt(2) or before.horizontal_m,
            tilt_rad=tilt,
            pan_rad=pan,
            roll_rad=roll,
            heading_rad=heading,
        )
        return replace(combined_std(found, noise), time_s=time or before.time_s)


def turned_by(wxyz: FloatArray, in_camera_rad: FloatArray, heading_rad: float) -> FloatArray:
    """An attitude corrected by a rotation vector ``(3,)`` in camera axes, and clockwise about the vertical."""
    about_vertical = from_rotation_vector(np.array([0.0, 0.0, -heading_rad]))
    return multiply(about_vertical, multiply(wxyz, from_rotation_vector(in_camera_rad)))


def by_biases(
    in_camera_rad: FloatArray, down_cam: FloatArray, velocity_mps: FloatArray, rate_cam_radps: FloatArray
) -> FloatArray:
    """``(6, 8)``: errors of a corrected pose, as ``Pose.cov`` counts them, by the biases, as ``BIASES``.

    Args:
        in_camera_rad: ``(3,)`` the rotation vector that the attitude was corrected by.
        down_cam: ``(3,)`` straight down, in axes of the corrected camera.
        velocity_mps: ``(3,)`` east, north, up.
        rate_cam_radps: ``(3,)`` in camera axes, before the correction.
    """
    by_bias = np.zeros((6, len(BIASES)))
    by_bias[[2, 0, 1], [_HEIGHT, _EAST, _NORTH]] = 1.0
    by_bias[3:, [_TILT, _PAN, _ROLL]] = right_jacobian(in_camera_rad)
    by_bias[3:, _HEADING] = down_cam  # about which it is clockwise
    by_bias[:3, _TIME] = velocity_mps
    by_bias[3:, _TIME] = matrix(from_rotation_vector(in_camera_rad)).T @ rate_cam_radps
    return by_bias


def combined_std(one: PoseStd, other: PoseStd) -> PoseStd:
    """Of the sum of errors that have nothing to do with each other."""
    each = {field.name: math.hypot(getattr(one, field.name), getattr(other, field.name)) for field in fields(PoseStd)}
    return PoseStd(**each)


def excess(now: float, stated: float) -> float:
    """What is new in a standard deviation that is larger than the stated one; 0 in any other."""
    return math.sqrt(max(now**2 - stated**2, 0.0))


def slope_of(pose: Pose) -> FloatArray:
    """By how much the height follows east and north ``(2,)``: where it is counted from ground that is not level."""
    if not np.any(pose.cov[2, :2]):
        return np.zeros(2)
    return np.asarray(pose.cov[2, :2] @ np.linalg.pinv(pose.cov[:2, :2]))


def relocated(sample: PoseSample, pose: Pose) -> PoseSample:
    """The sample with a corrected pose, and with the latitude and longitude of that."""
    if sample.origin is None:
        return replace(sample, pose=pose)
    lat_rad, lon_rad = lat_lon(sample.origin, pose.position_enu_m[:2]).tolist()
    return replace(sample, pose=pose, lat_rad=lat_rad, lon_rad=lon_rad)
