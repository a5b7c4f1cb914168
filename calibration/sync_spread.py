"""How residuals of reports spread: by noise, the faster the camera turns the more, and alike for a while."""

from dataclasses import dataclass

import numpy as np

from aerodft.model.arrays import FloatArray

_STUDENT = 4.0  # degrees of freedom of the t distribution
_JITTERS_S = (0.0005, 0.001, 0.002, 0.004, 0.008)  # more would explain any other way of following
_ROUNDS = 8
_PATH_STD_RAD = 3e-4  # between its images
_CORRELATED_S = 3.0  # residuals farther apart in time have nothing to do with each other
_BIN_S = 0.25
_FIXED_SHARE = np.array([-0.5324, 0.4160, 2.9694, 1.9600]) / 1.96  # of the whole: their critical values, at 95 %


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
