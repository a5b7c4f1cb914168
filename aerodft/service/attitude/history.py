"""All attitudes of a log in UTC, for aligning a video with it."""

from dataclasses import dataclass, field, replace

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, GimbalSource, GimbalTrack, IntArray, MountAxes, ReportFrame, Track, VehicleTrack
from aerodft.service.attitude.mounts import GIMBAL_MOUNTS
from aerodft.service.attitude.sources import AttitudeSources
from aerodft.service.clocks import ClockMap, Ticks
from aerodft.service.feed import MergedFeed
from aerodft.service.ports import Source, TelemetryDecoder
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import LAST


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeSeries:
    """A stream of attitudes.

    Attributes:
        stamp_ns: ``(n,)`` UTC, strictly ascending.
        wxyz: ``(n, 4)`` ``ned_SO3_body`` of a vehicle, ``ref_SO3_gimbal`` of a gimbal.
        yaw_in_earth: ``(n,)`` as in ``GimbalTrack``; always true for a vehicle.
    """

    stamp_ns: IntArray
    wxyz: FloatArray
    yaw_in_earth: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeHistory:
    """Attitudes of one vehicle and its gimbals; streams without samples are left out.

    Attributes:
        vehicle: The vehicle's.
        gimbals: The gimbals', from their reports.
        frames: Reference of each gimbal's roll and pitch, where configured or decided.
    """

    vehicle: AttitudeSeries | None
    gimbals: dict[GimbalSource, AttitudeSeries]
    frames: dict[GimbalSource, ReportFrame]

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """First and last stamp of all streams; None without attitudes."""
        series = [*self.gimbals.values(), *([] if self.vehicle is None else [self.vehicle])]
        if not series:
            return None
        return min(int(each.stamp_ns[0]) for each in series), max(int(each.stamp_ns[-1]) for each in series)


@dataclass(slots=True)
class _Parts:
    stamps: list[IntArray] = field(default_factory=list)
    wxyz: list[FloatArray] = field(default_factory=list)
    in_earth: list[FloatArray] = field(default_factory=list)

    def shift(self, by_ns: int) -> None:
        """Shift all stamps: the clock map has changed."""
        self.stamps = [stamps + by_ns for stamps in self.stamps]

    def series(self) -> AttitudeSeries | None:
        """The attitudes by ascending stamp, the first of several with one stamp; None without attitudes."""
        if not self.stamps:
            return None
        stamps, order = np.unique(np.concatenate(self.stamps), return_index=True)
        wxyz, in_earth = np.concatenate(self.wxyz)[order], np.concatenate(self.in_earth)[order]
        return AttitudeSeries(stamp_ns=stamps, wxyz=wxyz, yaw_in_earth=in_earth)


def attitude_histories(log: Source, decoder: TelemetryDecoder, settings: AttitudeSettings) -> list[AttitudeHistory]:
    """Read a log once; stamps are by the clock map, as in a run.

    Args:
        log: The log.
        decoder: Decoder of its frames.
        settings: Gimbals to use, and the reference of their reports where configured.

    Returns:
        The attitudes between reboots of the vehicle, in order; each stretch has a clock and a reading of its gimbals of
        its own. At least one, which is empty where the log has no attitudes.
    """
    clock, sources = ClockMap(), AttitudeSources(settings)
    vehicle, gimbals = _Parts(), dict[GimbalSource, _Parts]()
    histories = []
    for batch in MergedFeed([log], SECOND_NS, idle_ticks_ns=0, longest_ns=0).batches():
        tracks = tuple(track for block in batch.raw for track in decoder.decode(block) if len(track.arrival_ns))
        update = clock.update(Ticks.one(tracks))
        if update is None:
            continue
        if update.restarted:
            histories.append(_history(vehicle, gimbals, sources, settings))
            vehicle, gimbals = _Parts(), {}
            sources.clear()
        elif update.shift_ns:
            for rows in (vehicle, *gimbals.values()):
                rows.shift(update.shift_ns)
            sources.shift(update.shift_ns)
        sources.commit()
        for track in update.ticks.tracks:
            stamps_ns = clock.to_utc(track, LAST)
            sources.append(track, stamps_ns)
            _append_track(track, stamps_ns, vehicle, gimbals)
    histories.append(_history(vehicle, gimbals, sources, settings))
    return [each for each in histories if each.span_ns is not None] or histories[-1:]


def _history(
    vehicle: _Parts, gimbals: dict[GimbalSource, _Parts], sources: AttitudeSources, settings: AttitudeSettings
) -> AttitudeHistory:
    """The attitudes of one stretch between reboots, its gimbals read as their reports show."""
    vehicle_series, gimbal_series = vehicle.series(), {source: rows.series() for source, rows in gimbals.items()}
    readings = {
        source: (settings.frame or evidence.frame, settings.axes or evidence.axes or MountAxes.ROLL_OUTER)
        for source, evidence in sources.evidence().items()
    }
    return AttitudeHistory(
        vehicle=vehicle_series,
        gimbals={
            source: _to_attitudes(series, vehicle_series, *readings.get(source, (None, MountAxes.TILT_OUTER)))
            for source, series in gimbal_series.items()
            if series is not None
        },
        frames={source: frame for source, (frame, _) in readings.items() if frame is not None},
    )


def _to_attitudes(
    gimbal: AttitudeSeries, vehicle: AttitudeSeries | None, frame: ReportFrame | None, axes: MountAxes
) -> AttitudeSeries:
    """Attitudes from servo angles on the vehicle, by the vehicle's last sample before each report."""
    if frame is not ReportFrame.BODY or vehicle is None:
        return gimbal
    before = np.maximum(np.searchsorted(vehicle.stamp_ns, gimbal.stamp_ns, side="right"), 1) - 1
    wxyz = GIMBAL_MOUNTS[axes].camera_wxyz(gimbal.wxyz, vehicle.wxyz[before], yaw_in_earth=gimbal.yaw_in_earth > 0)
    return replace(gimbal, wxyz=wxyz)


def _append_track(track: Track, stamps_ns: IntArray, vehicle: _Parts, gimbals: dict[GimbalSource, _Parts]) -> None:
    if isinstance(track, VehicleTrack):
        rows, in_earth = vehicle, np.ones(len(stamps_ns))
    elif isinstance(track, GimbalTrack):
        rows, in_earth = gimbals.setdefault(track.source, _Parts()), track.yaw_in_earth.astype(np.float64)
    else:
        return
    rows.stamps.append(stamps_ns)
    rows.wxyz.append(track.wxyz)
    rows.in_earth.append(in_earth)
