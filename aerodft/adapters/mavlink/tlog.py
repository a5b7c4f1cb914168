"""Telemetry logs as ground stations write them: an 8-byte big-endian host stamp (us, UTC), then the frame."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.filetype import content_looks_like
from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.files import map_log, wrong_type
from aerodft.adapters.mavlink.framing import (
    AT_SYNC,
    FRAME,
    INCOMPLETE,
    MIN_FRAME,
    N_OK,
    STATE_SIZE,
    Bytes,
    FrameCounts,
    Table,
    counts_of,
    note_damage,
    probe,
)
from aerodft.adapters.mavlink.jit import njit
from aerodft.adapters.mavlink.stamps import BACK_US, big_endian_stamp, settle
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Event
from aerodft.model.telemetry import RawBlock, WireProtocol

BLOCK_FRAMES: Final = 4096
_BLOCK_BYTES: Final = 1 << 20
_PROBE_BYTES: Final = 1 << 24
_STAMP = 8
_EXPECTED: Final = "a MAVLink .tlog or an ArduPilot .bin log"
_STAMPED: Final = "a MAVLink .tlog"
_LAST_US, _BACKWARDS, _TLOG_STATE = STATE_SIZE, STATE_SIZE + 1, STATE_SIZE + 2
_MAGICS = (0xFD, 0xFE)


@njit
def _following_stamp(data: Bytes, at: int) -> int:
    """The stamp of the record that should start at ``at``; -1 where none does."""
    if at + _STAMP >= len(data) or data[at + _STAMP] not in _MAGICS:
        return -1
    return big_endian_stamp(data, at)


@njit
def _scan_tlog(data: Bytes, start: int, limit: int, table: Table, rows: IntArray, state: IntArray) -> tuple[int, int]:
    """Find records from ``start``, until ``rows`` is full or ``limit`` is passed.

    Args:
        data: The whole file.
        start: Where to go on.
        limit: Where to stop looking.
        table: ``frame_table()``.
        rows: ``(3, n)`` filled with each frame's offset, its size, and its arrival in us.
        state: ``(_TLOG_STATE,)``, updated.

    Returns:
        Number of frames, and where to go on.
    """
    at, found, stop = start, 0, len(data)
    while at < min(stop, limit) and found < rows.shape[1]:
        verdict, size = INCOMPLETE, 0
        if at + _STAMP < stop:
            verdict, size = probe(data, at + _STAMP, stop, table)
        if verdict == FRAME:
            end = at + _STAMP + size
            stamp = big_endian_stamp(data, at)
            if 0 <= stamp < state[_LAST_US] - BACK_US:
                state[_BACKWARDS] += 1
            state[_LAST_US] = settle(stamp, state[_LAST_US], _following_stamp(data, end))
            rows[0, found], rows[1, found], rows[2, found] = at + _STAMP, size, state[_LAST_US]
            found += 1
            state[N_OK] += 1
            state[AT_SYNC] = end
            at = end
        else:
            note_damage(state, at, verdict, size + _STAMP)
            at += 1
    return found, at


class TlogSource:
    """A .tlog as blocks of frames; their arrival is the host stamp, made not decreasing.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, or holds no MAVLink frame with a stamp.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._data = map_log(path, _EXPECTED)
        self._state = _fresh_state()
        self._check_type()

    @property
    def counts(self) -> FrameCounts:
        """What was read so far."""
        return counts_of(self._state)

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return len(self._data)

    def events(self) -> Iterator[Event]:
        """All frames in order, in blocks of at most 4096; memory does not grow with the file."""
        return self._blocks()

    def _blocks(self) -> Iterator[RawBlock]:
        self._state = _fresh_state()
        rows = np.empty((3, BLOCK_FRAMES), dtype=np.int64)
        at, size = 0, len(self._data)
        while at < size:
            found, at = _scan_tlog(self._data, at, at + _BLOCK_BYTES, frame_table(), rows, self._state)
            if found:
                yield self._block(rows[:, :found])

    def _block(self, rows: IntArray) -> RawBlock:
        start, stop = int(rows[0, 0]), int(rows[0, -1] + rows[1, -1])
        return RawBlock(
            protocol=WireProtocol.MAVLINK,
            sender=self._path.name,
            arrival_ns=rows[2] * 1000,
            offset=rows[0] - start,
            length=rows[1].copy(),
            data=self._data[start:stop].tobytes(),
        )

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        counts, backwards = self.counts, int(self._state[_BACKWARDS])
        sentences = []
        if counts.truncated:
            sentences.append(f"{self._path}: the last frame is cut off; everything before it was read")
        if counts.bad_crc:
            sentences.append(
                f"{self._path}: {counts.bad_crc} damaged frames left out"
                f" ({counts.skipped_bytes} bytes belong to no good frame)"
            )
        elif counts.skipped_bytes and not counts.truncated:
            sentences.append(f"{self._path}: {counts.skipped_bytes} bytes belong to no good frame")
        if backwards:
            sentences.append(
                f"{self._path}: the recording machine's clock stepped back ({backwards} frames stamped earlier than"
                " one before them); their arrival was held"
            )
        return tuple(sentences)

    def _check_type(self) -> None:
        """Refuse a file without any stamped frame near its start."""
        seen = content_looks_like(self._data[:512].tobytes())
        if seen not in {_STAMPED, "unknown binary data", "text"}:
            raise wrong_type(self._path, _EXPECTED, got=seen)
        table = frame_table()
        if len(self._data) >= MIN_FRAME and probe(self._data, 0, len(self._data), table)[0] == FRAME:
            raise wrong_type(
                self._path, _EXPECTED, got="MAVLink frames without stamps", hint="record with time stamps (.tlog)"
            )
        rows = np.empty((3, 1), dtype=np.int64)
        if not _scan_tlog(self._data, 0, _PROBE_BYTES, table, rows, _fresh_state())[0]:
            got = seen if seen != _STAMPED else "no valid MAVLink frame"
            raise wrong_type(self._path, _EXPECTED, got=got)


def _fresh_state() -> IntArray:
    return np.zeros(_TLOG_STATE, dtype=np.int64)
