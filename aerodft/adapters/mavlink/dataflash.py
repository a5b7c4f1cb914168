"""ArduPilot's on-board logs (.bin), message by message."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.filetype import looks_like
from aerodft.adapters.mavlink.dataflash_decoding import DataflashDecoder
from aerodft.adapters.mavlink.dataflash_format import FMT_SIZE, FMT_TYPE
from aerodft.adapters.mavlink.dataflash_kernels import scan_dataflash
from aerodft.adapters.mavlink.files import LogFile, wrong_type
from aerodft.adapters.mavlink.framing import FrameCounts, counts_of
from aerodft.adapters.mavlink.kernels import settle_all
from aerodft.adapters.mavlink.layout import STATE_SIZE, Bytes
from aerodft.model.arrays import IntArray
from aerodft.model.batch import Event
from aerodft.model.telemetry import ClockTrack, RawBlock, WireProtocol

BLOCK_MESSAGES: Final = 1 << 15
_FIRST_MESSAGES: Final = 1 << 12
_EXPECTED: Final = "a MAVLink .tlog or an ArduPilot .bin log"
_TYPES = 256


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
        self._log = LogFile(path, _EXPECTED)
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
            raise wrong_type(self._path, _EXPECTED, got=f"{looks_like(self._path)} without a valid message")
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
