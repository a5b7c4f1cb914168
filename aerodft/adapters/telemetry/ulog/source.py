"""A .ulg log as blocks of raw messages."""

import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.files import looks_like
from aerodft.adapters.telemetry.log_file import LogFile, Piece
from aerodft.adapters.telemetry.mavlink import TLOG_STATE, Bytes
from aerodft.adapters.telemetry.ulog.decoding import PROTOCOL, UlogDecoder
from aerodft.adapters.telemetry.ulog.definitions import Definitions
from aerodft.adapters.telemetry.ulog.framing import (
    DATA,
    DROPOUT,
    FILE_HEADER_SIZE,
    FLAGS,
    FORMAT,
    HEAD_SIZE,
    KIND_AT,
    MAGIC,
    MOST_BYTES,
    SUBSCRIPTION,
    scan_ulog,
)
from aerodft.model import ClockTrack, Event, IntArray, RawBlock

TITLE: Final = "a PX4 .ulg log"
_BLOCK_MESSAGES: Final = 1 << 15
_FIRST_MESSAGES: Final = 1 << 12
_HAS_APPENDED: Final = 1  # of the incompatible flags
_NO_CUT: Final = 1 << 62


class UlogSource(LogFile):
    """A .ulg log as blocks of raw messages, its file header and definitions included.

    Arrival is UTC: the first good report of the GPS receiver ties the log's time since boot to it; without one the
    file's modification time is taken as the log's end.

    Args:
        path: The file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, no such log, or of a later version of the format.
    """

    lookahead = MOST_BYTES + HEAD_SIZE

    def __init__(self, path: Path) -> None:
        super().__init__(path, TITLE, TLOG_STATE)
        self._cuts = self._appended()
        self._piece_first = 0
        self._dropouts_ms: list[int] = []
        self._first_us, self._unix_minus_boot_ns, self._has_utc = self._boot_to_utc()

    def events(self) -> Iterator[Event]:
        """All messages in order, in blocks of bounded size; memory does not grow with the file."""
        self._dropouts_ms = []
        for block in self._scan():
            self._count_dropouts(block)
            yield replace(
                block, arrival_ns=np.maximum(block.arrival_ns, self._first_us * 1000) + self._unix_minus_boot_ns
            )

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each kind of damage met so far; complete once ``events`` has ended."""
        counts, sentences = self.counts, []
        if not self._has_utc:
            sentences.append(
                f"{self.path}: no GPS time in the log; the file's modification time is taken as its end, so stamps"
                " may be off by hours"
            )
        if self._dropouts_ms:
            lost_s = sum(self._dropouts_ms) / 1000
            sentences.append(
                f"{self.path}: the logger dropped messages {len(self._dropouts_ms)} times, for {lost_s:.2f} s in all,"
                f" {max(self._dropouts_ms) / 1000:.2f} s at the longest"
            )
        if counts.truncated:
            sentences.append(f"{self.path}: the log is cut off; everything before the cut was read")
        elif counts.skipped_bytes:
            sentences.append(f"{self.path}: {counts.skipped_bytes} damaged bytes left out")
        return tuple(sentences)

    def piece(self, at: int) -> Piece:
        """The file's bytes from an offset on, with some before and after."""
        piece = super().piece(at)
        self._piece_first = piece.first
        return piece

    def _scan(self, most: int = _BLOCK_MESSAGES) -> Iterator[RawBlock]:
        """Blocks of at most so many messages, whose arrival is still the time since boot."""
        definitions = Definitions()

        def scan(data: Bytes, start: int, limit: int, rows: IntArray, state: IntArray) -> tuple[int, int]:
            found, at = 0, start
            while at < limit and found < rows.shape[1]:
                cut = next((each for each in self._cuts if each > self._piece_first + at), _NO_CUT)
                before = found
                found, at = scan_ulog(data, at, limit, cut - self._piece_first, definitions.sizes, rows, found, state)
                if found == before:
                    break
                first, size = rows[:2, found - 1].tolist()
                if data[first + KIND_AT] in {FORMAT, SUBSCRIPTION}:
                    payload = data[first + HEAD_SIZE : first + size].tobytes()
                    definitions.learn(int(data[first + KIND_AT]), payload)
            return found, at

        for piece, rows in self.scan_pieces(scan, most, self.size):
            yield piece.block(rows, PROTOCOL, self.path.name)

    def _appended(self) -> list[int]:
        """Offsets in the file at which data were appended after a crash.

        Raises:
            InputError: The file is no ULog, or uses what this version does not know.
        """
        head = self.read(0, FILE_HEADER_SIZE + HEAD_SIZE + 40)
        if not head.startswith(bytes(MAGIC)) or len(head) < FILE_HEADER_SIZE:
            raise self.wrong_type(looks_like(self.path))
        flags = head[FILE_HEADER_SIZE:]
        if len(flags) < HEAD_SIZE + 40 or flags[KIND_AT] != FLAGS:
            return []
        incompatible = flags[HEAD_SIZE + 8 : HEAD_SIZE + 16]
        if incompatible[0] & ~_HAS_APPENDED or any(incompatible[1:]):
            got = "a later version of the format (its flags of incompatibility are not known)"
            raise self.wrong_type(got, "convert the log with PX4's own tools")
        if not incompatible[0]:
            return []
        return sorted(each for each in struct.unpack_from("<3Q", flags, HEAD_SIZE + 16) if 0 < each < self.size)

    def _boot_to_utc(self) -> tuple[int, int, bool]:
        """First time of data (us since boot), UTC minus time since boot (ns), and whether the log states it.

        Raises:
            InputError: The log has no message of data.
        """
        decoder = UlogDecoder()
        first_ns = last_ns = 0
        has_data = False
        for block in self._scan(_FIRST_MESSAGES):
            last_ns = int(block.arrival_ns[-1])
            first_ns = first_ns or int(block.arrival_ns[block.arrival_ns > 0].min(initial=last_ns))
            kinds = np.frombuffer(block.data, dtype=np.uint8)[block.offset + KIND_AT]
            has_data |= bool(np.any(kinds == DATA))
            for track in decoder.decode(block):
                if isinstance(track, ClockTrack):
                    return first_ns // 1000, int(track.unix_ns[0] - track.boot_ns[0]), True
        if not has_data:
            raise self.wrong_type("a PX4 .ulg log without a valid message of data")
        return first_ns // 1000, self.path.stat().st_mtime_ns - last_ns, False

    def _count_dropouts(self, block: RawBlock) -> None:
        kinds = np.frombuffer(block.data, dtype=np.uint8)[block.offset + KIND_AT]
        for at in block.offset[kinds == DROPOUT].tolist():
            self._dropouts_ms.append(*struct.unpack_from("<H", block.data, at + HEAD_SIZE))
