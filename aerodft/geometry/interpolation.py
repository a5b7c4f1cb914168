"""Interpolation between samples: never across a gap, never outside the samples."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from aerodft.model import BoolArray, FloatArray, IntArray

_Number = TypeVar("_Number", np.float64, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Brackets:
    """The two samples around each of ``n`` stamps; rows are undefined where ``is_known`` is false.

    Attributes:
        before: ``(n,)`` indices of the samples that are not after the stamps.
        after: ``(n,)`` indices of those that are not before them.
        weight: ``(n,)`` of the later one.
        gap_ns: ``(n,)`` between the two.
        is_known: ``(n,)`` whether both exist, no farther apart than the longest gap.
    """

    before: IntArray
    after: IntArray
    weight: FloatArray
    gap_ns: IntArray
    is_known: BoolArray

    def rows(self, rows: IntArray) -> "Brackets":
        """The brackets of stamps ``(k,)`` by their indices."""
        return Brackets(self.before[rows], self.after[rows], self.weight[rows], self.gap_ns[rows], self.is_known[rows])

    def ends(self, values: npt.NDArray[_Number]) -> tuple[npt.NDArray[_Number], npt.NDArray[_Number]]:
        """Values ``(m, ...)`` of the samples before and after each stamp."""
        return values[self.before], values[self.after]

    def linear(self, values: FloatArray) -> FloatArray:
        """Values ``(m,)`` interpolated linearly at the stamps."""
        before, after = self.ends(values)
        return np.asarray(before + self.weight * (after - before))


def brackets(
    stamps_ns: IntArray, query_ns: IntArray, max_gap_ns: int, visible_rows: tuple[IntArray, IntArray] | None = None
) -> Brackets:
    """Find the two samples around each stamp; none outside the samples or across a gap.

    Args:
        stamps_ns: ``(m,)`` of the samples, ascending.
        query_ns: ``(n,)`` stamps to interpolate at.
        max_gap_ns: Longest gap that is interpolated over.
        visible_rows: First usable sample and end of the usable ones for each stamp, ``(n,)`` both; None for all.
    """
    first, end = (0, len(stamps_ns)) if visible_rows is None else visible_rows
    after = np.searchsorted(stamps_ns, query_ns, side="left")
    inside = after < end
    after = np.minimum(after, max(len(stamps_ns) - 1, 0))
    if not len(stamps_ns):
        return Brackets(after, after, np.zeros(len(query_ns)), after, inside)
    exact = stamps_ns[after] == query_ns
    before = np.maximum(np.where(exact, after, after - 1), 0)
    gap = stamps_ns[after] - stamps_ns[before]
    known = inside & (exact | (after > 0)) & (before >= first) & (gap <= max_gap_ns)
    weight = (query_ns - stamps_ns[before]) / np.where(gap > 0, gap, 1)
    return Brackets(before, after, weight, gap, known)
