"""The vehicle's clock against UTC and against this machine's clock, learned as messages come.

``utc = boot + offset(boot)``, a line through what SYSTEM_TIME says; until that is known, the line below arrival minus
boot, for this machine's clock. A message without a time of its own was sent right after the stamped one before it, and
takes that one's: the link's delay, which comes and goes by seconds on a radio, is not in it. All corrections are made
with what had arrived by the current tick, so the map is the same live and recomputed.
"""

from copy import copy
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import NO_BOOT_TIME, BoolArray, IntArray, SyncTrack, Track
from aerodft.service.clocks.stated_offset import JUMP_NS
from aerodft.service.clocks.tracks_by_tick import Ticks
from aerodft.service.clocks.vehicle_clock import VehicleClock
from aerodft.service.streams import LAST

HOST_STD_S: Final = 0.1
"""Standard deviation of a machine's clock that nobody holds against UTC."""


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
