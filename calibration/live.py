"""Biases of the telemetry, estimated from landmarks while the station measures."""

import hashlib
import math
from collections import deque
from dataclasses import replace

import numpy as np

from aerodft.model.calibration import BiasValues, Calibration, CalibrationEstimate, Innovation
from aerodft.model.observation import Observation
from aerodft.model.pose import PoseSample
from aerodft.model.pose_batch import PoseBatch
from aerodft.model.status import Status
from aerodft.service.settings import LiveCalibration, PipelineSettings, TelemetrySettings
from calibration.live_filter import BiasFilter, Expectation, Sight
from calibration.live_model import BiasedPoses, BiasModel, propagated, relocated, stds_of

_RECENT, _MOST_REFUSED = 12, 8
"""When so many of the last sights were refused, it is the estimate that is wrong, and it begins anew."""

_FINEST_PX = 0.01
"""Nobody sees anything more precisely, whatever is stated."""

_EDGE_PX = -0.5  # pixel (0, 0) is the centre of the top-left pixel


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
        self._model = BiasModel.of(live, telemetry, pipeline.time_std_s, start)
        self._filter = BiasFilter(self._model, pipeline.camera, live.landmarks, live.outlier_share)
        self._gate = -2.0 * math.log1p(-live.gate_probability)  # the quantile of chi-square with two degrees of freedom
        self._id = _identity(pipeline.config_id, start)
        self._has_start = start is not None
        self._updates = self._refused = self._restarts = 0
        self._recent: deque[bool] = deque(maxlen=_RECENT)
        self._seen: set[str] = set()
        self._seen_ns: int | None = None

    def refine(self, poses: PoseBatch) -> PoseBatch:
        """The corrected poses with what is known by now; samples that are not ok pass unchanged."""
        return poses if self._calibration is None else poses.where_ok(self._refined)

    def _refined(self, poses: PoseBatch) -> PoseBatch:
        biases, cov, with_lens = self._filter.biases(poses.stamp_ns)
        biased = self._model.biased(poses)
        noise = self._model.noise_of(poses.std, biased.height_column)
        pose = biased.corrected(biases)
        by = biased.by_biases(biases, pose.wxyz)
        known = replace(
            pose,
            cov=propagated(by, cov) + biased.noise_covariance(pose.wxyz, noise),
            lens_cov=by @ with_lens,
            time_std_s=0.0,  # it is one of the biases
        )
        std = np.hypot(stds_of(biased.of_heights(np.diagonal(cov, axis1=-2, axis2=-1))), noise)
        named = poses.all_varied(lambda sample: replace(sample, calibration=self._calibration))
        return relocated(replace(named, pose=known, std=std))

    def observes(self, name: str) -> bool:
        """Whether a landmark has that name."""
        return name in self._landmarks

    def fits(self, observation: Observation) -> bool:
        """Whether it is of one pixel."""
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
        image = self._filter.look(PoseBatch.of([sample]))
        if sample.stamp_ns != self._seen_ns:
            self._seen_ns, self._seen = sample.stamp_ns, set()
        sights = [self._sight(image, each) for each in sorted(observations, key=lambda each: each.name)]
        ranked = sights if len(sights) == 1 else sorted(sights, key=lambda each: _rank(self._filter.expect(each)))
        estimate = self._estimate(sample, tuple(self._judged(sight) for sight in ranked))
        self._restart_if_lost()
        return estimate

    @property
    def _calibration(self) -> str | None:
        return f"{self._id}:{self._updates}" if self._updates or self._has_start else None

    def _sight(self, image: BiasedPoses, seen: Observation) -> Sight:
        landmark = self._landmarks[seen.name]
        std_px = max(seen.std_px or landmark.std_px, _FINEST_PX)
        return Sight(image, landmark, np.array(seen.pixels[0]), std_px)

    def _judged(self, sight: Sight) -> Innovation:
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

    def _objection(self, sight: Sight, distance: float) -> str | None:
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
        if self._recent.count(False) >= _MOST_REFUSED:
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
        (biases,), (cov,), _ = self._filter.biases(np.array([sample.stamp_ns]))
        return replace(
            estimate,
            height_source=sample.height_source,
            bias=BiasValues(**self._model.said(sample, biases)),
            std=BiasValues(**self._model.said(sample, np.sqrt(np.diag(cov)))),
        )


def _identity(config_id: str | None, start: Calibration | None) -> str:
    """Names what the estimates depend on beside the observations."""
    text = f"{config_id or ''} {start.id if start else ''}"
    return f"live:{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def _unusable(sample: PoseSample) -> str | None:
    """Why a pose teaches nothing."""
    if sample.pose is None or sample.status is not Status.OK:
        return "; ".join((f"no pose: {sample.status}", *sample.reasons))
    if sample.zoom is not None:
        return "the camera is zoomed, and landmarks are held against its file"
    return "no position, so nobody knows where it should be seen" if sample.origin is None else None


def _rank(expected: Expectation) -> float:
    """The most credible first, what is out of view last."""
    distance = expected.chi2
    return math.inf if math.isnan(distance) else distance
