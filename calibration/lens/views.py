"""What one image shows of a board, and many of them as the arrays that are adjusted."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from aerodft.model.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """The corners of a board in one image.

    Attributes:
        name: The image's.
        ids: ``(n,)`` which corners, row by row from 0.
        pixels_px: ``(n, 2)`` where they are seen.
        points_m: ``(n, 3)`` where they are on the board.
        edge_px: Width over which black turns to white; a sharp image has about 2.
    """

    name: str
    ids: IntArray
    pixels_px: FloatArray
    points_m: FloatArray
    edge_px: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """The corners of ``v`` views, one view after the other.

    Attributes:
        pixels_px: ``(n, 2)``.
        points_m: ``(n, 3)``.
        starts: ``(v,)`` where each view begins.
        view: ``(n,)`` of which view each corner is.
    """

    pixels_px: FloatArray
    points_m: FloatArray
    starts: IntArray
    view: IntArray

    @classmethod
    def of(cls, views: Sequence[View]) -> Self:
        """All corners of at least one view, none of them empty."""
        counts = np.array([len(view.ids) for view in views])
        return cls(
            np.concatenate([view.pixels_px for view in views]),
            np.concatenate([view.points_m for view in views]),
            np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
            np.repeat(np.arange(len(views)), counts).astype(np.int64),
        )

    def per_view(self, values: FloatArray) -> FloatArray:
        """Sums ``(v, ...)`` of ``(n, ...)`` over each view."""
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))
