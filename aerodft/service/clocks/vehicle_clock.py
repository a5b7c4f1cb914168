"""What is learned of one vehicle's clock, as messages come: a reboot, its UTC, and this machine's clock beside it."""

from collections.abc import Iterator
from operator import itemgetter

import numpy as np

from aerodft.model import NO_BOOT_TIME, ClockTrack, IntArray, Track
from aerodft.service.clocks.arrival_offset import ArrivalOffset
from aerodft.service.clocks.boot_time import STEP_NS, BootClock
from aerodft.service.clocks.stated_offset import JUMP_NS, ClockOffset, StatedOffset
from aerodft.service.clocks.tracks_by_tick import OffsetsByTick, StampedRows, Ticks


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
