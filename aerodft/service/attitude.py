"""The camera's attitude at a stamp, from the first source in the configured order that has one."""

from collections.abc import Sequence
from dataclasses import dataclass

from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import GimbalSource
from aerodft.model.telemetry import GimbalTrack, ReportFrame, Track, VehicleTrack
from aerodft.service.attitude_readings import CameraAttitude, Reading, Resolver
from aerodft.service.gimbal import Gimbal
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import Missing, Stream

__all__ = ["AttitudeSources", "CameraAttitude", "Reading", "Refused"]


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
        self._resolver = Resolver(settings)

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

    def append(self, track: Track, stamps_ns: IntArray, edges: IntArray | None = None) -> None:
        """Take a track in, if it is one of attitude; ``edges`` as in ``TrackBuffer.append``."""
        if isinstance(track, VehicleTrack):
            self._vehicle.append(stamps_ns, edges, wxyz=track.wxyz)
        elif isinstance(track, GimbalTrack) and track.source in self._gimbals:
            self._gimbals[track.source].append(track, stamps_ns, edges)

    def see(self, tick: int) -> None:
        """Look at the gimbals' reports as at one of the ticks of those that came last; the streams are seen apart."""
        for gimbal in self._gimbals.values():
            gimbal.see(tick)

    def settle(self) -> None:
        """All ticks so far are over."""
        for gimbal in self._gimbals.values():
            gimbal.settle(self._vehicle)

    def evidence(self) -> dict[GimbalSource, FrameEvidence]:
        """What the gimbals that reported are against, as far as it is known."""
        heard = {source: gimbal for source, gimbal in self._gimbals.items() if gimbal.reports}
        return {source: gimbal.evidence(self._vehicle) for source, gimbal in heard.items()}

    def demands(self) -> dict[GimbalSource, bool]:
        """Whether the gimbals that reported may say what they were told, not where they are."""
        heard = {source: gimbal for source, gimbal in self._gimbals.items() if gimbal.reports}
        return {source: gimbal.is_demand(gimbal.evidence(self._vehicle).frame) for source, gimbal in heard.items()}

    def vehicle_at(self, stamp_ns: int, watermark_ns: int) -> FloatArray | Missing:
        """``ned_SO3_body (4,)`` at the stamp."""
        found = self._vehicle.find(stamp_ns, watermark_ns)
        return found if isinstance(found, Missing) else found.spherical(self._vehicle.column("wxyz"))

    def at(self, stamp_ns: int, watermark_ns: int) -> CameraAttitude | Missing | Refused:
        """The camera's attitude at the stamp."""
        found = self.found(stamp_ns, watermark_ns)
        return self.resolved([found])[0] if isinstance(found, Reading) else found

    def resolved(self, readings: Sequence[Reading]) -> list[CameraAttitude]:
        """The attitudes that readings come to, many at once."""
        return self._resolver.resolved(readings)

    def found(self, stamp_ns: int, watermark_ns: int) -> Reading | Missing | Refused:
        """What tells the camera's attitude at a stamp."""
        worst = Missing.NEVER
        for source in self._settings.order:
            if source is GimbalSource.FIXED_MOUNT:
                found: Reading | Missing | Refused = self._bolted(stamp_ns, watermark_ns)
            else:
                found = self._gimballed(source, stamp_ns, watermark_ns)
            if not isinstance(found, Missing) or found is Missing.PENDING:
                return found
            worst = Missing.STALE if Missing.STALE in (worst, found) else worst
        return worst

    def _bolted(self, stamp_ns: int, watermark_ns: int) -> Reading | Missing:
        found, mount = self._vehicle.find(stamp_ns, watermark_ns), self._settings.fixed_mount
        if isinstance(found, Missing) or mount is None:
            return found if isinstance(found, Missing) else Missing.NEVER
        return Reading(
            source=GimbalSource.FIXED_MOUNT,
            age_s=self._vehicle.age_s(stamp_ns) or 0.0,
            vehicle=(self._vehicle.column("wxyz"), found),
        )

    def _gimballed(self, source: GimbalSource, stamp_ns: int, watermark_ns: int) -> Reading | Missing | Refused:
        gimbal = self._gimbals[source]
        found, vehicle = gimbal.stream.find(stamp_ns, watermark_ns), self._vehicle.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing):
            return found
        if vehicle is Missing.PENDING:
            return vehicle
        evidence = gimbal.evidence(self._vehicle)
        refused = _refused(source, evidence, self._settings.frame)
        if refused is not None:
            return refused
        in_earth = gimbal.stream.column("yaw_in_earth")
        if in_earth[found.before] != in_earth[found.after]:
            return Missing.STALE  # no rotation leads from one reference to the other
        frame, yaw_in_earth = self._settings.frame or evidence.frame or ReportFrame.EARTH, bool(in_earth[found.before])
        if isinstance(vehicle, Missing) and not (yaw_in_earth and frame is ReportFrame.EARTH):
            return vehicle
        is_demand, reports = gimbal.is_demand(evidence.frame), gimbal.stream.column("wxyz")
        return Reading(
            source=source,
            age_s=gimbal.stream.age_s(stamp_ns) or 0.0,
            report=(reports, found),
            vehicle=None if isinstance(vehicle, Missing) else (self._vehicle.column("wxyz"), vehicle),
            frame=frame,
            yaw_in_earth=yaw_in_earth,
            demands=gimbal.demands(found, stamp_ns) if is_demand else None,
            evidence=evidence,
        )


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
