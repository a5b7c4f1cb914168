"""Estimates from the data whether a gimbal reports relative to the horizon (MAVLink's standard) or to the vehicle.

A stabilised camera keeps its attitude while the vehicle moves: reports relative to the horizon stay constant, reports
relative to the vehicle undo its motion. Each motion of the vehicle is scored under both readings by the rotation of the
camera relative to gravity that it implies, which needs no yaw and is regular at nadir.

Reports relative to the vehicle are servo angles, whose attitude depends on the mount: one reading for each of
``GIMBAL_MOUNTS`` that has a prior.

Two kinds of reports relative to the vehicle stay constant too: a servo at its limit, so that evidence at the end of the
range counts little, and the demand of a camera that is not stabilised, which the data cannot tell.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import about_axis, matrix, multiply, yaw_pitch_roll
from aerodft.model import Batch, BoolArray, FloatArray, IntArray, MountAxes, ReportFrame
from aerodft.service.attitude.mounts import GIMBAL_MOUNTS
from aerodft.service.streams import Stream

LAGS_NS: Final = (0, 100_000_000, 200_000_000, 300_000_000)
"""Lags of a report behind its stamp, each a hypothesis."""

AXES: Final = tuple(mount.axes for mount in GIMBAL_MOUNTS.values() if mount.prior)
"""Mounts that the data tell apart."""

BODY_READINGS: Final = len(AXES) * len(LAGS_NS)
"""Number of readings relative to the vehicle: each mount with each lag."""

_SAMPLES_BEFORE = 3  # samples before a stamp that its values depend on
_MIN_INTERVAL_NS = 100_000_000  # closer reports add no information


@dataclass(frozen=True, slots=True)
class GravitySample:
    """Directions of gravity at one report.

    Attributes:
        stamp_ns: The report's.
        reported_pitch_rad: Pitch in the report.
        down_body: Unit vector, in the vehicle's axes.
        down_if_earth: ``(3,)`` in the gimbal's axes, if the report is relative to the horizon.
        down_if_body: ``(BODY_READINGS, 3)`` in the gimbal's axes, if the report has servo angles of each mount, on the
            vehicle as it was each lag before.
        second_difference_rad: Second difference of ``down_body`` over the vehicle's last samples: interpolating between
            slow ones hides their noise.
    """

    stamp_ns: int
    reported_pitch_rad: float
    down_body: Sequence[float]
    down_if_earth: FloatArray
    down_if_body: FloatArray
    second_difference_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class GravitySamples(Batch):
    """Directions of gravity at ``n`` reports, in order, as columns.

    Attributes:
        is_known: ``(n,)`` whether the vehicle's attitude is known on both sides, and for the longest lag before.
        stamp_ns: ``(n,)``, as all other columns, see ``GravitySample``.
        reported_pitch_rad: ``(n,)``.
        down_body: ``(n, 3)``.
        down_if_earth: ``(n, 3)``.
        down_if_body: ``(n, BODY_READINGS, 3)``.
        second_difference_rad: ``(n,)``.
        silence_ns: ``(n,)`` for how long before it the vehicle reported its attitude and the gimbal nothing.
    """

    is_known: BoolArray
    stamp_ns: IntArray
    reported_pitch_rad: FloatArray
    down_body: FloatArray
    down_if_earth: FloatArray
    down_if_body: FloatArray
    second_difference_rad: FloatArray
    silence_ns: IntArray

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def row(self, row: int) -> GravitySample:
        """One sample."""
        return GravitySample(
            int(self.stamp_ns[row]),
            float(self.reported_pitch_rad[row]),
            self.down_body[row].tolist(),
            self.down_if_earth[row],
            self.down_if_body[row],
            float(self.second_difference_rad[row]),
        )


def gravity_samples(gimbal: Stream, vehicle: Stream, *, after_ns: int, until_ns: int) -> GravitySamples | None:
    """Gravity samples of the reports in a span of stamps, at most one per tenth of a second; None if there are none."""
    rows = _rows(gimbal.stamps_ns, after_ns, until_ns)
    if not len(rows) or vehicle.last_ns is None:
        return None
    stamps, wxyz = gimbal.stamps_ns[rows], gimbal.column("wxyz")[rows]
    first = max(int(np.searchsorted(vehicle.stamps_ns, stamps[0] - max(LAGS_NS))) - _SAMPLES_BEFORE, 0)
    samples_ns, attitudes = vehicle.stamps_ns[first:], vehicle.column("wxyz")[first:]
    before = np.stack([stamps - lag_ns for lag_ns in LAGS_NS], axis=-1)
    downs_at_samples = matrix(attitudes)[:, 2]
    downs, known = _interpolate(samples_ns, downs_at_samples, before, vehicle.max_gap_ns)
    noise = _second_differences(downs_at_samples)[np.searchsorted(samples_ns, stamps, side="right") - 1]
    latest = attitudes[np.clip(np.searchsorted(samples_ns, stamps), 0, len(attitudes) - 1)]
    yaws = np.where(gimbal.column("yaw_in_earth")[rows] > 0, yaw_pitch_roll(latest)[0], 0.0)
    relative_to_body = multiply(about_axis(2, -yaws), wxyz)
    rotations = [matrix(GIMBAL_MOUNTS[axes].camera_wxyz(relative_to_body, latest, yaw_in_earth=False)) for axes in AXES]
    if_body = np.concatenate([downs @ rotation for rotation in rotations], axis=1)
    silence_ns = _silence_ns(gimbal, vehicle, rows)
    return GravitySamples(
        known, stamps, yaw_pitch_roll(wxyz)[1], downs[:, 0], matrix(wxyz)[:, 2], if_body, noise, silence_ns
    )


def _silence_ns(gimbal: Stream, vehicle: Stream, rows: IntArray) -> IntArray:
    """Time ``(n,)`` between reports of the gimbal and those before them, less that in which the vehicle is unknown."""
    before_ns = np.where(rows > 0, gimbal.stamps_ns[rows - 1], 0)
    samples_ns = vehicle.stamps_ns[max(int(np.searchsorted(vehicle.stamps_ns, before_ns[0], side="right")) - 1, 0) :]
    steps_ns = np.diff(samples_ns, prepend=samples_ns[0])
    known_ns = np.cumsum(np.where(steps_ns <= vehicle.max_gap_ns, steps_ns, 0))
    ends = np.searchsorted(samples_ns, [before_ns, gimbal.stamps_ns[rows]], side="right") - 1
    return np.asarray(np.diff(known_ns[np.maximum(ends, 0)], axis=0)[0])


def _second_differences(downs: FloatArray) -> FloatArray:
    """Lengths ``(n,)`` of second differences ending at each of ``downs (n, 3)``; 0 for the first two."""
    return np.concatenate([np.zeros(min(2, len(downs))), np.linalg.norm(np.diff(downs, n=2, axis=0), axis=-1)])


def _rows(stamps_ns: IntArray, after_ns: int, until_ns: int) -> IntArray:
    """Rows of the first report in each tenth of a second."""
    first, stop = np.searchsorted(stamps_ns, [after_ns, until_ns], side="right").tolist()
    tenths = stamps_ns[first:stop] // _MIN_INTERVAL_NS
    is_first = np.diff(tenths, prepend=after_ns // _MIN_INTERVAL_NS - 1) > 0
    return np.flatnonzero(is_first) + int(first)


def _interpolate(
    samples_ns: IntArray, values: FloatArray, stamps_ns: IntArray, max_gap_ns: int
) -> tuple[FloatArray, BoolArray]:
    """The vehicle's ``values (m, 3)`` interpolated at ``stamps_ns (n, lags)``, and which rows are known for all lags.

    Returns:
        ``(n, lags, 3)`` linear between samples, and ``(n,)``.
    """
    after = np.clip(np.searchsorted(samples_ns, stamps_ns), 1, len(samples_ns) - 1)
    gap = samples_ns[after] - samples_ns[after - 1]
    weight = (stamps_ns - samples_ns[after - 1]) / np.maximum(gap, 1)
    known = (weight >= 0) & (weight <= 1) & (gap <= max_gap_ns) & (gap > 0)
    return values[after - 1] + weight[..., None] * (values[after] - values[after - 1]), np.all(known, axis=-1)


PRIOR_BODY: Final = 0.25
"""Prior probability of reports relative to the vehicle, as of servo mounts and most senders of older messages."""

CERTAIN: Final = 1e4
"""Bayes factor at which a reading is decided."""

_EXCHANGE_NS = 10 * SECOND_NS  # without a report, in which a gimbal may have become another one
_WINDOW_NS = 2 * SECOND_NS  # longest motion: slower ones may as well be commands
_MIN_MOTION_RAD = math.radians(2)  # ten times the error of an autopilot's own attitude
_MIN_MOTION_STDS = 8  # the noise of twenty attitudes reaches six
_NOISE_WINDOW = 300  # reports
_MIN_NOISE_SAMPLES = 15  # reports
_STD_PER_DIFFERENCE = 1 / (math.sqrt(6) * 1.177)  # of white noise in two directions, from the median of their lengths
_NOISE_RAD = math.radians(0.3)
_RESIDUAL_MOTION = 0.25  # fraction of the vehicle's motion that lags and poor stabilisation leave in the camera's
_MAX_PER_MOTION = math.log(10)  # log evidence of one motion: a command may coincide with it,
_MAX_PER_WINDOW = 2 * _MAX_PER_MOTION  # and, less often, with all parts of a long motion
_MAX_AT_LIMIT = math.log(200)
_AT_LIMIT_RAD = math.radians(1)
_MAX_LOG_RATIO = 3 * math.log(CERTAIN)  # bounded, so that later evidence can reverse it


_PRIORS: Final = np.array([GIMBAL_MOUNTS[axes].prior for axes in AXES])
_PRIOR_BY_AXES: Final = PRIOR_BODY * _PRIORS / np.sum(_PRIORS)

# Priors of the readings: the horizon, then the vehicle by mounts and lags.
_LOG_PRIOR: Final = np.log([1 - PRIOR_BODY, *np.repeat(_PRIOR_BY_AXES / len(LAGS_NS), len(LAGS_NS))])


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameEvidence:
    """Evidence on how one gimbal's reports are to be read.

    Attributes:
        frame: The decided frame; None while undecided.
        axes: The decided mount, if reports are relative to the vehicle; None while undecided.
        contradictory: Whether the decision changed more than once: no reading holds.
        body_probability: Probability that reports are relative to the vehicle.
        mount_probabilities: Probability of each of ``AXES`` then.
        motions: Number of motions of the vehicle so far.
        undone: Number of motions that the reports undid rather than not.
        motion_s: Total duration of the motions.
    """

    frame: ReportFrame | None
    axes: MountAxes | None
    contradictory: bool
    body_probability: float
    mount_probabilities: Mapping[MountAxes, float]
    motions: int
    undone: int
    motion_s: float

    def reading_probabilities(
        self, frame: ReportFrame | None, axes: MountAxes | None
    ) -> dict[tuple[ReportFrame, MountAxes], float]:
        """Probability of each reading; 0 for readings excluded by a decision or by the arguments.

        Args:
            frame: As configured; None for the evidence's.
            axes: As configured; None for the evidence's. Angles relative to the horizon are always aerospace angles.
        """
        frame, axes = frame or self.frame, axes or self.axes
        body = self.body_probability if frame is None else float(frame is ReportFrame.BODY)
        mounts = self.mount_probabilities if axes is None else {axes: 1.0}
        return {
            (ReportFrame.EARTH, MountAxes.TILT_OUTER): 1 - body,
            **{(ReportFrame.BODY, each): body * mounts.get(each, 0.0) for each in GIMBAL_MOUNTS},
        }


class FrameDetector:
    """Decides on the frame of one gimbal's reports, in order, independently of how they are split into calls.

    Attributes:
        evidence: The present evidence.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Drop all evidence: the gimbal may be another one."""
        self._recent: deque[GravitySample] = deque()
        self._second_differences_rad: deque[float] = deque(maxlen=_NOISE_WINDOW)
        self._range_rad = (math.inf, -math.inf)  # of reported pitches
        self._log_weights = np.zeros(1 + BODY_READINGS)  # of each reading, relative to the likeliest
        self._at_limit = np.zeros(BODY_READINGS)  # part of the log ratio to the horizon that a limit could explain
        self._recent_steps: deque[tuple[int, FloatArray]] = deque()  # ends of motions, and their log evidence
        self._undone = np.zeros(BODY_READINGS, dtype=np.int64)
        self._motions = self._motion_ns = self._changes = 0
        self._frame: ReportFrame | None = None
        self._most_support = 0.0  # for it so far, as log evidence
        self._is_doubted = False
        self._axes: MountAxes | None = None
        self.evidence = self._evidence()

    def end_motion(self) -> None:
        """Start a new motion after a gap or a change of clock; the evidence is kept."""
        self._recent.clear()

    def update(self, sample: GravitySample) -> None:
        """Process the next report; score the motion of the vehicle that it ends, if any."""
        low, high = self._range_rad
        self._range_rad = min(low, sample.reported_pitch_rad), max(high, sample.reported_pitch_rad)
        while self._recent and sample.stamp_ns - self._recent[0].stamp_ns > _WINDOW_NS:
            self._recent.popleft()
        if len(self._recent) > 1:
            first, second = self._recent[-2], self._recent[-1]
            downs = zip(sample.down_body, second.down_body, first.down_body, strict=True)
            second_difference_rad = math.hypot(*(last - 2 * before + earlier for last, before, earlier in downs))
            self._second_differences_rad.append(max(second_difference_rad, sample.second_difference_rad))
        if self._recent and len(self._second_differences_rad) > _MIN_NOISE_SAMPLES:
            rotations = list(map(math.dist, repeat(sample.down_body), [before.down_body for before in self._recent]))
            start = rotations.index(max(rotations))
            if rotations[start] >= _MIN_MOTION_RAD and rotations[start] >= _MIN_MOTION_STDS * self._noise_rad():
                self._score_motion(self._recent[start], sample, rotations[start])
                self._recent.clear()
        self._recent.append(sample)

    def update_all(self, gravity_samples: GravitySamples) -> Iterator[tuple[int, FrameEvidence]]:
        """Process reports in order; unknown ones end the motion, and after a silence the evidence starts anew.

        Returns:
            Stamps of the reports that changed the evidence, and the evidence after each.
        """
        is_new = gravity_samples.silence_ns >= _EXCHANGE_NS
        for row in range(len(gravity_samples)):
            before = self.evidence
            if is_new[row]:
                self.forget()
            if gravity_samples.is_known[row]:
                self.update(gravity_samples.row(row))
            else:
                self.end_motion()
            if self.evidence is not before:
                yield int(gravity_samples.stamp_ns[row]), self.evidence

    def _noise_rad(self) -> float:
        """Standard deviation of the vehicle's reported tilt; a bit more where it rotates fast."""
        ordered = sorted(self._second_differences_rad)
        return (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2 * _STD_PER_DIFFERENCE

    def _score_motion(self, start: GravitySample, end: GravitySample, motion_rad: float) -> None:
        rotations = np.linalg.norm(
            np.vstack([end.down_if_earth, end.down_if_body]) - np.vstack([start.down_if_earth, start.down_if_body]),
            axis=-1,
        )
        log_density = _log_density(rotations / math.hypot(_NOISE_RAD, _RESIDUAL_MOTION * motion_rad))
        step = self._limit_per_window(end.stamp_ns, log_density[1:] - log_density[0])
        if self._may_be_at_limit(start) and self._may_be_at_limit(end):
            before, self._at_limit = self._at_limit, np.maximum(self._at_limit + step, -_MAX_AT_LIMIT)
            step = self._at_limit - before
        self._log_weights = _clip_below(self._log_weights + np.concatenate([[0.0], step]), _MAX_LOG_RATIO)
        self._undone += log_density[1:] > log_density[0]
        self._motions += 1
        self._motion_ns += end.stamp_ns - start.stamp_ns
        self._decide()
        self.evidence = self._evidence()

    def _limit_per_window(self, stamp_ns: int, ratio: FloatArray) -> FloatArray:
        """Log evidence of a motion, limited together with that of motions shortly before it: parts of one."""
        while self._recent_steps and stamp_ns - self._recent_steps[0][0] > _WINDOW_NS:
            self._recent_steps.popleft()
        steps = [step for _, step in self._recent_steps]
        recent = np.sum(steps, axis=0) if steps else np.zeros_like(ratio)
        limited = _clip_below(np.clip(ratio, -_MAX_PER_MOTION, _MAX_PER_MOTION), _MAX_PER_MOTION)
        step = _clip_below(np.clip(recent + limited, -_MAX_PER_WINDOW, _MAX_PER_WINDOW), _MAX_PER_WINDOW) - recent
        self._recent_steps.append((stamp_ns, step))
        return np.asarray(step)

    def _may_be_at_limit(self, sample: GravitySample) -> bool:
        """Whether it is at an end of the range, and not beyond straight down: of that a limit falls short."""
        low, high = self._range_rad
        at_end = min(sample.reported_pitch_rad - low, high - sample.reported_pitch_rad) < _AT_LIMIT_RAD
        return at_end and float(np.max(sample.down_if_body[:, 2])) > -_MIN_MOTION_RAD

    def _decide(self) -> None:
        """Decide on a frame and a mount at certainty; a decision is reversed only at the same certainty.

        It is doubted while certain evidence against it has come since most spoke for it, however much that was: the
        gimbal may be another one.
        """
        by_axes = self._log_by_axes() - np.log(_PRIOR_BY_AXES)
        ratio = float(np.max(by_axes) - self._log_weights[0])
        if abs(ratio) >= math.log(CERTAIN):
            frame = ReportFrame.BODY if ratio > 0 else ReportFrame.EARTH
            if frame is not self._frame:
                self._changes += self._frame is not None
                self._frame, self._most_support = frame, 0.0
        if np.ptp(by_axes) >= math.log(CERTAIN):
            self._axes = AXES[int(np.argmax(by_axes))]
        support = ratio if self._frame is ReportFrame.BODY else -ratio
        self._most_support = max(self._most_support, support)
        self._is_doubted = self._frame is not None and self._most_support - support >= math.log(CERTAIN)

    def _evidence(self) -> FrameEvidence:
        by_axes = self._log_by_axes()
        return FrameEvidence(
            frame=None if self._is_doubted else self._frame,
            axes=self._axes,
            contradictory=self._changes > 1,
            body_probability=0.5 if self._is_doubted else 1 / (1 + math.exp(-self._log_odds_body())),
            mount_probabilities=dict(zip(AXES, np.exp(by_axes - _log_sum(by_axes)).tolist(), strict=True)),
            motions=self._motions,
            undone=int(self._undone[int(np.argmax(self._log_weights[1:]))]),
            motion_s=self._motion_ns / SECOND_NS,
        )

    def _log_odds_body(self) -> float:
        """Log odds of body over earth, with the prior."""
        return _log_sum(self._log_by_axes()) - float(self._log_weights[0] + _LOG_PRIOR[0])

    def _log_by_axes(self) -> FloatArray:
        """Log weights of each mount on the vehicle, with the prior."""
        return np.array([_log_sum(each) for each in np.split((self._log_weights + _LOG_PRIOR)[1:], len(AXES))])


def _clip_below(log_weights: FloatArray, max_difference: float) -> FloatArray:
    """Log weights, raised to at most ``max_difference`` below the largest."""
    return np.maximum(log_weights, np.max(log_weights) - max_difference)


def _log_sum(logarithms: FloatArray) -> float:
    """Logarithm of the sum of exponentials."""
    largest = float(np.max(logarithms))
    return largest + math.log(float(np.sum(np.exp(logarithms - largest))))


def _log_density(rotations: FloatArray) -> FloatArray:
    """Log density, up to a constant, of a Cauchy distribution of two small angles: commands have long tails."""
    return np.asarray(-1.5 * np.log1p(rotations**2))
