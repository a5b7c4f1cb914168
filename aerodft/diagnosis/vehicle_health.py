"""What a vehicle and its cameras say of themselves over a whole log: the worst of it, and the sentences that follow."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import (
    FIX_3D,
    RATIOS,
    BoolArray,
    Camera,
    CameraTrack,
    EstimatorTrack,
    FloatArray,
    GpsTrack,
    HeartbeatTrack,
    IntArray,
    LinkTrack,
    Track,
    ZoomSource,
)
from aerodft.service import HealthSettings, TelemetrySettings, ZoomSettings
from aerodft.service.pose import LEVEL_SLACK, hfov_difference_std_rad

_SAME_DEG: Final = 0.1
_NOTABLE_LOSS: Final = 0.01
_NEAR: Final = 0.8
_SOON_S: Final = 1.0


@dataclass(slots=True)
class Maximum:
    """The largest of all values.

    Attributes:
        value: That; NaN before the first.
        at_ns: When it came.
    """

    value: float = math.nan
    at_ns: int = 0

    def add(self, values: FloatArray, arrival_ns: IntArray) -> None:
        """Take in values ``(n,)``; NaN is none."""
        if not np.isfinite(values).any():
            return
        k = int(np.nanargmax(values))
        if not self.value >= values[k]:
            self.value, self.at_ns = float(values[k]), int(arrival_ns[k])


@dataclass(slots=True)
class Episode:
    """Reports that say something bad, among all.

    Attributes:
        count: All reports.
        bad: Those that say it.
        first_ns: The first of these.
        last_ns: The last of these.
    """

    count: int = 0
    bad: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def add(self, bad: BoolArray, arrival_ns: IntArray) -> None:
        """Take in reports ``(n,)``."""
        self.count += len(bad)
        when_ns = arrival_ns[bad]
        if len(when_ns):
            self.first_ns = self.first_ns if self.bad else int(when_ns[0])
            self.bad, self.last_ns = self.bad + len(when_ns), int(when_ns[-1])


@dataclass(frozen=True, slots=True, order=True)
class _Reporter:
    """Sender of a view: a camera, one of its video streams (0: none), and the message."""

    camera: int
    source: ZoomSource
    stream: int

    def __str__(self) -> str:
        return f"{self.source} of camera {self.camera}" + (f", stream {self.stream}" if self.stream else "")


@dataclass(slots=True)
class _View:
    """Extremes of what is said."""

    hfov_deg: tuple[float, float] = (math.inf, -math.inf)
    level: tuple[float, float] = (math.inf, -math.inf)
    sizes_px: set[tuple[int, int]] = field(default_factory=set)


@dataclass(slots=True)
class CameraReports:
    """Takes in tracks of cameras; sums up what each says of its view."""

    _views: dict[_Reporter, _View] = field(default_factory=dict)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Cameras that say anything of their view."""
        return tuple(sorted({reporter.camera for reporter in self._views}))

    def add(self, track: CameraTrack) -> None:
        """Take in a track."""
        for camera, stream in np.unique(np.stack([track.device, track.stream], axis=-1), axis=0).tolist():
            own = (track.device == camera) & (track.stream == stream)
            view = self._views.setdefault(_Reporter(camera, track.source, stream), _View())
            view.hfov_deg = _wider(view.hfov_deg, np.degrees(track.hfov_rad[own]))
            view.level = _wider(view.level, track.level[own])
            view.sizes_px |= {(w, h) for w, h in np.unique(track.size_px[own], axis=0).tolist() if w and h}

    def sentences(self, camera: Camera | None, zoom: ZoomSettings) -> Iterator[str]:
        """Sentences on the cameras, and on their differences from a camera file.

        Args:
            camera: As its file has it; None where nothing is held against one.
            zoom: How a station reads them.
        """
        numbers = ", ".join(map(str, self.numbers))
        if zoom.camera is not None and self._views and zoom.camera not in self.numbers:
            yield f"telemetry.zoom.camera = {zoom.camera} is not heard, cameras {numbers} are: no zoom is followed"
        elif zoom.camera is None and len(self.numbers) > 1:
            yield (
                f"more than one camera reports its view ({numbers}): as soon as one of them is zoomed nothing is "
                "measured, unless telemetry.zoom.camera says which one makes the images"
            )
        counted = {
            reporter: view for reporter, view in sorted(self._views.items(), key=_reporter) if _counts(reporter, zoom)
        }
        for number in self.numbers:
            streams = [each.stream for each in counted if each.camera == number and each.stream]
            if len(streams) > 1:
                listed = ", ".join(map(str, streams))
                yield f"camera {number} has several streams ({listed}): set telemetry.zoom.stream, or the first counts"
        for reporter, view in counted.items():
            yield from _of_view(reporter, view, camera, zoom)

    def documents(self) -> list[dict[str, Any]]:
        """Plain JSON values, one document for each camera, message and stream; null for what was never said."""
        return [
            {
                "camera": reporter.camera,
                "message": str(reporter.source),
                "stream": reporter.stream or None,
                "hfov_deg": _span(view.hfov_deg),
                "zoom_percent": _span((100 * view.level[0], 100 * view.level[1])),
                "sizes_px": sorted(map(list, view.sizes_px)),
            }
            for reporter, view in sorted(self._views.items(), key=_reporter)
        ]


def _reporter(item: tuple[_Reporter, _View]) -> _Reporter:
    return item[0]


def _counts(reporter: _Reporter, zoom: ZoomSettings) -> bool:
    is_chosen = zoom.camera in {None, reporter.camera} and (
        not reporter.stream or zoom.stream in {None, reporter.stream}
    )
    return is_chosen and reporter.source in zoom.order


def _of_view(reporter: _Reporter, view: _View, camera: Camera | None, zoom: ZoomSettings) -> Iterator[str]:
    if not zoom.curve and any(abs(level - zoom.level) > LEVEL_SLACK for level in view.level if math.isfinite(level)):
        low, high = (100 * level for level in view.level)
        yield (
            f"{reporter}: the zoom is {low:.0f} to {high:.0f} %, the camera file is of {100 * zoom.level:g} % "
            "(telemetry.zoom.at_percent); set telemetry.zoom.curve to what that makes of the focal length, or "
            "images zoomed otherwise than the camera file have no answer"
        )
    if camera is not None:
        yield from _against(reporter, view, camera, zoom)


def _against(reporter: _Reporter, view: _View, camera: Camera, zoom: ZoomSettings) -> Iterator[str]:
    low, high = view.hfov_deg
    own_deg = math.degrees(camera.hfov_rad if zoom.reported_hfov_rad is None else zoom.reported_hfov_rad)
    std_deg = math.degrees(hfov_difference_std_rad(zoom, reporter.source, camera))
    if high - low > _SAME_DEG:
        yield f"{reporter}: the field of view moves between {low:.1f} and {high:.1f} deg, which is followed"
    elif math.isfinite(low) and abs(low - own_deg) > std_deg:
        yield (
            f"{reporter} says hfov {low:.1f} deg, the camera file {own_deg:.1f} deg (std of the two {std_deg:.1f} "
            "deg): correct the file, or the vehicle's parameter (CAM1_HFOV of ArduPilot), or state it in "
            "telemetry.zoom.reported_hfov_deg"
        )
    for width, height in sorted(view.sizes_px - {(camera.width_px, camera.height_px)}):
        yield f"{reporter} says {width} x {height} px, the camera file {camera.width_px} x {camera.height_px} px"


def _wider(span: tuple[float, float], values: np.ndarray) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (min(span[0], float(known.min())), max(span[1], float(known.max()))) if len(known) else span


def _span(span: tuple[float, float]) -> list[float] | None:
    return [round(each, 3) for each in span] if math.isfinite(span[0]) else None


@dataclass(slots=True)
class VehicleHealth:
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
    silence: Maximum = field(default_factory=Maximum)
    no_fix: Episode = field(default_factory=Episode)
    gps_m: tuple[Maximum, Maximum] = field(default_factory=lambda: (Maximum(), Maximum()))
    no_attitude: Episode = field(default_factory=Episode)
    ratios: tuple[Maximum, ...] = field(default_factory=lambda: tuple(Maximum() for _ in RATIOS))
    received: int = 0
    lost: int = 0
    cameras: CameraReports = field(default_factory=CameraReports)
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

    def _at(self, worst: Maximum) -> str:
        return f"{self._since_s(worst.at_ns):.0f} s after the start"

    def _during(self, episode: Episode) -> str:
        first_s, last_s = self._since_s(episode.first_ns), self._since_s(episode.last_ns)
        return f"{episode.bad} of {episode.count} reports, from {first_s:.0f} to {last_s:.0f} s after the start"

    def _lasts(self, episode: Episode, ready_s: float) -> bool:
        """Whether there is a episode, and it is not only that the vehicle starts up."""
        return episode.bad > 0 and (not ready_s or self._since_s(episode.last_ns) > ready_s + _SOON_S)

    def _since_s(self, at_ns: int) -> float:
        return (at_ns - (self.start_ns or 0)) / SECOND_NS

    def sentences(
        self, camera: Camera | None = None, settings: TelemetrySettings | None = None, ready_s: float = 0.0
    ) -> list[str]:
        """Sentences on limits of the vehicle's health, and on differences from a camera file.

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

    def _span(self, episode: Episode) -> list[float] | None:
        return [self._rounded(episode.first_ns), self._rounded(episode.last_ns)] if episode.bad else None

    def _rounded(self, at_ns: int) -> float:
        return round(self._since_s(at_ns), 3)
