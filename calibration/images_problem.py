"""How far a guess is from what many images of one camera show, and from what telemetry says of each.

What the images share is coupled by all of them, what is new in each by itself alone: that is eliminated from the normal
equations (Schur's complement), so that the number of images costs time in proportion only.
"""

from dataclasses import dataclass

import numpy as np

from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import Evidence, EvidenceSet, Prior
from aerodft.model.measurement import ProjectionModel
from calibration.images_state import OWN, ImagesState, SharedUnknowns, View
from calibration.residuals import Problem
from calibration.state import BOUNDS, State, Unknowns


@dataclass(frozen=True, slots=True, eq=False)
class Arrow:
    """Normal equations, arrow-shaped.

    Attributes:
        matrix: ``(s, s)`` of what says something of the shared unknowns alone.
        shared_slope: ``(s,)`` of the same.
        blocks: ``(n, s + k, s + k)`` of each image, by shared unknowns and then its own.
        slopes: ``(n, s + k)`` likewise.
    """

    matrix: FloatArray
    shared_slope: FloatArray
    blocks: FloatArray
    slopes: FloatArray

    @property
    def slope(self) -> FloatArray:
        """``(s + n k,)``."""
        count = len(self.shared_slope)
        shared = self.shared_slope + self.slopes[:, :count].sum(axis=0)
        return np.append(shared, self.slopes[:, count:].ravel())

    def step(self, damping: float) -> FloatArray:
        """As ``descent.Normal``; what nothing depends on stays."""
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
    known = np.linalg.solve(
        blocks[:, count:, count:], np.concatenate([blocks[:, count:, :count], slopes[:, count:, None]], axis=-1)
    )
    taken = across @ known
    return blocks[:, :count, :count] - taken[..., :count], slopes[:, :count] - taken[..., count]


def own_steps(blocks: FloatArray, slopes: FloatArray, shared: FloatArray) -> FloatArray:
    """Steps ``(n, k)`` of the images' own unknowns that go with one ``(s,)`` of the shared ones."""
    count = len(shared)
    pull = slopes[:, count:] + blocks[:, count:, :count] @ shared
    return np.asarray(-np.linalg.solve(blocks[:, count:, count:], pull[..., None])[..., 0])


@dataclass(frozen=True, slots=True, eq=False)
class ImagesResiduals:
    """All residuals of one guess.

    Attributes:
        values: ``(m,)`` in standard deviations.
        by: ``(m, s + 7)`` by the shared unknowns, and by what is new in the row's image.
        owner: ``(m,)`` index of the observation that a row belongs to; -1 for priors.
        px: ``(m,)`` in pixels; 0 for priors.
        rows: Of each image; what comes after the last image's are priors of the shared unknowns.
    """

    values: FloatArray
    by: FloatArray
    owner: np.ndarray
    px: FloatArray
    rows: tuple[slice, ...]

    def normal(self, weights: FloatArray) -> Arrow:
        """The normal equations with weights ``(m,)`` of the rows."""
        weighted = self.by * weights[:, None]
        count = self.by.shape[1] - OWN
        shared = slice(self.rows[-1].stop, None)
        return Arrow(
            weighted[shared, :count].T @ self.by[shared, :count],
            weighted[shared, :count].T @ self.values[shared],
            np.stack([weighted[rows].T @ self.by[rows] for rows in self.rows]),
            np.stack([weighted[rows].T @ self.values[rows] for rows in self.rows]),
        )


class ImagesProblem:
    """Images and unknowns, ready to be evaluated again and again.

    Args:
        views: The images.
        unknowns: What is not known, and the same in all of them.
        priors: Of these, by name.
        model: Projection model.
    """

    def __init__(
        self, views: tuple[View, ...], unknowns: SharedUnknowns, priors: dict[str, Prior], model: ProjectionModel
    ) -> None:
        self.views = views
        self.unknowns = unknowns
        self.priors = {name: priors[name] for name in unknowns.names if name in priors}
        self._problems = [Problem(EvidenceSet(evidence=view.evidence), Unknowns(()), model) for view in views]
        self._firsts = np.cumsum([0, *(len(view.evidence) for view in views)]).tolist()

    @property
    def evidence(self) -> tuple[Evidence, ...]:
        """Of all images, one image after the other."""
        return tuple(each for view in self.views for each in view.evidence)

    @property
    def image_of(self) -> tuple[int, ...]:
        """Index of the image that each piece of evidence is from."""
        return tuple(index for index, view in enumerate(self.views) for _ in view.evidence)

    @property
    def count(self) -> int:
        """How many numbers are fitted."""
        return len(self.unknowns.names) + OWN * len(self.views)

    def cameras(self, state: ImagesState) -> tuple[State, ...]:
        """The camera of each image."""
        return tuple(self.unknowns.camera(state, index, view) for index, view in enumerate(self.views))

    def moved(self, state: ImagesState, step: FloatArray) -> ImagesState | None:
        """The guess after a step; None where no camera can be, and where telemetry does not reach."""
        try:
            moved = self.unknowns.moved(state, step)
            cameras = self.cameras(moved)
        except ValueError:
            return None
        return moved if all(holds(camera) for camera in cameras for holds in BOUNDS.values()) else None

    def evaluate(self, state: ImagesState) -> ImagesResiduals:
        """All residuals of a guess."""
        parts = [self._of_image(state, index) for index in range(len(self.views))]
        ends = np.cumsum([0, *(len(values) for values, *_ in parts)]).tolist()
        parts.append(self._of_priors(state))
        values, by, owner, px = (np.concatenate(column) for column in zip(*parts, strict=True))
        return ImagesResiduals(values, by, owner, px, tuple(map(slice, ends[:-1], ends[1:])))

    def _of_image(self, state: ImagesState, index: int) -> tuple[FloatArray, FloatArray, np.ndarray, FloatArray]:
        """Of the observations, and of what is new in the image; as the fields of ``ImagesResiduals``."""
        placed = self.unknowns.placed(state, index, self.views[index])
        own = np.eye(OWN, placed.by.shape[1], placed.by.shape[1] - OWN)
        nobody, nowhere = np.full(OWN, -1), np.zeros(OWN)
        found = self._problems[index].observed(placed.state, placed.by)
        if found is None:
            return state.own[index], own, nobody, nowhere
        return (
            np.append(found.values, state.own[index]),
            np.vstack([found.by_unknowns, own]),
            np.append(found.owner + self._firsts[index], nobody),
            np.append(found.px, nowhere),
        )

    def _of_priors(self, state: ImagesState) -> tuple[FloatArray, FloatArray, np.ndarray, FloatArray]:
        names, count = self.unknowns.names, len(self.priors)
        values = np.array([(state.value(name) - prior.value) / prior.std for name, prior in self.priors.items()])
        by = np.zeros((count, len(names) + OWN))
        for row, (name, prior) in enumerate(self.priors.items()):
            by[row, names.index(name)] = 1 / prior.std
        return values, by, np.full(count, -1), np.zeros(count)
