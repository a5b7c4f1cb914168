"""Several ticks' telemetry at once: which rows came by which tick, and what the clocks were at each of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.telemetry import NO_BOOT_TIME, ClockTrack, Track, joined
from aerodft.service.clock_line import JUMP_NS, Line, StatedLine
from aerodft.service.delayed_line import DelayedLine


@dataclass(frozen=True, slots=True)
class Ticks:
    """Tracks that came over several ticks, at least one row in each.

    Attributes:
        tracks: Their rows in order of arrival.
        edges: For each track ``(ticks,)`` how many of its rows had come by each tick.
        count: Number of ticks.
    """

    tracks: tuple[Track, ...]
    edges: tuple[IntArray, ...]
    count: int

    @classmethod
    def of(cls, tracks: tuple[Track, ...], ticks_ns: IntArray) -> "Ticks":
        """Tracks ``(n,)`` whose rows arrived by the last of ``ticks_ns (ticks,)``."""
        edges = tuple(np.searchsorted(track.arrival_ns, ticks_ns, side="right") for track in tracks)
        return cls(tracks, edges, len(ticks_ns))

    def tick_of(self, edges: IntArray) -> IntArray:
        """By which tick each row ``(n,)`` of a track had come."""
        return np.repeat(np.arange(self.count), np.diff(edges, prepend=0))

    def last_arrivals(self) -> IntArray:
        """``(ticks,)`` when the last row of each arrived; 0 where none did."""
        last = np.zeros(self.count, dtype=np.int64)
        for track, edges in zip(self.tracks, self.edges, strict=True):
            came = np.flatnonzero(np.diff(edges, prepend=0))
            last[came] = np.maximum(last[came], track.arrival_ns[edges[came] - 1])
        return last

    def between(self, first: int, stop: int) -> "Ticks":
        """What came in the ticks from ``first`` and before ``stop``."""
        tracks, ends = [], []
        for track, edges in zip(self.tracks, self.edges, strict=True):
            start = int(edges[first - 1]) if first else 0
            end = int(edges[stop - 1]) if stop else 0
            if end > start:
                rows = slice(start, end)
                tracks.append(track.rows(rows, boot_ns=track.boot_ns))
                ends.append(edges[first:stop] - start)
        return Ticks(tuple(tracks), tuple(ends), stop - first)


@dataclass(frozen=True, slots=True)
class KnownRows:
    """All rows with a time since boot, tick after tick; within a tick track after track."""

    boot_ns: IntArray
    arrival_ns: IntArray
    tick: IntArray

    @classmethod
    def of(cls, tracks: tuple[Track, ...], ticks: Ticks) -> "KnownRows":
        """The known rows of tracks with the edges of ``ticks``."""
        boots = np.concatenate([track.boot_ns for track in tracks])
        arrivals = np.concatenate([track.arrival_ns for track in tracks])
        tick = np.concatenate([ticks.tick_of(edges) for edges in ticks.edges])
        known = np.flatnonzero(boots != NO_BOOT_TIME)
        order = known[np.argsort(tick[known], kind="stable")]
        return cls(boots[order], arrivals[order], tick[order])

    def fastest(self, own_ns: IntArray) -> IntArray:
        """The fastest row of each tick that has any, of those the first."""
        starts = np.flatnonzero(np.diff(self.tick, prepend=-1))
        delays = self.arrival_ns - own_ns
        least = np.repeat(np.minimum.reduceat(delays, starts), np.diff(starts, append=len(delays)))
        is_least = np.flatnonzero(delays == least)
        return np.asarray(is_least[np.searchsorted(is_least, starts)])


@dataclass(frozen=True, slots=True, eq=False)
class LineTable:
    """A clock's line at each of several ticks, as columns.

    Attributes:
        at_ns: ``(ticks,)`` as in ``Line``.
        offset_ns: Likewise.
        drift: Likewise.
    """

    at_ns: IntArray
    offset_ns: IntArray
    drift: FloatArray

    @classmethod
    def of(cls, lines: Sequence[Line], from_tick: Sequence[int], count: int) -> "LineTable":
        """Of ``count`` ticks: the first of some lines, and each other one from its tick on."""
        which = np.searchsorted(from_tick, np.arange(count), side="right")
        at_ns, offset_ns = (np.array([getattr(each, name) for each in lines]) for name in ("at_ns", "offset_ns"))
        return cls(at_ns[which], offset_ns[which], np.array([each.drift for each in lines])[which])

    def line(self, tick: int) -> Line:
        """That of one tick."""
        return Line(int(self.at_ns[tick]), int(self.offset_ns[tick]), float(self.drift[tick]))

    def offset(self, own_ns: IntArray, tick: IntArray) -> IntArray:
        """As ``Line.offset`` at times ``(n,)``, each by the line of its tick ``(n,)``."""
        gained: IntArray = np.rint(self.drift[tick] * (own_ns - self.at_ns[tick])).astype(np.int64)
        return self.offset_ns[tick] + gained

    def own(self, other_ns: IntArray, tick: IntArray) -> IntArray:
        """Times ``(n,)`` of this clock by those of the other, likewise."""
        return other_ns - self.offset(other_ns - self.offset_ns[tick], tick)


class TickLines:
    """The clocks at each of several ticks, as they are learned.

    Attributes:
        stated: UTC minus time since boot, after the last tick.
        host_minus_boot: After the last tick.
        host_minus_utc: After the last tick.
        host: Its line after each tick; None before it is learned.
    """

    def __init__(self, stated: StatedLine, host_minus_boot: DelayedLine, host_minus_utc: DelayedLine) -> None:
        self.stated, self.host_minus_boot, self.host_minus_utc = stated, host_minus_boot, host_minus_utc
        self.host: LineTable | None = None

    def learn(self, tracks: tuple[Track, ...], ticks: Ticks, last_boot_ns: int) -> bool:
        """Learn from rows of one clock that goes on; False where a clock jumps, as ``ClockMap.update`` sees it."""
        before, stated = self.stated.line, self._stated_lines(tracks, ticks)
        if before is None or stated is None:
            return False
        self._utc = stated
        known = KnownRows.of(tracks, ticks)
        newest = np.full(ticks.count, last_boot_ns)
        np.maximum.at(newest, known.tick, known.boot_ns)
        by_newest = self._utc.offset(np.maximum.accumulate(newest), np.arange(ticks.count))
        steps = np.diff(by_newest, prepend=before.offset_at(last_boot_ns))
        return not np.any(np.abs(steps) > JUMP_NS) and self._learn_host(known, ticks)

    def to_utc(self, track: Track, tick: IntArray) -> IntArray:
        """UTC stamps ``(n,)`` of a track's rows, each by what was known at its ``tick (n,)``."""
        bare = track.boot_ns == NO_BOOT_TIME
        stamps: IntArray = track.boot_ns + self._utc.offset(track.boot_ns, tick)
        if self.host is None or not np.any(bare):
            return stamps
        by_arrival = track.arrival_ns - self.host.offset(track.arrival_ns, tick)
        return np.where(bare, by_arrival, stamps)

    def _stated_lines(self, tracks: tuple[Track, ...], ticks: Ticks) -> LineTable | None:
        """Learn what the vehicle says of UTC; its line at each tick, None where it says something else than before."""
        said: list[tuple[int, int, int]] = []
        for track, edges in zip(tracks, ticks.edges, strict=True):
            if isinstance(track, ClockTrack):
                offsets_ns = (track.unix_ns - track.boot_ns).tolist()
                said += zip(ticks.tick_of(edges).tolist(), track.boot_ns.tolist(), offsets_ns, strict=True)
        line, changes = self.stated.line, list[int]()
        if line is None:
            return None
        lines = [line]
        for tick, boot_ns, offset_ns in sorted(said, key=itemgetter(0)):  # of one tick as they came
            if boot_ns == NO_BOOT_TIME:
                continue
            if abs(offset_ns - lines[-1].offset_at(boot_ns)) > JUMP_NS:
                return None
            self.stated.learn(boot_ns, offset_ns)
            if self.stated.line is not None and self.stated.line is not lines[-1]:
                lines.append(self.stated.line)
                changes.append(tick)
        return LineTable.of(lines, changes, ticks.count)

    def _learn_host(self, known: KnownRows, ticks: Ticks) -> bool:
        before = self.host_minus_utc.line
        if before is None:
            return False
        if not len(known.tick):
            self.host = LineTable.of([before], [], ticks.count)
            return True
        utc_ns = known.boot_ns + self._utc.offset(known.boot_ns, known.tick)
        by_boot, by_utc = known.fastest(known.boot_ns), known.fastest(utc_ns)
        alone = np.zeros(len(by_utc), dtype=np.int64)
        self.host_minus_boot.learn_fastest(known.boot_ns[by_boot], known.arrival_ns[by_boot], alone)
        learned = self.host_minus_utc.learn_fastest(utc_ns[by_utc], known.arrival_ns[by_utc], alone)
        arrived_ns, rows = ticks.last_arrivals()[known.tick[by_utc]], np.arange(len(by_utc))
        after = learned.offset_of_host(arrived_ns, rows)
        first = before.offset_at(int(arrived_ns[0]) - before.offset_ns)
        then = np.concatenate([[first], learned.offset_of_host(arrived_ns[1:], rows[:-1])])
        if np.any(np.abs(after - then) > JUMP_NS) or np.any(learned.is_unsettled):
            return False
        came = np.cumsum(np.bincount(known.tick[by_utc], minlength=ticks.count))
        columns = (learned.at_ns, before.at_ns), (learned.offset_ns, before.offset_ns), (learned.drift, before.drift)
        self.host = LineTable(*(np.concatenate([[first], then])[came] for then, first in columns))
        return True


def of_a_kind(
    tracks: tuple[Track, ...], stamps: Sequence[IntArray], edges: Sequence[IntArray]
) -> Iterator[tuple[Track, IntArray, IntArray]]:
    """Tracks with stamps and edges, those of one kind as one: tick after tick, within a tick track after track.

    Rows of two messages that fill one stream are dropped where they go back in time, and that depends on their order.
    """
    kinds: dict[tuple[type[Track], object], list[int]] = {}
    for row, track in enumerate(tracks):
        kinds.setdefault((type(track), getattr(track, "source", None)), []).append(row)
    for rows in kinds.values():
        if len(rows) == 1:
            yield tracks[rows[0]], stamps[rows[0]], edges[rows[0]]
            continue
        tick = np.concatenate([np.repeat(np.arange(len(edges[row])), np.diff(edges[row], prepend=0)) for row in rows])
        order = np.argsort(tick, kind="stable")
        together = joined([tracks[row] for row in rows])
        ends = np.sum([edges[row] for row in rows], axis=0)
        ordered = np.concatenate([stamps[row] for row in rows])[order]
        yield together.rows(order, boot_ns=together.boot_ns), ordered, ends
