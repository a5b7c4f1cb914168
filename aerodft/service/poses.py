"""Telemetry tracks in, the camera's pose at an image's stamp out; interpolated, never the nearest sample."""

from collections.abc import Iterable
from functools import partial

import numpy as np

from aerodft.geometry.ground import Ground
from aerodft.model.arrays import IntArray
from aerodft.model.camera import Camera
from aerodft.model.health import Health, LinkTrack
from aerodft.model.height import HeightDifference, HeightSwitch
from aerodft.model.pose import GeoOrigin, GimbalSource, HeightSource, PoseSample
from aerodft.model.pose_columns import Posed, PoseRows, sample_of
from aerodft.model.status import Status
from aerodft.model.telemetry import CameraTrack, PositionTrack, Track
from aerodft.service.attitude import AttitudeSources, CameraAttitude, Refused
from aerodft.service.clock_ticks import Ticks, of_a_kind
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.health import HealthSources
from aerodft.service.height import Height, HeightSources
from aerodft.service.places import Place, Places
from aerodft.service.pose_ahead import PosesAhead, by_tick, each_once
from aerodft.service.pose_making import Parts, PoseMaker, missed
from aerodft.service.settings import TelemetrySettings
from aerodft.service.streams import END_OF_TIME, Missing, Stream
from aerodft.service.timing import ClockMap
from aerodft.service.zoom_sources import ZoomSources

# A sample, where its height and attitude are there.
_Found = tuple[PoseSample | None, Height | Missing, CameraAttitude | Missing | Refused, Place | Missing]


class PoseSource:
    """All telemetry of one vehicle.

    Args:
        settings: Sources, stds and limits.
        origin: The station's ENU origin; None takes the first fix.
        time_std_s: Standard deviation of image stamps against telemetry stamps.
        ground: What heights that are measured from the surface below are counted from; None for the level plane at 0.
        camera: What reports of a zoom are held against; None where nobody asks for one.
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
        self._places = Places(settings.height, origin)
        self._health = HealthSources(settings.health)
        self._tick = self._looked_at = -1
        self._ahead = PosesAhead(self._attitude, self._height, self._places, self._health, self._maker)
        self._newest_ns = 0
        self._zoom = None if camera is None else ZoomSources(settings.zoom, camera)

    @property
    def is_settled(self) -> bool:
        """Whether ticks may be taken in together."""
        return self.clock.is_settled and self._places.origin is not None

    def append(self, tracks: tuple[Track, ...]) -> int:
        """Take in the tracks of one tick.

        Returns:
            What must be added to UTC that was made of this machine's stamps before (ns).
        """
        self._settle()
        links = tuple(track for track in tracks if isinstance(track, LinkTrack))  # every frame: too many for the clock
        heard = self.clock.update(tuple(track for track in tracks if not isinstance(track, LinkTrack)))
        if heard.restarted:
            self._attitude.clear()
        elif heard.shift_ns:
            self._attitude.shift(heard.shift_ns)
        for stream in (self._places.stream, *self._height.streams(), *self._remarks()):
            if heard.restarted:
                stream.clear()
            elif heard.shift_ns:
                stream.shift(heard.shift_ns)
        for track in (*heard.tracks, *links):
            stamps = self.clock.to_utc(track)
            self._take(track, stamps, None)
            if self._zoom is not None:
                self._zoom.append(track, stamps)
        self._newest_ns = _newest_ns(self._streams())
        return heard.host_shift_ns

    def append_ticks(self, tracks: tuple[Track, ...], ticks_ns: IntArray) -> bool:
        """Take in the tracks of several ticks, to ``see`` one after the other as if each was taken in alone.

        Args:
            tracks: Of all ticks.
            ticks_ns: ``(n,)`` when they end.

        Returns:
            False, and nothing was taken in, where they must be taken one by one: something is new, or jumps.
        """
        self._settle()
        known = all(
            self._health.knows(track) and self._height.may_come_together(track) and not isinstance(track, CameraTrack)
            for track in tracks
        )
        if not self.is_settled or not known:
            return False
        is_link = [isinstance(track, LinkTrack) for track in tracks]
        links, ticks = (
            Ticks.of(tuple(t for t, link in zip(tracks, is_link, strict=True) if link is wanted), ticks_ns)
            for wanted in (True, False)
        )
        before = self.clock.copy()
        clocks = self.clock.update_ticks(ticks)
        if clocks is None:
            return False
        followed, lines = clocks
        all_tracks, edges = (*followed, *links.tracks), (*ticks.edges, *links.edges)
        stamps = [lines.to_utc(track, ticks.tick_of(ends)) for track, ends in zip(all_tracks, edges, strict=True)]
        if not self._health.goes_on(stamps, edges):
            self.clock = before
            return False
        for each in of_a_kind(all_tracks, stamps, edges):
            self._take(*each)
        self._newest_ns = _newest_ns(self._streams())
        return True

    def prepare(self, asked: IntArray) -> None:
        """Find what will be asked for when its telemetry is there; all at once is quicker.

        Args:
            asked: ``(n, 2)`` UTC, and from which of the ticks that were taken in together last it may be asked for.
        """
        needed = (self._places.stream, *self._attitude.streams())  # not every source of a height is waited for
        last, first = (
            by_tick(asked, [each.newest_by_tick() for each in streams]) for streams in (self._streams(), needed)
        )
        ticks, stamps_ns = each_once(np.concatenate([last, first]))  # many may be of one image
        if len(ticks):
            self._ahead.prepare(stamps_ns, ticks)
        if self.clock.is_plain and (self._zoom is None or not self._zoom.has_begun):
            self._ahead.complete(self.clock)

    def ready(self, ticks: IntArray, stamps_ns: IntArray) -> PoseRows | None:
        """As ``PosesAhead.rows``, of what was prepared last."""
        return self._ahead.rows(ticks, stamps_ns)

    def see(self, tick: int) -> None:
        """Look at what was known at one of the ticks that were taken in together last."""
        self._tick = tick
        self.clock.see(tick)

    def _look(self) -> None:
        """Turn to the tick that it is: only where something was not prepared."""
        if self._looked_at == self._tick:
            return
        self._looked_at = self._tick
        self._attitude.see(self._tick)
        streams = self._streams()
        for stream in (*streams, *self._remarks()):
            stream.see(self._tick)
        self._newest_ns = _newest_ns(streams)

    def _take(self, track: Track, stamps_ns: IntArray, edges: IntArray | None) -> None:
        self._attitude.append(track, stamps_ns, edges)
        self._height.append(track, stamps_ns, edges)
        self._health.append(track, stamps_ns, edges)
        if isinstance(track, PositionTrack) and len(stamps_ns):
            self._places.append(track, stamps_ns, edges)

    def _settle(self) -> None:
        """All ticks so far are over."""
        self.see(-1)
        self._look()
        self._ahead.clear()
        self.clock.settle()
        for stream in (*self._streams(), *self._remarks()):
            stream.settle()
        self._attitude.settle()

    def at(self, stamp_ns: int, *, final: bool, by_utc: bool = False) -> PoseSample | None:
        """The pose at a stamp.

        Args:
            stamp_ns: UTC.
            final: No more telemetry will be waited for.
            by_utc: Whether it is UTC by another clock than this machine's, which waits until the vehicle's is known.

        Returns:
            None as long as telemetry that matters may still come.
        """
        posed = self.posed_at(stamp_ns, final=final, by_utc=by_utc)
        return None if posed is None else sample_of(posed)

    def posed_at(self, stamp_ns: int, *, final: bool, by_utc: bool = False) -> Posed | None:
        """The same as it was made, with others or alone."""
        ready = None if final else self._ahead.ready((self._tick, stamp_ns))
        if ready is not None:
            return ready
        sample = self._by_telemetry(stamp_ns, final=final, by_utc=by_utc)
        if sample is None:
            return None
        verdict = self._ahead.verdict((self._tick, stamp_ns))
        if verdict is None:
            verdict = self._health.verdicts(np.array([stamp_ns]), np.array([self._tick])).of(0)
        judged = verdict.judged(sample)
        if self._zoom is None or not self._zoom.has_begun:
            return judged
        self._look()
        return self._zoom.seen(judged, self._watermark_ns(final=final))

    def health_at(self, stamp_ns: int) -> Health:
        """What the vehicle had said of itself by a stamp (UTC)."""
        self._look()
        return self._health.at(stamp_ns)

    def _by_telemetry(self, stamp_ns: int, *, final: bool, by_utc: bool) -> PoseSample | None:
        is_guess = by_utc and not self.clock.is_utc_known
        unsettled = self.clock.unsettled(by_utc=by_utc) or (self.clock.skipped(stamp_ns) if by_utc else None)
        if not final and (is_guess or unsettled is not None):
            return None
        if unsettled is not None:
            return PoseSample(stamp_ns=stamp_ns, status=Status.CLOCK_JUMPED, reasons=(unsettled,))
        found = self._parts(stamp_ns, final=final)
        if found is None:
            return None
        sample, height, attitude, place = found
        if isinstance(height, Missing) or isinstance(attitude, Missing | Refused) or sample is None:
            began = any(stream.began_by(stamp_ns) for stream in self._streams())
            return missed(stamp_ns, (height, attitude), self._settings, self.clock, began=began)
        return self._maker.completed(sample, height, place, self.clock, by_utc=by_utc)

    def _parts(self, stamp_ns: int, *, final: bool) -> _Found | None:
        """The parts of a pose, and the sample where both height and attitude are there; None: more may come."""
        prepared = None if final else self._ahead.sample((self._tick, stamp_ns))
        if prepared is not None:
            parts, sample = prepared
            return sample, parts.height, parts.attitude, parts.place or Missing.NEVER
        self._look()
        watermark = self._watermark_ns(final=final)
        attitude, place = self._attitude_at(stamp_ns, watermark), self._places.at(stamp_ns, watermark)
        lat_lon_rad = None if isinstance(place, Missing) else place.lat_lon_alt[:2]
        height = self._height.at(stamp_ns, watermark, partial(self._attitude.vehicle_at, watermark), lat_lon_rad)
        if Missing.PENDING in (height, attitude, place):
            return None
        if isinstance(height, Missing) or isinstance(attitude, Missing | Refused):
            return None, height, attitude, place
        own = Parts(stamp_ns, height, attitude, None if isinstance(place, Missing) else place)
        return self._maker.sample(own, self._places.origin), height, attitude, place

    def height_switch(self, before: HeightSource, after: HeightSource, stamp_ns: int) -> HeightSwitch:
        """That heights are of another source from a stamp on, and by how much the two differ."""
        self._look()
        return self._height.switch(before, after, stamp_ns, partial(self._attitude.vehicle_at, END_OF_TIME))

    def height_differences(self) -> list[HeightDifference]:
        """What the sources of the height said last, two by two."""
        self._look()
        return self._height.differences(self._watermark_ns(), partial(self._attitude.vehicle_at, END_OF_TIME))

    def _attitude_at(self, stamp_ns: int, watermark_ns: int) -> CameraAttitude | Missing | Refused:
        prepared = None if watermark_ns == END_OF_TIME else self._ahead.attitude((self._tick, stamp_ns))
        return prepared or self._attitude.at(stamp_ns, watermark_ns)

    def gimbal_frames(self) -> dict[GimbalSource, FrameEvidence]:
        """What the gimbals that reported are against, as far as it is known."""
        self._look()
        return self._attitude.evidence()

    def gimbal_demands(self) -> dict[GimbalSource, bool]:
        """Whether the gimbals that reported may say what they were told, not where they are."""
        self._look()
        return self._attitude.demands()

    def _watermark_ns(self, *, final: bool = False) -> int:
        """The newest stamp of any telemetry; where no more will be waited for, the last of all."""
        return END_OF_TIME if final else self._newest_ns

    def _remarks(self) -> tuple[Stream, ...]:
        """What no pose is made of, and is held against."""
        return (*self._height.remarks(), *self._health.streams(), *(() if self._zoom is None else self._zoom.streams()))

    def _streams(self) -> tuple[Stream, ...]:
        return (self._places.stream, *self._attitude.streams(), *self._height.streams())


def _newest_ns(streams: Iterable[Stream]) -> int:
    return max((stream.last_ns or 0 for stream in streams), default=0)
