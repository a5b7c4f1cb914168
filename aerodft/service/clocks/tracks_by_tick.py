"""The telemetry of a step's ticks: which rows came by which tick, and a clock's line at each of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model import NO_BOOT_TIME, FloatArray, IntArray, Track, joined
from aerodft.service.clocks.stated_offset import ClockOffset

_NOTHING: Final = np.empty(0, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Ticks:
    """Tracks that came over several ticks, at least one row in each.

    Attributes:
        tracks: Their rows in order of arrival.
        row_ends: For each track ``(ticks,)`` how many of its rows had come by each tick.
        count: Number of ticks.
    """

    tracks: tuple[Track, ...]
    row_ends: tuple[IntArray, ...]
    count: int

    @classmethod
    def of(cls, tracks: tuple[Track, ...], ticks_ns: IntArray) -> "Ticks":
        """Tracks ``(n,)`` whose rows arrived by the last of ``ticks_ns (ticks,)``."""
        row_ends = tuple(np.searchsorted(track.arrival_ns, ticks_ns, side="right") for track in tracks)
        return cls(tracks, row_ends, len(ticks_ns))

    @classmethod
    def one(cls, tracks: tuple[Track, ...]) -> "Ticks":
        """Tracks that came in one tick."""
        return cls(tracks, tuple(np.array([len(track.arrival_ns)]) for track in tracks), 1)

    def of_tracks(self, tracks: tuple[Track, ...]) -> "Ticks":
        """The ticks with what is left of the tracks: with all rows of each, or, of one tick, with some."""
        return Ticks(tracks, self.row_ends, self.count) if self.count > 1 else Ticks.one(tracks)

    def where(self, wanted: Sequence[bool]) -> "Ticks":
        """The ticks with some of the tracks."""
        return self.picked([k for k, is_wanted in enumerate(wanted) if is_wanted])

    def picked(self, kept: Sequence[int]) -> "Ticks":
        """The ticks with tracks by indices."""
        return Ticks(tuple(self.tracks[k] for k in kept), tuple(self.row_ends[k] for k in kept), self.count)

    def tick_of(self, row_end_by_tick: IntArray) -> IntArray:
        """By which tick each row ``(n,)`` of a track had come."""
        return np.repeat(np.arange(self.count), np.diff(row_end_by_tick, prepend=0))

    def last_arrivals(self) -> IntArray:
        """``(ticks,)`` when the last row of each arrived; 0 where none did."""
        last = np.zeros(self.count, dtype=np.int64)
        for track, own in zip(self.tracks, self.row_ends, strict=True):
            came = np.flatnonzero(np.diff(own, prepend=0))
            last[came] = np.maximum(last[came], track.arrival_ns[own[came] - 1])
        return last

    def between(self, first: int, stop: int) -> "Ticks":
        """What came in the ticks from ``first`` and before ``stop``."""
        tracks, ends = [], []
        for track, own in zip(self.tracks, self.row_ends, strict=True):
            start = int(own[first - 1]) if first else 0
            end = int(own[stop - 1]) if stop else 0
            if end > start:
                rows = slice(start, end)
                tracks.append(track.rows(rows, boot_ns=track.boot_ns))
                ends.append(own[first:stop] - start)
        return Ticks(tuple(tracks), tuple(ends), stop - first)


@dataclass(frozen=True, slots=True)
class StampedRows:
    """All rows with a time since boot, tick after tick; within a tick track after track."""

    boot_ns: IntArray
    arrival_ns: IntArray
    tick: IntArray

    @classmethod
    def of(cls, ticks: Ticks) -> "StampedRows":
        """The known rows of tracks."""
        boots = np.concatenate([_NOTHING, *(track.boot_ns for track in ticks.tracks)])
        arrivals = np.concatenate([_NOTHING, *(track.arrival_ns for track in ticks.tracks)])
        tick = np.concatenate([_NOTHING, *(ticks.tick_of(own) for own in ticks.row_ends)])
        known = np.flatnonzero(boots != NO_BOOT_TIME)
        order = known[np.argsort(tick[known], kind="stable")]
        return cls(boots[order], arrivals[order], tick[order])

    def fastest(self, own_ns: IntArray) -> tuple[IntArray, IntArray]:
        """The fastest row of each tick that has any, of those the first; and by how much the median is slower (ns)."""
        starts = np.flatnonzero(np.diff(self.tick, prepend=-1))
        sizes = np.diff(starts, append=len(self.tick))
        delays = self.arrival_ns - own_ns
        ordered = delays[np.lexsort((delays, self.tick))]
        least = ordered[starts]
        middles = ordered[starts + (sizes - 1) // 2], ordered[starts + sizes // 2]
        median = np.trunc((middles[0] + middles[1]) / 2).astype(np.int64)
        is_least = np.flatnonzero(delays == np.repeat(least, sizes))
        return is_least[np.searchsorted(is_least, starts)], median - least


@dataclass(frozen=True, slots=True, eq=False)
class OffsetsByTick:
    """A clock's line at each of several ticks, as columns.

    Attributes:
        at_ns: ``(ticks,)`` as in ``ClockOffset``.
        offset_ns: ``(ticks,)`` as in ``ClockOffset``.
        drift: ``(ticks,)`` as in ``ClockOffset``.
        off_ns: ``(ticks,)`` how far what is heard lies off the line, while it is not settled which is right; else 0.
    """

    at_ns: IntArray
    offset_ns: IntArray
    drift: FloatArray
    off_ns: IntArray

    @classmethod
    def of(cls, lines: Sequence[ClockOffset], from_tick: Sequence[int], count: int, off_ns: int = 0) -> "OffsetsByTick":
        """Of ``count`` ticks: the first of some lines, and each other one from its tick on."""
        which = np.searchsorted(from_tick, np.arange(count), side="right")
        at_ns, offset_ns = (np.array([getattr(each, name) for each in lines]) for name in ("at_ns", "offset_ns"))
        drift = np.array([each.drift for each in lines])
        return cls(at_ns[which], offset_ns[which], drift[which], np.full(count, off_ns))

    def followed_by(self, other: "OffsetsByTick", ticks: IntArray) -> "OffsetsByTick":
        """The lines at some ticks ``(n,)``, which are counted through this table and on through another."""
        pairs = ((getattr(each, name) for each in (self, other)) for name in self.__slots__)
        return OffsetsByTick(*(np.concatenate(list(pair))[ticks] for pair in pairs))

    def line(self, tick: int) -> ClockOffset:
        """The offset at one tick."""
        return ClockOffset(int(self.at_ns[tick]), int(self.offset_ns[tick]), float(self.drift[tick]))

    def offset(self, own_ns: IntArray, tick: IntArray) -> IntArray:
        """The other clock minus this one at times ``(n,)`` of this one, each by the line of its tick ``(n,)``."""
        gained: IntArray = np.rint(self.drift[tick] * (own_ns - self.at_ns[tick])).astype(np.int64)
        return self.offset_ns[tick] + gained

    def own(self, other_ns: IntArray, tick: IntArray) -> IntArray:
        """Times ``(n,)`` of this clock by those of the other, each by the line of its tick ``(n,)``."""
        return other_ns - self.offset(other_ns - self.offset_ns[tick], tick)


def grouped_by_stream(
    tracks: Sequence[Track], stamps: Sequence[IntArray], row_ends: Sequence[IntArray]
) -> Iterator[tuple[Track, IntArray, IntArray]]:
    """Tracks with stamps and rows by tick, those of one kind as one: tick after tick, within a tick track after track.

    Rows of two messages that fill one stream are dropped where they go back in time, and that depends on their order.
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
        together = joined([tracks[row] for row in rows])
        ends = np.sum([row_ends[row] for row in rows], axis=0)
        ordered = np.concatenate([stamps[row] for row in rows])[order]
        yield together.rows(order, boot_ns=together.boot_ns), ordered, ends
