"""When something was worst over a log, and from when to when something held."""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, IntArray


@dataclass(slots=True)
class Worst:
    """The largest of all values.

    Attributes:
        value: That; NaN before the first.
        at_ns: When it came.
    """

    value: float = math.nan
    at_ns: int = 0

    def add(self, values: FloatArray, arrival_ns: IntArray) -> None:
        """Take in values ``(n,)``; NaN is none."""
        if not np.isfinite(values).any():
            return
        k = int(np.nanargmax(values))
        if not self.value >= values[k]:
            self.value, self.at_ns = float(values[k]), int(arrival_ns[k])


@dataclass(slots=True)
class Spell:
    """Reports that say something bad, among all.

    Attributes:
        count: All reports.
        bad: Those that say it.
        first_ns: The first of these.
        last_ns: The last of these.
    """

    count: int = 0
    bad: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def add(self, bad: BoolArray, arrival_ns: IntArray) -> None:
        """Take in reports ``(n,)``."""
        self.count += len(bad)
        when_ns = arrival_ns[bad]
        if len(when_ns):
            self.first_ns = self.first_ns if self.bad else int(when_ns[0])
            self.bad, self.last_ns = self.bad + len(when_ns), int(when_ns[-1])
