"""Whether a gimbal's angles are against the horizon, as the standard says, or against the vehicle, told from the data.

A stabilised camera keeps its attitude while the vehicle moves: reports against the horizon then stay as they are,
reports against the vehicle undo its motion. Every motion of the vehicle is weighed under both readings by how far the
camera would have turned against gravity, which needs no yaw and is regular at nadir.

Reports against the vehicle hold servo angles, which come to one attitude where the roll servo carries the tilt servo,
and to another where it is the other way round: each is a reading of its own.

Two kinds of reports against the vehicle stay as well: those of a servo at its limit, so that what is held at the end
of the range counts little, and the demand of a camera that is not stabilised, which only its owner knows.
"""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise, repeat
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import from_yaw_pitch_roll, matrix, multiply, yaw_pitch_roll
from aerodft.model import BoolArray, FloatArray, IntArray, MountAxes, ReportFrame
from aerodft.service.attitude.servo_mount import mounted_wxyz
from aerodft.service.streams import Stream

LAGS_NS: Final = (0, 100_000_000, 200_000_000, 300_000_000)
"""How much older than its stamp a report may be: each is tried."""

AXES: Final = tuple(MountAxes)
BODY_READINGS: Final = len(AXES) * len(LAGS_NS)
"""The ways to read a report against the vehicle: each mount, and of each every lag."""

_NEIGHBOURS = 3  # samples that a stamp's values are made of, those before it
_STEP_NS = 100_000_000  # reports closer than this tell nothing new


@dataclass(frozen=True, slots=True)
class GravitySample:
    """Unit vectors of gravity at one report.

    Attributes:
        stamp_ns: The report's.
        reported_pitch_rad: As it stands in the report.
        down_body: Three numbers, in the vehicle's axes.
        down_if_earth: ``(3,)`` in the gimbal's axes, if the report's roll and pitch are against the horizon.
        down_if_body: ``(BODY_READINGS, 3)`` in the gimbal's axes, if they are servo angles of each mount, on the
            vehicle as it was each lag before.
        bend_rad: How far ``down_body`` was from the mean of its neighbours, twice, in the vehicle's own last samples:
            between slow ones nothing is seen of their noise.
    """

    stamp_ns: int
    reported_pitch_rad: float
    down_body: Sequence[float]
    down_if_earth: FloatArray
    down_if_body: FloatArray
    bend_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class GravitySamples:
    """Unit vectors of gravity at ``n`` reports, in order, as columns.

    Attributes:
        is_known: ``(n,)`` whether the vehicle's attitude is known on both sides, and for the longest lag before.
        stamp_ns: ``(n,)``, see ``GravitySample`` for this and all others.
        reported_pitch_rad: ``(n,)``.
        down_body: ``(n, 3)``.
        down_if_earth: ``(n, 3)``.
        down_if_body: ``(n, BODY_READINGS, 3)``.
        bend_rad: ``(n,)``.
    """

    is_known: BoolArray
    stamp_ns: IntArray
    reported_pitch_rad: FloatArray
    down_body: FloatArray
    down_if_earth: FloatArray
    down_if_body: FloatArray
    bend_rad: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def rows(self, rows: slice) -> "GravitySamples":
        """The samples of a slice."""
        return GravitySamples(*(getattr(self, each.name)[rows] for each in fields(self)))

    def row(self, row: int) -> GravitySample:
        """One sample."""
        return GravitySample(
            int(self.stamp_ns[row]),
            float(self.reported_pitch_rad[row]),
            self.down_body[row].tolist(),
            self.down_if_earth[row],
            self.down_if_body[row],
            float(self.bend_rad[row]),
        )


def gravity_samples(gimbal: Stream, vehicle: Stream, *, after_ns: int, until_ns: int) -> GravitySamples | None:
    """The reports after a stamp and up to another, at most one in each tenth of a second; None where there are none."""
    rows = _rows(gimbal.stamps_ns, after_ns, until_ns)
    if not len(rows) or vehicle.last_ns is None:
        return None
    stamps, wxyz = gimbal.stamps_ns[rows], gimbal.column("wxyz")[rows]
    first = max(int(np.searchsorted(vehicle.stamps_ns, stamps[0] - max(LAGS_NS))) - _NEIGHBOURS, 0)
    samples_ns, attitudes = vehicle.stamps_ns[first:], vehicle.column("wxyz")[first:]
    before = np.stack([stamps - lag_ns for lag_ns in LAGS_NS], axis=-1)
    own_downs = matrix(attitudes)[:, 2]
    downs, known = _between(samples_ns, own_downs, before, vehicle.max_gap_ns)
    bends = _bends(own_downs)[np.searchsorted(samples_ns, stamps, side="right") - 1]
    latest = attitudes[np.clip(np.searchsorted(samples_ns, stamps), 0, len(attitudes) - 1)]
    yaws = np.where(gimbal.column("yaw_in_earth")[rows] > 0, yaw_pitch_roll(latest)[0], 0.0)
    against_body = multiply(from_yaw_pitch_roll(-yaws, 0.0, 0.0), wxyz)
    on_mounts = [matrix(mounted_wxyz(against_body, axes, latest, yaw_in_earth=False)) for axes in AXES]
    if_body = np.concatenate([downs @ on_mount for on_mount in on_mounts], axis=1)
    return GravitySamples(known, stamps, yaw_pitch_roll(wxyz)[1], downs[:, 0], matrix(wxyz)[:, 2], if_body, bends)


def _bends(downs: FloatArray) -> FloatArray:
    """Length ``(n,)`` of the second differences that end at each of ``downs (n, 3)``; 0 of the first two."""
    return np.concatenate([np.zeros(min(2, len(downs))), np.linalg.norm(np.diff(downs, n=2, axis=0), axis=-1)])


def _rows(stamps_ns: IntArray, after_ns: int, until_ns: int) -> IntArray:
    """The first report in each tenth of a second."""
    first, stop = np.searchsorted(stamps_ns, [after_ns, until_ns], side="right").tolist()
    tenths = stamps_ns[first:stop] // _STEP_NS
    fresh = np.diff(tenths, prepend=after_ns // _STEP_NS - 1) > 0
    return np.flatnonzero(fresh) + int(first)


def _between(
    samples_ns: IntArray, values: FloatArray, stamps_ns: IntArray, max_gap_ns: int
) -> tuple[FloatArray, BoolArray]:
    """The vehicle's ``values (m, 3)`` at ``stamps_ns (n, lags)`` and which rows ``(n,)`` are known, for all lags.

    Returns:
        ``(n, lags, 3)`` linear between samples, and ``(n,)``.
    """
    after = np.clip(np.searchsorted(samples_ns, stamps_ns), 1, len(samples_ns) - 1)
    gap = samples_ns[after] - samples_ns[after - 1]
    weight = (stamps_ns - samples_ns[after - 1]) / np.maximum(gap, 1)
    known = (weight >= 0) & (weight <= 1) & (gap <= max_gap_ns) & (gap > 0)
    return values[after - 1] + weight[..., None] * (values[after] - values[after - 1]), np.all(known, axis=-1)


PRIOR_BODY: Final = 0.25
"""Before any evidence: servo mounts, and most senders of the older messages, report against the vehicle."""

_PRIOR_AXES: Final = {MountAxes.ROLL_OUTER: 0.75, MountAxes.TILT_OUTER: 0.25}

CERTAIN: Final = 1e4
"""A verdict is this many times as likely as its opposite."""

_WINDOW_NS = 2 * SECOND_NS  # a motion is over within it: slower ones may as well be commands
_LEAST_MOTION_RAD = math.radians(2)  # ten times the error of an autopilot's own attitude
_ROUNDING_RAD = 1e-9
_LEAST_MOTION_STDS = 8  # the noise of twenty attitudes reaches six
_NOISE_WINDOW = 300  # reports
_ENOUGH_NOISE = 15  # reports
_NOISE_OF_BEND = 1 / (math.sqrt(6) * 1.177)  # median length of white noise's second differences, in two directions
_NOISE_RAD = math.radians(0.3)
_LEFT_OVER = 0.25  # share of the vehicle's motion that lags and poor stabilisation leave
_MOST_A_MOTION = math.log(10)  # a command may fall together with a motion,
_MOST_AT_ONCE = 2 * _MOST_A_MOTION  # and, less often, with all parts of a long one
_MOST_AT_LIMIT = math.log(200)
_AT_LIMIT_RAD = math.radians(1)
_MOST = 3 * math.log(CERTAIN)  # what was learned can be unlearned
# Of each way to read a report: the horizon, then the vehicle by mounts and lags.
_LOG_PRIOR: Final = np.log(
    [1 - PRIOR_BODY, *(PRIOR_BODY * _PRIOR_AXES[axes] / len(LAGS_NS) for axes in AXES for _ in LAGS_NS)]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameEvidence:
    """What is known of one gimbal's reports.

    Attributes:
        frame: The verdict; None as long as there is none.
        axes: The verdict on the mount, if roll and pitch are against the vehicle; None as long as there is none.
        contradictory: The verdict on the frame changed more than once: no reading holds.
        body_probability: That roll and pitch are against the vehicle.
        tilt_outer_probability: That the tilt servo carries the roll servo, if they are.
        motions: How many motions of the vehicle were weighed.
        undone: How many of them the reports undid, rather than not.
        motion_s: How long they lasted, together.
    """

    frame: ReportFrame | None
    axes: MountAxes | None
    contradictory: bool
    body_probability: float
    tilt_outer_probability: float
    motions: int
    undone: int
    motion_s: float

    def reading_probabilities(
        self, frame: ReportFrame | None, axes: MountAxes | None
    ) -> dict[tuple[ReportFrame, MountAxes], float]:
        """How likely each way to read the reports is; those that a verdict or the arguments exclude are 0.

        Args:
            frame: As stated; None to go by what was found.
            axes: As stated; None to go by what was found. Angles against the horizon are always aerospace Euler angles.
        """
        frame, axes = frame or self.frame, axes or self.axes
        body = self.body_probability if frame is None else float(frame is ReportFrame.BODY)
        tilt_outer = self.tilt_outer_probability if axes is None else float(axes is MountAxes.TILT_OUTER)
        return {
            (ReportFrame.EARTH, MountAxes.TILT_OUTER): 1 - body,
            (ReportFrame.BODY, MountAxes.ROLL_OUTER): body * (1 - tilt_outer),
            (ReportFrame.BODY, MountAxes.TILT_OUTER): body * tilt_outer,
        }


class FrameDetector:
    """Weighs one gimbal's reports, in order; what it finds does not depend on when it is asked.

    Attributes:
        evidence: What is known by now.
    """

    def __init__(self) -> None:
        self._recent: deque[GravitySample] = deque()
        self._bends_rad: deque[float] = deque(maxlen=_NOISE_WINDOW)
        self._range_rad = (math.inf, -math.inf)  # pitches reported so far
        self._log_weights = np.zeros(1 + BODY_READINGS)  # of each reading, against the likeliest
        self._at_limit = np.zeros(BODY_READINGS)  # the part against the horizon's that a limit could explain
        self._recent_steps: deque[tuple[int, FloatArray]] = deque()  # ends of motions, and what each of them told
        self._undone = np.zeros(BODY_READINGS, dtype=np.int64)
        self._motions = self._motion_ns = self._changes = 0
        self._frame: ReportFrame | None = None
        self._axes: MountAxes | None = None
        self.evidence = self._evidence()

    def break_off(self) -> None:
        """No motion is followed over a gap, or from one clock to another; what was learned stays."""
        self._recent.clear()

    def weigh(self, sample: GravitySample) -> None:
        """Take in the next report; where it ends a motion of the vehicle, learn from it."""
        low, high = self._range_rad
        self._range_rad = min(low, sample.reported_pitch_rad), max(high, sample.reported_pitch_rad)
        while self._recent and sample.stamp_ns - self._recent[0].stamp_ns > _WINDOW_NS:
            self._recent.popleft()
        if len(self._recent) > 1:
            first, second = self._recent[-2], self._recent[-1]
            downs = zip(sample.down_body, second.down_body, first.down_body, strict=True)
            bend_rad = math.hypot(*(last - 2 * before + earlier for last, before, earlier in downs))
            self._bends_rad.append(max(bend_rad, sample.bend_rad))
        if self._recent and len(self._bends_rad) > _ENOUGH_NOISE:
            turns = list(map(math.dist, repeat(sample.down_body), [before.down_body for before in self._recent]))
            farthest = turns.index(max(turns))
            if turns[farthest] >= _LEAST_MOTION_RAD and turns[farthest] >= _LEAST_MOTION_STDS * self._noise_rad():
                self._learn(self._recent[farthest], sample, turns[farthest])
                self._recent.clear()
        self._recent.append(sample)

    def weigh_all(self, gravity_samples: GravitySamples) -> Iterator[tuple[int, FrameEvidence]]:
        """Take in reports as ``weigh`` does one after the other, most of which end no motion; gaps break off.

        Returns:
            Stamps of those that something was learned from, and what is known then.
        """
        is_calm = gravity_samples.is_known & ~self._may_end_motion(gravity_samples)
        ends = [0, *(np.flatnonzero(np.diff(is_calm)) + 1).tolist(), len(gravity_samples)]
        for first, stop in pairwise(ends):
            if is_calm[first]:
                self._skip(gravity_samples.rows(slice(first, stop)))
                continue
            for row in range(first, stop):
                before = self.evidence
                if gravity_samples.is_known[row]:
                    self.weigh(gravity_samples.row(row))
                else:
                    self.break_off()
                if self.evidence is not before:
                    yield int(gravity_samples.stamp_ns[row]), self.evidence

    def _may_end_motion(self, gravity_samples: GravitySamples) -> BoolArray:
        """Which of the reports ``(n,)`` may end a motion: the vehicle is far from what it was within its time."""
        stamps, downs = _behind(self._recent, gravity_samples)
        squared = np.zeros(len(stamps))
        for ago in range(1, len(stamps)):
            is_near = stamps[ago:] - stamps[:-ago] <= _WINDOW_NS
            if not np.any(is_near):
                break
            away = downs[ago:] - downs[:-ago]
            squared[ago:] = np.maximum(squared[ago:], np.where(is_near, (away * away).sum(axis=1), 0.0))
        return np.asarray(squared[len(self._recent) :] >= (_LEAST_MOTION_RAD - _ROUNDING_RAD) ** 2)

    def _skip(self, gravity_samples: GravitySamples) -> None:
        """Take in reports that end no motion."""
        low, high = self._range_rad
        pitches = gravity_samples.reported_pitch_rad
        self._range_rad = min(low, float(pitches.min())), max(high, float(pitches.max()))
        stamps, downs = _behind(list(self._recent)[-2:], gravity_samples)
        bends = downs[2:] - 2 * downs[1:-1] + downs[:-2]
        is_near = stamps[2:] - stamps[:-2] <= _WINDOW_NS
        own = gravity_samples.bend_rad[len(gravity_samples) - len(bends) :]
        lengths = map(math.hypot, *bends[is_near].T.tolist())
        self._bends_rad.extend(map(max, lengths, own[is_near].tolist()))
        first = int(np.searchsorted(gravity_samples.stamp_ns, gravity_samples.stamp_ns[-1] - _WINDOW_NS))
        self._recent.extend(gravity_samples.row(row) for row in range(first, len(gravity_samples)))
        while self._recent[-1].stamp_ns - self._recent[0].stamp_ns > _WINDOW_NS:
            self._recent.popleft()

    def _noise_rad(self) -> float:
        """Standard deviation of the vehicle's reported tilt, or a bit more where it turns fast."""
        ordered = sorted(self._bends_rad)
        return (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2 * _NOISE_OF_BEND

    def _learn(self, start: GravitySample, end: GravitySample, turn_rad: float) -> None:
        turns = np.linalg.norm(
            np.vstack([end.down_if_earth, end.down_if_body]) - np.vstack([start.down_if_earth, start.down_if_body]),
            axis=-1,
        )
        log_density = _log_density(turns / math.hypot(_NOISE_RAD, _LEFT_OVER * turn_rad))
        step = self._unexplained(end.stamp_ns, log_density[1:] - log_density[0])
        if self._may_be_at_limit(start) and self._may_be_at_limit(end):
            before, self._at_limit = self._at_limit, np.maximum(self._at_limit + step, -_MOST_AT_LIMIT)
            step = self._at_limit - before
        self._log_weights = _floored(self._log_weights + np.concatenate([[0.0], step]), _MOST)
        self._undone += log_density[1:] > log_density[0]
        self._motions += 1
        self._motion_ns += end.stamp_ns - start.stamp_ns
        self._decide()
        self.evidence = self._evidence()

    def _unexplained(self, stamp_ns: int, ratio: FloatArray) -> FloatArray:
        """What a motion adds to what those shortly before it told: they may be parts of one."""
        while self._recent_steps and stamp_ns - self._recent_steps[0][0] > _WINDOW_NS:
            self._recent_steps.popleft()
        steps = [step for _, step in self._recent_steps]
        recent = np.sum(steps, axis=0) if steps else np.zeros_like(ratio)
        own = _floored(np.clip(ratio, -_MOST_A_MOTION, _MOST_A_MOTION), _MOST_A_MOTION)
        step = _floored(np.clip(recent + own, -_MOST_AT_ONCE, _MOST_AT_ONCE), _MOST_AT_ONCE) - recent
        self._recent_steps.append((stamp_ns, step))
        return np.asarray(step)

    def _may_be_at_limit(self, sample: GravitySample) -> bool:
        low, high = self._range_rad
        return min(sample.reported_pitch_rad - low, high - sample.reported_pitch_rad) < _AT_LIMIT_RAD

    def _decide(self) -> None:
        """A verdict needs certainty, and goes only with the same certainty of the opposite."""
        by_axes = self._log_by_axes() - np.log([PRIOR_BODY * _PRIOR_AXES[axes] for axes in AXES])
        ratio = float(np.max(by_axes) - self._log_weights[0])
        if abs(ratio) >= math.log(CERTAIN):
            frame = ReportFrame.BODY if ratio > 0 else ReportFrame.EARTH
            self._changes += self._frame not in {None, frame}
            self._frame = frame
        if np.ptp(by_axes) >= math.log(CERTAIN):
            self._axes = AXES[int(np.argmax(by_axes))]

    def _evidence(self) -> FrameEvidence:
        by_axes = self._log_by_axes()
        return FrameEvidence(
            frame=self._frame,
            axes=self._axes,
            contradictory=self._changes > 1,
            body_probability=1 / (1 + math.exp(-self._log_odds_body())),
            tilt_outer_probability=math.exp(by_axes[AXES.index(MountAxes.TILT_OUTER)] - _log_sum(by_axes)),
            motions=self._motions,
            undone=int(self._undone[int(np.argmax(self._log_weights[1:]))]),
            motion_s=self._motion_ns / SECOND_NS,
        )

    def _log_odds_body(self) -> float:
        """Body against earth, with what is likely before any evidence."""
        return _log_sum(self._log_by_axes()) - float(self._log_weights[0] + _LOG_PRIOR[0])

    def _log_by_axes(self) -> FloatArray:
        """Of each mount against the vehicle, with what is likely before any evidence."""
        return np.array([_log_sum(each) for each in np.split((self._log_weights + _LOG_PRIOR)[1:], len(AXES))])


def _floored(log_weights: FloatArray, most: float) -> FloatArray:
    """None more than ``most`` below the likeliest."""
    return np.maximum(log_weights, np.max(log_weights) - most)


def _log_sum(logarithms: FloatArray) -> float:
    """The logarithm of a sum, by those of what is summed."""
    most = float(np.max(logarithms))
    return most + math.log(float(np.sum(np.exp(logarithms - most))))


def _behind(recent: Sequence[GravitySample], gravity_samples: GravitySamples) -> tuple[IntArray, FloatArray]:
    """Stamps ``(n,)``, and where down is for the vehicle ``(n, 3)``, of some reports and others behind them."""
    stamps = np.array([each.stamp_ns for each in recent], dtype=np.int64)
    downs = np.array([each.down_body for each in recent]).reshape(-1, 3)
    return np.concatenate([stamps, gravity_samples.stamp_ns]), np.concatenate([downs, gravity_samples.down_body])


def _log_density(turns: FloatArray) -> FloatArray:
    """Of a Cauchy distribution in the plane of two small angles, but for a constant: commands have long tails."""
    return np.asarray(-1.5 * np.log1p(turns**2))
