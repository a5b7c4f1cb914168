"""The vehicle's clock against UTC and against this machine's clock, learned as messages come.

``utc = boot + offset(boot)``, a line through what SYSTEM_TIME says; until that is known, the line below arrival minus
boot, for this machine's clock. A message without a time of its own was sent right after the stamped one before it, and
takes that one's: the link's delay, which comes and goes by seconds on a radio, is not in it. All corrections are made
with what had arrived by the current tick, so the map is the same live and recomputed.
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
"""Standard deviation of a machine's clock that nobody holds against UTC."""


class VehicleClock:
    """The lines between three clocks: the vehicle's time since boot, its UTC, and this machine's.

    Attributes:
        boot: Which rows are of the followed boot.
        stated: UTC minus time since boot.
        host_minus_boot: This machine's clock minus time since boot.
        host_minus_utc: This machine's clock minus UTC; goes on through reboots.
        jumps_ns: By how much UTC jumped in earlier boots.
        stated_by_tick: ``stated`` at each tick of the newest step; None before the vehicle has said UTC.
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
        """Whether the vehicle has said what UTC is, in this boot or an earlier one."""
        return self.stated.line is not None or self.host_minus_utc.line is not None

    def copy(self) -> "VehicleClock":
        """A state to learn with, that leaves this one as it is."""
        other = VehicleClock()
        other.boot, other.stated = self.boot.copy(), self.stated.copy()
        other.host_minus_boot, other.host_minus_utc = self.host_minus_boot.copy(), self.host_minus_utc.copy()
        other.jumps_ns = self.jumps_ns
        return other

    def follow(self, ticks: Ticks) -> tuple[tuple[Track, ...], bool]:
        """The rows of the followed boot, and whether that is a new one: then the old one's lines are forgotten."""
        # Of several ticks the last rows are not those of each one's end: so there is less room.
        followed, restarted = self.boot.follow(ticks.tracks, near_ns=STEP_NS if ticks.count == 1 else STEP_NS // 2)
        if restarted:
            self.jumps_ns += tuple(self.stated.jumps_ns)
            self.stated, self.host_minus_boot = StatedOffset(), ArrivalOffset()
        return followed, restarted

    def keep(self, count: int) -> None:
        """A step of so many ticks without telemetry: all lines stay as they are."""
        self.stated_by_tick = _unchanged(self.stated, count)
        self.arrival_by_tick = _unchanged(self.host_minus_boot, count)
        self.host_by_tick = _unchanged(self.host_minus_utc, count)

    def learn(self, ticks: Ticks, last_boot_ns: int) -> bool:
        """Learn from rows of the followed boot.

        Args:
            ticks: The rows.
            last_boot_ns: Newest time since boot before them.

        Returns:
            False where a clock jumps in one of several ticks, or is known from it on: then they cannot be learned from
            at once. Of one tick always true.
        """
        self.keep(ticks.count)
        known = StampedRows.of(ticks)
        if not len(known.tick):
            return True
        return self._learn_stated(ticks, known, last_boot_ns) and self._learn_host(ticks, known)

    def _learn_stated(self, ticks: Ticks, known: StampedRows, last_boot_ns: int) -> bool:
        """Learn what the vehicle says of UTC."""
        lines, changes, is_one = [self.stated.line], list[int](), ticks.count == 1
        for tick, boot_ns, offset_ns in _stated_offsets(ticks):
            line = self.stated.line
            if not is_one and (line is None or abs(offset_ns - line.offset_at(boot_ns)) > JUMP_NS):
                return False
            self._learn_offset(boot_ns, offset_ns)
            if self.stated.line is not line:
                lines.append(self.stated.line)
                changes.append(tick)
        if is_one:
            self.stated_by_tick = _unchanged(self.stated, 1)
            return True
        before = lines[0]
        if before is None:
            return True
        self.stated_by_tick = OffsetsByTick.of([line for line in lines if line is not None], changes, ticks.count)
        newest_ns = np.full(ticks.count, last_boot_ns)
        np.maximum.at(newest_ns, known.tick, known.boot_ns)
        by_newest = self.stated_by_tick.offset(np.maximum.accumulate(newest_ns), np.arange(ticks.count))
        steps = np.diff(by_newest, prepend=before.offset_at(last_boot_ns))
        return not np.any(np.abs(steps) > JUMP_NS)

    def _learn_offset(self, boot_ns: int, offset_ns: int) -> None:
        """Take in what UTC minus time since boot is said to be, and what follows for this machine's clock."""
        before, jumps = self.stated.line, len(self.stated.jumps_ns)
        self.stated.learn(boot_ns, offset_ns)
        if before is None and self.host_minus_utc.line is None and self.host_minus_boot.line is not None:
            self.host_minus_utc = self.host_minus_boot.rebased(offset_ns)
        if len(self.stated.jumps_ns) > jumps:
            self.host_minus_utc = self.host_minus_utc.rebased(self.stated.jumps_ns[-1])

    def _learn_host(self, ticks: Ticks, known: StampedRows) -> bool:
        """Learn from when messages arrive."""
        self.arrival_by_tick, is_calm = _learned(self.host_minus_boot, known.boot_ns, known, ticks)
        if self.stated_by_tick is not None:
            utc_ns = known.boot_ns + self.stated_by_tick.offset(known.boot_ns, known.tick)
            self.host_by_tick, is_calm = _learned(self.host_minus_utc, utc_ns, known, ticks)
        return is_calm or ticks.count == 1


def _unchanged(clock: StatedOffset | ArrivalOffset, count: int) -> OffsetsByTick | None:
    return None if clock.line is None else OffsetsByTick.of([clock.line], [], count, clock.unsettled_ns or 0)


def _learned(clock: ArrivalOffset, own_ns: IntArray, known: StampedRows, ticks: Ticks) -> tuple[OffsetsByTick, bool]:
    """Learn from when rows came that were sent at ``own_ns (n,)``: a line at each tick, and whether it never jumps."""
    before = _unchanged(clock, 1) or OffsetsByTick.of(
        [ClockOffset(0, 0)], [], 1
    )  # of ticks before the first that rows came in
    fastest, slower_ns = known.fastest(own_ns)
    learned = clock.learn_fastest(own_ns[fastest], known.arrival_ns[fastest], slower_ns)
    arrived_ns, row = ticks.last_arrivals()[known.tick[fastest]], np.arange(len(fastest))
    steps_ns = learned.own(arrived_ns, row) - before.followed_by(learned, row).own(arrived_ns, row)
    came = np.cumsum(np.bincount(known.tick[fastest], minlength=ticks.count))
    # A shift is what a tick alone makes of it, at a time that may be another: so there is less room.
    return before.followed_by(learned, came), bool(np.all(np.abs(steps_ns) <= JUMP_NS // 2))


def _stated_offsets(ticks: Ticks) -> Iterator[tuple[int, int, int]]:
    """Tick, time since boot, and UTC minus that, of all that the vehicle says of UTC; within a tick as it came."""
    said: list[tuple[int, int, int]] = []
    for track, row_ends in zip(ticks.tracks, ticks.row_ends, strict=True):
        if isinstance(track, ClockTrack):
            offsets_ns = track.unix_ns - track.boot_ns
            said += zip(ticks.tick_of(row_ends).tolist(), track.boot_ns.tolist(), offsets_ns.tolist(), strict=True)
    for each in sorted(said, key=itemgetter(0)):
        if each[1] != NO_BOOT_TIME:
            yield each


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockUpdate:
    """A step's telemetry on the followed clock, and what became of stamps given before.

    Attributes:
        ticks: The rows of the followed clock; those of another vehicle or boot are left out.
        restarted: Older stamps are of another boot: they must be forgotten.
        shift_ns: To be added to older stamps.
        host_shift_ns: To be added to UTC that was made of this machine's stamps.
    """

    ticks: Ticks
    restarted: bool = False
    shift_ns: int = 0
    host_shift_ns: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockHealth:
    """What happened to the clocks so far.

    Attributes:
        drift: Seconds that UTC gains on the vehicle's clock per second; None before UTC is known.
        restarts: Reboots.
        wraps: How often milliseconds since boot began anew at 32 bits, since the last reboot.
        jumps_s: By how much the vehicle's UTC jumped.
        left_out: Rows of another boot or another vehicle.
        rivals: Whether two clocks were heard at once.
    """

    drift: float | None
    restarts: int
    wraps: int
    jumps_s: tuple[float, ...]
    left_out: int
    rivals: bool


class ClockMap:
    """Offsets of one vehicle's clock."""

    def __init__(self) -> None:
        self._state = VehicleClock()

    @property
    def is_utc_known(self) -> bool:
        """Whether the vehicle has said what UTC is, in this boot or an earlier one."""
        return self._state.is_utc_known

    @property
    def health(self) -> ClockHealth:
        """What happened so far."""
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
        """Whether nothing that the vehicle says of its clock contradicts what it said before."""
        return self._state.stated.unsettled_ns is None and self._state.boot.other_apart_ns is None

    def copy(self) -> "ClockMap":
        """The map as it is now; what is learned later is not in it."""
        return copy(self)

    def update(self, ticks: Ticks) -> ClockUpdate | None:
        """Learn from the tracks of a step.

        Returns:
            None, and nothing was learned, where several ticks cannot be learned from at once: a clock jumps, begins
            anew, or is known for the first time. From one tick it always learns.
        """
        before = self._state
        if not ticks.tracks:
            before.keep(ticks.count)
            return ClockUpdate(ticks=ticks)
        if ticks.count > 1 and not self.is_settled:
            return None
        state = before.copy()
        is_sync = [isinstance(track, SyncTrack) for track in ticks.tracks]
        ticks = ticks.picked(sorted(range(len(is_sync)), key=is_sync.__getitem__))  # as they are followed
        followed, restarted = state.follow(ticks)
        if ticks.count > 1:
            is_whole = [len(track.boot_ns) for track in followed] == [len(track.boot_ns) for track in ticks.tracks]
            if not is_whole or not state.boot.is_as_calm_as(before.boot):
                return None
        arrived_ns = max((int(track.arrival_ns[-1]) for track in followed), default=0)
        was_known = state.is_utc_known
        offsets_ns = None if restarted else _utc_minus_boot_ns(state), _host_to_utc(state, arrived_ns)
        ticks = ticks.of_tracks(followed)
        if not state.learn(ticks, before.boot.last_boot_ns or 0):
            return None
        self._state = state
        least_ns = JUMP_NS if was_known or not state.is_utc_known else 0
        if ticks.count > 1:
            return ClockUpdate(ticks=ticks)
        now_ns = _utc_minus_boot_ns(state), _host_to_utc(state, arrived_ns)
        shifts = [_change(then, now, least_ns) for then, now in zip(offsets_ns, now_ns, strict=True)]
        return ClockUpdate(ticks=ticks, restarted=restarted, shift_ns=shifts[0], host_shift_ns=shifts[1])

    def host_to_utc(self, host_ns: IntArray, ticks: IntArray = LAST) -> IntArray:
        """UTC of stamps ``(n,)`` of this machine's clock, as it was known at ticks ``(n,)`` of the newest step.

        The stamps themselves as long as the vehicle has not said what UTC is.
        """
        lines = self._state.host_by_tick
        return host_ns if lines is None else lines.own(host_ns, ticks)

    def to_utc(self, track: Track, tick: IntArray) -> IntArray:
        """UTC stamps ``(n,)`` of the rows of a track that ``update`` gave back, each by what was known at its tick."""
        stated, host = self._state.stated_by_tick, self._state.host_by_tick
        boots, bare = track.boot_ns, track.boot_ns == NO_BOOT_TIME
        by_arrival = track.arrival_ns if host is None else track.arrival_ns - host.offset(track.arrival_ns, tick)
        if stated is not None:
            return np.where(bare, by_arrival, boots + stated.offset(boots, tick))
        arrival = self._state.arrival_by_tick
        if arrival is None:
            return by_arrival
        arrivals = boots + arrival.offset(boots, tick)
        return np.where(bare, by_arrival, arrivals if host is None else arrivals - host.offset(arrivals, tick))

    def off_ns(self, ticks: IntArray, by_utc: BoolArray) -> IntArray:
        """How far off a clock is heard to be at ticks ``(n,)``, where stamps cannot be matched for that; 0 elsewhere.

        Args:
            ticks: Of the newest step.
            by_utc: ``(n,)`` whether stamps are UTC by another clock than this machine's, or this machine's.
        """
        state = self._state
        stated, host = state.stated_by_tick, state.host_by_tick if self.is_utc_known else state.arrival_by_tick
        late_ns = np.zeros(len(ticks), dtype=np.int64) if host is None else host.off_ns[ticks]
        return late_ns if stated is None else np.where(by_utc, stated.off_ns[ticks], late_ns)

    def unsettled(self, *, by_utc: bool, tick: int = -1) -> str | None:
        """Why stamps cannot be matched at a tick of the newest step, in a sentence; ``by_utc`` as in ``off_ns``."""
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
        """Which stamps ``(n,)`` that are UTC by another clock than this machine's can have no telemetry.

        The vehicle's UTC jumped ahead, and it never said these times.
        """
        spans = self._state.stated.skipped_ns
        between = [(first_ns < stamps_ns) & (stamps_ns < last_ns) for first_ns, last_ns in spans]
        return np.asarray(np.any([np.zeros(len(stamps_ns), dtype=np.bool_), *between], axis=0))

    def repeats(self, stamps_ns: IntArray) -> BoolArray:
        """Which stamps ``(n,)`` the vehicle said twice, because its UTC jumped back."""
        spans = self._state.stated.repeated_ns
        between = [(first_ns <= stamps_ns) & (stamps_ns <= last_ns) for first_ns, last_ns in spans]
        return np.asarray(np.any([np.zeros(len(stamps_ns), dtype=np.bool_), *between], axis=0))

    def remarks(self, *, is_repeated: bool) -> tuple[str, ...]:
        """What is to be known of the clock behind a pose, in sentences; ``is_repeated`` as in ``repeats``."""
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
        """Why telemetry that comes is not believed now, in a sentence."""
        apart_ns = self._state.boot.other_apart_ns
        if apart_ns is None:
            return None
        return (
            f"the vehicle's time since boot jumped by {apart_ns / SECOND_NS:+.1f} s: a reboot, or another autopilot "
            "with its ids; it is not settled yet which"
        )


def _utc_minus_boot_ns(state: VehicleClock) -> int | None:
    """UTC, as far as it is known, minus time since boot at the newest message."""
    now_ns, stated, host = state.boot.last_boot_ns, state.stated.line, state.host_minus_boot.line
    if now_ns is None:
        return None
    if stated is not None:
        return stated.offset_at(now_ns)
    return None if host is None else _host_to_utc(state, now_ns + host.offset_at(now_ns)) - now_ns


def _host_to_utc(state: VehicleClock, host_ns: int) -> int:
    line = state.host_minus_utc.line
    return host_ns if line is None else host_ns - line.offset_at(host_ns - line.offset_ns)


def _change(before_ns: int | None, after_ns: int | None, least_ns: int) -> int:
    """By how much an offset changed; 0 where that is not more than ``least_ns``."""
    change_ns = 0 if before_ns is None or after_ns is None else after_ns - before_ns
    return change_ns if abs(change_ns) > least_ns else 0
