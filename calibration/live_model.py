"""How a pose depends on the biases of its telemetry, and how these come and go.

The biases are the height's (one for each source, in the configured order), then tilt, pan, roll, heading, east, north
and the time offset of the images. Each is a Gauss-Markov process: within minutes a random walk of the stated rate, in
the long run what the telemetry's standard deviation says; so what a landmark taught fades when none is seen any more,
and never into less certainty than there was without one.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.geometry.poses import pose_covariance
from aerodft.geometry.rotation import from_rotation_vector, matrix, multiply, right_jacobian
from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import BIASES, Calibration
from aerodft.model.pose import HeightSource, Pose, PoseSample, PoseStd
from aerodft.service.settings import LiveCalibration, TelemetrySettings
from calibration.biases import combined_std, excess, slope_of, turned_by

ANGLES: Final = ("tilt_rad", "pan_rad", "roll_rad", "heading_rad")
_TILT, _PAN, _ROLL, _HEADING, _EAST, _NORTH, _TIME = range(-7, 0)
_OTHERS = 7
_SHARED: Final = (*ANGLES, "horizontal_m")  # stds that are those of any height source


@dataclass(frozen=True, slots=True, eq=False)
class BiasModel:
    """What is known of the biases before a landmark was seen.

    Attributes:
        heights: The height sources, in the order of their biases.
        mean: ``(k,)``.
        cov: ``(k, k)``.
        rate_per_s: ``(k,)`` at which what was learned is forgotten.
        noise_height_m: Std of what is new in every image, by height source.
        noise: The same of all other errors.
        stated_height_m: Std that the configuration states, by height source.
        stated: The same of all other errors.
    """

    heights: tuple[HeightSource, ...]
    mean: FloatArray
    cov: FloatArray
    rate_per_s: FloatArray
    noise_height_m: tuple[float, ...]
    noise: PoseStd
    stated_height_m: tuple[float, ...]
    stated: PoseStd

    @classmethod
    def of(
        cls, live: LiveCalibration, telemetry: TelemetrySettings, time_std_s: float, start: Calibration | None
    ) -> "BiasModel":
        """The model of a station; ``start`` is a calibration whose biases and covariance are where it begins."""
        heights, stated = telemetry.height.order, telemetry.attitude.lasting_std
        stated_heights = tuple(telemetry.height.std_m[source] for source in heights)
        share, noise, initial = live.noise_share, live.noise, live.initial
        shared = math.sqrt(1 - share**2)
        others = (*(getattr(stated, each) for each in ANGLES), stated.horizontal_m, stated.horizontal_m)
        stds = [shared * each for each in (*stated_heights, *others)]
        given = (
            *([initial.height_m] * len(heights)),
            *(getattr(initial, each) for each in ANGLES),
            initial.horizontal_m,
            initial.horizontal_m,
        )
        stds = [std if each is None else each for std, each in zip(stds, given, strict=True)]
        cov = np.diag(np.square([*stds, time_std_s]))
        mean = np.zeros(len(cov))
        if start is not None:
            mean, cov = _started(mean, cov, start)
        return cls(
            heights=heights,
            mean=mean,
            cov=cov,
            rate_per_s=_rates(np.diag(cov), live, len(heights)),
            noise_height_m=tuple(share * std if noise.height_m is None else noise.height_m for std in stated_heights),
            noise=PoseStd(**{each: _or(getattr(noise, each), share * getattr(stated, each)) for each in _SHARED}),
            stated_height_m=stated_heights,
            stated=stated,
        )

    def height_column(self, sample: PoseSample) -> int:
        """Which bias is that of a sample's height.

        Raises:
            ValueError: Its source is not one of the configured ones.
        """
        return self.heights.index(HeightSource(sample.height_source or ""))

    def noise_of(self, sample: PoseSample) -> PoseStd:
        """What is new in one image: the model's noise, and by how much the sample is worse than stated."""
        column = self.height_column(sample)
        more = {each: excess(getattr(sample.std, each), getattr(self.stated, each)) for each in _SHARED}
        excess_m = excess(sample.std.height_agl_m, self.stated_height_m[column])
        noise = replace(self.noise, height_agl_m=self.noise_height_m[column])
        return combined_std(noise, PoseStd(height_agl_m=excess_m, **more))

    def noise_covariance(self, sample: PoseSample, wxyz: FloatArray) -> FloatArray:
        """``(6, 6)`` of the pose's errors that are new in one image; ``wxyz`` is the refined attitude."""
        follows = np.eye(6)
        if sample.pose is not None:
            follows[2, :2] = slope_of(sample.pose)
        return np.asarray(follows @ pose_covariance(wxyz, self.noise_of(sample)) @ follows.T)

    def drifted(self, elapsed_s: float) -> tuple[FloatArray, FloatArray]:
        """What is left of what was learned after a time, ``(k,)``, and the variances ``(k,)`` that have come back."""
        left = np.exp(-self.rate_per_s * elapsed_s)
        return left, np.diag(self.cov) * (1 - left**2)

    def corrected(self, sample: PoseSample, biases: FloatArray, noise: FloatArray | None = None) -> Pose:
        """The sample's pose without ``biases (k,)``, and where given without ``noise (6,)``, an error of the pose."""
        pose = sample.pose
        if pose is None:
            raise ValueError("the sample has no pose")
        by_time = biases[_TIME]
        in_camera = biases[[_TILT, _PAN, _ROLL]] + by_time * pose.rate_cam_radps
        wxyz = turned_by(pose.wxyz, in_camera, float(biases[_HEADING]))
        east_north = biases[[_EAST, _NORTH]]
        up = biases[self.height_column(sample)] + slope_of(pose) @ east_north
        position = pose.position_enu_m + np.append(east_north, up) + by_time * pose.velocity_enu_mps
        if noise is not None:
            position, wxyz = position + noise[:3], multiply(wxyz, from_rotation_vector(noise[3:]))
        return replace(pose, position_enu_m=position, wxyz=wxyz)

    def by_biases(self, sample: PoseSample, biases: FloatArray, wxyz: FloatArray) -> FloatArray:
        """The corrected pose (position in ENU, rotation in camera axes) by the biases, ``(6, k)``.

        Args:
            sample: The pose by telemetry alone.
            biases: ``(k,)`` that it is corrected by.
            wxyz: The corrected attitude.
        """
        pose = sample.pose
        if pose is None:
            raise ValueError("the sample has no pose")
        by = np.zeros((6, len(self.mean)))
        by[2, self.height_column(sample)] = 1.0
        by[0, _EAST] = by[1, _NORTH] = 1.0
        by[2, [_EAST, _NORTH]] = slope_of(pose)
        turn = right_jacobian(biases[[_TILT, _PAN, _ROLL]] + biases[_TIME] * pose.rate_cam_radps)
        by[3:, [_TILT, _PAN, _ROLL]] = turn
        by[3:, _HEADING] = -matrix(wxyz)[2, :]  # clockwise is about straight down
        by[:3, _TIME], by[3:, _TIME] = pose.velocity_enu_mps, turn @ pose.rate_cam_radps
        return by

    def said(self, sample: PoseSample, values: FloatArray) -> dict[str, float]:
        """Numbers ``(k,)``, one a bias, by the names of ``model.estimate.BiasValues``."""
        names = (*ANGLES, "east_m", "north_m", "time_s")
        rest = dict(zip(names, values[-_OTHERS:].tolist(), strict=True))
        return {"height_m": float(values[self.height_column(sample)]), **rest}


def _or(given: float | None, default: float) -> float:
    return default if given is None else given


def _started(mean: FloatArray, cov: FloatArray, start: Calibration) -> tuple[FloatArray, FloatArray]:
    """Biases as a calibration has them: of whatever height is in use, and with the heading it takes the pan's place.

    Images' stamps are moved by its time offset before poses are looked up: what is left of it is around 0.
    """
    by_found = np.zeros((len(mean), len(BIASES)))
    by_found[:-_OTHERS, 0] = 1.0
    columns = [BIASES.index(name) for name in ("tilt", "pan", "roll", "heading", "east", "north", "time")]
    by_found[range(-_OTHERS, 0), columns] = 1.0
    found = np.array(
        [
            start.height_bias_m,
            start.tilt_bias_rad,
            start.roll_bias_rad,
            start.heading_bias_rad,
            start.pan_bias_rad,
            start.east_bias_m,
            start.north_bias_m,
            0.0,
        ]
    )
    if start.bias_cov is None:
        return by_found @ found, cov
    told = by_found @ start.bias_cov @ by_found.T
    kept = np.zeros(len(mean))
    kept[[_EAST, _NORTH, _TIME]] = np.diag(told)[[_EAST, _NORTH, _TIME]] == 0
    return by_found @ found, kept[:, None] * cov * kept + told


def _rates(variances: FloatArray, live: LiveCalibration, heights: int) -> FloatArray:
    """At which biases that walk at random by the stated drift are pulled back, to keep their variance."""
    drift = live.drift
    others = (*(getattr(drift, each) for each in ANGLES), drift.horizontal_m, drift.horizontal_m, 0.0)
    walked = np.square([each or 0.0 for each in (*([drift.height_m] * heights), *others)])
    return np.divide(walked, 2 * variances, out=np.zeros_like(walked), where=variances > 0)
