"""Offset, drift and lag to hundredths of a second: the camera's turns by its images against its turns by the log.

A nonlinear least-squares fit with t-distributed residuals, which begins with large ones forgiven, so that it does not
end beside its goal. Beside the three, a small turn between camera and gimbal axes is estimated: a degree of it leaks
rates from one axis into another. The log is a smoothed curve here, which rounds off where a gimbal starts and stops:
``sync_refine`` goes on from what is found.
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


class TurnProblem:
    """Image pairs beside a log, ``zero_ns`` being where the video's time counts from."""

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


def fit(problem: TurnProblem, start: FloatArray) -> FloatArray:
    """Fit from ``start (3,)``: offset (s, at the reference), drift, lag (s).

    Returns:
        ``(6,)``: the same, and the turn of the camera's axes against the gimbal's (rad).
    """
    fixed = np.arange(_UNKNOWNS) == (LAG if not problem.camera.has_lag else -1)
    precision, mean = np.where(fixed, _FIXED, 1 / _PRIOR_STD**2), np.where(fixed, 0.0, _PRIOR_MEAN)
    values = np.where(fixed, 0.0, np.concatenate([start, np.zeros(_UNKNOWNS - len(start))]))
    for round_ in range(_ITERATIONS):
        lines = _linearised(problem, values)
        jac, off = _whitened(lines, (_FIRST_STD_RADPS * _SHARPER**round_ * problem.between_s) ** 2)
        information = np.einsum("nui,nuj->ij", jac, jac) + np.diag(precision)
        gradient = np.einsum("nui,nu->i", jac, off) + precision * (mean - values)
        step = np.linalg.solve(information, gradient)
        values = np.where(fixed, 0.0, values + step)
        if round_ >= _LEAST_ITERATIONS and np.all(np.abs(step[: LAG + 1]) < _CONVERGED):
            break
    return np.asarray(values)


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


def _linearised(problem: TurnProblem, values: FloatArray) -> _Lines:
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


def _whitened(lines: _Lines, doubt_rad2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives and residuals in units in which their errors are independent and of standard deviation 1."""
    cov = lines.cov + doubt_rad2[lines.used][:, None, None] * np.eye(3)
    inward = np.linalg.inv(np.linalg.cholesky(cov))
    jac, off = inward @ lines.jac, np.einsum("nij,nj->ni", inward, lines.off)
    squares = np.sum(off**2, axis=-1)
    scale2 = float(np.median(squares)) / _MEDIAN_CHI2
    scale = np.sqrt((_STUDENT + 3) / (_STUDENT + squares / scale2) / scale2)
    return jac * scale[:, None, None], off * scale[:, None]
