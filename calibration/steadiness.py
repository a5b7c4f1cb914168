"""A fixed camera that is bumped: its attitude, corrected by what its steady points show."""

import hashlib
import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.intrinsics import intrinsics_covariance
from aerodft.geometry.rotation import inverse, matrix, multiply, to_rotation_vector
from aerodft.model.arrays import FloatArray
from aerodft.model.calibration import STEADY, Steadiness, SteadinessEstimate
from aerodft.model.observation import Observation
from aerodft.model.pose import Pose, PoseSample, PoseStd
from aerodft.model.status import Status
from aerodft.service.settings import PipelineSettings
from aerodft.service.watching import WatchSettings
from calibration.biases import combined_std
from calibration.steady_state import Look, Looker, SteadyState

_HOUR_NS: Final = 3600 * SECOND_NS
_NUMBERLESS: Final = {
    Steadiness.MOVING: "the camera turned, or was displaced, and where it rests is not known yet",
    Steadiness.UNKNOWN_VIEW: (
        "the view is not the reference's, turned: the camera was displaced, looks elsewhere, or is covered;"
        " set it up as it was, or calibrate it anew"
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class KnownTurn:
    """A turn with its errors.

    Attributes:
        wxyz: ``(4,)`` ``now_SO3_reference``.
        cov: ``(3, 3)`` of a small rotation about the camera's axes now, without the lens's part (rad^2).
        by_intrinsics: ``(3, m)``: that small rotation by errors of the intrinsics.
        lens_cov: ``(m, m)`` of the intrinsics.
        shift_m: Standard deviation, along each axis, of how far the lens went along.
    """

    wxyz: FloatArray
    cov: FloatArray
    by_intrinsics: FloatArray
    lens_cov: FloatArray
    shift_m: float

    @property
    def angle_rad(self) -> float:
        """By how much, about whichever axis."""
        return float(np.linalg.norm(self.rotvec_rad))

    @property
    def rotvec_rad(self) -> FloatArray:
        """``(3,)``: the camera's own rotation about its axes, ``reference_SO3_now``."""
        return to_rotation_vector(inverse(self.wxyz))

    @property
    def std_rad(self) -> FloatArray:
        """``(3,)`` about the camera's axes now, the lens's part included."""
        return np.sqrt(np.diag(self.cov + self.by_intrinsics @ self.lens_cov @ self.by_intrinsics.T))


def shift_of(lever_arm_m: float, wxyz: FloatArray) -> float:
    """How far something at the end of a lever goes when that turns."""
    return 2 * lever_arm_m * math.sin(float(np.linalg.norm(to_rotation_vector(wxyz))) / 2)


def turned_pose(pose: Pose, turn: KnownTurn) -> Pose:
    """The pose after the turn.

    A small rotation of the reference's camera axes becomes one of today's. The same errors of the lens are in the pose
    (where one calibration found both), in the turn, and in what is measured: they stay correlated.
    """
    carry = np.eye(6)
    carry[3:, 3:] = matrix(turn.wxyz)
    by_lens = np.zeros((6, len(turn.lens_cov)))
    by_lens[3:] = -turn.by_intrinsics  # the pose's rotation is the turn's inverse
    with_lens = carry @ (pose.lens_cov if pose.lens_cov.shape[1] else np.zeros_like(by_lens))
    crossed = with_lens @ by_lens.T
    cov = carry @ pose.cov @ carry.T + crossed + crossed.T + by_lens @ turn.lens_cov @ by_lens.T
    cov[3:, 3:] += turn.cov
    cov[:3, :3] += turn.shift_m**2 * np.eye(3)
    return replace(
        pose,
        wxyz=multiply(pose.wxyz, inverse(turn.wxyz)),
        cov=(cov + cov.T) / 2,
        lens_cov=with_lens + by_lens @ turn.lens_cov,
    )


def turned_std(std: PoseStd, turn: KnownTurn) -> PoseStd:
    """The pose's stds in people's words after the turn."""
    tilt, pan, roll = turn.std_rad.tolist()
    by_turn = PoseStd(height_agl_m=turn.shift_m, horizontal_m=turn.shift_m, tilt_rad=tilt, pan_rad=pan, roll_rad=roll)
    return combined_std(std, by_turn)


class SteadyCalibrator:
    """Implements ``service.ports.Calibrator`` and ``LandmarkObserver``.

    The configured pose is that of the camera when it took the reference image. Until the first look, poses are what
    they would be without it.

    Args:
        watch: What counts as moved.
        pipeline: The station.
    """

    def __init__(self, watch: WatchSettings, pipeline: PipelineSettings) -> None:
        self._watch = watch
        self._camera = pipeline.camera
        self._lens_cov = intrinsics_covariance(pipeline.camera)
        self._looker = Looker(pipeline.camera, watch.limit_rad)
        self._state = SteadyState(watch)
        self._looks = 0
        self._id = f"watch:{hashlib.sha256((pipeline.config_id or '').encode()).hexdigest()[:16]}"

    def refine(self, sample: PoseSample) -> PoseSample:
        """The corrected pose; without one, ``CAMERA_MOVED``, while nobody knows where the camera looks."""
        if sample.pose is None or sample.status is not Status.OK:
            return sample
        state = self._state
        if (why := _NUMBERLESS.get(state.state)) is not None:
            reason = f"{why} (since {_utc(state.since_ns)})"
            return replace(sample, pose=None, status=Status.CAMERA_MOVED, reasons=(reason,))
        turn = self._turn(sample.stamp_ns)
        said = (*sample.reasons, *self._said(sample.stamp_ns, turn))
        if turn is None:
            return replace(sample, reasons=said)
        pose, std = turned_pose(sample.pose, turn), turned_std(sample.std, turn)
        return replace(sample, pose=pose, std=std, reasons=said, calibration=self._calibration)

    def observes(self, name: str) -> bool:
        """Whether that is what observations of steady points are called."""
        return name == STEADY

    def fits(self, observation: Observation) -> bool:
        """Whether its pixels come in pairs; none says that nothing was found."""
        return len(observation.pixels) % 2 == 0

    def observe(self, sample: PoseSample, observations: tuple[Observation, ...]) -> SteadinessEstimate:
        """Learn from an image's steady points; of several looks at one image the first counts."""
        look = self._looker.judge(observations[0])
        self._state.take(sample.stamp_ns, look)
        self._looks += look.turn is not None
        return self._estimate(sample.stamp_ns, look)

    @property
    def _calibration(self) -> str | None:
        return f"{self._id}:{self._looks}" if self._looks else None

    def _turn(self, stamp_ns: int) -> KnownTurn | None:
        """Where the camera looks in an image, against where it looked; None before the first look that told."""
        state, level = self._state, self._state.level
        if level is None:
            return None
        cov = level.covariance(self._camera.fx_px, state.variance_rad2) + np.outer(state.off_rad, state.off_rad)
        return KnownTurn(
            wxyz=level.wxyz,
            cov=cov + self._unwatched_rad2(stamp_ns) * np.eye(3),
            by_intrinsics=level.last.by_intrinsics,
            lens_cov=self._lens_cov,
            shift_m=shift_of(self._watch.lever_arm_m, level.wxyz),
        )

    def _unwatched_rad2(self, stamp_ns: int) -> float:
        """Variance about each axis since the camera was last recognised: the limit in an hour, as a random walk."""
        told_ns = self._state.told_ns
        if self._state.state is not Steadiness.UNCHECKED or told_ns is None:
            return 0.0
        return self._watch.limit_rad**2 * max(stamp_ns - told_ns, 0) / _HOUR_NS

    def _said(self, stamp_ns: int, turn: KnownTurn | None) -> tuple[str, ...]:
        """What people should know of a pose that has numbers."""
        state, said = self._state, []
        if turn is not None and state.moved_ns is not None:
            angle_deg = math.degrees(turn.angle_rad)
            said.append(f"{Status.CAMERA_MOVED}: turned by {angle_deg:.2f} deg since {_utc(state.moved_ns)}; corrected")
        if state.state is Steadiness.UNCHECKED and state.has_looked:
            when = "yet"
            if state.told_ns is not None:
                when = f"for {max(stamp_ns - state.told_ns, 0) / SECOND_NS:.0f} s"
            said.append(f"no steady points were recognised {when}: whether the camera was moved is not known")
        return tuple(said)

    def _estimate(self, stamp_ns: int, look: Look) -> SteadinessEstimate:
        state, turn = self._state, self._turn(stamp_ns)
        estimate = SteadinessEstimate(
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
                agreeing=int(np.count_nonzero(look.turn.agreeing)),
                std_px=look.turn.std_px,
            )
        if turn is None:
            return estimate
        return replace(estimate, turn_rad=_three(turn.rotvec_rad), std_rad=_three(turn.std_rad))


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _utc(stamp_ns: int) -> str:
    return f"{datetime.fromtimestamp(stamp_ns // SECOND_NS, UTC):%Y-%m-%dT%H:%M:%SZ}"
