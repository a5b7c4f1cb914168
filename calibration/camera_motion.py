"""A fixed camera that is bumped: its attitude, corrected by what its steady points show.

A look at these points says by how much the camera has turned, or why that cannot be told. From look to look it rests,
was bumped, is moving, or cannot be told. Where it looks is the mean over the last looks; how far single images scatter
about that is learned beside it.
"""

import hashlib
import math
from collections import deque
from collections.abc import Sequence
from copy import copy, deepcopy
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import (
    RelativeRotation,
    find_rotation,
    from_rotation_vector,
    intrinsics_covariance,
    inverse,
    matrix,
    multiply,
    to_rotation_vector,
)
from aerodft.model import (
    FIXED_POINTS,
    Camera,
    CameraMotionEstimate,
    FloatArray,
    IntArray,
    MotionState,
    Observation,
    Pose,
    PoseBatch,
    PoseSample,
    Status,
)
from aerodft.service import CameraMotionSettings, PipelineSettings

_MIN_AGREEING: Final = 8
_MIN_SHARE: Final = 0.2  # of the points: strays agree by chance
_FINE: Final = 0.25  # of the limit: a turn that is known less well tells nothing
_STAY: Final = 0.4  # of the points: so many in the wrong place, and staying there, are no passers-by
_OFF: Final = 0.5  # of the limit, at the principal point: what counts as the wrong place
_MIN_OFF_PX: Final = 2.0
_WINDOW: Final = 10
_MEMORY: Final = 60  # looks
_EXPECTED_LOOKS: Final = 4  # that the expectation counts for, against what is seen
_EXPECTED: Final = 0.15  # of the limit: standard deviation of a mast in the wind, about an axis
_STRONG: Final = 0.25  # of the limit: in as strong a wind as may be, before a few looks have told better
_SHARED_PX: Final = 0.03  # what all points of a look are off by together, as trackers and sensors make it
_RARE: Final = 6.0  # standard deviations about each axis: once in millions of looks
_NOTED: Final = 3.0
_BACK: Final = 0.9  # of the limit: who is within it again, by more than noise
_HOUR_NS: Final = 3600 * SECOND_NS
_NUMBERLESS: Final = {
    MotionState.MOVING: "the camera turned, or was displaced, and where it rests is not known yet",
    MotionState.UNKNOWN_VIEW: (
        "the view is not the reference's, turned: the camera was displaced, looks elsewhere, or is covered;"
        " set it up as it was, or calibrate it anew"
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class KnownTurn:
    """A turn with its errors.

    Attributes:
        wxyz: ``(4,)`` ``now_SO3_reference``.
        cov: ``(..., 3, 3)`` of a small rotation about the camera's axes now, without the lens's part (rad^2).
        jac_intrinsics: ``(3, m)``: that small rotation by errors of the intrinsics.
        lens_cov: ``(m, m)`` of the intrinsics.
        shift_m: Standard deviation, along each axis, of how far the lens went along.
    """

    wxyz: FloatArray
    cov: FloatArray
    jac_intrinsics: FloatArray
    lens_cov: FloatArray
    shift_m: float

    @property
    def rotvec_rad(self) -> FloatArray:
        """``(3,)``: the camera's own rotation about its axes, ``reference_SO3_now``."""
        return to_rotation_vector(inverse(self.wxyz))

    @property
    def std_rad(self) -> FloatArray:
        """``(..., 3)`` about the camera's axes now, the lens's part included."""
        by_lens = self.jac_intrinsics @ self.lens_cov @ self.jac_intrinsics.T
        return np.asarray(np.sqrt(np.diagonal(self.cov + by_lens, axis1=-2, axis2=-1)))


def rotated_pose(pose: Pose, turn: KnownTurn) -> Pose:
    """The poses ``(...)`` after the turn.

    A small rotation of the reference's camera axes becomes one of today's. The same errors of the lens are in the pose
    (where one calibration found both), in the turn, and in what is measured: they stay correlated.
    """
    carry = np.eye(6)
    carry[3:, 3:] = matrix(turn.wxyz)
    by_lens = np.zeros((6, len(turn.lens_cov)))
    by_lens[3:] = -turn.jac_intrinsics  # the pose's rotation is the turn's inverse
    with_lens = carry @ (pose.lens_cov if pose.lens_cov.shape[-1] else np.zeros_like(by_lens))
    crossed = with_lens @ by_lens.T
    cov = carry @ pose.cov @ carry.T + crossed + np.swapaxes(crossed, -1, -2) + by_lens @ turn.lens_cov @ by_lens.T
    cov[..., 3:, 3:] += turn.cov
    cov[..., :3, :3] += turn.shift_m**2 * np.eye(3)
    return replace(
        pose,
        wxyz=multiply(pose.wxyz, inverse(turn.wxyz)),
        cov=(cov + np.swapaxes(cov, -1, -2)) / 2,
        lens_cov=with_lens + by_lens @ turn.lens_cov,
    )


def rotated_std(std: FloatArray, turn: KnownTurn) -> FloatArray:
    """The poses' stds in people's words, ``(n, 7)`` in the order of ``PoseStd``, after the turn."""
    added = np.zeros_like(std)
    added[:, :2], added[:, 2:5] = turn.shift_m, turn.std_rad
    return np.hypot(std, added)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Rotation of the camera by one observation of its steady points.

    Attributes:
        turn: ``now_SO3_reference``, maybe none at all; None where it cannot be told.
        points: How many were found again.
        is_unknown_view: Points stand still where a camera that only turned would not see them.
    """

    turn: RelativeRotation | None
    points: int
    is_unknown_view: bool = False


class LookJudge:
    """Judges looks one after the other; remembers where strays were.

    Args:
        camera: The camera.
        limit_rad: What counts as moved.
    """

    def __init__(self, camera: Camera, limit_rad: float) -> None:
        self._camera = camera
        self._fine_rad = _FINE * limit_rad
        self._off_px = max(_OFF * limit_rad * camera.fx_px, _MIN_OFF_PX)
        self._strays: dict[tuple[float, ...], FloatArray] = {}

    def judge(self, seen: Observation) -> Look:
        """The camera's rotation by pairs of pixels (reference, now)."""
        pairs = np.array(seen.pixels, dtype=np.float64).reshape(-1, 2, 2)
        turn = find_rotation(self._camera, pairs[:, 0], pairs[:, 1])
        staying = self._staying(pairs, turn)
        if len(pairs) >= _MIN_AGREEING and staying >= _STAY * len(pairs):
            return Look(None, len(pairs), is_unknown_view=True)
        return Look(turn if turn is not None and self._tells(turn) else None, len(pairs))

    def _tells(self, turn: RelativeRotation) -> bool:
        agreeing = int(np.count_nonzero(turn.inliers))
        enough = agreeing >= max(_MIN_AGREEING, _MIN_SHARE * len(turn.inliers))
        return enough and float(np.max(np.diag(turn.cov))) <= self._fine_rad**2

    def _staying(self, pairs: FloatArray, turn: RelativeRotation | None) -> int:
        """Number of points that the turn does not explain, and that were in the same place at the last look."""
        is_stray = np.ones(len(pairs), dtype=np.bool_) if turn is None else _beyond(turn.residual_px, self._off_px)
        before, self._strays = self._strays, {tuple(then.tolist()): now for then, now in pairs[is_stray]}
        return sum(
            key in before and bool(np.max(np.abs(place - before[key])) <= self._off_px)
            for key, place in self._strays.items()
        )


def _beyond(off_px: FloatArray, limit_px: float) -> np.ndarray:
    """Farther off than the limit; what a turned camera should not see at all is."""
    return np.asarray(~(np.max(np.abs(off_px), axis=-1) <= limit_px))


class Scatter:
    """Scatter of a camera's rotation between images, equal about each axis.

    Args:
        limit_rad: What counts as moved.
    """

    def __init__(self, limit_rad: float) -> None:
        self._weight = float(_EXPECTED_LOOKS)
        self._strong_rad2 = (_STRONG * limit_rad) ** 2
        self.variance_rad2 = (_EXPECTED * limit_rad) ** 2

    @property
    def max_rad2(self) -> float:
        """Upper bound of the variance about each axis."""
        is_known = self._weight >= _EXPECTED_LOOKS + _WINDOW
        return self.variance_rad2 if is_known else max(self.variance_rad2, self._strong_rad2)

    def learn(self, off_rad: FloatArray) -> None:
        """Take in how far a look was ``(3,)`` from where the camera looks on the whole."""
        self._weight = min(self._weight + 1, float(_MEMORY))
        self.variance_rad2 += (float(np.mean(np.square(off_rad))) - self.variance_rad2) / self._weight


class RestAttitude:
    """The mean over the last looks of a camera that rests."""

    def __init__(self, first: RelativeRotation) -> None:
        self._base_wxyz = first.wxyz
        self._turns: deque[RelativeRotation] = deque([first], maxlen=_WINDOW)
        self._mean_rad = np.zeros(3)

    @classmethod
    def over(cls, turns: list[RelativeRotation]) -> "RestAttitude":
        """Over some looks, at least one."""
        rest = cls(turns[0])
        for turn in turns[1:]:
            rest.add(turn)
        return rest

    @property
    def wxyz(self) -> FloatArray:
        """``(4,)`` ``now_SO3_reference``."""
        return multiply(from_rotation_vector(self._mean_rad), self._base_wxyz)

    @property
    def looks(self) -> int:
        """Number of averaged looks."""
        return len(self._turns)

    @property
    def last(self) -> RelativeRotation:
        """The newest look."""
        return self._turns[-1]

    def add(self, turn: RelativeRotation) -> None:
        """Take in a look; the oldest one leaves."""
        self._turns.append(turn)
        self._mean_rad = np.mean([_between(self._base_wxyz, each) for each in self._turns], axis=0)

    def off(self, turn: RelativeRotation) -> FloatArray:
        """Small rotation ``(3,)`` of a look from the mean, about the camera's axes now."""
        return _between(self.wxyz, turn)

    def newest(self, count: int) -> list[RelativeRotation]:
        """The last looks."""
        return list(self._turns)[-count:]

    def step(self, count: int) -> FloatArray:
        """Mean rotation ``(3,)`` from all looks but the last ``count`` to these; zero where that leaves none."""
        offs = [_between(self._base_wxyz, each) for each in self._turns]
        if len(offs) <= count:
            return np.zeros(3)
        return np.asarray(np.mean(offs[-count:], axis=0) - np.mean(offs[:-count], axis=0))

    def covariance(self, focal_px: float, variance_rad2: float) -> FloatArray:
        """``(3, 3)`` of where a single image looks, by the looks' own errors and by how far images scatter.

        Errors of the looks are not averaged away: the points' places in the reference are the same in all of them.
        """
        measured = np.mean([each.cov for each in self._turns], axis=0)
        scatter = (_SHARED_PX / focal_px) ** 2 + variance_rad2 * (1 + 1 / len(self._turns))
        return np.asarray(measured + scatter * np.eye(3))


def _between(wxyz: FloatArray, turn: RelativeRotation) -> FloatArray:
    return to_rotation_vector(multiply(turn.wxyz, inverse(wxyz)))


class CameraMotionState:
    """A function of the looks that it was given, in their order.

    Args:
        settings: The limit, and how many looks must agree.

    Attributes:
        state: What the looks so far come to.
        since_ns: The first look that came to that.
        moved_ns: The first look that saw the camera where it rests by now, beyond the limit; None if it is within.
        determined_ns: The last look that told by how much the camera has turned.
        has_looked: Whether there were looks enough to say that none tells.
        rest: Where the camera looks; None before the first look that determined it.
        off_rad: How far the last look was ``(3,)`` from there; zero where that may be chance.
    """

    def __init__(self, settings: CameraMotionSettings) -> None:
        self.state = MotionState.UNCHECKED
        self.since_ns = 0
        self.moved_ns: int | None = None
        self.determined_ns: int | None = None
        self.has_looked = False
        self.rest: RestAttitude | None = None
        self.off_rad: FloatArray = np.zeros(3)
        self._settings = settings
        self._scatter = Scatter(settings.limit_rad)
        self._elsewhere: list[RelativeRotation] = []
        self._strange = self._nothing = self._beyond = 0
        self._left_ns = 0  # the first look of those that may come to a move

    @property
    def variance_rad2(self) -> float:
        """Variance of single images about each axis."""
        return self._scatter.variance_rad2

    def take(self, stamp_ns: int, look: Look) -> None:
        """Go on with a look."""
        before = self.state
        if look.turn is not None:
            self._strange = self._nothing = 0
            self.determined_ns = stamp_ns
            self.state = self._with_turn(stamp_ns, look.turn)
        elif look.is_unknown_view:
            self._strange, self._nothing = self._strange + 1, 0
            is_confirmed = self._strange >= self._settings.confirm_looks
            self.state = MotionState.UNKNOWN_VIEW if is_confirmed else MotionState.MOVING
        else:
            self._nothing += 1
            if self._nothing >= self._settings.confirm_looks:
                self.has_looked = True
                rested = before in {MotionState.STEADY, MotionState.MOVED}
                self.state = MotionState.UNCHECKED if rested else before
        if self.state is not before or not self.since_ns:
            self.since_ns = stamp_ns

    def _with_turn(self, stamp_ns: int, turn: RelativeRotation) -> MotionState:
        if self.rest is None:
            self.rest = RestAttitude(turn)
        elif np.linalg.norm(off_rad := self.rest.off(turn)) > max(self._settings.limit_rad, self._chance_rad(1.0)):
            return self._after_jump(stamp_ns, turn, off_rad)
        else:
            self.rest = self._followed(self.rest, turn, off_rad)
        self._elsewhere = []
        return self._within(stamp_ns, self.rest)

    def _followed(self, rest: RestAttitude, turn: RelativeRotation, off_rad: FloatArray) -> RestAttitude:
        """Attitude with a near look added; where the last few agree on a step, by these alone."""
        is_chance = np.linalg.norm(off_rad) <= self._chance_rad(1.0) * _NOTED / _RARE
        self.off_rad = np.zeros(3) if is_chance else off_rad
        self._scatter.learn(off_rad)
        rest.add(turn)
        few = self._settings.confirm_looks
        stepped = np.linalg.norm(rest.step(few)) > self._chance_rad(1 / few + 1 / max(rest.looks - few, 1))
        return RestAttitude.over(rest.newest(few)) if stepped else rest

    def _after_jump(self, stamp_ns: int, turn: RelativeRotation, off_rad: FloatArray) -> MotionState:
        """A look far from where the camera was: believed once enough in a row agree with each other."""
        close_rad = max(self._settings.limit_rad / 2, self._chance_rad(2.0))
        if self._elsewhere and np.linalg.norm(RestAttitude.over(self._elsewhere).off(turn)) > close_rad:
            self._elsewhere = []
        if not self._elsewhere:
            self._left_ns = stamp_ns
        self._elsewhere.append(turn)
        self.off_rad = off_rad
        if len(self._elsewhere) < self._settings.confirm_looks:
            return MotionState.MOVING
        self.rest, self.off_rad = RestAttitude.over(self._elsewhere), np.zeros(3)
        self._elsewhere, self._beyond, self.moved_ns = [], self._settings.confirm_looks, None
        return self._within(stamp_ns, self.rest)

    def _within(self, stamp_ns: int, rest: RestAttitude) -> MotionState:
        """Whether the camera has moved: by where it looks now, against where it looked at first."""
        angle_rad = float(np.linalg.norm(to_rotation_vector(rest.wxyz)))
        limit_rad = self._settings.limit_rad * (1.0 if self.moved_ns is None else _BACK)
        if angle_rad <= limit_rad:
            self._beyond, self.moved_ns = 0, None
            return MotionState.STEADY
        if not self._beyond:
            self._left_ns = stamp_ns
        self._beyond += 1
        if self.moved_ns is None and self._beyond < self._settings.confirm_looks:
            is_drift = self.state is MotionState.STEADY  # then it is known where the camera is
            return MotionState.STEADY if is_drift else MotionState.MOVING
        self.moved_ns = self.moved_ns or self._left_ns
        return MotionState.MOVED

    def _chance_rad(self, variances: float) -> float:
        """Rotation that chance does not exceed where ``variances`` times a look's variance adds up."""
        return float(_RARE * np.sqrt(variances * self._scatter.max_rad2))


class CameraMotionCalibrator:
    """Implements ``service.ports.Calibrator`` and ``LandmarkObserver``.

    The configured pose is that of the camera when it took the reference image. Until the first look, poses are what
    they would be without it.

    Args:
        settings: What counts as moved.
        pipeline: The station.
    """

    def __init__(self, settings: CameraMotionSettings, pipeline: PipelineSettings) -> None:
        self._settings = settings
        self._camera = pipeline.camera
        self._lens_cov = intrinsics_covariance(pipeline.camera)
        self._judge = LookJudge(pipeline.camera, settings.limit_rad)
        self._state = CameraMotionState(settings)
        self._looks = 0
        self._id = f"watch:{hashlib.sha256((pipeline.config_id or '').encode()).hexdigest()[:16]}"

    def known(self) -> "CameraMotionCalibrator":
        """This calibrator as it is now."""
        now = copy(self)
        now._state = deepcopy(self._state)  # noqa: SLF001 - its own
        return now

    def refine(self, poses: PoseBatch, known: Sequence["CameraMotionCalibrator"], which: IntArray) -> PoseBatch:
        """The corrected poses; without one, ``CAMERA_MOVED``, while nobody knows where the camera looks."""
        for k, now in enumerate(known):
            poses = poses.where(poses.is_ok & (which == k), now._refined)  # noqa: SLF001 - its own
        return poses

    def _refined(self, poses: PoseBatch, _: IntArray) -> PoseBatch:
        state = self._state
        if (why := _NUMBERLESS.get(state.state)) is not None:
            reason = f"{why} (since {_utc(state.since_ns)})"
            moved = poses.map_variants(lambda each: replace(each, status=Status.CAMERA_MOVED, reasons=(reason,)))
            return moved.without_poses()
        turn, calibration = self._turn(poses.stamp_ns), self._calibration
        remarks = self._remarks(poses.stamp_ns, turn)
        remarked = poses.with_variants(remarks, lambda each, own: replace(each, reasons=(*each.reasons, *own)))
        if turn is None:
            return remarked
        pose, std = rotated_pose(poses.pose, turn), rotated_std(poses.std, turn)
        return replace(remarked.map_variants(lambda each: replace(each, calibration=calibration)), pose=pose, std=std)

    def observes(self, name: str) -> bool:
        """Whether that is what observations of steady points are called."""
        return name == FIXED_POINTS

    def fits(self, observation: Observation) -> bool:
        """Whether its pixels come in pairs; none says that nothing was found."""
        return len(observation.pixels) % 2 == 0

    def observe(self, sample: PoseSample, observations: tuple[Observation, ...]) -> CameraMotionEstimate:
        """Learn from an image's steady points; of several looks at one image the first counts."""
        look = self._judge.judge(observations[0])
        self._state.take(sample.stamp_ns, look)
        self._looks += look.turn is not None
        return self._estimate(sample.stamp_ns, look)

    @property
    def _calibration(self) -> str | None:
        return f"{self._id}:{self._looks}" if self._looks else None

    def _turn(self, stamp_ns: IntArray) -> KnownTurn | None:
        """Rotation of the camera since the reference, by image; None before the first look that determined it.

        Args:
            stamp_ns: ``(n,)``; the turn's covariance is ``(n, 3, 3)``.
        """
        state, rest = self._state, self._state.rest
        if rest is None:
            return None
        half_rad = float(np.linalg.norm(to_rotation_vector(rest.wxyz))) / 2
        cov = rest.covariance(self._camera.fx_px, state.variance_rad2) + np.outer(state.off_rad, state.off_rad)
        return KnownTurn(
            wxyz=rest.wxyz,
            cov=cov + self._unwatched_rad2(stamp_ns)[:, None, None] * np.eye(3),
            jac_intrinsics=rest.last.jac_intrinsics,
            lens_cov=self._lens_cov,
            shift_m=2 * self._settings.lever_arm_m * math.sin(half_rad),  # of what is at the end of a lever
        )

    def _unwatched_rad2(self, stamp_ns: IntArray) -> FloatArray:
        """Variances ``(n,)`` about each axis since the camera was last recognised: a random walk of 1 limit an hour."""
        determined_ns = self._state.determined_ns
        if self._state.state is not MotionState.UNCHECKED or determined_ns is None:
            return np.zeros(len(stamp_ns))
        return np.asarray(self._settings.limit_rad**2 * np.maximum(stamp_ns - determined_ns, 0) / _HOUR_NS)

    def _remarks(self, stamp_ns: IntArray, turn: KnownTurn | None) -> list[tuple[str, ...]]:
        """Remarks on poses that have numbers, for each stamp ``(n,)``."""
        state, remarks = self._state, []
        if turn is not None and state.moved_ns is not None:
            angle_deg = math.degrees(np.linalg.norm(turn.rotvec_rad))
            remarks.append(
                f"{Status.CAMERA_MOVED}: turned by {angle_deg:.2f} deg since {_utc(state.moved_ns)};"
                " the pose is corrected, and fixed pixels follow the ground"
            )
        if state.state is not MotionState.UNCHECKED or not state.has_looked:
            return [tuple(remarks)] * len(stamp_ns)
        whens = ["yet"] * len(stamp_ns)
        if state.determined_ns is not None:
            whens = [f"for {max(each - state.determined_ns, 0) / SECOND_NS:.0f} s" for each in stamp_ns.tolist()]
        unknown = "whether the camera was moved is not known"
        return [(*remarks, f"no steady points were recognised {when}: {unknown}") for when in whens]

    def _estimate(self, stamp_ns: int, look: Look) -> CameraMotionEstimate:
        state, turn = self._state, self._turn(np.array([stamp_ns]))
        estimate = CameraMotionEstimate(
            stamp_ns=stamp_ns,
            state=state.state,
            since_ns=state.since_ns,
            moved_ns=state.moved_ns,
            points=look.points,
            calibration=self._calibration,
        )
        if look.turn is not None:
            estimate = replace(
                estimate,
                look_turn_rad=_three(to_rotation_vector(inverse(look.turn.wxyz))),
                agreeing=int(np.count_nonzero(look.turn.inliers)),
                std_px=look.turn.std_px,
            )
        if turn is None:
            return estimate
        return replace(estimate, turn_rad=_three(turn.rotvec_rad), std_rad=_three(turn.std_rad[0]))


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _utc(stamp_ns: int) -> str:
    return f"{datetime.fromtimestamp(stamp_ns // SECOND_NS, UTC):%Y-%m-%dT%H:%M:%SZ}"
