"""Levenberg and Marquardt's descent to the nearest minimum; observations that stand far off may count less."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import FloatArray
from calibration.residuals import Problem, Residuals
from calibration.state import BOUNDS, State

_MOST_STEPS: Final = 60
_DAMPING, _LEAST, _MOST = 1e-4, 1e-12, 1e10
_SETTLED: Final = 1e-10
"""Share of the cost below which a step makes no difference."""


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Where a descent ended."""

    state: State
    residuals: Residuals
    cost: float


class Loss:
    """What an observation costs whose squared residual is ``s``.

    Args:
        owner: ``(m,)`` of the rows.
        scale: Standard deviations beyond which an observation counts less and less (Cauchy's loss); None for plain
            least squares.
        kept: Whether each observation is used at all; None for all of them.
    """

    def __init__(self, owner: np.ndarray, scale: float | None = None, kept: np.ndarray | None = None) -> None:
        self._owner, self._scale, self._kept = owner, scale, kept

    def cost(self, residuals: Residuals) -> float:
        """Half of what all rows cost."""
        squares = residuals.values * residuals.values
        used = self._used()
        if self._scale is None:
            return 0.5 * float(np.sum(squares[used]))
        limit = self._scale**2
        evidence = used & (self._owner >= 0)
        by_owner = np.bincount(self._owner[evidence], squares[evidence])
        priors = float(np.sum(squares[self._owner < 0]))
        return 0.5 * (priors + limit * float(np.sum(np.log1p(by_owner / limit))))

    def weights(self, residuals: Residuals) -> FloatArray:
        """``(m,)`` weights of the rows, with which plain least squares has this loss's derivative."""
        used = self._used().astype(np.float64)
        if self._scale is None:
            return used
        squares = residuals.values * residuals.values
        evidence = self._owner >= 0
        by_owner = np.bincount(self._owner[evidence], squares[evidence])
        used[evidence] /= 1 + by_owner[self._owner[evidence]] / self._scale**2
        return used

    def _used(self) -> np.ndarray:
        if self._kept is None:
            return np.ones(len(self._owner), dtype=bool)
        return np.asarray((self._owner < 0) | self._kept[self._owner])


def descend(problem: Problem, start: State, scale: float | None = None, kept: np.ndarray | None = None) -> Descent:
    """The minimum next to ``start``.

    Args:
        problem: What to fit.
        start: Where from.
        scale: As ``Loss``.
        kept: As ``Loss``.
    """
    state, residuals = start, problem.evaluate(start)
    loss = Loss(residuals.owner, scale, kept)
    cost, damping = loss.cost(residuals), _DAMPING
    for _ in range(_MOST_STEPS):
        weights = loss.weights(residuals)
        weighted = residuals.by_unknowns * weights[:, None]
        normal, slope = weighted.T @ residuals.by_unknowns, weighted.T @ residuals.values
        found = _better(problem, loss, state, normal, slope, cost, damping)
        if found is None:
            break
        gained, (state, residuals, new_cost, damping) = cost - found[2], found
        cost = new_cost
        if gained <= _SETTLED * (cost + _SETTLED):
            break
    return Descent(state, residuals, cost)


def _better(
    problem: Problem,
    loss: Loss,
    state: State,
    normal: FloatArray,
    slope: FloatArray,
    cost: float,
    damping: float,
) -> tuple[State, Residuals, float, float] | None:
    """The next state that costs less, its residuals and cost, and the damping from there; None where there is none."""
    diagonal = np.diag(normal) + 1e-12 * (np.max(np.diag(normal), initial=0.0) + 1e-300)
    while damping < _MOST:
        step: FloatArray = np.asarray(np.linalg.solve(normal + damping * np.diag(diagonal), -slope), dtype=np.float64)
        moved = _moved(problem, state, step)
        if moved is not None:
            residuals = problem.evaluate(moved)
            new_cost = loss.cost(residuals)
            if new_cost < cost:
                return moved, residuals, new_cost, max(damping / 10, _LEAST)
            if float(np.abs(step @ slope)) <= _SETTLED * _SETTLED * (cost + _SETTLED):
                return None
        damping *= 10
    return None


def _moved(problem: Problem, state: State, step: FloatArray) -> State | None:
    """The state after a step; None where no camera can be."""
    if not np.all(np.isfinite(step)):
        return None
    try:
        moved = problem.unknowns.moved(state, step)
    except ValueError:
        return None
    return moved if all(holds(moved) for holds in BOUNDS.values()) else None
