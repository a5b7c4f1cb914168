"""Offset, drift and lag to milliseconds: what the log reported, against where the camera's path says that it looked.

The path by the images is precise and smooth, so it is taken between its samples, never the reports: their noise is only
added to the residuals and does not move with the assumed offset. What strays slowly (the path, a report's bias) is a
random walk beside the unknowns. A camera may be late by a pure delay, or follow by first order: then its report is
where it is, and its rate times a time constant ahead. Residuals of reports spread by noise, the faster the camera turns
the more, and are alike for a while.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from aerodft.geometry.rotation import from_rotation_vector, inverse, multiply, to_rotation_vector
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import GimbalSource
from calibration.sync_fit import DRIFT, LAG, LAG_PRIOR_S, OFFSET
from calibration.sync_motion import CameraMotion, CameraPath

_STUDENT = 4.0  # degrees of freedom of the t distribution
_JITTERS_S = (0.0005, 0.001, 0.002, 0.004, 0.008)  # more would explain any other way of following
_ROUNDS = 8
_PATH_STD_RAD = 3e-4  # between its images
_CORRELATED_S = 3.0  # residuals farther apart in time have nothing to do with each other
_BIN_S = 0.25
_FIXED_SHARE = np.array([-0.5324, 0.4160, 2.9694, 1.9600]) / 1.96  # of the whole: their critical values, at 95 %
SMEAR = LAG + 1
"""The time constant's place among the unknowns; a turn of the path as a whole follows."""

FEWEST_REPORTS = 20
"""With fewer there is no answer."""

_UNKNOWNS = SMEAR + 4
_PRIOR_STD = np.array([np.inf, np.inf, LAG_PRIOR_S[1], 0.15, 0.1, 0.1, 0.1])
_PRIOR_MEAN = np.array([0.0, 0.0, LAG_PRIOR_S[0], 0.0, 0.0, 0.0, 0.0])
_STEP = np.array([0.004, 1e-4, 0.004, 0.004, 0.002, 0.002, 0.002])  # of central differences
_SHARES = (0.0, 0.5, 1.0)  # of the lag that the time constant makes up at first
_AROUND_S = 0.05  # on both sides, of a rate
_MARGIN_S = 0.4  # of the video's ends, for what is yet to be moved
_TOGETHER_S = 0.4  # reports this close are one residual: what a lead adds to the path's noise averages out
_KNOT_S, _MOST_KNOTS = 0.5, 240
_STRAY_RAD = 0.0005  # in a second, beside what is known of the path
_FIRST_RAD = 0.2  # how far off it may begin
_LEAST_ITERATIONS, _ITERATIONS = 8, 14
_CONVERGED = np.array([1e-5, 1e-7, 1e-5])
_FIXED = 1e18  # precision of what is no unknown
_BESIDE = 1.3  # times what model and residuals tell were the errors over simulated flights
_WHOLE_MS_STD_S = 0.0005  # of stamps that count milliseconds, with those of the clock map
_UNSTAMPED = (GimbalSource.MOUNT_STATUS,)
_UNSTAMPED_STD_S = 0.02  # of reports that take the time of the message before them


@dataclass(frozen=True, slots=True)
class Spread:
    """Noise of each axis, and of each residual's time.

    Attributes:
        noise_rad: Standard deviation of an angle.
        jitter_s: Of the time: what it makes lies along the rate.
    """

    noise_rad: float
    jitter_s: float

    @staticmethod
    def first() -> "Spread":
        """Before anything is known."""
        return Spread(0.003, _JITTERS_S[-1])

    def inward(self, off_rad: FloatArray, rate_radps: FloatArray) -> FloatArray:
        """``(n, 3, 3)`` to units of standard deviation 1; less of what is far off."""
        along = self.jitter_s**2 * rate_radps[:, :, None] * rate_radps[:, None, :]
        inward = np.linalg.inv(np.linalg.cholesky(self.noise_rad**2 * np.eye(3) + along))
        squares = np.sum((inward @ off_rad[..., None]) ** 2, axis=(1, 2))
        return np.asarray(inward * np.sqrt(forgiven(squares))[:, None, None])

    def cost(self, off_rad: FloatArray, rate_radps: FloatArray) -> float:
        """Minus the logarithm of the likelihood of residuals ``(n, 3)``, but for a constant."""
        along, across = _parts(off_rad, rate_radps)
        along_var = self.noise_rad**2 + self.jitter_s**2 * np.sum(rate_radps**2, axis=-1)
        squares = along / along_var + across / self.noise_rad**2
        return float(np.sum(loss(squares) + np.log(along_var) / 2 + 2 * np.log(self.noise_rad)))


def scales(off_rad: FloatArray, rate_radps: FloatArray) -> Spread:
    """The likeliest of residuals ``(n, 3)`` at rates ``(n, 3)``."""
    tries = [Spread(_noise_rad(off_rad, rate_radps, jitter_s), jitter_s) for jitter_s in _JITTERS_S]
    return min(tries, key=lambda each: each.cost(off_rad, rate_radps))


def _noise_rad(off_rad: FloatArray, rate_radps: FloatArray, jitter_s: float) -> float:
    along, across = _parts(off_rad, rate_radps)
    jitter = jitter_s**2 * np.sum(rate_radps**2, axis=-1)
    noise = float(np.mean(off_rad**2))
    for _ in range(_ROUNDS):
        squares = along / (noise + jitter) + across / noise
        noise *= float(np.mean(forgiven(squares) * squares)) / 3
    return float(np.hypot(np.sqrt(noise), _PATH_STD_RAD))


def forgiven(squares: FloatArray) -> FloatArray:
    """Weights ``(n,)`` of t-distributed vectors of three, by the sum of their squares."""
    return np.asarray((_STUDENT + 3) / (_STUDENT + squares))


def loss(squares: FloatArray) -> FloatArray:
    """Minus the logarithm of their likelihood ``(n,)``, but for a constant."""
    return np.asarray((_STUDENT + 3) / 2 * np.log1p(squares / _STUDENT))


def _parts(off_rad: FloatArray, rate_radps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squares ``(n,)`` of what lies along the rate, and across it."""
    rate2 = np.maximum(np.sum(rate_radps**2, axis=-1), np.finfo(np.float64).tiny)
    along = np.sum(off_rad * rate_radps, axis=-1) ** 2 / rate2
    return along, np.sum(off_rad**2, axis=-1) - along


def alike(times_s: FloatArray, parts: FloatArray) -> FloatArray:
    """Covariance ``(u, u)`` of the sum of parts ``(n, u)``, which are alike for a while (Newey and West 1987).

    Of few independent stretches it would come out too small: it is scaled so that 1.96 of its standard deviations hold
    95 % (Kiefer and Vogelsang, A new asymptotic theory for heteroskedasticity-autocorrelation robust tests, 2005).
    """
    bins = ((times_s - np.min(times_s)) / _BIN_S).astype(np.int64)
    sums = np.zeros((int(bins.max()) + 1, parts.shape[1]))
    np.add.at(sums, bins, parts)
    reach = round(_CORRELATED_S / _BIN_S)
    total = sums.T @ sums
    for lag in range(1, min(reach, len(sums))):
        cross = sums[lag:].T @ sums[:-lag]
        total += (1 - lag / reach) * (cross + cross.T)
    return np.asarray(total * np.polyval(_FIXED_SHARE, min(reach / len(sums), 1.0)) ** 2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refined:
    """A refined alignment.

    Attributes:
        values: ``(3,)`` offset (s, at the reference), drift, lag (s).
        cov: ``(3, 3)``.
        time_constant_s: The part of the lag in which the camera follows by first order.
        cost: Minus the logarithm of the likelihood.
    """

    values: FloatArray
    cov: FloatArray
    time_constant_s: float
    cost: float


def refined(camera: CameraMotion, path: CameraPath, start: FloatArray) -> Refined:
    """Fit from ``start (3,)``, which must be within tenths of a second.

    Raises:
        LookupError: Hardly any report is of a time that images tell about.
    """
    reports = _Reports(camera, path, start)
    walk = _Walk(reports.video_s, path)
    shares = _SHARES if camera.has_lag else (0.0,)
    tries = [_Fit(reports, walk, has_lag=camera.has_lag).found(start, share) for share in shares]
    best = min(tries, key=lambda each: each.cost)
    if camera.source not in _UNSTAMPED:
        return best
    return replace(best, cov=best.cov + np.diag([0.0, 0.0, _UNSTAMPED_STD_S**2]))


class _Reports:
    """Reports of times at which the path is known, some tenths of a second of them as one.

    Attributes:
        video_s: ``(n,)`` means of their times by the video's clock.
    """

    def __init__(self, camera: CameraMotion, path: CameraPath, start: FloatArray) -> None:
        self._camera, self._path = camera, path
        utc_s = camera.report_s + start[LAG]
        video_s = (utc_s - start[OFFSET]) / (1 + start[DRIFT])
        around = [camera.carries(utc_s + sign * _MARGIN_S / 2) for sign in (-1, 1)]
        around += [path.sees(video_s + sign * _MARGIN_S) for sign in (-1, 0, 1)]
        keep = np.all(around, axis=0)
        if np.count_nonzero(keep) < FEWEST_REPORTS:
            raise LookupError(np.count_nonzero(keep))
        self._report_s, self._wxyz = camera.report_s[keep], camera.report_wxyz[keep]
        together = np.floor((self._report_s - self._report_s[0]) / _TOGETHER_S)
        _, self._group = np.unique(together, return_inverse=True)
        self._count = np.bincount(self._group)
        self.video_s = self._mean(video_s[keep])

    def off(self, values: FloatArray) -> FloatArray:
        """``(n, 3)``: the turn from what should be reported to what is, in the gimbal's axes."""
        utc_s = self._report_s + values[LAG] - values[SMEAR]
        expected = self._expected(utc_s, values)
        if values[SMEAR] > 0:
            lead = from_rotation_vector(values[SMEAR] * self._rate_radps(utc_s, values))
            expected = multiply(expected, lead)
        return self._mean(to_rotation_vector(multiply(inverse(expected), self._wxyz)))

    def rate_radps(self, values: FloatArray) -> FloatArray:
        """``(n, 3)`` at which the reports change."""
        return self._mean(self._rate_radps(self._report_s + values[LAG] - values[SMEAR], values))

    def _expected(self, utc_s: FloatArray, values: FloatArray) -> FloatArray:
        path = self._path.at((utc_s - values[OFFSET]) / (1 + values[DRIFT]))
        return self._camera.report_of(utc_s, multiply(from_rotation_vector(values[SMEAR + 1 :]), path))

    def _rate_radps(self, utc_s: FloatArray, values: FloatArray) -> FloatArray:
        before, after = (self._expected(utc_s + sign * _AROUND_S, values) for sign in (-1, 1))
        return to_rotation_vector(multiply(inverse(before), after)) / (2 * _AROUND_S)

    def _mean(self, rows: FloatArray) -> FloatArray:
        total = np.zeros((len(self._count), *rows.shape[1:]))
        np.add.at(total, self._group, rows)
        return total / self._count.reshape(-1, *[1] * (rows.ndim - 1))


class _Walk:
    """What strays slowly, of three axes alike: its values at knots, straight between them.

    Attributes:
        basis: ``(n, m)`` from knots to residuals.
        steps: ``(m, m)`` from knots to what should be of standard deviation 1; the first row is its beginning.
        step_s: ``(m,)`` when each of these is.
    """

    def __init__(self, times_s: FloatArray, path: CameraPath) -> None:
        span_s = float(times_s[-1] - times_s[0])
        knots = np.linspace(times_s[0], times_s[-1], int(np.clip(span_s / _KNOT_S, 1, _MOST_KNOTS)) + 1)
        self.basis = np.stack([np.interp(times_s, knots, row) for row in np.eye(len(knots))], axis=1)
        between_s = knots[1] - knots[0]
        std = np.hypot(path.stray_rad(knots), _STRAY_RAD * np.sqrt(between_s))
        self.steps = np.diff(np.eye(len(knots)), axis=0, prepend=0.0) / np.append(_FIRST_RAD, std)[:, None]
        self.step_s = np.concatenate([knots[:1], (knots[1:] + knots[:-1]) / 2])


class _Fit:
    """Weighted least squares with t-distributed residuals; the walk's knots are among the unknowns.

    All unknowns stand in one row: the seven, then the walk's knots, axis by axis.
    """

    def __init__(self, reports: _Reports, walk: _Walk, *, has_lag: bool) -> None:
        self._reports, self._walk = reports, walk
        self._fixed = np.isin(np.arange(_UNKNOWNS), () if has_lag else (LAG, SMEAR))
        self._straying = np.kron(np.eye(3), walk.basis).reshape(3, -1, 3 * walk.basis.shape[1]).swapaxes(0, 1)
        self._steps = np.kron(np.eye(3), walk.steps)
        self._spread = Spread.first()

    def found(self, start: FloatArray, share: float) -> Refined:
        """From ``start (3,)``, this share of the lag being a time constant."""
        values = np.concatenate([start, [share * start[LAG], 0.0, 0.0, 0.0]])
        values, strays = np.where(self._fixed, 0.0, values), np.zeros(len(self._steps))
        for round_ in range(_ITERATIONS):
            lines = self._lines(values, strays)
            step = cho_solve(lines.factor, lines.gradient)
            values, strays = values + np.where(self._fixed, 0.0, step[:_UNKNOWNS]), strays + step[_UNKNOWNS:]
            if values[SMEAR] < 0:
                values[SMEAR] = 0.0
                self._fixed[SMEAR] = round_ >= _LEAST_ITERATIONS
            self._spread = scales(self._off(values, strays), self._reports.rate_radps(values))
            if round_ > _LEAST_ITERATIONS and np.all(np.abs(step[: LAG + 1]) < _CONVERGED):
                break
        lines = self._lines(values, strays)
        return Refined(
            values=values[: LAG + 1],
            cov=self._covariance(lines, strays),
            time_constant_s=float(values[SMEAR]),
            cost=self._cost(values, strays),
        )

    def _off(self, values: FloatArray, strays: FloatArray) -> FloatArray:
        return self._reports.off(values) - self._straying @ strays

    def _prior(self) -> tuple[FloatArray, FloatArray]:
        """Precision and mean of the seven."""
        return np.where(self._fixed, _FIXED, 1 / _PRIOR_STD**2), np.where(self._fixed, 0.0, _PRIOR_MEAN)

    def _weighted_steps(self, strays: FloatArray) -> FloatArray:
        """Less of those knots between which the path strays far: of a while in which water was followed."""
        squares = np.sum((self._steps @ strays).reshape(3, -1) ** 2, axis=0)
        return np.asarray(self._steps * np.tile(np.sqrt(forgiven(squares)), 3)[:, None])

    def _lines(self, values: FloatArray, strays: FloatArray) -> "_Lines":
        jac = np.zeros((*self._reports.off(values).shape, _UNKNOWNS))
        for column in np.flatnonzero(~self._fixed):
            step = _STEP[column] * (np.arange(_UNKNOWNS) == column)
            jac[..., column] = (self._reports.off(values - step) - self._reports.off(values + step)) / (
                2 * _STEP[column]
            )
        inward = self._spread.inward(self._off(values, strays), self._reports.rate_radps(values))
        white = (inward @ np.concatenate([jac, self._straying], axis=-1)).reshape(-1, _UNKNOWNS + len(strays))
        scores = white * (inward @ self._off(values, strays)[..., None]).reshape(-1, 1)
        precision, mean = self._prior()
        information, gradient = white.T @ white, np.sum(scores, axis=0)
        information[:_UNKNOWNS, :_UNKNOWNS] += np.diag(precision)
        gradient[:_UNKNOWNS] += precision * (mean - values)
        steps = self._weighted_steps(strays)
        information[_UNKNOWNS:, _UNKNOWNS:] += steps.T @ steps
        gradient[_UNKNOWNS:] -= steps.T @ (steps @ strays)
        return _Lines(cho_factor(information), gradient, np.sum(scores.reshape(*jac.shape[:2], -1), axis=1))

    def _covariance(self, lines: "_Lines", strays: FloatArray) -> FloatArray:
        """``(3, 3)``: what the model says, and what residuals say that last for a while."""
        size = _UNKNOWNS + len(strays)
        bread = np.asarray(cho_solve(lines.factor, np.eye(size)[:, :_UNKNOWNS])).T[: LAG + 1]
        by_reports = lines.scores @ bread.T
        steps = self._weighted_steps(strays)
        by_steps = -(steps * (steps @ strays)[:, None]) @ bread[:, _UNKNOWNS:].T
        times_s = np.concatenate([self._reports.video_s, np.tile(self._walk.step_s, 3)])
        spread = bread[:, : LAG + 1] + alike(times_s, np.concatenate([by_reports, by_steps]))
        return np.asarray(_BESIDE**2 * spread) + np.diag([_WHOLE_MS_STD_S**2, 0.0, _WHOLE_MS_STD_S**2])

    def _cost(self, values: FloatArray, strays: FloatArray) -> float:
        precision, mean = self._prior()
        prior = np.sum(np.where(self._fixed, 0.0, precision * (values - mean) ** 2)) / 2
        squares = np.sum((self._steps @ strays).reshape(3, -1) ** 2, axis=0)
        off = self._spread.cost(self._off(values, strays), self._reports.rate_radps(values))
        return off + float(prior + np.sum(loss(squares)))


@dataclass(frozen=True, slots=True, eq=False)
class _Lines:
    """The normal equations near some values, and each residual's part of their right side ``(n, unknowns)``."""

    factor: tuple[FloatArray, bool]
    gradient: FloatArray
    scores: FloatArray
