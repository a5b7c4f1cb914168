"""What MAVLink frames and logs are laid out like, and the hot loops over their bytes.

The loops are checksum, frame check, scanners, arrivals, headers and payloads. They stand in one module because compiled
code that is kept on disk is renewed only when its own file changes: a loop that calls one from another file goes on
running the other's old version until this one is touched.
"""

import numpy as np
import numpy.typing as npt

from aerodft.adapters.telemetry.mavlink.dialect import TABLE_IDS
from aerodft.jit import njit
from aerodft.model import IntArray

Bytes = npt.NDArray[np.uint8]
Table = npt.NDArray[np.int32]

FRAME, NOTHING, INCOMPLETE, UNKNOWN, BAD_CRC = 0, 1, 2, 3, 4  # verdicts of ``probe``
MIN_FRAME = 8
MAX_FRAME = 280
# Where the scanners' state keeps what: counters, then positions in the buffer.
N_OK, N_BAD_CRC, N_UNKNOWN, N_SKIPPED, N_TRUNCATED, SHARED, AT_SYNC, AT_QUIET, STATE_SIZE = 0, 1, 2, 3, 4, 5, 6, 7, 8

LAST_US, BACKWARDS, TLOG_STATE = 8, 9, 10  # what the state of a log with stamps has beside
STAMP_SIZE = 8
JUMP_US = 60_000_000
BACK_US = 1_000_000
MAX_STAMP_US = 1 << 52  # year 2112; its nanoseconds still fit 64 bits

V1, V2 = 0xFE, 0xFD
V1_HEAD, V2_HEAD = 6, 10
SIGNED = 1
SIGNATURE = 13
MOST_SHARED = SIGNATURE + 1  # bytes of a cut frame that the next one may have begun in


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
    if at + 4 <= stop:
        first = data[at] ^ np.uint8(crc & np.uint16(0xFF))
        second = data[at + 1] ^ np.uint8(crc >> np.uint16(8))
        crc = _CRC[3, first] ^ _CRC[2, second] ^ _CRC[1, data[at + 2]] ^ _CRC[0, data[at + 3]]
        at += 4
    for i in range(at, stop):
        crc = (crc >> np.uint16(8)) ^ _CRC[0, data[i] ^ np.uint8(crc & np.uint16(0xFF))]
    return int((crc >> np.uint16(8)) ^ _CRC[0, np.uint8(extra) ^ np.uint8(crc & np.uint16(0xFF))])


@njit
def measure(data: Bytes, at: int, stop: int, table: Table) -> tuple[int, int, int]:
    """Size of the frame that the header at ``at`` claims, before any checksum.

    Returns:
        ``FRAME`` where a frame may stand, else the verdict; the claimed size of the frame in bytes (0 where nothing is
        claimed); and the message's CRC_EXTRA.
    """
    magic = data[at]
    if magic not in (V1, V2):
        return NOTHING, 0, 0
    head = V1_HEAD if magic == V1 else V2_HEAD
    if at + head > stop:
        return INCOMPLETE, 0, 0
    length = int(data[at + 1])
    size = head + length + 2
    message_id = int(data[at + 5])
    if magic == V2:
        message_id = int(data[at + 7]) | int(data[at + 8]) << 8 | int(data[at + 9]) << 16
        flags = int(data[at + 2])
        if flags & ~SIGNED:
            return NOTHING, 0, 0  # the protocol forbids to read on under a flag that one does not know
        if flags & SIGNED:
            size += SIGNATURE
    entry = int(table[message_id]) if message_id < TABLE_IDS else -1
    # MAVLink 1 cuts nothing off; MAVLink 2 zeros, some senders all, and a later dialect may have added fields.
    if entry < 0 or (magic == V1 and not ((entry >> 8) & 0xFF) <= length <= entry >> 16):
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
        if data[at] == V2 and data[at + 2] & SIGNED:
            end -= SIGNATURE
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
def shared_tail(data: Bytes, at: int, end: int) -> int:
    """Bytes at the end of the frame ``data[at:end]`` that may be the next one's: its last, or its signature.

    The checksum covers neither: where the frame was cut there, what it lacks is taken from the next one's start.
    """
    signed = data[at] == V2 and data[at + 2] & SIGNED
    for first in range(end - MOST_SHARED if signed else end - 1, end):
        if data[first] in (V1, V2):
            return end - first
    return 0


@njit
def scan_stream(
    data: Bytes, *, given_up: int, table: Table, offsets: IntArray, lengths: IntArray, state: IntArray
) -> tuple[int, int]:
    """Find the frames of a byte stream.

    A frame that was cut at its end may be made whole by the next frame's first bytes: then both count (``SHARED``).

    Args:
        data: The bytes so far; with ``SHARED`` so many of them ended the last frame.
        given_up: So many of them begin nothing that is not whole by now; an incomplete frame behind is waited for.
        table: ``frame_table()``.
        offsets: ``(n,)`` filled with the start of each frame.
        lengths: ``(n,)`` filled with the size of each frame.
        state: ``(STATE_SIZE,)``, updated.

    Returns:
        Number of frames, and number of bytes that are done with.
    """
    at, found, stop = int(state[SHARED]), 0, len(data)
    while at < stop and found < len(offsets):
        verdict, size = probe(data, at, stop, table)
        waits = verdict == INCOMPLETE and at >= given_up
        for early in range(at if waits else at - int(state[SHARED]), at):
            shared, shared_size = probe(data, early, stop, table)
            if shared == FRAME:
                at, verdict, size = early, shared, shared_size
                break
            waits = waits or (shared == INCOMPLETE and early >= given_up)
        if waits and verdict != FRAME:
            break
        state[SHARED] = 0
        if verdict == FRAME:
            offsets[found], lengths[found] = at, size
            found += 1
            state[N_OK] += 1
            at += size
            state[AT_SYNC] = at
            state[SHARED] = shared_tail(data, at - size, at)
            continue
        note_damage(state, at, verdict, size)
        at += 1
    return found, at - int(state[SHARED])


@njit
def overlapping(data: Bytes, end: int, table: Table) -> int:
    """Start of the record whose frame begins shortly before or after ``end``, at most a stamp later; else -1.

    A cut frame may be made whole by the first bytes of the next record, which are then short of their stamp, and where
    a signature was cut of their first bytes.
    """
    for at in range(max(end - MOST_SHARED, 0), end):
        if at + STAMP_SIZE < len(data) and probe(data, at + STAMP_SIZE, len(data), table)[0] == FRAME:
            return at
    return -1


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
def following_stamp(data: Bytes, at: int) -> int:
    """The stamp of the record that should start at ``at``; -1 where none does."""
    if at + STAMP_SIZE >= len(data) or data[at + STAMP_SIZE] not in (V1, V2):
        return -1
    return big_endian_stamp(data, at)


@njit
def plausible_stamp(stamp_us: int, last_us: int, following_us: int) -> int:
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
def plausible_stamps(stamps_us: IntArray, last_us: int, behind_us: int) -> None:
    """Replace stamps ``(n,)``, -1 where unreadable, by arrivals that do not decrease (``plausible_stamp``).

    Args:
        stamps_us: Replaced in place.
        last_us: The arrival before them; 0 for none.
        behind_us: The first readable stamp behind them; -1 for none.
    """
    following_us = np.full(len(stamps_us) + 1, behind_us)
    for k in range(len(stamps_us) - 1, -1, -1):  # the first readable stamp from each on
        following_us[k] = stamps_us[k] if stamps_us[k] >= 0 else following_us[k + 1]
    for k in range(len(stamps_us)):
        stamps_us[k] = last_us = plausible_stamp(stamps_us[k], last_us, following_us[k + 1])


@njit
def _arrival_after_jump(stamp_us: int, following_us: int, state: IntArray) -> int:
    """The arrival of a record whose stamp does not go on from the last one."""
    if 0 <= stamp_us < state[LAST_US] - BACK_US:
        state[BACKWARDS] += 1
    return plausible_stamp(stamp_us, int(state[LAST_US]), following_us)


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
        verdict, size, extra, first = INCOMPLETE, 0, 0, at + STAMP_SIZE
        if first < stop:
            verdict, size, extra = measure(data, first, stop, table)
        if verdict == FRAME:  # as ``probe``, the call of which would take as long as all the rest
            end = first + size - 2
            if data[first] == V2 and data[first + 2] & SIGNED:
                end -= SIGNATURE
            crc = checksum(data, first + 1, end, extra)
            if data[end] != crc & 0xFF or data[end + 1] != crc >> 8:
                verdict = BAD_CRC
        if verdict != FRAME and at == state[AT_SYNC]:
            early = overlapping(data, at, table)
            if early >= 0:
                at = early
                verdict, size = probe(data, at + STAMP_SIZE, stop, table)
        if verdict == FRAME:
            end = at + STAMP_SIZE + size
            stamp = big_endian_stamp(data, at)
            if not 0 <= stamp - state[LAST_US] <= JUMP_US:  # what follows is seldom needed
                stamp = _arrival_after_jump(stamp, following_stamp(data, end), state)
            state[LAST_US] = stamp
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
        heads[0, k], heads[3, k] = data[at + 5], at + V1_HEAD
        if data[at] == V2:
            first = at + 5
            heads[0, k] = np.int64(data[at + 7]) | np.int64(data[at + 8]) << 8 | np.int64(data[at + 9]) << 16
            heads[3, k] = at + V2_HEAD
        heads[1, k], heads[2, k], heads[4, k] = data[first], data[first + 1], data[at + 1]


@njit
def copy_payloads(data: Bytes, places: IntArray, out: Bytes) -> None:
    """Copy payloads to rows of equal size, with zeros where MAVLink 2 cut them off.

    Args:
        data: The block's bytes.
        places: ``(2, k)`` start and length of each payload.
        out: ``(k, size)`` zeros, filled.
    """
    for k in range(places.shape[1]):
        at = places[0, k]
        for i in range(min(places[1, k], out.shape[1])):
            out[k, i] = data[at + i]
