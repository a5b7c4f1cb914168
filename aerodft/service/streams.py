"""Recent samples of a telemetry stream, and which of them were known at each tick of the newest step.

Values are interpolated between two samples: never across a gap, never outside the samples.
"""

from abc import abstractmethod
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Protocol, Self, TypeVar

import numpy as np
import numpy.typing as npt

from aerodft.conventions import SECOND_NS
from aerodft.model import Batch, BoolArray, FloatArray, IntArray, Track

_Number = TypeVar("_Number", np.float64, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Brackets(Batch):
    """The two samples around each of ``n`` stamps; rows are undefined where ``is_known`` is false.

    Attributes:
        before: ``(n,)`` indices of the samples that are not after the stamps.
        after: ``(n,)`` indices of those that are not before them.
        weight: ``(n,)`` of the later one.
        gap_ns: ``(n,)`` between the two.
        is_known: ``(n,)`` whether both exist, no farther apart than the longest gap.
    """

    before: IntArray
    after: IntArray
    weight: FloatArray
    gap_ns: IntArray
    is_known: BoolArray

    def ends(self, values: npt.NDArray[_Number]) -> tuple[npt.NDArray[_Number], npt.NDArray[_Number]]:
        """Values ``(m, ...)`` of the samples before and after each stamp."""
        return values[self.before], values[self.after]

    def linear(self, values: FloatArray) -> FloatArray:
        """Values ``(m,)`` interpolated linearly at the stamps."""
        before, after = self.ends(values)
        return np.asarray(before + self.weight * (after - before))


@dataclass(frozen=True, slots=True, eq=False)
class Query(Batch):
    """``n`` stamps at which telemetry is asked for, each as of a tick.

    Attributes:
        stamps_ns: ``(n,)`` UTC.
        ticks: ``(n,)`` ticks as of which samples are known.
        watermark_ns: ``(n,)`` newest stamp of any stream: once past the stamp, and past a stream's last sample by more
            than its longest gap, nothing is pending any more.
    """

    stamps_ns: IntArray
    ticks: IntArray
    watermark_ns: IntArray

    @classmethod
    def final(cls, stamps_ns: IntArray, ticks: IntArray) -> Self:
        """Stamps ``(n,)`` as of ticks ``(n,)`` for which nothing more is waited for."""
        return cls(stamps_ns, ticks, np.full(len(stamps_ns), END_OF_TIME))

    def __len__(self) -> int:
        """``n``."""
        return len(self.stamps_ns)

    def at(self, stamps_ns: IntArray) -> "Query":
        """The same ticks and watermarks, at other stamps ``(n,)``."""
        return Query(stamps_ns, self.ticks, self.watermark_ns)


def brackets(
    stamps_ns: IntArray, query_ns: IntArray, max_gap_ns: int, visible_rows: tuple[IntArray, IntArray] | None = None
) -> Brackets:
    """Find the two samples around each stamp; none outside the samples or across a gap.

    Args:
        stamps_ns: ``(m,)`` of the samples, ascending.
        query_ns: ``(n,)`` stamps to interpolate at.
        max_gap_ns: Longest gap that is interpolated over.
        visible_rows: First usable sample and end of the usable ones for each stamp, ``(n,)`` both; None for all.
    """
    first, end = (0, len(stamps_ns)) if visible_rows is None else visible_rows
    after = np.searchsorted(stamps_ns, query_ns, side="left")
    inside = after < end
    after = np.minimum(after, max(len(stamps_ns) - 1, 0))
    if not len(stamps_ns):
        return Brackets(after, after, np.zeros(len(query_ns)), after, inside)
    exact = stamps_ns[after] == query_ns
    before = np.maximum(np.where(exact, after, after - 1), 0)
    gap = stamps_ns[after] - stamps_ns[before]
    known = inside & (exact | (after > 0)) & (before >= first) & (gap <= max_gap_ns)
    weight = (query_ns - stamps_ns[before]) / np.where(gap > 0, gap, 1)
    return Brackets(before, after, weight, gap, known)


HISTORY_NS: Final = 120 * SECOND_NS
"""Span of samples kept: longer than any image waits for its telemetry."""

END_OF_TIME: Final = np.iinfo(np.int64).max
"""Watermark of a stream that has ended."""

LAST: Final = np.array([-1])
"""The last tick of the newest step."""

_BEFORE_ALL_STAMPS: Final = np.iinfo(np.int64).min


class Missing(IntEnum):
    """Reason for no value at a stamp; arrays hold these as ``int64``."""

    NOTHING = 0  # there is a value
    PENDING = 1  # the next sample may still arrive
    STALE = 2  # samples, but not close enough on both sides
    NEVER = 3  # no sample up to then
    REFUSED = 4  # samples that are rejected


class Stream:
    """Samples in order of their UTC stamps, in arrays that grow at the end and are trimmed at the start.

    A sample whose stamp is not after the last one's is dropped and counted: a stamp's neighbours must not depend on how
    late a sample arrived. A step appends the samples of one or more ticks; queries are as of a tick, by its number in
    the newest step.

    Args:
        max_gap_ns: The longest gap that is interpolated over.

    Attributes:
        out_of_order: Number of samples dropped.
        appended: Number of samples kept, those removed since included.
    """

    def __init__(self, max_gap_ns: int) -> None:
        self.max_gap_ns = max_gap_ns
        self.out_of_order = 0
        self.appended = 0
        self._first_ns: int | None = None
        self._stamps: IntArray = np.empty(0, dtype=np.int64)
        self._columns: dict[str, npt.NDArray[np.generic]] = {}
        self._start = self._stop = 0
        self._view_first, self._view_end = np.zeros((2, 1), dtype=np.int64)  # rows that are known at each tick

    @property
    def is_empty(self) -> bool:
        """Whether there are no samples."""
        return self._start == self._stop

    @property
    def last_ns(self) -> int | None:
        """Stamp of the newest sample; None if empty."""
        return None if self.is_empty else int(self._stamps[self._stop - 1])

    @property
    def stamps_ns(self) -> IntArray:
        """Stamps ``(m,)`` of the samples, strictly ascending."""
        return self._stamps[self._start : self._stop]

    def column(self, name: str) -> FloatArray:
        """Values ``(m, ...)`` of the samples."""
        return np.asarray(self._columns[name][self._start : self._stop])

    def append(
        self, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None, **columns: npt.NDArray[np.generic]
    ) -> None:
        """Append the samples of a step.

        Args:
            stamps_ns: ``(k,)`` in order of arrival.
            row_end_by_tick: ``(ticks,)`` number of samples up to each tick; None for a step of one tick.
            columns: ``(k, ...)`` values.
        """
        if len(stamps_ns) == 0:
            return
        last = self.last_ns if not self.is_empty else np.iinfo(np.int64).min
        ceiling = np.maximum.accumulate(np.concatenate([[last], stamps_ns]))[:-1]
        keep = stamps_ns > ceiling
        kept = np.cumsum(keep)
        count = int(kept[-1])
        self.out_of_order += len(keep) - count
        self._reserve(count, columns)
        before, rows = self._stop, slice(self._stop, self._stop + count)
        self._stamps[rows] = stamps_ns[keep]
        for name, values in columns.items():
            self._columns[name][rows] = values[keep]
        self._stop += count
        self.appended += count
        if self._first_ns is None:
            self._first_ns = int(stamps_ns[0])
        ends = np.array([len(keep)]) if row_end_by_tick is None else row_end_by_tick
        self._update_views(before + np.concatenate([[0], kept])[ends])

    def commit(self) -> None:
        """End the step: later queries are as of its last tick."""
        self._view_first, self._view_end = self._view_first[-1:], self._view_end[-1:]

    def clear(self) -> None:
        """Remove all samples: their stamps are of another clock."""
        self._start = self._stop = 0
        self._view_first, self._view_end = np.zeros((2, 1), dtype=np.int64)
        if self._first_ns is not None:
            self._first_ns = _BEFORE_ALL_STAMPS

    def shift(self, by_ns: int) -> None:
        """Shift all stamps: the clock map has changed."""
        self._stamps[self._start : self._stop] += by_ns
        if self._first_ns is not None and self._first_ns != _BEFORE_ALL_STAMPS:
            self._first_ns += by_ns

    def rows_known_at(self, ticks: IntArray) -> tuple[IntArray, IntArray]:
        """First known row of ``stamps_ns`` and the end of the known rows, ``(n,)`` both, at ticks ``(n,)``."""
        if len(self._view_end) == 1:
            ticks = np.zeros_like(ticks)
        return self._view_first[ticks] - self._start, self._view_end[ticks] - self._start

    def newest_rows(self, count: int) -> tuple[IntArray, IntArray]:
        """Rows ``(m,)`` of the newest samples, at most ``count``, and the ticks ``(m,)`` from which they are known."""
        rows = np.arange(max(len(self.stamps_ns) - count, 0), len(self.stamps_ns))
        ticks = np.searchsorted(self._view_end - self._start, rows, side="right")
        return rows, np.minimum(ticks, len(self._view_end) - 1)

    def newest_ns(self, ticks: IntArray) -> IntArray:
        """Stamps of the newest samples known at ticks ``(n,)``; 0 if none."""
        if self.is_empty:
            return np.zeros(len(ticks), dtype=np.int64)
        first, end = self.rows_known_at(ticks)
        return np.where(end > first, self.stamps_ns[np.maximum(end, 1) - 1], 0)

    def began_by(self, stamps_ns: IntArray) -> BoolArray:
        """Whether there was a sample at or before each stamp ``(n,)``."""
        return np.full(len(stamps_ns), False) if self._first_ns is None else stamps_ns >= self._first_ns

    def find(self, query: Query) -> tuple[Brackets, IntArray]:
        """Find the two samples around each stamp.

        Returns:
            Brackets of rows of ``column``, and ``Missing`` ``(n,)``.
        """
        stamps_ns, watermark_ns = query.stamps_ns, query.watermark_ns
        first, end = self.rows_known_at(query.ticks)
        found = brackets(self.stamps_ns, stamps_ns, self.max_gap_ns, (first, end))
        newest_ns, is_any = self.newest_ns(query.ticks), end > first
        never_or_stale = np.where(self.began_by(stamps_ns), Missing.STALE, Missing.NEVER)
        is_over = (watermark_ns >= stamps_ns) & (~is_any | (watermark_ns - newest_ns > self.max_gap_ns))
        is_pending = ~(is_any & (newest_ns >= stamps_ns)) & ~is_over
        return found, np.where(found.is_known, Missing.NOTHING, np.where(is_pending, Missing.PENDING, never_or_stale))

    def last_before(self, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
        """Rows of ``column`` of the newest samples up to stamps ``(n,)`` as of ticks ``(n,)``; -1 if none."""
        first, end = self.rows_known_at(ticks)
        rows = np.minimum(np.searchsorted(self.stamps_ns, stamps_ns, side="right"), end) - 1
        return np.where(rows >= first, rows, -1)

    def ages_s(self, stamps_ns: IntArray, found: Brackets) -> FloatArray:
        """Time ``(n,)`` from each stamp to the nearer of the samples around it."""
        before, after = found.ends(self.stamps_ns)
        return np.asarray(np.minimum(stamps_ns - before, after - stamps_ns) / SECOND_NS)

    def _update_views(self, ends: IntArray) -> None:
        """Set the rows known at each tick from their ends, and release rows too old for any tick."""
        stamps = self._stamps[self._start : self._stop]
        newest = stamps[np.maximum(ends - self._start - 1, 0)]
        firsts = self._start + np.searchsorted(stamps, newest - HISTORY_NS)
        self._start = int(firsts[0])
        self._view_first, self._view_end = firsts, ends

    def _reserve(self, count: int, columns: dict[str, npt.NDArray[np.generic]]) -> None:
        if self._stop + count <= len(self._stamps):
            return
        kept, rows = self._stop - self._start, slice(self._start, self._stop)
        size = 2 * (kept + count) + 64
        stamps = np.empty(size, dtype=np.int64)
        stamps[:kept] = self._stamps[rows]
        for name, values in columns.items():
            column = np.empty((size, *values.shape[1:]), dtype=values.dtype)
            if name in self._columns:
                column[:kept] = self._columns[name][rows]
            self._columns[name] = column
        self._stamps, self._start, self._stop = stamps, 0, kept


class TelemetryPart(Protocol):
    """What a pose source keeps of some of a vehicle's tracks: streams, appended in steps of one or more ticks."""

    def pose_streams(self) -> tuple[Stream, ...]:
        """Streams that poses are computed from: they make the watermark. None, where poses are but checked by them."""
        return ()

    @abstractmethod
    def streams(self) -> tuple[Stream, ...]:
        """All streams."""

    @abstractmethod
    def may_append_ticks(self, track: Track) -> bool:
        """Whether a track of several ticks may be appended at once."""

    @abstractmethod
    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append a track of a step, as ``Stream.append``; tracks that are of no use here are ignored."""

    def commit(self) -> None:
        """End the step."""
        for stream in self.streams():
            stream.commit()

    def clear(self) -> None:
        """Remove all samples: their stamps are of another boot."""
        for stream in self.streams():
            stream.clear()

    def shift(self, by_ns: int) -> None:
        """Shift all stamps: the clock map has changed."""
        for stream in self.streams():
            stream.shift(by_ns)
