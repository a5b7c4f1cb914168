"""Messages found in the bytes of a .bin log, damaged ones left out."""

from typing import Final

import numpy as np

from aerodft.adapters.telemetry.mavlink import AT_SYNC, LAST_US, MAX_STAMP_US, N_OK, N_SKIPPED, N_TRUNCATED, Bytes
from aerodft.jit import njit, njit_inline
from aerodft.model import IntArray

HEAD: Final = (0xA3, 0x95)
HEAD_SIZE: Final = 3
FMT_TYPE: Final = 128
FMT_SIZE: Final = 89

_WHOLE, _DOUBTFUL, _DAMAGED = 0, 1, 2  # what may be said of a message
_FIRST, _SECOND = HEAD
_FMT_FORMAT_AT, _FMT_COLUMNS_AT = 9, 25
_TIME_US_COLUMN: Final = np.frombuffer(b"TimeUS", dtype=np.uint8)
_TIME_MS_COLUMN: Final = np.frombuffer(b"TimeMS", dtype=np.uint8)
_TIMED_US: Final = 1 << 8  # beside a type's length: the message starts with TimeUS, 64 bits
_TIMED_MS: Final = 1 << 9  # it starts with TimeMS, 32 bits: logs of firmware before 2015 (Copter 3.3)
_TIMED: Final = _TIMED_US | _TIMED_MS
_TIME_US_SIZE: Final = 8
_TIME_MS_SIZE: Final = 4
_MS_US: Final = 1000
_NEAR_US: Final = 10_000_000  # between two messages side by side; what stands there by chance is years away
_ORDER_US: Final = 50_000  # so much earlier than the last message may one be: threads log side by side


def known_types() -> IntArray:
    """The ``types`` that ``scan_dataflash`` learns in, at the beginning of a log."""
    types = np.zeros(256, dtype=np.int64)
    types[FMT_TYPE] = FMT_SIZE
    return types


@njit_inline
def _starts(data: Bytes, at: int) -> bool:
    """Whether the two bytes stand here that every message starts with, as far as the log goes."""
    return at >= len(data) or (data[at] == _FIRST and (at + 1 == len(data) or data[at + 1] == _SECOND))


@njit_inline
def _goes_on(data: Bytes, at: int) -> bool:
    """Whether a message starts at ``at``, or behind the first bytes of heads that were cut off.

    Behind a message that ends in such a byte they count for nothing: it may have lost its own last byte.
    """
    if data[at - 1] != _FIRST:
        while at + 1 < len(data) and data[at] == _FIRST and data[at + 1] == _FIRST:
            at += 1
    return _starts(data, at)


@njit_inline
def _may_hold_head(data: Bytes) -> bool:
    """Whether the first byte of a head is among the bytes; the loop has no early end, so that it is vectorised."""
    found = False
    for i in range(len(data)):
        found |= data[i] == _FIRST
    return found


@njit
def _time_us(data: Bytes, at: int, kind: int) -> int:
    """The time since boot of the message of a type at ``at``; -1 where it has none."""
    time_size = _TIME_US_SIZE if kind & _TIMED_US else _TIME_MS_SIZE
    if not kind & _TIMED or at + HEAD_SIZE + time_size > len(data):
        return -1
    stamp = 0
    for i in range(at + HEAD_SIZE + time_size - 1, at + HEAD_SIZE - 1, -1):
        if stamp >= MAX_STAMP_US >> 8:
            return -1
        stamp = stamp << 8 | int(data[i])
    return stamp if kind & _TIMED_US else stamp * _MS_US


@njit
def _follows(time_us: int, before_us: int) -> bool:
    """Whether a message may have been logged behind one of another time."""
    return -_ORDER_US <= time_us - before_us <= _NEAR_US


@njit
def _is_in_order(data: Bytes, time_us: int, end: int, types: IntArray, last_us: int) -> bool:
    """Whether the time of the message before ``end`` is between that of the last one and that of the next, if any.

    It may be far ahead behind a gap, where the next two go on from it: two side by side may have the same bit flipped.
    """
    next_us, next_end = _next_time(data, end, types)
    if next_us < 0:
        next_us = last_us + _NEAR_US if last_us > 0 else time_us
    if _follows(next_us, last_us):
        return max(last_us - _ORDER_US, 0) <= time_us <= next_us + _ORDER_US
    after_us, _ = _next_time(data, next_end, types)
    is_behind_gap = _follows(next_us, time_us) and (after_us < 0 or _follows(after_us, next_us))
    return time_us >= 0 and (abs(time_us - last_us) <= _ORDER_US or is_behind_gap)


@njit
def _next_time(data: Bytes, at: int, types: IntArray) -> tuple[int, int]:
    """The time since boot of the message at ``at``, if any, and where it ends; -1 where it has none."""
    if at + HEAD_SIZE > len(data):
        return -1, len(data)
    kind = types[data[at + 2]]
    return _time_us(data, at, kind), at + (kind & 0xFF)


@njit
def _judge(data: Bytes, at: int, end: int, types: IntArray, time_us: int, last_us: int) -> int:
    """Whether the message from ``at`` to ``end`` is whole, doubtful or damaged: it has no checksum that would tell.

    It is doubtful where the log does not go on behind it, or its time is not between those of the messages beside it;
    damaged where another message starts within it. What looks like a head by chance has no time near the last one.
    """
    is_timely = not types[data[at + 2]] & _TIMED or _is_in_order(data, time_us, end, types, last_us)
    verdict = _WHOLE if is_timely and _goes_on(data, end) else _DOUBTFUL
    for inner in range(at + len(HEAD), min(end, len(data) - HEAD_SIZE + 1)):
        if not _starts(data, inner) or types[data[inner + 2]] == 0:
            continue
        kind = types[data[inner + 2]]
        inner_us = _time_us(data, inner, kind)
        if inner_us >= 0 and abs(inner_us - last_us) < _NEAR_US:
            return _DAMAGED
        if not kind & _TIMED and _goes_on(data, inner + kind):
            return _DAMAGED
        time_size = _TIME_US_SIZE if kind & _TIMED_US else _TIME_MS_SIZE
        for soon in range(inner + HEAD_SIZE, inner + HEAD_SIZE + time_size):
            if _starts(data, soon):  # the other one is cut off before it has a time
                verdict = _DOUBTFUL
    return verdict


@njit
def _learn_type(data: Bytes, at: int, types: IntArray) -> None:
    """Take in the size of the type that a FMT message declares, and whether it starts with a time."""
    size = int(data[at + 4])
    in_us, in_ms = data[at + _FMT_FORMAT_AT] == ord("Q"), data[at + _FMT_FORMAT_AT] == ord("I")
    for i in range(len(_TIME_US_COLUMN)):
        in_us = in_us and data[at + _FMT_COLUMNS_AT + i] == _TIME_US_COLUMN[i]
        in_ms = in_ms and data[at + _FMT_COLUMNS_AT + i] == _TIME_MS_COLUMN[i]
    if size >= HEAD_SIZE and data[at + 3] != FMT_TYPE:
        types[data[at + 3]] = size | (_TIMED_US if in_us else 0) | (_TIMED_MS if in_ms else 0)


@njit
def scan_dataflash(
    data: Bytes, start: int, limit: int, types: IntArray, rows: IntArray, state: IntArray
) -> tuple[int, int]:
    """Find messages from ``start``, until ``rows`` is full or ``limit`` is passed.

    A doubtful message is found with one byte of what follows it, which tells it from others of its type wherever it is
    kept; a damaged one is not found.

    Args:
        data: The whole file.
        start: Where to go on.
        limit: Where to stop looking.
        types: ``(256,)`` size of each known type, and the mark of those that start with a time; learns.
        rows: ``(3, n)`` filled with each message's offset, its size, and its time since boot in us, -1 where it has
            none or is doubtful.
        state: ``(TLOG_STATE,)``, updated.

    Returns:
        Number of messages, and where to go on.
    """
    at, found, stop, last_us = start, 0, len(data), state[LAST_US]
    while at < min(stop, limit) and found < rows.shape[1]:
        kind, time_us, verdict = 0, -1, _DAMAGED
        if at + HEAD_SIZE <= stop and data[at] == _FIRST and data[at + 1] == _SECOND:
            kind = types[data[at + 2]]
        size = kind & 0xFF
        end = at + size
        if size > 0 and end <= stop:
            time_us, verdict = _time_us(data, at, kind), _WHOLE
            is_plain = _starts(data, end) and abs(time_us - last_us) <= _ORDER_US
            if not is_plain or _may_hold_head(data[at + len(HEAD) : end]):  # seldom
                verdict = _judge(data, at, end, types, time_us, last_us)
        if verdict == _DAMAGED or (verdict == _DOUBTFUL and end == stop):  # no byte follows
            if at == state[AT_SYNC] and (end > stop or stop - at < HEAD_SIZE):
                state[N_TRUNCATED] += 1
            state[N_SKIPPED] += 1
            at += 1
            continue
        if data[at + 2] == FMT_TYPE and (verdict == _WHOLE or types[data[at + 3]] == 0):
            _learn_type(data, at, types)
        if verdict == _DOUBTFUL:
            size, time_us = size + 1, -1
        elif time_us >= 0:
            last_us = time_us
        rows[0, found], rows[1, found], rows[2, found] = at, size, time_us
        found += 1
        state[N_OK] += 1
        state[AT_SYNC] = at = end
    state[LAST_US] = last_us
    return found, at
