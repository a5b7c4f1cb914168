"""What follows for a pose from what a vehicle says of itself; ``docs/health.md`` states the rules."""

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import pose_covariance
from aerodft.model import (
    CODE_OF,
    FIX_3D,
    HORIZONTAL,
    BoolArray,
    FloatArray,
    GimbalSource,
    IntArray,
    PoseBatch,
    PoseSample,
    Status,
)
from aerodft.service.settings import HealthSettings

_WARNING_SHARE: Final = 0.8  # of the largest ratio
_OF_THE_GIMBAL: Final = (GimbalSource.MOUNT_ORIENTATION, GimbalSource.MOUNT_STATUS)  # that cannot say so themselves


class Facts(NamedTuple):
    """What a verdict follows from; None for what was never said.

    Attributes:
        is_silent: Whether the autopilot's HEARTBEAT stays away.
        has_attitude: Whether the estimator has an attitude.
        ratios: The estimator's test ratios, by what they are of.
        is_estimator_silent: Whether it said something once, and nothing believable since.
        gps_fix: GPS_FIX_TYPE.
        is_gps_silent: Whether the receiver spoke once, and stays away.
        horizontal_std_m: Of its position.
        vertical_std_m: Likewise.
        lost_share: Share of the autopilot's frames, where that is more than may be lost; else 0.
        failures: What the gimbal said that it failed in, lately.
        rivals: Who else spoke, lately.
    """

    is_silent: bool
    has_attitude: bool | None
    ratios: tuple[tuple[str, float], ...]
    is_estimator_silent: bool
    gps_fix: int | None
    is_gps_silent: bool
    horizontal_std_m: float | None
    vertical_std_m: float | None
    lost_share: float
    failures: tuple[str, ...]
    rivals: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What a vehicle's health means for a pose, as long as the facts stay what they are.

    Attributes:
        status: Of poses with faults.
        faults: Why there can be no answer, in sentences.
        remarks: What makes an answer worth less, in sentences.
        failures: As in ``Facts``.
        rivals: Likewise.
        horizontal_std_m: The least that a place may have.
        has_place: Whether the receiver knows where it is.
    """

    status: Status
    faults: tuple[str, ...]
    remarks: tuple[str, ...]
    failures: tuple[str, ...]
    rivals: tuple[str, ...]
    horizontal_std_m: float
    has_place: bool

    @property
    def is_silent(self) -> bool:
        """Whether there is nothing to say of a pose, but for the least std of its place."""
        return self.has_place and not (self.faults or self.remarks or self.failures or self.rivals)

    def refuses(self, sample: PoseSample) -> bool:
        """Whether a pose that is ok gets no answer: by a fault, or by what its own gimbal failed in."""
        return bool(self.faults) or (bool(self.failures) and sample.attitude_source in _OF_THE_GIMBAL)

    def varied(self, sample: PoseSample) -> PoseSample:
        """A sample without its numbers, with the status, the reasons and the origin that follow."""
        if sample.status is not Status.OK:
            said = (*self.faults, *self.failures, *self.rivals)
            return replace(sample, reasons=(*sample.reasons, *said))
        if self.refuses(sample):
            not_believed = tuple(f"{each}: its other reports are not believed" for each in self.failures)
            status = self.status if self.faults else Status.UNHEALTHY
            return replace(sample, status=status, reasons=(*(self.faults or not_believed), *sample.reasons))
        remarks = (*self.remarks, *self.failures, *self.rivals)
        origin = sample.origin if self.has_place else None
        return replace(sample, origin=origin, reasons=(*sample.reasons, *remarks))


@dataclass(frozen=True, slots=True, eq=False)
class Verdicts:
    """What the vehicle's health means for ``n`` poses.

    Attributes:
        each: All that there are.
        verdict_index: ``(n,)`` which of these.
    """

    each: tuple[Verdict, ...]
    verdict_index: IntArray

    def applied(self, poses: PoseBatch) -> PoseBatch:
        """Poses ``(n,)`` with their verdicts."""
        stays = (poses.status == CODE_OF[Status.OK]) & ~self._refuses(poses)
        least_m = np.array([verdict.horizontal_std_m for verdict in self.each])[self.verdict_index]
        has_place = np.array([verdict.has_place for verdict in self.each], dtype=np.bool_)[self.verdict_index]
        widened = _with_horizontal_std(poses, stays & poses.has_pose & (least_m > poses.std[:, HORIZONTAL]), least_m)
        lat_lon_alt = np.where((stays & ~has_place)[:, None], np.nan, widened.lat_lon_alt)
        keys = [None if verdict.is_silent else verdict for verdict in self.each]
        return replace(widened, lat_lon_alt=lat_lon_alt).varied([keys[k] for k in self.verdict_index.tolist()], _varied)

    def _refuses(self, poses: PoseBatch) -> BoolArray:
        """``(n,)`` as ``Verdict.refuses``."""
        table = [[verdict.refuses(variant) for verdict in self.each] for variant in poses.variants]
        return np.array(table, dtype=np.bool_)[poses.variant_index, self.verdict_index]


def _varied(sample: PoseSample, verdict: Hashable) -> PoseSample:
    return verdict.varied(sample) if isinstance(verdict, Verdict) else sample


def verdict_on(facts: Facts, limits: HealthSettings) -> Verdict:
    """What the rules make of facts."""
    status, faults = _faults(facts, limits)
    return Verdict(
        status=status,
        faults=tuple(faults),
        remarks=tuple(_remarks(facts, limits)),
        failures=facts.failures,
        rivals=facts.rivals,
        horizontal_std_m=facts.horizontal_std_m or 0.0,
        has_place=facts.gps_fix is None or facts.gps_fix >= FIX_3D,
    )


def is_calm(ratios: FloatArray, has_attitude: FloatArray, limits: HealthSettings) -> BoolArray:
    """Where nothing follows from what estimators said: test ratios ``(n, k)``, and whether there is an attitude."""
    return np.asarray((has_attitude != 0) & ~np.any(ratios >= _WARNING_SHARE * limits.max_ratio, axis=1))


def _faults(facts: Facts, limits: HealthSettings) -> tuple[Status, list[str]]:
    """Why there can be no answer, in sentences; and the status of that."""
    faults = []
    if facts.is_silent:
        faults.append(f"no HEARTBEAT of the autopilot for more than {limits.heartbeat_ns / SECOND_NS:g} s")
    status = Status.STALE_TELEMETRY if faults else Status.UNHEALTHY
    if facts.has_attitude is False:
        faults.append("the autopilot's estimator says that it has no attitude")
    faults += [
        f"the autopilot's estimator is at fault: its test ratio of {name} is {ratio:.2f}, below"
        f" {limits.max_ratio:g} is wanted"
        for name, ratio in facts.ratios
        if ratio >= limits.max_ratio
    ]
    return status, faults


def _remarks(facts: Facts, limits: HealthSettings) -> list[str]:
    """What makes an answer worth less, in sentences."""
    remarks = []
    if facts.gps_fix is not None and facts.gps_fix < FIX_3D:
        remarks.append(f"GPS has no 3D fix (fix type {facts.gps_fix}): the place is not known")
    if facts.is_gps_silent:
        remarks.append(f"GPS has been silent for more than {limits.gps_ns / SECOND_NS:g} s")
    for what, std_m, most_m in (
        ("horizontally", facts.horizontal_std_m, limits.horizontal_std_m),
        ("vertically", facts.vertical_std_m, limits.vertical_std_m),
    ):
        if std_m is not None and std_m > most_m:
            remarks.append(f"GPS is accurate to {std_m:.1f} m {what} only, at best {most_m:g} m is wanted")
    if facts.is_estimator_silent:
        most_s = limits.heartbeat_ns / SECOND_NS
        remarks.append(f"the autopilot's estimator has said nothing believable for more than {most_s:g} s")
    remarks += [
        f"the autopilot's estimator is near its limit: its test ratio of {name} is {ratio:.2f}"
        for name, ratio in facts.ratios
        if ratio >= _WARNING_SHARE * limits.max_ratio
    ]
    if facts.lost_share:
        share, seconds = round(100 * facts.lost_share), limits.window_ns / SECOND_NS
        remarks.append(f"the link lost {share} % of the autopilot's frames over {seconds:g} s")
    return remarks


def _with_horizontal_std(poses: PoseBatch, rows: BoolArray, least_m: FloatArray) -> PoseBatch:
    """Poses of which those of some rows ``(n,)`` have standard deviations ``least_m (n,)`` of their place."""
    at = np.flatnonzero(rows)
    if not len(at):
        return poses
    before, std = poses.std[at], poses.std.copy()
    std[at, HORIZONTAL] = least_m[at]
    wxyz, cov = poses.pose.wxyz[at], poses.pose.cov.copy()
    cov[at] += pose_covariance(wxyz, std[at]) - pose_covariance(wxyz, before)
    return replace(poses, std=std, pose=replace(poses.pose, cov=cov))
