"""The camera's attitude at a stamp, from the first source in the configured order that has one."""

from collections.abc import Iterator

import numpy as np

from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import GimbalSource
from aerodft.model.telemetry import GimbalTrack, ReportFrame, Track, VehicleTrack
from aerodft.service.attitude_readings import CameraAttitude, CameraAttitudes, Readings, Resolver, Told
from aerodft.service.carried import Ends
from aerodft.service.gimbal import Gimbal
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.reports import Asked, Refused, readings_of, refused
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import Missing, Stream

__all__ = ["AttitudeSources", "CameraAttitude", "CameraAttitudes", "Refused", "Told"]


class AttitudeSources:
    """The vehicle's and the gimbals' attitude streams."""

    def __init__(self, settings: AttitudeSettings) -> None:
        self._settings = settings
        self._vehicle = Stream(settings.max_gap_ns)
        self._gimbals: dict[GimbalSource, Gimbal] = {
            source: Gimbal(settings) for source in settings.order if source is not GimbalSource.FIXED_MOUNT
        }
        self._resolver = Resolver(settings)
        self._tick = -1
        self._vehicle_at: dict[int, FloatArray] = {}

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
        self._tick = tick
        for gimbal in self._gimbals.values():
            gimbal.see(tick)

    def settle(self) -> None:
        """All ticks so far are over."""
        self._tick = -1
        self._vehicle_at = {}
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

    def vehicle_at(self, watermark_ns: int, stamp_ns: int) -> FloatArray | Missing:
        """``ned_SO3_body (4,)`` at the stamp; kept until the ticks are over: heights ask for each many times."""
        known = self._vehicle_at.get(stamp_ns)
        if known is not None:
            return known
        found = self._vehicle.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing):
            return found
        turned = self._vehicle_at[stamp_ns] = found.spherical(self._vehicle.column("wxyz"))
        return turned

    def at(self, stamp_ns: int, watermark_ns: int) -> CameraAttitude | Missing | Refused:
        """The camera's attitude at the stamp."""
        worst = Missing.NEVER
        for source in self._settings.order:
            if source is GimbalSource.FIXED_MOUNT:
                missing: Missing | Refused | None = self._bolted(stamp_ns, watermark_ns)
            else:
                missing = self._gimballed(source, stamp_ns, watermark_ns)
            if missing is None:
                asked = Asked(np.array([stamp_ns]), np.array([self._tick]), np.array([True]))
                ((_, found),) = self._resolved(source, asked)
                return found.row(0)
            if isinstance(missing, Refused) or missing is Missing.PENDING:
                return missing
            worst = Missing.STALE if Missing.STALE in (worst, missing) else worst
        return worst

    def at_all(self, stamps_ns: IntArray, ticks: IntArray) -> CameraAttitudes:
        """What ``at`` gives for stamps ``(n,)`` at ticks ``(n,)`` of those that came last, to the last bit.

        Not known where it is not that simple: unknown, refused, or more may come.
        """
        found = CameraAttitudes.none(len(stamps_ns))
        left = np.arange(len(stamps_ns))
        for source in self._settings.order:
            stream = self._vehicle if source is GimbalSource.FIXED_MOUNT else self._gimbals[source].stream
            if not stream.has_begun or not len(left):
                continue
            is_over = (self._vehicle.newest_at(ticks) >= stamps_ns) | (not self._vehicle.has_begun)
            for rows, attitudes in self._resolved(source, Asked(stamps_ns[left], ticks[left], is_over[left])):
                found = found.put(left[rows], attitudes)
            is_known = stream.find_all(stamps_ns[left], ticks[left]).is_known
            left = left[~is_known & (stream.newest_at(ticks[left]) >= stamps_ns[left])]  # the next source is asked
        return found

    def _bolted(self, stamp_ns: int, watermark_ns: int) -> Missing | None:
        """Why a camera that is bolted to the vehicle has no attitude; None where it has."""
        found = self._vehicle.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing):
            return found
        return Missing.NEVER if self._settings.fixed_mount is None else None

    def _gimballed(self, source: GimbalSource, stamp_ns: int, watermark_ns: int) -> Missing | Refused | None:
        """Why a gimbal's reports tell no attitude; None where they do."""
        gimbal = self._gimbals[source]
        found, vehicle = gimbal.stream.find(stamp_ns, watermark_ns), self._vehicle.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing):
            return found
        if vehicle is Missing.PENDING:
            return vehicle
        evidence = gimbal.evidence(self._vehicle)
        refusal = refused(source, evidence, self._settings.frame)
        if refusal is not None:
            return refusal
        in_earth = gimbal.stream.column("yaw_in_earth")
        if in_earth[found.before] != in_earth[found.after]:
            return Missing.STALE  # no rotation leads from one reference to the other
        is_against_earth = bool(in_earth[found.before]) and self._frame(evidence) is ReportFrame.EARTH
        return vehicle if isinstance(vehicle, Missing) and not is_against_earth else None

    def _frame(self, evidence: FrameEvidence) -> ReportFrame:
        return self._settings.frame or evidence.frame or ReportFrame.EARTH

    def _resolved(self, source: GimbalSource, asked: Asked) -> Iterator[tuple[IntArray, CameraAttitudes]]:
        """Attitudes at the stamps for which a source tells one, with their rows among them."""
        if source is not GimbalSource.FIXED_MOUNT:
            gimbal, stated = self._gimbals[source], self._settings.frame
            for rows, readings in readings_of(source, gimbal, self._vehicle, stated, asked):
                yield rows, self._resolver.resolved(readings)
            return
        vehicle = self._vehicle.find_all(asked.stamps_ns, asked.ticks)
        rows = np.flatnonzero(vehicle.is_known & (self._settings.fixed_mount is not None))
        if len(rows):
            known = vehicle.rows(rows)
            own, age_s = (
                Ends.of(self._vehicle.all_of("wxyz"), known),
                self._vehicle.ages_s(asked.stamps_ns[rows], known),
            )
            yield rows, self._resolver.resolved(Readings(source=source, age_s=age_s, vehicle=own))
