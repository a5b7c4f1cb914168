"""Messages found in the bytes of a .bin log, damaged ones left out."""

from typing import Final

import numpy as np

from aerodft.adapters.telemetry.mavlink import AT_SYNC, MAX_STAMP_US, N_OK, N_SKIPPED, N_TRUNCATED, Bytes
from aerodft.jit import njit, njit_inline
from aerodft.model import IntArray

HEAD: Final = (0xA3, 0x95)
HEAD_SIZE: Final = 3
FMT_TYPE: Final = 128
FMT_SIZE: Final = 89
TYPES: Final = 256
NEAR_US: Final = 10_000_000
"""Of two messages side by side; one that stands there by chance is years away."""

_FIRST, _SECOND = HEAD
_FMT_FORMAT_AT, _FMT_COLUMNS_AT = 9, 25
_TIME_COLUMN: Final = np.frombuffer(b"TimeUS", dtype=np.uint8)
_TIMED: Final = 1 << 8  # beside a type's length: the message starts with TimeUS
_TIME_SIZE: Final = 8
_MOST_HALF_HEADS: Final = 8  # one behind the other, where a log goes on


def known_types() -> IntArray:
    """The ``types`` that ``scan_dataflash`` learns in, at the beginning of a log."""
    types = np.zeros(TYPES, dtype=np.int64)
    types[FMT_TYPE] = FMT_SIZE
    return types


@njit_inline
def _starts(data: Bytes, at: int) -> bool:
    """Whether the two bytes stand here that every message starts with."""
    return at + 1 < len(data) and data[at] == _FIRST and data[at + 1] == _SECOND


@njit_inline
def _may_hold_head(data: Bytes) -> bool:
    """Whether the first byte of a head is among the bytes; the loop has no early end, so that it is vectorised."""
    found = False
    for i in range(len(data)):
        found |= data[i] == _FIRST
    return found


@njit
def _goes_on(data: Bytes, at: int, types: IntArray) -> bool:
    """Whether a message starts at ``at``, or the log ends.

    A head with one wrong byte is one where the log goes on behind the message that it is the head of; of heads that
    were cut off, their first byte may be left.
    """
    for _ in range(_MOST_HALF_HEADS):
        if at >= len(data):
            break
        first, second = data[at] == _FIRST, at + 1 >= len(data) or data[at + 1] == _SECOND
        if first and second:
            return True
        if first and data[at + 1] == _FIRST:
            at += 1
            continue
        size = types[data[at + 2]] & 0xFF if at + 2 < len(data) else 0
        if size == 0 or not (first or second):
            return False
        at += size
    return at == len(data)


@njit
def _is_near(data: Bytes, one: int, other: int, types: IntArray) -> bool:
    """Whether messages that start at two places were logged at nearly one time; not where one has none."""
    for at in (one, other):
        if at + HEAD_SIZE + _TIME_SIZE > len(data) or not types[data[at + 2]] & _TIMED:
            return False
    one_us, other_us = _time_us(data, one + HEAD_SIZE), _time_us(data, other + HEAD_SIZE)
    return min(one_us, other_us) >= 0 and abs(one_us - other_us) < NEAR_US


@njit
def _holds_another(data: Bytes, at: int, end: int, types: IntArray) -> bool:
    """Whether another message starts before a message ends, by their bytes from ``at`` to ``end``.

    A head may stand there by chance: then no other comes soon, the log does not go on behind its message, and its time
    is another one, while what follows at the end is of the message's own.
    """
    if _starts(data, end - 2):
        return True
    for inner in range(at + len(HEAD), min(end, len(data) - HEAD_SIZE + 1)):
        if not _starts(data, inner) or types[data[inner + 2]] == 0:
            continue
        if inner < at + HEAD_SIZE and _starts(data, end) and not _is_near(data, inner, end, types):
            continue  # a type and a time that look like a head, not a head without a type
        if (
            not types[data[inner + 2]] & _TIMED
            or _is_near(data, at, inner, types)
            or not _is_near(data, at, end, types)
        ):
            return True
        inner_end = inner + (types[data[inner + 2]] & 0xFF)
        if inner_end != end and _goes_on(data, inner_end, types):
            return True
        for soon in range(inner + HEAD_SIZE, inner + HEAD_SIZE + _TIME_SIZE):
            if _starts(data, soon):
                return True
    return False


@njit
def _time_us(data: Bytes, at: int) -> int:
    """The time since boot of a message that begins with it, at ``at``; -1 where it is none."""
    stamp = 0
    for i in range(7, -1, -1):
        if stamp >= MAX_STAMP_US >> 8:
            return -1
        stamp = stamp << 8 | int(data[at + i])
    return stamp


@njit
def _learn_type(data: Bytes, at: int, types: IntArray) -> None:
    """Take in the size of the type that a FMT message declares, and whether it starts with a time."""
    size = int(data[at + 4])
    timed = data[at + _FMT_FORMAT_AT] == ord("Q")
    for i in range(len(_TIME_COLUMN)):
        timed = timed and data[at + _FMT_COLUMNS_AT + i] == _TIME_COLUMN[i]
    if size >= HEAD_SIZE and data[at + 3] != FMT_TYPE:
        types[data[at + 3]] = size | (_TIMED if timed else 0)


@njit
def scan_dataflash(
    data: Bytes, start: int, limit: int, types: IntArray, rows: IntArray, state: IntArray
) -> tuple[int, int]:
    """Find messages from ``start``, until ``rows`` is full or ``limit`` is passed.

    Args:
        data: The whole file.
        start: Where to go on.
        limit: Where to stop looking.
        types: ``(256,)`` size of each known type, and the mark of those that start with a time; learns.
        rows: ``(3, n)`` filled with each message's offset, its size, negative where damage follows, and its time
            since boot in us, -1 where it has none.
        state: ``(STATE_SIZE,)``, updated.

    Returns:
        Number of messages, and where to go on.
    """
    at, found, stop = start, 0, len(data)
    while at < min(stop, limit) and found < rows.shape[1]:
        kind, synced = 0, at == state[AT_SYNC]
        if at + HEAD_SIZE <= stop and data[at] == _FIRST and data[at + 1] == _SECOND:
            kind = types[data[at + 2]]
        size = kind & 0xFF
        end = at + size
        is_whole, is_sure = size > 0 and end <= stop, True
        if is_whole and (not _starts(data, end) or _may_hold_head(data[at + len(HEAD) : end])):  # seldom
            is_whole = not _holds_another(data, at, end, types)
            is_sure = _goes_on(data, end, types) or not kind & _TIMED  # without a time it reaches no pose
        if not is_whole:
            if synced and (end > stop or stop - at < HEAD_SIZE):
                state[N_TRUNCATED] += 1
            state[N_SKIPPED] += 1
            at += 1
            continue
        if data[at + 2] == FMT_TYPE:
            _learn_type(data, at, types)
        timed = kind & _TIMED and at + HEAD_SIZE + 8 <= stop
        rows[0, found], rows[1, found] = at, size if is_sure else -size
        rows[2, found] = _time_us(data, at + HEAD_SIZE) if timed else -1
        found += 1
        state[N_OK] += 1
        state[AT_SYNC] = end
        at = end
    return found, at
