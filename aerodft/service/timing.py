"""The vehicle's clock against UTC and against this machine's clock, learned as messages come.

``utc = boot + utc_minus_boot`` from SYSTEM_TIME; until that is known, from the smallest delay seen between a
message's time since boot and its arrival. A message without a time of its own was sent right after the stamped one
before it, and takes that one's: the link's delay, which comes and goes by seconds on a radio, is not in it. All
corrections are made with what had arrived by the current tick, so the map is the same live and recomputed.
"""

from collections import deque
from enum import Enum, auto

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import IntArray
from aerodft.model.telemetry import NO_BOOT_TIME, ClockTrack, Track

JUMP_NS = SECOND_NS // 10
"""A larger change of an offset is a jump: older stamps are on another clock."""

REBOOT_NS = 2 * SECOND_NS
"""Time since boot that goes back by more than this is a reboot, not a late message."""

_CONFIRMATIONS = 3  # samples that must agree before a jump is believed
_SMOOTHED = 51  # samples whose median is the offset; SYSTEM_TIME counts boot time in whole milliseconds
_ANCHOR_NS = SECOND_NS // 2  # an unstamped message takes the time of a stamped one that came at most this long before
_DELAY_WINDOW = 10  # seconds over which the smallest delay is taken


class ClockChange(Enum):
    """What a tick's messages did to the map."""

    NONE = auto()
    JUMPED = auto()


class ClockMap:
    """Offsets of one vehicle's clock."""

    def __init__(self) -> None:
        self.utc_minus_boot_ns: int | None = None
        self._delays: deque[tuple[int, int]] = deque()  # (second, smallest arrival - boot in it)
        self._last_boot_ns: int | None = None
        self._recent: deque[int] = deque(maxlen=_SMOOTHED)
        self._strangers: list[int] = []
        self._anchors: IntArray = np.empty((2, 0), dtype=np.int64)  # arrival and boot time of stamped messages

    @property
    def host_minus_boot_ns(self) -> int | None:
        """Arrival minus time since boot of the fastest recent message; None before the first."""
        return min(delay for _, delay in self._delays) if self._delays else None

    @property
    def utc_minus_host_ns(self) -> int:
        """UTC minus this machine's clock; 0 as long as the vehicle has not said what UTC is."""
        host = self.host_minus_boot_ns
        return 0 if host is None or self.utc_minus_boot_ns is None else self.utc_minus_boot_ns - host

    def update(self, tracks: tuple[Track, ...]) -> ClockChange:
        """Learn from one tick's tracks."""
        rebooted = self._watch_boot(tracks)
        self._set_anchors(tracks)
        before = self._boot_to_utc()
        for track in tracks:
            if isinstance(track, ClockTrack):
                for offset in (track.unix_ns - track.boot_ns).tolist():
                    self._learn_utc(offset)
        after = self._boot_to_utc()
        jumped = before is not None and after is not None and abs(after - before) > JUMP_NS
        return ClockChange.JUMPED if rebooted or jumped else ClockChange.NONE

    def to_utc(self, track: Track) -> IntArray:
        """UTC stamps ``(n,)`` of a track's rows."""
        by_arrival = track.arrival_ns + self.utc_minus_host_ns
        offset = self._boot_to_utc()
        if offset is None:
            return by_arrival
        boot_ns = np.where(track.boot_ns == NO_BOOT_TIME, self._anchored(track.arrival_ns), track.boot_ns)
        return np.where(boot_ns == NO_BOOT_TIME, by_arrival, boot_ns + offset)

    def _anchored(self, arrival_ns: IntArray) -> IntArray:
        """Boot times of the stamped messages before these arrivals; ``NO_BOOT_TIME`` where there is none near."""
        arrivals, boots = self._anchors
        if len(arrivals) == 0:
            return np.full_like(arrival_ns, NO_BOOT_TIME)
        before = np.searchsorted(arrivals, arrival_ns, side="right") - 1
        near = (before >= 0) & (arrival_ns - arrivals[before] <= _ANCHOR_NS)
        return np.where(near, boots[before], NO_BOOT_TIME)

    def _set_anchors(self, tracks: tuple[Track, ...]) -> None:
        stamped = [track for track in tracks if len(track.boot_ns)]
        arrivals = np.concatenate([self._anchors[0][-1:], *(track.arrival_ns for track in stamped)])
        boots = np.concatenate([self._anchors[1][-1:], *(track.boot_ns for track in stamped)])
        known = boots != NO_BOOT_TIME
        order = np.lexsort((boots[known], arrivals[known]))
        self._anchors = np.stack([arrivals[known][order], boots[known][order]])

    def _boot_to_utc(self) -> int | None:
        return self.host_minus_boot_ns if self.utc_minus_boot_ns is None else self.utc_minus_boot_ns

    def _watch_boot(self, tracks: tuple[Track, ...]) -> bool:
        rebooted = False
        for track in tracks:
            known = track.boot_ns != NO_BOOT_TIME
            if not np.any(known):
                continue
            boot, arrival = track.boot_ns[known], track.arrival_ns[known]
            if self._last_boot_ns is not None and int(boot[-1]) < self._last_boot_ns - REBOOT_NS:
                self._forget()
                rebooted = True
            self._last_boot_ns = max(self._last_boot_ns or 0, int(boot[-1]))
            self._note_delay(int(arrival[-1]), int(np.min(arrival - boot)))
        return rebooted

    def _forget(self) -> None:
        self.utc_minus_boot_ns = self._last_boot_ns = None
        self._delays.clear()
        self._recent.clear()
        self._strangers.clear()
        self._anchors = np.empty((2, 0), dtype=np.int64)

    def _note_delay(self, arrival_ns: int, delay_ns: int) -> None:
        second = arrival_ns // SECOND_NS
        if self._delays and self._delays[-1][0] == second:
            self._delays[-1] = (second, min(self._delays[-1][1], delay_ns))
        else:
            self._delays.append((second, delay_ns))
        while self._delays[0][0] < second - _DELAY_WINDOW:
            self._delays.popleft()

    def _learn_utc(self, offset_ns: int) -> None:
        current = self.utc_minus_boot_ns
        if current is None or abs(offset_ns - current) <= JUMP_NS:
            self._strangers.clear()
            self._recent.append(offset_ns)
            self.utc_minus_boot_ns = sorted(self._recent)[len(self._recent) // 2]
            return
        if self._strangers and abs(offset_ns - self._strangers[-1]) > JUMP_NS:
            self._strangers.clear()
        self._strangers.append(offset_ns)
        if len(self._strangers) >= _CONFIRMATIONS:
            self._recent.clear()
            self._recent.extend(self._strangers)
            self.utc_minus_boot_ns = sorted(self._strangers)[len(self._strangers) // 2]
            self._strangers.clear()
