"""A fixed camera that is bumped: its attitude, corrected by what its steady points show."""

import hashlib
import math
from dataclasses import replace
from datetime import UTC, datetime
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.intrinsics import intrinsics_covariance
from aerodft.geometry.rotation import inverse, to_rotation_vector
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.calibration import STEADY, Steadiness, SteadinessEstimate
from aerodft.model.observation import Observation
from aerodft.model.pose import PoseSample
from aerodft.model.pose_batch import PoseBatch
from aerodft.model.status import Status
from aerodft.service.settings import PipelineSettings, WatchSettings
from calibration.steady_pose import KnownTurn, shift_of, turned_pose, turned_std
from calibration.steady_state import Look, Looker, SteadyState

_HOUR_NS: Final = 3600 * SECOND_NS
_NUMBERLESS: Final = {
    Steadiness.MOVING: "the camera turned, or was displaced, and where it rests is not known yet",
    Steadiness.UNKNOWN_VIEW: (
        "the view is not the reference's, turned: the camera was displaced, looks elsewhere, or is covered;"
        " set it up as it was, or calibrate it anew"
    ),
}


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

    def refine(self, poses: PoseBatch) -> PoseBatch:
        """The corrected poses; without one, ``CAMERA_MOVED``, while nobody knows where the camera looks."""
        return poses.where_ok(self._refined)

    def _refined(self, poses: PoseBatch) -> PoseBatch:
        state = self._state
        if (why := _NUMBERLESS.get(state.state)) is not None:
            reason = f"{why} (since {_utc(state.since_ns)})"
            moved = poses.all_varied(lambda each: replace(each, status=Status.CAMERA_MOVED, reasons=(reason,)))
            return moved.without_poses()
        turn, calibration = self._turn(poses.stamp_ns), self._calibration
        said = self._said(poses.stamp_ns, turn)
        told = poses.varied(said, lambda each, own: replace(each, reasons=(*each.reasons, *own)))
        if turn is None:
            return told
        pose, std = turned_pose(poses.pose, turn), turned_std(poses.std, turn)
        return replace(told.all_varied(lambda each: replace(each, calibration=calibration)), pose=pose, std=std)

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

    def _turn(self, stamp_ns: IntArray) -> KnownTurn | None:
        """Where the camera looks in images, against where it looked; None before the first look that told.

        Args:
            stamp_ns: ``(n,)``; the turn's covariance is ``(n, 3, 3)``.
        """
        state, level = self._state, self._state.level
        if level is None:
            return None
        cov = level.covariance(self._camera.fx_px, state.variance_rad2) + np.outer(state.off_rad, state.off_rad)
        return KnownTurn(
            wxyz=level.wxyz,
            cov=cov + self._unwatched_rad2(stamp_ns)[:, None, None] * np.eye(3),
            by_intrinsics=level.last.by_intrinsics,
            lens_cov=self._lens_cov,
            shift_m=shift_of(self._watch.lever_arm_m, level.wxyz),
        )

    def _unwatched_rad2(self, stamp_ns: IntArray) -> FloatArray:
        """Variances ``(n,)`` about each axis since the camera was last recognised: a random walk of 1 limit an hour."""
        told_ns = self._state.told_ns
        if self._state.state is not Steadiness.UNCHECKED or told_ns is None:
            return np.zeros(len(stamp_ns))
        return np.asarray(self._watch.limit_rad**2 * np.maximum(stamp_ns - told_ns, 0) / _HOUR_NS)

    def _said(self, stamp_ns: IntArray, turn: KnownTurn | None) -> list[tuple[str, ...]]:
        """What people should know of poses that have numbers, for each stamp ``(n,)``."""
        state, said = self._state, []
        if turn is not None and state.moved_ns is not None:
            angle_deg = math.degrees(turn.angle_rad)
            said.append(f"{Status.CAMERA_MOVED}: turned by {angle_deg:.2f} deg since {_utc(state.moved_ns)}; corrected")
        if state.state is not Steadiness.UNCHECKED or not state.has_looked:
            return [tuple(said)] * len(stamp_ns)
        whens = ["yet"] * len(stamp_ns)
        if state.told_ns is not None:
            whens = [f"for {max(each - state.told_ns, 0) / SECOND_NS:.0f} s" for each in stamp_ns.tolist()]
        unknown = "whether the camera was moved is not known"
        return [(*said, f"no steady points were recognised {when}: {unknown}") for when in whens]

    def _estimate(self, stamp_ns: int, look: Look) -> SteadinessEstimate:
        state, turn = self._state, self._turn(np.array([stamp_ns]))
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
        return replace(estimate, turn_rad=_three(turn.rotvec_rad), std_rad=_three(turn.std_rad[0]))


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _utc(stamp_ns: int) -> str:
    return f"{datetime.fromtimestamp(stamp_ns // SECOND_NS, UTC):%Y-%m-%dT%H:%M:%SZ}"
