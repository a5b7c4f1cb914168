"""What a vehicle says of itself over a whole log: the worst of it, and the sentences that follow."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from aerodft.adapters.mavlink.camera_survey import CameraSurvey
from aerodft.adapters.mavlink.spells import Spell, Worst
from aerodft.conventions import SECOND_NS
from aerodft.model.camera import Camera
from aerodft.model.health import FIX_3D, RATIOS, EstimatorTrack, GpsTrack, HeartbeatTrack, LinkTrack
from aerodft.model.telemetry import CameraTrack, Track
from aerodft.service.health_settings import HealthSettings
from aerodft.service.settings import TelemetrySettings

_NOTABLE_LOSS: Final = 0.01
_NEAR: Final = 0.8
_SOON_S: Final = 1.0


@dataclass(slots=True)
class HealthSurvey:
    """Takes in tracks; sums up what they say of the vehicle, its link and its camera.

    Attributes:
        start_ns: What times are counted from; None for the first track's arrival.
        autopilot: MAV_AUTOPILOT as last said.
        heartbeats: How many there were.
        silence: The longest one between two of them (s), and when it began.
        no_fix: Reports of the receiver without a 3D fix.
        gps_m: Largest horizontal and vertical standard deviation stated with a fix.
        no_attitude: Reports of the estimator that there is no attitude.
        ratios: ``(4,)`` largest of each of ``RATIOS``.
        received: Frames of the autopilot.
        lost: Those that are missing between them.
        cameras: What is said of cameras.
    """

    start_ns: int | None = None
    autopilot: int | None = None
    heartbeats: int = 0
    silence: Worst = field(default_factory=Worst)
    no_fix: Spell = field(default_factory=Spell)
    gps_m: tuple[Worst, Worst] = field(default_factory=lambda: (Worst(), Worst()))
    no_attitude: Spell = field(default_factory=Spell)
    ratios: tuple[Worst, ...] = field(default_factory=lambda: tuple(Worst() for _ in RATIOS))
    received: int = 0
    lost: int = 0
    cameras: CameraSurvey = field(default_factory=CameraSurvey)
    _last_beat_ns: int | None = None

    def add(self, track: Track) -> None:
        """Take in a track, whatever it is of."""
        if self.start_ns is None and len(track.arrival_ns):
            self.start_ns = int(track.arrival_ns[0])
        match track:
            case HeartbeatTrack():
                self._add_heartbeats(track)
            case GpsTrack():
                self._add_fixes(track)
            case EstimatorTrack():
                self.no_attitude.add(~track.has_attitude, track.arrival_ns)
                for k, worst in enumerate(self.ratios):
                    worst.add(track.ratios[:, k], track.arrival_ns)
            case LinkTrack():
                self.received += len(track.lost)
                self.lost += int(track.lost.sum())
            case CameraTrack():
                self.cameras.add(track)

    def _add_heartbeats(self, track: HeartbeatTrack) -> None:
        self.autopilot = int(track.autopilot[-1])
        self.heartbeats += len(track.autopilot)
        before_ns = track.arrival_ns[0] if self._last_beat_ns is None else self._last_beat_ns
        silent_ns = np.diff(track.arrival_ns, prepend=before_ns)
        self.silence.add(silent_ns / SECOND_NS, track.arrival_ns - silent_ns)
        self._last_beat_ns = int(track.arrival_ns[-1])

    def _add_fixes(self, track: GpsTrack) -> None:
        good = track.fix >= FIX_3D
        self.no_fix.add(~good, track.arrival_ns)
        for worst, std_m in zip(self.gps_m, (track.horizontal_std_m, track.vertical_std_m), strict=True):
            worst.add(std_m[good], track.arrival_ns[good])

    def _at(self, worst: Worst) -> str:
        return f"{self._since_s(worst.at_ns):.0f} s after the start"

    def _during(self, spell: Spell) -> str:
        first_s, last_s = self._since_s(spell.first_ns), self._since_s(spell.last_ns)
        return f"{spell.bad} of {spell.count} reports, from {first_s:.0f} to {last_s:.0f} s after the start"

    def _lasts(self, spell: Spell, ready_s: float) -> bool:
        """Whether there is a spell, and it is not only that the vehicle starts up."""
        return spell.bad > 0 and (not ready_s or self._since_s(spell.last_ns) > ready_s + _SOON_S)

    def _since_s(self, at_ns: int) -> float:
        return (at_ns - (self.start_ns or 0)) / SECOND_NS

    def sentences(
        self, camera: Camera | None = None, settings: TelemetrySettings | None = None, ready_s: float = 0.0
    ) -> list[str]:
        """What limits how far the vehicle may be believed; and what it says against a camera file.

        Args:
            camera: As its file has it; None where nothing is held against one.
            settings: The limits of a station; None for those that hold where nobody states any.
            ready_s: When the vehicle had started up: what is over by then is not said.
        """
        limits = settings or TelemetrySettings()
        return [
            *self._life(limits.health),
            *self._gps(limits.health, ready_s),
            *self._estimator(limits.health, ready_s),
            *self._link(),
            *self.cameras.sentences(camera, limits.zoom),
        ]

    def _life(self, limits: HealthSettings) -> Iterator[str]:
        limit_s = limits.heartbeat_ns / SECOND_NS
        if self.received and not self.heartbeats:
            yield "no HEARTBEAT of the autopilot: whether it lives is told from its other messages alone"
        if self.silence.value > limit_s:
            yield (
                f"HEARTBEAT of the autopilot is silent for up to {self.silence.value:.1f} s ({self._at(self.silence)}):"
                f" nothing is measured later than {limit_s:g} s after one (telemetry.health.heartbeat_s)"
            )

    def _gps(self, limits: HealthSettings, ready_s: float) -> Iterator[str]:
        if self.received and not self.no_fix.count:
            yield "GPS_RAW_INT never comes: how good the fix is, is not known"
        if self._lasts(self.no_fix, ready_s):
            yield f"GPS has no 3D fix in {self._during(self.no_fix)}: places are not stated then"
        for what, worst, most_m in zip(
            ("horizontally", "vertically"),
            self.gps_m,
            (limits.horizontal_std_m, limits.vertical_std_m),
            strict=True,
        ):
            if worst.value > most_m:
                yield (
                    f"GPS is accurate to {worst.value:.1f} m {what} at its worst, {most_m:g} m is wanted "
                    f"({self._at(worst)})"
                )

    def _estimator(self, limits: HealthSettings, ready_s: float) -> Iterator[str]:
        if self._lasts(self.no_attitude, ready_s):
            yield (
                f"the autopilot's estimator has no attitude in {self._during(self.no_attitude)}: "
                "nothing is measured then"
            )
        limit = limits.max_ratio
        for name, worst in zip(RATIOS, self.ratios, strict=True):
            if worst.value >= limit:
                yield (
                    f"the autopilot's estimator is at fault: its test ratio of {name} reaches {worst.value:.2f}, "
                    f"nothing is measured from {limit:g} on (telemetry.health.max_test_ratio; {self._at(worst)})"
                )
            elif worst.value >= _NEAR * limit:
                yield (
                    f"the autopilot's estimator is near its limit: its test ratio of {name} reaches "
                    f"{worst.value:.2f} ({self._at(worst)})"
                )

    def _link(self) -> Iterator[str]:
        total = self.received + self.lost
        if total and self.lost > _NOTABLE_LOSS * total:
            yield (
                f"the link lost {100 * self.lost / total:.1f} % of the autopilot's frames ({self.lost} of {total}): "
                "ask for fewer messages, or for a faster link"
            )

    def document(self) -> dict[str, Any]:
        """Plain JSON values; null for what was never said; times in seconds since the start."""
        horizontal_m, vertical_m = (None if math.isnan(each.value) else each.value for each in self.gps_m)
        ratios = {name: worst for name, worst in zip(RATIOS, self.ratios, strict=True) if math.isfinite(worst.value)}
        has_silence = self.silence.value > 0
        return {
            "autopilot": self.autopilot,
            "heartbeats": self.heartbeats,
            "longest_silence_s": round(self.silence.value, 3) if has_silence else 0.0,
            "longest_silence_at_s": self._rounded(self.silence.at_ns) if has_silence else None,
            "gps": {
                "reports": self.no_fix.count,
                "without_fix": self.no_fix.bad,
                "without_fix_s": self._span(self.no_fix),
                "worst_horizontal_std_m": horizontal_m,
                "worst_vertical_std_m": vertical_m,
            },
            "estimator": {
                "reports": self.no_attitude.count,
                "without_attitude": self.no_attitude.bad,
                "without_attitude_s": self._span(self.no_attitude),
                "worst_test_ratios": {name: worst.value for name, worst in ratios.items()},
                "worst_at_s": {name: self._rounded(worst.at_ns) for name, worst in ratios.items()},
            },
            "link": {"received": self.received, "lost": self.lost},
            "cameras": self.cameras.documents(),
        }

    def _span(self, spell: Spell) -> list[float] | None:
        return [self._rounded(spell.first_ns), self._rounded(spell.last_ns)] if spell.bad else None

    def _rounded(self, at_ns: int) -> float:
        return round(self._since_s(at_ns), 3)
