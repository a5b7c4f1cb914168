"""A strict MAVLink 1 and 2 framer: a frame counts only with a known id, a possible length and the right checksum.

After damage it resynchronises byte by byte and never skips a claimed length, so an intact frame is never lost to a
broken neighbour. Files and live streams go through the same check (``probe``).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.jit import njit
from aerodft.model.arrays import IntArray

Bytes = npt.NDArray[np.uint8]
Table = npt.NDArray[np.int32]

FRAME, NOTHING, INCOMPLETE, UNKNOWN, BAD_CRC = 0, 1, 2, 3, 4  # verdicts of ``probe``
MIN_FRAME = 8
MAX_FRAME = 280
# Where the scanners' state keeps what: counters, then positions in the buffer.
N_OK, N_BAD_CRC, N_UNKNOWN, N_SKIPPED, N_TRUNCATED, AT_SYNC, AT_QUIET, STATE_SIZE = 0, 1, 2, 3, 4, 5, 6, 7

_V1, _V2 = 0xFE, 0xFD
_V1_HEAD, _V2_HEAD = 6, 10
_SIGNED = 1
_SIGNATURE = 13
_TABLE_IDS = 1 << 16


def _crc_table() -> npt.NDArray[np.uint16]:
    """The 256 remainders of CRC-16/MCRF4XX, MAVLink's checksum (X.25's polynomial, reflected)."""
    values = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        values = np.where(values & 1, (values >> 1) ^ np.uint16(0x8408), values >> 1)
    return values


_CRC = _crc_table()


@njit
def checksum(data: Bytes, start: int, stop: int, extra: int) -> int:
    """The checksum over ``data[start:stop]`` and the message's CRC_EXTRA."""
    crc = 0xFFFF
    for i in range(start, stop):
        crc = (crc >> 8) ^ _CRC[(crc ^ data[i]) & 0xFF]
    return int((crc >> 8) ^ _CRC[(crc ^ extra) & 0xFF])


@njit
def probe(data: Bytes, at: int, stop: int, table: Table) -> tuple[int, int]:
    """Whether a frame stands at ``at``.

    Returns:
        The verdict, and the claimed size of the frame in bytes (0 where nothing is claimed).
    """
    magic = data[at]
    if magic not in (_V1, _V2):
        return NOTHING, 0
    head = _V1_HEAD if magic == _V1 else _V2_HEAD
    if at + head > stop:
        return INCOMPLETE, 0
    length = int(data[at + 1])
    size = head + length + 2
    message_id = int(data[at + 5])
    if magic == _V2:
        message_id = int(data[at + 7]) | int(data[at + 8]) << 8 | int(data[at + 9]) << 16
        flags = data[at + 2]
        if flags & ~_SIGNED:
            return NOTHING, 0  # the protocol forbids to read on under a flag that one does not know
        if flags & _SIGNED:
            size += _SIGNATURE
    entry = int(table[message_id]) if message_id < _TABLE_IDS else -1
    # MAVLink 1 has no truncation; in MAVLink 2 a later dialect may have added fields.
    if entry < 0 or length < 1 or (magic == _V1 and not ((entry >> 8) & 0xFF) <= length <= entry >> 16):
        return UNKNOWN, size
    if at + size > stop:
        return INCOMPLETE, size
    end = at + head + length
    crc = checksum(data, at + 1, end, entry & 0xFF)
    good = data[end] == crc & 0xFF and data[end + 1] == crc >> 8
    return (FRAME if good else BAD_CRC), size


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


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameCounts:
    """What a framer has seen.

    Attributes:
        frames: Good frames.
        bad_crc: Frames with a wrong checksum where a frame was due.
        unknown: Frames of messages that the dialect does not know, or not with this length, where a frame was due.
        skipped_bytes: Bytes that belong to no frame.
        truncated: Frames cut off by the end of the input.
    """

    frames: int = 0
    bad_crc: int = 0
    unknown: int = 0
    skipped_bytes: int = 0
    truncated: int = 0


def counts_of(state: IntArray) -> FrameCounts:
    """A scanner's counters."""
    return FrameCounts(
        frames=int(state[N_OK]),
        bad_crc=int(state[N_BAD_CRC]),
        unknown=int(state[N_UNKNOWN]),
        skipped_bytes=int(state[N_SKIPPED]),
        truncated=int(state[N_TRUNCATED]),
    )


class StreamFramer:
    """Cuts one sender's bytes into frames, however they were cut into reads."""

    def __init__(self) -> None:
        self._rest = b""
        self._state = np.zeros(STATE_SIZE, dtype=np.int64)
        self._offsets = np.empty(64, dtype=np.int64)
        self._lengths = np.empty(64, dtype=np.int64)

    @property
    def counts(self) -> FrameCounts:
        """What was seen so far."""
        return counts_of(self._state)

    def push(self, data: bytes) -> list[bytes]:
        """Whole frames that are complete with these bytes."""
        return self._scan(self._rest + data, final=False)

    def flush(self) -> list[bytes]:
        """What is left when nothing follows."""
        return self._scan(self._rest, final=True)

    def _scan(self, data: bytes, *, final: bool) -> list[bytes]:
        capacity = len(data) // MIN_FRAME + 1
        if capacity > len(self._offsets):
            self._offsets = np.empty(capacity, dtype=np.int64)
            self._lengths = np.empty(capacity, dtype=np.int64)
        found, done = scan_stream(
            np.frombuffer(data, dtype=np.uint8),
            final=final,
            table=frame_table(),
            offsets=self._offsets,
            lengths=self._lengths,
            state=self._state,
        )
        self._rest = data[done:]
        self._state[AT_SYNC:] -= done
        starts, sizes = self._offsets[:found].tolist(), self._lengths[:found].tolist()
        return [data[start : start + size] for start, size in zip(starts, sizes, strict=True)]
