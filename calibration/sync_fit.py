"""Offset, drift and lag to milliseconds: the camera's turns by its images against its turns by the log.

A nonlinear least-squares fit with t-distributed residuals. Beside the three, a small turn between camera and gimbal
axes is estimated: a degree of it leaks rates from one axis into another. The covariance is Newey and West's, because
residuals of successive pairs are alike: what is seen of the ground, and what a report gets wrong, lasts for a while.
"""

from dataclasses import dataclass

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.rotation import from_rotation_vector, matrix, skew
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.vision.rotation import PlaneMotion, Turns, turns_over_plane
from calibration.sync_motion import CameraMotion, Predicted, predicted

OFFSET, DRIFT, LAG = range(3)
LAG_PRIOR_S = (0.15, 0.1)
"""Mean and standard deviation of a gimbal's lag before the data are asked."""

_UNKNOWNS = 6
_PRIOR_STD = np.array([np.inf, np.inf, LAG_PRIOR_S[1], 0.05, 0.05, 0.05])
_PRIOR_MEAN = np.array([0.0, 0.0, LAG_PRIOR_S[0], 0.0, 0.0, 0.0])
_STEP = np.array([0.01, 2e-4, 0.01])  # of central differences: s, 1, s
_TELEMETRY_STD_RADPS = 0.003  # what reports are never better than
_STUDENT = 4.0
_ITERATIONS = 12
_CONVERGED = np.array([1e-5, 1e-7, 1e-5])
_CORRELATED_S = 3.0  # residuals farther apart in time have nothing to do with each other


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SyncFit:
    """A fitted alignment.

    Attributes:
        values: ``(6,)`` offset (s, at the reference), drift, lag (s), turn of the camera against the gimbal (rad).
        cov: ``(6, 6)``.
        rate_seen_radps: ``(n, 3)`` camera's angular rate by the images, in camera axes.
        rate_said_radps: ``(n, 3)`` by the log.
        used: ``(n,)`` pairs that the log covers.
        cost: Mean of the robust loss over the used pairs.
    """

    values: FloatArray
    cov: FloatArray
    rate_seen_radps: FloatArray
    rate_said_radps: FloatArray
    used: BoolArray
    cost: float


class _Problem:
    def __init__(self, motion: PlaneMotion, camera: CameraMotion, zero_ns: int) -> None:
        self.motion = motion
        self.camera = camera
        self.start_s = (motion.start_ns - zero_ns) / SECOND_NS
        self.end_s = (motion.end_ns - zero_ns) / SECOND_NS
        self.between_s = self.end_s - self.start_s

    def said(self, values: FloatArray) -> Predicted:
        """What the log says of all pairs under this alignment."""
        offset, drift, lag = values[: LAG + 1].tolist()
        start, end = (offset + (1 + drift) * times for times in (self.start_s, self.end_s))
        return predicted(self.camera, start, end, lag)

    def seen(self, said: Predicted) -> Turns:
        """What the images say, with the ground where the log has it."""
        return turns_over_plane(self.motion, said.normal_cam, said.rotvec_rad)

    def off(self, values: FloatArray) -> FloatArray:
        """``(n, 3)`` seen minus said, rad."""
        said = self.said(values)
        return self.seen(said).rotvec_rad - _turned(said, values)


def _turned(said: Predicted, values: FloatArray) -> FloatArray:
    return said.rotvec_rad @ matrix(from_rotation_vector(values[LAG + 1 :])).T


def fit(motion: PlaneMotion, camera: CameraMotion, zero_ns: int, start: FloatArray) -> SyncFit:
    """Fit from ``start (3,)``: offset (s, at ``zero_ns``), drift, lag (s)."""
    problem = _Problem(motion, camera, zero_ns)
    fixed = np.zeros(_UNKNOWNS, dtype=bool)
    fixed[LAG] = not camera.has_lag
    precision = np.where(fixed, 1e18, 1 / _PRIOR_STD**2)
    mean = np.where(fixed, 0.0, _PRIOR_MEAN)
    values = np.concatenate([start, np.zeros(_UNKNOWNS - len(start))])
    values[fixed] = 0.0
    for _ in range(_ITERATIONS):
        jac, off, whitening, used = _linearised(problem, values)
        white_jac = whitening @ jac
        white_off = np.einsum("nij,nj->ni", whitening, off)
        scale2, weight = _robust(white_off)
        weighted = np.swapaxes(white_jac, -1, -2) * (weight / scale2)[:, None, None]
        information = np.einsum("nui,niv->uv", weighted, white_jac) + np.diag(precision)
        gradient = np.einsum("nui,ni->u", weighted, white_off) + precision * (mean - values)
        step = np.linalg.solve(information, gradient)
        values = values + step
        if np.all(np.abs(step[: LAG + 1]) < _CONVERGED):
            break
    scores = np.einsum("nui,ni->nu", weighted, white_off)
    spread = _newey_west(problem.start_s[used], scores) + np.diag(precision)
    bread = np.linalg.inv(information)
    said = problem.said(values)
    loss = (_STUDENT + 3) / 2 * np.log1p(np.sum(white_off**2, axis=-1) / (_STUDENT * scale2))
    return SyncFit(
        values=values,
        cov=bread @ spread @ bread,
        rate_seen_radps=problem.seen(said).rotvec_rad / problem.between_s[:, None],
        rate_said_radps=_turned(said, values) / problem.between_s[:, None],
        used=used,
        cost=float(np.mean(loss) + 1.5 * np.log(scale2)),
    )


def _linearised(problem: _Problem, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Derivatives ``(m, 3, 6)`` of what is said, residuals ``(m, 3)``, whitenings ``(m, 3, 3)``; which are known."""
    said = problem.said(values)
    seen = problem.seen(said)
    used = said.known
    jac = np.empty((len(problem.motion), 3, _UNKNOWNS))
    for column, step in enumerate(_STEP):
        ahead, behind = values.copy(), values.copy()
        ahead[column] += step
        behind[column] -= step
        jac[..., column] = (problem.off(behind) - problem.off(ahead)) / (2 * step)
    jac[..., LAG + 1 :] = -skew(said.rotvec_rad)
    report = (_TELEMETRY_STD_RADPS * problem.between_s[used]) ** 2
    # Where a homography does not agree with the plane that it is of, it is off by as much.
    unlike = np.maximum(seen.chi2[used] / 2, 1.0)
    cov = unlike[:, None, None] * seen.cov_rad2[used] + report[:, None, None] * np.eye(3)
    whitening = np.linalg.inv(np.linalg.cholesky(cov))
    return jac[used], (seen.rotvec_rad - _turned(said, values))[used], whitening, used


def _robust(white_off: FloatArray) -> tuple[float, FloatArray]:
    """Squared scale of residuals ``(m, 3)``, and weights ``(m,)`` of a multivariate t distribution."""
    squares = np.sum(white_off**2, axis=-1)
    scale2 = float(np.median(squares)) / 2.366  # the median of chi2 with 3 degrees of freedom
    return scale2, (_STUDENT + 3) / (_STUDENT + squares / scale2)


def _newey_west(times_s: FloatArray, scores: FloatArray) -> FloatArray:
    """Covariance ``(u, u)`` of the sum of scores ``(m, u)``, alike over ``_CORRELATED_S``."""
    step_s = float(np.median(np.diff(times_s)))
    reach = max(round(_CORRELATED_S / step_s), 1)
    total = scores.T @ scores
    for lag in range(1, min(reach, len(scores) - 1)):
        cross = scores[lag:].T @ scores[:-lag]
        total += (1 - lag / reach) * (cross + cross.T)
    return total * len(scores) / max(len(scores) - _UNKNOWNS, 1)
