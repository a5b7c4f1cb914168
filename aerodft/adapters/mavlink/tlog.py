"""Telemetry logs as ground stations write them: an 8-byte big-endian host stamp (us, UTC), then the frame."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.filetype import content_looks_like
from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.files import check_length, map_log, wrong_type
from aerodft.adapters.mavlink.framing import FrameCounts, counts_of
from aerodft.adapters.mavlink.kernels import probe
from aerodft.adapters.mavlink.layout import BACKWARDS, FRAME, MIN_FRAME, TLOG_STATE
from aerodft.adapters.mavlink.loops import scan_tlog
from aerodft.geometry.jit import expect
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Event
from aerodft.model.telemetry import RawBlock, WireProtocol

BLOCK_FRAMES: Final = 1 << 15
_BLOCK_BYTES: Final = 1 << 23
_STEP_BYTES: Final = 64  # over whole arrays, with all that is done with the frames afterwards
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
        """All frames in order, in blocks of bounded size; memory does not grow with the file."""
        return self._blocks()

    def _blocks(self) -> Iterator[RawBlock]:
        self._state = _fresh_state()
        rows = np.empty((3, BLOCK_FRAMES), dtype=np.int64)
        at, size = 0, len(self._data)
        expect(size // _STEP_BYTES)
        while at < size:
            check_length(self._path, self._data)
            found, at = scan_tlog(self._data, at, at + _BLOCK_BYTES, frame_table(), rows, self._state)
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
        seen = content_looks_like(self._data[:512].tobytes())
        if seen not in {_STAMPED, "unknown binary data", "text"}:
            raise wrong_type(self._path, _EXPECTED, got=seen)
        table = frame_table()
        if len(self._data) >= MIN_FRAME and probe(self._data, 0, len(self._data), table)[0] == FRAME:
            raise wrong_type(
                self._path, _EXPECTED, got="MAVLink frames without stamps", hint="record with time stamps (.tlog)"
            )
        rows = np.empty((3, 1), dtype=np.int64)
        if not scan_tlog(self._data, 0, _PROBE_BYTES, table, rows, _fresh_state())[0]:
            got = seen if seen != _STAMPED else "no valid MAVLink frame"
            raise wrong_type(self._path, _EXPECTED, got=got)


def _fresh_state() -> IntArray:
    return np.zeros(TLOG_STATE, dtype=np.int64)
