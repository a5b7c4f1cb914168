"""Alignment of a video with a log by the camera's rotations: clock offset and drift, and the gimbal's lag.

Stamps of the video become UTC by ``stamp + offset + drift (stamp - reference)``; the gimbal's report of ``lag`` before
is where the camera then looked. All offsets and drifts of a range are searched first. The best is fitted to the turns
that the images show, then, land and water by themselves, the reports to the path that these turns make.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerodft.adapters.timestamps import zone_hint
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, counted
from aerodft.model import FloatArray, GimbalSource, IntArray
from aerodft.service import AttitudeSettings
from aerodft.service.attitude import AttitudeHistory
from aerodft.vision.camera_motion import ImagePair, PlaneMotion, layered_motion, plane_motion
from calibration.sync.diagnosis import MIN_SCORE, check_focal, refusal
from calibration.sync.fit import (
    LAG,
    LAG_PRIOR_S,
    MAX_DRIFT,
    MIN_REPORTS,
    Peak,
    RefinedAlignment,
    RotationProblem,
    fit,
    refine_alignment,
    search,
)
from calibration.sync.motion import CameraMotion, CameraPath, integrated_path, predict_rotations

MAX_STD_S = 0.05
"""Largest standard deviation of offset less lag of an accepted alignment."""

_MIN_PAIRS = 25
_AROUND_S = 5.0  # of the log beside what could be of the video, for a lag and for a curve's ends
_MAX_RATIO = 0.7  # of the second peak's score to the best one's
_LAG_DETERMINED = 0.6  # of the prior's standard deviation: what is left when the data tell the lag


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rates:
    """Angular rates about the camera's axes, for plots.

    Attributes:
        stamp_ns: ``(n,)`` by the video's clock.
        seen_radps: ``(n, 3)`` by the images.
        logged_before_radps: ``(n, 3)`` by the log, as the video was stamped; NaN outside of the log.
        logged_radps: ``(n, 3)`` by the log, aligned; NaN outside of the log.
    """

    stamp_ns: IntArray
    seen_radps: FloatArray
    logged_before_radps: FloatArray
    logged_radps: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment:
    """Alignment of a video with a log.

    Attributes:
        reference_ns: Where the offset holds and from where the drift counts, by the video's clock.
        offset_s: To be added to a stamp at the reference.
        drift: To be added to it per second since then.
        lag_s: How much the camera was behind the gimbal's reports, on average.
        time_constant_s: How much of that is a camera that follows ever more slowly, rather than later.
        cov: ``(3, 3)`` of offset, drift and lag.
        is_lag_determined: The lag is known, by the data or because there is none; else it is a typical one, and part
            of the offset's std.
        peak_ratio: Score of the best other offset over that of this one; 0 where there is no other.
        source: The report of the camera's attitude.
        rates: What it was made of.
    """

    reference_ns: int
    offset_s: float
    drift: float
    lag_s: float
    time_constant_s: float
    cov: FloatArray
    is_lag_determined: bool
    peak_ratio: float
    source: GimbalSource
    rates: Rates

    @property
    def stds(self) -> FloatArray:
        """Standard deviations ``(3,)`` of offset, drift and lag."""
        return np.asarray(np.sqrt(np.diag(self.cov)))

    @property
    def lateness_s(self) -> float:
        """Lateness of the camera beyond its lag, while it turns."""
        return 2 * float(self.stds[LAG]) + self.time_constant_s

    def attitude_std_s(self, after_s: float = 0.0) -> float:
        """Std (s) of the attitudes' time, ``after_s`` after the reference: of offset less lag, with drift."""
        return self._std_s([1.0, after_s, -1.0])

    def position_std_s(self, after_s: float = 0.0) -> float:
        """Std (s) of the positions' time, ``after_s`` after the reference: of the offset, with drift."""
        return self._std_s([1.0, after_s, 0.0])

    def _std_s(self, weights: list[float]) -> float:
        return float(np.sqrt(np.array(weights) @ self.cov @ np.array(weights)))


def align(
    pairs: Sequence[ImagePair],
    history: AttitudeHistory,
    settings: AttitudeSettings,
    max_offset_s: float,
    focal_std: float = 0.0,
) -> Alignment:
    """Align a video with a log.

    Args:
        pairs: What its images have in common, ascending.
        history: The log's attitudes.
        settings: Which of them are believed.
        max_offset_s: How far off the video's stamps may be.
        focal_std: Stated standard deviation of the focal length over it.

    Raises:
        NoAnswerError: No attitude in the log, too little to see in the images, too little motion to tell, a focal
            length or a mount that contradicts the log, or several offsets that fit about as well.
    """
    coarse = plane_motion(pairs)
    if len(coarse) < _MIN_PAIRS:
        raise NoAnswerError(
            "the images do not tell how the camera turned",
            got=f"{counted(len(coarse), 'pair')} of images with a common plane",
            expected=f"at least {_MIN_PAIRS}",
            hint="the ground must be in view, sharp and textured",
        )
    reference_ns = (pairs[0].start_ns + pairs[-1].end_ns) // 2
    reach_s = max_offset_s + (1 + MAX_DRIFT) * (pairs[-1].end_ns - reference_ns) / SECOND_NS + _AROUND_S
    camera = _camera(history, settings, (pairs[0].start_ns, pairs[-1].end_ns), reach_s)
    peaks = search(coarse, camera, reference_ns, max_offset_s)
    if peaks[0].score < MIN_SCORE:
        raise refusal(coarse, camera, history, settings, reference_ns, (max_offset_s, reach_s), peaks[0])
    best, ratio = peaks[0], _ratio(peaks)
    first = fit(RotationProblem(coarse, camera, reference_ns), np.array([best.offset_s, best.drift, best.lag_s]))
    problem = RotationProblem(_layered(pairs, camera, reference_ns, first), camera, reference_ns)
    seen = problem.seen(problem.predicted_by_log(first))
    path = integrated_path(pairs, problem.motion, seen, camera, first[: LAG + 1], reference_ns)
    found = _refined(camera, path, first[: LAG + 1])
    check_focal(coarse, camera, reference_ns, found.values, focal_std)
    alignment = _alignment(found, first, problem, reference_ns, ratio)
    _check(alignment)
    return alignment


def _camera(
    history: AttitudeHistory, settings: AttitudeSettings, video_ns: tuple[int, int], reach_s: float
) -> CameraMotion:
    try:
        return CameraMotion(history, settings, sum(video_ns) // 2, reach_s)
    except LookupError:
        check_overlap(history, video_ns, reach_s)
        there = ", ".join([*map(str, history.gimbals), *(["ATTITUDE"] if history.vehicle is not None else [])])
        raise NoAnswerError(
            "no camera attitude in the log",
            got=there or "none",
            expected=f"one of {', '.join(settings.order)}",
            hint="see `diagnose`, and telemetry.attitude.order in the config",
        ) from None


def check_overlap(history: AttitudeHistory, video_ns: tuple[int, int], reach_s: float) -> None:
    """Refuse a log that is far from its video.

    Args:
        history: The log's attitudes; without any there is nothing to refuse.
        video_ns: Start and end of the video, by its own stamps.
        reach_s: How far from its middle the log may be.

    Raises:
        NoAnswerError: It is farther away.
    """
    if history.span_ns is None:
        return
    zero_ns, log_ns = sum(video_ns) // 2, history.span_ns
    first_s, last_s = ((each - zero_ns) / SECOND_NS for each in log_ns)
    if first_s > reach_s or last_s < -reach_s:
        raise NoAnswerError(
            "video and log do not overlap in time",
            got=f"a log from {first_s:+.0f} s to {last_s:+.0f} s about the middle of the video",
            expected=f"some of it within {reach_s:.0f} s",
            hint=zone_hint(video_ns, log_ns) or "pass `video_start_ns`, or a larger `max_offset_s`",
        )


def _ratio(peaks: tuple[Peak, ...]) -> float:
    """Score of the second best offset over that of the best one; refuses one that is nearly as good."""
    best = peaks[0]
    ratio = max(peaks[1].score / best.score, 0.0) if len(peaks) > 1 else 0.0
    if ratio > _MAX_RATIO:
        raise NoAnswerError(
            "several offsets fit about as well",
            got=f"{best.offset_s:+.1f} s and {peaks[1].offset_s:+.1f} s, which explains {ratio:.0%} of what that does",
            expected=f"at most {_MAX_RATIO:.0%}",
            hint="a motion that repeats itself does not tell; pass `video_start_ns` and a smaller `max_offset_s`",
        )
    return ratio


def _layered(pairs: Sequence[ImagePair], camera: CameraMotion, zero_ns: int, first: FloatArray) -> PlaneMotion:
    """Homographies of what moves alike, with the ground where the first fit has it."""
    offset, drift, lag = first[: LAG + 1].tolist()
    stamps = np.array([(pair.start_ns, pair.end_ns) for pair in pairs], dtype=np.int64)
    start, end = (offset + (1 + drift) * ((stamps - zero_ns) / SECOND_NS)).T
    logged = predict_rotations(camera, start, end, lag)
    covered = [pair for pair, known in zip(pairs, logged.known.tolist(), strict=True) if known]
    return layered_motion(covered, logged.rotvec_rad[logged.known], logged.normal_cam[logged.known])


def _refined(camera: CameraMotion, path: CameraPath, start: FloatArray) -> RefinedAlignment:
    try:
        return refine_alignment(camera, path, start)
    except LookupError as error:
        raise NoAnswerError(
            "too little of the log is about what the video shows",
            got=f"{error} reports of {camera.source} while the ground was followed",
            expected=f"at least {MIN_REPORTS}",
            hint="film longer while the gimbal moves, or ask for its reports more often",
        ) from None


def _alignment(
    found: RefinedAlignment, first: FloatArray, problem: RotationProblem, reference_ns: int, ratio: float
) -> Alignment:
    offset, drift, lag = found.values.tolist()
    between = problem.between_s[:, None]
    before = predict_rotations(problem.camera, problem.start_s, problem.end_s, 0.0)
    logged = problem.predicted_by_log(np.concatenate([found.values, first[LAG + 1 :]]))
    return Alignment(
        reference_ns=reference_ns,
        offset_s=offset,
        drift=drift,
        lag_s=lag,
        time_constant_s=found.time_constant_s,
        cov=found.cov,
        is_lag_determined=float(np.sqrt(found.cov[LAG, LAG])) < _LAG_DETERMINED * LAG_PRIOR_S[1],
        peak_ratio=ratio,
        source=problem.camera.source,
        rates=Rates(
            stamp_ns=(problem.motion.start_ns + problem.motion.end_ns) // 2,
            seen_radps=problem.seen(logged).rotvec_rad / between,
            logged_before_radps=np.where(before.known[:, None], before.rotvec_rad / between, np.nan),
            logged_radps=np.where(logged.known[:, None], logged.rotvec_rad / between, np.nan),
        ),
    )


def _check(alignment: Alignment) -> None:
    std_s = alignment.attitude_std_s()
    if std_s > MAX_STD_S:
        raise NoAnswerError(
            "too little motion to tell",
            got=f"an offset that is known to {std_s:.2f} s only",
            expected=f"a standard deviation of at most {MAX_STD_S:g} s",
            hint="the gimbal or the vehicle must turn while the video runs",
        )
