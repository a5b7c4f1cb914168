"""The line below delayed samples: this machine's clock against a vehicle's, from when messages arrive."""

from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.jit import njit
from aerodft.model import FloatArray, IntArray
from aerodft.service.clocks.stated_offset import JUMP_NS, ClockOffset
from aerodft.service.clocks.tracks_by_tick import OffsetsByTick

_WINDOW_S: Final = 120  # over which the fastest messages are looked for
_MIN_DELAY_SPAN_S: Final = 30  # a radio's fastest messages in shorter times differ by more than clocks drift
_MAX_DELAY_DRIFT: Final = 5e-4  # more is a link that becomes slower or faster, not a clock
_RECENT_S: Final = 10  # all messages late for so long: the clock was set
_HELD_UP_NS: Final = SECOND_NS // 2  # no receiver is for longer
_STEADY: Final = 5  # times the scatter of the fastest messages; a radio that is busy is late by less

# What is known, as the loops have it.
_HAS_LINE, _AT, _OFFSET, _START, _STOP, _IS_LATE, _LEAST, _MOST, _LATE_FROM, _LATE_TO = range(10)


class ArrivalOffset:
    """This machine's clock minus the vehicle's (UTC, or time since boot), from arrivals: the fastest messages tell it.

    Attributes:
        line: None before the first message.
    """

    def __init__(self) -> None:
        self.line: ClockOffset | None = None
        self._state = np.zeros(10, dtype=np.int64)
        self._drift = np.zeros(1)
        self._fastest = np.empty((3, 4 * _WINDOW_S), dtype=np.int64)  # of each second: it, the vehicle's time, delay

    def copy(self) -> "ArrivalOffset":
        """A copy that learns on its own."""
        other = ArrivalOffset()
        other.line, other._fastest = self.line, self._fastest.copy()
        other._state, other._drift = self._state.copy(), self._drift.copy()
        return other

    @property
    def unsettled_ns(self) -> int | None:
        """How late all messages are now, where it is not known yet whether this machine's clock was set.

        A link that is busy delays some more than others; after a step all are late by the same. A receiver that was
        held up is late once: stamps after a step are ahead of the telemetry, and wait until more has come.
        """
        return int(self._state[_LEAST]) if _is_unsettled(self._state) else None

    def learn(self, own_ns: IntArray, arrival_ns: IntArray) -> None:
        """Take in messages ``(n,)``, n > 0, by the vehicle's clock and this machine's."""
        delays = arrival_ns - own_ns
        best = int(np.argmin(delays))
        slower_ns = int(np.median(delays)) - int(delays[best])
        self.learn_fastest(own_ns[best : best + 1], arrival_ns[best : best + 1], np.array([slower_ns]))

    def learn_fastest(self, own_ns: IntArray, arrival_ns: IntArray, slower_ns: IntArray) -> OffsetsByTick:
        """Take in the fastest messages ``(n,)`` of some groups of them, one after the other, of each the first.

        Args:
            own_ns: When they were sent, by the vehicle's clock.
            arrival_ns: When they came, by this machine's.
            slower_ns: How much slower the others of the group were; matters only where the fastest is late.

        Returns:
            The line after each of them.
        """
        at_ns, offset_ns, off_ns = np.empty((3, len(own_ns)), dtype=np.int64)
        found = OffsetsByTick(at_ns, offset_ns, np.empty(len(own_ns)), off_ns)
        known = self._fastest, self._state, self._drift
        _learn(known, (own_ns, arrival_ns, slower_ns), at_ns, offset_ns, found.drift, off_ns)
        self.line = self._line()
        return found

    def rebased(self, by_ns: int) -> "ArrivalOffset":
        """A copy for a vehicle's clock that is ahead of this one's by so much."""
        other = self.copy()
        other.rebase(by_ns)
        return other

    def rebase(self, by_ns: int) -> None:
        """From now on the vehicle's clock is ahead of what it was by so much."""
        self._fastest[1] += by_ns
        self._fastest[2] -= by_ns
        self._state[_HAS_LINE] = self._state[_STOP] > self._state[_START]
        if self._state[_HAS_LINE]:
            _fit(self._fastest, self._state, self._drift)
        self.line = self._line()

    def _line(self) -> ClockOffset | None:
        state = self._state
        return ClockOffset(int(state[_AT]), int(state[_OFFSET]), float(self._drift[0])) if state[_HAS_LINE] else None


@njit
def _learn(
    known: tuple[IntArray, IntArray, FloatArray],
    messages: tuple[IntArray, IntArray, IntArray],
    at_ns: IntArray,
    offset_ns: IntArray,
    drifts: FloatArray,
    off_ns: IntArray,
) -> None:
    """``ArrivalOffset.learn_fastest``: change what is known, and write what a ``OffsetsByTick`` holds."""
    table, state, drift = known
    own, arrival, slower = messages
    for k in range(len(own)):
        delay = arrival[k] - own[k]
        if state[_HAS_LINE] and delay < _offset_at(state, drift, own[k]) - JUMP_NS:
            state[_START] = state[_STOP]  # one of the two clocks was set, or all before this one were held up
        is_new = _note(table, state, arrival[k] // SECOND_NS, own[k], delay)
        start = state[_START]
        _start_anew_where_set(table, state, drift)
        if is_new or state[_START] != start:
            _fit(table, state, drift)
        late = delay - _offset_at(state, drift, own[k])
        if not state[_IS_LATE]:
            state[_LATE_FROM], state[_LEAST], state[_MOST] = own[k], late, late
        state[_LATE_TO] = own[k]
        state[_LEAST], state[_MOST] = min(state[_LEAST], late), max(state[_MOST], late + slower[k])
        state[_IS_LATE] = late > JUMP_NS  # since no message has been in time
        at_ns[k], offset_ns[k], drifts[k] = state[_AT], state[_OFFSET], drift[0]
        off_ns[k] = state[_LEAST] if _is_unsettled(state) else 0


@njit
def _is_unsettled(state: IntArray) -> bool:
    if not state[_IS_LATE] or state[_LATE_TO] - state[_LATE_FROM] < _HELD_UP_NS:
        return False
    return bool(state[_MOST] - state[_LEAST] <= max(JUMP_NS, state[_LEAST]))


@njit
def _offset_at(state: IntArray, drift: FloatArray, own_ns: int) -> int:
    return int(state[_OFFSET] + np.int64(np.rint(drift[0] * (own_ns - state[_AT]))))


@njit
def _note(table: IntArray, state: IntArray, second: int, own_ns: int, delay_ns: int) -> bool:
    """Take in a message; whether it is the fastest of its second so far."""
    last, is_fastest = state[_STOP] - 1, True
    if last >= state[_START] and table[0, last] >= second:
        is_fastest = delay_ns < table[2, last]
        if is_fastest:
            table[1, last], table[2, last] = own_ns, delay_ns
        second = table[0, last]
    else:
        if state[_STOP] == table.shape[1]:
            kept = table[:, state[_START] : state[_STOP]].copy()
            state[_START], state[_STOP] = 0, kept.shape[1]
            table[:, : state[_STOP]] = kept
        stop = state[_STOP]
        table[0, stop], table[1, stop], table[2, stop] = second, own_ns, delay_ns
        state[_STOP] = stop + 1
    while table[0, state[_START]] < second - _WINDOW_S:
        state[_START] += 1
    return is_fastest


@njit
def _start_anew_where_set(table: IntArray, state: IntArray, drift: FloatArray) -> None:
    """Forget what was before a step of this machine's clock: since then all are late, and by the same."""
    start, stop = state[_START], state[_STOP]
    first = stop
    while first > start and table[0, first - 1] > table[0, stop - 1] - _RECENT_S:
        first -= 1
    if not state[_HAS_LINE] or stop - first < _RECENT_S // 2 or first == start:
        return
    recent = table[2, first:stop]
    least = np.min(recent)
    late = least - _offset_at(state, drift, table[1, stop - 1])
    if late > JUMP_NS and late > _STEADY * (np.median(recent) - least):
        state[_START] = first


@njit
def _fit(table: IntArray, state: IntArray, drift: FloatArray) -> None:
    """The line below what is in the table, which is something."""
    start, stop = state[_START], state[_STOP]
    last = stop - 1
    own_ns, delay_ns = table[1, start:stop], table[2, start:stop]
    state[_HAS_LINE], state[_AT], state[_OFFSET], drift[0] = 1, table[1, last], delay_ns.min(), 0.0
    ascends = np.all(own_ns[1:] > own_ns[:-1])
    if not ascends or table[0, last] - table[0, start] < _MIN_DELAY_SPAN_S:
        return
    x, y = (own_ns - table[1, last]).astype(np.float64), (delay_ns - table[2, last]).astype(np.float64)
    offset, slope = line_below(x, y)
    if abs(slope) <= _MAX_DELAY_DRIFT:
        state[_OFFSET], drift[0] = table[2, last] + np.int64(np.rint(offset)), slope


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
