"""Offsets between clocks as lines (offset and drift): a robust one through samples, and one below delayed samples."""

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.jit import njit
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
_HELD_UP_NS: Final = SECOND_NS // 2  # no receiver is for longer
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
        return self.offset_ns + round(self.drift * (own_ns - self.at_ns))


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


@njit
def line_below(own_ns: FloatArray, offset_ns: FloatArray) -> tuple[float, float]:
    """Offset at 0 and drift of the line closest below all samples ``(n,)``, ``own_ns`` ascending.

    Delays only ever add: the fastest messages lie on the line (Moon, Skelly and Towsley 1999).
    """
    x, y = np.empty(len(own_ns)), np.empty(len(own_ns))  # the hull from below
    count, middle = 0, 0.0
    for k in range(len(own_ns)):
        middle += own_ns[k] / len(own_ns)
        while count > 1 and (y[count - 1] - y[count - 2]) * (own_ns[k] - x[count - 2]) >= (
            offset_ns[k] - y[count - 2]
        ) * (x[count - 1] - x[count - 2]):
            count -= 1
        x[count], y[count] = own_ns[k], offset_ns[k]
        count += 1
    after = 1
    while after < count - 1 and x[after] < middle:
        after += 1
    drift = (y[after] - y[after - 1]) / (x[after] - x[after - 1])
    return y[after - 1] - drift * x[after - 1], drift


class StatedLine:
    """UTC minus time since boot, from what the vehicle says of both at once.

    Attributes:
        line: None before the first sample.
        jumps_ns: By how much it jumped, each time that a jump was believed.
        skipped_ns: UTC from and to which it never said, for each jump ahead.
        repeated_ns: UTC from and to which it said twice, for each jump back.
    """

    def __init__(self) -> None:
        self.line: Line | None = None
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

    def copy(self) -> "StatedLine":
        """The same, to go on from."""
        other = StatedLine()
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


class DelayedLine:
    """This machine's clock minus the vehicle's (UTC, or time since boot), from arrivals: the fastest messages tell it.

    Attributes:
        line: None before the first message.
    """

    def __init__(self) -> None:
        self.line: Line | None = None
        self._late_ns: tuple[int, int] | None = None  # least and most, since no message has been in time
        self._late_for_ns = (0, 0)  # from and to which time of the vehicle's clock
        self._fastest = np.empty((3, 4 * _WINDOW_S), dtype=np.int64)  # of each second: it, the vehicle's time, delay
        self._start = self._stop = 0

    def copy(self) -> "DelayedLine":
        """The same, to go on from."""
        other = DelayedLine()
        other.line, other._fastest = self.line, self._fastest.copy()
        other._late_ns, other._late_for_ns = self._late_ns, self._late_for_ns
        other._start, other._stop = self._start, self._stop
        return other

    @property
    def unsettled_ns(self) -> int | None:
        """How late all messages are now, where it is not known yet whether this machine's clock was set.

        A link that is busy delays some more than others; after a step all are late by the same. A receiver that was
        held up is late once: stamps after a step are ahead of the telemetry, and wait until more has come.
        """
        if self._late_ns is None or self._late_for_ns[1] - self._late_for_ns[0] < _HELD_UP_NS:
            return None
        least_ns, most_ns = self._late_ns
        return least_ns if most_ns - least_ns <= max(JUMP_NS, least_ns) else None

    def learn(self, own_ns: IntArray, arrival_ns: IntArray) -> None:
        """Take in messages ``(n,)``, n > 0, by the vehicle's clock and this machine's."""
        delays = arrival_ns - own_ns
        best = int(np.argmin(delays))
        self.learn_fastest(int(own_ns[best]), int(arrival_ns[best]), int(np.median(delays)) - int(delays[best]))

    def learn_fastest(self, own_ns: int, arrival_ns: int, slower_ns: int = 0) -> Line:
        """Take in the fastest of some messages, of those the first; gives back the line.

        Args:
            own_ns: When it was sent, by the vehicle's clock.
            arrival_ns: When it came, by this machine's.
            slower_ns: How much slower the others were; matters only where the fastest is late.
        """
        delay_ns = arrival_ns - own_ns
        if self.line is not None and delay_ns < self.line.offset_at(own_ns) - JUMP_NS:
            self._start = self._stop  # one of the two clocks was set, or all before this one were held up
        self._note(arrival_ns // SECOND_NS, own_ns, delay_ns)
        self._start_anew_where_set()
        self.line = self._fitted()
        late_ns = delay_ns - self.line.offset_at(own_ns)
        least_ns, most_ns = self._late_ns or (late_ns, late_ns)
        since_ns = own_ns if self._late_ns is None else self._late_for_ns[0]
        self._late_ns = None if late_ns <= JUMP_NS else (min(least_ns, late_ns), max(most_ns, late_ns + slower_ns))
        self._late_for_ns = since_ns, own_ns
        return self.line

    def rebased(self, by_ns: int) -> "DelayedLine":
        """The same for a vehicle's clock that is ahead of this one's by so much."""
        other = self.copy()
        other.rebase(by_ns)
        return other

    def rebase(self, by_ns: int) -> None:
        """From now on the vehicle's clock is ahead of what it was by so much."""
        self._fastest[1] += by_ns
        self._fastest[2] -= by_ns
        self.line = self._fitted() if self._stop > self._start else None

    def _note(self, second: int, own_ns: int, delay_ns: int) -> None:
        table = self._fastest
        if self._stop > self._start and table[0, self._stop - 1] >= second:
            if delay_ns < table[2, self._stop - 1]:
                table[1:, self._stop - 1] = own_ns, delay_ns
            second = int(table[0, self._stop - 1])
        else:
            if self._stop == table.shape[1]:
                kept = table[:, self._start : self._stop].copy()
                self._start, self._stop = 0, kept.shape[1]
                table[:, : self._stop] = kept
            table[:, self._stop] = second, own_ns, delay_ns
            self._stop += 1
        while table[0, self._start] < second - _WINDOW_S:
            self._start += 1

    def _start_anew_where_set(self) -> None:
        """Forget what was before a step of this machine's clock: since then all are late, and by the same."""
        seconds = self._fastest[0, self._start : self._stop]
        first = self._start + int(np.searchsorted(seconds, seconds[-1] - _RECENT_S, side="right"))
        if self.line is None or self._stop - first < _RECENT_S // 2 or first == self._start:
            return
        recent = self._fastest[2, first : self._stop]
        least_ns = int(recent.min())
        late_ns = least_ns - self.line.offset_at(int(self._fastest[1, self._stop - 1]))
        if late_ns > JUMP_NS and late_ns > _STEADY * (float(np.median(recent)) - least_ns):
            self._start = first

    def _fitted(self) -> Line:
        seconds, own, delays = self._fastest[:, self._start : self._stop]
        last = int(own[-1])
        is_line, least_ns, offset, drift = _fit(seconds, own, delays)
        if not is_line or abs(drift) > _MAX_DELAY_DRIFT:
            return Line(last, least_ns)
        return Line(last, int(delays[-1]) + round(offset), drift)


@njit
def _fit(seconds: IntArray, own_ns: IntArray, delays_ns: IntArray) -> tuple[bool, int, float, float]:
    """Whether there is a line below delays ``(n,)``; the least of them; its offset at the last one, and its drift."""
    x, y = np.empty(len(own_ns)), np.empty(len(own_ns))
    ascends, least_ns = True, delays_ns[0]
    for k in range(len(own_ns)):
        x[k], y[k] = own_ns[k] - own_ns[-1], delays_ns[k] - delays_ns[-1]
        least_ns = min(least_ns, delays_ns[k])
        if k > 0 and own_ns[k] <= own_ns[k - 1]:
            ascends = False
    if not ascends or seconds[-1] - seconds[0] < _MIN_DELAY_SPAN_S:
        return False, least_ns, 0.0, 0.0
    offset, drift = line_below(x, y)
    return True, least_ns, offset, drift
