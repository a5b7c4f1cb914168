"""Offset, drift and lag of a video: to hundredths of a second by the camera's rotations, to milliseconds by its path.

Every offset and drift of a range is weighed by all image pairs at once. For each image pair and each instant of the
log, how well does the pair's homography agree with the camera's turn and tilt then, whatever the camera's translation
was? An offset with a drift is a straight line through that table; its score is the sum along it. A pair's entry is its
likelihood over its mean over the log, so that a pair that would fit anywhere (a hover), or that lies outside the log,
counts for nothing.

The best is the start of a nonlinear least-squares fit with t-distributed residuals, which begins with inflated
standard deviations, so that it does not stop at a local minimum. Besides these three, a small rotation between camera
and gimbal axes is estimated: a degree of it leaks rates from one axis into another. The log is a smoothed curve here,
which rounds off where a gimbal starts and stops: its reports are then compared with the camera's path.

The path by the images is precise and smooth, so it is interpolated, never the reports: their noise is only added to the
residuals and does not move with the assumed offset. Slow drift (of the path, of a report's bias) is a random walk among
the unknowns. A camera may lag by a pure delay, or follow by first order: then its report is its attitude advanced by
its rate times a time constant. Residuals of reports spread by noise, more at higher rates, and are correlated in time.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import maximum_filter1d

from aerodft.conventions import SECOND_NS
from aerodft.geometry import (
    from_rotation_vector,
    inverse,
    matrix,
    multiply,
    skew,
    student_loss,
    student_weights,
    to_rotation_vector,
    weighted_step,
)
from aerodft.model import BoolArray, FloatArray
from aerodft.service import GIMBAL_SOURCES
from aerodft.vision.camera_motion import FREE, PlaneMotion, Turns, turns_over_plane
from calibration.sync.motion import CameraMotion, CameraPath, PredictedRotations, predict_rotations

MAX_DRIFT = 0.03
"""Twice the drift of clocks that are worth aligning."""

_STEP_S = 0.05
_DRIFT_STEP = 0.0025
_MAX_PAIRS = 400
_MAX_FOCAL_PAIRS = 80  # of the profile over focal lengths
_LOG_RATE_STD_RADPS = 0.015  # of telemetry against the camera, in part because its lag is not quite known yet
_LAG_GRID_S = (0.05, 0.175, 0.3)  # grid of the search
_MIN_LIKELIHOOD = np.exp(-8.0)  # floor of a pair's likelihood: a pair may be wrong
_MIN_PEAK_DISTANCE_S = 1.0  # peaks closer than this are one
_MAX_PEAKS = 2
_PEAK_WINDOW = 2 * round(_MIN_PEAK_DISTANCE_S / _STEP_S) + 1
OFFSET, DRIFT, LAG = range(3)
LAG_PRIOR_S = (0.15, 0.1)
"""Mean and standard deviation of the prior of a gimbal's lag."""

_TURN_SIZE = 6
_PRIOR_STD = np.array([np.inf, np.inf, LAG_PRIOR_S[1], 0.05, 0.05, 0.05])
_PRIOR_MEAN = np.array([0.0, 0.0, LAG_PRIOR_S[0], 0.0, 0.0, 0.0])
_STEP = np.array([0.01, 2e-4, 0.01, 0.002, 0.002, 0.002])  # of central differences
_RATE_STD_RADPS = 0.001  # of the camera's motion relative to its gimbal
_STUDENT_DOF = 4.0  # degrees of freedom of the rotations' t distribution
_MEDIAN_CHI2 = 2.366  # with 3 degrees of freedom
_MIN_ITERATIONS, _ITERATIONS = 6, 12
_INITIAL_STD_RADPS, _STD_DECAY = 0.05, 0.4  # added to the residuals' std, times the decay in each iteration
_CONVERGED = np.array([1e-5, 1e-7, 1e-5])
_FIXED = 1e18  # precision of a fixed parameter
_JITTERS_S = (0.0005, 0.001, 0.002, 0.004, 0.008)  # more would explain any other way of following
_NOISE_ITERATIONS = 8
_PATH_STD_RAD = 3e-4  # between its images
_CORRELATION_S = 3.0  # residuals farther apart in time are independent
_BIN_S = 0.25
_CRITICAL_VALUES = np.array([-0.5324, 0.4160, 2.9694, 1.9600]) / 1.96  # by b, the window as a share of all, at 95 %
SMEAR = LAG + 1
"""Index of the time constant among the unknowns; a rotation of the whole path follows."""

MIN_REPORTS = 20
"""Smallest number of reports that an alignment is fitted to."""

_PATH_SIZE = SMEAR + 4
_PATH_PRIOR_STD = np.array([np.inf, np.inf, LAG_PRIOR_S[1], 0.15, 0.1, 0.1, 0.1])
_PATH_PRIOR_MEAN = np.array([0.0, 0.0, LAG_PRIOR_S[0], 0.0, 0.0, 0.0, 0.0])
_PATH_STEP = np.array([0.004, 1e-4, 0.004, 0.004, 0.002, 0.002, 0.002])  # of central differences
_START_SHARES = (0.0, 0.5, 1.0)  # of the lag that the time constant starts with
_RATE_HALF_STEP_S = 0.05  # of the difference quotient of a rate
_MARGIN_S = 0.4  # to the video's ends, for shifts during the fit
_REPORT_BIN_S = 0.4  # reports this close are one residual: a lead's amplification of the path's noise averages out
_KNOT_S, _MAX_KNOTS = 0.5, 240
_WALK_STD_RAD = 0.0005  # in a second, besides the path's own
_WALK_START_STD_RAD = 0.2  # of its first knot
_MIN_PATH_ITERATIONS, _PATH_ITERATIONS = 8, 14
_STD_FACTOR = 1.3  # ratio of the errors of simulated flights to the stds by model and residuals
_STAMP_STD_S = 0.0005  # of stamps in whole milliseconds, with those of the clock map
_UNSTAMPED_STD_S = 0.02  # of reports that take the time of the message before them


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """Candidate alignment: offset (s, at the reference), drift, lag (s), score (natural logarithm of the evidence)."""

    offset_s: float
    drift: float
    lag_s: float
    score: float


def search(
    motion: PlaneMotion, camera: CameraMotion, zero_ns: int, max_offset_s: float, *, most_pairs: int = _MAX_PAIRS
) -> tuple[Peak, ...]:
    """Search the best offset, and the best of those not near it, in descending order of score.

    Args:
        motion: ``n`` image pairs, stamped by the video's clock.
        camera: The log.
        zero_ns: The reference: offset is added there, drift counts from there; that of ``camera``.
        max_offset_s: Offsets of up to this, on both sides.
        most_pairs: How many of the image pairs are weighed, about.
    """
    every = max(len(motion) // most_pairs, 1)
    start_s, end_s = ((stamps[::every] - zero_ns) / SECOND_NS for stamps in (motion.start_ns, motion.end_ns))
    reach_s = max_offset_s + MAX_DRIFT * float(np.max(np.abs(start_s)))
    log_s = np.arange(start_s[0] - reach_s, start_s[-1] + reach_s + _STEP_S, _STEP_S)
    offsets = np.arange(-max_offset_s, max_offset_s + _STEP_S / 2, _STEP_S)
    drifts = np.arange(-MAX_DRIFT, MAX_DRIFT + _DRIFT_STEP / 2, _DRIFT_STEP)
    lags = _LAG_GRID_S if camera.has_lag else (0.0,)
    scores = np.empty((len(lags), len(drifts), len(offsets)))
    pairs = np.arange(len(start_s))
    for layer, lag_s in enumerate(lags):
        table = _log_likelihood_ratios(motion, every, camera, (log_s, end_s - start_s), lag_s)
        for row, drift in enumerate(drifts):
            at = np.rint((offsets[:, None] + (1 + drift) * start_s - log_s[0]) / _STEP_S).astype(np.int64)
            scores[layer, row] = table[pairs, np.clip(at, 0, len(log_s) - 1)].sum(axis=1)
    return _peaks(scores, offsets, drifts, lags)


def _log_likelihood_ratios(
    motion: PlaneMotion, every: int, camera: CameraMotion, times: tuple[FloatArray, FloatArray], lag_s: float
) -> FloatArray:
    """Logarithms ``(pairs, instants)`` of likelihood over its mean; 0 where the log knows nothing."""
    log_s, between_s = times
    typical_s = float(np.median(between_s))
    logged = predict_rotations(camera, log_s, log_s + typical_s, lag_s)
    rate, known = logged.rotvec_rad / typical_s, logged.known
    table = np.zeros((len(between_s), len(log_s)))
    if not np.any(known):
        return table
    for row, (homography, cov, step_s) in enumerate(
        zip(motion.homography[::every], motion.cov[::every], between_s, strict=True)
    ):
        misfit = _misfit(homography, cov, rate[known] * step_s, logged.normal_cam[known], _LOG_RATE_STD_RADPS * step_s)
        likelihood = np.exp(-misfit / 2) + _MIN_LIKELIHOOD
        table[row, known] = np.log(likelihood / likelihood.mean())
    return table


def _misfit(
    homography: FloatArray, cov: FloatArray, turn_rad: FloatArray, normal_cam: FloatArray, std_rad: float
) -> FloatArray:
    """Squared distance ``(m,)`` of a homography from rotations and normals ``(m, 3)``, over all translations.

    First order in the turn and the translation.
    """
    rotation_jacobian = -skew(np.eye(3)).reshape(3, 9).T[:FREE]
    information = np.linalg.inv(cov + std_rad**2 * rotation_jacobian @ rotation_jacobian.T)
    last = homography.ravel()[:FREE]
    difference = last - np.eye(3).ravel()[:FREE] - turn_rad @ rotation_jacobian.T
    moving = np.zeros((len(normal_cam), 3, 3, 3))
    for axis in range(3):
        moving[:, axis, :, axis] = normal_cam
    moved = moving.reshape(-1, 9, 3)
    translation_jacobian = moved[:, :FREE] - last[:, None] * moved[:, FREE:]  # the last element stays 1
    weighted = np.swapaxes(translation_jacobian, -1, -2) @ information
    translation = np.linalg.solve(weighted @ translation_jacobian, weighted @ difference[..., None])
    residual = difference - (translation_jacobian @ translation)[..., 0]
    return np.asarray(np.einsum("mi,ij,mj->m", residual, information, residual))


def evidence_by_focal(
    motion: PlaneMotion, camera: CameraMotion, zero_ns: int, values: FloatArray, scales: FloatArray
) -> FloatArray:
    """Log likelihoods ``(k,)`` of an alignment, were the focal length ``scales (k,)`` times as long.

    Args:
        motion: Image pairs, stamped by the video's clock.
        camera: The log.
        zero_ns: The reference.
        values: ``(3,)``: offset (s, at the reference), drift, lag (s).
        scales: Of the focal length.
    """
    offset, drift, lag = values.tolist()
    stamps = np.stack([motion.start_ns, motion.end_ns])
    start_s, end_s = offset + (1 + drift) * ((stamps - zero_ns) / SECOND_NS)
    every = max(len(motion) // _MAX_FOCAL_PAIRS, 1)
    logged = predict_rotations(camera, start_s, end_s, lag)
    total = np.zeros(len(scales))
    for index, scale in enumerate(scales.tolist()):
        scaled = with_focal(motion, scale)
        for row in np.flatnonzero(logged.known)[::every].tolist():
            turn, normal = logged.rotvec_rad[row : row + 1], logged.normal_cam[row : row + 1]
            std_rad = _LOG_RATE_STD_RADPS * float(end_s[row] - start_s[row])
            misfit = _misfit(scaled.homography[row], scaled.cov[row], turn, normal, std_rad)
            total[index] += float(np.log(np.exp(-misfit / 2) + _MIN_LIKELIHOOD)[0])
    return total


def with_focal(motion: PlaneMotion, scale: float) -> PlaneMotion:
    """The motion that the images show, were the focal length ``scale`` times as long: rays are nearer to the axis."""
    ray = np.array([1 / scale, 1 / scale, 1.0])
    factors = ray[:, None] / ray
    free = factors.ravel()[:FREE]
    return replace(motion, homography=motion.homography * factors, cov=motion.cov * np.outer(free, free))


def _peaks(scores: FloatArray, offsets: FloatArray, drifts: FloatArray, lags: tuple[float, ...]) -> tuple[Peak, ...]:
    best = scores.max(axis=(0, 1))
    peaks: list[Peak] = []
    free = best >= maximum_filter1d(best, _PEAK_WINDOW)  # a shoulder is no peak
    while np.any(free) and len(peaks) < _MAX_PEAKS:
        at = int(np.argmax(np.where(free, best, -np.inf)))
        lag, drift = np.unravel_index(int(np.argmax(scores[..., at])), scores.shape[:2])
        peaks.append(
            Peak(offset_s=float(offsets[at]), drift=float(drifts[drift]), lag_s=lags[int(lag)], score=float(best[at]))
        )
        free &= np.abs(offsets - offsets[at]) > _MIN_PEAK_DISTANCE_S
    return tuple(peaks)


class RotationProblem:
    """Rotations of image pairs against a log; ``zero_ns`` is the origin of the video's time."""

    def __init__(self, motion: PlaneMotion, camera: CameraMotion, zero_ns: int) -> None:
        self.motion = motion
        self.camera = camera
        self.start_s = (motion.start_ns - zero_ns) / SECOND_NS
        self.end_s = (motion.end_ns - zero_ns) / SECOND_NS
        self.between_s = self.end_s - self.start_s

    def predicted_by_log(self, values: FloatArray) -> PredictedRotations:
        """Predict rotations and normals of all pairs by the log under an alignment."""
        offset, drift, lag = values[: LAG + 1].tolist()
        start, end = (offset + (1 + drift) * times for times in (self.start_s, self.end_s))
        logged = predict_rotations(self.camera, start, end, lag)
        camera_from_gimbal = matrix(from_rotation_vector(values[LAG + 1 :])).T
        return PredictedRotations(
            rotvec_rad=logged.rotvec_rad @ camera_from_gimbal,
            normal_cam=logged.normal_cam @ camera_from_gimbal,
            known=logged.known,
        )

    def seen(self, logged: PredictedRotations) -> Turns:
        """Rotations by the images, over the ground plane of the log."""
        return turns_over_plane(self.motion, logged.normal_cam, logged.rotvec_rad)

    def off(self, values: FloatArray) -> FloatArray:
        """Residuals ``(n, 3)``: rotation by images minus that of the log, rad."""
        logged = self.predicted_by_log(values)
        return self.seen(logged).rotvec_rad - logged.rotvec_rad


def fit(problem: RotationProblem, start: FloatArray) -> FloatArray:
    """Fit from ``start (3,)``: offset (s, at the reference), drift, lag (s).

    Returns:
        ``(6,)``: offset, drift, lag, and the turn of the camera's axes against the gimbal's (rad).
    """
    fixed = np.arange(_TURN_SIZE) == (LAG if not problem.camera.has_lag else -1)
    precision, mean = np.where(fixed, _FIXED, 1 / _PRIOR_STD**2), np.where(fixed, 0.0, _PRIOR_MEAN)
    values = np.where(fixed, 0.0, np.concatenate([start, np.zeros(_TURN_SIZE - len(start))]))
    for round_ in range(_ITERATIONS):
        lines = _linearize(problem, values)
        jac, off = _whiten(lines, (_INITIAL_STD_RADPS * _STD_DECAY**round_ * problem.between_s) ** 2)
        step, _ = weighted_step(jac, off, np.ones(len(off)), (np.diag(precision), mean - values))
        values = np.where(fixed, 0.0, values + step)
        if round_ >= _MIN_ITERATIONS and np.all(np.abs(step[: LAG + 1]) < _CONVERGED):
            break
    return np.asarray(values)


@dataclass(frozen=True, slots=True, eq=False)
class _LinearizedPairs:
    """Linearization for the ``m`` pairs that the log covers.

    Attributes:
        jac: ``(m, 3, 6)`` Jacobian of the log's rotations minus the images'.
        off: ``(m, 3)`` residuals, images' minus log's, rad.
        cov: ``(m, 3, 3)`` of the images' rotations.
        used: ``(n,)`` mask of these pairs.
    """

    jac: FloatArray
    off: FloatArray
    cov: FloatArray
    used: BoolArray


def _linearize(problem: RotationProblem, values: FloatArray) -> _LinearizedPairs:
    logged = problem.predicted_by_log(values)
    seen, used = problem.seen(logged), logged.known
    jac = np.empty((len(problem.motion), 3, _TURN_SIZE))
    for column, step in enumerate(_STEP):
        ahead, behind = values.copy(), values.copy()
        ahead[column] += step
        behind[column] -= step
        jac[..., column] = (problem.off(behind) - problem.off(ahead)) / (2 * step)
    # A homography that misfits its plane has an error of that size.
    misfit = np.maximum(seen.chi2 / 2, 1.0)[:, None, None]
    rate_cov = ((_RATE_STD_RADPS * problem.between_s) ** 2)[:, None, None] * np.eye(3)
    return _LinearizedPairs(
        jac=jac[used],
        off=(seen.rotvec_rad - logged.rotvec_rad)[used],
        cov=(misfit * seen.cov_rad2 + rate_cov)[used],
        used=used,
    )


def _whiten(lines: _LinearizedPairs, doubt_rad2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Whiten Jacobian and residuals, with t-distribution weights."""
    cov = lines.cov + doubt_rad2[lines.used][:, None, None] * np.eye(3)
    whitening = np.linalg.inv(np.linalg.cholesky(cov))
    jac, off = whitening @ lines.jac, np.einsum("nij,nj->ni", whitening, lines.off)
    squares = np.sum(off**2, axis=-1)
    scale2 = float(np.median(squares)) / _MEDIAN_CHI2
    scale = np.sqrt(student_weights(squares / scale2, 3, _STUDENT_DOF) / scale2)
    return jac * scale[:, None, None], off * scale[:, None]


@dataclass(frozen=True, slots=True)
class NoiseScales:
    """Noise of each axis, and of each residual's time.

    Attributes:
        noise_rad: Standard deviation of an angle.
        jitter_s: Of the time: what it makes lies along the rate.
    """

    noise_rad: float
    jitter_s: float

    @staticmethod
    def initial() -> "NoiseScales":
        """Initial spread of the fit."""
        return NoiseScales(0.003, _JITTERS_S[-1])

    def whitening(self, off_rad: FloatArray, rate_radps: FloatArray) -> FloatArray:
        """Whitening matrices ``(n, 3, 3)``, with t-distribution weights."""
        along = self.jitter_s**2 * rate_radps[:, :, None] * rate_radps[:, None, :]
        whitening = np.linalg.inv(np.linalg.cholesky(self.noise_rad**2 * np.eye(3) + along))
        squares = np.sum((whitening @ off_rad[..., None]) ** 2, axis=(1, 2))
        return np.asarray(whitening * np.sqrt(student_weights(squares, 3, _STUDENT_DOF))[:, None, None])

    def cost(self, off_rad: FloatArray, rate_radps: FloatArray) -> float:
        """Negative log likelihood of residuals ``(n, 3)``, up to a constant."""
        along, across = _split_squares(off_rad, rate_radps)
        along_var = self.noise_rad**2 + self.jitter_s**2 * np.sum(rate_radps**2, axis=-1)
        squares = along / along_var + across / self.noise_rad**2
        return float(
            np.sum(student_loss(squares, 3, _STUDENT_DOF) + np.log(along_var) / 2 + 2 * np.log(self.noise_rad))
        )


def fit_noise_scales(off_rad: FloatArray, rate_radps: FloatArray) -> NoiseScales:
    """Most likely spread of residuals ``(n, 3)`` at rates ``(n, 3)``."""
    tries = [NoiseScales(_noise_rad(off_rad, rate_radps, jitter_s), jitter_s) for jitter_s in _JITTERS_S]
    return min(tries, key=lambda each: each.cost(off_rad, rate_radps))


def _noise_rad(off_rad: FloatArray, rate_radps: FloatArray, jitter_s: float) -> float:
    along, across = _split_squares(off_rad, rate_radps)
    jitter = jitter_s**2 * np.sum(rate_radps**2, axis=-1)
    noise = float(np.mean(off_rad**2))
    for _ in range(_NOISE_ITERATIONS):
        squares = along / (noise + jitter) + across / noise
        noise *= float(np.mean(student_weights(squares, 3, _STUDENT_DOF) * squares)) / 3
    return float(np.hypot(np.sqrt(noise), _PATH_STD_RAD))


def _split_squares(off_rad: FloatArray, rate_radps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squares ``(n,)`` of the components along the rate and across it."""
    rate2 = np.maximum(np.sum(rate_radps**2, axis=-1), np.finfo(np.float64).tiny)
    along = np.sum(off_rad * rate_radps, axis=-1) ** 2 / rate2
    return along, np.sum(off_rad**2, axis=-1) - along


def correlated_covariance(times_s: FloatArray, parts: FloatArray) -> FloatArray:
    """Covariance ``(u, u)`` of a sum of terms ``(n, u)`` correlated in time (Newey and West 1987).

    From few independent stretches it would be too small: it is scaled so that 1.96 of its standard deviations hold
    95 % (Kiefer and Vogelsang, A new asymptotic theory for heteroskedasticity-autocorrelation robust tests, 2005).
    """
    bins = ((times_s - np.min(times_s)) / _BIN_S).astype(np.int64)
    sums = np.zeros((int(bins.max()) + 1, parts.shape[1]))
    np.add.at(sums, bins, parts)
    reach = round(_CORRELATION_S / _BIN_S)
    total = sums.T @ sums
    for lag in range(1, min(reach, len(sums))):
        cross = sums[lag:].T @ sums[:-lag]
        total += (1 - lag / reach) * (cross + cross.T)
    return np.asarray(total * np.polyval(_CRITICAL_VALUES, min(reach / len(sums), 1.0)) ** 2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RefinedAlignment:
    """Refined alignment.

    Attributes:
        values: ``(3,)`` offset (s, at the reference), drift, lag (s).
        cov: ``(3, 3)``.
        time_constant_s: Part of the lag that is a first-order time constant.
        cost: Negative log likelihood.
    """

    values: FloatArray
    cov: FloatArray
    time_constant_s: float
    cost: float


def refine_alignment(camera: CameraMotion, path: CameraPath, start: FloatArray) -> RefinedAlignment:
    """Refine an alignment ``start (3,)``, which must be within tenths of a second.

    Raises:
        LookupError: Fewer than ``MIN_REPORTS`` reports at times between measured images.
    """
    reports = _BinnedReports(camera, path, start)
    walk = _RandomWalk(reports.video_s, path)
    shares = _START_SHARES if camera.has_lag else (0.0,)
    tries = [_PathFit(reports, walk, has_lag=camera.has_lag).solve(start, share) for share in shares]
    best = min(tries, key=lambda each: each.cost)
    if GIMBAL_SOURCES[camera.source].is_stamped:
        return best
    return replace(best, cov=best.cov + np.diag([0.0, 0.0, _UNSTAMPED_STD_S**2]))


class _BinnedReports:
    """Reports at times at which the path is known, averaged over bins of some tenths of a second.

    Attributes:
        video_s: ``(n,)`` mean times of the bins by the video's clock.
    """

    def __init__(self, camera: CameraMotion, path: CameraPath, start: FloatArray) -> None:
        self._camera, self._path = camera, path
        utc_s = camera.report_s + start[LAG]
        video_s = (utc_s - start[OFFSET]) / (1 + start[DRIFT])
        masks = [camera.knows_reference(utc_s + sign * _MARGIN_S / 2) for sign in (-1, 1)]
        masks += [path.sees(video_s + sign * _MARGIN_S) for sign in (-1, 0, 1)]
        keep = np.all(masks, axis=0)
        if np.count_nonzero(keep) < MIN_REPORTS:
            raise LookupError(np.count_nonzero(keep))
        self._report_s, self._wxyz = camera.report_s[keep], camera.report_wxyz[keep]
        bins = np.floor((self._report_s - self._report_s[0]) / _REPORT_BIN_S)
        _, self._group = np.unique(bins, return_inverse=True)
        self._count = np.bincount(self._group)
        self.video_s = self._mean(video_s[keep])

    def off(self, values: FloatArray) -> FloatArray:
        """Residuals ``(n, 3)``: rotation from the expected report to the actual one, in the gimbal's axes."""
        utc_s = self._report_s + values[LAG] - values[SMEAR]
        expected = self._expected(utc_s, values)
        if values[SMEAR] > 0:
            lead = from_rotation_vector(values[SMEAR] * self._rate_radps(utc_s, values))
            expected = multiply(expected, lead)
        return self._mean(to_rotation_vector(multiply(inverse(expected), self._wxyz)))

    def rate_radps(self, values: FloatArray) -> FloatArray:
        """Angular rates ``(n, 3)`` of the expected reports."""
        return self._mean(self._rate_radps(self._report_s + values[LAG] - values[SMEAR], values))

    def _expected(self, utc_s: FloatArray, values: FloatArray) -> FloatArray:
        path = self._path.at((utc_s - values[OFFSET]) / (1 + values[DRIFT]))
        return self._camera.report_of(utc_s, multiply(from_rotation_vector(values[SMEAR + 1 :]), path))

    def _rate_radps(self, utc_s: FloatArray, values: FloatArray) -> FloatArray:
        before, after = (self._expected(utc_s + sign * _RATE_HALF_STEP_S, values) for sign in (-1, 1))
        return to_rotation_vector(multiply(inverse(before), after)) / (2 * _RATE_HALF_STEP_S)

    def _mean(self, rows: FloatArray) -> FloatArray:
        total = np.zeros((len(self._count), *rows.shape[1:]))
        np.add.at(total, self._group, rows)
        return total / self._count.reshape(-1, *[1] * (rows.ndim - 1))


class _RandomWalk:
    """Random walk of three equal axes: its values at knots, linear between them.

    Attributes:
        basis: ``(n, m)`` from knots to residuals.
        steps: ``(m, m)`` from knots to steps of standard deviation 1; the first row is its start.
        step_s: ``(m,)`` times of the steps.
    """

    def __init__(self, times_s: FloatArray, path: CameraPath) -> None:
        span_s = float(times_s[-1] - times_s[0])
        knots = np.linspace(times_s[0], times_s[-1], int(np.clip(span_s / _KNOT_S, 1, _MAX_KNOTS)) + 1)
        self.basis = np.stack([np.interp(times_s, knots, row) for row in np.eye(len(knots))], axis=1)
        between_s = knots[1] - knots[0]
        std = np.hypot(path.stray_rad(knots), _WALK_STD_RAD * np.sqrt(between_s))
        self.steps = np.diff(np.eye(len(knots)), axis=0, prepend=0.0) / np.append(_WALK_START_STD_RAD, std)[:, None]
        self.step_s = np.concatenate([knots[:1], (knots[1:] + knots[:-1]) / 2])


class _PathFit:
    """Weighted least squares with t-distributed residuals; the walk's knots are among the unknowns.

    All unknowns stand in one row: the seven, then the walk's knots, axis by axis.
    """

    def __init__(self, reports: _BinnedReports, walk: _RandomWalk, *, has_lag: bool) -> None:
        self._reports, self._walk = reports, walk
        self._fixed = np.isin(np.arange(_PATH_SIZE), () if has_lag else (LAG, SMEAR))
        self._knot_jacobian = np.kron(np.eye(3), walk.basis).reshape(3, -1, 3 * walk.basis.shape[1]).swapaxes(0, 1)
        self._steps = np.kron(np.eye(3), walk.steps)
        self._noise = NoiseScales.initial()

    def solve(self, start: FloatArray, share: float) -> RefinedAlignment:
        """Fit from ``start (3,)``, with ``share`` of the lag as a time constant."""
        values = np.concatenate([start, [share * start[LAG], 0.0, 0.0, 0.0]])
        values, knots = np.where(self._fixed, 0.0, values), np.zeros(len(self._steps))
        for round_ in range(_PATH_ITERATIONS):
            lines = self._lines(values, knots)
            step = cho_solve(lines.factor, lines.gradient)
            values, knots = values + np.where(self._fixed, 0.0, step[:_PATH_SIZE]), knots + step[_PATH_SIZE:]
            if values[SMEAR] < 0:
                values[SMEAR] = 0.0
                self._fixed[SMEAR] = round_ >= _MIN_PATH_ITERATIONS
            self._noise = fit_noise_scales(self._off(values, knots), self._reports.rate_radps(values))
            if round_ > _MIN_PATH_ITERATIONS and np.all(np.abs(step[: LAG + 1]) < _CONVERGED):
                break
        lines = self._lines(values, knots)
        return RefinedAlignment(
            values=values[: LAG + 1],
            cov=self._covariance(lines, knots),
            time_constant_s=float(values[SMEAR]),
            cost=self._cost(values, knots),
        )

    def _off(self, values: FloatArray, knots: FloatArray) -> FloatArray:
        return self._reports.off(values) - self._knot_jacobian @ knots

    def _prior(self) -> tuple[FloatArray, FloatArray]:
        """Precision and mean of the seven path unknowns."""
        return np.where(self._fixed, _FIXED, 1 / _PATH_PRIOR_STD**2), np.where(self._fixed, 0.0, _PATH_PRIOR_MEAN)

    def _weighted_steps(self, knots: FloatArray) -> FloatArray:
        """Steps of the walk, down-weighted where the path drifts far, as while water was followed."""
        squares = np.sum((self._steps @ knots).reshape(3, -1) ** 2, axis=0)
        return np.asarray(self._steps * np.tile(np.sqrt(student_weights(squares, 3, _STUDENT_DOF)), 3)[:, None])

    def _lines(self, values: FloatArray, knots: FloatArray) -> "_NormalEquations":
        jac = np.zeros((*self._reports.off(values).shape, _PATH_SIZE))
        for column in np.flatnonzero(~self._fixed):
            step = _PATH_STEP[column] * (np.arange(_PATH_SIZE) == column)
            jac[..., column] = (self._reports.off(values - step) - self._reports.off(values + step)) / (
                2 * _PATH_STEP[column]
            )
        whitening = self._noise.whitening(self._off(values, knots), self._reports.rate_radps(values))
        white = (whitening @ np.concatenate([jac, self._knot_jacobian], axis=-1)).reshape(-1, _PATH_SIZE + len(knots))
        scores = white * (whitening @ self._off(values, knots)[..., None]).reshape(-1, 1)
        precision, mean = self._prior()
        information, gradient = white.T @ white, np.sum(scores, axis=0)
        information[:_PATH_SIZE, :_PATH_SIZE] += np.diag(precision)
        gradient[:_PATH_SIZE] += precision * (mean - values)
        steps = self._weighted_steps(knots)
        information[_PATH_SIZE:, _PATH_SIZE:] += steps.T @ steps
        gradient[_PATH_SIZE:] -= steps.T @ (steps @ knots)
        return _NormalEquations(cho_factor(information), gradient, np.sum(scores.reshape(*jac.shape[:2], -1), axis=1))

    def _covariance(self, lines: "_NormalEquations", knots: FloatArray) -> FloatArray:
        """Covariance ``(3, 3)`` by the model and by the residuals' correlation in time."""
        size = _PATH_SIZE + len(knots)
        bread = np.asarray(cho_solve(lines.factor, np.eye(size)[:, :_PATH_SIZE])).T[: LAG + 1]
        by_reports = lines.scores @ bread.T
        steps = self._weighted_steps(knots)
        by_steps = -(steps * (steps @ knots)[:, None]) @ bread[:, _PATH_SIZE:].T
        times_s = np.concatenate([self._reports.video_s, np.tile(self._walk.step_s, 3)])
        spread = bread[:, : LAG + 1] + correlated_covariance(times_s, np.concatenate([by_reports, by_steps]))
        return np.asarray(_STD_FACTOR**2 * spread) + np.diag([_STAMP_STD_S**2, 0.0, _STAMP_STD_S**2])

    def _cost(self, values: FloatArray, knots: FloatArray) -> float:
        precision, mean = self._prior()
        prior = np.sum(np.where(self._fixed, 0.0, precision * (values - mean) ** 2)) / 2
        squares = np.sum((self._steps @ knots).reshape(3, -1) ** 2, axis=0)
        off = self._noise.cost(self._off(values, knots), self._reports.rate_radps(values))
        return off + float(prior + np.sum(student_loss(squares, 3, _STUDENT_DOF)))


@dataclass(frozen=True, slots=True, eq=False)
class _NormalEquations:
    """Factored normal equations, gradient, and each residual's part of the gradient ``(n, unknowns)``."""

    factor: tuple[FloatArray, bool]
    gradient: FloatArray
    scores: FloatArray
