"""The rangefinders of an on-board log: which one is followed, and the distances that it can see."""

import re
from collections import defaultdict
from collections.abc import Iterable
from typing import Final

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, IntArray

# ArduPilot's AP_RangeFinder_Params: RNGFND1_MIN and _MAX in metres, before 4.7 RNGFND1_MIN_CM and _MAX_CM. The sensor
# is counted from 1 there, in hexadecimal; from 0 in RFND.
_LIMIT: Final = re.compile(r"RNGFND([1-9A-F])_(MIN|MAX)(_CM)?")
_UNIT_M: Final = {None: 1.0, "_CM": 0.01}


class Rangefinders:
    """What the log has said of its rangefinders so far."""

    def __init__(self) -> None:
        self._limits: dict[tuple[int, str], list[tuple[int, float]]] = defaultdict(list)
        self._followed: float | None = None

    def learn(self, names: Iterable[str], values: Iterable[float], boot_ns: Iterable[int]) -> None:
        """Take in parameters in the order of the log; those that are no limit of a rangefinder change nothing."""
        for name, value, at_ns in zip(names, values, boot_ns, strict=True):
            found = _LIMIT.fullmatch(name)
            if found and np.isfinite(value):
                changes = self._limits[int(found[1], 16) - 1, found[2]]
                while changes and changes[-1][0] > at_ns:  # a damaged time: the log goes on before it
                    changes.pop()
                changes.append((at_ns, value * _UNIT_M[found[3]]))

    def limit_m(self, bound: str, sensor: FloatArray, boot_ns: IntArray) -> FloatArray:
        """The limit of each reading ``(n,)``, NaN where none was known by then.

        Args:
            bound: ``MIN`` or ``MAX``.
            sensor: ``(n,)`` counted from 0.
            boot_ns: ``(n,)``.
        """
        limit_m = np.full(len(sensor), np.nan)
        for (number, kind), changes in self._limits.items():
            own = sensor == number
            if kind == bound and own.any():
                times_ns, values_m = zip(*changes, strict=True)
                limit_m[own] = np.array([np.nan, *values_m])[np.searchsorted(times_ns, boot_ns[own], side="right")]
        return limit_m

    def others(self, sensor: FloatArray, good: BoolArray) -> dict[str, BoolArray]:
        """A fault for the readings ``(n,)`` of other sensors than the first that gave a good one."""
        if self._followed is None and good.any():
            self._followed = float(sensor[np.argmax(good)])
        if self._followed is None:
            return {}
        return {f"of another sensor than number {self._followed:g}": sensor != self._followed}
