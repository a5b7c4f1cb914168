"""The hot loops over MAVLink bytes: checksum, frame check, scanners, headers, arrival stamps.

They stand in one module because compiled code that is kept on disk is renewed only when its own file changes: a loop
that calls one from another file would go on running the other's old version.
"""

import numpy as np
import numpy.typing as npt

from aerodft.geometry.jit import njit
from aerodft.model.arrays import IntArray

Bytes = npt.NDArray[np.uint8]
Table = npt.NDArray[np.int32]

FRAME, NOTHING, INCOMPLETE, UNKNOWN, BAD_CRC = 0, 1, 2, 3, 4  # verdicts of ``probe``
MIN_FRAME = 8
MAX_FRAME = 280
# Where the scanners' state keeps what: counters, then positions in the buffer.
N_OK, N_BAD_CRC, N_UNKNOWN, N_SKIPPED, N_TRUNCATED, AT_SYNC, AT_QUIET, STATE_SIZE = 0, 1, 2, 3, 4, 5, 6, 7

LAST_US, BACKWARDS, TLOG_STATE = 7, 8, 9  # what the state of a log with stamps has beside
STAMP_SIZE = 8
JUMP_US = 60_000_000
BACK_US = 1_000_000
MAX_STAMP_US = 1 << 52  # year 2112; its nanoseconds still fit 64 bits

_V1, _V2 = 0xFE, 0xFD
_V1_HEAD, _V2_HEAD = 6, 10
_SIGNED = 1
_SIGNATURE = 13
_TABLE_IDS = 1 << 16


def _crc_tables() -> npt.NDArray[np.uint16]:
    """``(8, 256)`` remainders of CRC-16/MCRF4XX, MAVLink's checksum (X.25's polynomial, reflected).

    Row ``k`` has those of a byte with ``k`` zero bytes after it.
    """
    values = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        values = np.where(values & 1, (values >> 1) ^ np.uint16(0x8408), values >> 1)
    rows = [values]
    for _ in range(7):
        rows.append((rows[-1] >> 8) ^ values[rows[-1] & 0xFF])
    return np.stack(rows)


_CRC = _crc_tables()


@njit
def checksum(data: Bytes, start: int, stop: int, extra: int) -> int:
    """The checksum over ``data[start:stop]`` and the message's CRC_EXTRA.

    Eight bytes at a time: their remainders do not wait for each other (Kounavis and Berry 2005, "slicing by 8").
    """
    crc = np.uint16(0xFFFF)
    at = start
    while at + 8 <= stop:
        first = data[at] ^ np.uint8(crc & np.uint16(0xFF))
        second = data[at + 1] ^ np.uint8(crc >> np.uint16(8))
        crc = _CRC[7, first] ^ _CRC[6, second] ^ _CRC[5, data[at + 2]] ^ _CRC[4, data[at + 3]]
        crc ^= _CRC[3, data[at + 4]] ^ _CRC[2, data[at + 5]] ^ _CRC[1, data[at + 6]] ^ _CRC[0, data[at + 7]]
        at += 8
    for i in range(at, stop):
        crc = (crc >> np.uint16(8)) ^ _CRC[0, data[i] ^ np.uint8(crc & np.uint16(0xFF))]
    return int((crc >> np.uint16(8)) ^ _CRC[0, np.uint8(extra) ^ np.uint8(crc & np.uint16(0xFF))])


@njit
def measure(data: Bytes, at: int, stop: int, table: Table) -> tuple[int, int, int]:
    """What the header at ``at`` claims, before any checksum.

    Returns:
        ``FRAME`` where a frame may stand, else the verdict; the claimed size of the frame in bytes (0 where nothing is
        claimed); and the message's CRC_EXTRA.
    """
    magic = data[at]
    if magic not in (_V1, _V2):
        return NOTHING, 0, 0
    head = _V1_HEAD if magic == _V1 else _V2_HEAD
    if at + head > stop:
        return INCOMPLETE, 0, 0
    length = int(data[at + 1])
    size = head + length + 2
    message_id = int(data[at + 5])
    if magic == _V2:
        message_id = int(data[at + 7]) | int(data[at + 8]) << 8 | int(data[at + 9]) << 16
        flags = data[at + 2]
        if flags & ~_SIGNED:
            return NOTHING, 0, 0  # the protocol forbids to read on under a flag that one does not know
        if flags & _SIGNED:
            size += _SIGNATURE
    entry = int(table[message_id]) if message_id < _TABLE_IDS else -1
    # MAVLink 1 has no truncation; in MAVLink 2 a later dialect may have added fields.
    if entry < 0 or length < 1 or (magic == _V1 and not ((entry >> 8) & 0xFF) <= length <= entry >> 16):
        return UNKNOWN, size, 0
    return (FRAME if at + size <= stop else INCOMPLETE), size, entry & 0xFF


@njit
def probe(data: Bytes, at: int, stop: int, table: Table) -> tuple[int, int]:
    """Whether a frame stands at ``at``.

    Returns:
        The verdict, and the claimed size of the frame in bytes (0 where nothing is claimed).
    """
    verdict, size, extra = measure(data, at, stop, table)
    if verdict == FRAME:
        end = at + size - 2
        if data[at] == _V2 and data[at + 2] & _SIGNED:
            end -= _SIGNATURE
        crc = checksum(data, at + 1, end, extra)
        if data[end] != crc & 0xFF or data[end + 1] != crc >> 8:
            verdict = BAD_CRC
    return verdict, size


@njit
def note_damage(state: IntArray, at: int, verdict: int, size: int) -> None:
    """Count what stands at ``at`` instead of a frame.

    Only where a frame was due is a bad one counted: its inside is full of things that look like frames.
    """
    if at == state[AT_SYNC]:
        if verdict == BAD_CRC:
            state[N_BAD_CRC] += 1
        elif verdict == UNKNOWN:
            state[N_UNKNOWN] += 1
            state[AT_QUIET] = at + size
        elif verdict == INCOMPLETE:
            state[N_TRUNCATED] += 1
            size = MAX_FRAME  # nothing more is due
        state[AT_SYNC] = at + size
    if at >= state[AT_QUIET]:
        state[N_SKIPPED] += 1


@njit
def scan_stream(
    data: Bytes, *, final: bool, table: Table, offsets: IntArray, lengths: IntArray, state: IntArray
) -> tuple[int, int]:
    """Find the frames of a byte stream.

    Args:
        data: The bytes so far.
        final: Whether nothing follows; else an incomplete frame at the end is waited for.
        table: ``frame_table()``.
        offsets: ``(n,)`` filled with the start of each frame.
        lengths: ``(n,)`` filled with the size of each frame.
        state: ``(STATE_SIZE,)``, updated.

    Returns:
        Number of frames, and number of bytes that are done with.
    """
    at, found, stop = 0, 0, len(data)
    while at < stop and found < len(offsets):
        verdict, size = probe(data, at, stop, table)
        if verdict == FRAME:
            offsets[found], lengths[found] = at, size
            found += 1
            state[N_OK] += 1
            at += size
            state[AT_SYNC] = at
            continue
        if verdict == INCOMPLETE and not final:
            break
        note_damage(state, at, verdict, size)
        at += 1
    return found, at


@njit
def big_endian_stamp(data: Bytes, at: int) -> int:
    """The 8-byte big-endian stamp in front of a tlog's frame; -1 where it cannot be one."""
    stamp = 0
    for i in range(8):
        if i == 1 and stamp != 0:
            return -1
        stamp = stamp << 8 | int(data[at + i])
    return stamp if stamp < MAX_STAMP_US else -1


@njit
def settle(stamp_us: int, last_us: int, following_us: int) -> int:
    """The arrival of a record, not before the last one.

    A jump forward is believed only when the record that follows confirms it: one garbled stamp in the far future would
    otherwise carry the rest of the file along.

    Args:
        stamp_us: As read; -1 where unreadable.
        last_us: The previous arrival; 0 before the first.
        following_us: The next record's stamp; -1 where there is none.
    """
    if stamp_us <= last_us:
        return last_us
    if stamp_us - last_us <= JUMP_US or abs(following_us - stamp_us) <= JUMP_US:
        return stamp_us
    if following_us < 0:
        return last_us if last_us > 0 else stamp_us
    return max(last_us, min(stamp_us, following_us))


@njit
def settle_all(stamps_us: IntArray, last_us: int) -> None:
    """Replace stamps ``(n,)``, -1 where a record has none, by arrivals that do not decrease (see ``settle``)."""
    following = -1
    nexts = np.empty_like(stamps_us)
    for k in range(len(stamps_us) - 1, -1, -1):
        nexts[k] = following
        if stamps_us[k] >= 0:
            following = stamps_us[k]
    for k in range(len(stamps_us)):
        last_us = settle(stamps_us[k], last_us, nexts[k])
        stamps_us[k] = last_us


@njit
def following_stamp(data: Bytes, at: int) -> int:
    """The stamp of the record that should start at ``at``; -1 where none does."""
    if at + STAMP_SIZE >= len(data) or data[at + STAMP_SIZE] not in (_V1, _V2):
        return -1
    return big_endian_stamp(data, at)


@njit
def scan_tlog(data: Bytes, start: int, limit: int, table: Table, rows: IntArray, state: IntArray) -> tuple[int, int]:
    """Find records from ``start``, until ``rows`` is full or ``limit`` is passed.

    Args:
        data: The whole file.
        start: Where to go on.
        limit: Where to stop looking.
        table: ``frame_table()``.
        rows: ``(3, n)`` filled with each frame's offset, its size, and its arrival in us.
        state: ``(TLOG_STATE,)``, updated.

    Returns:
        Number of frames, and where to go on.
    """
    at, found, stop = start, 0, len(data)
    while at < min(stop, limit) and found < rows.shape[1]:
        verdict, size = INCOMPLETE, 0
        if at + STAMP_SIZE < stop:
            verdict, size = probe(data, at + STAMP_SIZE, stop, table)
        if verdict == FRAME:
            end = at + STAMP_SIZE + size
            stamp = big_endian_stamp(data, at)
            if 0 <= stamp < state[LAST_US] - BACK_US:
                state[BACKWARDS] += 1
            state[LAST_US] = settle(stamp, state[LAST_US], following_stamp(data, end))
            rows[0, found], rows[1, found], rows[2, found] = at + STAMP_SIZE, size, state[LAST_US]
            found += 1
            state[N_OK] += 1
            state[AT_SYNC] = end
            at = end
        else:
            note_damage(state, at, verdict, size + STAMP_SIZE)
            at += 1
    return found, at


@njit
def read_headers(data: Bytes, frames: IntArray, table: Table, heads: IntArray, *, checked: bool) -> None:
    """Check frames and take their headers apart.

    Args:
        data: A block's bytes.
        checked: Whether their checksums are known to be right.
        frames: ``(2, n)`` offset and length of each frame.
        table: ``frame_table()``.
        heads: ``(5, n)`` filled with message id (-1: no good frame), system, component, payload's start and length.
    """
    for k in range(frames.shape[1]):
        at, size = frames[0, k], frames[1, k]
        heads[0, k] = -1
        if at < 0 or size < MIN_FRAME or at + size > len(data):
            continue
        if checked:
            verdict, claimed, _ = measure(data, at, at + size, table)
        else:
            verdict, claimed = probe(data, at, at + size, table)
        if verdict != FRAME or claimed != size:
            continue
        first = at + 3
        heads[0, k], heads[3, k] = data[at + 5], at + _V1_HEAD
        if data[at] == _V2:
            first = at + 5
            heads[0, k] = np.int64(data[at + 7]) | np.int64(data[at + 8]) << 8 | np.int64(data[at + 9]) << 16
            heads[3, k] = at + _V2_HEAD
        heads[1, k], heads[2, k], heads[4, k] = data[first], data[first + 1], data[at + 1]
