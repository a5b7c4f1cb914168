"""The camera's attitude at a stamp, from the first source in the configured order that has one."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import GIMBAL_SO3_CAM_WXYZ
from aerodft.geometry.interpolation import Bracket
from aerodft.geometry.rotation import (
    camera_from_gimbal,
    from_yaw_pitch_roll,
    inverse,
    matrix,
    multiply,
    to_rotation_vector,
)
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import GimbalSource
from aerodft.model.telemetry import GimbalTrack, ReportFrame, Track, VehicleTrack
from aerodft.service.carried import Turning, between, carrier, heading_of
from aerodft.service.gimbal import Gimbal
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.settings import AttitudeSettings, FixedMount
from aerodft.service.streams import Missing, Stream

_CAM_FROM_STRAIGHT: Final = matrix(inverse(np.array(GIMBAL_SO3_CAM_WXYZ)))  # of a camera that looks along x
_USUAL_TILT_RAD: Final = math.radians(5)  # of a vehicle that does not report its attitude


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraAttitude:
    """Where the camera looks.

    Attributes:
        wxyz: ``(4,)`` ``enu_SO3_cam``.
        rate_cam_radps: ``(3,)`` angular rate in camera axes.
        source: Where it came from.
        age_s: Distance in time to the nearest sample used.
        report_std_rad: ``(3,)`` about the camera's axes, beside the settings': how far off the report may be at this
            stamp, because it jumps, leads the camera, or may be against the vehicle.
        is_demand: Whether the report may be what the gimbal was told, not what it did.
        reasons: What was corrected, or is not known of the report.
    """

    wxyz: FloatArray
    rate_cam_radps: FloatArray
    source: GimbalSource
    age_s: float
    report_std_rad: FloatArray
    is_demand: bool = False
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Refused:
    """There are reports, and they cannot be believed: ``reason`` says why, in a sentence."""

    reason: str


class AttitudeSources:
    """The vehicle's and the gimbals' attitude streams."""

    def __init__(self, settings: AttitudeSettings) -> None:
        self._settings = settings
        self._vehicle = Stream(settings.max_gap_ns)
        self._gimbals: dict[GimbalSource, Gimbal] = {
            source: Gimbal(settings) for source in settings.order if source is not GimbalSource.FIXED_MOUNT
        }
        self._camera = _mounted(settings.camera_on_gimbal)

    def streams(self) -> tuple[Stream, ...]:
        """All streams, for the watermark."""
        return (self._vehicle, *(gimbal.stream for gimbal in self._gimbals.values()))

    def clear(self) -> None:
        """Forget all samples: their stamps are of another clock."""
        for gimbal in self._gimbals.values():
            gimbal.clear(self._vehicle)
        self._vehicle.clear()

    def shift(self, by_ns: int) -> None:
        """Move all samples: what time it was when they were taken is known better now."""
        for gimbal in self._gimbals.values():
            gimbal.shift(by_ns, self._vehicle)
        self._vehicle.shift(by_ns)

    def append(self, track: Track, stamps_ns: IntArray) -> None:
        """Take a track in, if it is one of attitude."""
        if isinstance(track, VehicleTrack):
            self._vehicle.append(stamps_ns, wxyz=track.wxyz)
        elif isinstance(track, GimbalTrack) and track.source in self._gimbals:
            self._gimbals[track.source].append(track, stamps_ns, self._vehicle)

    def evidence(self) -> dict[GimbalSource, FrameEvidence]:
        """What the gimbals that reported are against, as far as it is known."""
        heard = {source: gimbal for source, gimbal in self._gimbals.items() if gimbal.reports}
        return {source: gimbal.evidence(self._vehicle) for source, gimbal in heard.items()}

    def vehicle_at(self, stamp_ns: int, watermark_ns: int) -> FloatArray | Missing:
        """``ned_SO3_body (4,)`` at the stamp."""
        found = self._vehicle.find(stamp_ns, watermark_ns)
        return found if isinstance(found, Missing) else found.spherical(self._vehicle.column("wxyz"))

    def at(self, stamp_ns: int, watermark_ns: int) -> CameraAttitude | Missing | Refused:
        """The camera's attitude at the stamp."""
        worst = Missing.NEVER
        found: CameraAttitude | Missing | Refused
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
        bolted = between(self._vehicle.column("wxyz"), found).carrying(_mounted(mount))
        return CameraAttitude(
            wxyz=camera_from_gimbal(bolted.wxyz),
            rate_cam_radps=_CAM_FROM_STRAIGHT @ bolted.rate_radps,
            source=GimbalSource.FIXED_MOUNT,
            age_s=self._vehicle.age_s(stamp_ns) or 0.0,
            report_std_rad=np.zeros(3),
        )

    def _gimballed(self, source: GimbalSource, stamp_ns: int, watermark_ns: int) -> CameraAttitude | Missing | Refused:
        gimbal = self._gimbals[source]
        found, vehicle = gimbal.stream.find(stamp_ns, watermark_ns), self._vehicle.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing):
            return found
        if vehicle is Missing.PENDING:
            return vehicle
        evidence = gimbal.evidence(self._vehicle)
        looking = _refused(source, evidence, self._settings.frame) or self._looking(gimbal, found, vehicle)
        if not isinstance(looking, Turning):
            return looking
        is_open = self._settings.frame is None and evidence.frame is None
        doubt = self._doubt_std(evidence, vehicle, looking) if is_open else np.zeros(3)
        std = np.hypot(gimbal.std_rad(found, stamp_ns, self._vehicle), doubt)
        camera = looking.carrying(self._camera)
        cam_from_gimbal = _CAM_FROM_STRAIGHT @ matrix(inverse(self._camera.wxyz))
        return CameraAttitude(
            wxyz=camera_from_gimbal(camera.wxyz),
            rate_cam_radps=_CAM_FROM_STRAIGHT @ camera.rate_radps,
            source=source,
            age_s=gimbal.stream.age_s(stamp_ns) or 0.0,
            report_std_rad=np.sqrt(cam_from_gimbal**2 @ std**2),
            is_demand=gimbal.is_demand(self._vehicle),
            reasons=self._remarks(source, evidence, doubt),
        )

    def _looking(self, gimbal: Gimbal, found: Bracket, vehicle: Bracket | Missing) -> Turning | Missing:
        """``ned_SO3_gimbal`` by the reading that is set, or was found, or is the standard's."""
        in_earth = gimbal.stream.column("yaw_in_earth")
        if in_earth[found.before] != in_earth[found.after]:
            return Missing.STALE  # no rotation leads from one reference to the other
        report, yaw_in_earth = between(gimbal.stream.column("wxyz"), found), bool(in_earth[found.before])
        frame = self._settings.frame or gimbal.evidence(self._vehicle).frame or ReportFrame.EARTH
        if yaw_in_earth and frame is ReportFrame.EARTH:
            return report
        if isinstance(vehicle, Missing):
            return vehicle
        return carrier(self._vehicle.column("wxyz"), vehicle, frame, yaw_in_earth=yaw_in_earth).carrying(report)

    def _doubt_std(self, evidence: FrameEvidence, vehicle: Bracket | Missing, looking: Turning) -> FloatArray:
        """Standard deviation ``(3,)`` in gimbal axes of the standard's reading, wrong or not by the vehicle's tilt."""
        share = math.sqrt(evidence.body_probability)
        if isinstance(vehicle, Missing):
            return np.full(3, share * _USUAL_TILT_RAD)
        attitude = vehicle.spherical(self._vehicle.column("wxyz"))
        tilt_ned = to_rotation_vector(multiply(attitude, inverse(heading_of(attitude))))
        return np.abs(share * matrix(inverse(looking.wxyz)) @ tilt_ned)

    def _remarks(self, source: GimbalSource, evidence: FrameEvidence, doubt_std_rad: FloatArray) -> tuple[str, ...]:
        if self._settings.frame is not None:
            return ()
        if evidence.frame is ReportFrame.BODY:
            return (f"{source} is body-frame (against the vehicle, not the horizon): the vehicle's attitude was added",)
        if np.max(doubt_std_rad) > self._settings.std.tilt_rad:
            return (f"whether {source} is earth-frame or body-frame is not known yet: the std covers both",)
        return ()


def _refused(source: GimbalSource, evidence: FrameEvidence, stated: ReportFrame | None) -> Refused | None:
    """Why reports cannot be read as stated, or cannot be read at all."""
    if stated is ReportFrame.EARTH and evidence.frame is ReportFrame.BODY:
        return Refused(
            f"{source} is body-frame (against the vehicle, not the horizon): it undid {evidence.undone} of the "
            f"vehicle's {evidence.motions} motions; "
            'set telemetry.attitude.frame = "auto" or "body"'
        )
    if stated is None and evidence.contradictory:
        return Refused(
            f"{source} is earth-frame (against the horizon) at times and body-frame (against the vehicle) at others; "
            'set telemetry.attitude.frame = "earth" or "body"'
        )
    return None


def _mounted(mount: FixedMount | None) -> Turning:
    """The camera on what it is bolted to."""
    if mount is None:
        return Turning(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    return Turning(from_yaw_pitch_roll(mount.yaw_rad, mount.pitch_rad, mount.roll_rad), np.zeros(3))
