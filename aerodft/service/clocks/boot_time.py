"""One vehicle's time since boot, followed through wraps and reboots, and held apart from another vehicle's.

Rows are taken in order of arrival. One is of the followed clock if it goes on from there: not far back (a late
message), and not farther ahead than time has passed. Anything else may be a reboot, or a second autopilot with the same
ids: it is left out, until it goes on by itself while the followed clock is silent.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import NO_BOOT_TIME, BoolArray, IntArray, SyncTrack, Track

STEP_NS: Final = 2 * SECOND_NS
"""Farther back than this, or farther ahead than time has passed, is another clock, not a late message."""

WRAP_NS: Final = (1 << 32) * 1_000_000
"""Milliseconds in 32 bits begin anew after 49.7 days."""

_SILENCE_NS: Final = SECOND_NS  # of the followed clock, before another one is taken for its successor
_RIVAL_SILENCE_NS: Final = 10 * SECOND_NS  # where both run at once
_CONFIRMATIONS: Final = 3
_ANCHOR_NS: Final = SECOND_NS // 2  # an unstamped row takes the time of a stamped one this close before it
_FOLLOWED, _CANDIDATE, _DROPPED = 0, 1, 2
_NOTHING: Final = np.empty(0, dtype=np.int64)
_LONG_AGO_NS: Final = -(1 << 61)


@dataclass(slots=True)
class _Run:
    """A clock that goes on from row to row; ``lead_ns`` is the least of arrival minus boot."""

    boot_ns: int
    arrival_ns: int
    lead_ns: int
    rows: int = 1

    def goes_on(self, boot_ns: int, arrival_ns: int) -> bool:
        passed_ns = max(arrival_ns - self.arrival_ns, 0)
        latest_ns = max(self.boot_ns + passed_ns, arrival_ns - self.lead_ns)
        return self.boot_ns - STEP_NS <= boot_ns <= latest_ns + STEP_NS

    def advance(self, boot_ns: int, arrival_ns: int) -> None:
        self.boot_ns, self.arrival_ns = max(self.boot_ns, boot_ns), max(self.arrival_ns, arrival_ns)
        self.lead_ns = min(self.lead_ns, arrival_ns - boot_ns)
        self.rows += 1


@dataclass(frozen=True, slots=True)
class _Anchor:
    """The last stamped row."""

    arrival_ns: int
    boot_ns: int
    owner: int


def _begun(boot_ns: int, arrival_ns: int) -> _Run:
    return _Run(boot_ns, arrival_ns, arrival_ns - boot_ns)


class BootClock:
    """Which rows are of the followed clock, and their time since boot.

    Attributes:
        restarts: How often a new clock was taken up.
        wraps: How often it began anew at 32 bits.
        left_out: Rows of other clocks.
        rivals: How often the followed clock was heard again after another one.
    """

    def __init__(self) -> None:
        self.restarts = self.wraps = self.left_out = self.rivals = 0
        self._followed: _Run | None = None
        self._other: _Run | None = None
        self._anchor = _Anchor(_LONG_AGO_NS, 0, _DROPPED)

    def copy(self) -> "BootClock":
        """A copy that learns on its own."""
        other = BootClock()
        other.restarts, other.wraps, other.left_out, other.rivals = (
            self.restarts,
            self.wraps,
            self.left_out,
            self.rivals,
        )
        other._followed = None if self._followed is None else replace(self._followed)
        other._other = None if self._other is None else replace(self._other)
        other._anchor = self._anchor
        return other

    def is_as_calm_as(self, before: "BootClock") -> bool:
        """Whether one clock was heard, then and since, and nothing else happened to it."""
        happened = [(each.restarts, each.wraps, each.left_out, each.rivals) for each in (self, before)]
        return happened[0] == happened[1] and before.is_alone and self.is_alone

    @property
    def is_alone(self) -> bool:
        """Whether a clock is followed, and no other one is heard."""
        return self._followed is not None and self._other is None

    @property
    def last_boot_ns(self) -> int | None:
        """Newest time since boot; None before the first."""
        return None if self._followed is None else self._followed.boot_ns

    @property
    def has_other_clock(self) -> bool:
        """Whether two clocks run at once: stray rows are fewer."""
        return self.rivals >= _CONFIRMATIONS

    @property
    def other_apart_ns(self) -> int | None:
        """By how much another clock that is heard is ahead; None where there is none."""
        if self._followed is None or self._other is None:
            return None
        passed_ns = self._other.arrival_ns - self._followed.arrival_ns
        return self._other.boot_ns - self._followed.boot_ns - passed_ns

    def follow(self, tracks: tuple[Track, ...], *, near_ns: int = STEP_NS) -> tuple[tuple[Track, ...], bool]:
        """Take in the tracks of one tick, or of several calm ones.

        Args:
            tracks: The tracks.
            near_ns: How far the clock may be from where the last rows see it in rows that synchronise clocks: these
                come from others, which say the followed clock's time or another's.

        Returns:
            Their rows of the followed clock, wraps undone, unstamped rows with the time of the stamped one before them,
            those that synchronise clocks last; and whether that is a new clock.
        """
        spoken = [track for track in tracks if not isinstance(track, SyncTrack)]
        arrivals = np.concatenate([_NOTHING, *(track.arrival_ns for track in spoken)])
        boots = np.concatenate([_NOTHING, *(track.boot_ns for track in spoken)])
        bare = boots == NO_BOOT_TIME
        order = np.lexsort((boots, bare, arrivals))
        restarts = self.restarts
        known, mine = np.empty_like(boots), np.empty(len(boots), dtype=np.bool_)
        known[order], mine[order] = self._told(arrivals[order], boots[order], bare[order])
        edges = np.cumsum([0, *(len(track.boot_ns) for track in spoken)]).tolist()
        parts = zip(spoken, pairwise(edges), strict=True)
        kept = [track.rows(mine[start:stop], boot_ns=known[start:stop]) for track, (start, stop) in parts]
        kept += [
            track.rows(self._near(track, near_ns), boot_ns=track.boot_ns)
            for track in tracks
            if isinstance(track, SyncTrack)
        ]
        return tuple(track for track in kept if len(track.arrival_ns)), self.restarts > restarts

    def _told(self, arrivals: IntArray, boots: IntArray, bare: BoolArray) -> tuple[IntArray, BoolArray]:
        """Time since boot, and whether it is of the followed clock, of rows ``(n,)`` in order of arrival."""
        stamped = ~bare
        restarts = self.restarts
        heard = self._unwrapped(boots[stamped], arrivals[stamped])
        owners = self._owners(heard, arrivals[stamped])
        self.left_out += int(np.count_nonzero(owners != _FOLLOWED))
        if self.restarts > restarts:
            self._anchor = _Anchor(self._anchor.arrival_ns, self._anchor.boot_ns, _DROPPED)
        at = np.cumsum(stamped)  # the last stamped row by then; 0 is that of the tick before
        told_ns = np.concatenate([[self._anchor.arrival_ns], arrivals[stamped]])
        told_boot = np.concatenate([[self._anchor.boot_ns], heard])
        told_by = np.concatenate([[self._anchor.owner], owners])
        if len(heard):
            self._anchor = _Anchor(int(told_ns[-1]), int(told_boot[-1]), int(told_by[-1]))
        near = arrivals - told_ns[at] <= _ANCHOR_NS
        nobody = _FOLLOWED if self._other is None else _DROPPED
        mine = np.where(near, told_by[at], nobody) == _FOLLOWED
        return np.where(near, told_boot[at], NO_BOOT_TIME), mine

    def _near(self, track: Track, near_ns: int) -> BoolArray:
        """Rows whose sender means the followed clock's time since boot."""
        run = self._followed
        if run is None:
            return np.zeros(len(track.boot_ns), dtype=np.bool_)
        expected = run.boot_ns + track.arrival_ns - run.arrival_ns
        return np.asarray(np.abs(track.boot_ns - expected) <= near_ns)

    def _unwrapped(self, boots: IntArray, arrivals: IntArray) -> IntArray:
        """Times since boot with whole wraps added, by what the followed clock must have come to."""
        run = self._followed
        if run is None or len(boots) == 0:
            return boots
        wraps = np.maximum(np.rint((run.boot_ns + arrivals - run.arrival_ns - boots) / WRAP_NS), 0).astype(np.int64)
        unwrapped = boots + wraps * WRAP_NS
        near = np.abs(unwrapped - run.boot_ns - (arrivals - run.arrival_ns)) <= STEP_NS
        self.wraps = max(self.wraps, int(np.max(wraps, where=near, initial=0)))
        return np.where(near, unwrapped, boots)

    def _owners(self, boots: IntArray, arrivals: IntArray) -> IntArray:
        """Whose each row ``(n,)`` is, in order of arrival."""
        owners = np.full(len(boots), _FOLLOWED, dtype=np.int64)
        if len(boots) == 0 or self._goes_on_smoothly(boots, arrivals):
            return owners
        for row, (boot_ns, arrival_ns) in enumerate(zip(boots.tolist(), arrivals.tolist(), strict=True)):
            owners[row] = self._owner(boot_ns, arrival_ns)
            if self._takes_over(arrival_ns):
                owners[: row + 1] = np.where(owners[: row + 1] == _CANDIDATE, _FOLLOWED, _DROPPED)
                self._followed, self._other = self._other, None
                self.restarts += 1
                self.wraps = self.rivals = 0
        return owners

    def _goes_on_smoothly(self, boots: IntArray, arrivals: IntArray) -> bool:
        """Take in rows ``(n,)`` at once, where all of them are of the followed clock."""
        if self._other is not None:
            return False
        run = self._followed or _begun(int(boots[0]), int(arrivals[0]))
        self._followed = run
        newest = np.maximum.accumulate(np.concatenate([[run.boot_ns], boots]))
        passed = np.maximum(np.diff(arrivals, prepend=run.arrival_ns), 0)
        if np.any(newest[1:] - boots > STEP_NS) or np.any(np.diff(newest) - passed > STEP_NS):
            return False
        run.boot_ns, run.arrival_ns = int(newest[-1]), max(run.arrival_ns, int(arrivals[-1]))
        run.lead_ns = min(run.lead_ns, int(np.min(arrivals - boots)))
        return True

    def _owner(self, boot_ns: int, arrival_ns: int) -> int:
        if self._followed is not None and self._followed.goes_on(boot_ns, arrival_ns):
            self._followed.advance(boot_ns, arrival_ns)
            if self._other is not None:
                self.rivals, self._other = self.rivals + 1, None
            return _FOLLOWED
        if self._other is not None and self._other.goes_on(boot_ns, arrival_ns):
            self._other.advance(boot_ns, arrival_ns)
        else:
            self._other = _begun(boot_ns, arrival_ns)
        return _CANDIDATE

    def _takes_over(self, arrival_ns: int) -> bool:
        """Whether the other clock has gone on long enough while the followed one was silent."""
        if self._other is None or self._followed is None or self._other.rows < _CONFIRMATIONS:
            return False
        silence_ns = _RIVAL_SILENCE_NS if self.has_other_clock else _SILENCE_NS
        return arrival_ns - self._followed.arrival_ns >= silence_ns
