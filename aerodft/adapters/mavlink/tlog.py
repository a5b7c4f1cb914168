"""Telemetry logs as ground stations write them: an 8-byte big-endian host stamp (us, UTC), then the frame."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.filetype import content_looks_like
from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.files import LogFile, Piece, shift, wrong_type
from aerodft.adapters.mavlink.framing import FrameCounts, counts_of
from aerodft.adapters.mavlink.kernels import probe
from aerodft.adapters.mavlink.layout import BACKWARDS, FRAME, MIN_FRAME, TLOG_STATE
from aerodft.adapters.mavlink.loops import scan_tlog
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Event
from aerodft.model.telemetry import RawBlock, WireProtocol

BLOCK_FRAMES: Final = 1 << 15
_FIRST_FRAMES: Final = 1 << 10
_HEAD_BYTES: Final = 512
_PROBE_BYTES: Final = 1 << 24
_EXPECTED: Final = "a MAVLink .tlog or an ArduPilot .bin log"
_STAMPED: Final = "a MAVLink .tlog"


class TlogSource:
    """A .tlog as blocks of frames; their arrival is the host stamp, made not decreasing.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, or holds no MAVLink frame with a stamp.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._log = LogFile(path, _EXPECTED)
        self._state = _fresh_state()
        self._check_type()

    @property
    def counts(self) -> FrameCounts:
        """What was read so far."""
        return counts_of(self._state)

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._log.size

    def events(self) -> Iterator[Event]:
        """All frames in order, in blocks of bounded size; memory does not grow with the file."""
        return self._blocks()

    def _blocks(self) -> Iterator[RawBlock]:
        self._state = _fresh_state()
        for piece, rows in self._scanned(self._state, BLOCK_FRAMES, self.size):
            yield self._block(piece, rows)

    def _scanned(self, state: IntArray, most: int, stop: int) -> Iterator[tuple[Piece, IntArray]]:
        """Frames that begin before ``stop`` at least, at most so many at once.

        Args:
            state: Of the scan, at its beginning; updated.
            most: So many.
            stop: Nothing is looked for in pieces that begin there or behind.

        Yields:
            A piece, and ``rows`` of ``scan_tlog`` in it.
        """
        rows = np.empty((3, most), dtype=np.int64)
        at, piece = 0, Piece(np.empty(0, dtype=np.uint8), 0, 0)
        while at < stop:
            if at >= piece.stop:
                last, piece = piece, self._log.piece(at)
                shift(state, piece.first - last.first)
            found, end = scan_tlog(piece.data, at - piece.first, piece.limit, frame_table(), rows, state)
            at = piece.first + end
            if found:
                yield piece, rows[:, :found]

    def _block(self, piece: Piece, rows: IntArray) -> RawBlock:
        start, stop = int(rows[0, 0]), int(rows[0, -1] + rows[1, -1])
        return RawBlock(
            protocol=WireProtocol.MAVLINK,
            sender=self._path.name,
            arrival_ns=rows[2] * 1000,
            offset=rows[0] - start,
            length=rows[1].copy(),
            data=piece.data[start:stop].tobytes(),
            checked=True,
        )

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        counts, backwards = self.counts, int(self._state[BACKWARDS])
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
        head = self._log.read(0, _HEAD_BYTES)
        seen = content_looks_like(head)
        if seen not in {_STAMPED, "unknown binary data", "text"}:
            raise wrong_type(self._path, _EXPECTED, got=seen)
        data = np.frombuffer(head, dtype=np.uint8)
        if len(data) >= MIN_FRAME and probe(data, 0, len(data), frame_table())[0] == FRAME:
            raise wrong_type(
                self._path, _EXPECTED, got="MAVLink frames without stamps", hint="record with time stamps (.tlog)"
            )
        first = next(self._scanned(_fresh_state(), _FIRST_FRAMES, min(self.size, _PROBE_BYTES)), None)
        if first is None:
            got = seen if seen != _STAMPED else "no valid MAVLink frame"
            raise wrong_type(self._path, _EXPECTED, got=got)


def _fresh_state() -> IntArray:
    return np.zeros(TLOG_STATE, dtype=np.int64)
