"""Offset, drift and lag to hundredths of a second: the camera's turns by its images against its turns by the log.

Every offset and drift of a range is weighed by all image pairs at once. For each image pair and each instant of the
log, how well does the pair's homography agree with the camera's turn and tilt then, whatever the camera's translation
was? An offset with a drift is a straight line through that table; its score is the sum along it. A pair's entry is its
likelihood over its mean over the log, so that a pair that would fit anywhere (a hover), or that lies outside the log,
counts for nothing.

The best is the start of a nonlinear least-squares fit with t-distributed residuals, which begins with large ones
forgiven, so that it does not end beside its goal. Beside the three, a small turn between camera and gimbal axes is
estimated: a degree of it leaks rates from one axis into another. The log is a smoothed curve here, which rounds off
where a gimbal starts and stops: ``sync_refine`` goes on from what is found.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from aerodft.conventions import SECOND_NS
from aerodft.geometry.rotation import from_rotation_vector, matrix, skew
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.vision.rotation import FREE, PlaneMotion, Turns, turns_over_plane
from calibration.sync_motion import CameraMotion, Predicted, predicted

MAX_DRIFT = 0.03
"""Of clocks that are worth aligning, twice."""

_STEP_S = 0.05
_DRIFT_STEP = 0.0025
_MOST_PAIRS = 400
_LOG_RATE_STD_RADPS = 0.015  # of telemetry against the camera, in part because its lag is not quite known yet
_LAGS_S = (0.05, 0.175, 0.3)  # that are tried
_LEAST = np.exp(-8.0)  # likelihood of what cannot be: a pair may be wrong
_APART_S = 1.0  # peaks closer than this are one
_PEAKS = 2
_REACH = 2 * round(_APART_S / _STEP_S) + 1
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """A candidate: offset (s, at the reference), drift, lag (s), and its score (natural logarithm of the evidence)."""

    offset_s: float
    drift: float
    lag_s: float
    score: float


def search(motion: PlaneMotion, camera: CameraMotion, zero_ns: int, max_offset_s: float) -> tuple[Peak, ...]:
    """The best offset, and the best of those that are not near it, in descending order of score.

    Args:
        motion: ``n`` image pairs, stamped by the video's clock.
        camera: The log.
        zero_ns: The reference: offset is added there, drift counts from there; that of ``camera``.
        max_offset_s: Offsets of up to this, on both sides.
    """
    every = max(len(motion) // _MOST_PAIRS, 1)
    start_s, end_s = ((stamps[::every] - zero_ns) / SECOND_NS for stamps in (motion.start_ns, motion.end_ns))
    reach_s = max_offset_s + MAX_DRIFT * float(np.max(np.abs(start_s)))
    log_s = np.arange(start_s[0] - reach_s, start_s[-1] + reach_s + _STEP_S, _STEP_S)
    offsets = np.arange(-max_offset_s, max_offset_s + _STEP_S / 2, _STEP_S)
    drifts = np.arange(-MAX_DRIFT, MAX_DRIFT + _DRIFT_STEP / 2, _DRIFT_STEP)
    lags = _LAGS_S if camera.has_lag else (0.0,)
    scores = np.empty((len(lags), len(drifts), len(offsets)))
    pairs = np.arange(len(start_s))
    for layer, lag_s in enumerate(lags):
        table = _table(motion, every, camera, (log_s, end_s - start_s), lag_s)
        for row, drift in enumerate(drifts):
            at = np.rint((offsets[:, None] + (1 + drift) * start_s - log_s[0]) / _STEP_S).astype(np.int64)
            scores[layer, row] = table[pairs, np.clip(at, 0, len(log_s) - 1)].sum(axis=1)
    return _peaks(scores, offsets, drifts, lags)


def _table(
    motion: PlaneMotion, every: int, camera: CameraMotion, times: tuple[FloatArray, FloatArray], lag_s: float
) -> FloatArray:
    """``(pairs, instants)`` logarithms of likelihood over its mean; 0 where the log has nothing to say."""
    log_s, between_s = times
    typical_s = float(np.median(between_s))
    told = predicted(camera, log_s, log_s + typical_s, lag_s)
    rate, known = told.rotvec_rad / typical_s, told.known
    table = np.zeros((len(between_s), len(log_s)))
    if not np.any(known):
        return table
    for row, (homography, cov, step_s) in enumerate(
        zip(motion.homography[::every], motion.cov[::every], between_s, strict=True)
    ):
        misfit = _misfit(homography, cov, rate[known] * step_s, told.normal_cam[known], _LOG_RATE_STD_RADPS * step_s)
        likelihood = np.exp(-misfit / 2) + _LEAST
        table[row, known] = np.log(likelihood / likelihood.mean())
    return table


def _misfit(
    homography: FloatArray, cov: FloatArray, turn_rad: FloatArray, normal_cam: FloatArray, std_rad: float
) -> FloatArray:
    """Squared distance ``(m,)`` of one homography from those of turns and normals ``(m, 3)``, over all translations.

    First order in the turn and the translation.
    """
    turning = -skew(np.eye(3)).reshape(3, 9).T[:FREE]
    information = np.linalg.inv(cov + std_rad**2 * turning @ turning.T)
    last = homography.ravel()[:FREE]
    off = last - np.eye(3).ravel()[:FREE] - turn_rad @ turning.T
    moving = np.zeros((len(normal_cam), 3, 3, 3))
    for axis in range(3):
        moving[:, axis, :, axis] = normal_cam
    moved = moving.reshape(-1, 9, 3)
    shifting = moved[:, :FREE] - last[:, None] * moved[:, FREE:]  # the last element stays 1
    weighted = np.swapaxes(shifting, -1, -2) @ information
    shift = np.linalg.solve(weighted @ shifting, weighted @ off[..., None])
    left = off - (shifting @ shift)[..., 0]
    return np.asarray(np.einsum("mi,ij,mj->m", left, information, left))


def _peaks(scores: FloatArray, offsets: FloatArray, drifts: FloatArray, lags: tuple[float, ...]) -> tuple[Peak, ...]:
    best = scores.max(axis=(0, 1))
    peaks: list[Peak] = []
    free = best >= maximum_filter1d(best, _REACH)  # a shoulder is no peak
    while np.any(free) and len(peaks) < _PEAKS:
        at = int(np.argmax(np.where(free, best, -np.inf)))
        lag, drift = np.unravel_index(int(np.argmax(scores[..., at])), scores.shape[:2])
        peaks.append(
            Peak(offset_s=float(offsets[at]), drift=float(drifts[drift]), lag_s=lags[int(lag)], score=float(best[at]))
        )
        free &= np.abs(offsets - offsets[at]) > _APART_S
    return tuple(peaks)


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
