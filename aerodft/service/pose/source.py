"""The pose source: telemetry tracks in, camera poses at image stamps out, interpolated between samples."""

from typing import Final

import numpy as np

from aerodft.geometry import Ground
from aerodft.model import (
    BoolArray,
    Camera,
    GeoOrigin,
    GimbalSource,
    Health,
    HeightDifference,
    HeightSource,
    HeightSwitch,
    IntArray,
    LevelSeries,
    LinkTrack,
    PoseBatch,
    PoseSample,
    Status,
)
from aerodft.service.attitude import AttitudeSources, FrameEvidence
from aerodft.service.clocks import ClockMap, Ticks, grouped_by_stream
from aerodft.service.health import HealthSources
from aerodft.service.pose.composition import PoseComposer, PoseInputs, missing_poses
from aerodft.service.pose.heights import HeightSources
from aerodft.service.pose.vehicle_position import VehiclePositions
from aerodft.service.pose.zoom import ZoomSources
from aerodft.service.settings import TelemetrySettings
from aerodft.service.streams import END_OF_TIME, LAST, Query, Stream, TelemetryPart

_PLACEHOLDER: Final = PoseSample(stamp_ns=0, status=Status.NO_TELEMETRY)  # of poses that are pending
_SKIPPED: Final = "the vehicle's UTC jumped ahead: it never said this time"


class PoseSource:
    """All telemetry of one vehicle, and the camera poses that follow from it.

    Telemetry is appended in steps of one or more ticks; queries are as of a tick of the newest step. Poses do not
    depend on how ticks are grouped into steps.

    Args:
        settings: Sources, stds and limits.
        origin: The station's ENU origin; None takes the first fix.
        time_std_s: Standard deviation of image stamps relative to telemetry stamps.
        ground: Ground below the camera, for heights above the surface; None for the level plane at 0.
        camera: Camera file that reported zooms are relative to; None without zoom.
        level: The water's level; None where it is always 0.

    Attributes:
        clock: Map of the vehicle's clock to UTC and to this machine's clock.
    """

    def __init__(
        self,
        settings: TelemetrySettings,
        *,
        origin: GeoOrigin | None,
        time_std_s: float,
        ground: Ground | None = None,
        camera: Camera | None = None,
        level: LevelSeries | None = None,
    ) -> None:
        self.clock = ClockMap()
        self._settings = settings
        self._ground = ground
        self._maker = PoseComposer(settings, time_std_s, ground, level)
        self._attitude = AttitudeSources(settings.attitude)
        self._height = HeightSources(settings.height, level)
        self._vehicle_position = VehiclePositions(settings.height, origin, settings.attitude.std.horizontal_m)
        self._health = HealthSources(settings.health)
        self._zoom = None if camera is None else ZoomSources(settings.zoom, camera)
        parts = self._attitude, self._height, self._health, self._vehicle_position, self._zoom
        self._parts: tuple[TelemetryPart, ...] = tuple(part for part in parts if part is not None)

    def append(self, ticks: Ticks) -> int | None:
        """Append the tracks of a step.

        Returns:
            Correction (ns) of UTC from earlier stamps on this machine's clock; None, without an effect, where several
            ticks must be appended one by one: a first report, or a jump of a clock. Never None for one tick.
        """
        for part in self._parts:
            part.commit()
        is_one = ticks.count == 1
        if not is_one and not all(part.may_append_ticks(track) for track in ticks.tracks for part in self._parts):
            return None
        is_link = [isinstance(track, LinkTrack) for track in ticks.tracks]  # one row per frame: too many for the clock
        links, others = ticks.where(is_link), ticks.where([not link for link in is_link])
        before = self.clock.copy()
        update = self.clock.update(others)
        if update is None:
            return None
        tracks, row_ends = (*update.ticks.tracks, *links.tracks), (*update.ticks.row_ends, *links.row_ends)
        stamps = [self.clock.to_utc(track, ticks.tick_of(ends)) for track, ends in zip(tracks, row_ends, strict=True)]
        if not is_one and tracks and not self._health.has_no_silence(stamps, row_ends):
            self.clock = before
            return None
        for part in self._parts:
            if update.restarted:
                part.clear()
            elif update.shift_ns:
                part.shift(update.shift_ns)
        for rows in grouped_by_stream(tracks, stamps, row_ends):
            for part in self._parts:
                part.append(*rows)
        self._height.check(self._attitude.vehicle_before)
        return update.host_shift_ns

    def at(
        self, stamps_ns: IntArray, ticks: IntArray, *, is_final: BoolArray, by_utc: BoolArray
    ) -> tuple[PoseBatch, BoolArray]:
        """Poses at stamps.

        Args:
            stamps_ns: ``(n,)`` UTC.
            ticks: ``(n,)`` as in ``Stream.find``.
            is_final: ``(n,)`` whether not to wait for more telemetry.
            by_utc: ``(n,)`` whether each is UTC, not on this machine's clock; such a stamp waits for the vehicle's UTC.

        Returns:
            The poses, and where telemetry is pending: these poses are placeholders.
        """
        is_unsettled = (self.clock.off_ns(ticks, by_utc) != 0) | (self.clock.skips(stamps_ns) & by_utc)
        is_pending = ~is_final & (is_unsettled | (by_utc & (not self.clock.is_utc_known)))
        refused_rows = np.flatnonzero(is_unsettled & is_final)
        matched = np.flatnonzero(~is_unsettled & ~is_pending)
        if not len(matched) and not len(refused_rows):
            return PoseBatch.repeated(_PLACEHOLDER, stamps_ns), is_pending
        query = Query(stamps_ns, ticks, np.where(is_final, END_OF_TIME, self._newest_ns(ticks)))
        inputs = self._inputs(query.rows(matched), by_utc[matched])
        is_pending[matched] = inputs.is_pending
        whole = np.flatnonzero(inputs.is_complete & ~inputs.is_pending)
        lost = np.flatnonzero(~inputs.is_complete & ~inputs.is_pending)
        rows = np.concatenate([matched[whole], matched[lost], refused_rows])
        if not len(rows):
            return PoseBatch.repeated(_PLACEHOLDER, stamps_ns), is_pending
        why = missing_poses(inputs.rows(lost), self._settings, self.clock, self._has_begun_by(stamps_ns[matched[lost]]))
        why += map(self._refused, *(column[refused_rows].tolist() for column in (stamps_ns, ticks, by_utc)))
        parts = [self._maker.poses(inputs.rows(whole), self._vehicle_position.origin, self.clock)] if len(whole) else []
        poses = PoseBatch.concatenate([*parts, PoseBatch.from_samples(why)] if why else parts)
        poses = self._health.with_verdicts(poses, ticks[rows])
        if self._zoom is not None:
            poses, awaits_zoom = self._zoom.with_zoom(poses, query.rows(rows))
            is_pending[rows[awaits_zoom]] = True
        row_of = np.zeros(len(stamps_ns), dtype=np.int64)
        row_of[rows] = np.arange(len(rows))
        return poses.rows(row_of), is_pending

    def watermark_ns(self, count: int) -> IntArray:
        """Newest stamps ``(count,)`` of any telemetry at each of ``count`` ticks of the newest step."""
        return self._newest_ns(np.arange(count))

    def health_at(self, stamp_ns: int) -> Health:
        """Health of the vehicle as reported by a stamp (UTC)."""
        return self._health.at(stamp_ns)

    def height_switch(self, before: HeightSource, after: HeightSource, stamp_ns: int, tick: int) -> HeightSwitch:
        """Change of the height source at a stamp, with the step between the sources as of a tick."""
        return self._height.switch(before, after, stamp_ns, np.array([tick]), self._attitude.vehicle_at)

    def height_differences(self) -> list[HeightDifference]:
        """Latest differences between all pairs of height sources."""
        return self._height.latest_differences(int(self._newest_ns(LAST)[0]), self._attitude.vehicle_at)

    def gimbal_frames(self) -> dict[GimbalSource, FrameEvidence]:
        """Evidence on the frames of the gimbals that have reported."""
        return self._attitude.evidence()

    def gimbal_demands(self) -> dict[GimbalSource, bool]:
        """Whether the gimbals that have reported may report demands, not measurements."""
        return self._attitude.demands()

    def _inputs(self, query: Query, by_utc: BoolArray) -> PoseInputs:
        """Heights, attitudes and positions ``(n,)``."""
        vehicle_position, attitudes = self._vehicle_position.at(query), self._attitude.at(query)
        ground_m = None if self._ground is None else self._ground.height_at(vehicle_position.east_north_m)
        places = vehicle_position.lat_lon_alt[:, :2]
        heights = self._height.at(query, self._attitude.vehicle_at, places, ground_m)
        return PoseInputs(query.stamps_ns, by_utc, heights, attitudes, vehicle_position)

    def _refused(self, stamp_ns: int, tick: int, by_utc: bool) -> PoseSample:  # noqa: FBT001 - a value of a column
        """The refused pose at a stamp that cannot be matched as of a tick."""
        reason = self.clock.unsettled(by_utc=by_utc, tick=tick) or _SKIPPED
        return PoseSample(stamp_ns=stamp_ns, status=Status.CLOCK_JUMPED, reasons=(reason,))

    def _has_begun_by(self, stamps_ns: IntArray) -> BoolArray:
        """Whether there was any telemetry at or before stamps ``(n,)``."""
        return np.asarray(np.any([stream.began_by(stamps_ns) for stream in self._streams()], axis=0))

    def _streams(self) -> tuple[Stream, ...]:
        """Streams that poses are computed from."""
        return tuple(stream for part in self._parts for stream in part.pose_streams())

    def _newest_ns(self, ticks: IntArray) -> IntArray:
        """Newest stamps of any telemetry as of ticks ``(n,)``."""
        return np.asarray(np.max([stream.newest_ns(ticks) for stream in self._streams()], axis=0))
