"""Pose samples out of attitudes, heights and places, many at once, in ENU; and of what is missing among them."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from aerodft.geometry.ground import Ground, Plane
from aerodft.geometry.poses import pose_covariance
from aerodft.model.pose import GeoOrigin, HeightSource, Pose, PoseSample, PoseStd
from aerodft.model.status import Status
from aerodft.service.attitude import CameraAttitude, Refused
from aerodft.service.footing import footing
from aerodft.service.height import Height
from aerodft.service.places import Place
from aerodft.service.pose_words import (
    HOME_MOVED,
    REBOOTED,
    by_guess,
    by_host,
    no_height,
    no_place,
    sentence,
    unplaced,
)
from aerodft.service.settings import DEMAND_TILT_STD_RAD, TelemetrySettings
from aerodft.service.streams import Missing
from aerodft.service.timing import ClockMap


class Parts(NamedTuple):
    """What a pose is made of; a height and an attitude may come without a place."""

    stamp_ns: int
    height: Height
    attitude: CameraAttitude
    place: Place | None


_STILL: Final = (0.0, 0.0, 0.0)


class PoseMaker:
    """Makes samples.

    Args:
        settings: Stated standard deviations.
        time_std_s: Of image stamps against telemetry stamps.
        ground: What heights that are measured from the surface below are counted from; None for the level plane at 0.
    """

    def __init__(self, settings: TelemetrySettings, time_std_s: float, ground: Ground | None) -> None:
        self._settings = settings
        self._time_std_s = time_std_s
        self._ground = ground

    def samples(self, parts: Sequence[Parts], origin: GeoOrigin | None) -> list[PoseSample]:
        """A sample of each; what its clock has to say is not in its reasons yet."""
        if not parts:
            return []
        alike = [(each.height.std_m, each.attitude.report_std_rad, each.attitude.is_demand) for each in parts]
        std_of = {key: self._std(*key) for key in set(alike)}
        stds = [std_of[key] for key in alike]
        covs = pose_covariance(np.array([each.attitude.wxyz for each in parts]), stds)
        poses = Pose(
            position_enu_m=np.array([_position(each) for each in parts]),
            wxyz=np.array([each.attitude.wxyz for each in parts]),
            cov=covs,
            velocity_enu_mps=np.array(
                [_STILL if each.place is None else each.place.velocity_enu_mps for each in parts]
            ),
            rate_cam_radps=np.array([each.attitude.rate_cam_radps for each in parts]),
            time_std_s=self._time_std_s,
        )
        return [_sample(each, std, pose, origin) for each, std, pose in zip(parts, stds, poses.rows(), strict=True)]

    def _std(self, height_m: float, report: tuple[float, float, float], is_demand: bool) -> PoseStd:  # noqa: FBT001
        stated = self._settings.attitude.std
        tilt_rad = max(stated.tilt_rad, DEMAND_TILT_STD_RAD) if is_demand else stated.tilt_rad
        return PoseStd(
            height_agl_m=height_m,
            horizontal_m=stated.horizontal_m,
            tilt_rad=math.hypot(tilt_rad, report[0]),
            pan_rad=math.hypot(stated.pan_rad, report[1]),
            roll_rad=math.hypot(stated.roll_rad, report[2]),
            heading_rad=stated.heading_rad,
            time_s=self._time_std_s,
        )

    def completed(
        self, sample: PoseSample, height: Height, place: Place | Missing, clock: ClockMap, *, by_utc: bool
    ) -> PoseSample:
        """A sample of these parts with what its clock has to say, over its ground, and high enough.

        Args:
            sample: As ``samples`` made it.
            height: Of it.
            place: Of it, or why it has none.
            clock: Of the vehicle.
            by_utc: Whether it is for a stamp that is UTC by another clock than this machine's.
        """
        home = (HOME_MOVED,) if clock.has_restarted and height.source is HeightSource.HOME else ()
        nowhere = (f"{no_place(self._settings.height)}: the place is not stated",) if place is Missing.STALE else ()
        remarks = (*clock.remarks(sample.stamp_ns), *home, *nowhere)
        sample = replace(sample, reasons=(*sample.reasons, *remarks)) if remarks else sample
        if not clock.is_utc_known:
            sample = by_guess(sample) if by_utc else by_host(sample)
        if self._ground is not None:
            sample = self._over_ground(sample, self._ground, height, place)
        minimum = self._settings.height.min_m
        if height.height_agl_m < minimum and sample.status is Status.OK:
            reason = f"{height.source} says {height.height_agl_m:.2f} m, the minimum is {minimum:g} m"
            return replace(sample, status=Status.BELOW_MIN_HEIGHT, reasons=(reason,))
        return sample

    def _over_ground(self, sample: PoseSample, ground: Ground, height: Height, place: Place | Missing) -> PoseSample:
        """The sample in ENU, where its height may be counted from the surface below; or why it has no place there."""
        from_zero, pose = height.source is HeightSource.HOME, sample.pose
        if pose is None:
            return sample
        if isinstance(place, Missing) and (from_zero or not isinstance(ground, Plane)):  # a slope is alike everywhere
            return unplaced(sample, place, self._settings.height)
        foot = pose.position_enu_m[:2] + height.foot_m
        below = footing(ground, foot)
        if below.status is Status.BEYOND_TERRAIN or not (from_zero or below.status is Status.OK):
            east, north = foot.tolist()
            reason = f"below the camera, {east:.0f} m east and {north:.0f} m north of the origin, is {below.what}"
            return replace(sample, status=below.status, reasons=(reason,), pose=None)
        return sample if from_zero else replace(sample, pose=below.carrying(pose), datum_enu_m=below.height_m)


def _position(parts: Parts) -> tuple[float, float, float]:
    east, north = (0.0, 0.0) if parts.place is None else parts.place.east_north_m
    return east, north, parts.height.height_agl_m


def _sample(parts: Parts, std: PoseStd, pose: Pose, origin: GeoOrigin | None) -> PoseSample:
    stamp_ns, height, attitude, place = parts
    lat, lon, alt = (None, None, None) if place is None else place.lat_lon_alt
    return PoseSample(
        stamp_ns=stamp_ns,
        status=Status.OK,
        reasons=(*attitude.reasons, *height.reasons),
        pose=pose,
        std=std,
        origin=None if place is None else origin,
        lat_rad=lat,
        lon_rad=lon,
        alt_msl_m=alt,
        height_source=height.source,
        height_datum=height.datum,
        attitude_source=attitude.source,
        height_age_s=height.age_s,
        telemetry_age_s=max(height.age_s, attitude.age_s),
    )


def missed(
    stamp_ns: int,
    parts: tuple[Height | Missing, CameraAttitude | Missing | Refused],
    settings: TelemetrySettings,
    clock: ClockMap,
    *,
    began: bool,
) -> PoseSample:
    """Why there is no pose at a stamp (UTC).

    Args:
        stamp_ns: The stamp.
        parts: Height and attitude, at least one of which is missing.
        settings: Limits.
        clock: Of the vehicle.
        began: Whether there was any telemetry by then.
    """
    height, attitude = parts
    reasons = []
    if isinstance(height, Missing):
        reasons.append(no_height(height, settings.height))
    if isinstance(attitude, Missing):
        limits = settings.attitude
        reasons.append(sentence("camera attitude", attitude, limits.order, limits.max_gap_ns))
    if isinstance(attitude, Refused):
        reasons.append(attitude.reason)
    broken_off = clock.broken_off()
    if broken_off is not None:
        return PoseSample(stamp_ns=stamp_ns, status=Status.CLOCK_JUMPED, reasons=(broken_off, *reasons))
    if not began:
        status = Status.NO_TELEMETRY
        reasons = [*([REBOOTED] if clock.has_restarted else []), *reasons]
    elif Missing.STALE in (height, attitude):
        status = Status.STALE_TELEMETRY
    else:
        status = Status.NO_HEIGHT if height is Missing.NEVER else Status.NO_ATTITUDE
    return PoseSample(stamp_ns=stamp_ns, status=status, reasons=tuple(reasons))
