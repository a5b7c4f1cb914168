"""How the sender's UTC relates to the recording machine's over a survey, and when it jumped or began anew."""

from dataclasses import dataclass, field

import numpy as np

from aerodft.adapters.mavlink.survey_report import ClockSummary
from aerodft.conventions import SECOND_NS
from aerodft.model.telemetry import NO_BOOT_TIME, ClockTrack
from aerodft.service.clock_line import JUMP_NS
from aerodft.service.timing import ClockHealth


@dataclass(slots=True)
class ClockSurvey:
    """Takes in tracks of UTC, and what becomes known of the clock's health."""

    _first_ns: int | None = None
    _offsets_ns: list[int] = field(default_factory=list)  # thinned
    _last: tuple[int, int] | None = None  # time since boot, UTC minus that
    _step_ns: int | None = None  # arrival of the last step of UTC
    _fall_ns: int | None = None  # arrival of the last time since boot that was less than the one before
    _reboots_ns: list[int] = field(default_factory=list)
    _jumps_ns: list[int] = field(default_factory=list)

    def add(self, track: ClockTrack) -> None:
        """Take in a track, n > 0."""
        if self._first_ns is None:
            self._first_ns = int(track.arrival_ns[0])
        self._offsets_ns.append(int(np.median(track.arrival_ns - track.unix_ns)))
        for arrival_ns, boot_ns, unix_ns in zip(
            track.arrival_ns.tolist(), track.boot_ns.tolist(), track.unix_ns.tolist(), strict=True
        ):
            if boot_ns == NO_BOOT_TIME:
                continue
            last_boot_ns, last_offset_ns = self._last or (boot_ns, unix_ns - boot_ns)
            if boot_ns < last_boot_ns - SECOND_NS:
                self._fall_ns = arrival_ns
            elif abs(unix_ns - boot_ns - last_offset_ns) > JUMP_NS:
                self._step_ns = arrival_ns
            self._last = boot_ns, unix_ns - boot_ns

    def note(self, health: ClockHealth, at_ns: int) -> None:
        """What is new in the clock's health since the last time, at the latest at this arrival."""
        if health.restarts > len(self._reboots_ns):
            self._reboots_ns.append(at_ns if self._fall_ns is None else self._fall_ns)
        if len(health.jumps_s) > len(self._jumps_ns):
            self._jumps_ns.append(at_ns if self._step_ns is None else self._step_ns)

    def summary(self, start_ns: int | None) -> ClockSummary:
        """What is known by now; times since ``start_ns``."""
        first_ns, start_ns = self._first_ns, start_ns or 0
        return ClockSummary(
            known_after_s=None if first_ns is None else (first_ns - start_ns) / SECOND_NS,
            host_minus_utc_s=float(np.median(self._offsets_ns)) / SECOND_NS if self._offsets_ns else None,
            reboots_at_s=tuple((at_ns - start_ns) / SECOND_NS for at_ns in self._reboots_ns),
            jumps_at_s=tuple((at_ns - start_ns) / SECOND_NS for at_ns in self._jumps_ns),
        )
