"""Telemetry tracks in, the camera's pose at an image's stamp out; interpolated, never the nearest sample."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.geodesy import east_north
from aerodft.geometry.ground import Ground, Plane
from aerodft.geometry.poses import pose_covariance
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import GeoOrigin, GimbalSource, HeightSource, Pose, PoseSample
from aerodft.model.status import Status
from aerodft.model.telemetry import PositionTrack, Track
from aerodft.service.attitude import AttitudeSources, CameraAttitude, Refused
from aerodft.service.footing import footing
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.height import Height, HeightSources
from aerodft.service.settings import TelemetrySettings
from aerodft.service.streams import END_OF_TIME, Missing, Stream
from aerodft.service.timing import ClockChange, ClockMap

_DEMAND_TILT_STD_RAD: Final = math.radians(1)
"""A gimbal that only says what it was told is known no better."""


@dataclass(frozen=True, slots=True)
class _Place:
    east_north_m: FloatArray
    velocity_enu_mps: FloatArray
    lat_lon_alt: tuple[float, float, float]


class PoseSource:
    """All telemetry of one vehicle.

    Args:
        settings: Sources, stds and limits.
        origin: The station's ENU origin; None takes the first fix.
        time_std_s: Standard deviation of image stamps against telemetry stamps.
        ground: What heights that are measured from the surface below are counted from; None for the level plane at 0.
    """

    def __init__(
        self,
        settings: TelemetrySettings,
        *,
        origin: GeoOrigin | None,
        time_std_s: float,
        ground: Ground | None = None,
    ) -> None:
        self.clock = ClockMap()
        self.origin = origin
        self._settings = settings
        self._time_std_s = time_std_s
        self._ground = ground
        self._attitude = AttitudeSources(settings.attitude)
        self._height = HeightSources(settings.height)
        self._position = Stream(settings.height.max_gap_ns)

    def append(self, tracks: tuple[Track, ...]) -> None:
        """Take in the tracks of one tick."""
        if self.clock.update(tracks) is ClockChange.JUMPED:
            self._attitude.clear()
            for stream in (self._position, *self._height.streams()):
                stream.clear()
        for track in tracks:
            stamps = self.clock.to_utc(track)
            self._attitude.append(track, stamps)
            self._height.append(track, stamps)
            if isinstance(track, PositionTrack) and len(stamps):
                self._take_position(track, stamps)

    def at(self, stamp_ns: int, *, final: bool) -> PoseSample | None:
        """The pose at a stamp.

        Args:
            stamp_ns: UTC.
            final: No more telemetry will be waited for.

        Returns:
            None as long as telemetry that matters may still come.
        """
        watermark = END_OF_TIME if final else max((stream.last_ns or 0 for stream in self._streams()), default=0)
        vehicle = self._attitude.vehicle_at(stamp_ns, watermark)
        height = self._height.at(stamp_ns, watermark, vehicle)
        attitude = self._attitude.at(stamp_ns, watermark)
        place = self._place(stamp_ns, watermark)
        if Missing.PENDING in (height, attitude, place):
            return None
        if isinstance(height, Missing) or isinstance(attitude, Missing | Refused):
            return self._miss(stamp_ns, height, attitude)
        sample = self._sample(stamp_ns, height, attitude, None if isinstance(place, Missing) else place)
        if self._ground is not None:
            sample = self._over_ground(sample, self._ground, height, place)
        minimum = self._settings.height.min_m
        if height.height_agl_m < minimum and sample.status is Status.OK:
            reason = f"{height.source} says {height.height_agl_m:.2f} m, the minimum is {minimum:g} m"
            return replace(sample, status=Status.BELOW_MIN_HEIGHT, reasons=(reason,))
        return sample

    def gimbal_frames(self) -> dict[GimbalSource, FrameEvidence]:
        """What the gimbals that reported are against, as far as it is known."""
        return self._attitude.evidence()

    def _streams(self) -> tuple[Stream, ...]:
        return (self._position, *self._attitude.streams(), *self._height.streams())

    def _take_position(self, track: PositionTrack, stamps: np.ndarray) -> None:
        columns = {"lat_rad": track.lat_rad, "lon_rad": track.lon_rad, "alt_msl_m": track.alt_msl_m}
        self._position.append(stamps, **columns)
        if self.origin is None:
            above_plane = float(track.height_home_m[0]) + self._settings.height.home_above_plane_m
            self.origin = GeoOrigin(
                lat_rad=float(track.lat_rad[0]),
                lon_rad=float(track.lon_rad[0]),
                alt_msl_m=float(track.alt_msl_m[0]) - above_plane,
            )

    def _place(self, stamp_ns: int, watermark_ns: int) -> _Place | Missing:
        found = self._position.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing) or self.origin is None:
            return found if isinstance(found, Missing) else Missing.NEVER
        lat, lon, alt = (self._position.column(name) for name in ("lat_rad", "lon_rad", "alt_msl_m"))
        ends = [found.before, found.after]
        corners = np.column_stack([east_north(self.origin, lat[ends], lon[ends]), alt[ends]])
        apart = corners[1] - corners[0]
        velocity = apart * (SECOND_NS / found.gap_ns) if found.gap_ns else np.zeros(3)
        return _Place(
            corners[0, :2] + found.weight * apart[:2],
            velocity,
            (float(found.linear(lat)), float(found.linear(lon)), float(found.linear(alt))),
        )

    def _sample(self, stamp_ns: int, height: Height, attitude: CameraAttitude, place: _Place | None) -> PoseSample:
        stated, report = self._settings.attitude.std, attitude.report_std_rad
        tilt_rad = max(stated.tilt_rad, _DEMAND_TILT_STD_RAD) if attitude.is_demand else stated.tilt_rad
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
            reasons=attitude.reasons,
            pose=pose,
            std=std,
            origin=None if place is None else self.origin,
            lat_rad=lat,
            lon_rad=lon,
            alt_msl_m=alt,
            height_source=height.source,
            height_datum=height.datum,
            attitude_source=attitude.source,
            telemetry_age_s=max(height.age_s, attitude.age_s),
        )

    def _over_ground(self, sample: PoseSample, ground: Ground, height: Height, place: _Place | Missing) -> PoseSample:
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
            reasons.append(_sentence("height", height, self._settings.height.order, self._settings.height.max_gap_ns))
        if isinstance(attitude, Missing):
            limits = self._settings.attitude
            reasons.append(_sentence("camera attitude", attitude, limits.order, limits.max_gap_ns))
        if isinstance(attitude, Refused):
            reasons.append(attitude.reason)
        if not any(stream.began_by(stamp_ns) for stream in self._streams()):
            status = Status.NO_TELEMETRY
        elif Missing.STALE in (height, attitude):
            status = Status.STALE_TELEMETRY
        else:
            status = Status.NO_HEIGHT if height is Missing.NEVER else Status.NO_ATTITUDE
        return PoseSample(stamp_ns=stamp_ns, status=status, reasons=tuple(reasons))


def _unplaced(sample: PoseSample, missing: Missing, max_gap_ns: int) -> PoseSample:
    """What a sample becomes over ground of which nobody knows which part is below."""
    status, when = Status.NO_HEIGHT, "received yet"
    if missing is Missing.STALE:
        status, when = Status.STALE_TELEMETRY, f"on both sides of the stamp within {max_gap_ns / SECOND_NS:g} s"
    return replace(sample, pose=None, status=status, reasons=(f"no position {when}, and the ground is uneven",))


def _sentence(what: str, missing: Missing, order: tuple[str, ...], max_gap_ns: int) -> str:
    sources = ", ".join(order)
    if missing is Missing.NEVER:
        return f"no {what} received yet from {sources}"
    return f"no {what} on both sides of the stamp within {max_gap_ns / SECOND_NS:g} s from {sources}"
