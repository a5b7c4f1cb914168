"""Telemetry biases: their prior and decay, poses corrected by them, and the Jacobians of these poses.

The biases are the height's (one for each source, in the configured order), then tilt, pan, roll, heading, east, north
and the time offset of the images. Each is a Gauss-Markov process: within minutes a random walk of the stated rate, in
the long run of the telemetry's standard deviation. An estimate from landmarks so decays when none is seen any more, and
never into less certainty than there was without one.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.geometry import from_rotation_vector, lat_lon, matrix, multiply, pose_covariance, right_jacobian, rotate
from aerodft.model import (
    BIASES,
    HORIZONTAL,
    TIME,
    Calibration,
    FloatArray,
    FloatLike,
    HeightSource,
    IntArray,
    Pose,
    PoseBatch,
    PoseSample,
    PoseStd,
)
from aerodft.service import LiveCalibration, TelemetrySettings

_ANGLES: Final = ("tilt_rad", "pan_rad", "roll_rad", "heading_rad")
_VALUES: Final = ("height_m", *_ANGLES, "east_m", "north_m", "time_s")
_OTHER_COUNT: Final = 7
"""Number of biases behind those of the heights."""
_HEADING, EAST, NORTH, TIME_OFFSET = range(-4, 0)
TURNS: Final = slice(-_OTHER_COUNT, _HEADING)
"""Tilt, pan and roll: a rotation vector about the camera's axes."""
_DOWN: Final = np.array([0.0, 0.0, -1.0])
ORDER: Final = [BIASES.index(each) for each in ("height", "tilt", "pan", "roll", "heading", "east", "north", "time")]
"""Indices in ``BIASES`` of the height and of the seven other biases, in the order of this module."""


@dataclass(frozen=True, slots=True, eq=False)
class BiasModel:
    """Prior of the biases, their decay rates and the noise of single images.

    Attributes:
        heights: The height sources, in the order of their biases.
        mean: ``(k,)``.
        cov: ``(k, k)``.
        rate_per_s: ``(k,)`` decay rates of the estimated biases.
        noise_std: ``(heights, 7)`` std of every image's noise, by height source, in the order of ``PoseStd``.
        stated_std: ``(heights, 7)`` std that the configuration states; infinite for the time, which has no noise.
    """

    heights: tuple[HeightSource, ...]
    mean: FloatArray
    cov: FloatArray
    rate_per_s: FloatArray
    noise_std: FloatArray
    stated_std: FloatArray

    @classmethod
    def from_settings(
        cls, live: LiveCalibration, telemetry: TelemetrySettings, time_std_s: float, start: Calibration | None
    ) -> "BiasModel":
        """Build the model of a station; ``start`` is a calibration whose biases and covariance it starts from."""
        heights, stated = telemetry.height.order, telemetry.attitude.lasting_std
        stated_heights = tuple(telemetry.height.std_m[source] for source in heights)
        share, noise, initial = live.noise_share, live.noise, live.initial
        shared = math.sqrt(1 - share**2)
        others = (*(getattr(stated, each) for each in _ANGLES), stated.horizontal_m, stated.horizontal_m)
        stds = [shared * each for each in (*stated_heights, *others)]
        configured = (
            *([initial.height_agl_m] * len(heights)),
            *(getattr(initial, each) for each in _ANGLES),
            initial.horizontal_m,
            initial.horizontal_m,
        )
        stds = [std if each is None else each for std, each in zip(stds, configured, strict=True)]
        cov = np.diag(np.square([*stds, time_std_s]))
        mean = np.zeros(len(cov))
        if start is not None:
            mean, cov = _with_start(mean, cov, start)
        floor = {each: _or(getattr(noise, each), share * getattr(stated, each)) for each in ("horizontal_m", *_ANGLES)}
        image_stds = [PoseStd(height_agl_m=_or(noise.height_agl_m, share * std), **floor) for std in stated_heights]
        stated_stds = [replace(stated, height_agl_m=std, time_s=math.inf) for std in stated_heights]
        return cls(
            heights=heights,
            mean=mean,
            cov=cov,
            rate_per_s=_rates(np.diag(cov), live, len(heights)),
            noise_std=np.array([each.values for each in image_stds]),
            stated_std=np.array([each.values for each in stated_stds]),
        )

    def height_column(self, sample: PoseSample) -> int:
        """Index of the bias of a sample's height.

        Raises:
            ValueError: Its source is not one of the configured ones.
        """
        return self.heights.index(HeightSource(sample.height_source or ""))

    def with_biases(self, poses: PoseBatch) -> "BiasedPoses":
        """Telemetry poses, each with the bias of its own height."""
        return BiasedPoses.from_poses(poses.pose, poses.by_variant(self.height_column))

    def noise_of(self, std: FloatArray, height_column: IntArray) -> FloatArray:
        """Noise std ``(n, 7)`` of each image: the model's, plus the excess of the pose's std over the stated one.

        Args:
            std: ``(n, 7)`` as ``PoseBatch.std``.
            height_column: ``(n,)`` index of the bias of each pose's height.
        """
        return np.hypot(self.noise_std[height_column], excess_std(std, self.stated_std[height_column]))

    def decayed(self, elapsed_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Remaining share of the estimates and regained variances ``(..., k)`` after times ``(...)``."""
        left = np.exp(-self.rate_per_s * elapsed_s[..., None])
        return left, np.diag(self.cov) * (1 - left**2)

    def by_name(self, sample: PoseSample, values: FloatArray) -> dict[str, float]:
        """Map values ``(k,)``, one a bias, to the names of ``model.calibration.BiasValues``."""
        by_column = [float(values[self.height_column(sample)]), *values[-_OTHER_COUNT:].tolist()]
        return dict(zip(_VALUES, by_column, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class BiasedPoses:
    """Telemetry poses and their dependence on the biases: those of the heights, then the seven others.

    Attributes:
        pose: The ``(...)`` poses.
        height_column: ``(...)`` index of the bias of each pose's height.
        slope: ``(..., 2)`` derivative of each height by east and north, as ``slope_of``.
    """

    pose: Pose
    height_column: IntArray
    slope: FloatArray

    @staticmethod
    def from_poses(pose: Pose, height_column: IntArray) -> "BiasedPoses":
        """Poses ``(...)`` with the bias columns ``(...)`` of their heights."""
        return BiasedPoses(pose, height_column, slope_of(pose))

    def row(self, row: int) -> "BiasedPoses":
        """Select one of ``(n,)`` poses."""
        return BiasedPoses(self.pose.rows(row), self.height_column[row], self.slope[row])

    def for_heights(self, values: FloatArray) -> FloatArray:
        """Select from ``values (..., k)``, one a bias, each pose's own height and the seven others: ``(..., 8)``."""
        own = np.take_along_axis(values, self.height_column[..., None], axis=-1)
        return np.concatenate([own, values[..., -_OTHER_COUNT:]], axis=-1)

    def corrected(self, biases: FloatArray, noise: FloatArray | None = None) -> Pose:
        """Correct the poses by ``biases (..., k)`` and, where given, by their own error ``noise (6,)``."""
        pose, east_north = self.pose, biases[..., EAST:TIME_OFFSET]
        about_vertical = biases[..., [_HEADING]] * _DOWN
        in_camera = from_rotation_vector(self._in_camera(biases))
        wxyz = multiply(from_rotation_vector(about_vertical), multiply(pose.wxyz, in_camera))
        up = np.take_along_axis(biases, self.height_column[..., None], axis=-1)
        up = up + np.sum(self.slope * east_north, axis=-1, keepdims=True)
        shift = np.concatenate([east_north, up], axis=-1) + biases[..., [TIME_OFFSET]] * pose.velocity_enu_mps
        position = pose.position_enu_m + shift
        if noise is not None:
            position, wxyz = position + noise[:3], multiply(wxyz, from_rotation_vector(noise[3:]))
        return replace(pose, position_enu_m=position, wxyz=wxyz)

    def by_biases(self, biases: FloatArray, wxyz: FloatArray) -> FloatArray:
        """Jacobian ``(..., 6, k)`` of the corrected poses (position in ENU, rotation in camera axes) by the biases.

        Args:
            biases: ``(..., k)`` that the poses are corrected by.
            wxyz: ``(..., 4)`` corrected attitudes.
        """
        by = np.zeros((*wxyz.shape[:-1], 6, biases.shape[-1]))
        np.put_along_axis(by[..., 2, :], self.height_column[..., None], 1.0, axis=-1)
        by[..., 0, EAST] = by[..., 1, NORTH] = 1.0
        by[..., 2, EAST:TIME_OFFSET] = self.slope
        turn = right_jacobian(self._in_camera(biases))
        by[..., 3:, TURNS] = turn
        by[..., 3:, _HEADING] = -matrix(wxyz)[..., 2, :]  # clockwise is about straight down
        by[..., :3, TIME_OFFSET] = self.pose.velocity_enu_mps
        by[..., 3:, TIME_OFFSET] = rotate(turn, self.pose.rate_cam_radps)
        return by

    def by_biases_of_corrected_stamps(self, biases: FloatArray, wxyz: FloatArray) -> FloatArray:
        """Jacobian by the biases of poses interpolated at corrected stamps, without a time bias.

        Their rates are about the axes before the correction.
        """
        by = self.by_biases(biases, wxyz)
        before = matrix(from_rotation_vector(biases[..., TURNS]))
        by[..., 3:, TIME_OFFSET] = (self.pose.rate_cam_radps[..., None, :] @ before)[..., 0, :]
        return by

    def noise_covariance(self, wxyz: FloatArray, std: FloatArray) -> FloatArray:
        """Covariance ``(..., 6, 6)`` of the noise of single images' poses.

        Args:
            wxyz: ``(..., 4)`` corrected attitudes.
            std: ``(..., 7)`` of these errors, in the order of ``PoseStd``, broadcast.
        """
        jac = np.broadcast_to(np.eye(6), (*wxyz.shape[:-1], 6, 6)).copy()
        jac[..., 2, :2] = self.slope
        return propagate_covariance(jac, pose_covariance(wxyz, std))

    def _in_camera(self, biases: FloatArray) -> FloatArray:
        return biases[..., TURNS] + biases[..., [TIME_OFFSET]] * self.pose.rate_cam_radps


def propagate_covariance(by: FloatArray, cov: FloatArray) -> FloatArray:
    """Propagate ``cov (..., k, k)`` through Jacobians ``by (..., m, k)`` to ``(..., m, m)``."""
    return np.asarray(by @ cov @ np.swapaxes(by, -1, -2))


def stds_of(variances: FloatArray) -> FloatArray:
    """Standard deviations ``(..., 7)`` in the order of ``PoseStd`` from the variances ``(..., 8)`` of biases.

    Args:
        variances: Of the height, and of the seven other biases.
    """
    height, tilt, pan, roll, heading, east, north, time = np.moveaxis(np.sqrt(variances), -1, 0)
    return np.stack([height, np.hypot(east, north) / math.sqrt(2), tilt, pan, roll, heading, time], axis=-1)


def biases_of(found: Calibration) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
    """Biases ``(8,)`` of a calibration, height first, with their covariance and that with the lens.

    Images' stamps are moved by the time offset before poses are interpolated: the remaining time bias is around 0.
    """
    biases = np.array([getattr(replace(found.bias, time_s=0.0), name) for name in _VALUES])
    cov = None if found.bias_cov is None else found.bias_cov[np.ix_(ORDER, ORDER)]
    return biases, cov, None if found.lens_cov is None else found.lens_cov[ORDER]


def with_lat_lon(poses: PoseBatch) -> PoseBatch:
    """Recompute latitude and longitude of corrected poses."""
    lat_lon_alt = poses.lat_lon_alt.copy()
    origins = list(dict.fromkeys(variant.origin for variant in poses.variants))
    own = poses.by_variant(lambda variant: origins.index(variant.origin))
    for index, origin in enumerate(origins):
        if origin is not None:
            rows = own == index
            lat_lon_alt[rows, :2] = lat_lon(origin, poses.pose.position_enu_m[rows, :2])
    return replace(poses, lat_lon_alt=lat_lon_alt)


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def excess_std(now: FloatLike, stated: FloatLike) -> FloatArray:
    """Root of the excess of variances over the stated ones; 0 where there is none."""
    return np.asarray(np.sqrt(np.maximum(np.square(now) - np.square(stated), 0.0)))


def _with_start(mean: FloatArray, cov: FloatArray, start: Calibration) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of the biases from a calibration; its height bias is that of every source."""
    found, found_cov, _ = biases_of(start)
    by_found = np.zeros((len(mean), len(found)))
    by_found[:-_OTHER_COUNT, 0] = 1.0
    by_found[-_OTHER_COUNT:, 1:] = np.eye(_OTHER_COUNT)
    if found_cov is None:
        return by_found @ found, cov
    start_cov = propagate_covariance(by_found, found_cov)
    is_unknown = np.zeros(len(mean))
    columns = [EAST, NORTH, TIME_OFFSET]
    is_unknown[columns] = np.diag(start_cov)[columns] == 0
    return by_found @ found, is_unknown[:, None] * cov * is_unknown + start_cov


def _rates(variances: FloatArray, live: LiveCalibration, heights: int) -> FloatArray:
    """Decay rates at which biases with a random walk of the stated drift keep their variance."""
    drift = live.drift
    others = (*(getattr(drift, each) for each in _ANGLES), drift.horizontal_m, drift.horizontal_m, 0.0)
    walk_variance = np.square([each or 0.0 for each in (*([drift.height_agl_m] * heights), *others)])
    return np.divide(walk_variance, 2 * variances, out=np.zeros_like(walk_variance), where=variances > 0)


def slope_of(pose: Pose) -> FloatArray:
    """Derivatives of heights by east and north ``(..., 2)``, for heights above ground that is not level."""
    cross_cov, position_cov = pose.cov[..., 2, :2], pose.cov[..., :2, :2]
    slope, is_sloped = np.zeros_like(cross_cov), np.any(cross_cov, axis=-1)
    if np.any(is_sloped):
        slope[is_sloped] = (cross_cov[is_sloped][:, None] @ np.linalg.pinv(position_cov[is_sloped]))[:, 0]
    return slope


class BiasCalibrator:
    """Implements ``service.ports.Calibrator`` with the fixed biases of one calibration.

    The calibration's covariance takes the place of the telemetry's for height and attitude, and for place and time
    where it has them: it is the corrected pose's. The time offset itself moves the images' stamps, before poses are
    interpolated.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._biases, self._cov, self._with_lens = biases_of(calibration)

    def known(self) -> None:
        """Return nothing: biases stay those of the calibration."""

    def refine(self, poses: PoseBatch, *_: object) -> PoseBatch:
        """Correct poses and mark them with the calibration's id; samples that are not ok pass unchanged."""
        return poses.where(poses.is_ok, self._correct)

    def _correct(self, poses: PoseBatch, _: IntArray) -> PoseBatch:
        biases = np.tile(self._biases, (len(poses), 1))
        biased = BiasedPoses.from_poses(poses.pose, np.zeros(len(poses), dtype=np.int64))
        pose, std = biased.corrected(biases), poses.std
        if self._cov is not None:
            pose, std = self._with_covariance(biased, biases, pose, self._cov), self._corrected_std(std, self._cov)
        marked = poses.map_variants(lambda sample: replace(sample, calibration=self._calibration.id))
        refined = replace(marked, pose=pose, std=std)
        return with_lat_lon(refined) if np.any(self._biases[[EAST, NORTH]]) else refined

    def _with_covariance(self, biased: BiasedPoses, biases: FloatArray, pose: Pose, bias_cov: FloatArray) -> Pose:
        """Corrected poses with their covariance, including the calibration's."""
        by_bias = biased.by_biases_of_corrected_stamps(biases, pose.wxyz)
        cov = propagate_covariance(by_bias, bias_cov)
        cov += biased.noise_covariance(pose.wxyz, self._calibration.noise.values)
        if not bias_cov[EAST, EAST] + bias_cov[NORTH, NORTH]:
            place = by_bias[:, :3, [EAST, NORTH]]
            cov[:, :3, :3] += propagate_covariance(place, pose.cov[:, :2, :2])
        return replace(
            pose,
            cov=cov,
            lens_cov=pose.lens_cov if self._with_lens is None else by_bias @ self._with_lens,
            time_std_s=0.0 if bias_cov[TIME_OFFSET, TIME_OFFSET] else pose.time_std_s,
        )

    def _corrected_std(self, before: FloatArray, bias_cov: FloatArray) -> FloatArray:
        """Std ``(n, 7)`` of ``PoseBatch.std``: telemetry's for place and time where the calibration has none."""
        known = stds_of(np.diag(bias_cov))
        std = np.tile(known, (len(before), 1))
        for column in (HORIZONTAL, TIME):
            std[:, column] = known[column] or before[:, column]
        return np.hypot(std, replace(self._calibration.noise, time_s=0.0).values)
