"""Telemetry log files, read piece by piece: those of ground stations (.tlog) and ArduPilot's on-board ones (.bin).

A .tlog has an 8-byte big-endian host stamp (us, UTC) in front of each frame.
"""

import os
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.file_kind import content_looks_like, looks_like
from aerodft.adapters.telemetry.dataflash import FMT_SIZE, FMT_TYPE, HEAD, HEAD_SIZE, DataflashDecoder
from aerodft.adapters.telemetry.mavlink import (
    AT_QUIET,
    AT_SYNC,
    BACKWARDS,
    FRAME,
    MAX_STAMP_US,
    MIN_FRAME,
    N_OK,
    N_SKIPPED,
    N_TRUNCATED,
    STATE_SIZE,
    TLOG_STATE,
    Bytes,
    FrameCounts,
    counts_of,
    frame_table,
    probe,
    scan_tlog,
    settle_all,
)
from aerodft.errors import InputError
from aerodft.jit import njit
from aerodft.model import ClockTrack, Event, IntArray, RawBlock, WireProtocol
from aerodft.service import ArrivalLimiter

Scan = Callable[[Bytes, int, int, IntArray, IntArray], tuple[int, int]]

BLOCK_FRAMES: Final = 1 << 15
_FIRST_FRAMES: Final = 1 << 10
_HEAD_BYTES: Final = 512
_PROBE_BYTES: Final = 1 << 24
_STAMPED: Final = "a MAVLink .tlog"
PIECE_BYTES: Final = 1 << 22
_EXPECTED: Final = "a MAVLink .tlog or an ArduPilot .bin log"
_BEFORE, _AFTER = 1 << 10, 1 << 12  # bytes; scanners look back and ahead by less: what one message and a stamp take
TIMED = 1 << 8  # beside a type's length: the message starts with TimeUS
_FIRST, _SECOND = HEAD
_FMT_FORMAT_AT, _FMT_COLUMNS_AT = 9, 25
_TIME_COLUMN = np.frombuffer(b"TimeUS", dtype=np.uint8)
BLOCK_MESSAGES: Final = 1 << 15
_FIRST_MESSAGES: Final = 1 << 12
_TYPES = 256


@dataclass(frozen=True, slots=True)
class Piece:
    """Part of a log.

    Attributes:
        data: Its bytes, with some around it.
        first: Where they begin in the log.
        limit: Where in ``data`` the part ends; what is behind it there is only looked at.
    """

    data: Bytes
    first: int
    limit: int

    @property
    def stop(self) -> int:
        """Where the part ends in the log."""
        return self.first + self.limit

    def block(self, rows: IntArray, protocol: WireProtocol, sender: str, *, checked: bool = False) -> RawBlock:
        """What a scanner found in it: ``rows (3, n)`` of where in ``data``, how long, and when in us."""
        start, stop = int(rows[0, 0]), int(rows[0, -1] + rows[1, -1])
        return RawBlock(
            protocol=protocol,
            sender=sender,
            arrival_ns=rows[2] * 1000,
            offset=rows[0] - start,
            length=rows[1].copy(),
            data=self.data[start:stop].tobytes(),
            checked=checked,
        )


class LogFile:
    """A log's bytes, and what was scanned of them so far; memory does not grow with it.

    It is not mapped into memory: to touch what somebody has cut off would end the process without a word.

    Args:
        path: The file.
        state_size: How many numbers its scanner keeps.

    Attributes:
        path: The file.
        size: Its bytes when it was opened; what is written later is not read.

    Raises:
        InputError: It is missing, a folder, unreadable or empty.
    """

    def __init__(self, path: Path, state_size: int = STATE_SIZE) -> None:
        if not path.exists():
            raise InputError("no such file", where=path, expected=_EXPECTED, hint="check the path")
        if path.is_dir():
            raise InputError("is a folder", where=path, expected=_EXPECTED, hint="name one file in it")
        self.path = path
        self._state = np.zeros(state_size, dtype=np.int64)
        try:
            if path.stat().st_size == 0:  # asked first: to open a pipe would wait for somebody who writes
                raise InputError("the file is empty", where=path, got="0 bytes", expected=_EXPECTED)
            self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            weakref.finalize(self, os.close, self._descriptor)
            self.size = os.fstat(self._descriptor).st_size
        except OSError as error:
            raise InputError("cannot be read", where=path, got=error.strerror or error, expected=_EXPECTED) from error

    @property
    def counts(self) -> FrameCounts:
        """What was read so far."""
        return counts_of(self._state)

    def read(self, start: int, stop: int) -> bytes:
        """Bytes of the log; fewer where it ends before ``stop``.

        Raises:
            InputError: It cannot be read, or somebody has cut it.
        """
        parts = []
        stop = min(stop, self.size)
        while start < stop:
            try:
                parts.append(os.pread(self._descriptor, stop - start, start))
            except OSError as error:
                raise InputError("cannot be read", where=self.path, got=error.strerror or error) from error
            if not parts[-1]:
                got, expected = f"{start} bytes", f"{self.size} bytes, as when it was opened"
                raise InputError(
                    "the file became shorter while it was read", where=self.path, got=got, expected=expected
                )
            start += len(parts[-1])
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def piece(self, at: int) -> Piece:
        """What comes from ``at`` on.

        Raises:
            InputError: It cannot be read, or somebody has cut it.
        """
        first = max(at - _BEFORE, 0)
        stop = min(at + PIECE_BYTES, self.size)
        return Piece(np.frombuffer(self.read(first, stop + _AFTER), dtype=np.uint8), first, stop - first)

    def scanned(self, scan: Scan, most: int, stop: int) -> Iterator[tuple[Piece, IntArray]]:
        """What a scanner finds before ``stop`` at least; begins anew.

        Args:
            scan: Of some bytes, from where, to where; fills ``rows`` as for ``Piece.block``, and updates its state,
                the places in which are kept to the bytes of the piece; gives how many, and where to go on.
            most: So many at once.
            stop: Nothing is looked for in pieces that begin there or behind.

        Yields:
            A piece, and the rows in it, valid until the next.
        """
        rows = np.empty((3, most), dtype=np.int64)
        self._state = state = np.zeros_like(self._state)
        at, piece = 0, Piece(np.empty(0, dtype=np.uint8), 0, 0)
        while at < stop:
            if at >= piece.stop:
                last, piece = piece, self.piece(at)
                state[[AT_SYNC, AT_QUIET]] -= piece.first - last.first
            found, end = scan(piece.data, at - piece.first, piece.limit, rows, state)
            at = piece.first + end
            if found:
                yield piece, rows[:, :found]


def wrong_type(path: Path, got: str, hint: str = "") -> InputError:
    """The refusal of a file that holds something else."""
    return InputError("wrong type of file", where=path, got=got, expected=_EXPECTED, hint=hint)


class TlogSource(LogFile):
    """A .tlog as blocks of frames; their arrival is the host stamp, made not decreasing.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, or holds no MAVLink frame with a stamp.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, TLOG_STATE)
        self._check_type()
        self._state = np.zeros_like(self._state)

    def events(self) -> Iterator[Event]:
        """All frames in order, in blocks of bounded size; memory does not grow with the file."""
        pace = ArrivalLimiter()
        for piece, rows in self.scanned(_scan_tlog, BLOCK_FRAMES, self.size):
            block = piece.block(rows, WireProtocol.MAVLINK, self.path.name, checked=True)
            yield replace(block, arrival_ns=pace.kept(block.arrival_ns))

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        counts, backwards = self.counts, int(self._state[BACKWARDS])
        sentences = []
        if counts.truncated:
            sentences.append(f"{self.path}: the last frame is cut off; everything before it was read")
        if counts.bad_crc:
            sentences.append(
                f"{self.path}: {counts.bad_crc} damaged frames left out"
                f" ({counts.skipped_bytes} bytes belong to no good frame)"
            )
        elif counts.skipped_bytes and not counts.truncated:
            sentences.append(f"{self.path}: {counts.skipped_bytes} bytes belong to no good frame")
        if backwards:
            sentences.append(
                f"{self.path}: the recording machine's clock stepped back ({backwards} frames stamped earlier than"
                " one before them); their arrival was held"
            )
        return tuple(sentences)

    def _check_type(self) -> None:
        """Refuse a file without any stamped frame near its start."""
        head = self.read(0, _HEAD_BYTES)
        seen = content_looks_like(head)
        if seen not in {_STAMPED, "unknown binary data", "text"}:
            raise wrong_type(self.path, seen)
        data = np.frombuffer(head, dtype=np.uint8)
        if len(data) >= MIN_FRAME and probe(data, 0, len(data), frame_table())[0] == FRAME:
            raise wrong_type(self.path, "MAVLink frames without stamps", "record with time stamps (.tlog)")
        if next(self.scanned(_scan_tlog, _FIRST_FRAMES, min(self.size, _PROBE_BYTES)), None) is None:
            got = seen if seen != _STAMPED else "no valid MAVLink frame"
            raise wrong_type(self.path, got)


def _scan_tlog(data: Bytes, start: int, limit: int, rows: IntArray, state: IntArray) -> tuple[int, int]:
    return scan_tlog(data, start, limit, frame_table(), rows, state)


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


class DataflashSource(LogFile):
    """A .bin log as blocks of raw messages, the ones that describe the format included.

    Arrival is UTC: the first good GPS message ties the log's time since boot to it; without one the file's
    modification time is taken as the log's end.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, or no such log.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._first_us, self._unix_minus_boot_ns, self._has_gps = self._tie()

    def events(self) -> Iterator[Event]:
        """All messages in order, in blocks of bounded size; memory does not grow with the file."""
        for block in self._scan():
            # What comes before the first stamp (the format's description) arrives with it.
            time_ns = np.maximum(block.arrival_ns, self._first_us * 1000)
            yield replace(block, arrival_ns=time_ns + self._unix_minus_boot_ns)

    def _scan(self, most: int = BLOCK_MESSAGES) -> Iterator[RawBlock]:
        """Blocks of at most so many, whose arrival is still the time since boot, 0 before the first stamp."""
        types = np.zeros(_TYPES, dtype=np.int64)
        types[FMT_TYPE] = FMT_SIZE
        last_us = 0

        def scan(data: Bytes, start: int, limit: int, rows: IntArray, state: IntArray) -> tuple[int, int]:
            return scan_dataflash(data, start, limit, types, rows, state)

        for piece, rows in self.scanned(scan, most, self.size):
            stamps_us = rows[2]
            settle_all(stamps_us, last_us)
            last_us = int(stamps_us[-1])
            yield piece.block(rows, WireProtocol.DATAFLASH, self.path.name)

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
            raise wrong_type(self.path, f"{looks_like(self.path)} without a valid message")
        return first_ns // 1000, self.path.stat().st_mtime_ns - last_ns, False

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        counts = self.counts
        sentences = []
        if not self._has_gps:
            sentences.append(
                f"{self.path}: no GPS time in the log; the file's modification time is taken as its end, so stamps"
                " may be off by hours"
            )
        if counts.truncated:
            sentences.append(f"{self.path}: the log is cut off; everything before the cut was read")
        elif counts.skipped_bytes:
            sentences.append(f"{self.path}: {counts.skipped_bytes} damaged bytes left out")
        return tuple(sentences)
