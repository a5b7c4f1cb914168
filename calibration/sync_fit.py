"""Offset, drift and lag to milliseconds: the camera's turns by its images against its turns by the log.

A nonlinear least-squares fit with t-distributed residuals, which begins with large ones forgiven, so that it does not
end beside its goal. Beside the three, a small turn between camera and gimbal axes is estimated: a degree of it leaks
rates from one axis into another. The covariance is Newey and West's, because residuals of successive pairs are alike:
what is seen of the ground, and what a report gets wrong, lasts for a while.
"""

from dataclasses import dataclass

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.rotation import from_rotation_vector, matrix
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.vision.rotation import PlaneMotion, Turns, turns_over_plane
from calibration.sync_motion import CameraMotion, Predicted, predicted

OFFSET, DRIFT, LAG = range(3)
LAG_PRIOR_S = (0.15, 0.1)
"""Mean and standard deviation of a gimbal's lag before the data are asked."""

_UNKNOWNS = 6
_PRIOR_STD = np.array([np.inf, np.inf, LAG_PRIOR_S[1], 0.05, 0.05, 0.05])
_PRIOR_MEAN = np.array([0.0, 0.0, LAG_PRIOR_S[0], 0.0, 0.0, 0.0])
_STEP = np.array([0.01, 2e-4, 0.01, 0.002, 0.002, 0.002])  # of central differences
_RATE_STD_RADPS = 0.001  # of what a camera does beside its gimbal
_STUDENT = 4.0  # degrees of freedom of the turns' t distribution
_MEDIAN_CHI2 = 2.366  # with 3 degrees of freedom
_LEAST_ITERATIONS, _ITERATIONS = 6, 12
_FIRST_STD_RADPS, _SHARPER = 0.05, 0.4  # of what is forgiven, and what is left of it after each iteration
_CONVERGED = np.array([1e-5, 1e-7, 1e-5])
_FIXED = 1e18  # precision of what is no unknown
_FIXED_SHARE = np.array([-0.5324, 0.4160, 2.9694, 1.9600]) / 1.96  # of the whole: their critical values, at 95 %
_BESIDE = 1.5  # times what residuals tell were the errors over simulated flights with noisy reports
_WHOLE_MS_STD_S = 0.0005  # of stamps that count milliseconds, with those of the clock map
_ROUNDING = np.diag([_WHOLE_MS_STD_S**2, 0.0, _WHOLE_MS_STD_S**2, 0.0, 0.0, 0.0])
_CORRELATED_S = 6.0  # residuals farther apart in time have nothing to do with each other


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
        said = predicted(self.camera, start, end, lag)
        camera_from_gimbal = matrix(from_rotation_vector(values[LAG + 1 :])).T
        return Predicted(
            rotvec_rad=said.rotvec_rad @ camera_from_gimbal,
            normal_cam=said.normal_cam @ camera_from_gimbal,
            known=said.known,
        )

    def seen(self, said: Predicted) -> Turns:
        """What the images say, with the ground where the log has it."""
        return turns_over_plane(self.motion, said.normal_cam, said.rotvec_rad)

    def off(self, values: FloatArray) -> FloatArray:
        """``(n, 3)`` seen minus said, rad."""
        said = self.said(values)
        return self.seen(said).rotvec_rad - said.rotvec_rad


def fit(motion: PlaneMotion, camera: CameraMotion, zero_ns: int, start: FloatArray) -> SyncFit:
    """Fit from ``start (3,)``: offset (s, at ``zero_ns``), drift, lag (s)."""
    problem = _Problem(motion, camera, zero_ns)
    fixed = np.arange(_UNKNOWNS) == (LAG if not camera.has_lag else -1)
    precision, mean = np.where(fixed, _FIXED, 1 / _PRIOR_STD**2), np.where(fixed, 0.0, _PRIOR_MEAN)
    values = np.where(fixed, 0.0, np.concatenate([start, np.zeros(_UNKNOWNS - len(start))]))
    for round_ in range(_ITERATIONS):
        lines = _linearised(problem, values)
        white = _whitened(lines, (_FIRST_STD_RADPS * _SHARPER**round_ * problem.between_s) ** 2)
        information = np.einsum("nui,nuj->ij", white.jac, white.jac) + np.diag(precision)
        gradient = np.einsum("nui,nu->i", white.jac, white.off) + precision * (mean - values)
        step = np.linalg.solve(information, gradient)
        values = np.where(fixed, 0.0, values + step)
        if round_ >= _LEAST_ITERATIONS and np.all(np.abs(step[: LAG + 1]) < _CONVERGED):
            break
    scores = np.einsum("nui,nu->ni", white.jac, white.off)
    bread = np.linalg.inv(information)
    said = problem.said(values)
    return SyncFit(
        values=values,
        cov=bread @ (_newey_west(problem.start_s[lines.used], scores) + np.diag(precision)) @ bread + _ROUNDING,
        rate_seen_radps=problem.seen(said).rotvec_rad / problem.between_s[:, None],
        rate_said_radps=said.rotvec_rad / problem.between_s[:, None],
        used=lines.used,
        cost=white.cost,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Lines:
    """The problem near some values, of the ``m`` pairs that the log covers.

    Attributes:
        jac: ``(m, 3, 6)`` derivatives of what is said less what is seen.
        off: ``(m, 3)`` seen less said, rad.
        cov: ``(m, 3, 3)`` of what is seen.
        used: ``(n,)`` which of all pairs they are.
    """

    jac: FloatArray
    off: FloatArray
    cov: FloatArray
    used: BoolArray


def _linearised(problem: _Problem, values: FloatArray) -> _Lines:
    said = problem.said(values)
    seen, used = problem.seen(said), said.known
    jac = np.empty((len(problem.motion), 3, _UNKNOWNS))
    for column, step in enumerate(_STEP):
        ahead, behind = values.copy(), values.copy()
        ahead[column] += step
        behind[column] -= step
        jac[..., column] = (problem.off(behind) - problem.off(ahead)) / (2 * step)
    # Where a homography does not agree with the plane that it is of, it is off by as much.
    unlike = np.maximum(seen.chi2 / 2, 1.0)[:, None, None]
    beside = ((_RATE_STD_RADPS * problem.between_s) ** 2)[:, None, None] * np.eye(3)
    return _Lines(
        jac=jac[used],
        off=(seen.rotvec_rad - said.rotvec_rad)[used],
        cov=(unlike * seen.cov_rad2 + beside)[used],
        used=used,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _White:
    """Lines in units in which their errors are independent and of standard deviation 1, and their robust cost."""

    jac: FloatArray
    off: FloatArray
    cost: float


def _whitened(lines: _Lines, doubt_rad2: FloatArray) -> _White:
    cov = lines.cov + doubt_rad2[lines.used][:, None, None] * np.eye(3)
    inward = np.linalg.inv(np.linalg.cholesky(cov))
    jac, off = inward @ lines.jac, np.einsum("nij,nj->ni", inward, lines.off)
    squares = np.sum(off**2, axis=-1)
    scale2 = float(np.median(squares)) / _MEDIAN_CHI2
    scale = np.sqrt((_STUDENT + 3) / (_STUDENT + squares / scale2) / scale2)
    loss = (_STUDENT + 3) / 2 * np.log1p(squares / (_STUDENT * scale2))
    return _White(jac * scale[:, None, None], off * scale[:, None], float(np.mean(loss) + 1.5 * np.log(scale2)))


def _newey_west(times_s: FloatArray, scores: FloatArray) -> FloatArray:
    """Covariance ``(u, u)`` of the sum of scores ``(m, u)``, which are alike over ``_CORRELATED_S``.

    Of few independent stretches it would come out too small: it is scaled so that 1.96 of its standard deviations hold
    95 % (Kiefer and Vogelsang, A new asymptotic theory for heteroskedasticity-autocorrelation robust tests, 2005).
    """
    span_s = float(times_s[-1] - times_s[0])
    reach = max(round(_CORRELATED_S * len(scores) / span_s), 1)
    total = scores.T @ scores
    for lag in range(1, min(reach, len(scores))):
        cross = scores[lag:].T @ scores[:-lag]
        total += (1 - lag / reach) * (cross + cross.T)
    share = min(_CORRELATED_S / span_s, 1.0)
    return np.asarray(total * (_BESIDE * np.polyval(_FIXED_SHARE, share)) ** 2)
