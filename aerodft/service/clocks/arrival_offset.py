"""Offset of this machine's clock to a vehicle's, from arrivals: the lower line of delayed samples."""

from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.jit import njit
from aerodft.model import FloatArray, IntArray
from aerodft.service.clocks.stated_offset import JUMP_NS, ClockOffset
from aerodft.service.clocks.tracks_by_tick import OffsetsByTick

_WINDOW_S: Final = 120  # window of the fastest messages
_MIN_DELAY_SPAN_S: Final = 30  # over shorter spans a radio's fastest messages vary by more than clocks drift
_MAX_DELAY_DRIFT: Final = 5e-4  # more is a link that becomes slower or faster, not a clock
_RECENT_S: Final = 10  # after all messages are late for this long the clock was set
_MAX_STALL_NS: Final = SECOND_NS // 2  # longest stall of a receiver
_MIN_LATENESS_RATIO: Final = 5  # lateness over scatter after a clock step; a busy radio has less

# Indices of the state in compiled loops.
_HAS_LINE, _AT, _OFFSET, _START, _STOP, _IS_LATE, _LEAST, _MOST, _LATE_FROM, _LATE_TO = range(10)


class ArrivalOffset:
    """This machine's clock minus the vehicle's (UTC, or time since boot), from the fastest messages' arrivals.

    Attributes:
        line: None before the first message.
    """

    def __init__(self) -> None:
        self.line: ClockOffset | None = None
        self._state = np.zeros(10, dtype=np.int64)
        self._drift = np.zeros(1)
        self._fastest = np.empty((3, 4 * _WINDOW_S), dtype=np.int64)  # per second: it, vehicle's time, delay

    def copy(self) -> "ArrivalOffset":
        """An independent copy."""
        other = ArrivalOffset()
        other.line, other._fastest = self.line, self._fastest.copy()
        other._state, other._drift = self._state.copy(), self._drift.copy()
        return other

    @property
    def unsettled_ns(self) -> int | None:
        """Lateness of all messages while it is unknown whether this machine's clock was set; else None.

        A busy link delays some messages more than others; after a step all are late by the same. A stalled receiver is
        late once: stamps after a step are ahead of the telemetry, and wait for more.
        """
        return int(self._state[_LEAST]) if _is_unsettled(self._state) else None

    def learn(self, own_ns: IntArray, arrival_ns: IntArray) -> None:
        """Update by messages ``(n,)``, n > 0, with the vehicle's time and the arrival."""
        delays = arrival_ns - own_ns
        best = int(np.argmin(delays))
        slower_ns = int(np.median(delays)) - int(delays[best])
        self.learn_fastest(own_ns[best : best + 1], arrival_ns[best : best + 1], np.array([slower_ns]))

    def learn_fastest(self, own_ns: IntArray, arrival_ns: IntArray, slower_ns: IntArray) -> OffsetsByTick:
        """Update by the fastest message of each of ``n`` groups, in order.

        Args:
            own_ns: Times of sending, by the vehicle's clock.
            arrival_ns: Arrivals, by this machine's clock.
            slower_ns: Median delay of the group minus the fastest; matters only where the fastest is late.

        Returns:
            The line after each group.
        """
        at_ns, offset_ns, off_ns = np.empty((3, len(own_ns)), dtype=np.int64)
        offsets = OffsetsByTick(at_ns, offset_ns, np.empty(len(own_ns)), off_ns)
        buffers = self._fastest, self._state, self._drift
        _learn(buffers, (own_ns, arrival_ns, slower_ns), at_ns, offset_ns, offsets.drift, off_ns)
        self.line = self._line()
        return offsets

    def rebased(self, by_ns: int) -> "ArrivalOffset":
        """A copy for a vehicle's clock that is ahead of this one's by ``by_ns``."""
        other = self.copy()
        other.rebase(by_ns)
        return other

    def rebase(self, by_ns: int) -> None:
        """Adapt to a step ``by_ns`` of the vehicle's clock."""
        self._fastest[1] += by_ns
        self._fastest[2] -= by_ns
        self._state[_HAS_LINE] = self._state[_STOP] > self._state[_START]
        if self._state[_HAS_LINE]:
            _fit_line(self._fastest, self._state, self._drift)
        self.line = self._line()

    def _line(self) -> ClockOffset | None:
        state = self._state
        return ClockOffset(int(state[_AT]), int(state[_OFFSET]), float(self._drift[0])) if state[_HAS_LINE] else None


@njit
def _learn(
    buffers: tuple[IntArray, IntArray, FloatArray],
    messages: tuple[IntArray, IntArray, IntArray],
    at_ns: IntArray,
    offset_ns: IntArray,
    drifts: FloatArray,
    off_ns: IntArray,
) -> None:
    """Implements ``ArrivalOffset.learn_fastest``: updates the buffers and writes columns of ``OffsetsByTick``."""
    table, state, drift = buffers
    vehicle, arrival, slower = messages
    for k in range(len(vehicle)):
        delay = arrival[k] - vehicle[k]
        if state[_HAS_LINE] and delay < _offset_at(state, drift, vehicle[k]) - JUMP_NS:
            state[_START] = state[_STOP]  # one of the clocks was set, or all messages before this one were delayed
        is_new = _add_message(table, state, arrival[k] // SECOND_NS, vehicle[k], delay)
        start = state[_START]
        _drop_before_step(table, state, drift)
        if is_new or state[_START] != start:
            _fit_line(table, state, drift)
        late = delay - _offset_at(state, drift, vehicle[k])
        if not state[_IS_LATE]:
            state[_LATE_FROM], state[_LEAST], state[_MOST] = vehicle[k], late, late
        state[_LATE_TO] = vehicle[k]
        state[_LEAST], state[_MOST] = min(state[_LEAST], late), max(state[_MOST], late + slower[k])
        state[_IS_LATE] = late > JUMP_NS  # since the last message that was not late
        at_ns[k], offset_ns[k], drifts[k] = state[_AT], state[_OFFSET], drift[0]
        off_ns[k] = state[_LEAST] if _is_unsettled(state) else 0


@njit
def _is_unsettled(state: IntArray) -> bool:
    if not state[_IS_LATE] or state[_LATE_TO] - state[_LATE_FROM] < _MAX_STALL_NS:
        return False
    return bool(state[_MOST] - state[_LEAST] <= max(JUMP_NS, state[_LEAST]))


@njit
def _offset_at(state: IntArray, drift: FloatArray, own_ns: int) -> int:
    return int(state[_OFFSET] + np.int64(np.rint(drift[0] * (own_ns - state[_AT]))))


@njit
def _add_message(table: IntArray, state: IntArray, second: int, own_ns: int, delay_ns: int) -> bool:
    """Add a message; returns whether it is the fastest of its second so far."""
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
def _drop_before_step(table: IntArray, state: IntArray, drift: FloatArray) -> None:
    """Drop messages before a step of this machine's clock: since then all are late by the same."""
    start, stop = state[_START], state[_STOP]
    first = stop
    while first > start and table[0, first - 1] > table[0, stop - 1] - _RECENT_S:
        first -= 1
    if not state[_HAS_LINE] or stop - first < _RECENT_S // 2 or first == start:
        return
    recent = table[2, first:stop]
    least = np.min(recent)
    late = least - _offset_at(state, drift, table[1, stop - 1])
    if late > JUMP_NS and late > _MIN_LATENESS_RATIO * (np.median(recent) - least):
        state[_START] = first


@njit
def _fit_line(table: IntArray, state: IntArray, drift: FloatArray) -> None:
    """Fit the lower line to the messages in the table (one or more)."""
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
    """Offset at 0 and drift of the closest line below all samples ``(n,)``, ``own_ns`` ascending.

    Delays are positive: the fastest messages lie on the line (Moon, Skelly and Towsley 1999).
    """
    x, y = np.empty(len(own_ns)), np.empty(len(own_ns))  # the lower hull
    count, mean = 0, 0.0
    for k in range(len(own_ns)):
        mean += own_ns[k] / len(own_ns)
        while count > 1 and (y[count - 1] - y[count - 2]) * (own_ns[k] - x[count - 2]) >= (
            offset_ns[k] - y[count - 2]
        ) * (x[count - 1] - x[count - 2]):
            count -= 1
        x[count], y[count] = own_ns[k], offset_ns[k]
        count += 1
    after = 1
    while after < count - 1 and x[after] < mean:
        after += 1
    drift = (y[after] - y[after - 1]) / (x[after] - x[after - 1])
    return y[after - 1] - drift * x[after - 1], drift
