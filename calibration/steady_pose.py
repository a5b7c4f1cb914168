"""A pose after a turn of the camera, with everything that is not known of that turn."""

import math
from dataclasses import dataclass, replace

import numpy as np

from aerodft.geometry.rotation import inverse, matrix, multiply, to_rotation_vector
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class KnownTurn:
    """A turn with its errors.

    Attributes:
        wxyz: ``(4,)`` ``now_SO3_reference``.
        cov: ``(..., 3, 3)`` of a small rotation about the camera's axes now, without the lens's part (rad^2).
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
        """``(..., 3)`` about the camera's axes now, the lens's part included."""
        by_lens = self.by_intrinsics @ self.lens_cov @ self.by_intrinsics.T
        return np.asarray(np.sqrt(np.diagonal(self.cov + by_lens, axis1=-2, axis2=-1)))


def shift_of(lever_arm_m: float, wxyz: FloatArray) -> float:
    """How far something at the end of a lever goes when that turns."""
    return 2 * lever_arm_m * math.sin(float(np.linalg.norm(to_rotation_vector(wxyz))) / 2)


def turned_pose(pose: Pose, turn: KnownTurn) -> Pose:
    """The poses ``(...)`` after the turn.

    A small rotation of the reference's camera axes becomes one of today's. The same errors of the lens are in the pose
    (where one calibration found both), in the turn, and in what is measured: they stay correlated.
    """
    carry = np.eye(6)
    carry[3:, 3:] = matrix(turn.wxyz)
    by_lens = np.zeros((6, len(turn.lens_cov)))
    by_lens[3:] = -turn.by_intrinsics  # the pose's rotation is the turn's inverse
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


def turned_std(std: FloatArray, turn: KnownTurn) -> FloatArray:
    """The poses' stds in people's words, ``(n, 7)`` in the order of ``PoseStd``, after the turn."""
    added = np.zeros_like(std)
    added[:, :2], added[:, 2:5] = turn.shift_m, turn.std_rad
    return np.hypot(std, added)
