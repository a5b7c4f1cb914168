"""Normal equations of many images: what they share is coupled by all of them, what is new in each by itself alone.

The unknowns of the images are eliminated (Schur's complement), so that their number costs time in proportion only.
"""

from dataclasses import dataclass

import numpy as np

from aerodft.model.arrays import FloatArray


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
