"""Tracks of the ticks of a step with the rows that had arrived by each tick, and clock offsets at each tick."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from aerodft.model import NO_BOOT_TIME, FloatArray, IntArray, Track, concatenate_tracks
from aerodft.service.clocks.stated_offset import ClockOffset

_EMPTY: Final = np.empty(0, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Ticks:
    """Tracks that arrived over several ticks, at least one row in each track.

    Attributes:
        tracks: Their rows in order of arrival.
        row_ends: For each track ``(ticks,)`` the number of rows that had arrived by each tick.
        count: Number of ticks.
    """

    tracks: tuple[Track, ...]
    row_ends: tuple[IntArray, ...]
    count: int

    @classmethod
    def from_tracks(cls, tracks: tuple[Track, ...], ticks_ns: IntArray) -> "Ticks":
        """Tracks ``(n,)`` whose rows arrived by the last of ``ticks_ns (ticks,)``."""
        row_ends = tuple(np.searchsorted(track.arrival_ns, ticks_ns, side="right") for track in tracks)
        return cls(tracks, row_ends, len(ticks_ns))

    @classmethod
    def one(cls, tracks: tuple[Track, ...]) -> "Ticks":
        """Tracks that arrived in one tick."""
        return cls(tracks, tuple(np.array([len(track.arrival_ns)]) for track in tracks), 1)

    def of_tracks(self, tracks: tuple[Track, ...]) -> "Ticks":
        """The ticks with other tracks: of equal length, or of any length for one tick."""
        return Ticks(tracks, self.row_ends, self.count) if self.count > 1 else Ticks.one(tracks)

    def where(self, selected: Sequence[bool]) -> "Ticks":
        """The ticks with the tracks of a mask."""
        return self.select([k for k, is_selected in enumerate(selected) if is_selected])

    def select(self, indices: Sequence[int]) -> "Ticks":
        """The ticks with tracks by their indices."""
        return Ticks(tuple(self.tracks[k] for k in indices), tuple(self.row_ends[k] for k in indices), self.count)

    def tick_of(self, row_end_by_tick: IntArray) -> IntArray:
        """Ticks ``(n,)`` in which the rows of a track arrived."""
        return np.repeat(np.arange(self.count), np.diff(row_end_by_tick, prepend=0))

    def last_arrivals(self) -> IntArray:
        """Arrivals ``(ticks,)`` of the last row of each tick; 0 without a row."""
        last = np.zeros(self.count, dtype=np.int64)
        for track, row_ends in zip(self.tracks, self.row_ends, strict=True):
            ticks = np.flatnonzero(np.diff(row_ends, prepend=0))
            last[ticks] = np.maximum(last[ticks], track.arrival_ns[row_ends[ticks] - 1])
        return last

    def between(self, first: int, stop: int) -> "Ticks":
        """The ticks from ``first`` up to before ``stop``."""
        tracks, ends = [], []
        for track, row_ends in zip(self.tracks, self.row_ends, strict=True):
            start = int(row_ends[first - 1]) if first else 0
            end = int(row_ends[stop - 1]) if stop else 0
            if end > start:
                rows = slice(start, end)
                tracks.append(track.rows(rows))
                ends.append(row_ends[first:stop] - start)
        return Ticks(tuple(tracks), tuple(ends), stop - first)


@dataclass(frozen=True, slots=True)
class StampedRows:
    """All rows with a time since boot, by ticks, within a tick by tracks."""

    boot_ns: IntArray
    arrival_ns: IntArray
    tick: IntArray

    @classmethod
    def from_ticks(cls, ticks: Ticks) -> "StampedRows":
        """The rows with a time since boot in the tracks of ticks."""
        boots = np.concatenate([_EMPTY, *(track.boot_ns for track in ticks.tracks)])
        arrivals = np.concatenate([_EMPTY, *(track.arrival_ns for track in ticks.tracks)])
        tick = np.concatenate([_EMPTY, *(ticks.tick_of(row_ends) for row_ends in ticks.row_ends)])
        stamped = np.flatnonzero(boots != NO_BOOT_TIME)
        order = stamped[np.argsort(tick[stamped], kind="stable")]
        return cls(boots[order], arrivals[order], tick[order])

    def fastest(self, own_ns: IntArray) -> tuple[IntArray, IntArray]:
        """First fastest row of each tick that has rows, and the median delay minus its own (ns)."""
        starts = np.flatnonzero(np.diff(self.tick, prepend=-1))
        sizes = np.diff(starts, append=len(self.tick))
        delays = self.arrival_ns - own_ns
        ordered = delays[np.lexsort((delays, self.tick))]
        fastest_ns = ordered[starts]
        medians = ordered[starts + (sizes - 1) // 2], ordered[starts + sizes // 2]
        median = np.trunc((medians[0] + medians[1]) / 2).astype(np.int64)
        candidates = np.flatnonzero(delays == np.repeat(fastest_ns, sizes))
        return candidates[np.searchsorted(candidates, starts)], median - fastest_ns


@dataclass(frozen=True, slots=True, eq=False)
class OffsetsByTick:
    """Clock offset lines at each of several ticks, as columns.

    Attributes:
        at_ns: ``(ticks,)`` as in ``ClockOffset``.
        offset_ns: ``(ticks,)`` as in ``ClockOffset``.
        drift: ``(ticks,)`` as in ``ClockOffset``.
        off_ns: ``(ticks,)`` deviation of samples from the line while a jump is unconfirmed; else 0.
    """

    at_ns: IntArray
    offset_ns: IntArray
    drift: FloatArray
    off_ns: IntArray

    @classmethod
    def from_lines(cls, lines: Sequence[ClockOffset], from_tick: Sequence[int], count: int, off_ns: int = 0) -> Self:
        """Columns of ``count`` ticks: the first line, and each further line from its tick on."""
        line_index = np.searchsorted(from_tick, np.arange(count), side="right")
        at_ns, offset_ns = (np.array([getattr(each, name) for each in lines]) for name in ("at_ns", "offset_ns"))
        drift = np.array([each.drift for each in lines])
        return cls(at_ns[line_index], offset_ns[line_index], drift[line_index], np.full(count, off_ns))

    def followed_by(self, other: "OffsetsByTick", ticks: IntArray) -> "OffsetsByTick":
        """The lines at ticks ``(n,)``, numbered through this table and on through the other."""
        pairs = ((getattr(each, name) for each in (self, other)) for name in self.__slots__)
        return OffsetsByTick(*(np.concatenate(list(pair))[ticks] for pair in pairs))

    def line(self, tick: int) -> ClockOffset:
        """The line at one tick."""
        return ClockOffset(int(self.at_ns[tick]), int(self.offset_ns[tick]), float(self.drift[tick]))

    def offset(self, own_ns: IntArray, tick: IntArray) -> IntArray:
        """Other clock minus this one at times ``(n,)`` of this one, by the lines of ticks ``(n,)``."""
        growth: IntArray = np.rint(self.drift[tick] * (own_ns - self.at_ns[tick])).astype(np.int64)
        return self.offset_ns[tick] + growth

    def own(self, other_ns: IntArray, tick: IntArray) -> IntArray:
        """Times ``(n,)`` of this clock at those of the other, by the lines of ticks ``(n,)``."""
        return other_ns - self.offset(other_ns - self.offset_ns[tick], tick)


def grouped_by_stream(
    tracks: Sequence[Track], stamps: Sequence[IntArray], row_ends: Sequence[IntArray]
) -> Iterator[tuple[Track, IntArray, IntArray]]:
    """Tracks concatenated by kind, with stamps and row ends: ordered by ticks, within a tick by tracks.

    The order matters where two messages fill one stream: rows that go back in time are dropped.
    """
    kinds: dict[tuple[type[Track], object, object], list[int]] = {}
    for row, track in enumerate(tracks):
        kinds.setdefault((type(track), getattr(track, "source", None), getattr(track, "what", None)), []).append(row)
    for rows in kinds.values():
        if len(rows) == 1:
            yield tracks[rows[0]], stamps[rows[0]], row_ends[rows[0]]
            continue
        tick = np.concatenate(
            [np.repeat(np.arange(len(row_ends[row])), np.diff(row_ends[row], prepend=0)) for row in rows]
        )
        order = np.argsort(tick, kind="stable")
        concatenated = concatenate_tracks([tracks[row] for row in rows])
        ends = np.sum([row_ends[row] for row in rows], axis=0)
        ordered = np.concatenate([stamps[row] for row in rows])[order]
        yield concatenated.rows(order), ordered, ends
