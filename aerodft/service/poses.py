"""Telemetry tracks in, the camera's pose at an image's stamp out; interpolated, never the nearest sample."""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.ground import Ground, Plane
from aerodft.geometry.poses import pose_covariance
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.health import Health, LinkTrack
from aerodft.model.height import HeightDifference, HeightSwitch
from aerodft.model.pose import GeoOrigin, GimbalSource, HeightSource, Pose, PoseSample
from aerodft.model.status import Status
from aerodft.model.telemetry import PositionTrack, Track
from aerodft.service.attitude import AttitudeSources, CameraAttitude, Refused
from aerodft.service.footing import footing
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.health import HealthSources
from aerodft.service.height import Height, HeightSources
from aerodft.service.places import Place, Places
from aerodft.service.settings import DEMAND_TILT_STD_RAD, HeightSettings, TelemetrySettings
from aerodft.service.streams import END_OF_TIME, Missing, Stream
from aerodft.service.timing import HOST_STD_S, ClockMap
from aerodft.service.zoom import ZoomSources


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
        self._time_std_s = time_std_s
        self._ground = ground
        self._attitude = AttitudeSources(settings.attitude)
        self._height = HeightSources(settings.height)
        self._places = Places(settings.height, origin)
        self._health = HealthSources(settings.health)
        self._zoom = None if camera is None else ZoomSources(settings.zoom, camera)

    def append(self, tracks: tuple[Track, ...]) -> int:
        """Take in the tracks of one tick.

        Returns:
            What must be added to UTC that was made of this machine's stamps before (ns).
        """
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
            self._attitude.append(track, stamps)
            self._height.append(track, stamps)
            self._health.append(track, stamps)
            if self._zoom is not None:
                self._zoom.append(track, stamps)
            if isinstance(track, PositionTrack) and len(stamps):
                self._places.append(track, stamps)
        return heard.host_shift_ns

    def at(self, stamp_ns: int, *, final: bool, by_utc: bool = False) -> PoseSample | None:
        """The pose at a stamp.

        Args:
            stamp_ns: UTC.
            final: No more telemetry will be waited for.
            by_utc: Whether it is UTC by another clock than this machine's, which waits until the vehicle's is known.

        Returns:
            None as long as telemetry that matters may still come.
        """
        sample = self._by_telemetry(stamp_ns, final=final, by_utc=by_utc)
        if sample is None:
            return None
        judged = self._health.judged(sample)
        return judged if self._zoom is None else self._zoom.seen(judged, self._watermark_ns(), final=final)

    def health_at(self, stamp_ns: int) -> Health:
        """What the vehicle had said of itself by a stamp (UTC)."""
        return self._health.at(stamp_ns)

    def _by_telemetry(self, stamp_ns: int, *, final: bool, by_utc: bool) -> PoseSample | None:
        is_guess, unsettled = by_utc and not self.clock.is_utc_known, self.clock.unsettled() if by_utc else None
        if not final and (is_guess or unsettled is not None):
            return None
        if unsettled is not None:
            return PoseSample(stamp_ns=stamp_ns, status=Status.CLOCK_JUMPED, reasons=(unsettled,))
        watermark = END_OF_TIME if final else self._watermark_ns()
        attitude, place = self._attitude.at(stamp_ns, watermark), self._places.at(stamp_ns, watermark)
        lat_lon_rad = None if isinstance(place, Missing) else place.lat_lon_alt[:2]
        height = self._height.at(stamp_ns, watermark, partial(self._vehicle_at, watermark), lat_lon_rad)
        if Missing.PENDING in (height, attitude, place):
            return None
        if isinstance(height, Missing) or isinstance(attitude, Missing | Refused):
            return self._miss(stamp_ns, height, attitude)
        sample = self._sample(stamp_ns, height, attitude, None if isinstance(place, Missing) else place)
        if is_guess:
            sample = _by_guess(sample)
        if self._ground is not None:
            sample = self._over_ground(sample, self._ground, height, place)
        minimum = self._settings.height.min_m
        if height.height_agl_m < minimum and sample.status is Status.OK:
            reason = f"{height.source} says {height.height_agl_m:.2f} m, the minimum is {minimum:g} m"
            return replace(sample, status=Status.BELOW_MIN_HEIGHT, reasons=(reason,))
        return sample

    def height_switch(self, before: HeightSource, after: HeightSource, stamp_ns: int) -> HeightSwitch:
        """That heights are of another source from a stamp on, and by how much the two differ."""
        return self._height.switch(before, after, stamp_ns, partial(self._vehicle_at, END_OF_TIME))

    def height_differences(self) -> list[HeightDifference]:
        """What the sources of the height said last, two by two."""
        return self._height.differences(self._watermark_ns(), partial(self._vehicle_at, END_OF_TIME))

    def _vehicle_at(self, watermark_ns: int, stamp_ns: int) -> FloatArray | Missing:
        return self._attitude.vehicle_at(stamp_ns, watermark_ns)

    def gimbal_frames(self) -> dict[GimbalSource, FrameEvidence]:
        """What the gimbals that reported are against, as far as it is known."""
        return self._attitude.evidence()

    def _watermark_ns(self) -> int:
        """The newest stamp of any telemetry."""
        return max((stream.last_ns or 0 for stream in self._streams()), default=0)

    def _remarks(self) -> tuple[Stream, ...]:
        """What no pose is made of, and is held against."""
        return (*self._height.remarks(), *self._health.streams(), *(() if self._zoom is None else self._zoom.streams()))

    def _streams(self) -> tuple[Stream, ...]:
        return (self._places.stream, *self._attitude.streams(), *self._height.streams())

    def _sample(self, stamp_ns: int, height: Height, attitude: CameraAttitude, place: Place | None) -> PoseSample:
        stated, report = self._settings.attitude.std, attitude.report_std_rad
        tilt_rad = max(stated.tilt_rad, DEMAND_TILT_STD_RAD) if attitude.is_demand else stated.tilt_rad
        std = replace(
            stated,
            height_agl_m=height.std_m,
            tilt_rad=math.hypot(tilt_rad, report[0]),
            pan_rad=math.hypot(stated.pan_rad, report[1]),
            roll_rad=math.hypot(stated.roll_rad, report[2]),
            time_s=self._time_std_s,
        )
        east, north = (0.0, 0.0) if place is None else place.east_north_m.tolist()
        lat, lon, alt = (None, None, None) if place is None else place.lat_lon_alt
        pose = Pose(
            position_enu_m=np.array([east, north, height.height_agl_m]),
            wxyz=attitude.wxyz,
            cov=pose_covariance(attitude.wxyz, std),
            velocity_enu_mps=np.zeros(3) if place is None else place.velocity_enu_mps,
            rate_cam_radps=attitude.rate_cam_radps,
            time_std_s=self._time_std_s,
        )
        return PoseSample(
            stamp_ns=stamp_ns,
            status=Status.OK,
            reasons=(*attitude.reasons, *height.reasons, *self.clock.remarks()),
            pose=pose,
            std=std,
            origin=None if place is None else self._places.origin,
            lat_rad=lat,
            lon_rad=lon,
            alt_msl_m=alt,
            height_source=height.source,
            height_datum=height.datum,
            attitude_source=attitude.source,
            height_age_s=height.age_s,
            telemetry_age_s=max(height.age_s, attitude.age_s),
        )

    def _over_ground(self, sample: PoseSample, ground: Ground, height: Height, place: Place | Missing) -> PoseSample:
        """The sample in ENU, where its height may be counted from the surface below; or why it has no place there."""
        from_zero, pose = height.source is HeightSource.HOME, sample.pose
        if pose is None:
            return sample
        if isinstance(place, Missing) and (from_zero or not isinstance(ground, Plane)):  # a slope is alike everywhere
            return _unplaced(sample, place, self._settings.height.max_gap_ns)
        foot = pose.position_enu_m[:2] + height.foot_m
        below = footing(ground, foot)
        if below.status is Status.BEYOND_TERRAIN or not (from_zero or below.status is Status.OK):
            east, north = foot.tolist()
            reason = f"below the camera, {east:.0f} m east and {north:.0f} m north of the origin, is {below.what}"
            return replace(sample, status=below.status, reasons=(reason,), pose=None)
        return sample if from_zero else replace(sample, pose=below.carrying(pose), datum_enu_m=below.height_m)

    def _miss(
        self, stamp_ns: int, height: Height | Missing, attitude: CameraAttitude | Missing | Refused
    ) -> PoseSample:
        reasons = []
        if isinstance(height, Missing):
            reasons.append(_no_height(height, self._settings.height))
        if isinstance(attitude, Missing):
            limits = self._settings.attitude
            reasons.append(_sentence("camera attitude", attitude, limits.order, limits.max_gap_ns))
        if isinstance(attitude, Refused):
            reasons.append(attitude.reason)
        broken_off = self.clock.broken_off()
        if broken_off is not None:
            return PoseSample(stamp_ns=stamp_ns, status=Status.CLOCK_JUMPED, reasons=(broken_off, *reasons))
        if not any(stream.began_by(stamp_ns) for stream in self._streams()):
            status = Status.NO_TELEMETRY
        elif Missing.STALE in (height, attitude):
            status = Status.STALE_TELEMETRY
        else:
            status = Status.NO_HEIGHT if height is Missing.NEVER else Status.NO_ATTITUDE
        return PoseSample(stamp_ns=stamp_ns, status=status, reasons=tuple(reasons))


def _by_guess(sample: PoseSample) -> PoseSample:
    """A sample whose stamp is held against a clock that nobody vouches for."""
    reason = "the vehicle has not said what UTC is: the receiving machine's clock is taken for it"
    time_s = math.hypot(sample.std.time_s, HOST_STD_S)
    pose = None if sample.pose is None else replace(sample.pose, time_std_s=time_s)
    std = replace(sample.std, time_s=time_s)
    return replace(sample, pose=pose, std=std, reasons=(*sample.reasons, reason))


def _unplaced(sample: PoseSample, missing: Missing, max_gap_ns: int) -> PoseSample:
    """What a sample becomes over ground of which nobody knows which part is below."""
    status, when = Status.NO_HEIGHT, "received yet"
    if missing is Missing.STALE:
        status, when = Status.STALE_TELEMETRY, f"on both sides of the stamp within {max_gap_ns / SECOND_NS:g} s"
    return replace(sample, pose=None, status=status, reasons=(f"no position {when}, and the ground is uneven",))


def _no_height(missing: Missing, settings: HeightSettings) -> str:
    if missing is Missing.NEVER:
        return _sentence("height", missing, settings.order, settings.max_gap_ns)
    within = ", ".join(f"{settings.gap_ns(source) / SECOND_NS:g} s from {source}" for source in settings.order)
    return f"no height on both sides of the stamp within {within}"


def _sentence(what: str, missing: Missing, order: tuple[str, ...], max_gap_ns: int) -> str:
    sources = ", ".join(order)
    if missing is Missing.NEVER:
        return f"no {what} received yet from {sources}"
    return f"no {what} on both sides of the stamp within {max_gap_ns / SECOND_NS:g} s from {sources}"
