"""An iterated Kalman filter over the biases of a vehicle's telemetry, fed with one landmark's pixel at a time.

The biases are the height's (one for each source, in the configured order), then tilt, pan, roll, heading, east, north
and the time offset of the images. Each is a Gauss-Markov process: within minutes a random walk of the stated rate, in
the long run what the telemetry's standard deviation says; so what a landmark taught fades when none is seen any more,
and never into less certainty than there was without one.

Beside the biases its state holds what would make it too sure of itself: the errors that are new in the current image
and shared by all landmarks in it, the surveyor's error of each landmark, and the lens's. The lens is considered, never
estimated (Schmidt): its errors are the camera file's, and the pose's correlation with them is kept.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.intrinsics import intrinsics_covariance
from aerodft.geometry.poses import pose_covariance
from aerodft.geometry.reprojection import reproject
from aerodft.geometry.rotation import from_rotation_vector, matrix, multiply, right_jacobian
from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import BIASES, Calibration
from aerodft.model.camera import Camera
from aerodft.model.marker import SurveyedLandmark
from aerodft.model.pose import HeightSource, Pose, PoseSample, PoseStd
from aerodft.service.settings import LiveCalibration, TelemetrySettings
from calibration.biases import combined_std, excess, slope_of, turned_by

ANGLES: Final = ("tilt_rad", "pan_rad", "roll_rad", "heading_rad")
_TILT, _PAN, _ROLL, _HEADING, _EAST, _NORTH, _TIME = range(-7, 0)
_OTHERS = 7
_SHARED: Final = (*ANGLES, "horizontal_m")  # stds that are those of any height source
_ITERATIONS = 6
_CURVED = 0.01
"""Of a sight's std: an error of linearisation that is not worth another iteration."""

_POSE = 6
_STRAY_PX = 50.0
"""How far off, about, an observation of something else is: what a tracker takes for the landmark is near it."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One pixel that is said to be a landmark's.

    Attributes:
        sample: The image's pose, by telemetry alone.
        landmark: The landmark.
        pixel: ``(2,)``.
        std_px: Of each coordinate.
    """

    sample: PoseSample
    landmark: SurveyedLandmark
    pixel: FloatArray
    std_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """A sight against the state.

    Attributes:
        px: ``(2,)`` observed minus expected; NaN where there is no view.
        cov_px2: ``(2, 2)`` of that.
        by_state: ``(2, n)`` of the expected pixel by the state.
    """

    px: FloatArray
    cov_px2: FloatArray
    by_state: FloatArray

    @property
    def chi2(self) -> float:
        """Squared distance in standard deviations; NaN where there is no view."""
        return float(self.px @ np.linalg.solve(self.cov_px2, self.px)) if np.all(np.isfinite(self.px)) else math.nan


class BiasFilter:
    """The state; a function of the sights that it was given, in their order.

    Args:
        model: The biases before anything was seen.
        camera: The camera.
        landmarks: All of them.
        outlier_share: Share of sights that are something else.
    """

    def __init__(
        self, model: BiasModel, camera: Camera, landmarks: tuple[SurveyedLandmark, ...], outlier_share: float
    ) -> None:
        self._model = model
        self._camera = camera
        self._landmarks = landmarks
        self._outlier_share = outlier_share
        lens = intrinsics_covariance(camera)
        uncertain = [each for each in landmarks if any(each.std_m)]
        biases = len(model.mean)
        self._biases = slice(0, biases)
        self._image = slice(biases, biases + _POSE)
        self._lens = slice(self._image.stop, self._image.stop + (len(lens) if np.any(lens) else 0))
        self._places = {each.name: slice(s, s + 3) for s, each in zip(_from(self._lens.stop), uncertain, strict=False)}
        self.restart()

    def restart(self) -> None:
        """Forget everything that was learned."""
        size = self._lens.stop + 3 * len(self._places)
        self._mean, self._cov = np.zeros(size), np.zeros((size, size))
        self._mean[self._biases], self._cov[self._biases, self._biases] = self._model.mean, self._model.cov
        if self._lens.stop > self._lens.start:
            self._cov[self._lens, self._lens] = intrinsics_covariance(self._camera)
        for each in self._landmarks:
            if each.name in self._places:
                place = self._places[each.name]
                self._cov[place, place] = np.diag(np.square(each.std_m))
        self._stamp_ns: int | None = None
        self._image_ns: int | None = None

    def biases(self, stamp_ns: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The biases at a stamp: mean ``(k,)``, covariance ``(k, k)`` and that with the lens ``(k, m or 0)``."""
        mean, cov = self._drifted(stamp_ns)
        return mean[self._biases], cov[self._biases, self._biases], cov[self._biases, self._lens]

    def look(self, sample: PoseSample) -> None:
        """Go to an image: all that comes next is seen in it. An earlier one than the last is looked at from here."""
        if self._stamp_ns is None or sample.stamp_ns > self._stamp_ns:
            self._mean, self._cov = self._drifted(sample.stamp_ns)
            self._stamp_ns = sample.stamp_ns
        if sample.stamp_ns == self._image_ns:
            return
        self._image_ns = sample.stamp_ns
        pose = self._model.corrected(sample, self._mean[self._biases])
        self._mean[self._image] = 0.0
        self._cov[self._image, :] = self._cov[:, self._image] = 0.0
        noise = self._model.noise_covariance(sample, pose.wxyz)
        if sample.stamp_ns < self._stamp_ns:  # the biases of then are not quite those of now
            _, returned = self._model.drifted((self._stamp_ns - sample.stamp_ns) / SECOND_NS)
            by = self._model.by_biases(sample, self._mean[self._biases], pose.wxyz)
            noise = noise + by * returned @ by.T
        self._cov[self._image, self._image] = noise

    def expect(self, sight: Sight) -> Expectation:
        """What a sight would be expected to be, against what it is."""
        seen, by = self._linearised(sight, self._mean)
        cov = by @ self._cov @ by.T + sight.std_px**2 * np.eye(2)
        return Expectation(sight.pixel - seen, cov, by)

    def learn(self, sight: Sight, expected: Expectation) -> None:
        """Follow a sight that was found credible, by how credible it is.

        A sight is mixed of what it teaches if it is the landmark and of nothing if it is not, by their probabilities.
        So as long as little is known, and something tens of pixels off would be believed, one sight does not make sure.

        Args:
            sight: The sight.
            expected: What was expected of it, just before.
        """
        trust, noise = self._trust(expected), sight.std_px**2 * np.eye(2)
        off, by, step = expected.px, expected.by_state, np.zeros_like(self._mean)
        for _ in range(_ITERATIONS):
            gain = self._cov @ by.T @ np.linalg.inv(by @ self._cov @ by.T + noise)
            gain[self._lens] = 0.0
            last, step = step, gain @ (off + by @ step)
            moved_px = float(np.max(np.abs(by @ (step - last))))
            if moved_px**2 / self._camera.fx_px < _CURVED * sight.std_px:
                break
            seen, by = self._linearised(sight, self._mean + step)
            off = sight.pixel - seen
            if not np.all(np.isfinite(off)):
                return  # the way there leads out of view: nothing to follow
        rest = np.eye(len(step)) - gain @ by
        taught = rest @ self._cov @ rest.T + gain @ noise @ gain.T
        mixed = trust * taught + (1 - trust) * self._cov + trust * (1 - trust) * np.outer(step, step)
        self._mean, self._cov = self._mean + trust * step, (mixed + mixed.T) / 2

    def _trust(self, expected: Expectation) -> float:
        """The probability that a sight is of its landmark."""
        stray = expected.cov_px2 + _STRAY_PX**2 * np.eye(2)
        good = (1 - self._outlier_share) * _density(expected.px, expected.cov_px2)
        bad = self._outlier_share * _density(expected.px, stray)
        return good / (good + bad)

    def _linearised(self, sight: Sight, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The landmark's pixel ``(2,)`` in a state ``(n,)``, and its derivative ``(2, n)`` by that."""
        biases = state[self._biases]
        pose = self._model.corrected(sight.sample, biases, state[self._image])
        place, point = self._places.get(sight.landmark.name), np.array(sight.landmark.position_enu_m)
        if place is not None:
            point = point + state[place]
        seen = reproject(self._camera, pose.position_enu_m, matrix(pose.wxyz), point)
        by_pose = np.hstack([-seen.by_point, seen.by_rotation])
        by = np.zeros((2, len(state)))
        by[:, self._biases] = by_pose @ self._model.by_biases(sight.sample, biases, pose.wxyz)
        by[:, self._image] = by_pose
        if self._lens.stop > self._lens.start:
            by[:, self._lens] = seen.by_intrinsics
        if place is not None:
            by[:, place] = seen.by_point
        return seen.pixels_px, by

    def _drifted(self, stamp_ns: int) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of the state at a stamp, copied; of now for a stamp of the past."""
        mean, cov = self._mean.copy(), self._cov.copy()
        if self._stamp_ns is None or stamp_ns <= self._stamp_ns:
            return mean, cov
        left, returned = self._model.drifted((stamp_ns - self._stamp_ns) / SECOND_NS)
        mean[self._biases] = self._model.mean + left * (mean[self._biases] - self._model.mean)
        cov[self._biases, :] *= left[:, None]
        cov[:, self._biases] *= left
        cov[self._biases, self._biases] += np.diag(returned)
        return mean, cov


def _from(start: int) -> range:
    """Starts of blocks of three."""
    return range(start, np.iinfo(np.int32).max, 3)


def _density(px: FloatArray, cov_px2: FloatArray) -> float:
    """Of a two-dimensional normal distribution."""
    return math.exp(-0.5 * float(px @ np.linalg.solve(cov_px2, px))) / math.sqrt(float(np.linalg.det(cov_px2)))
