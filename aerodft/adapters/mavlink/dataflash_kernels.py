"""The hot loop over the bytes of ArduPilot's logs."""

import numpy as np

from aerodft.adapters.mavlink.dataflash_format import FMT_TYPE, HEAD, HEAD_SIZE
from aerodft.adapters.mavlink.layout import AT_SYNC, MAX_STAMP_US, N_OK, N_SKIPPED, N_TRUNCATED, Bytes
from aerodft.geometry.jit import njit
from aerodft.model.arrays import IntArray

TIMED = 1 << 8  # beside a type's length: the message starts with TimeUS
_FIRST, _SECOND = HEAD
_FMT_FORMAT_AT, _FMT_COLUMNS_AT = 9, 25
_TIME_COLUMN = np.frombuffer(b"TimeUS", dtype=np.uint8)


@njit
def _size_at(data: Bytes, at: int, types: IntArray) -> int:
    """The size of the message that starts at ``at``; 0 where none of a known type does."""
    if at + HEAD_SIZE > len(data) or data[at] != _FIRST or data[at + 1] != _SECOND:
        return 0
    return int(types[data[at + 2]]) & 0xFF


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
def learn(data: Bytes, at: int, types: IntArray) -> None:
    """Take in the size of the type that a FMT message declares, and whether it starts with a time."""
    size = int(data[at + 4])
    timed = data[at + _FMT_FORMAT_AT] == ord("Q")
    for i in range(len(_TIME_COLUMN)):
        timed = timed and data[at + _FMT_COLUMNS_AT + i] == _TIME_COLUMN[i]
    if size >= HEAD_SIZE and data[at + 3] != FMT_TYPE:
        types[data[at + 3]] = size | (TIMED if timed else 0)


@njit
def _whole(data: Bytes, at: int, size: int, synced: bool, types: IntArray) -> bool:  # noqa: FBT001 - numba
    """Whether a message may stand here: there is no checksum, so after damage the next one must follow at once."""
    end = at + size
    if size == 0 or end > len(data):
        return False
    return synced or end == len(data) or _size_at(data, end, types) > 0


@njit
def scan_dataflash(
    data: Bytes, start: int, limit: int, types: IntArray, rows: IntArray, state: IntArray
) -> tuple[int, int]:
    """Find messages from ``start``, until ``rows`` is full or ``limit`` is passed.

    Args:
        data: The whole file.
        start: Where to go on.
        limit: Where to stop looking.
        types: ``(256,)`` size of each known type, and ``TIMED``; learns.
        rows: ``(3, n)`` filled with each message's offset, its size, and its time since boot in us,
            -1 where it has none.
        state: ``(STATE_SIZE,)``, updated.

    Returns:
        Number of messages, and where to go on.
    """
    at, found, stop = start, 0, len(data)
    while at < min(stop, limit) and found < rows.shape[1]:
        kind, synced = 0, at == state[AT_SYNC]
        # As ``_size_at``: such calls would take most of the time.
        if at + HEAD_SIZE <= stop and data[at] == _FIRST and data[at + 1] == _SECOND:
            kind = types[data[at + 2]]
        size = kind & 0xFF
        is_due = synced and size > 0 and at + size <= stop
        if not is_due and not _whole(data, at, size, synced, types):
            if synced and (at + size > stop or stop - at < HEAD_SIZE):
                state[N_TRUNCATED] += 1
            state[N_SKIPPED] += 1
            at += 1
            continue
        end = at + size
        if data[at + 2] == FMT_TYPE:
            learn(data, at, types)
        timed = kind & TIMED and at + HEAD_SIZE + 8 <= stop
        rows[0, found], rows[1, found] = at, size
        rows[2, found] = _time_us(data, at + HEAD_SIZE) if timed else -1
        found += 1
        state[N_OK] += 1
        state[AT_SYNC] = end
        at = end
    return found, at
