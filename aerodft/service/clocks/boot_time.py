"""Follows one vehicle's time since boot through wraps and reboots, and drops rows of other vehicles.

Rows are processed in order of arrival. A row is of the followed clock if it continues it: not far back (a late
message), not farther ahead than time has passed, and not the same time for seconds. Other rows may be of a reboot, or
of a second autopilot with the same ids: they are dropped until they continue by themselves while the followed clock is
silent. Rows of a clock that stands still are dropped.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import NO_BOOT_TIME, BoolArray, IntArray, SyncTrack, Track

STEP_NS: Final = 2 * SECOND_NS
"""A row farther back than this, or farther ahead of the time passed, is of another clock, not late."""

WRAP_NS: Final = (1 << 32) * 1_000_000
"""32-bit milliseconds wrap after 49.7 days."""

_SILENCE_NS: Final = SECOND_NS  # of the followed clock before another one replaces it
_SILENCE_OF_TWO_NS: Final = 10 * SECOND_NS  # where two clocks run at once
_CONFIRMATIONS: Final = 3
_MAX_STAMP_AGE_NS: Final = SECOND_NS // 2  # from a stamped row to an unstamped one that takes its time
_FOLLOWED, _CANDIDATE, _DROPPED = 0, 1, 2
_EMPTY: Final = np.empty(0, dtype=np.int64)
_NEVER_NS: Final = -(1 << 61)


@dataclass(slots=True)
class _ClockTrack:
    """A clock that continues from row to row.

    Attributes:
        boot_ns: Newest time since boot.
        arrival_ns: Newest arrival.
        lead_ns: Smallest arrival minus time since boot.
        advanced_ns: Arrival of the row with which ``boot_ns`` last advanced.
        rows: Number of rows.
    """

    boot_ns: int
    arrival_ns: int
    lead_ns: int
    advanced_ns: int
    rows: int = 1

    def continues(self, boot_ns: int, arrival_ns: int) -> bool:
        if boot_ns <= self.boot_ns and self.arrival_ns - self.advanced_ns >= STEP_NS:
            return False  # it has stood still, and does so still
        passed_ns = max(arrival_ns - self.arrival_ns, 0)
        latest_ns = max(self.boot_ns + passed_ns, arrival_ns - self.lead_ns)
        return self.boot_ns - STEP_NS <= boot_ns <= latest_ns + STEP_NS

    def advance(self, boot_ns: int, arrival_ns: int) -> None:
        if boot_ns > self.boot_ns:
            self.advanced_ns = max(self.advanced_ns, arrival_ns)
        self.boot_ns, self.arrival_ns = max(self.boot_ns, boot_ns), max(self.arrival_ns, arrival_ns)
        self.lead_ns = min(self.lead_ns, arrival_ns - boot_ns)
        self.rows += 1


@dataclass(frozen=True, slots=True)
class _StampedRow:
    """The last row with a time since boot."""

    arrival_ns: int
    boot_ns: int
    owner: int


def _new_clock(boot_ns: int, arrival_ns: int) -> _ClockTrack:
    return _ClockTrack(boot_ns, arrival_ns, arrival_ns - boot_ns, arrival_ns)


class BootClock:
    """Assigns rows to the followed clock and gives their time since boot.

    Attributes:
        restarts: Number of changes to a new clock.
        wraps: Number of 32-bit wraps.
        left_out: Number of dropped rows, of other clocks.
        rivals: Number of times that the followed clock was heard again after another one.
    """

    def __init__(self) -> None:
        self.restarts = self.wraps = self.left_out = self.rivals = 0
        self._followed: _ClockTrack | None = None
        self._other: _ClockTrack | None = None
        self._last_stamped = _StampedRow(_NEVER_NS, 0, _DROPPED)

    def copy(self) -> "BootClock":
        """An independent copy."""
        other = BootClock()
        other.restarts, other.wraps, other.left_out, other.rivals = (
            self.restarts,
            self.wraps,
            self.left_out,
            self.rivals,
        )
        other._followed = None if self._followed is None else replace(self._followed)
        other._other = None if self._other is None else replace(self._other)
        other._last_stamped = self._last_stamped
        return other

    def has_same_events(self, before: "BootClock") -> bool:
        """Whether only the followed clock was heard, before and since, without a restart or wrap between."""
        events = [(each.restarts, each.wraps, each.left_out, each.rivals) for each in (self, before)]
        return events[0] == events[1] and before.is_alone and self.is_alone

    @property
    def is_alone(self) -> bool:
        """Whether a clock is followed and no other one is heard."""
        return self._followed is not None and self._other is None

    @property
    def last_boot_ns(self) -> int | None:
        """Newest time since boot; None before the first."""
        return None if self._followed is None else self._followed.boot_ns

    @property
    def has_other_clock(self) -> bool:
        """Whether two clocks run at once, which is more than stray rows."""
        return self.rivals >= _CONFIRMATIONS

    @property
    def other_apart_ns(self) -> int | None:
        """Offset of another clock that is heard to the followed one; None without one."""
        if self._followed is None or self._other is None:
            return None
        passed_ns = self._other.arrival_ns - self._followed.arrival_ns
        return self._other.boot_ns - self._followed.boot_ns - passed_ns

    def follow(self, tracks: tuple[Track, ...], *, near_ns: int = STEP_NS) -> tuple[tuple[Track, ...], bool]:
        """Process the tracks of one tick, or of several without events.

        Args:
            tracks: The tracks.
            near_ns: Largest deviation of TIMESYNC rows from the followed clock: other senders may give its time or that
                of another clock.

        Returns:
            Rows of the followed clock, unwrapped, unstamped rows with the time of the stamped row before them, TIMESYNC
            last; and whether it is a new clock.
        """
        tracks_of_vehicle = [track for track in tracks if not isinstance(track, SyncTrack)]
        arrivals = np.concatenate([_EMPTY, *(track.arrival_ns for track in tracks_of_vehicle)])
        boots = np.concatenate([_EMPTY, *(track.boot_ns for track in tracks_of_vehicle)])
        unstamped = boots == NO_BOOT_TIME
        order = np.lexsort((boots, unstamped, arrivals))
        restarts = self.restarts
        boot_ns, is_followed = np.empty_like(boots), np.empty(len(boots), dtype=np.bool_)
        boot_ns[order], is_followed[order] = self._assign(arrivals[order], boots[order], unstamped[order])
        row_ends = np.cumsum([0, *(len(track.boot_ns) for track in tracks_of_vehicle)]).tolist()
        parts = zip(tracks_of_vehicle, pairwise(row_ends), strict=True)
        followed = [
            replace(track, boot_ns=boot_ns[start:stop]).rows(is_followed[start:stop]) for track, (start, stop) in parts
        ]
        followed += [
            track.rows(self._is_near_followed(track, near_ns)) for track in tracks if isinstance(track, SyncTrack)
        ]
        return tuple(track for track in followed if len(track.arrival_ns)), self.restarts > restarts

    def _assign(self, arrivals: IntArray, boots: IntArray, unstamped: BoolArray) -> tuple[IntArray, BoolArray]:
        """Times since boot of rows ``(n,)`` in order of arrival, and whether each is of the followed clock."""
        stamped = ~unstamped
        restarts = self.restarts
        unwrapped = self._unwrap(boots[stamped], arrivals[stamped])
        owners = self._owners(unwrapped, arrivals[stamped])
        self.left_out += int(np.count_nonzero(owners != _FOLLOWED))
        if self.restarts > restarts:
            self._last_stamped = _StampedRow(self._last_stamped.arrival_ns, self._last_stamped.boot_ns, _DROPPED)
        stamped_index = np.cumsum(stamped)  # index of the last stamped row; 0 is that of the tick before
        stamped_arrivals = np.concatenate([[self._last_stamped.arrival_ns], arrivals[stamped]])
        stamped_boots = np.concatenate([[self._last_stamped.boot_ns], unwrapped])
        stamped_owners = np.concatenate([[self._last_stamped.owner], owners])
        if len(unwrapped):
            self._last_stamped = _StampedRow(int(stamped_arrivals[-1]), int(stamped_boots[-1]), int(stamped_owners[-1]))
        is_recent = arrivals - stamped_arrivals[stamped_index] <= _MAX_STAMP_AGE_NS
        default_owner = _FOLLOWED if self._other is None else _DROPPED
        is_followed = np.where(is_recent, stamped_owners[stamped_index], default_owner) == _FOLLOWED
        return np.where(is_recent, stamped_boots[stamped_index], NO_BOOT_TIME), is_followed

    def _is_near_followed(self, track: Track, near_ns: int) -> BoolArray:
        """Whether the rows' times since boot are near the followed clock's."""
        run = self._followed
        if run is None:
            return np.zeros(len(track.boot_ns), dtype=np.bool_)
        expected = run.boot_ns + track.arrival_ns - run.arrival_ns
        return np.asarray(np.abs(track.boot_ns - expected) <= near_ns)

    def _unwrap(self, boots: IntArray, arrivals: IntArray) -> IntArray:
        """Times since boot with whole wraps added where that continues the followed clock."""
        run = self._followed
        if run is None or len(boots) == 0:
            return boots
        wraps = np.maximum(np.rint((run.boot_ns + arrivals - run.arrival_ns - boots) / WRAP_NS), 0).astype(np.int64)
        unwrapped = boots + wraps * WRAP_NS
        is_near = np.abs(unwrapped - run.boot_ns - (arrivals - run.arrival_ns)) <= STEP_NS
        self.wraps = max(self.wraps, int(np.max(wraps, where=is_near, initial=0)))
        return np.where(is_near, unwrapped, boots)

    def _owners(self, boots: IntArray, arrivals: IntArray) -> IntArray:
        """Owners ``(n,)`` of rows in order of arrival."""
        owners = np.full(len(boots), _FOLLOWED, dtype=np.int64)
        if len(boots) == 0 or self._follow_all(boots, arrivals):
            return owners
        for row, (boot_ns, arrival_ns) in enumerate(zip(boots.tolist(), arrivals.tolist(), strict=True)):
            owners[row] = self._owner(boot_ns, arrival_ns)
            if self._takes_over(arrival_ns):
                owners[: row + 1] = np.where(owners[: row + 1] == _CANDIDATE, _FOLLOWED, _DROPPED)
                self._followed, self._other = self._other, None
                self.restarts += 1
                self.wraps = self.rivals = 0
        return owners

    def _follow_all(self, boots: IntArray, arrivals: IntArray) -> bool:
        """Process rows ``(n,)`` at once if all of them continue the followed clock; else return False."""
        if self._other is not None:
            return False
        run = self._followed or _new_clock(int(boots[0]), int(arrivals[0]))
        self._followed = run
        newest = np.maximum.accumulate(np.concatenate([[run.boot_ns], boots]))
        passed = np.maximum(np.diff(arrivals, prepend=run.arrival_ns), 0)
        if np.any(newest[1:] - boots > STEP_NS) or np.any(np.diff(newest) - passed > STEP_NS):
            return False
        has_advanced = np.diff(newest) > 0
        advances = np.where(has_advanced, arrivals, run.advanced_ns)
        advanced = np.maximum.accumulate(np.concatenate([[run.advanced_ns], advances]))
        before = np.maximum.accumulate(np.concatenate([[run.arrival_ns], arrivals[:-1]]))
        if np.any(~has_advanced & (before - advanced[:-1] >= STEP_NS)):
            return False  # it has stood still, and does so still
        run.advanced_ns = int(advanced[-1])
        run.boot_ns, run.arrival_ns = int(newest[-1]), max(run.arrival_ns, int(arrivals[-1]))
        run.lead_ns = min(run.lead_ns, int(np.min(arrivals - boots)))
        return True

    def _owner(self, boot_ns: int, arrival_ns: int) -> int:
        if self._followed is not None and self._followed.continues(boot_ns, arrival_ns):
            self._followed.advance(boot_ns, arrival_ns)
            if self._other is not None:
                self.rivals, self._other = self.rivals + 1, None
            return _FOLLOWED
        if self._other is not None and self._other.continues(boot_ns, arrival_ns):
            self._other.advance(boot_ns, arrival_ns)
        else:
            self._other = _new_clock(boot_ns, arrival_ns)
        return _CANDIDATE

    def _takes_over(self, arrival_ns: int) -> bool:
        """Whether the other clock has continued long enough while the followed one was silent."""
        if self._other is None or self._followed is None or self._other.rows < _CONFIRMATIONS:
            return False
        if 0 <= self._followed.boot_ns - self._other.boot_ns <= STEP_NS:
            return False  # it is the followed one, which stands still
        silence_ns = _SILENCE_OF_TWO_NS if self.has_other_clock else _SILENCE_NS
        return arrival_ns - self._followed.arrival_ns >= silence_ns
