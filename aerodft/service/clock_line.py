"""Offsets between clocks as lines (offset and drift): a robust one through samples, and one below delayed samples."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import FloatArray, IntArray

JUMP_NS: Final = SECOND_NS // 10
"""An offset that is off by more is a jump: what time it is must be found anew."""

_CONFIRMATIONS: Final = 3  # samples that must agree before a jump is believed
_UTC_SAMPLES: Final = 64
_MIN_DRIFT_SPAN_NS: Final = 3 * SECOND_NS  # SYSTEM_TIME counts boot time in whole milliseconds
_WHOLE_NS: Final = 2_000_000  # that is no outlier
_FAR: Final = 4.5  # times the median deviation: three standard deviations
_WINDOW_S: Final = 120  # over which the fastest messages are looked for
_MIN_DELAY_SPAN_S: Final = 30  # a radio's fastest messages in shorter times differ by more than clocks drift
_MAX_DELAY_DRIFT: Final = 5e-4  # more is a link that becomes slower or faster, not a clock
_RECENT_S: Final = 10  # all messages late for so long: the clock was set
_STEADY: Final = 5  # times the scatter of the fastest messages; a radio that is busy is late by less


@dataclass(frozen=True, slots=True)
class Line:
    """Another clock minus this one: ``offset_ns`` at ``at_ns`` of this one, and so much more per unit of time."""

    at_ns: int
    offset_ns: int
    drift: float = 0.0

    def offset(self, own_ns: IntArray) -> IntArray:
        """The other clock minus this one at times ``(n,)`` of this one."""
        gained_ns: IntArray = np.rint(self.drift * (own_ns - self.at_ns)).astype(np.int64)
        return self.offset_ns + gained_ns

    def offset_at(self, own_ns: int) -> int:
        """The same at one time."""
        return int(self.offset(np.array([own_ns]))[0])


def robust_line(own_ns: IntArray, offset_ns: IntArray) -> Line:
    """The line through samples ``(n,)``, of which up to a quarter may be wrong.

    Medians (Theil 1950, Sen 1968) find those that agree, and least squares go through these: medians alone stick to the
    whole milliseconds of the samples.
    """
    x, y = (own_ns - own_ns[-1]).astype(np.float64), (offset_ns - offset_ns[-1]).astype(np.float64)
    if x[-1] - x[0] < _MIN_DRIFT_SPAN_NS:
        return Line(int(own_ns[-1]), int(offset_ns[-1]) + round(float(np.median(y))))
    before, after = np.triu_indices(len(x), 1)
    drift = float(np.median((y[after] - y[before]) / (x[after] - x[before])))
    off = np.abs(y - drift * x - np.median(y - drift * x))
    near = off <= max(_WHOLE_NS, _FAR * float(np.median(off)))
    drift, offset = np.polynomial.polynomial.polyfit(x[near], y[near], 1)[::-1].tolist()
    return Line(int(own_ns[-1]), int(offset_ns[-1]) + round(offset), drift)


def line_below(own_ns: FloatArray, offset_ns: FloatArray) -> tuple[float, float]:
    """Offset at 0 and drift of the line closest below all samples ``(n,)``, ``own_ns`` ascending.

    Delays only ever add: the fastest messages lie on the line (Moon, Skelly and Towsley 1999).
    """
    hull: list[tuple[float, float]] = []
    for x, y in zip(own_ns.tolist(), offset_ns.tolist(), strict=True):
        while len(hull) > 1 and _turns_up(hull[-2], hull[-1], (x, y)):
            hull.pop()
        hull.append((x, y))
    middle = float(np.mean(own_ns))
    after = max(next(k for k, (x, _) in enumerate(hull) if x >= middle), 1)
    (x0, y0), (x1, y1) = hull[after - 1], hull[after]
    drift = (y1 - y0) / (x1 - x0)
    return y0 - drift * x0, drift


def _turns_up(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether ``b`` lies on or above the line from ``a`` to ``c``."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])


class StatedLine:
    """UTC minus time since boot, from what the vehicle says of both at once.

    Attributes:
        line: None before the first sample.
        jumps_ns: By how much it jumped, each time that a jump was believed.
    """

    def __init__(self) -> None:
        self.line: Line | None = None
        self.jumps_ns: list[int] = []
        self._samples: deque[tuple[int, int]] = deque(maxlen=_UTC_SAMPLES)
        self._strangers: list[tuple[int, int]] = []

    @property
    def unsettled_ns(self) -> int | None:
        """By how much the newest sample is off, where it is not known yet whether that is to be believed."""
        if not self._strangers or self.line is None:
            return None
        boot_ns, offset_ns = self._strangers[-1]
        return offset_ns - self.line.offset_at(boot_ns)

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
            self._samples.clear()
            self._samples.append(self._strangers[-1])
            self._strangers.clear()
            self._fit()

    def _fit(self) -> None:
        boots, offsets = np.array(self._samples, dtype=np.int64).T
        self.line = robust_line(boots, offsets)


class DelayedLine:
    """This machine's clock minus the vehicle's (UTC, or time since boot), from arrivals: the fastest messages tell it.

    Attributes:
        line: None before the first message.
    """

    def __init__(self) -> None:
        self.line: Line | None = None
        self._fastest: deque[_Delay] = deque()  # the fastest message of each second

    def learn(self, own_ns: IntArray, arrival_ns: IntArray) -> None:
        """Take in messages ``(n,)``, n > 0, by the vehicle's clock and this machine's."""
        delays = arrival_ns - own_ns
        best = int(np.argmin(delays))
        newest = _Delay(int(arrival_ns[best]) // SECOND_NS, int(own_ns[best]), int(delays[best]))
        if self.line is not None and newest.ns < self.line.offset_at(newest.own_ns) - JUMP_NS:
            self._fastest.clear()  # one of the two clocks was set, or all before this one were held up
        self._note(newest)
        self._start_anew_where_set()
        self.line = self._fitted()

    def rebased(self, by_ns: int) -> "DelayedLine":
        """The same for a vehicle's clock that is ahead of this one's by so much."""
        other = DelayedLine()
        other._fastest.extend(_Delay(each.second, each.own_ns + by_ns, each.ns - by_ns) for each in self._fastest)
        other.line = other._fitted() if other._fastest else None
        return other

    def _note(self, newest: "_Delay") -> None:
        if self._fastest and self._fastest[-1].second >= newest.second:
            last = self._fastest.pop()
            newest = replace(min(last, newest, key=lambda each: each.ns), second=last.second)
        self._fastest.append(newest)
        while self._fastest[0].second < newest.second - _WINDOW_S:
            self._fastest.popleft()

    def _start_anew_where_set(self) -> None:
        """Forget what was before a step of this machine's clock: since then all are late, and by the same."""
        newest_s = self._fastest[-1].second
        recent = [each.ns for each in self._fastest if each.second > newest_s - _RECENT_S]
        if self.line is None or len(recent) < _RECENT_S // 2 or len(recent) == len(self._fastest):
            return
        late_ns = min(recent) - self.line.offset_at(self._fastest[-1].own_ns)
        if late_ns > max(JUMP_NS, _STEADY * (float(np.median(recent)) - min(recent))):
            while self._fastest[0].second <= newest_s - _RECENT_S:
                self._fastest.popleft()

    def _fitted(self) -> Line:
        own = np.array([each.own_ns for each in self._fastest], dtype=np.int64)
        delays = np.array([each.ns for each in self._fastest], dtype=np.int64)
        fastest = Line(int(own[-1]), int(np.min(delays)))
        if self._fastest[-1].second - self._fastest[0].second < _MIN_DELAY_SPAN_S or np.any(np.diff(own) <= 0):
            return fastest
        x, y = (own - own[-1]).astype(np.float64), (delays - delays[-1]).astype(np.float64)
        offset, drift = line_below(x, y)
        return fastest if abs(drift) > _MAX_DELAY_DRIFT else Line(int(own[-1]), int(delays[-1]) + round(offset), drift)


@dataclass(frozen=True, slots=True)
class _Delay:
    """A message's delay, with the difference of the clocks in it."""

    second: int  # of arrival
    own_ns: int
    ns: int
