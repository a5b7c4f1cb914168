"""Levenberg-Marquardt descent to the nearest minimum, optionally with Cauchy's robust loss."""

from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

import numpy as np

from aerodft.model import Batch, FloatArray

_MAX_STEPS: Final = 60
_DAMPING, _MIN_DAMPING, _MAX_DAMPING = 1e-4, 1e-12, 1e10
_MIN_EIGENVALUE = 1e-13  # beside a largest eigenvalue of about 1
_CONVERGED, _CONVERGED_ROBUST, _ROUNDING = 1e-10, 1e-6, 1e-14
"""Relative decreases of the cost: converged; converged with a robust loss, before a further descent; rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Arrow-shaped normal equations at a state: unknowns shared by all images, and unknowns of each image.

    Attributes:
        matrix: ``(s, s)`` of residuals that depend on the shared unknowns alone.
        shared_slope: ``(s,)`` gradient of the cost of these residuals.
        blocks: ``(n, s + k, s + k)`` of each image, by shared unknowns and then its own.
        slopes: ``(n, s + k)`` gradients of the cost of each image.
    """

    matrix: FloatArray
    shared_slope: FloatArray
    blocks: FloatArray
    slopes: FloatArray

    @property
    def slope(self) -> FloatArray:
        """Gradient ``(s + n k,)`` of the cost."""
        count = len(self.shared_slope)
        shared = self.shared_slope + self.slopes[:, :count].sum(axis=0)
        return np.append(shared, self.slopes[:, count:].ravel())

    def step(self, damping: float) -> FloatArray:
        """Step ``(s + n k,)`` that solves the equations with the diagonal increased by ``damping`` times itself.

        Unknowns without an effect keep their values.
        """
        count = len(self.shared_slope)
        shared = self.matrix + self.blocks[:, :count, :count].sum(axis=0)
        diagonal = np.diag(shared) + 1e-12 * (np.max(np.diag(shared), initial=0.0) + 1e-300)
        blocks = self.blocks.copy()
        image_columns = np.arange(count, blocks.shape[-1])
        blocks[:, image_columns, image_columns] *= 1 + damping
        reduced_blocks, reduced_slopes = eliminate_image_unknowns(blocks, self.slopes, count)
        matrix = self.matrix + reduced_blocks.sum(axis=0) + damping * np.diag(diagonal)
        shared_step = np.asarray(np.linalg.solve(matrix, -self.shared_slope - reduced_slopes.sum(axis=0)))
        return np.append(shared_step, image_steps(blocks, self.slopes, shared_step).ravel())

    def reduced(self) -> FloatArray:
        """Schur complement ``(s, s)``: information on the shared unknowns with all others eliminated."""
        count = len(self.shared_slope)
        return np.asarray(self.matrix + eliminate_image_unknowns(self.blocks, self.slopes, count)[0].sum(axis=0))


def covariance_of(normal: FloatArray) -> FloatArray:
    """Inverse of a normal matrix; infinite if it is numerically singular."""
    size = np.sqrt(np.diag(normal))
    if not np.all(size > 0):
        return np.full_like(normal, np.inf)
    scaled = normal / np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] < _MIN_EIGENVALUE:
        return np.full_like(normal, np.inf)
    return np.asarray(np.linalg.inv(scaled) / np.outer(size, size))


def eliminate_image_unknowns(blocks: FloatArray, slopes: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Schur complements ``(n, count, count)`` and slopes ``(n, count)`` with each image's own unknowns eliminated.

    Args:
        blocks: ``(n, s + k, s + k)``.
        slopes: ``(n, s + k)``.
        count: ``s``.
    """
    coupling = blocks[:, :count, count:]
    solved = np.linalg.solve(
        blocks[:, count:, count:], np.concatenate([blocks[:, count:, :count], slopes[:, count:, None]], axis=-1)
    )
    by_own = coupling @ solved
    return blocks[:, :count, :count] - by_own[..., :count], slopes[:, :count] - by_own[..., count]


def image_steps(blocks: FloatArray, slopes: FloatArray, shared: FloatArray) -> FloatArray:
    """Steps ``(n, k)`` of the images' own unknowns for a step ``(s,)`` of the shared ones."""
    count = len(shared)
    slope = slopes[:, count:] + blocks[:, count:, :count] @ shared
    return np.asarray(-np.linalg.solve(blocks[:, count:, count:], slope[..., None])[..., 0])


@dataclass(frozen=True, slots=True, eq=False)
class Residuals(Batch):
    """Residuals and their Jacobian at a state: by ``s`` unknowns shared by all images, and by ``k`` of the row's image.

    Attributes:
        values: ``(m,)`` in standard deviations.
        jac_unknowns: ``(m, s + k)``.
        owner: ``(m,)`` index of the observation that a row belongs to; -1 for priors.
        px: ``(m,)`` in pixels; 0 for priors.
        log_std: ``(m,)`` logarithm of the standard deviation that a row was divided by, over that of its pixels alone:
            0 where both are equal. Minus the log likelihood is half the squares plus these.
        images: Rows of each image; behind them those that depend on shared unknowns alone, all of them without images.
        own: ``k``.
    """

    values: FloatArray
    jac_unknowns: FloatArray
    owner: np.ndarray
    px: FloatArray
    log_std: FloatArray
    images: tuple[slice, ...] = ()
    own: int = 0

    def normal(self, weights: FloatArray) -> NormalEquations:
        """Normal equations with weights ``(m,)`` of the rows."""
        by, size = self.jac_unknowns, self.jac_unknowns.shape[1]
        weighted, count = by * weights[:, None], size - self.own
        shared = slice(self.images[-1].stop if self.images else 0, None)
        return NormalEquations(
            weighted[shared, :count].T @ by[shared, :count],
            weighted[shared, :count].T @ self.values[shared],
            np.reshape([weighted[rows].T @ by[rows] for rows in self.images], (-1, size, size)),
            np.reshape([weighted[rows].T @ self.values[rows] for rows in self.images], (-1, size)),
        )


StateT = TypeVar("StateT")


class LeastSquares(Protocol[StateT]):
    """A least-squares problem."""

    def evaluate(self, state: StateT) -> Residuals:
        """All residuals at a state."""
        ...

    def moved(self, state: StateT, step: FloatArray) -> StateT | None:
        """The state after a step ``(n,)``; None where no camera can be."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class LocalMinimum(Generic[StateT]):
    """A local minimum of the loss: its state, its residuals, and half of the summed loss."""

    state: StateT
    residuals: Residuals
    cost: float


def used_rows(owner: np.ndarray, kept: np.ndarray | None) -> np.ndarray:
    """Whether each row ``(m,)`` is used: priors, and observations that are kept ``(k,)``; None keeps all."""
    return np.ones(len(owner), dtype=bool) if kept is None else np.asarray((owner < 0) | kept[owner])


class Loss:
    """Loss of the residuals: plain or robust (Cauchy) least squares.

    Args:
        owner: ``(m,)`` of the rows.
        scale: Scale of Cauchy's loss in standard deviations; None for plain least squares.
        kept: Whether each observation is used; None for all.
    """

    def __init__(self, owner: np.ndarray, scale: float | None = None, kept: np.ndarray | None = None) -> None:
        self._scale = scale
        self._used: FloatArray = used_rows(owner, kept).astype(np.float64)
        self._priors, self._evidence_rows = np.flatnonzero(owner < 0), np.flatnonzero(owner >= 0)
        self._owner = owner[self._evidence_rows]

    def cost(self, residuals: Residuals) -> float:
        """Half of the summed loss of all rows."""
        squares = self._used * (residuals.values * residuals.values)
        if self._scale is None:
            return 0.5 * float(np.sum(squares))
        limit = self._scale**2
        by_owner = np.bincount(self._owner, squares[self._evidence_rows])
        priors = float(np.sum(squares[self._priors]))
        return 0.5 * (priors + limit * float(np.sum(np.log1p(by_owner / limit))))

    def weights(self, residuals: Residuals) -> FloatArray:
        """Weights ``(m,)`` of the rows, with which plain least squares has this loss's gradient."""
        if self._scale is None:
            return self._used
        values = residuals.values[self._evidence_rows]
        by_owner = np.bincount(self._owner, values * values)
        weights = self._used.copy()
        weights[self._evidence_rows] /= 1 + by_owner[self._owner] / self._scale**2
        return weights


def descend(
    problem: LeastSquares[StateT],
    start: StateT,
    scale: float | None = None,
    kept: np.ndarray | None = None,
    known: Residuals | None = None,
) -> LocalMinimum[StateT]:
    """Descend from ``start`` to the nearest minimum.

    Args:
        problem: The problem.
        start: First state.
        scale: Scale of the robust loss, see ``Loss``; None for plain squares.
        kept: ``(k,)`` whether each observation is used; None for all.
        known: Residuals at ``start`` if already evaluated.
    """
    state, residuals = start, problem.evaluate(start) if known is None else known
    loss = Loss(residuals.owner, scale, kept)
    cost, damping = loss.cost(residuals), _DAMPING
    tolerance = _CONVERGED if scale is None else _CONVERGED_ROBUST
    for _ in range(_MAX_STEPS):
        better = _next_state(problem, loss, state, residuals.normal(loss.weights(residuals)), cost, damping)
        if better is None:
            break
        decrease, (state, residuals, new_cost, damping) = cost - better[2], better
        cost = new_cost
        if decrease <= tolerance * (cost + _CONVERGED):
            break
    return LocalMinimum(state, residuals, cost)


def _next_state(
    problem: LeastSquares[StateT], loss: Loss, state: StateT, normal: NormalEquations, cost: float, damping: float
) -> tuple[StateT, Residuals, float, float] | None:
    """The next state of smaller cost, its residuals, cost and damping; None if there is none."""
    while damping < _MAX_DAMPING:
        step = normal.step(damping)
        moved = problem.moved(state, step) if np.all(np.isfinite(step)) else None
        if moved is not None:
            residuals = problem.evaluate(moved)
            new_cost = loss.cost(residuals)
            if new_cost < cost:
                return moved, residuals, new_cost, max(damping / 10, _MIN_DAMPING)
            if float(np.abs(step @ normal.slope)) <= _ROUNDING * (cost + _CONVERGED):
                return None
        damping *= 10
    return None
