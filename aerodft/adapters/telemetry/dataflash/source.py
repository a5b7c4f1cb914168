"""A .bin log as blocks of raw messages."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.files import looks_like
from aerodft.adapters.telemetry.dataflash.decoding import DataflashDecoder
from aerodft.adapters.telemetry.dataflash.framing import known_types, scan_dataflash
from aerodft.adapters.telemetry.log_file import LogFile, Piece
from aerodft.adapters.telemetry.mavlink import JUMP_US, TLOG_STATE, Bytes, plausible_stamps
from aerodft.model import ClockTrack, Event, IntArray, RawBlock, WireProtocol

TITLE: Final = "an ArduPilot .bin log"
_BLOCK_MESSAGES: Final = 1 << 15
_FIRST_MESSAGES: Final = 1 << 12
_Batch = tuple[Piece, IntArray]  # messages, in rows as of ``scan_dataflash``


class DataflashSource(LogFile):
    """A .bin log as blocks of raw messages, the ones that describe the format included.

    Arrival is UTC: the first good GPS message ties the log's time since boot to it; without one the file's
    modification time is taken as the log's end.

    Args:
        path: The file.
        expected: What would have been right, for the sentence that refuses a file.

    Raises:
        InputError: The file is missing, a folder, unreadable, empty, or no such log.
    """

    def __init__(self, path: Path, expected: str = TITLE) -> None:
        super().__init__(path, expected, TLOG_STATE)
        self._first_us, self._unix_minus_boot_ns, self._has_gps = self._boot_to_utc()

    def events(self) -> Iterator[Event]:
        """All messages in order, in blocks of bounded size; memory does not grow with the file."""
        for block in self._scan():
            # What comes before the first stamp (the format's description) arrives with it.
            time_ns = np.maximum(block.arrival_ns, self._first_us * 1000)
            yield replace(block, arrival_ns=time_ns + self._unix_minus_boot_ns)

    def _scan(self, most: int = _BLOCK_MESSAGES) -> Iterator[RawBlock]:
        """Blocks of at most so many, whose arrival is still the time since boot, 0 before the first stamp."""
        types, last_us = known_types(), 0

        def scan(data: Bytes, start: int, limit: int, rows: IntArray, state: IntArray) -> tuple[int, int]:
            return scan_dataflash(data, start, limit, types, rows, state)

        for (piece, rows), following_us in _with_following(self.scan_pieces(scan, most, self.size)):
            plausible_stamps(rows[2], last_us, following_us)
            last_us = int(rows[2, -1])
            yield piece.block(rows, WireProtocol.DATAFLASH, self.path.name)

    def _boot_to_utc(self) -> tuple[int, int, bool]:
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
            raise self.wrong_type(f"{looks_like(self.path)} without a valid message")
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


def _with_following(batches: Iterable[_Batch]) -> Iterator[tuple[_Batch, int]]:
    """Each batch, and the first time since boot (us) that can be read behind it, where its last one needs it; else -1.

    A batch is not held back without need: what was just found is decoded in half the time.
    """
    held: list[_Batch] = []
    for batch in batches:
        times_us = batch[1][2]
        if held and (first_us := _first_time(times_us)) >= 0:
            yield from ((each, first_us) for each in held)
            held = []
        if held or times_us[-2:].min() < 0 or np.ptp(times_us[-2:]) > JUMP_US or len(times_us) == 1:
            held.append(batch)
        else:
            yield batch, -1
    yield from ((each, -1) for each in held)


def _first_time(times_us: IntArray) -> int:
    """The first time since boot that can be read, of some; -1 where none can."""
    return int(times_us[np.argmax(times_us >= 0)])
