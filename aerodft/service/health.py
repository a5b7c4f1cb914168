"""What a vehicle says of itself at a stamp, and what follows for a pose; ``docs/health.md`` states the rules."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.poses import pose_covariance
from aerodft.model.arrays import IntArray
from aerodft.model.health import (
    FIX_3D,
    RATIOS,
    EstimatorTrack,
    GimbalFailureTrack,
    GpsTrack,
    Health,
    HeartbeatTrack,
    LinkTrack,
    RivalTrack,
)
from aerodft.model.pose import GimbalSource, PoseSample
from aerodft.model.status import Status
from aerodft.model.telemetry import (
    CameraTrack,
    ClockTrack,
    GimbalTrack,
    HeightTrack,
    PositionTrack,
    Track,
    VehicleTrack,
)
from aerodft.service.health_settings import HealthSettings
from aerodft.service.lately import HeardLately
from aerodft.service.streams import Stream

_WARNING_SHARE: Final = 0.8  # of the largest ratio
_GIMBAL_NS: Final = SECOND_NS  # for which a failure that its gimbal reports counts
_OF_THE_GIMBAL: Final = (GimbalSource.MOUNT_ORIENTATION, GimbalSource.MOUNT_STATUS)  # that cannot say so themselves
_NAMES: Final = {
    ClockTrack: "clock",
    VehicleTrack: "vehicle attitude",
    PositionTrack: "position",
    HeartbeatTrack: "heartbeat",
    GpsTrack: "gps",
    EstimatorTrack: "estimator",
}


class HealthSources:
    """All that a vehicle says of itself, and when anything of a kind came last."""

    def __init__(self, settings: HealthSettings) -> None:
        self._settings = settings
        self._kinds: dict[str, Stream] = {}
        self._heartbeat, self._gps = Stream(settings.heartbeat_ns), Stream(settings.gps_ns)
        self._estimator, self._link = Stream(settings.heartbeat_ns), Stream(settings.window_ns)
        self._resumed = Stream(settings.heartbeat_ns)  # when all had been silent before
        self._rivals, self._failures = HeardLately(settings.window_ns), HeardLately(_GIMBAL_NS)
        self._newest_ns: int | None = None

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be forgotten or moved when clocks jump."""
        own = (self._heartbeat, self._gps, self._estimator, self._link, self._resumed)
        return (*own, *self._rivals.streams(), *self._failures.streams(), *self._kinds.values())

    def append(self, track: Track, stamps_ns: IntArray, edges: IntArray | None = None) -> None:
        """Take a track in, whatever it is of; ``edges`` as in ``TrackBuffer.append``."""
        if isinstance(track, RivalTrack | GimbalFailureTrack):
            lately = self._rivals if isinstance(track, RivalTrack) else self._failures
            lately.append(track.what, stamps_ns)
            return
        if len(stamps_ns):
            self._note_silence(stamps_ns, edges)
        match track:
            case HeartbeatTrack():
                self._heartbeat.append(stamps_ns, edges)
            case GpsTrack():
                self._gps.append(
                    stamps_ns,
                    edges,
                    fix=track.fix,
                    satellites=track.satellites,
                    horizontal_std_m=track.horizontal_std_m,
                    vertical_std_m=track.vertical_std_m,
                )
            case EstimatorTrack():
                self._estimator.append(stamps_ns, edges, ratios=track.ratios, has_attitude=track.has_attitude)
            case LinkTrack():
                self._append_link(track, stamps_ns, np.array([len(stamps_ns)]) if edges is None else edges)
                return
        self._kinds.setdefault(_name(track), Stream(self._settings.heartbeat_ns)).append(stamps_ns, edges)

    def knows(self, track: Track) -> bool:
        """Whether such a track was taken in before, since clocks were last set."""
        if isinstance(track, LinkTrack):
            return True
        return _name(track) in self._kinds and len(self._kinds[_name(track)].stamps_ns) > 0

    def goes_on(self, stamps: Sequence[IntArray], edges: Sequence[IntArray]) -> bool:
        """Whether there is no silence in or before tracks ``(n,)`` of several ticks, edges as in ``append``."""
        newest, limit = self._newest_ns, self._settings.heartbeat_ns
        if newest is None:
            return False
        ticks = len(edges[0])
        firsts, lasts = np.full(ticks, newest), np.full(ticks, newest)
        for stamps_ns, ends in zip(stamps, edges, strict=True):
            starts = np.concatenate([[0], ends[:-1]])
            came = np.flatnonzero(ends > starts)
            firsts[came] = np.maximum(firsts[came], stamps_ns[starts[came]])
            lasts[came] = np.maximum(lasts[came], stamps_ns[ends[came] - 1])
        before = np.concatenate([[newest], np.maximum.accumulate(lasts)[:-1]])
        return bool(np.all(firsts <= before + limit))

    def _append_link(self, track: LinkTrack, stamps_ns: IntArray, edges: IntArray) -> None:
        """Count the frames of each tick, at its last one's stamp."""
        starts = np.concatenate([[0], edges[:-1]])
        came = edges > starts
        ends = edges[came]
        lost = np.add.reduceat(track.lost, starts[came])
        self._link.append(stamps_ns[ends - 1], np.cumsum(came), received=ends - starts[came], lost=lost)

    def _note_silence(self, stamps_ns: IntArray, edges: IntArray | None) -> None:
        """A link that was dead, or a clock that was set, is no autopilot without heartbeat: that counts from there."""
        first_ns = int(stamps_ns[0])
        if edges is None and self._newest_ns is not None and first_ns > self._newest_ns + self._settings.heartbeat_ns:
            self._resumed.append(stamps_ns[:1])
        lasts = stamps_ns[-1:] if edges is None else stamps_ns[edges[edges > 0] - 1]
        self._newest_ns = max(int(lasts.max()), self._newest_ns or 0)

    def at(self, stamp_ns: int) -> Health:
        """What was known at a stamp: nothing later than it."""
        gps, estimator = _last(self._gps, stamp_ns), _last(self._estimator, stamp_ns)
        fresh = estimator is not None and estimator.age_ns <= self._settings.heartbeat_ns
        fix = None if gps is None else int(self._gps.column("fix")[gps.row])
        ratios = self._estimator.column("ratios")[estimator.row].tolist() if fresh and estimator else ()
        received, lost = self._link_counts(stamp_ns)
        silent = [_age_s(stream, stamp_ns) for stream in (self._heartbeat, self._resumed)]
        return Health(
            heartbeat_age_s=None if silent[0] is None else min(age for age in silent if age is not None),
            gps_fix=fix,
            gps_age_s=None if gps is None else gps.age_ns / SECOND_NS,
            satellites=None if gps is None else _known(self._gps.column("satellites")[gps.row]),
            horizontal_std_m=None if gps is None else _finite(self._gps.column("horizontal_std_m")[gps.row]),
            vertical_std_m=None if gps is None else _finite(self._gps.column("vertical_std_m")[gps.row]),
            ratios=dict(zip(RATIOS, ratios, strict=False)),
            has_attitude=bool(self._estimator.column("has_attitude")[estimator.row]) if fresh and estimator else None,
            received=received,
            lost=lost,
            ages_s={name: age for name, each in self._kinds.items() if (age := _age_s(each, stamp_ns)) is not None},
        )

    def judged(self, sample: PoseSample) -> PoseSample:
        """A pose with what follows from the vehicle's health: another status, a wider std, no place, remarks."""
        health = self.at(sample.stamp_ns)
        status, faults = self._faults(health)
        failures, rivals = self._failures.at(sample.stamp_ns), self._rivals.at(sample.stamp_ns)
        if sample.status is not Status.OK:
            return replace(sample, reasons=(*sample.reasons, *faults, *failures, *rivals))
        if not faults and failures and sample.attitude_source in _OF_THE_GIMBAL:
            status, faults = Status.UNHEALTHY, [f"{each}: its other reports are not believed" for each in failures]
        if faults:
            return replace(sample, status=status, reasons=(*faults, *sample.reasons))
        remarks = [*self._remarks(health), *failures, *rivals]
        sample = _with_horizontal_std(sample, health.horizontal_std_m or 0.0)
        if health.gps_fix is not None and health.gps_fix < FIX_3D:
            sample = replace(sample, origin=None, lat_rad=None, lon_rad=None, alt_msl_m=None)
        return replace(sample, reasons=(*sample.reasons, *remarks)) if remarks else sample

    def _faults(self, health: Health) -> tuple[Status, list[str]]:
        """Why there can be no answer, in sentences; and the status of that."""
        limits, faults = self._settings, []
        most_s = limits.heartbeat_ns / SECOND_NS
        if (health.heartbeat_age_s or 0.0) > most_s:
            faults.append(f"no HEARTBEAT of the autopilot for more than {most_s:g} s")
        status = Status.STALE_TELEMETRY if faults else Status.UNHEALTHY
        if health.has_attitude is False:
            faults.append("the autopilot's estimator says that it has no attitude")
        faults += [
            f"the autopilot's estimator is at fault: its test ratio of {name} is {ratio:.2f}, below"
            f" {limits.max_ratio:g} is wanted"
            for name, ratio in health.ratios.items()
            if ratio >= limits.max_ratio
        ]
        return status, faults

    def _remarks(self, health: Health) -> list[str]:
        """What makes an answer worth less, in sentences."""
        limits, remarks = self._settings, []
        if health.gps_fix is not None and health.gps_fix < FIX_3D:
            remarks.append(f"GPS has no 3D fix (fix type {health.gps_fix}): the place is not known")
        most_s = limits.gps_ns / SECOND_NS
        if (health.gps_age_s or 0.0) > most_s:
            remarks.append(f"GPS has been silent for more than {most_s:g} s")
        for what, std_m, most_m in (
            ("horizontally", health.horizontal_std_m, limits.horizontal_std_m),
            ("vertically", health.vertical_std_m, limits.vertical_std_m),
        ):
            if std_m is not None and std_m > most_m:
                remarks.append(f"GPS is accurate to {std_m:.1f} m {what} only, at best {most_m:g} m is wanted")
        most_s = limits.heartbeat_ns / SECOND_NS
        if health.ages_s.get(_NAMES[EstimatorTrack], 0.0) > most_s:
            remarks.append(f"the autopilot's estimator has said nothing believable for more than {most_s:g} s")
        remarks += [
            f"the autopilot's estimator is near its limit: its test ratio of {name} is {ratio:.2f}"
            for name, ratio in health.ratios.items()
            if ratio >= _WARNING_SHARE * limits.max_ratio
        ]
        if health.loss_share > limits.loss_share:
            share, seconds = round(100 * health.loss_share), limits.window_ns / SECOND_NS
            remarks.append(f"the link lost {share} % of the autopilot's frames over {seconds:g} s")
        return remarks

    def _link_counts(self, stamp_ns: int) -> tuple[int, int]:
        """Frames received and lost over the window before a stamp."""
        if not len(self._link.stamps_ns):
            return 0, 0
        ends = [stamp_ns - self._settings.window_ns, stamp_ns]
        rows = slice(*np.searchsorted(self._link.stamps_ns, ends, side="right").tolist())
        return int(self._link.column("received")[rows].sum()), int(self._link.column("lost")[rows].sum())


@dataclass(frozen=True, slots=True)
class _Row:
    row: int
    age_ns: int


def _last(stream: Stream, stamp_ns: int) -> _Row | None:
    """The newest row that is not after a stamp."""
    stamps = stream.stamps_ns
    row = int(np.searchsorted(stamps, stamp_ns, side="right")) - 1
    return None if row < 0 else _Row(row, stamp_ns - int(stamps[row]))


def _age_s(stream: Stream, stamp_ns: int) -> float | None:
    last = _last(stream, stamp_ns)
    return None if last is None else last.age_ns / SECOND_NS


def _name(track: Track) -> str:
    if isinstance(track, GimbalTrack | HeightTrack | CameraTrack):
        return str(track.source)
    return _NAMES.get(type(track), type(track).__name__)


def _known(count: float) -> int | None:
    return int(count) if count >= 0 else None


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _with_horizontal_std(sample: PoseSample, horizontal_m: float) -> PoseSample:
    """The sample, with no smaller standard deviation of its place."""
    if sample.pose is None or horizontal_m <= sample.std.horizontal_m:
        return sample
    std = replace(sample.std, horizontal_m=horizontal_m)
    widened = pose_covariance(sample.pose.wxyz, std) - pose_covariance(sample.pose.wxyz, sample.std)
    return replace(sample, pose=replace(sample.pose, cov=sample.pose.cov + widened), std=std)
