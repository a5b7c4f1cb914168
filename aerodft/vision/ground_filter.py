"""Where an object on the ground is, and how fast: a Kalman filter with constant velocity, in metres.

The state is east, north, and their rates. Velocity changes as white noise of a given power, so that what is not seen
becomes uncertain as the time to the power of 3/2.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.uncertainty import CHI2_2D_95
from aerodft.model.arrays import FloatArray

GATE: Final = 13.815510557964274
"""99.9 % quantile of chi-square with two degrees of freedom: what is farther off is another object."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundState:
    """One object's state, with the errors that are its own: none of the camera's.

    Attributes:
        mean: ``(4,)`` east, north (m), rates (m/s).
        cov: ``(4, 4)``.
    """

    mean: FloatArray
    cov: FloatArray

    @property
    def place_en_m(self) -> FloatArray:
        """``(2,)``."""
        return self.mean[:2]

    @property
    def velocity_en_mps(self) -> FloatArray:
        """``(2,)``."""
        return self.mean[2:]


def begun(place_en_m: FloatArray, cov_m2: FloatArray, speed_mps: float) -> GroundState:
    """The state after the first sight.

    Args:
        place_en_m: ``(2,)``.
        cov_m2: ``(2, 2)``.
        speed_mps: Standard deviation of each rate.
    """
    cov = np.zeros((4, 4))
    cov[:2, :2], cov[2, 2], cov[3, 3] = cov_m2, speed_mps**2, speed_mps**2
    return GroundState(np.array([*place_en_m, 0.0, 0.0]), cov)


def predicted(state: GroundState, elapsed_s: float, acceleration_mps2: float) -> GroundState:
    """The state some time later.

    Args:
        state: The last one.
        elapsed_s: 0 or more.
        acceleration_mps2: What a rate has changed by after a second, a standard deviation.
    """
    if elapsed_s <= 0:
        return state
    on = np.eye(4)
    on[0, 2] = on[1, 3] = elapsed_s
    power = acceleration_mps2**2
    noise = np.array([[elapsed_s**3 / 3, elapsed_s**2 / 2], [elapsed_s**2 / 2, elapsed_s]]) * power
    return GroundState(on @ state.mean, on @ state.cov @ on.T + np.kron(noise, np.eye(2)))


def distance2(state: GroundState, place_en_m: FloatArray, cov_m2: FloatArray) -> float:
    """Squared Mahalanobis distance of a sight ``(2,)`` with covariance ``(2, 2)``."""
    off = place_en_m - state.place_en_m
    return float(off @ np.linalg.solve(state.cov[:2, :2] + cov_m2, off))


def updated(state: GroundState, place_en_m: FloatArray, cov_m2: FloatArray) -> GroundState:
    """The state with a sight ``(2,)`` of covariance ``(2, 2)``; Joseph's form, whose covariance stays one.

    What is farther off than 95 of 100 are counts less, as much as makes it one of these: outlines have fringes.
    """
    excess = distance2(state, place_en_m, cov_m2) / CHI2_2D_95
    if excess > 1:
        cov_m2 = cov_m2 + (excess - 1) * (state.cov[:2, :2] + cov_m2)
    spread = state.cov[:2, :2] + cov_m2
    gain = np.linalg.solve(spread, state.cov[:2]).T
    keep = np.eye(4)
    keep[:, :2] -= gain
    mean = state.mean + gain @ (place_en_m - state.place_en_m)
    return GroundState(mean, keep @ state.cov @ keep.T + gain @ cov_m2 @ gain.T)
