"""Biases of the telemetry, estimated from landmarks while the station measures.

An iterated Kalman filter is fed with one landmark's pixel at a time. Beside the biases its state holds what would make
it too sure of itself: the errors that are new in the current image and shared by all landmarks in it, the surveyor's
error of each landmark, and the lens's. The lens is considered, never estimated (Schmidt): its errors are the camera
file's, and the pose's correlation with them is kept.
"""

import hashlib
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import intrinsics_covariance, matrix, reproject
from aerodft.model import (
    BiasValues,
    Calibration,
    CalibrationEstimate,
    Camera,
    FloatArray,
    Innovation,
    IntArray,
    Observation,
    PoseBatch,
    PoseSample,
    Status,
    SurveyedLandmark,
)
from aerodft.service import LiveCalibration, PipelineSettings, TelemetrySettings
from calibration.flight import BiasedPoses, BiasModel, propagate_covariance, stds_of, with_lat_lon

_ITERATIONS = 6
_CURVED = 0.01
"""Share of a sighting's std: an error of linearisation that is not worth another iteration."""

_POSE = 6
_STRAY_PX = 50.0
"""How far off, about, an observation of something else is: what a tracker takes for the landmark is near it."""
_RECENT, _MAX_REJECTED = 12, 8
"""When so many of the last sights were refused, it is the estimate that is wrong, and it begins anew."""

_FINEST_PX = 0.01
"""Nobody sees anything more precisely, whatever is stated."""

_NEVER_NS = np.iinfo(np.int64).max  # no stamp is later
_Known = tuple[FloatArray, FloatArray, FloatArray, int, str | None]
"""The biases after an image: mean, covariance, covariance with the lens, the image's stamp, and the calibration's name,
which is None before anything was learned."""
_EDGE_PX = -0.5  # pixel (0, 0) is the centre of the top-left pixel


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkSighting:
    """One pixel that is said to be a landmark's.

    Attributes:
        image: The image's pose ``()``, by telemetry alone.
        landmark: The landmark.
        pixel: ``(2,)``.
        std_px: Of each coordinate.
    """

    image: BiasedPoses
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
        outlier_fraction: Share of sights that are something else.
    """

    def __init__(
        self, model: BiasModel, camera: Camera, landmarks: tuple[SurveyedLandmark, ...], outlier_fraction: float
    ) -> None:
        self._model = model
        self._camera = camera
        self._landmarks = landmarks
        self._outlier_fraction = outlier_fraction
        lens = intrinsics_covariance(camera)
        uncertain = [each for each in landmarks if any(each.std_m)]
        biases = len(model.mean)
        self._biases = slice(0, biases)
        self._image = slice(biases, biases + _POSE)
        self._lens = slice(self._image.stop, self._image.stop + (len(lens) if np.any(lens) else 0))
        self._places = {
            each.name: slice(s, s + 3) for s, each in zip(count(self._lens.stop, 3), uncertain, strict=False)
        }
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

    def known(self, calibration: str | None) -> _Known:
        """The biases as of the last image, under a name."""
        mean, cov = self._mean[self._biases].copy(), self._cov[self._biases].copy()
        stamp_ns = _NEVER_NS if self._stamp_ns is None else self._stamp_ns
        return mean, cov[:, self._biases], cov[:, self._lens], stamp_ns, calibration

    def biases(self, known: Sequence[_Known], which: IntArray, stamp_ns: IntArray) -> tuple[FloatArray, ...]:
        """The biases at stamps ``(n,)``: mean ``(n, k)``, covariance ``(n, k, k)``, that with the lens ``(n, k, m)``.

        Each is told from ``which (n,)`` of the states ``known``; at a stamp before a state's image as at that image.
        """
        mean, cov, lens_cov, since_ns = (np.array([each[part] for each in known])[which] for part in range(4))
        left, returned = self._model.decayed(np.maximum(stamp_ns - since_ns, 0) / SECOND_NS)
        cov = left[:, :, None] * cov * left[:, None]
        every = np.arange(cov.shape[-1])
        cov[:, every, every] += returned
        return self._model.mean + left * (mean - self._model.mean), cov, left[:, :, None] * lens_cov

    def advance_to(self, image: PoseBatch) -> BiasedPoses:
        """Go to an image: all that comes next is seen in it. An earlier one than the last is looked at from here.

        Args:
            image: Its pose by telemetry alone, in a batch of one.

        Returns:
            That pose ``()``.
        """
        stamp_ns, pose = int(image.stamp_ns[0]), self._model.with_biases(image).row(0)
        if self._stamp_ns is None or stamp_ns > self._stamp_ns:
            self._propagate(stamp_ns)
            self._stamp_ns = stamp_ns
        if stamp_ns == self._image_ns:
            return pose
        self._image_ns = stamp_ns
        biases = self._mean[self._biases]
        wxyz = pose.corrected(biases).wxyz
        noise = pose.noise_covariance(wxyz, self._model.noise_of(image.std[0], pose.height_column))
        if stamp_ns < self._stamp_ns:  # the biases of then are not quite those of now
            _, returned = self._model.decayed(np.array((self._stamp_ns - stamp_ns) / SECOND_NS))
            noise = noise + propagate_covariance(pose.by_biases(biases, wxyz), np.diag(returned))
        self._mean[self._image] = 0.0
        self._cov[self._image, :] = self._cov[:, self._image] = 0.0
        self._cov[self._image, self._image] = noise
        return pose

    def expect(self, sight: LandmarkSighting) -> Expectation:
        """Innovation of a sighting: observed less expected pixel, with its covariance and Jacobian."""
        seen, by = self._linearised(sight, self._mean)
        cov = by @ self._cov @ by.T + sight.std_px**2 * np.eye(2)
        return Expectation(sight.pixel - seen, cov, by)

    def learn(self, sight: LandmarkSighting, expected: Expectation) -> None:
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
        left = self._cov - gain @ (by @ self._cov)
        taught = left - (left @ by.T - gain @ noise) @ gain.T  # as by Joseph: (1 - K H) P (1 - K H)' + K R K'
        mixed = trust * taught + (1 - trust) * self._cov + trust * (1 - trust) * np.outer(step, step)
        self._mean, self._cov = self._mean + trust * step, (mixed + mixed.T) / 2

    def _trust(self, expected: Expectation) -> float:
        """The probability that a sight is of its landmark."""
        stray = expected.cov_px2 + _STRAY_PX**2 * np.eye(2)
        good = (1 - self._outlier_fraction) * _density(expected.px, expected.cov_px2)
        bad = self._outlier_fraction * _density(expected.px, stray)
        return good / (good + bad)

    def _linearised(self, sight: LandmarkSighting, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The landmark's pixel ``(2,)`` in a state ``(n,)``, and its derivative ``(2, n)`` by that."""
        biases = state[self._biases]
        pose = sight.image.corrected(biases, state[self._image])
        place, point = self._places.get(sight.landmark.name), np.array(sight.landmark.position_enu_m)
        if place is not None:
            point = point + state[place]
        seen = reproject(self._camera, pose.position_enu_m, matrix(pose.wxyz), point)
        by_pose = np.hstack([-seen.jac_point, seen.jac_rotation])
        by = np.zeros((2, len(state)))
        by[:, self._biases] = by_pose @ sight.image.by_biases(biases, pose.wxyz)
        by[:, self._image] = by_pose
        if self._lens.stop > self._lens.start:
            by[:, self._lens] = seen.jac_intrinsics
        if place is not None:
            by[:, place] = seen.jac_point
        return seen.pixels_px, by

    def _propagate(self, stamp_ns: int) -> None:
        """Bring the state to a later stamp."""
        elapsed_ns = 0 if self._stamp_ns is None else stamp_ns - self._stamp_ns
        left, returned = self._model.decayed(np.array(elapsed_ns / SECOND_NS))
        self._mean[self._biases] = self._model.mean + left * (self._mean[self._biases] - self._model.mean)
        self._cov[self._biases, :] *= left[:, None]
        self._cov[:, self._biases] *= left
        self._cov[self._biases, self._biases] += np.diag(returned)


def _density(px: FloatArray, cov_px2: FloatArray) -> float:
    """Density of a two-dimensional normal distribution."""
    return math.exp(-0.5 * float(px @ np.linalg.solve(cov_px2, px))) / math.sqrt(float(np.linalg.det(cov_px2)))


class LiveCalibrator:
    """Implements ``service.ports.Calibrator`` and ``LandmarkObserver``.

    Until the first landmark is believed, poses are what they would be without it: as the telemetry has them, or as the
    calibration that it starts from has them.

    Args:
        live: The landmarks, and how certain what is.
        pipeline: The station; telemetry must be configured.
        start: A calibration whose biases are where it begins.
    """

    def __init__(self, live: LiveCalibration, pipeline: PipelineSettings, start: Calibration | None = None) -> None:
        self._camera = pipeline.camera
        self._landmarks = {each.name: each for each in live.landmarks}
        telemetry = pipeline.telemetry or TelemetrySettings()
        self._model = BiasModel.from_settings(live, telemetry, pipeline.time_std_s, start)
        self._filter = BiasFilter(self._model, pipeline.camera, live.landmarks, live.outlier_fraction)
        self._gate = -2.0 * math.log1p(-live.gate_probability)  # the quantile of chi-square with two degrees of freedom
        depends_on = f"{pipeline.config_id or ''} {start.id if start else ''}"  # beside the observations
        self._id = f"live:{hashlib.sha256(depends_on.encode()).hexdigest()[:16]}"
        self._has_start = start is not None
        self._updates = self._refused = self._restarts = 0
        self._recent: deque[bool] = deque(maxlen=_RECENT)
        self._seen: set[str] = set()
        self._seen_ns: int | None = None

    def known(self) -> _Known:
        """Biases and covariance known by now."""
        return self._filter.known(self._calibration)

    def refine(self, poses: PoseBatch, known: Sequence[_Known], which: IntArray) -> PoseBatch:
        """The corrected poses; samples that are not ok, and those of when nothing was known, pass unchanged."""
        chosen = poses.is_ok & np.array([each[-1] is not None for each in known])[which]
        return poses.where(chosen, lambda some, rows: self._refined(some, known, which[rows]))

    def _refined(self, poses: PoseBatch, known: Sequence[_Known], which: IntArray) -> PoseBatch:
        biases, cov, with_lens = self._filter.biases(known, which, poses.stamp_ns)
        biased = self._model.with_biases(poses)
        noise = self._model.noise_of(poses.std, biased.height_column)
        pose = biased.corrected(biases)
        by = biased.by_biases(biases, pose.wxyz)
        refined = replace(
            pose,
            cov=propagate_covariance(by, cov) + biased.noise_covariance(pose.wxyz, noise),
            lens_cov=by @ with_lens,
            time_std_s=0.0,  # it is one of the biases
        )
        std = np.hypot(stds_of(biased.for_heights(np.diagonal(cov, axis1=-2, axis2=-1))), noise)
        names = [known[k][-1] for k in which.tolist()]
        named = poses.with_variants(names, lambda sample, name: replace(sample, calibration=name))
        return with_lat_lon(replace(named, pose=refined, std=std))

    def observes(self, name: str) -> bool:
        """Whether a landmark has that name."""
        return name in self._landmarks

    def fits(self, observation: Observation) -> bool:
        """Whether an observation is of one pixel, as a landmark's is."""
        return len(observation.pixels) == 1

    def observe(self, sample: PoseSample, observations: tuple[Observation, ...]) -> CalibrationEstimate:
        """Learn from the landmarks of one image.

        Args:
            sample: The image's pose, by telemetry alone.
            observations: One pixel each, of landmarks.
        """
        if (why := _unusable(sample)) is not None:
            self._refused += len(observations)
            refused = tuple(Innovation(name=each.name, reason=why) for each in observations)
            return self._estimate(sample, refused)
        image = self._filter.advance_to(PoseBatch.from_samples([sample]))
        if sample.stamp_ns != self._seen_ns:
            self._seen_ns, self._seen = sample.stamp_ns, set()
        sights = [self._sight(image, each) for each in sorted(observations, key=lambda each: each.name)]
        ranked = sights if len(sights) == 1 else sorted(sights, key=self._distance)
        estimate = self._estimate(sample, tuple(self._follow(sight) for sight in ranked))
        self._restart_if_lost()
        return estimate

    @property
    def _calibration(self) -> str | None:
        return f"{self._id}:{self._updates}" if self._updates or self._has_start else None

    def _distance(self, sight: LandmarkSighting) -> float:
        """The most credible first, what is out of view last."""
        return float(np.nan_to_num(self._filter.expect(sight).chi2, nan=np.inf))

    def _sight(self, image: BiasedPoses, seen: Observation) -> LandmarkSighting:
        landmark = self._landmarks[seen.name]
        std_px = max(seen.std_px or landmark.std_px, _FINEST_PX)
        return LandmarkSighting(image, landmark, np.array(seen.pixels[0]), std_px)

    def _follow(self, sight: LandmarkSighting) -> Innovation:
        """Follow a sight, or say why not."""
        name, expected = sight.landmark.name, self._filter.expect(sight)
        distance = expected.chi2
        reason = self._objection(sight, distance)
        self._refused += reason is not None
        if reason is None:
            self._seen.add(name)
            self._filter.learn(sight, expected)
            self._updates += 1
        if math.isnan(distance):
            return Innovation(name=name, reason=reason)
        u, v = expected.px.tolist()
        sigma_u, sigma_v = np.sqrt(np.diag(expected.cov_px2)).tolist()
        return Innovation(name=name, px=(u, v), sigma_px=(sigma_u, sigma_v), chi2=distance, reason=reason)

    def _objection(self, sight: LandmarkSighting, distance: float) -> str | None:
        size = np.array([self._camera.width_px, self._camera.height_px])
        if not np.all((sight.pixel >= _EDGE_PX) & (sight.pixel <= size + _EDGE_PX)):
            return "the pixel is outside the image"
        if sight.landmark.name in self._seen:
            return "it was seen in this image already"
        if math.isnan(distance):
            return "the landmark is out of view: behind the camera, or beyond the lens model"
        self._recent.append(distance <= self._gate)
        if distance <= self._gate:
            return None
        return f"{math.sqrt(distance):.1f} sigma from where it is expected, at most {math.sqrt(self._gate):.1f}"

    def _restart_if_lost(self) -> None:
        if self._recent.count(False) >= _MAX_REJECTED:
            self._filter.restart()
            self._recent.clear()
            self._restarts += 1

    def _estimate(self, sample: PoseSample, innovations: tuple[Innovation, ...]) -> CalibrationEstimate:
        estimate = CalibrationEstimate(
            stamp_ns=sample.stamp_ns,
            calibration=self._calibration,
            innovations=innovations,
            updates=self._updates,
            refused=self._refused,
            restarts=self._restarts,
        )
        if sample.pose is None or sample.height_source is None:
            return estimate
        now = np.array([0])
        (biases,), (cov,), _ = self._filter.biases([self.known()], now, np.array([sample.stamp_ns]))
        return replace(
            estimate,
            height_source=sample.height_source,
            bias=BiasValues(**self._model.by_name(sample, biases)),
            std=BiasValues(**self._model.by_name(sample, np.sqrt(np.diag(cov)))),
        )


def _unusable(sample: PoseSample) -> str | None:
    """Why a pose teaches nothing."""
    if sample.pose is None or sample.status is not Status.OK:
        return "; ".join((f"no pose: {sample.status}", *sample.reasons))
    if sample.zoom is not None:
        return "the camera is zoomed, and landmarks are held against its file"
    return "no position, so nobody knows where it should be seen" if sample.origin is None else None
