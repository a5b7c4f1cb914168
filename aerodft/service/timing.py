"""The vehicle's clock against UTC and against this machine's clock, learned as messages come.

``utc = boot + offset(boot)``, a line through what SYSTEM_TIME says; until that is known, the line below arrival minus
boot, for this machine's clock. A message without a time of its own was sent right after the stamped one before it, and
takes that one's: the link's delay, which comes and goes by seconds on a radio, is not in it. All corrections are made
with what had arrived by the current tick, so the map is the same live and recomputed.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import IntArray
from aerodft.model.telemetry import NO_BOOT_TIME, ClockTrack, SyncTrack, Track
from aerodft.service.boot_clock import BootClock
from aerodft.service.clock_line import JUMP_NS, StatedLine
from aerodft.service.clock_ticks import LineTable, TickLines, Ticks
from aerodft.service.delayed_line import DelayedLine

HOST_STD_S = 0.1
"""Standard deviation of a machine's clock that nobody holds against UTC."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """One tick's telemetry on the followed clock, and what became of stamps given before.

    Attributes:
        tracks: The rows of the followed clock; those of another vehicle or boot are left out.
        restarted: Older stamps are of another boot: they must be forgotten.
        shift_ns: To be added to older stamps.
        host_shift_ns: To be added to UTC that was made of this machine's stamps.
    """

    tracks: tuple[Track, ...]
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
        self._boot = BootClock()
        self._stated = StatedLine()
        self._host_minus_boot = DelayedLine()
        self._host_minus_utc = DelayedLine()  # goes on through reboots
        self._jumps_ns: list[int] = []
        self._host_lines: LineTable | None = None  # at each of the ticks that were taken in together last

    @property
    def is_utc_known(self) -> bool:
        """Whether the vehicle has said what UTC is, in this boot or an earlier one."""
        return self._stated.line is not None or self._host_minus_utc.line is not None

    @property
    def utc_minus_boot_ns(self) -> int | None:
        """UTC minus time since boot at the newest message; None until the vehicle has said what UTC is."""
        line, now_ns = self._stated.line, self._boot.last_boot_ns
        return None if line is None or now_ns is None else line.offset_at(now_ns)

    @property
    def host_minus_boot_ns(self) -> int | None:
        """Arrival minus time since boot of the fastest messages, at the newest one; None before the first."""
        line, now_ns = self._host_minus_boot.line, self._boot.last_boot_ns
        return None if line is None or now_ns is None else line.offset_at(now_ns)

    @property
    def health(self) -> ClockHealth:
        """What happened so far."""
        line, jumps_ns = self._stated.line, (*self._jumps_ns, *self._stated.jumps_ns)
        return ClockHealth(
            drift=None if line is None else line.drift,
            restarts=self._boot.restarts,
            wraps=self._boot.wraps,
            jumps_s=tuple(jump_ns / SECOND_NS for jump_ns in jumps_ns),
            left_out=self._boot.left_out,
            rivals=self._boot.has_rival,
        )

    def update(self, tracks: tuple[Track, ...]) -> Heard:
        """Learn from one tick's tracks."""
        followed, restarted = self._boot.follow(tracks)
        if restarted:
            self._forget()
        arrived_ns = max((int(track.arrival_ns[-1]) for track in followed), default=0)
        before_ns, host_before_ns = self._boot_to_utc_ns(), self.host_to_utc(arrived_ns)
        was_known = self.is_utc_known
        self._learn(followed)
        least_ns = JUMP_NS if was_known or not self.is_utc_known else 0
        return Heard(
            tracks=followed,
            restarted=restarted,
            shift_ns=0 if restarted else _change(before_ns, self._boot_to_utc_ns(), least_ns),
            host_shift_ns=_change(host_before_ns, self.host_to_utc(arrived_ns), least_ns),
        )

    def copy(self) -> "ClockMap":
        """The same, to go on from; what was learned last is shared until more is learned."""
        return copy(self)

    @property
    def is_settled(self) -> bool:
        """Whether the vehicle has said what UTC is, and nothing contradicts it now."""
        waits = self.unsettled(by_utc=True) or self.unsettled(by_utc=False) or self.broken_off()
        return self._stated.line is not None and waits is None

    @property
    def is_plain(self) -> bool:
        """Whether it is settled, and there is no time that the vehicle never said."""
        return self.is_settled and not self._stated.skipped_ns

    def see(self, tick: int) -> None:
        """Look at what was known at one of the ticks that were taken in together last."""
        if self._host_lines is not None:
            self._host_minus_utc.line = self._host_lines.line(tick)

    def settle(self) -> None:
        """All ticks so far are over."""
        self._host_lines = None

    def update_ticks(self, ticks: Ticks) -> tuple[tuple[Track, ...], TickLines] | None:
        """Learn from several ticks' tracks at once, as ``update`` does from one after the other.

        Returns:
            The tracks on the followed clock, all rows of them, and what turns these into UTC; None, and nothing was
            learned, where one of the ticks must be taken alone: a clock jumps, begins anew, or is not known yet.
        """
        if not self.is_settled or not ticks.tracks or any(isinstance(track, SyncTrack) for track in ticks.tracks):
            return None
        boot = self._boot.copy()
        followed, _ = boot.follow(ticks.tracks)
        is_whole = [len(track.boot_ns) for track in followed] == [len(track.boot_ns) for track in ticks.tracks]
        if not is_whole or not boot.is_as_calm_as(self._boot):
            return None
        lines = TickLines(self._stated.copy(), self._host_minus_boot.copy(), self._host_minus_utc.copy())
        if not lines.learn(followed, ticks, self._boot.last_boot_ns or 0):
            return None
        self._boot, self._stated = boot, lines.stated
        self._host_minus_boot, self._host_minus_utc = lines.host_minus_boot, lines.host_minus_utc
        self._host_lines = lines.host
        return followed, lines

    def host_to_utc(self, host_ns: int) -> int:
        """UTC of a stamp of this machine's clock; the same as long as the vehicle has not said what UTC is."""
        line = self._host_minus_utc.line
        return host_ns if line is None else host_ns - line.offset_at(host_ns - line.offset_ns)

    def hosts_to_utc(self, host_ns: IntArray, ticks: IntArray) -> IntArray:
        """The same of stamps ``(n,)``, each as it was known at a tick ``(n,)`` of those taken in together last."""
        if self._host_lines is not None:
            return self._host_lines.own(host_ns, ticks)
        return np.array([self.host_to_utc(each) for each in host_ns.tolist()], dtype=np.int64)

    def to_utc(self, track: Track) -> IntArray:
        """UTC stamps ``(n,)`` of a track's rows, as ``update`` gave it back."""
        host = self._host_minus_utc.line
        by_arrival = track.arrival_ns if host is None else track.arrival_ns - host.offset(track.arrival_ns)
        boots, bare = track.boot_ns, track.boot_ns == NO_BOOT_TIME
        if self._stated.line is not None:
            return np.where(bare, by_arrival, boots + self._stated.line.offset(boots))
        if self._host_minus_boot.line is None:
            return by_arrival
        arrivals = boots + self._host_minus_boot.line.offset(boots)
        return np.where(bare, by_arrival, arrivals if host is None else arrivals - host.offset(arrivals))

    def unsettled(self, *, by_utc: bool) -> str | None:
        """Why stamps cannot be matched now, in a sentence.

        Args:
            by_utc: Whether they are UTC by another clock than this machine's, or this machine's.
        """
        if by_utc and self._stated.line is not None:
            jump_ns = self._stated.unsettled_ns
            if jump_ns is None:
                return None
            return f"the vehicle's UTC jumped by {jump_ns / SECOND_NS:+.3f} s, and has not settled yet"
        late_ns = (self._host_minus_utc if self.is_utc_known else self._host_minus_boot).unsettled_ns
        if late_ns is None:
            return None
        return (
            f"all telemetry arrives {late_ns / SECOND_NS:.1f} s later than before: the receiving machine's clock was"
            " set, or the link is slow; it is not settled yet which"
        )

    def skipped(self, stamp_ns: int) -> str | None:
        """Why a stamp that is UTC by another clock than this machine's can have no telemetry, in a sentence."""
        if any(first_ns < stamp_ns < last_ns for first_ns, last_ns in self._stated.skipped_ns):
            return "the vehicle's UTC jumped ahead: it never said this time"
        return None

    def remarks(self, stamp_ns: int) -> tuple[str, ...]:
        """What is to be known of the clock behind a pose at a stamp (UTC), in sentences."""
        sentences = []
        if any(first_ns <= stamp_ns <= last_ns for first_ns, last_ns in self._stated.repeated_ns):
            sentences.append("the vehicle's UTC jumped back and said this time twice: it is taken for the later")
        if self._boot.has_rival:
            sentences.append(
                "a second autopilot speaks with the vehicle's ids: the one that was heard first is followed"
            )
        return tuple(sentences)

    @property
    def has_nothing_to_say(self) -> bool:
        """Whether UTC is known, and a pose needs no remark about the clocks."""
        is_plain = self.is_utc_known and not self._stated.repeated_ns
        return is_plain and not self._boot.has_rival and not self.has_restarted

    @property
    def has_restarted(self) -> bool:
        """Whether the vehicle has rebooted."""
        return self._boot.restarts > 0

    def broken_off(self) -> str | None:
        """Why telemetry that comes is not believed now, in a sentence."""
        apart_ns = self._boot.other_apart_ns
        if apart_ns is None:
            return None
        return (
            f"the vehicle's time since boot jumped by {apart_ns / SECOND_NS:+.1f} s: a reboot, or another autopilot "
            "with its ids; it is not settled yet which"
        )

    def _boot_to_utc_ns(self) -> int | None:
        """UTC, as far as it is known, minus time since boot at the newest message."""
        now_ns, host_ns = self._boot.last_boot_ns, self.host_minus_boot_ns
        if self._stated.line is not None or now_ns is None or host_ns is None:
            return self.utc_minus_boot_ns
        return self.host_to_utc(now_ns + host_ns) - now_ns

    def _learn(self, tracks: tuple[Track, ...]) -> None:
        known = [track.rows(track.boot_ns != NO_BOOT_TIME, boot_ns=track.boot_ns) for track in tracks]
        if not sum(len(track.boot_ns) for track in known):
            return
        for track in known:
            if isinstance(track, ClockTrack):
                for boot_ns, unix_ns in zip(track.boot_ns.tolist(), track.unix_ns.tolist(), strict=True):
                    self._learn_utc(boot_ns, unix_ns - boot_ns)
        boots = np.concatenate([track.boot_ns for track in known])
        arrivals = np.concatenate([track.arrival_ns for track in known])
        self._host_minus_boot.learn(boots, arrivals)
        if self._stated.line is not None:
            self._host_minus_utc.learn(boots + self._stated.line.offset(boots), arrivals)

    def _learn_utc(self, boot_ns: int, offset_ns: int) -> None:
        before, jumps = self._stated.line, len(self._stated.jumps_ns)
        self._stated.learn(boot_ns, offset_ns)
        if before is None and self._host_minus_utc.line is None and self._host_minus_boot.line is not None:
            self._host_minus_utc = self._host_minus_boot.rebased(offset_ns)
        if len(self._stated.jumps_ns) > jumps:
            self._host_minus_utc = self._host_minus_utc.rebased(self._stated.jumps_ns[-1])

    def _forget(self) -> None:
        """A new boot: only how the vehicle's UTC and this machine's clock stand to each other goes on."""
        self._jumps_ns += self._stated.jumps_ns
        self._stated, self._host_minus_boot = StatedLine(), DelayedLine()


def _change(before_ns: int | None, after_ns: int | None, least_ns: int) -> int:
    """By how much an offset changed; 0 where that is not more than ``least_ns``."""
    change_ns = 0 if before_ns is None or after_ns is None else after_ns - before_ns
    return change_ns if abs(change_ns) > least_ns else 0
