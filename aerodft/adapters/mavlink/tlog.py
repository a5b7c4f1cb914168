"""Telemetry logs as ground stations write them: an 8-byte big-endian host stamp (us, UTC), then the frame."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.filetype import content_looks_like
from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.files import LogFile, Scan, wrong_type
from aerodft.adapters.mavlink.framing import FrameCounts, counts_of
from aerodft.adapters.mavlink.kernels import BACKWARDS, FRAME, MIN_FRAME, TLOG_STATE, Bytes, probe, scan_tlog
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Event
from aerodft.model.telemetry import WireProtocol
from aerodft.service.arrivals import Pace

BLOCK_FRAMES: Final = 1 << 15
_FIRST_FRAMES: Final = 1 << 10
_HEAD_BYTES: Final = 512
_PROBE_BYTES: Final = 1 << 24
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
        self._log = LogFile(path)
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
        self._state = _fresh_state()
        scanned = self._log.scanned(_scan_with(self._state), self._state, BLOCK_FRAMES, self.size)
        pace = Pace()
        for piece, rows in scanned:
            block = piece.block(rows, WireProtocol.MAVLINK, self._path.name, checked=True)
            yield replace(block, arrival_ns=pace.kept(block.arrival_ns))

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
            raise wrong_type(self._path, seen)
        data = np.frombuffer(head, dtype=np.uint8)
        if len(data) >= MIN_FRAME and probe(data, 0, len(data), frame_table())[0] == FRAME:
            raise wrong_type(self._path, "MAVLink frames without stamps", "record with time stamps (.tlog)")
        state = _fresh_state()
        first = next(self._log.scanned(_scan_with(state), state, _FIRST_FRAMES, min(self.size, _PROBE_BYTES)), None)
        if first is None:
            got = seen if seen != _STAMPED else "no valid MAVLink frame"
            raise wrong_type(self._path, got)


def _scan_with(state: IntArray) -> Scan:
    def scan(data: Bytes, start: int, limit: int, rows: IntArray) -> tuple[int, int]:
        return scan_tlog(data, start, limit, frame_table(), rows, state)

    return scan


def _fresh_state() -> IntArray:
    return np.zeros(TLOG_STATE, dtype=np.int64)
