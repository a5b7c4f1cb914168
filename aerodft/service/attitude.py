"""The camera's attitude at a stamp, from the first source in the configured order that has one."""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.conventions import GIMBAL_SO3_CAM_WXYZ, SECOND_NS
from aerodft.geometry.interpolation import Bracket
from aerodft.geometry.rotation import (
    camera_from_gimbal,
    from_yaw_pitch_roll,
    inverse,
    matrix,
    multiply,
    to_rotation_vector,
    yaw_pitch_roll,
)
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import GimbalSource
from aerodft.model.telemetry import GimbalTrack, Track, VehicleTrack
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import Missing, Stream


@dataclass(frozen=True, slots=True)
class CameraAttitude:
    """Where the camera looks.

    Attributes:
        wxyz: ``(4,)`` ``enu_SO3_cam``.
        rate_cam_radps: ``(3,)`` angular rate in camera axes.
        jump_std_rad: ``(3,)`` about the camera's axes: how far off the interpolation may be, because the report jumped.
        source: Where it came from.
        age_s: Distance in time to the nearest sample used.
    """

    wxyz: FloatArray
    rate_cam_radps: FloatArray
    jump_std_rad: FloatArray
    source: GimbalSource
    age_s: float


class AttitudeSources:
    """The vehicle's and the gimbals' attitude streams."""

    def __init__(self, settings: AttitudeSettings) -> None:
        self._settings = settings
        self._vehicle = Stream(settings.max_gap_ns)
        self._gimbals = {source: Stream(settings.max_gap_ns) for source in settings.order}

    def streams(self) -> tuple[Stream, ...]:
        """All streams, for the watermark."""
        return (self._vehicle, *self._gimbals.values())

    def append(self, track: Track, stamps_ns: IntArray) -> None:
        """Take a track in, if it is one of attitude."""
        if isinstance(track, VehicleTrack):
            self._vehicle.append(stamps_ns, wxyz=track.wxyz)
        elif isinstance(track, GimbalTrack) and track.source in self._gimbals:
            earth = track.yaw_in_earth.astype(np.float64)
            self._gimbals[track.source].append(stamps_ns, wxyz=track.wxyz, yaw_in_earth=earth)

    def vehicle_at(self, stamp_ns: int, watermark_ns: int) -> FloatArray | Missing:
        """``ned_SO3_body (4,)`` at the stamp."""
        found = self._vehicle.find(stamp_ns, watermark_ns)
        return found if isinstance(found, Missing) else found.spherical(self._vehicle.column("wxyz"))

    def at(self, stamp_ns: int, watermark_ns: int) -> CameraAttitude | Missing:
        """The camera's attitude at the stamp."""
        worst = Missing.NEVER
        for source in self._settings.order:
            if source is GimbalSource.FIXED_MOUNT:
                found = self._bolted(stamp_ns, watermark_ns)
            else:
                found = self._gimballed(source, stamp_ns, watermark_ns)
            if not isinstance(found, Missing) or found is Missing.PENDING:
                return found
            worst = Missing.STALE if Missing.STALE in (worst, found) else worst
        return worst

    def _bolted(self, stamp_ns: int, watermark_ns: int) -> CameraAttitude | Missing:
        found, mount = self._vehicle.find(stamp_ns, watermark_ns), self._settings.fixed_mount
        if isinstance(found, Missing) or mount is None:
            return found if isinstance(found, Missing) else Missing.NEVER
        body_wxyz_gimbal = from_yaw_pitch_roll(mount.yaw_rad, mount.pitch_rad, mount.roll_rad)
        vehicle = self._vehicle.column("wxyz")
        ends = multiply(vehicle[[found.before, found.after]], body_wxyz_gimbal)
        now = multiply(found.spherical(vehicle), body_wxyz_gimbal)
        rate = _rate(ends[0], ends[1], found.gap_ns)
        return self._camera(now, (rate, np.zeros(3)), GimbalSource.FIXED_MOUNT, stamp_ns, self._vehicle)

    def _gimballed(self, source: GimbalSource, stamp_ns: int, watermark_ns: int) -> CameraAttitude | Missing:
        stream = self._gimbals[source]
        found = stream.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing):
            return found
        reported, in_earth = stream.column("wxyz"), stream.column("yaw_in_earth")
        if in_earth[found.before] != in_earth[found.after]:
            return Missing.STALE  # no rotation leads from one reference to the other
        gimbal = found.spherical(reported)
        rate = _rate(reported[found.before], reported[found.after], found.gap_ns)
        jump = _jump_std(reported, found)
        if in_earth[found.before]:
            return self._camera(gimbal, (rate, jump), source, stamp_ns, stream)
        vehicle = self._vehicle.find(stamp_ns, watermark_ns)
        if isinstance(vehicle, Missing):
            return vehicle
        attitude = self._vehicle.column("wxyz")
        yaw, _, _ = yaw_pitch_roll(vehicle.spherical(attitude))
        turn_ned = np.array([0.0, 0.0, _yaw_rate(attitude[vehicle.before], attitude[vehicle.after], vehicle.gap_ns)])
        gimbal = multiply(from_yaw_pitch_roll(yaw, 0.0, 0.0), gimbal)
        return self._camera(gimbal, (rate + matrix(inverse(gimbal)) @ turn_ned, jump), source, stamp_ns, stream)

    @staticmethod
    def _camera(
        ned_wxyz_gimbal: FloatArray,
        rate_and_jump: tuple[FloatArray, FloatArray],
        source: GimbalSource,
        stamp_ns: int,
        stream: Stream,
    ) -> CameraAttitude:
        cam_from_gimbal = matrix(inverse(np.array(GIMBAL_SO3_CAM_WXYZ)))
        rate, jump = (cam_from_gimbal @ vector for vector in rate_and_jump)
        age_s = stream.age_s(stamp_ns) or 0.0
        return CameraAttitude(camera_from_gimbal(ned_wxyz_gimbal), rate, np.abs(jump), source, age_s)


def _jump_std(reported_wxyz: FloatArray, found: Bracket) -> FloatArray:
    """Standard deviation ``(3,)`` of interpolating between two samples when the report jumps, in gimbal axes.

    A gimbal that repeats its command shows a slew as one step, at any time between two samples: a share ``w`` into the
    gap the interpolation is then off by ``turn sqrt(w (1 - w))``. What the turn before already announced is no step.
    """
    turn = to_rotation_vector(multiply(inverse(reported_wxyz[found.before]), reported_wxyz[found.after]))
    if found.before == 0 or not np.any(turn):
        return turn * 0.0
    before = to_rotation_vector(multiply(inverse(reported_wxyz[found.before - 1]), reported_wxyz[found.before]))
    unannounced = max(0.0, 1.0 - float(np.linalg.norm(before)) / float(np.linalg.norm(turn)))
    return np.asarray(turn * unannounced * math.sqrt(found.weight * (1 - found.weight)))


def _yaw_rate(before_wxyz: FloatArray, after_wxyz: FloatArray, gap_ns: int) -> float:
    """Rate of the heading (rad/s, clockwise) between two samples of ``ned_SO3_body``, the shorter way round."""
    if gap_ns == 0:
        return 0.0
    turn_rad = float(yaw_pitch_roll(after_wxyz)[0] - yaw_pitch_roll(before_wxyz)[0])
    return math.remainder(turn_rad, math.tau) * (SECOND_NS / gap_ns)


def _rate(before_wxyz: FloatArray, after_wxyz: FloatArray, gap_ns: int) -> FloatArray:
    """Angular rate (rad/s) in the moving frame's own axes between two samples."""
    if gap_ns == 0:
        return np.zeros(3)
    return np.asarray(to_rotation_vector(multiply(inverse(before_wxyz), after_wxyz)) * (SECOND_NS / gap_ns))
