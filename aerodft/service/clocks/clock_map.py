"""Estimates the offsets of the vehicle's clock to UTC and to this machine's clock from messages.

``utc = boot + offset(boot)``, a line through SYSTEM_TIME; until that is known the lower line of arrival minus boot, for
this machine's clock. A message without a time since boot takes that of the stamped message right before it, so that the
link's delay (seconds, at times, on a radio) is not in it. All corrections use what had arrived by the current tick: the
map is the same live and recomputed.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import NO_BOOT_TIME, BoolArray, ClockTrack, IntArray, SyncTrack, Track
from aerodft.service.clocks.arrival_offset import ArrivalOffset
from aerodft.service.clocks.boot_time import STEP_NS, BootClock
from aerodft.service.clocks.stated_offset import JUMP_NS, ClockOffset, StatedOffset
from aerodft.service.clocks.tracks_by_tick import OffsetsByTick, StampedRows, Ticks
from aerodft.service.streams import LAST

HOST_STD_S: Final = 0.1
"""Standard deviation of a machine's clock that is not compared with UTC."""


class VehicleClock:
    """Offset lines between the vehicle's time since boot, its UTC, and this machine's clock.

    Attributes:
        boot: Assigns rows to the followed boot.
        stated: UTC minus time since boot.
        host_minus_boot: This machine's clock minus time since boot.
        host_minus_utc: This machine's clock minus UTC; continues through reboots.
        jumps_ns: Jumps of UTC in earlier boots.
        stated_by_tick: ``stated`` at each tick of the newest step; None before the first SYSTEM_TIME with UTC.
        arrival_by_tick: ``host_minus_boot`` at each tick of the newest step; None before it is known.
        host_by_tick: ``host_minus_utc`` at each tick of the newest step; None before it is known.
    """

    def __init__(self) -> None:
        self.boot = BootClock()
        self.stated = StatedOffset()
        self.host_minus_boot = ArrivalOffset()
        self.host_minus_utc = ArrivalOffset()
        self.jumps_ns: tuple[int, ...] = ()
        self.stated_by_tick: OffsetsByTick | None = None
        self.arrival_by_tick: OffsetsByTick | None = None
        self.host_by_tick: OffsetsByTick | None = None

    @property
    def is_utc_known(self) -> bool:
        """Whether the vehicle has sent UTC, in this boot or an earlier one."""
        return self.stated.line is not None or self.host_minus_utc.line is not None

    def copy(self) -> "VehicleClock":
        """A copy to update, which leaves this state unchanged."""
        other = VehicleClock()
        other.boot, other.stated = self.boot.copy(), self.stated.copy()
        other.host_minus_boot, other.host_minus_utc = self.host_minus_boot.copy(), self.host_minus_utc.copy()
        other.jumps_ns = self.jumps_ns
        return other

    def follow(self, ticks: Ticks) -> tuple[tuple[Track, ...], bool]:
        """Rows of the followed boot, and whether it is a new one, whose lines start from nothing."""
        # With several ticks the last rows are not at each tick's end: the tolerance is smaller.
        followed, restarted = self.boot.follow(ticks.tracks, near_ns=STEP_NS if ticks.count == 1 else STEP_NS // 2)
        if restarted:
            self.jumps_ns += tuple(self.stated.jumps_ns)
            self.stated, self.host_minus_boot = StatedOffset(), ArrivalOffset()
        return followed, restarted

    def keep(self, count: int) -> None:
        """Keep all lines for a step of ``count`` ticks without telemetry."""
        self.stated_by_tick = _constant_offsets(self.stated, count)
        self.arrival_by_tick = _constant_offsets(self.host_minus_boot, count)
        self.host_by_tick = _constant_offsets(self.host_minus_utc, count)

    def learn(self, ticks: Ticks, last_boot_ns: int) -> bool:
        """Update the lines from rows of the followed boot.

        Args:
            ticks: The rows.
            last_boot_ns: Newest time since boot before them.

        Returns:
            False where a clock jumps, or becomes known, in one of several ticks: these must be learned from one by one.
            Always true for one tick.
        """
        self.keep(ticks.count)
        rows = StampedRows.from_ticks(ticks)
        if not len(rows.tick):
            return True
        return self._learn_stated(ticks, rows, last_boot_ns) and self._learn_host(ticks, rows)

    def _learn_stated(self, ticks: Ticks, rows: StampedRows, last_boot_ns: int) -> bool:
        """Update UTC minus time since boot from SYSTEM_TIME; returns as ``learn``."""
        lines, changes, is_one = [self.stated.line], list[int](), ticks.count == 1
        for tick, boot_ns, offset_ns in _system_times(ticks):
            line = self.stated.line
            if not is_one and (line is None or abs(offset_ns - line.offset_at(boot_ns)) > JUMP_NS):
                return False
            self._learn_offset(boot_ns, offset_ns)
            if self.stated.line is not line:
                lines.append(self.stated.line)
                changes.append(tick)
        if is_one:
            self.stated_by_tick = _constant_offsets(self.stated, 1)
            return True
        before = lines[0]
        if before is None:
            return True
        known_lines = [line for line in lines if line is not None]
        self.stated_by_tick = OffsetsByTick.from_lines(known_lines, changes, ticks.count)
        newest_ns = np.full(ticks.count, last_boot_ns)
        np.maximum.at(newest_ns, rows.tick, rows.boot_ns)
        by_newest = self.stated_by_tick.offset(np.maximum.accumulate(newest_ns), np.arange(ticks.count))
        steps = np.diff(by_newest, prepend=before.offset_at(last_boot_ns))
        return not np.any(np.abs(steps) > JUMP_NS)

    def _learn_offset(self, boot_ns: int, offset_ns: int) -> None:
        """Update by one sample of UTC minus time since boot, and this machine's offset as it follows."""
        line, jumps = self.stated.line, len(self.stated.jumps_ns)
        self.stated.learn(boot_ns, offset_ns)
        if line is None and self.host_minus_utc.line is None and self.host_minus_boot.line is not None:
            self.host_minus_utc = self.host_minus_boot.rebased(offset_ns)
        if len(self.stated.jumps_ns) > jumps:
            self.host_minus_utc = self.host_minus_utc.rebased(self.stated.jumps_ns[-1])

    def _learn_host(self, ticks: Ticks, rows: StampedRows) -> bool:
        """Update this machine's offsets from arrivals; returns as ``learn``."""
        self.arrival_by_tick, has_no_jump = _learn(self.host_minus_boot, rows.boot_ns, rows, ticks)
        if self.stated_by_tick is not None:
            utc_ns = rows.boot_ns + self.stated_by_tick.offset(rows.boot_ns, rows.tick)
            self.host_by_tick, has_no_jump = _learn(self.host_minus_utc, utc_ns, rows, ticks)
        return has_no_jump or ticks.count == 1


def _constant_offsets(clock: StatedOffset | ArrivalOffset, count: int) -> OffsetsByTick | None:
    return None if clock.line is None else OffsetsByTick.from_lines([clock.line], [], count, clock.unsettled_ns or 0)


def _learn(clock: ArrivalOffset, sent_ns: IntArray, rows: StampedRows, ticks: Ticks) -> tuple[OffsetsByTick, bool]:
    """Update by arrivals of rows sent at ``sent_ns (n,)``; returns a line at each tick, and whether none jumps."""
    before = _constant_offsets(clock, 1) or OffsetsByTick.from_lines([ClockOffset(0, 0)], [], 1)
    fastest, slower_ns = rows.fastest(sent_ns)
    learned = clock.learn_fastest(sent_ns[fastest], rows.arrival_ns[fastest], slower_ns)
    arrived_ns, row = ticks.last_arrivals()[rows.tick[fastest]], np.arange(len(fastest))
    steps_ns = learned.own(arrived_ns, row) - before.followed_by(learned, row).own(arrived_ns, row)
    rows_by_tick = np.cumsum(np.bincount(rows.tick[fastest], minlength=ticks.count))
    # A single tick would find a shift at another time: the tolerance is smaller.
    return before.followed_by(learned, rows_by_tick), bool(np.all(np.abs(steps_ns) <= JUMP_NS // 2))


def _system_times(ticks: Ticks) -> Iterator[tuple[int, int, int]]:
    """Tick, time since boot, and UTC minus time since boot of all SYSTEM_TIME rows, in order of ticks."""
    samples: list[tuple[int, int, int]] = []
    for track, row_ends in zip(ticks.tracks, ticks.row_ends, strict=True):
        if isinstance(track, ClockTrack):
            offsets_ns = track.unix_ns - track.boot_ns
            samples += zip(ticks.tick_of(row_ends).tolist(), track.boot_ns.tolist(), offsets_ns.tolist(), strict=True)
    for each in sorted(samples, key=itemgetter(0)):
        if each[1] != NO_BOOT_TIME:
            yield each


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockUpdate:
    """Telemetry of a step on the followed clock, and corrections of earlier stamps.

    Attributes:
        ticks: Rows of the followed clock; rows of another vehicle or boot are dropped.
        restarted: Whether older stamps are of another boot and must be dropped.
        shift_ns: Correction of older stamps.
        host_shift_ns: Correction of UTC from stamps on this machine's clock.
    """

    ticks: Ticks
    restarted: bool = False
    shift_ns: int = 0
    host_shift_ns: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockHealth:
    """Events of the clocks so far.

    Attributes:
        drift: Drift of UTC relative to the vehicle's clock (s/s); None before UTC is known.
        restarts: Number of reboots.
        wraps: Number of 32-bit wraps of milliseconds since boot, since the last reboot.
        jumps_s: Jumps of the vehicle's UTC.
        left_out: Number of dropped rows, of another boot or another vehicle.
        rivals: Whether two clocks were heard at once.
    """

    drift: float | None
    restarts: int
    wraps: int
    jumps_s: tuple[float, ...]
    left_out: int
    rivals: bool


class ClockMap:
    """Map from one vehicle's clock, and this machine's, to UTC."""

    def __init__(self) -> None:
        self._state = VehicleClock()

    @property
    def is_utc_known(self) -> bool:
        """Whether the vehicle has sent UTC, in this boot or an earlier one."""
        return self._state.is_utc_known

    @property
    def health(self) -> ClockHealth:
        """Events of the clocks so far."""
        state = self._state
        line, boot = state.stated.line, state.boot
        return ClockHealth(
            drift=None if line is None else line.drift,
            restarts=boot.restarts,
            wraps=boot.wraps,
            jumps_s=tuple(jump_ns / SECOND_NS for jump_ns in (*state.jumps_ns, *state.stated.jumps_ns)),
            left_out=boot.left_out,
            rivals=boot.has_other_clock,
        )

    @property
    def is_settled(self) -> bool:
        """Whether no message contradicts the followed clock."""
        return self._state.stated.unsettled_ns is None and self._state.boot.other_apart_ns is None

    def copy(self) -> "ClockMap":
        """The present map, unaffected by later updates."""
        return copy(self)

    def update(self, ticks: Ticks) -> ClockUpdate | None:
        """Update the map from the tracks of a step.

        Returns:
            None, without an update, where several ticks must be processed one by one: a clock jumps, restarts, or
            becomes known. Never None for one tick.
        """
        before = self._state
        if not ticks.tracks:
            before.keep(ticks.count)
            return ClockUpdate(ticks=ticks)
        if ticks.count > 1 and not self.is_settled:
            return None
        state = before.copy()
        is_sync = [isinstance(track, SyncTrack) for track in ticks.tracks]
        ticks = ticks.select(sorted(range(len(is_sync)), key=is_sync.__getitem__))  # TIMESYNC last
        followed, restarted = state.follow(ticks)
        if ticks.count > 1:
            is_whole = [len(track.boot_ns) for track in followed] == [len(track.boot_ns) for track in ticks.tracks]
            if not is_whole or not state.boot.has_same_events(before.boot):
                return None
        arrived_ns = max((int(track.arrival_ns[-1]) for track in followed), default=0)
        was_known = state.is_utc_known
        offsets_ns = None if restarted else _utc_minus_boot_ns(state), _host_to_utc(state, arrived_ns)
        ticks = ticks.of_tracks(followed)
        if not state.learn(ticks, before.boot.last_boot_ns or 0):
            return None
        self._state = state
        min_ns = JUMP_NS if was_known or not state.is_utc_known else 0
        if ticks.count > 1:
            return ClockUpdate(ticks=ticks)
        now_ns = _utc_minus_boot_ns(state), _host_to_utc(state, arrived_ns)
        shifts = [_change(before, now, min_ns) for before, now in zip(offsets_ns, now_ns, strict=True)]
        return ClockUpdate(ticks=ticks, restarted=restarted, shift_ns=shifts[0], host_shift_ns=shifts[1])

    def host_to_utc(self, host_ns: IntArray, ticks: IntArray = LAST) -> IntArray:
        """UTC of stamps ``(n,)`` on this machine's clock, as known at ticks ``(n,)`` of the newest step.

        The stamps themselves before the vehicle has sent UTC.
        """
        lines = self._state.host_by_tick
        return host_ns if lines is None else lines.own(host_ns, ticks)

    def to_utc(self, track: Track, tick: IntArray) -> IntArray:
        """UTC stamps ``(n,)`` of the rows of a track that ``update`` returned, as known at each row's tick."""
        stated, host = self._state.stated_by_tick, self._state.host_by_tick
        boots, unstamped = track.boot_ns, track.boot_ns == NO_BOOT_TIME
        by_arrival = track.arrival_ns if host is None else track.arrival_ns - host.offset(track.arrival_ns, tick)
        if stated is not None:
            return np.where(unstamped, by_arrival, boots + stated.offset(boots, tick))
        arrival = self._state.arrival_by_tick
        if arrival is None:
            return by_arrival
        arrivals = boots + arrival.offset(boots, tick)
        return np.where(unstamped, by_arrival, arrivals if host is None else arrivals - host.offset(arrivals, tick))

    def off_ns(self, ticks: IntArray, by_utc: BoolArray) -> IntArray:
        """Unsettled offset of a clock at ticks ``(n,)``, for which stamps cannot be matched; 0 where settled.

        Args:
            ticks: Of the newest step.
            by_utc: ``(n,)`` whether stamps are UTC, not on this machine's clock.
        """
        state = self._state
        stated, host = state.stated_by_tick, state.host_by_tick if self.is_utc_known else state.arrival_by_tick
        late_ns = np.zeros(len(ticks), dtype=np.int64) if host is None else host.off_ns[ticks]
        return late_ns if stated is None else np.where(by_utc, stated.off_ns[ticks], late_ns)

    def unsettled(self, *, by_utc: bool, tick: int = -1) -> str | None:
        """Sentence on why stamps cannot be matched at a tick, or None; ``by_utc`` as in ``off_ns``."""
        off_s = float(self.off_ns(np.array([tick]), np.array([by_utc]))[0]) / SECOND_NS
        if not off_s:
            return None
        if by_utc and self._state.stated.line is not None:
            return f"the vehicle's UTC jumped by {off_s:+.3f} s, and has not settled yet"
        return (
            f"all telemetry arrives {off_s:.1f} s later than before: the receiving machine's clock was"
            " set, or the link is slow; it is not settled yet which"
        )

    def skips(self, stamps_ns: IntArray) -> BoolArray:
        """Whether UTC stamps ``(n,)`` are in a span that the vehicle's UTC skipped in a jump ahead."""
        spans = self._state.stated.skipped_ns
        between = [(first_ns < stamps_ns) & (stamps_ns < last_ns) for first_ns, last_ns in spans]
        return np.asarray(np.any([np.zeros(len(stamps_ns), dtype=np.bool_), *between], axis=0))

    def repeats(self, stamps_ns: IntArray) -> BoolArray:
        """Whether stamps ``(n,)`` are in a span that the vehicle's UTC repeated after a jump back."""
        spans = self._state.stated.repeated_ns
        between = [(first_ns <= stamps_ns) & (stamps_ns <= last_ns) for first_ns, last_ns in spans]
        return np.asarray(np.any([np.zeros(len(stamps_ns), dtype=np.bool_), *between], axis=0))

    def remarks(self, *, is_repeated: bool) -> tuple[str, ...]:
        """Sentences on the clock for the reasons of a pose; ``is_repeated`` as in ``repeats``."""
        sentences = []
        if is_repeated:
            sentences.append("the vehicle's UTC jumped back and said this time twice: it is taken for the later")
        if self._state.boot.has_other_clock:
            sentences.append(
                "a second autopilot speaks with the vehicle's ids: the one that was heard first is followed"
            )
        return tuple(sentences)

    @property
    def has_restarted(self) -> bool:
        """Whether the vehicle has rebooted."""
        return self._state.boot.restarts > 0

    def broken_off(self) -> str | None:
        """Sentence on why received telemetry is dropped at present, or None."""
        apart_ns = self._state.boot.other_apart_ns
        if apart_ns is None:
            return None
        return (
            f"the vehicle's time since boot jumped by {apart_ns / SECOND_NS:+.1f} s: a reboot, or another autopilot "
            "with its ids; it is not settled yet which"
        )


def _utc_minus_boot_ns(state: VehicleClock) -> int | None:
    """UTC, as far as known, minus time since boot at the newest message."""
    now_ns, stated, host = state.boot.last_boot_ns, state.stated.line, state.host_minus_boot.line
    if now_ns is None:
        return None
    if stated is not None:
        return stated.offset_at(now_ns)
    return None if host is None else _host_to_utc(state, now_ns + host.offset_at(now_ns)) - now_ns


def _host_to_utc(state: VehicleClock, host_ns: int) -> int:
    line = state.host_minus_utc.line
    return host_ns if line is None else host_ns - line.offset_at(host_ns - line.offset_ns)


def _change(before_ns: int | None, after_ns: int | None, min_ns: int) -> int:
    """Change of an offset; 0 where it is at most ``min_ns``."""
    change_ns = 0 if before_ns is None or after_ns is None else after_ns - before_ns
    return change_ns if abs(change_ns) > min_ns else 0
