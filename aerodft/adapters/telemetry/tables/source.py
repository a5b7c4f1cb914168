"""A flight table as blocks of rows."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from aerodft.adapters.files import looks_like, read_whole
from aerodft.adapters.telemetry.log_file import rows_that_go_on
from aerodft.adapters.telemetry.mavlink import FrameCounts
from aerodft.adapters.telemetry.tables.decoding import PROTOCOL, layout_frame
from aerodft.adapters.telemetry.tables.layouts import LOCAL, MISSION_PLANNER, UTC, Layout, layout_of, mapped_layout
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, counted, os_errors_as
from aerodft.model import Event
from aerodft.service import block_of

TITLE: Final = "a flight table (.csv of AirData, Litchi, a DJI flight log or Mission Planner)"
_BLOCK_ROWS: Final = 4096
_MOST_BYTES: Final = 1 << 29  # 30 h of the widest of these tables at 10 Hz
_MS_NS: Final = 1_000_000
_LINE: Final = re.compile(rb'(?:[^"\n]|"[^"]*")*\n?')


class TableLog:
    """A flight table as blocks of rows, whose arrivals are UTC.

    The first frame of each block states where values stand, so that a recording can be computed again.

    Args:
        path: The file.
        columns: Names of columns by ``COLUMN_KEYS``, in place of a known tool's; None for those.

    Attributes:
        path: The file.

    Raises:
        InputError: The file is missing or unreadable, is of no known tool, lacks a column, or has no time.
    """

    def __init__(self, path: Path, columns: Mapping[str, str] | None = None) -> None:
        self.path = path
        lines = _lines(path)
        self._layout = _layout(path, lines[0], columns)
        rows = lines if self._layout.tool == MISSION_PLANNER else lines[1:]
        rows = [row for row in rows if row.strip()]
        self._notes: list[str] = []
        stamps_ns = self._stamps_ns([self._layout.cells(row) for row in rows])
        kept = rows_that_go_on(stamps_ns)
        if not kept:
            raise InputError("no row states a time", where=path, got=counted(len(rows), "row"), expected=TITLE)
        self._rows = [(stamp, rows[k]) for k in kept if (stamp := stamps_ns[k]) is not None]
        self._left_out = len(rows) - len(kept)

    @property
    def counts(self) -> FrameCounts:
        """Counts of the rows."""
        return FrameCounts(frames=len(self._rows))

    def events(self) -> Iterator[Event]:
        """All rows in order, in blocks of bounded size."""
        head = layout_frame(self._layout)
        for first in range(0, len(self._rows), _BLOCK_ROWS):
            stamps_ns, rows = zip(*self._rows[first : first + _BLOCK_ROWS], strict=True)
            yield block_of(PROTOCOL, self.path.name, [stamps_ns[0], *stamps_ns], [head, *rows])

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each thing that the table does not say, and for rows that are left out."""
        sentences = [f"{self.path}: {each}" for each in self._notes]
        if self._left_out:
            sentences.append(f"{self.path}: {self._left_out} rows left out: they state no time, or one that goes back")
        return tuple(sentences)

    def _stamps_ns(self, cells: Sequence[Sequence[str]]) -> list[int | None]:
        """UTC of each row by its date, its elapsed time, or both; None where it states none."""
        values = [self._layout.values(row) for row in cells]
        stated = [self._layout.time_ns(row) for row in cells]
        unix = [None if (s := each.get("unix_s")) is None else round(s * SECOND_NS) for each in values]
        elapsed = [None if (s := each.get("elapsed_s")) is None else round(s * SECOND_NS) for each in values]
        if self._layout.tool == MISSION_PLANNER:
            return self._with_utc(stated, unix)
        if any(each is not None for each in unix):
            return unix
        if LOCAL in self._layout.columns:
            self._notes.append("its clock states no zone: it is taken for UTC")
        is_dated, is_timed = (any(each is not None for each in column) for column in (stated, elapsed))
        if is_timed and is_dated:  # dates are cut to whole seconds: the latest base is the nearest
            pairs = zip(stated, elapsed, strict=True)
            base_ns = max(date - since for date, since in pairs if date is not None and since is not None)
            return [None if each is None else base_ns + each for each in elapsed]
        if is_timed:
            self._notes.append("no date: the file's modification time is taken for the end, so UTC may be off by hours")
            with os_errors_as("cannot be read", where=self.path):
                base_ns = self.path.stat().st_mtime_ns - max(each for each in elapsed if each is not None)
            return [None if each is None else base_ns + each for each in elapsed]
        return self._spread(stated)

    def _with_utc(self, host: Sequence[int | None], unix: Sequence[int | None]) -> list[int | None]:
        """The host's local times, moved to the vehicle's UTC where rows state it."""
        offsets = sorted(
            utc - at for utc, at in zip(unix, host, strict=True) if utc is not None and at is not None and utc > 0
        )
        if not offsets:
            self._notes.append("no UTC of the vehicle: the host's clock, of an unknown zone, is taken for UTC")
            return list(host)
        offset_ns = offsets[len(offsets) // 2]
        stamps = [None if at is None else at + offset_ns for at in host]
        return self._nudged(stamps)

    @staticmethod
    def _nudged(stamps: Sequence[int | None]) -> list[int | None]:
        """Times of messages that came in one millisecond, one nanosecond after the other."""
        last_ns, nudged = 0, list[int | None]()
        for stamp in stamps:
            is_same = stamp is not None and last_ns - _MS_NS < stamp <= last_ns
            nudged.append(last_ns + 1 if is_same else stamp)
            last_ns = max(nudged[-1] or 0, last_ns)
        return nudged

    def _spread(self, stamps: Sequence[int | None]) -> list[int | None]:
        """Whole seconds that several rows share, spread evenly over the second."""
        counts: dict[int, int] = {}
        for stamp in stamps:
            if stamp is not None:
                counts[stamp] = counts.get(stamp, 0) + 1
        if max(counts.values(), default=1) == 1:
            return list(stamps)
        self._notes.append("its clock counts whole seconds: the rows of each are spread evenly over it")
        seen: dict[int, int] = {}
        spread: list[int | None] = []
        for stamp in stamps:
            if stamp is None:
                spread.append(None)
                continue
            seen[stamp] = seen.get(stamp, -1) + 1
            spread.append(stamp + seen[stamp] * SECOND_NS // counts[stamp])
        return spread


def _lines(path: Path) -> list[bytes]:
    """The file's rows; a quoted line end does not end one.

    Raises:
        InputError: The file cannot be read, or holds no text.
    """
    if not path.exists():
        raise InputError("no such file", where=path, expected=TITLE, hint="check the path")
    with os_errors_as("cannot be read", where=path, expected=TITLE):
        if path.is_file() and path.stat().st_size > _MOST_BYTES:
            raise InputError("wrong type of file", where=path, got=f"more than {_MOST_BYTES >> 20} MB", expected=TITLE)
        data = read_whole(path).removeprefix(b"\xef\xbb\xbf")
    if not data.strip() or b"\0" in data[:512]:
        raise InputError("wrong type of file", where=path, got=looks_like(path), expected=TITLE)
    if data.count(b'"') % 2:  # a quote that nothing closes must not swallow the rest
        return data.splitlines(keepends=True)
    return [line for line in _LINE.findall(data) if line]


def _layout(path: Path, head: bytes, columns: Mapping[str, str] | None) -> Layout:
    text = head.decode("utf-8-sig", "replace").strip("\r\n")
    if columns is None:
        found = layout_of(text)
        if found is None:
            hint = "name its columns in [telemetry.columns]"
            raise InputError("wrong type of file", where=path, got=looks_like(path), expected=TITLE, hint=hint)
        return found
    layout, missing = mapped_layout(text, columns)
    if missing:
        got, names = f"no {', '.join(missing)}", text.replace(layout.delimiter, ", ")
        raise InputError("telemetry.columns names columns that are not there", where=path, got=got, expected=names)
    has_time = {UTC, LOCAL, "elapsed_s", "elapsed_ms", "unix_s", "unix_ms", "unix_us"} & layout.columns.keys()
    if not has_time:
        raise InputError("telemetry.columns names no time", where=path, expected=f"{UTC}, unix_s or elapsed_s")
    return layout
