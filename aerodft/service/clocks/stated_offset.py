"""Clock offsets as lines (offset and drift), and a robust line through samples of UTC minus time since boot."""

from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, IntArray

JUMP_NS: Final = SECOND_NS // 10
"""A larger change of an offset is a jump: the offset must be found anew."""

_CONFIRMATIONS: Final = 3  # agreeing samples that confirm a jump
_MAX_SAMPLES: Final = 64
_MIN_DRIFT_SPAN_NS: Final = 3 * SECOND_NS  # SYSTEM_TIME counts boot time in whole milliseconds
_MIN_INLIER_NS: Final = 2_000_000  # rounding of samples to milliseconds makes no outlier
_INLIER_MADS: Final = 4.5  # median absolute deviations: three standard deviations


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """Another clock minus this one: ``offset_ns`` at ``at_ns`` of this one, growing by ``drift`` (ns/ns)."""

    at_ns: int
    offset_ns: int
    drift: float = 0.0

    def offset(self, own_ns: IntArray) -> IntArray:
        """Other clock minus this one at times ``(n,)`` of this one."""
        gained_ns: IntArray = np.rint(self.drift * (own_ns - self.at_ns)).astype(np.int64)
        return self.offset_ns + gained_ns

    def offset_at(self, own_ns: int) -> int:
        """Other clock minus this one at one time of this one."""
        return self.offset_ns + round(self.drift * (own_ns - self.at_ns))


def robust_line(own_ns: IntArray, offset_ns: IntArray) -> ClockOffset:
    """Line through samples ``(n,)`` of which up to a quarter may be wrong.

    Theil-Sen (1950, 1968) finds the inliers, least squares fits them: medians alone stick to the samples' whole
    milliseconds.
    """
    x, y = (own_ns - own_ns[-1]).astype(np.float64), (offset_ns - offset_ns[-1]).astype(np.float64)
    if x[-1] - x[0] < _MIN_DRIFT_SPAN_NS:
        return ClockOffset(int(own_ns[-1]), int(offset_ns[-1]) + round(float(np.median(y))))
    before, after = _pairs(len(x))
    drift = _median((y[after] - y[before]) / (x[after] - x[before]))
    residuals = np.abs(y - drift * x - _median(y - drift * x))
    is_inlier = residuals <= max(_MIN_INLIER_NS, _INLIER_MADS * _median(residuals))
    offset, drift = np.polynomial.polynomial.polyfit(x[is_inlier], y[is_inlier], 1).tolist()
    return ClockOffset(int(own_ns[-1]), int(offset_ns[-1]) + round(offset), drift)


def _median(values: FloatArray) -> float:
    """Median without numpy's check for NaN, which takes longer than the median."""
    first, half = (len(values) - 1) // 2, len(values) // 2
    parts = np.partition(values, (first, half))
    return float((parts[first] + parts[half]) / 2)


@lru_cache(maxsize=_MAX_SAMPLES)
def _pairs(count: int) -> tuple[IntArray, IntArray]:
    """All pairs of ``count`` rows."""
    before, after = np.triu_indices(count, 1)
    return before, after


class StatedOffset:
    """UTC minus time since boot from messages that have both.

    Attributes:
        line: None before the first sample.
        jumps_ns: Sizes of confirmed jumps.
        skipped_ns: Start and end of the UTC skipped by each jump ahead.
        repeated_ns: Start and end of the UTC repeated after each jump back.
    """

    def __init__(self) -> None:
        self.line: ClockOffset | None = None
        self.jumps_ns: list[int] = []
        self.skipped_ns: list[tuple[int, int]] = []
        self.repeated_ns: list[tuple[int, int]] = []
        self._samples: deque[tuple[int, int]] = deque(maxlen=_MAX_SAMPLES)
        self._jump_candidates: list[tuple[int, int]] = []

    @property
    def unsettled_ns(self) -> int | None:
        """Deviation of the newest sample while a jump is unconfirmed; else None."""
        if not self._jump_candidates or self.line is None:
            return None
        boot_ns, offset_ns = self._jump_candidates[-1]
        return offset_ns - self.line.offset_at(boot_ns)

    def copy(self) -> "StatedOffset":
        """An independent copy."""
        other = StatedOffset()
        other.line, other.jumps_ns = self.line, self.jumps_ns.copy()
        other.skipped_ns, other.repeated_ns = self.skipped_ns.copy(), self.repeated_ns.copy()
        other._samples.extend(self._samples)
        other._jump_candidates = self._jump_candidates.copy()
        return other

    def learn(self, boot_ns: int, offset_ns: int) -> None:
        """Update by a sample; only the first of several in one second is used."""
        off_ns = 0
        if self.line is not None:
            off_ns = offset_ns - self.line.offset_at(boot_ns)
        if abs(off_ns) <= JUMP_NS:
            self._jump_candidates.clear()
            if not self._samples or boot_ns - self._samples[-1][0] >= SECOND_NS - JUMP_NS:
                self._samples.append((boot_ns, offset_ns))
                self._fit()
            return
        if self._jump_candidates and abs(offset_ns - self._jump_candidates[-1][1]) > JUMP_NS:
            self._jump_candidates.clear()
        self._jump_candidates.append((boot_ns, offset_ns))
        if len(self._jump_candidates) >= _CONFIRMATIONS:
            self.jumps_ns.append(off_ns)
            self._add_jump(boot_ns + offset_ns - off_ns)
            self._samples.clear()
            self._samples.append(self._jump_candidates[-1])
            self._jump_candidates.clear()
            self._fit()

    def _add_jump(self, taken_for_ns: int) -> None:
        """Record the UTC skipped between the samples around a jump ahead, or repeated after a jump back."""
        before_ns, after_ns = sum(self._samples[-1]), sum(self._jump_candidates[0])
        if self.jumps_ns[-1] > 0:
            self.skipped_ns.append((before_ns, after_ns))
        else:
            self.repeated_ns.append((after_ns, taken_for_ns))

    def _fit(self) -> None:
        boots, offsets = np.array(self._samples, dtype=np.int64).T
        self.line = robust_line(boots, offsets)
