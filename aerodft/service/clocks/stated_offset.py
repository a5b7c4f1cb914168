"""Offsets between clocks as lines (offset and drift), and a robust one through samples."""

from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, IntArray

JUMP_NS: Final = SECOND_NS // 10
"""An offset that is off by more is a jump: what time it is must be found anew."""

_CONFIRMATIONS: Final = 3  # samples that must agree before a jump is believed
_UTC_SAMPLES: Final = 64
_MIN_DRIFT_SPAN_NS: Final = 3 * SECOND_NS  # SYSTEM_TIME counts boot time in whole milliseconds
_WHOLE_NS: Final = 2_000_000  # that is no outlier
_FAR: Final = 4.5  # times the median deviation: three standard deviations


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """Another clock minus this one: ``offset_ns`` at ``at_ns`` of this one, and so much more per unit of time."""

    at_ns: int
    offset_ns: int
    drift: float = 0.0

    def offset(self, own_ns: IntArray) -> IntArray:
        """The other clock minus this one at times ``(n,)`` of this one."""
        gained_ns: IntArray = np.rint(self.drift * (own_ns - self.at_ns)).astype(np.int64)
        return self.offset_ns + gained_ns

    def offset_at(self, own_ns: int) -> int:
        """The other clock minus this one at one time of this one."""
        return self.offset_ns + round(self.drift * (own_ns - self.at_ns))


def robust_line(own_ns: IntArray, offset_ns: IntArray) -> ClockOffset:
    """The line through samples ``(n,)``, of which up to a quarter may be wrong.

    Medians (Theil 1950, Sen 1968) find those that agree, and least squares go through these: medians alone stick to the
    whole milliseconds of the samples.
    """
    x, y = (own_ns - own_ns[-1]).astype(np.float64), (offset_ns - offset_ns[-1]).astype(np.float64)
    if x[-1] - x[0] < _MIN_DRIFT_SPAN_NS:
        return ClockOffset(int(own_ns[-1]), int(offset_ns[-1]) + round(float(np.median(y))))
    before, after = _pairs(len(x))
    drift = _median((y[after] - y[before]) / (x[after] - x[before]))
    off = np.abs(y - drift * x - _median(y - drift * x))
    near = off <= max(_WHOLE_NS, _FAR * _median(off))
    offset, drift = _least_squares(x[near], y[near])
    return ClockOffset(int(own_ns[-1]), int(offset_ns[-1]) + round(offset), drift)


def _median(values: FloatArray) -> float:
    """The median; numpy's looks for NaN first, in more time than it then takes."""
    first, half = (len(values) - 1) // 2, len(values) // 2
    parts = np.partition(values, (first, half))
    return float((parts[first] + parts[half]) / 2)


def _least_squares(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Value at 0 and slope of the line through samples ``(n,)``, as ``numpy.polynomial`` finds it in twice the time."""
    powers = np.stack([np.ones_like(x), x])
    scale = np.sqrt(np.square(powers).sum(axis=1))
    found, *_ = np.linalg.lstsq(powers.T / scale, y, len(x) * np.finfo(np.float64).eps)
    at_0, slope = (found / scale).tolist()
    return at_0, slope


@lru_cache(maxsize=_UTC_SAMPLES)
def _pairs(count: int) -> tuple[IntArray, IntArray]:
    """All pairs of so many rows."""
    before, after = np.triu_indices(count, 1)
    return before, after


class StatedOffset:
    """UTC minus time since boot, from what the vehicle says of both at once.

    Attributes:
        line: None before the first sample.
        jumps_ns: By how much it jumped, each time that a jump was believed.
        skipped_ns: UTC from and to which it never said, for each jump ahead.
        repeated_ns: UTC from and to which it said twice, for each jump back.
    """

    def __init__(self) -> None:
        self.line: ClockOffset | None = None
        self.jumps_ns: list[int] = []
        self.skipped_ns: list[tuple[int, int]] = []
        self.repeated_ns: list[tuple[int, int]] = []
        self._samples: deque[tuple[int, int]] = deque(maxlen=_UTC_SAMPLES)
        self._strangers: list[tuple[int, int]] = []

    @property
    def unsettled_ns(self) -> int | None:
        """By how much the newest sample is off, where it is not known yet whether that is to be believed."""
        if not self._strangers or self.line is None:
            return None
        boot_ns, offset_ns = self._strangers[-1]
        return offset_ns - self.line.offset_at(boot_ns)

    def copy(self) -> "StatedOffset":
        """A copy that learns on its own."""
        other = StatedOffset()
        other.line, other.jumps_ns = self.line, self.jumps_ns.copy()
        other.skipped_ns, other.repeated_ns = self.skipped_ns.copy(), self.repeated_ns.copy()
        other._samples.extend(self._samples)
        other._strangers = self._strangers.copy()
        return other

    def learn(self, boot_ns: int, offset_ns: int) -> None:
        """Take in a sample; of several in one second the first."""
        off_ns = 0
        if self.line is not None:
            off_ns = offset_ns - self.line.offset_at(boot_ns)
        if abs(off_ns) <= JUMP_NS:
            self._strangers.clear()
            if not self._samples or boot_ns - self._samples[-1][0] >= SECOND_NS - JUMP_NS:
                self._samples.append((boot_ns, offset_ns))
                self._fit()
            return
        if self._strangers and abs(offset_ns - self._strangers[-1][1]) > JUMP_NS:
            self._strangers.clear()
        self._strangers.append((boot_ns, offset_ns))
        if len(self._strangers) >= _CONFIRMATIONS:
            self.jumps_ns.append(off_ns)
            self._note_jump(boot_ns + offset_ns - off_ns)
            self._samples.clear()
            self._samples.append(self._strangers[-1])
            self._strangers.clear()
            self._fit()

    def _note_jump(self, taken_for_ns: int) -> None:
        """Ahead: from the last sample before it to the first after it. Back: to what it is taken for until now."""
        before_ns, after_ns = sum(self._samples[-1]), sum(self._strangers[0])
        if self.jumps_ns[-1] > 0:
            self.skipped_ns.append((before_ns, after_ns))
        else:
            self.repeated_ns.append((after_ns, taken_for_ns))

    def _fit(self) -> None:
        boots, offsets = np.array(self._samples, dtype=np.int64).T
        self.line = robust_line(boots, offsets)
