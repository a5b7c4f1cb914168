"""Pose samples out of attitudes, heights and places, many at once, in ENU; and of what is missing among them."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from aerodft.geometry.ground import Ground, Plane
from aerodft.geometry.poses import pose_covariances
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.pose import GeoOrigin, HeightSource, Pose, PoseSample
from aerodft.model.pose_columns import PoseColumns
from aerodft.model.status import Status
from aerodft.service.attitude import CameraAttitude, CameraAttitudes, Refused, Told
from aerodft.service.footing import footing
from aerodft.service.height import Height, Heights
from aerodft.service.places import Place, PlaceColumns
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


class PartColumns(NamedTuple):
    """What ``n`` poses are made of, all of it known, or no place at all."""

    stamps_ns: IntArray
    heights: Heights
    attitudes: CameraAttitudes
    places: PlaceColumns | None

    @staticmethod
    def of(parts: Parts) -> "PartColumns":
        """Those of one pose."""
        stamp_ns, height, attitude, place = parts
        places = None if place is None else PlaceColumns.of(place)
        return PartColumns(np.array([stamp_ns]), Heights.of(height), CameraAttitudes.of(attitude), places)

    def rows(self, rows: IntArray) -> "PartColumns":
        """Those of some of the poses."""
        places = None if self.places is None else self.places.rows(rows)
        return PartColumns(self.stamps_ns[rows], self.heights.rows(rows), self.attitudes.rows(rows), places)

    def row(self, row: int) -> Parts:
        """Those of one of the poses."""
        place = None if self.places is None else self.places.row(row)
        return Parts(int(self.stamps_ns[row]), self.heights.row(row), self.attitudes.row(row), place)


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

    def sample(self, parts: Parts, origin: GeoOrigin | None) -> PoseSample:
        """The sample of its parts; what its clock has to say is not in its reasons yet."""
        return self.columns(PartColumns.of(parts), origin).sample(0)

    def columns(self, parts: PartColumns, origin: GeoOrigin | None) -> PoseColumns:
        """The same of many parts."""
        stamps_ns, heights, attitudes, places = parts
        std, still = self._stds(heights.std_m, attitudes), np.zeros((len(stamps_ns), 3))
        position = still.copy()
        position[:, 2] = heights.height_agl_m
        if places is not None:
            position[:, :2] = places.east_north_m
        pose = Pose(
            position_enu_m=position,
            wxyz=attitudes.wxyz,
            cov=pose_covariances(attitudes.wxyz, std),
            velocity_enu_mps=still if places is None else places.velocity_enu_mps,
            rate_cam_radps=attitudes.rate_cam_radps,
            time_std_s=self._time_std_s,
        )
        return PoseColumns(
            stamp_ns=stamps_ns,
            pose=pose,
            std=std,
            lat_lon_alt=None if places is None else places.lat_lon_alt,
            height_age_s=heights.age_s,
            telemetry_age_s=np.maximum(heights.age_s, attitudes.age_s),
            which=attitudes.which,
            alike=tuple(_without_numbers(told, heights, None if places is None else origin) for told in attitudes.told),
        )

    def _stds(self, height_m: FloatArray, attitudes: CameraAttitudes) -> FloatArray:
        """Standard deviations ``(n, 7)`` as in ``PoseStd``."""
        stated = self._settings.attitude.std
        demanded_rad = max(stated.tilt_rad, DEMAND_TILT_STD_RAD)
        tilt_rad = np.array([demanded_rad if told.is_demand else stated.tilt_rad for told in attitudes.told])
        std = np.empty((len(height_m), 7))
        std[:, 0], std[:, 1] = height_m, stated.horizontal_m
        std[:, 2], std[:, 3], std[:, 4] = tilt_rad[attitudes.which], stated.pan_rad, stated.roll_rad
        for axis in range(3):  # Python's own: numpy's differs in the last bit of one in a hundred
            stated_rad, report_rad = std[:, 2 + axis].tolist(), attitudes.report_std_rad[:, axis].tolist()
            std[:, 2 + axis] = list(map(math.hypot, stated_rad, report_rad))
        std[:, 5], std[:, 6] = stated.heading_rad, self._time_std_s
        return std

    def leaves(self, heights: Heights, clock: ClockMap) -> BoolArray:
        """Where ``completed`` leaves samples ``(n,)`` that have a place as they are."""
        is_said = not clock.has_nothing_to_say or self._ground is not None
        return (heights.height_agl_m >= self._settings.height.min_m) & (not is_said)

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


def _without_numbers(told: Told, heights: Heights, origin: GeoOrigin | None) -> PoseSample:
    return PoseSample(
        stamp_ns=0,
        status=Status.OK,
        reasons=(*told.reasons, *heights.reasons),
        origin=origin,
        height_source=heights.source,
        height_datum=heights.datum,
        attitude_source=told.source,
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
