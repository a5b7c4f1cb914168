"""A whole log's attitudes in UTC, for what looks at a flight from outside its run: the alignment of a video."""

from dataclasses import dataclass, field, replace

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, GimbalSource, GimbalTrack, IntArray, MountAxes, ReportFrame, Track, VehicleTrack
from aerodft.service.attitude.servo_mount import mounted_wxyz
from aerodft.service.attitude.sources import AttitudeSources
from aerodft.service.clocks import ClockMap, Ticks
from aerodft.service.feed import MergedFeed
from aerodft.service.ports import Source, TelemetryDecoder
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import LAST


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeSeries:
    """One stream of attitudes.

    Attributes:
        stamp_ns: ``(n,)`` UTC, strictly ascending.
        wxyz: ``(n, 4)`` ``ned_SO3_body`` of a vehicle, ``ref_SO3_gimbal`` of a gimbal.
        yaw_in_earth: ``(n,)`` of a gimbal, as in ``GimbalTrack``; of a vehicle always true.
    """

    stamp_ns: IntArray
    wxyz: FloatArray
    yaw_in_earth: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeHistory:
    """The attitudes of one vehicle; streams without a sample are left out.

    Attributes:
        vehicle: Its own.
        gimbals: Their reports.
        frames: What the roll and pitch of each gimbal are against, as far as it was set or found.
    """

    vehicle: AttitudeSeries | None
    gimbals: dict[GimbalSource, AttitudeSeries]
    frames: dict[GimbalSource, ReportFrame]


@dataclass(slots=True)
class _Rows:
    stamps: list[IntArray] = field(default_factory=list)
    wxyz: list[FloatArray] = field(default_factory=list)
    in_earth: list[FloatArray] = field(default_factory=list)

    def shift(self, by_ns: int) -> None:
        """What time it was is known better now."""
        self.stamps = [stamps + by_ns for stamps in self.stamps]

    def series(self) -> AttitudeSeries | None:
        """What was gathered; of samples with one stamp, or that go back, the first in time."""
        if not self.stamps:
            return None
        stamps, order = np.unique(np.concatenate(self.stamps), return_index=True)
        wxyz, in_earth = np.concatenate(self.wxyz)[order], np.concatenate(self.in_earth)[order]
        return AttitudeSeries(stamp_ns=stamps, wxyz=wxyz, yaw_in_earth=in_earth)


def attitude_history(log: Source, decoder: TelemetryDecoder, settings: AttitudeSettings) -> AttitudeHistory:
    """Read through a log once; stamps are those of the clock map, as in a run.

    After a reboot only what follows counts: what came before is on another clock.

    Args:
        log: The log.
        decoder: Of its frames.
        settings: Which gimbals are heard, and what they report against, where that is known.
    """
    clock, sources = ClockMap(), AttitudeSources(settings)
    vehicle, gimbals = _Rows(), dict[GimbalSource, _Rows]()
    for batch in MergedFeed([log], SECOND_NS, idle_ticks_ns=0, longest_ns=0).batches():
        tracks = tuple(track for block in batch.raw for track in decoder.decode(block) if len(track.arrival_ns))
        update = clock.update(Ticks.one(tracks))
        if update is None:
            continue
        if update.restarted:
            vehicle, gimbals = _Rows(), {}
            sources.clear()
        elif update.shift_ns:
            for rows in (vehicle, *gimbals.values()):
                rows.shift(update.shift_ns)
            sources.shift(update.shift_ns)
        sources.commit()
        for track in update.ticks.tracks:
            stamps_ns = clock.to_utc(track, LAST)
            sources.append(track, stamps_ns)
            _take(track, stamps_ns, vehicle, gimbals)
    own, found = vehicle.series(), {source: rows.series() for source, rows in gimbals.items()}
    readings = {
        source: (settings.frame or evidence.frame, settings.axes or evidence.axes or MountAxes.ROLL_OUTER)
        for source, evidence in sources.evidence().items()
    }
    return AttitudeHistory(
        vehicle=own,
        gimbals={
            source: _on_mount(series, own, *readings.get(source, (None, MountAxes.TILT_OUTER)))
            for source, series in found.items()
            if series is not None
        },
        frames={source: frame for source, (frame, _) in readings.items() if frame is not None},
    )


def _on_mount(
    gimbal: AttitudeSeries, vehicle: AttitudeSeries | None, frame: ReportFrame | None, axes: MountAxes
) -> AttitudeSeries:
    """Servo angles against the vehicle as attitudes, by the vehicle's last sample before each report."""
    if frame is not ReportFrame.BODY or vehicle is None:
        return gimbal
    before = np.maximum(np.searchsorted(vehicle.stamp_ns, gimbal.stamp_ns, side="right"), 1) - 1
    wxyz = mounted_wxyz(gimbal.wxyz, axes, vehicle.wxyz[before], yaw_in_earth=gimbal.yaw_in_earth > 0)
    return replace(gimbal, wxyz=wxyz)


def _take(track: Track, stamps_ns: IntArray, vehicle: _Rows, gimbals: dict[GimbalSource, _Rows]) -> None:
    if isinstance(track, VehicleTrack):
        rows, in_earth = vehicle, np.ones(len(stamps_ns))
    elif isinstance(track, GimbalTrack):
        rows, in_earth = gimbals.setdefault(track.source, _Rows()), track.yaw_in_earth.astype(np.float64)
    else:
        return
    rows.stamps.append(stamps_ns)
    rows.wxyz.append(track.wxyz)
    rows.in_earth.append(in_earth)
