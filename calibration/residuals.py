"""How far a guess is from the evidence: whitened residuals with analytic derivatives.

An observation that is no reprojection (a range, a length, a horizon) is a condition ``g(state, pixels) = known``. Its
residual is ``g`` less what is known, over what pixels and the known number's own std make of it to first order
(Sampson's error; Hartley and Zisserman, "Multiple View Geometry", 2nd ed., section 4.2.6).
"""

from dataclasses import dataclass

import numpy as np

from aerodft.dft.projection import INTRINSICS, POSITION, ROTATION
from aerodft.geometry.intrinsics import reproject
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import EvidenceSet, KnownLength, Landmark, SlantRange
from aerodft.model.measurement import ProjectionModel
from calibration.conditions import Condition, Distances, condition_of
from calibration.state import BOUNDS, State, Unknowns

OUT_OF_SIGHT = 1e6
"""Residual, in standard deviations, of what a guess does not see at all: behind the camera, above the horizon.

More than of anything that is seen: else the best guess would be the one that sees nothing."""

_ANGLES = ("roll", "heading")  # on a turn


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """All residuals of one guess.

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

    def normal(self, weights: FloatArray) -> "Dense":
        """The normal equations with weights ``(m,)`` of the rows."""
        weighted = self.by_unknowns * weights[:, None]
        return Dense(weighted.T @ self.by_unknowns, weighted.T @ self.values)


@dataclass(frozen=True, slots=True, eq=False)
class Dense:
    """Normal equations of few unknowns.

    Attributes:
        matrix: ``(n, n)``.
        slope: ``(n,)``.
    """

    matrix: FloatArray
    slope: FloatArray

    def step(self, damping: float) -> FloatArray:
        """As ``descent.Normal``; what nothing depends on stays."""
        diagonal = np.diag(self.matrix)
        diagonal = diagonal + 1e-12 * (np.max(diagonal, initial=0.0) + 1e-300)
        return np.asarray(np.linalg.solve(self.matrix + damping * np.diag(diagonal), -self.slope))


class Problem:
    """Evidence and unknowns, ready to be evaluated again and again.

    Args:
        known: What is known.
        unknowns: What is not.
        model: Projection model.

    Attributes:
        reprojected: ``(k,)`` indices of the observations that are landmarks known in all three dimensions.
    """

    def __init__(self, known: EvidenceSet, unknowns: Unknowns, model: ProjectionModel) -> None:
        self.known = known
        self.unknowns = unknowns
        reprojected = {
            index: each
            for index, each in enumerate(known.evidence)
            if model is ProjectionModel.PINHOLE and isinstance(each, Landmark) and None not in each.position_m
        }
        self.reprojected, points = np.array(list(reprojected), dtype=np.intp), reprojected.values()
        self._owner = np.repeat(self.reprojected, 2)
        self._points_m = np.array([each.position_m for each in points], dtype=np.float64).reshape(-1, 3)
        self._pixels = np.array([each.pixel for each in points], dtype=np.float64).reshape(-1, 2)
        self._std_px = np.array([each.std_px for each in points], dtype=np.float64)
        std_m = np.array([each.std_m for each in points], dtype=np.float64).reshape(-1, 3)
        self._point_cov = np.square(std_m)[:, None] * np.eye(3) if np.any(std_m) else None
        ranges = {index: each for index, each in enumerate(known.evidence) if isinstance(each, SlantRange)}
        lengths = {index: each for index, each in enumerate(known.evidence) if isinstance(each, KnownLength)}
        self._together = [Distances(each) for each in (ranges, lengths) if each]
        self._conditions: list[tuple[int, Condition]] = [
            (index, condition_of(each))
            for index, each in enumerate(known.evidence)
            if index not in reprojected and index not in ranges and index not in lengths
        ]
        self._priors = [(name, known.priors[name]) for name in unknowns.names if name in known.priors]

    @property
    def landmarks(self) -> tuple[FloatArray, FloatArray]:
        """World points ``(k, 3)`` and pixels ``(k, 2)`` of what is ``reprojected``."""
        return self._points_m, self._pixels

    def evaluate(self, state: State) -> Residuals:
        """All residuals of a guess."""
        found = self.observed(state, self.unknowns.by_unknowns(state))
        parts = [] if found is None else [found]
        parts += [self._of_priors(state)] if self._priors else []
        return _joined(parts)

    def moved(self, state: State, step: FloatArray) -> State | None:
        """The guess after a step ``(n,)``; None where no camera can be."""
        try:
            moved = self.unknowns.moved(state, step)
        except ValueError:
            return None
        return moved if all(holds(moved) for holds in BOUNDS.values()) else None

    def observed(self, state: State, by: FloatArray) -> Residuals | None:
        """The evidence's residuals alone, None without evidence; derivatives by what moves a camera ``(s, n)``."""
        parts = [self._of_landmarks(state, by)] if len(self.reprojected) else []
        parts += [_of_many(each, state, by) for each in self._together]
        parts += [_of_condition(index, condition, state, by) for index, condition in self._conditions]
        return _joined(parts) if parts else None

    def _of_landmarks(self, state: State, by: FloatArray) -> Residuals:
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            found = reproject(state.camera, state.position_m, state.rotation, self._points_m)
            off = found.pixels_px - self._pixels
            jac = _times(found.by_rotation, by[ROTATION]) - _times(found.by_point, by[POSITION])
            if np.any(by[INTRINSICS]):
                jac += _times(found.by_intrinsics, by[INTRINSICS])
        std = self._std_px[:, None]
        values, rows = off / std, jac / std[..., None]
        if self._point_cov is not None:
            cov = found.by_point @ self._point_cov @ found.by_point.swapaxes(-1, -2)
            cov += np.square(self._std_px)[:, None, None] * np.eye(2)
            root = _whitening(np.where(np.all(np.isfinite(cov), axis=(-1, -2), keepdims=True), cov, np.eye(2)))
            values, rows = (root @ off[..., None])[..., 0], root @ jac
        px, blind = off.ravel(), np.isnan(off[:, 0])
        if np.any(blind):
            values[blind], rows[blind] = OUT_OF_SIGHT, 0.0
            px = np.where(np.isnan(px), np.inf, px)
        return Residuals(values.ravel(), rows.reshape(len(px), -1), self._owner, px)

    def _of_priors(self, state: State) -> Residuals:
        to_angles = self.unknowns.to_angles(state)
        values, rows = [], []
        for name, prior in self._priors:
            off = state.value(name) - prior.value
            if name in _ANGLES:
                off = (off + np.pi) % (2 * np.pi) - np.pi
            values.append(off / prior.std)
            rows.append(to_angles[self.unknowns.names.index(name)] / prior.std)
        count = len(values)
        return Residuals(np.array(values), np.array(rows), np.full(count, -1), np.zeros(count))


def _times(many: FloatArray, by: FloatArray) -> FloatArray:
    """``(k, 2, i)`` times ``(i, n)``, as one large product."""
    return np.asarray((many.reshape(-1, len(by)) @ by).reshape(*many.shape[:-1], -1))


def _joined(parts: list[Residuals]) -> Residuals:
    if len(parts) == 1:
        return parts[0]
    return Residuals(
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.by_unknowns for part in parts]),
        np.concatenate([part.owner for part in parts]),
        np.concatenate([part.px for part in parts]),
    )


def _of_many(many: Distances, state: State, by: FloatArray) -> Residuals:
    off_m, by_shared, variance = many.found(state)
    std_m = np.sqrt(variance * (1 + 1e-12))
    values, by_shared = off_m / std_m, by_shared / std_m[:, None]
    px = many.std_px * values
    blind = ~(np.isfinite(values) & np.all(np.isfinite(by_shared), axis=-1))
    if np.any(blind):
        by_shared[blind], values[blind], px[blind] = 0.0, OUT_OF_SIGHT, np.inf
    return Residuals(values, by_shared @ by, many.owner, px)


def _of_condition(index: int, condition: Condition, state: State, by: FloatArray) -> Residuals:
    found = condition(state)
    count = len(found.off)
    blind = not np.all(np.isfinite(found.off)) or not np.all(np.isfinite(found.by_shared))
    owner = np.full(count, index)
    if blind:
        nothing = np.zeros((count, by.shape[1]))
        return Residuals(np.full(count, OUT_OF_SIGHT), nothing, owner, np.full(count, np.inf))
    root = _whitening(found.cov)
    values = root @ found.off
    return Residuals(values, root @ found.by_shared @ by, owner, found.std_px * values)


def _whitening(cov: FloatArray) -> FloatArray:
    """``(..., k, k)`` that makes residuals of that covariance independent and of variance 1.

    One direction may be billions of times as uncertain as another (a ray along the ground, a landmark right before the
    lens): rounding alone would make such a matrix singular.
    """
    if cov.shape == (1, 1) and cov[0, 0] > 0:
        return np.asarray(1.0 / np.sqrt(cov + 1e-12 * cov))
    size = np.trace(cov, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(np.linalg.inv(np.linalg.cholesky(cov + 1e-12 * size * np.eye(cov.shape[-1]))))
