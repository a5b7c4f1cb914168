"""Values between samples: linear and spherical, never across a gap, never outside."""

from dataclasses import dataclass

import numpy as np

from aerodft.geometry.rotation import slerp
from aerodft.model.arrays import FloatArray, IntArray


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
