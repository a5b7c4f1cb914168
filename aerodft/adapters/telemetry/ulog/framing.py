"""Messages found in the bytes of a ULog file, damaged ones left out.

ULog has no checksum. A message counts where its head is plausible, its data are of its topic's size, its time goes on
from the message before, and another plausible message follows.
"""

from typing import Final

import numpy as np

from aerodft.adapters.telemetry.mavlink import AT_SYNC, LAST_US, MAX_STAMP_US, N_OK, N_SKIPPED, N_TRUNCATED, Bytes
from aerodft.jit import njit
from aerodft.model import IntArray

MAGIC: Final = (0x55, 0x4C, 0x6F, 0x67, 0x01, 0x12, 0x35)
FILE_HEADER_SIZE: Final = 16  # magic, version, and the log's start (us since boot)
HEAD_SIZE: Final = 3  # size of what follows (u16), and the message's kind
ID_SIZE: Final = 2  # a data message begins with the number of its subscription
KIND_AT: Final = 2
MOST_BYTES: Final = HEAD_SIZE + 0xFFFF
DATA, FORMAT, SUBSCRIPTION, FLAGS, DROPOUT = (ord(each) for each in "DFABO")
LEAST, MOST, TIME_AT = 0, 1, 2  # rows of ``topic_table``

_SYNC = ord("S")
_SMALLEST: Final = np.zeros(256, dtype=np.int64)  # payload bytes by kind; 0 for what is no kind
for _kind, _bytes in {
    "D": ID_SIZE + 8,  # every topic has a timestamp
    "F": 3,
    "A": 4,
    "R": 2,
    "I": 3,
    "M": 4,
    "P": 3,
    "Q": 4,
    "L": 9,
    "C": 11,
    "S": 8,
    "O": 2,
    "B": 40,
}.items():
    _SMALLEST[ord(_kind)] = _bytes
_SMALLEST.setflags(write=False)
_LARGEST: Final = 10_000  # bytes of a message that is no data: pyulog takes larger ones for damage too
_TIME_SIZE: Final = 8
# A log that pauses for longer is resumed by a jump that the next message confirms. Half of it would take the pauses of
# logging from arming to disarming for damage in each message, twice would let a flipped bit of 2^26 us pass.
_NEAR_US: Final = 60_000_000
_LOOK_AHEAD: Final = 64  # messages in which the next time is looked for


def topic_table() -> IntArray:
    """``(3, 65536)`` least and most bytes of a topic's data and where its time is, by subscription; 0 for none."""
    return np.zeros((3, 1 << 16), dtype=np.int64)


@njit
def _size(data: Bytes, at: int, topics: IntArray) -> int:
    """Bytes of the message at ``at``; 0 where none can be, -1 where the bytes end before."""
    if at + HEAD_SIZE > len(data):
        return -1
    size, kind = int(data[at]) | int(data[at + 1]) << 8, data[at + KIND_AT]
    if _SMALLEST[kind] == 0 or size < _SMALLEST[kind] or (kind != DATA and size > _LARGEST):
        return 0
    if (kind == _SYNC and size != _SMALLEST[kind]) or (kind == DROPOUT and size != _SMALLEST[kind]):
        return 0
    if kind == DATA:
        if at + HEAD_SIZE + ID_SIZE > len(data):
            return -1
        number = int(data[at + HEAD_SIZE]) | int(data[at + HEAD_SIZE + 1]) << 8
        if not topics[LEAST, number] <= size - ID_SIZE <= topics[MOST, number]:
            return 0
    return HEAD_SIZE + size if at + HEAD_SIZE + size <= len(data) else -1


@njit
def _number(data: Bytes, at: int, size: int) -> int:
    """Unsigned little-endian integer; ``MAX_STAMP_US`` where it is not less than that."""
    value = 0
    for i in range(at + size - 1, at - 1, -1):
        if value >= MAX_STAMP_US >> 8:
            return MAX_STAMP_US
        value = value << 8 | int(data[i])
    return value


@njit
def _time_us(data: Bytes, at: int, topics: IntArray) -> int:
    """Time of the message at ``at``; -1 where its kind has none."""
    if data[at + KIND_AT] != DATA:
        return -1
    number = _number(data, at + HEAD_SIZE, ID_SIZE)
    return _number(data, at + HEAD_SIZE + ID_SIZE + topics[TIME_AT, number], _TIME_SIZE)


@njit
def _is_timely(data: Bytes, at: int, end: int, topics: IntArray, last_us: int) -> bool:
    """Whether the time of the data at ``at`` is not far ahead of the last one, or the next message's is there too.

    Old times are right: at its start a log repeats what was published long before.
    """
    time_us = _time_us(data, at, topics)
    if time_us >= MAX_STAMP_US:
        return False
    if time_us <= last_us + _NEAR_US or last_us == 0:
        return True
    for _ in range(_LOOK_AHEAD):
        size = _size(data, end, topics)
        if size <= 0:
            return False
        next_us = _time_us(data, end, topics)
        if next_us > last_us + _NEAR_US:
            return abs(next_us - time_us) <= _NEAR_US
        if next_us >= 0:
            return False
        end += size
    return False


@njit
def _is_first_of(data: Bytes, at: int, end: int) -> bool:
    """Whether data of the subscription at ``at``, whose size is not learned yet, follow at ``end``."""
    if end + HEAD_SIZE + ID_SIZE > len(data) or data[end + KIND_AT] != DATA:
        return False
    return _number(data, end + HEAD_SIZE, ID_SIZE) == _number(data, at + HEAD_SIZE + 1, ID_SIZE)


@njit
def _is_file_header(data: Bytes, at: int) -> bool:
    if at + FILE_HEADER_SIZE > len(data):
        return False
    is_magic = True
    for i in range(len(MAGIC)):
        is_magic &= data[at + i] == MAGIC[i]
    return is_magic


@njit
def scan_ulog(  # noqa: PLR0913, PLR0917 - a compiled loop takes its state one by one
    data: Bytes, start: int, limit: int, cut: int, topics: IntArray, rows: IntArray, first: int, state: IntArray
) -> tuple[int, int]:
    """Find messages from ``start``, until ``rows`` is full, ``limit`` is passed, or a definition was found.

    Args:
        data: Bytes of the file.
        start: Where to go on.
        limit: Where to stop looking.
        cut: Where data were appended after a crash: no message reaches over it.
        topics: As of ``topic_table``.
        rows: ``(3, n)`` filled from row ``first`` on with each message's offset, its size, and the log's time in us.
        first: So many rows are filled already.
        state: ``(TLOG_STATE,)``, updated.

    Returns:
        Number of rows that are filled, and where to go on.
    """
    at, found = start, first
    while at < min(len(data), limit) and found < rows.shape[1]:
        kind, is_good, size = 0, False, 0
        if _is_file_header(data, at):
            size, is_good = FILE_HEADER_SIZE, True
            start_us = _number(data, at + FILE_HEADER_SIZE - _TIME_SIZE, _TIME_SIZE)
            if state[LAST_US] == 0 and start_us < MAX_STAMP_US:
                state[LAST_US] = start_us
        else:
            size = _size(data, at, topics)
            end = at + size
            if size > 0 and not at < cut < end:
                kind = data[at + KIND_AT]
                is_good = end in (len(data), cut) or _size(data, end, topics) != 0
                is_good = is_good or (kind == SUBSCRIPTION and _is_first_of(data, at, end))
                is_good = is_good and (kind != DATA or _is_timely(data, at, end, topics, state[LAST_US]))
        if not is_good:
            if size < 0 and at == state[AT_SYNC]:
                state[N_TRUNCATED] += 1
            state[N_SKIPPED] += 1
            at += 1
            continue
        if kind == DATA:
            state[LAST_US] = max(state[LAST_US], _time_us(data, at, topics))
        rows[0, found], rows[1, found], rows[2, found] = at, size, state[LAST_US]
        found += 1
        state[N_OK] += 1
        state[AT_SYNC] = at = at + size
        if kind in (FORMAT, SUBSCRIPTION, FLAGS):
            break
    return found, at
