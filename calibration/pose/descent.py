"""Levenberg and Marquardt's descent to the nearest minimum; observations that stand far off may count less."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

import numpy as np

from aerodft.model import FloatArray

_MAX_STEPS: Final = 60
_DAMPING, _MIN_DAMPING, _MAX_DAMPING = 1e-4, 1e-12, 1e10
_SETTLED, _NEARLY, _ROUNDING = 1e-10, 1e-6, 1e-14
"""Shares of the cost: below which a step makes no difference, or none where observations that stand far off count less
(what follows goes on from there), and below which numbers cannot tell."""


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Normal equations of a guess, arrow-shaped: of unknowns that all images share, and of those of each image.

    Attributes:
        matrix: ``(s, s)`` of what says something of the shared unknowns alone.
        shared_slope: ``(s,)`` gradient of their cost.
        blocks: ``(n, s + k, s + k)`` of each image, by shared unknowns and then its own.
        slopes: ``(n, s + k)`` gradients of the cost of each image.
    """

    matrix: FloatArray
    shared_slope: FloatArray
    blocks: FloatArray
    slopes: FloatArray

    @property
    def slope(self) -> FloatArray:
        """``(s + n k,)`` of the cost."""
        count = len(self.shared_slope)
        shared = self.shared_slope + self.slopes[:, :count].sum(axis=0)
        return np.append(shared, self.slopes[:, count:].ravel())

    def step(self, damping: float) -> FloatArray:
        """``(s + n k,)`` to their solution, with so much more on their diagonal, as a share of it.

        What nothing depends on stays.
        """
        count = len(self.shared_slope)
        shared = self.matrix + self.blocks[:, :count, :count].sum(axis=0)
        diagonal = np.diag(shared) + 1e-12 * (np.max(np.diag(shared), initial=0.0) + 1e-300)
        blocks = self.blocks.copy()
        own = np.arange(count, blocks.shape[-1])
        blocks[:, own, own] *= 1 + damping
        known, pulled = eliminated(blocks, self.slopes, count)
        matrix = self.matrix + known.sum(axis=0) + damping * np.diag(diagonal)
        moved = np.asarray(np.linalg.solve(matrix, -self.shared_slope - pulled.sum(axis=0)))
        return np.append(moved, own_steps(blocks, self.slopes, moved).ravel())

    def reduced(self) -> FloatArray:
        """``(s, s)``: what is known of the shared unknowns, whatever the others are."""
        count = len(self.shared_slope)
        return np.asarray(self.matrix + eliminated(self.blocks, self.slopes, count)[0].sum(axis=0))


def eliminated(blocks: FloatArray, slopes: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """What images say of the first ``count`` unknowns: matrices ``(n, count, count)`` and slopes ``(n, count)``.

    Args:
        blocks: ``(n, s + k, s + k)``.
        slopes: ``(n, s + k)``.
        count: ``s``.
    """
    across = blocks[:, :count, count:]
    solved = np.linalg.solve(
        blocks[:, count:, count:], np.concatenate([blocks[:, count:, :count], slopes[:, count:, None]], axis=-1)
    )
    by_own = across @ solved
    return blocks[:, :count, :count] - by_own[..., :count], slopes[:, :count] - by_own[..., count]


def own_steps(blocks: FloatArray, slopes: FloatArray, shared: FloatArray) -> FloatArray:
    """Steps ``(n, k)`` of the images' own unknowns that go with one ``(s,)`` of the shared ones."""
    count = len(shared)
    pull = slopes[:, count:] + blocks[:, count:, :count] @ shared
    return np.asarray(-np.linalg.solve(blocks[:, count:, count:], pull[..., None])[..., 0])


@dataclass(frozen=True, slots=True, eq=False)
class Rows(ABC):
    """Residuals of a guess.

    Attributes:
        values: ``(m,)`` in standard deviations.
        by_unknowns: ``(m, n)``.
        owner: ``(m,)`` index of the observation that a row belongs to; -1 for priors.
        px: ``(m,)`` in pixels; 0 for priors.
    """

    values: FloatArray
    by_unknowns: FloatArray
    owner: np.ndarray
    px: FloatArray

    @abstractmethod
    def normal(self, weights: FloatArray) -> NormalEquations:
        """The normal equations with weights ``(m,)`` of the rows."""


StateT = TypeVar("StateT")
RowsT_co = TypeVar("RowsT_co", bound=Rows, covariant=True)


class Task(Protocol[StateT, RowsT_co]):
    """What can be fitted."""

    def evaluate(self, state: StateT) -> RowsT_co:
        """All residuals of a guess."""
        ...

    def moved(self, state: StateT, step: FloatArray) -> StateT | None:
        """The guess after a step ``(n,)``; None where no camera can be."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Descent(Generic[StateT, RowsT_co]):
    """Where a descent ended."""

    state: StateT
    residuals: RowsT_co
    cost: float


def used_rows(owner: np.ndarray, kept: np.ndarray | None) -> np.ndarray:
    """``(m,)`` whether a row counts: priors, and observations that are kept ``(k,)``; None for all of them."""
    return np.ones(len(owner), dtype=bool) if kept is None else np.asarray((owner < 0) | kept[owner])


class Loss:
    """What an observation costs whose squared residual is ``s``.

    Args:
        owner: ``(m,)`` of the rows.
        scale: Standard deviations beyond which an observation counts less and less (Cauchy's loss); None for plain
            least squares.
        kept: Whether each observation is used at all; None for all of them.
    """

    def __init__(self, owner: np.ndarray, scale: float | None = None, kept: np.ndarray | None = None) -> None:
        self._scale = scale
        self._used: FloatArray = used_rows(owner, kept).astype(np.float64)
        self._priors, self._seen = np.flatnonzero(owner < 0), np.flatnonzero(owner >= 0)
        self._owner = owner[self._seen]

    def cost(self, residuals: Rows) -> float:
        """Half of what all rows cost."""
        squares = self._used * (residuals.values * residuals.values)
        if self._scale is None:
            return 0.5 * float(np.sum(squares))
        limit = self._scale**2
        by_owner = np.bincount(self._owner, squares[self._seen])
        priors = float(np.sum(squares[self._priors]))
        return 0.5 * (priors + limit * float(np.sum(np.log1p(by_owner / limit))))

    def weights(self, residuals: Rows) -> FloatArray:
        """``(m,)`` weights of the rows, with which plain least squares has this loss's derivative."""
        if self._scale is None:
            return self._used
        values = residuals.values[self._seen]
        by_owner = np.bincount(self._owner, values * values)
        weights = self._used.copy()
        weights[self._seen] /= 1 + by_owner[self._owner] / self._scale**2
        return weights


def descend(
    problem: Task[StateT, RowsT_co],
    start: StateT,
    scale: float | None = None,
    kept: np.ndarray | None = None,
    known: RowsT_co | None = None,
) -> Descent[StateT, RowsT_co]:
    """The minimum next to ``start``.

    Args:
        problem: What to fit.
        start: Where from.
        scale: Standard deviations beyond which an observation counts less, see ``Loss``; None for plain squares.
        kept: ``(k,)`` which observations count; None for all.
        known: Residuals of ``start``, where somebody has them.
    """
    state, residuals = start, problem.evaluate(start) if known is None else known
    loss = Loss(residuals.owner, scale, kept)
    cost, damping = loss.cost(residuals), _DAMPING
    settled = _SETTLED if scale is None else _NEARLY
    for _ in range(_MAX_STEPS):
        found = _better(problem, loss, state, residuals.normal(loss.weights(residuals)), cost, damping)
        if found is None:
            break
        gained, (state, residuals, new_cost, damping) = cost - found[2], found
        cost = new_cost
        if gained <= settled * (cost + _SETTLED):
            break
    return Descent(state, residuals, cost)


def _better(
    problem: Task[StateT, RowsT_co], loss: Loss, state: StateT, normal: NormalEquations, cost: float, damping: float
) -> tuple[StateT, RowsT_co, float, float] | None:
    """The next state that costs less, its residuals and cost, and the damping from there; None where there is none."""
    while damping < _MAX_DAMPING:
        step = normal.step(damping)
        moved = problem.moved(state, step) if np.all(np.isfinite(step)) else None
        if moved is not None:
            residuals = problem.evaluate(moved)
            new_cost = loss.cost(residuals)
            if new_cost < cost:
                return moved, residuals, new_cost, max(damping / 10, _MIN_DAMPING)
            if float(np.abs(step @ normal.slope)) <= _ROUNDING * (cost + _SETTLED):
                return None
        damping *= 10
    return None
