"""The log format of ground stations (.tlog): MAVLink frames, each behind an 8-byte big-endian host stamp (us, UTC)."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.files import content_looks_like
from aerodft.adapters.telemetry.log_file import HEAD_BYTES, LogFile
from aerodft.adapters.telemetry.mavlink import (
    BACKWARDS,
    FRAME,
    MIN_FRAME,
    TLOG_STATE,
    Bytes,
    FollowedIds,
    MavlinkDecoder,
    frame_table,
    probe,
    scan_tlog,
)
from aerodft.model import Event, IntArray, WireProtocol
from aerodft.service import ArrivalLimiter

PROTOCOL: Final = WireProtocol.MAVLINK
TITLE: Final = "a MAVLink .tlog"

BLOCK_FRAMES: Final = 1 << 15
_FIRST_FRAMES: Final = 1 << 10
_PROBE_BYTES: Final = 1 << 24


def recognises(head: bytes) -> bool:
    """Whether a stamped frame may stand at the beginning."""
    return content_looks_like(head) == TITLE


def open_source(path: Path) -> "TlogSource":
    """A .tlog as blocks of frames."""
    return TlogSource(path)


def new_decoder(followed: FollowedIds) -> MavlinkDecoder:
    """A decoder of MAVLink frames, of a log or a link."""
    return MavlinkDecoder(followed)


class TlogSource(LogFile):
    """A .tlog as blocks of frames; they arrive at their host stamps, which never decrease.

    Args:
        path: The file.
        expected: What would have been right, for the sentence that refuses a file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, or holds no MAVLink frame with a stamp.
    """

    def __init__(self, path: Path, expected: str = TITLE) -> None:
        super().__init__(path, expected, TLOG_STATE)
        self._check_type()
        self._state = np.zeros_like(self._state)

    def events(self) -> Iterator[Event]:
        """All frames in order, in blocks of bounded size; memory does not grow with the file."""
        limiter = ArrivalLimiter()
        for piece, rows in self.scan_pieces(_scan_tlog, BLOCK_FRAMES, self.size):
            block = piece.block(rows, WireProtocol.MAVLINK, self.path.name, checked=True)
            yield replace(block, arrival_ns=limiter.limited(block.arrival_ns))

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
        head = self.read(0, HEAD_BYTES)
        kind = content_looks_like(head)
        if kind not in {TITLE, "unknown binary data", "text"}:
            raise self.wrong_type(kind)
        data = np.frombuffer(head, dtype=np.uint8)
        if len(data) >= MIN_FRAME and probe(data, 0, len(data), frame_table())[0] == FRAME:
            raise self.wrong_type("MAVLink frames without stamps", "record with time stamps (.tlog)")
        if next(self.scan_pieces(_scan_tlog, _FIRST_FRAMES, min(self.size, _PROBE_BYTES)), None) is None:
            got = kind if kind != TITLE else "no valid MAVLink frame"
            raise self.wrong_type(got)


def _scan_tlog(data: Bytes, start: int, limit: int, rows: IntArray, state: IntArray) -> tuple[int, int]:
    return scan_tlog(data, start, limit, frame_table(), rows, state)
