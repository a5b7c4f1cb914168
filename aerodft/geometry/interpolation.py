"""Values between samples: linear and spherical, never across a gap, never outside."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from aerodft.geometry.rotation import slerp
from aerodft.model.arrays import BoolArray, FloatArray, IntArray

_Number = TypeVar("_Number", np.float64, np.int64)


@dataclass(frozen=True, slots=True)
class Bracket:
    """The two samples around a stamp: indices, weight of the later one, and the gap between them."""

    before: int
    after: int
    weight: float
    gap_ns: int

    def linear(self, values: FloatArray) -> FloatArray:
        """``values (n, ...)`` at the stamp."""
        return np.asarray(values[self.before] + self.weight * (values[self.after] - values[self.before]))

    def spherical(self, wxyz: FloatArray) -> FloatArray:
        """Unit quaternions ``(n, 4)`` at the stamp, ``(4,)``."""
        return slerp(wxyz[self.before], wxyz[self.after], self.weight)


@dataclass(frozen=True, slots=True, eq=False)
class Brackets:
    """``Bracket`` of many stamps ``(n,)``; rows where ``is_known`` is false mean nothing."""

    before: IntArray
    after: IntArray
    weight: FloatArray
    gap_ns: IntArray
    is_known: BoolArray

    def rows(self, rows: IntArray) -> "Brackets":
        """Those of some of the stamps."""
        return Brackets(self.before[rows], self.after[rows], self.weight[rows], self.gap_ns[rows], self.is_known[rows])

    def ends(self, values: npt.NDArray[_Number]) -> tuple[npt.NDArray[_Number], npt.NDArray[_Number]]:
        """``values (m, ...)`` before and after each stamp."""
        return values[self.before], values[self.after]

    def linear(self, values: FloatArray) -> FloatArray:
        """``values (m,)`` at the stamps, as ``Bracket.linear`` to the last bit."""
        before, after = self.ends(values)
        return np.asarray(before + self.weight * (after - before))


def brackets(
    stamps_ns: IntArray, asked_ns: IntArray, max_gap_ns: int, seen: tuple[IntArray, IntArray] | None = None
) -> Brackets:
    """``bracket`` of many stamps at once.

    Args:
        stamps_ns: ``(m,)`` ascending.
        asked_ns: ``(n,)``.
        max_gap_ns: Longest gap.
        seen: For each of them ``(n,)`` the first sample that counts, and the one behind the last; None for all.
    """
    first, end = (0, len(stamps_ns)) if seen is None else seen
    after = np.searchsorted(stamps_ns, asked_ns, side="left")
    inside = after < end
    after = np.minimum(after, max(len(stamps_ns) - 1, 0))
    if not len(stamps_ns):
        return Brackets(after, after, np.zeros(len(asked_ns)), after, inside)
    exact = stamps_ns[after] == asked_ns
    before = np.maximum(np.where(exact, after, after - 1), 0)
    gap = stamps_ns[after] - stamps_ns[before]
    known = inside & (exact | (after > 0)) & (before >= first) & (gap <= max_gap_ns)
    weight = (asked_ns - stamps_ns[before]) / np.where(gap > 0, gap, 1)
    return Brackets(before, after, weight, gap, known)


def bracket(stamps_ns: IntArray, stamp_ns: int, max_gap_ns: int) -> Bracket | None:
    """Find the samples on both sides of ``stamp_ns`` in ascending ``stamps_ns (n,)``.

    Returns:
        None outside the samples and where their gap exceeds ``max_gap_ns``.
    """
    after = int(np.searchsorted(stamps_ns, stamp_ns, side="left"))
    if after == len(stamps_ns):
        return None
    if stamps_ns[after] == stamp_ns:
        return Bracket(after, after, 0.0, 0)
    if after == 0:
        return None
    start, gap = int(stamps_ns[after - 1]), int(stamps_ns[after] - stamps_ns[after - 1])
    if gap > max_gap_ns:
        return None
    return Bracket(after - 1, after, (stamp_ns - start) / gap, gap)
