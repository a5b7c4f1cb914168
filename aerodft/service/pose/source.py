"""Telemetry tracks in, the camera's poses at images' stamps out; interpolated, never the nearest sample."""

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
    LinkTrack,
    PoseBatch,
    PoseSample,
    PositionTrack,
    Status,
    Track,
)
from aerodft.service.attitude import AttitudeSources, FrameEvidence
from aerodft.service.clocks import ClockMap, Ticks, grouped_by_stream
from aerodft.service.health import HealthSources
from aerodft.service.pose.composition import PoseInputs, PoseMaker, missing_poses
from aerodft.service.pose.heights import HeightSources
from aerodft.service.pose.vehicle_position import VehiclePositions
from aerodft.service.pose.zoom import ZoomSources
from aerodft.service.settings import TelemetrySettings
from aerodft.service.streams import END_OF_TIME, LAST, Stream

_NOWHERE: Final = PoseSample(stamp_ns=0, status=Status.NO_TELEMETRY)  # means nothing
_SKIPPED: Final = "the vehicle's UTC jumped ahead: it never said this time"


class PoseSource:
    """All telemetry of one vehicle.

    Telemetry is appended step by step, of one tick or of several; questions name the tick of the newest step as of
    which they are answered, so that an answer does not depend on how ticks were put into steps.

    Args:
        settings: Sources, stds and limits.
        origin: The station's ENU origin; None takes the first fix.
        time_std_s: Standard deviation of image stamps against telemetry stamps.
        ground: What heights that are measured from the surface below are counted from; None for the level plane at 0.
        camera: What reports of a zoom are held against; None where nobody asks for one.

    Attributes:
        clock: The vehicle's clock against UTC and this machine's.
    """

    def __init__(
        self,
        settings: TelemetrySettings,
        *,
        origin: GeoOrigin | None,
        time_std_s: float,
        ground: Ground | None = None,
        camera: Camera | None = None,
    ) -> None:
        self.clock = ClockMap()
        self._settings = settings
        self._maker = PoseMaker(settings, time_std_s, ground)
        self._attitude = AttitudeSources(settings.attitude)
        self._height = HeightSources(settings.height)
        self._vehicle_position = VehiclePositions(settings.height, origin)
        self._health = HealthSources(settings.health)
        self._zoom = None if camera is None else ZoomSources(settings.zoom, camera)

    def append(self, ticks: Ticks) -> int | None:
        """Take in the tracks of a step.

        Returns:
            What must be added to UTC that was made of this machine's stamps before (ns); None, and nothing was taken
            in, where several ticks must be taken one by one: something is new, or a clock jumps. One tick always is
            taken in.
        """
        self._commit()
        is_one = ticks.count == 1
        if not is_one and not (self._has_origin(ticks) and all(map(self._may_append_ticks, ticks.tracks))):
            return None
        is_link = [isinstance(track, LinkTrack) for track in ticks.tracks]  # every frame: too many for the clock
        links, others = ticks.where(is_link), ticks.where([not link for link in is_link])
        before = self.clock.copy()
        update = self.clock.update(others)
        if update is None:
            return None
        tracks, row_ends = (*update.ticks.tracks, *links.tracks), (*update.ticks.row_ends, *links.row_ends)
        stamps = [self.clock.to_utc(track, ticks.tick_of(own)) for track, own in zip(tracks, row_ends, strict=True)]
        if not is_one and tracks and not self._health.goes_on(stamps, row_ends):
            self.clock = before
            return None
        if update.restarted:
            self._clear()
        elif update.shift_ns:
            self._shift(update.shift_ns)
        for each in grouped_by_stream(tracks, stamps, row_ends):
            self._append_track(*each)
        return update.host_shift_ns

    def at(
        self, stamps_ns: IntArray, ticks: IntArray, *, final: BoolArray, by_utc: BoolArray
    ) -> tuple[PoseBatch, BoolArray]:
        """Poses at stamps.

        Args:
            stamps_ns: ``(n,)`` UTC.
            ticks: ``(n,)`` as of which tick of the newest step each is asked.
            final: ``(n,)`` whether no more telemetry will be waited for.
            by_utc: ``(n,)`` whether each is UTC by another clock than this machine's, which waits until the vehicle's
                is known.

        Returns:
            The poses, and where telemetry that matters may still come: these poses mean nothing.
        """
        jumped = (self.clock.off_ns(ticks, by_utc) != 0) | (self.clock.skips(stamps_ns) & by_utc)
        is_pending = ~final & (jumped | (by_utc & (not self.clock.is_utc_known)))
        refused = np.flatnonzero(jumped & final)
        matched = np.flatnonzero(~jumped & ~is_pending)
        if not len(matched) and not len(refused):
            return PoseBatch.repeated(_NOWHERE, stamps_ns), is_pending
        watermark_ns = np.where(final, END_OF_TIME, self._newest_ns(ticks))
        inputs = self._inputs(stamps_ns[matched], ticks[matched], watermark_ns[matched], by_utc[matched])
        is_pending[matched] = inputs.is_pending
        whole = np.flatnonzero(inputs.is_whole & ~inputs.is_pending)
        lost = np.flatnonzero(~inputs.is_whole & ~inputs.is_pending)
        rows = np.concatenate([matched[whole], matched[lost], refused])
        if not len(rows):
            return PoseBatch.repeated(_NOWHERE, stamps_ns), is_pending
        why = missing_poses(inputs.rows(lost), self._settings, self.clock, self._has_begun_by(stamps_ns[matched[lost]]))
        why += map(self._refused, *(column[refused].tolist() for column in (stamps_ns, ticks, by_utc)))
        parts = [self._maker.poses(inputs.rows(whole), self._vehicle_position.origin, self.clock)] if len(whole) else []
        poses = PoseBatch.joined([*parts, PoseBatch.of(why)] if why else parts)
        poses = self._health.judged(poses, ticks[rows])
        if self._zoom is not None:
            poses, awaits_zoom = self._zoom.applied(poses, ticks[rows], watermark_ns[rows])
            is_pending[rows[awaits_zoom]] = True
        row_of = np.zeros(len(stamps_ns), dtype=np.int64)
        row_of[rows] = np.arange(len(rows))
        return poses.rows(row_of), is_pending

    def watermark_ns(self, count: int) -> IntArray:
        """``(count,)`` newest stamp of any telemetry at each tick of the newest step of so many ticks."""
        return self._newest_ns(np.arange(count))

    def health_at(self, stamp_ns: int) -> Health:
        """What the vehicle had said of itself by a stamp (UTC)."""
        return self._health.at(stamp_ns)

    def height_switch(self, before: HeightSource, after: HeightSource, stamp_ns: int, tick: int) -> HeightSwitch:
        """That heights are of another source from a stamp on, and by how much the two differ, as of a tick."""
        return self._height.switch(before, after, stamp_ns, np.array([tick]), self._attitude.vehicle_at)

    def height_differences(self) -> list[HeightDifference]:
        """What the sources of the height said last, two by two."""
        return self._height.latest_differences(int(self._newest_ns(LAST)[0]), self._attitude.vehicle_at)

    def gimbal_frames(self) -> dict[GimbalSource, FrameEvidence]:
        """What the gimbals that reported are against, as far as it is known."""
        return self._attitude.evidence()

    def gimbal_demands(self) -> dict[GimbalSource, bool]:
        """Whether the gimbals that reported may say what they were told, not where they are."""
        return self._attitude.demands()

    def _inputs(self, stamps_ns: IntArray, ticks: IntArray, watermark_ns: IntArray, by_utc: BoolArray) -> PoseInputs:
        """What poses at stamps ``(n,)`` are made of."""
        query = stamps_ns, ticks, watermark_ns
        vehicle_position, attitudes = self._vehicle_position.at(*query), self._attitude.at(*query)
        heights = self._height.at(*query, self._attitude.vehicle_at, vehicle_position.lat_lon_alt[:, :2])
        return PoseInputs(stamps_ns, by_utc, heights, attitudes, vehicle_position)

    def _refused(self, stamp_ns: int, tick: int, by_utc: bool) -> PoseSample:  # noqa: FBT001 - a value of a column
        """Why there is no pose at a stamp as of a tick at which it cannot be matched."""
        reason = self.clock.unsettled(by_utc=by_utc, tick=tick) or _SKIPPED
        return PoseSample(stamp_ns=stamp_ns, status=Status.CLOCK_JUMPED, reasons=(reason,))

    def _has_begun_by(self, stamps_ns: IntArray) -> BoolArray:
        """Whether there was any telemetry by stamps ``(n,)``."""
        return np.asarray(np.any([stream.began_by(stamps_ns) for stream in self._streams()], axis=0))

    def _has_origin(self, ticks: Ticks) -> bool:
        has_position = any(isinstance(track, PositionTrack) for track in ticks.tracks)
        return self._vehicle_position.origin is not None or not has_position

    def _may_append_ticks(self, track: Track) -> bool:
        """Whether a track of several ticks may be appended at once."""
        parts = (self._health, self._height, *(() if self._zoom is None else (self._zoom,)))
        return all(part.may_append_ticks(track) for part in parts)

    def _append_track(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray) -> None:
        self._attitude.append(track, stamps_ns, row_end_by_tick)
        self._height.append(track, stamps_ns, row_end_by_tick)
        self._health.append(track, stamps_ns, row_end_by_tick)
        if isinstance(track, PositionTrack) and len(stamps_ns):
            self._vehicle_position.append(track, stamps_ns, row_end_by_tick)
        if self._zoom is not None:
            self._zoom.append(track, stamps_ns, row_end_by_tick)

    def _commit(self) -> None:
        """The ticks so far are over."""
        self._attitude.commit()
        for stream in (self._vehicle_position.stream, *self._height.streams(), *self._remarks()):
            stream.commit()

    def _clear(self) -> None:
        """Forget all samples: their stamps are of another boot."""
        self._attitude.clear()
        for stream in (self._vehicle_position.stream, *self._height.streams(), *self._remarks()):
            stream.clear()

    def _shift(self, by_ns: int) -> None:
        """Move all samples: what time it was when they were taken is known better now."""
        self._attitude.shift(by_ns)
        for stream in (self._vehicle_position.stream, *self._height.streams(), *self._remarks()):
            stream.shift(by_ns)

    def _remarks(self) -> tuple[Stream, ...]:
        """What no pose is made of, and is held against."""
        return (*self._height.remarks(), *self._health.streams(), *(() if self._zoom is None else self._zoom.streams()))

    def _streams(self) -> tuple[Stream, ...]:
        return (self._vehicle_position.stream, *self._attitude.streams(), *self._height.streams())

    def _newest_ns(self, ticks: IntArray) -> IntArray:
        """Newest stamp of any telemetry as of ticks ``(n,)``."""
        return np.asarray(np.max([stream.newest_ns(ticks) for stream in self._streams()], axis=0))
