"""ArduPilot's on-board logs (.bin), message by message."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.filetype import looks_like
from aerodft.adapters.mavlink.dataflash_decoding import FMT_SIZE, FMT_TYPE, HEAD, HEAD_SIZE, DataflashDecoder
from aerodft.adapters.mavlink.files import LogFile, wrong_type
from aerodft.adapters.mavlink.framing import FrameCounts, counts_of
from aerodft.adapters.mavlink.kernels import (
    AT_SYNC,
    MAX_STAMP_US,
    N_OK,
    N_SKIPPED,
    N_TRUNCATED,
    STATE_SIZE,
    Bytes,
    settle_all,
)
from aerodft.geometry.jit import njit
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Event
from aerodft.model.telemetry import ClockTrack, RawBlock, WireProtocol

TIMED = 1 << 8  # beside a type's length: the message starts with TimeUS
_FIRST, _SECOND = HEAD
_FMT_FORMAT_AT, _FMT_COLUMNS_AT = 9, 25
_TIME_COLUMN = np.frombuffer(b"TimeUS", dtype=np.uint8)
BLOCK_MESSAGES: Final = 1 << 15
_FIRST_MESSAGES: Final = 1 << 12
_TYPES = 256


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


class DataflashSource:
    """A .bin log as blocks of raw messages, the ones that describe the format included.

    Arrival is UTC: the first good GPS message ties the log's time since boot to it; without one the file's
    modification time is taken as the log's end.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, or no such log.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._log = LogFile(path)
        self._state, self._types = _fresh()
        self._first_us, self._unix_minus_boot_ns, self._has_gps = self._tie()

    @property
    def counts(self) -> FrameCounts:
        """What was read so far."""
        return counts_of(self._state)

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._log.size

    def events(self) -> Iterator[Event]:
        """All messages in order, in blocks of bounded size; memory does not grow with the file."""
        for block in self._scan():
            # What comes before the first stamp (the format's description) arrives with it.
            time_ns = np.maximum(block.arrival_ns, self._first_us * 1000)
            yield replace(block, arrival_ns=time_ns + self._unix_minus_boot_ns)

    def _scan(self, most: int = BLOCK_MESSAGES) -> Iterator[RawBlock]:
        """Blocks of at most so many, whose arrival is still the time since boot, 0 before the first stamp."""
        state, types = self._state, self._types = _fresh()
        last_us = 0

        def scan(data: Bytes, start: int, limit: int, rows: IntArray) -> tuple[int, int]:
            return scan_dataflash(data, start, limit, types, rows, state)

        for piece, rows in self._log.scanned(scan, state, most, self.size):
            stamps_us = rows[2]
            settle_all(stamps_us, last_us)
            last_us = int(stamps_us[-1])
            yield piece.block(rows, WireProtocol.DATAFLASH, self._path.name)

    def _tie(self) -> tuple[int, int, bool]:
        """First stamp (us since boot), UTC minus time since boot (ns), and whether that came from GPS.

        Raises:
            InputError: The first messages declare no format.
        """
        decoder = DataflashDecoder()
        first_ns, last_ns = 0, 0
        for block in self._scan(_FIRST_MESSAGES):
            last_ns = int(block.arrival_ns[-1])
            first_ns = first_ns or int(block.arrival_ns[block.arrival_ns > 0].min(initial=last_ns))
            for track in decoder.decode(block):
                if isinstance(track, ClockTrack):
                    return first_ns // 1000, int(track.unix_ns[0] - track.boot_ns[0]), True
            if not decoder.formats:
                break
        if not decoder.formats:
            raise wrong_type(self._path, f"{looks_like(self._path)} without a valid message")
        return first_ns // 1000, self._path.stat().st_mtime_ns - last_ns, False

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        counts = self.counts
        sentences = []
        if not self._has_gps:
            sentences.append(
                f"{self._path}: no GPS time in the log; the file's modification time is taken as its end, so stamps"
                " may be off by hours"
            )
        if counts.truncated:
            sentences.append(f"{self._path}: the log is cut off; everything before the cut was read")
        elif counts.skipped_bytes:
            sentences.append(f"{self._path}: {counts.skipped_bytes} damaged bytes left out")
        return tuple(sentences)


def _fresh() -> tuple[IntArray, IntArray]:
    """The state and the known types before the first byte."""
    types = np.zeros(_TYPES, dtype=np.int64)
    types[FMT_TYPE] = FMT_SIZE
    return np.zeros(STATE_SIZE, dtype=np.int64), types
