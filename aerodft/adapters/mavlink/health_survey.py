"""What a vehicle says of itself over a whole log: the worst of it, and the sentences that follow."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.camera import Camera
from aerodft.model.health import RATIOS, EstimatorTrack, GpsTrack, HeartbeatTrack, LinkTrack
from aerodft.model.telemetry import CameraTrack, Track
from aerodft.service.health_settings import HealthSettings
from aerodft.service.zoom import focal_share
from aerodft.service.zoom_settings import ZoomSettings

_3D_FIX: Final = 3
_NOTABLE_LOSS: Final = 0.01
_NEAR: Final = 0.8
_SAME_DEG: Final = 0.1


@dataclass(slots=True)
class _View:
    """Extremes of what one message says of the camera."""

    hfov_deg: tuple[float, float] = (math.inf, -math.inf)
    level: tuple[float, float] = (math.inf, -math.inf)
    sizes_px: set[tuple[int, int]] = field(default_factory=set)
    devices: set[int] = field(default_factory=set)


@dataclass(slots=True)
class HealthSurvey:
    """Takes in tracks; sums up what they say of the vehicle, its link and its camera.

    Attributes:
        autopilot: MAV_AUTOPILOT as last said.
        heartbeats: How many there were.
        longest_silence_s: Between two of them.
        fixes: Reports of the receiver.
        without_fix: Those without a 3D fix.
        worst_gps_m: Largest horizontal and vertical standard deviation stated with a fix; NaN where none was.
        estimates: Reports of the estimator.
        without_attitude: Those that say that there is no attitude.
        worst_ratios: ``(4,)`` largest of each of ``RATIOS``.
        received: Frames of the autopilot.
        lost: Those that are missing between them.
        views: By message, what it says of the camera.
    """

    autopilot: int | None = None
    heartbeats: int = 0
    longest_silence_s: float = 0.0
    fixes: int = 0
    without_fix: int = 0
    worst_gps_m: tuple[float, float] = (math.nan, math.nan)
    estimates: int = 0
    without_attitude: int = 0
    worst_ratios: tuple[float, ...] = (0.0,) * len(RATIOS)
    received: int = 0
    lost: int = 0
    views: dict[str, _View] = field(default_factory=dict)
    _last_beat_ns: int | None = None

    def add(self, track: Track) -> None:
        """Take in a track, whatever it is of."""
        match track:
            case HeartbeatTrack():
                self._add_heartbeats(track)
            case GpsTrack():
                self._add_fixes(track)
            case EstimatorTrack():
                self.estimates += len(track.has_attitude)
                self.without_attitude += int(np.count_nonzero(~track.has_attitude))
                self.worst_ratios = tuple(np.maximum(self.worst_ratios, track.ratios.max(axis=0)).tolist())
            case LinkTrack():
                self.received += len(track.lost)
                self.lost += int(track.lost.sum())
            case CameraTrack():
                self._add_view(track)

    def _add_heartbeats(self, track: HeartbeatTrack) -> None:
        self.autopilot = int(track.autopilot[-1])
        self.heartbeats += len(track.autopilot)
        before_ns = track.arrival_ns[0] if self._last_beat_ns is None else self._last_beat_ns
        silence_s = float(np.diff(track.arrival_ns, prepend=before_ns).max()) / SECOND_NS
        self.longest_silence_s = max(self.longest_silence_s, silence_s)
        self._last_beat_ns = int(track.arrival_ns[-1])

    def _add_fixes(self, track: GpsTrack) -> None:
        good = track.fix >= _3D_FIX
        self.fixes += len(good)
        self.without_fix += int(np.count_nonzero(~good))
        stds = (track.horizontal_std_m[good], track.vertical_std_m[good])
        worst = (float(np.fmax.reduce(each, initial=math.nan)) for each in stds)
        horizontal, vertical = (float(np.fmax(a, b)) for a, b in zip(self.worst_gps_m, worst, strict=True))
        self.worst_gps_m = (horizontal, vertical)

    def _add_view(self, track: CameraTrack) -> None:
        view = self.views.setdefault(str(track.source), _View())
        view.hfov_deg = _wider(view.hfov_deg, np.degrees(track.hfov_rad))
        view.level = _wider(view.level, track.level)
        view.sizes_px |= {(w, h) for w, h in np.unique(track.size_px, axis=0).tolist() if w and h}
        view.devices |= set(np.unique(track.device).tolist())

    def sentences(self, camera: Camera | None = None) -> list[str]:
        """What limits how far the vehicle may be believed; and what it says against a camera file."""
        return [*self._life(), *self._gps(), *self._estimator(), *self._link(), *self._camera(camera)]

    def _life(self) -> Iterator[str]:
        limit_s = HealthSettings().heartbeat_ns / SECOND_NS
        if self.received and not self.heartbeats:
            yield "no HEARTBEAT of the autopilot: whether it lives is told from its other messages alone"
        if self.longest_silence_s > limit_s:
            yield (
                f"HEARTBEAT of the autopilot is silent for up to {self.longest_silence_s:.1f} s: "
                f"nothing is measured later than {limit_s:g} s after one (telemetry.health.heartbeat_s)"
            )

    def _gps(self) -> Iterator[str]:
        limits = HealthSettings()
        if self.received and not self.fixes:
            yield "GPS_RAW_INT never comes: how good the fix is, is not known"
        if self.without_fix:
            yield f"GPS has no 3D fix in {self.without_fix} of {self.fixes} reports: places are not stated then"
        for what, std_m, most_m in zip(
            ("horizontally", "vertically"),
            self.worst_gps_m,
            (limits.horizontal_std_m, limits.vertical_std_m),
            strict=True,
        ):
            if std_m > most_m:
                yield f"GPS is accurate to {std_m:.1f} m {what} at its worst, {most_m:g} m is wanted"

    def _estimator(self) -> Iterator[str]:
        if self.without_attitude:
            yield (
                f"the autopilot's estimator has no attitude in {self.without_attitude} of {self.estimates} reports: "
                "nothing is measured then"
            )
        limit = HealthSettings().max_ratio
        for name, ratio in zip(RATIOS, self.worst_ratios, strict=True):
            if ratio >= limit:
                yield (
                    f"the autopilot's estimator is at fault: its test ratio of {name} reaches {ratio:.2f}, nothing is "
                    f"measured from {limit:g} on (telemetry.health.max_test_ratio)"
                )
            elif ratio >= _NEAR * limit:
                yield f"the autopilot's estimator is near its limit: its test ratio of {name} reaches {ratio:.2f}"

    def _link(self) -> Iterator[str]:
        total = self.received + self.lost
        if total and self.lost > _NOTABLE_LOSS * total:
            yield (
                f"the link lost {100 * self.lost / total:.1f} % of the autopilot's frames ({self.lost} of {total}): "
                "ask for fewer messages, or for a faster link"
            )

    def _camera(self, camera: Camera | None) -> Iterator[str]:
        for name, view in self.views.items():
            if len(view.devices) > 1:
                numbers = ", ".join(map(str, sorted(view.devices)))
                yield f"{name} is of more than one camera ({numbers}): set telemetry.zoom.camera, or the first is taken"
            if view.level[1] > view.level[0]:
                low, high = (100 * level for level in view.level)
                yield (
                    f"{name}: the zoom moves between {low:.0f} and {high:.0f} %; set telemetry.zoom.curve to what that "
                    "makes of the focal length, or images zoomed otherwise than the camera file have no answer"
                )
            if camera is not None:
                yield from _against(name, view, camera)

    def document(self) -> dict[str, Any]:
        """Plain JSON values; null for what was never said."""
        horizontal_m, vertical_m = (None if math.isnan(each) else each for each in self.worst_gps_m)
        return {
            "autopilot": self.autopilot,
            "heartbeats": self.heartbeats,
            "longest_silence_s": round(self.longest_silence_s, 3),
            "gps": {
                "reports": self.fixes,
                "without_fix": self.without_fix,
                "worst_horizontal_std_m": horizontal_m,
                "worst_vertical_std_m": vertical_m,
            },
            "estimator": {
                "reports": self.estimates,
                "without_attitude": self.without_attitude,
                "worst_test_ratios": dict(zip(RATIOS, self.worst_ratios, strict=True)) if self.estimates else {},
            },
            "link": {"received": self.received, "lost": self.lost},
            "cameras": {
                name: {
                    "hfov_deg": _span(view.hfov_deg),
                    "zoom_percent": _span((100 * view.level[0], 100 * view.level[1])),
                    "sizes_px": sorted(map(list, view.sizes_px)),
                    "numbers": sorted(view.devices),
                }
                for name, view in self.views.items()
            },
        }


def _against(name: str, view: _View, camera: Camera) -> Iterator[str]:
    low, high = view.hfov_deg
    own_deg = math.degrees(camera.hfov_rad)
    std_deg = math.degrees(math.hypot(ZoomSettings().hfov_std_rad, math.sin(camera.hfov_rad) * focal_share(camera)))
    if high - low > _SAME_DEG:
        yield f"{name}: the field of view moves between {low:.1f} and {high:.1f} deg, which is followed"
    elif math.isfinite(low) and abs(low - own_deg) > std_deg:
        yield (
            f"{name} says hfov {low:.1f} deg, the camera file {own_deg:.1f} deg (std of the two {std_deg:.1f} deg): "
            "correct the file, or the vehicle's parameter (CAM1_HFOV of ArduPilot), or state it in "
            "telemetry.zoom.reported_hfov_deg"
        )
    for width, height in sorted(view.sizes_px - {(camera.width_px, camera.height_px)}):
        yield f"{name} says {width} x {height} px, the camera file {camera.width_px} x {camera.height_px} px"


def _wider(span: tuple[float, float], values: np.ndarray) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (min(span[0], float(known.min())), max(span[1], float(known.max()))) if len(known) else span


def _span(span: tuple[float, float]) -> list[float] | None:
    return [round(each, 3) for each in span] if math.isfinite(span[0]) else None
