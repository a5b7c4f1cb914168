"""Composition of poses from attitudes, heights and positions, in ENU over the station's ground; or reasons for none."""

from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import Ground, Plane, pose_covariance
from aerodft.model import (
    CODE_OF,
    CODES,
    TIME,
    Batch,
    BoolArray,
    FloatArray,
    GeoOrigin,
    IntArray,
    LevelSeries,
    Pose,
    PoseBatch,
    PoseSample,
    Status,
)
from aerodft.service.attitude import AttitudeBatch
from aerodft.service.clocks import HOST_STD_S, ClockMap
from aerodft.service.gimbal_sources import is_own_statement
from aerodft.service.height_sources import HEIGHT_SOURCES, HeightSettings
from aerodft.service.pose.heights import HeightBatch
from aerodft.service.pose.vehicle_position import PositionBatch
from aerodft.service.settings import DEMAND_TILT_STD_RAD, TelemetrySettings
from aerodft.service.streams import Missing

_ABOVE_ALL_GROUND_M = 1e5  # above all ground
_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, slots=True, eq=False)
class GroundBelow:
    """The ground below ``n`` points.

    Attributes:
        status: ``(n,)`` indices into ``CODES``: ``BEYOND_TERRAIN`` or ``NO_ELEVATION`` where its height is unknown.
        height_m: ``(n,)`` above ENU 0; NaN where it is unknown.
        slope: ``(n, 2)`` rise per metre to the east and to the north; NaN where it is unknown.
    """

    status: IntArray
    height_m: FloatArray
    slope: FloatArray

    @staticmethod
    def what(code: int) -> str:
        """Text for ground of unknown height, by the code of its status."""
        return "a hole in the elevation model" if CODES[code] is Status.NO_ELEVATION else "no more elevation model"


def ground_below(ground: Ground, east_north_m: FloatArray) -> GroundBelow:
    """The ground below ``east_north_m (n, 2)``."""
    start = np.column_stack([east_north_m, np.full(len(east_north_m), _ABOVE_ALL_GROUND_M)])
    hits = ground.meet(start, np.broadcast_to(_DOWN, start.shape).copy(), np.zeros(len(start)))
    slope = -hits.normal_enu[:, :2] / hits.normal_enu[:, 2:]
    return GroundBelow(hits.status.astype(np.int64), hits.points_enu_m[:, 2], slope)


def raised_by_ground(pose: Pose, height_m: FloatArray, slope: FloatArray) -> Pose:
    """Poses ``(n,)`` in ENU from poses with heights above the ground below them.

    On a slope, errors in east and north become errors in height.

    Args:
        pose: Poses whose third position component is the height above that ground.
        height_m: ``(n,)`` of the ground.
        slope: ``(n, 2)`` of the ground.
    """
    by_pose = np.broadcast_to(np.eye(6), (len(height_m), 6, 6)).copy()
    by_pose[:, 2, :2] = slope
    position = pose.position_enu_m.copy()
    position[:, 2] += height_m
    return replace(pose, position_enu_m=position, cov=by_pose @ pose.cov @ by_pose.swapaxes(-1, -2))


def raised(poses: PoseBatch, by_m: FloatArray) -> PoseBatch:
    """Poses ``(n,)`` with their heights raised by ``by_m (n,)``."""
    position = poses.pose.position_enu_m.copy()
    position[:, 2] += by_m
    return replace(poses, pose=replace(poses.pose, position_enu_m=position))


REBOOTED: Final = "the vehicle rebooted: what it had said before is forgotten"
HOME_MOVED: Final = "the vehicle rebooted: home may be elsewhere since, and heights above it count from there"


RECEIVER_CONTRADICTS: Final = (
    "the positions of the receiver (GPS_RAW_INT) and of the estimator (GLOBAL_POSITION_INT) contradict each other: the "
    "place is not stated"
)
HEADINGS_DIFFER: Final = (
    "the vehicle's headings in ATTITUDE and in GLOBAL_POSITION_INT differ: the heading's std covers both"
)


BY_GUESS: Final = "the vehicle has not said what UTC is: the receiving machine's clock is taken for it"
BY_HOST: Final = "the vehicle has not said what UTC is: the stamp is the receiving machine's clock"


def no_position_refusal(missing: Missing, settings: HeightSettings) -> tuple[Status, tuple[str, ...]]:
    """Status and reason of a pose without a position over ground that is not level."""
    status, what = Status.NO_HEIGHT, "no position received yet"
    if missing is Missing.STALE:
        status, what = Status.STALE_TELEMETRY, no_position_reason(settings)
    return status, (f"{what}, and the ground is uneven",)


def no_position_reason(settings: HeightSettings) -> str:
    """Reason for no position where positions come: none around the stamp, or a jump between them."""
    return f"no believable position on both sides of the stamp within {settings.max_gap_ns / SECOND_NS:g} s"


def no_height_reason(missing: Missing, settings: HeightSettings) -> str:
    """Reason for no height."""
    if missing is Missing.NEVER:
        return missing_reason("height", missing, settings.order, settings.max_gap_ns)
    limits = []
    for source in settings.order:
        reader = HEIGHT_SOURCES[source]
        distance_m = reader.max_distance_m(settings)
        within = f"{reader.gap_ns(settings) / SECOND_NS:g} s" + (f" and {distance_m:g} m" if distance_m else "")
        limits.append(f"{within} from {source}")
    return f"no height on both sides of the stamp within {', '.join(limits)}"


def missing_reason(what: str, missing: Missing, order: tuple[str, ...], max_gap_ns: int) -> str:
    """Reason for no value from any of several sources."""
    sources = ", ".join(order)
    if missing is Missing.NEVER:
        return f"no {what} received yet from {sources}"
    return f"no {what} on both sides of the stamp within {max_gap_ns / SECOND_NS:g} s from {sources}"


@dataclass(frozen=True, slots=True, eq=False)
class PoseInputs(Batch):
    """Heights, attitudes and positions for poses at ``n`` stamps.

    Attributes:
        stamps_ns: ``(n,)`` UTC.
        by_utc: ``(n,)`` whether each is UTC, not on this machine's clock.
        heights: Heights.
        attitudes: Attitudes.
        vehicle_position: Positions.
    """

    stamps_ns: IntArray
    by_utc: BoolArray
    heights: HeightBatch
    attitudes: AttitudeBatch
    vehicle_position: PositionBatch

    @property
    def is_pending(self) -> BoolArray:
        """Whether relevant telemetry is pending ``(n,)``."""
        parts = self.heights.missing, self.attitudes.missing, self.vehicle_position.missing
        return np.asarray(np.any([missing == Missing.PENDING for missing in parts], axis=0))

    @property
    def is_complete(self) -> BoolArray:
        """Whether there is a height and an attitude ``(n,)``; a pose may have no position."""
        return np.asarray((self.heights.missing == Missing.NOTHING) & (self.attitudes.missing == Missing.NOTHING))


_Refusals: TypeAlias = dict[int, tuple[Status, tuple[str, ...]]]
"""Status and reasons of refused poses, by row."""


class PoseComposer:
    """Composes poses.

    Args:
        settings: Standard deviations and limits.
        time_std_s: Standard deviation of image stamps relative to telemetry stamps.
        ground: Ground below the camera, for heights above the surface; None for the level plane at 0.
        level: The water's level, for heights that were measured to it; None where it is always 0.
    """

    def __init__(
        self, settings: TelemetrySettings, time_std_s: float, ground: Ground | None, level: LevelSeries | None = None
    ) -> None:
        self._settings = settings
        self._level = level
        self._time_std_s = time_std_s
        self._ground = ground

    def poses(self, inputs: PoseInputs, origin: GeoOrigin | None, clock: ClockMap) -> PoseBatch:
        """Poses from complete inputs ``(n,)``, over the ground, with remarks on the clock."""
        poses = self._compose(inputs, origin)
        poses = self._with_remarks(poses, inputs, clock)
        if self._ground is not None:
            poses = self._over_ground(poses, inputs, self._ground)
        elevation_m = np.zeros(len(poses)) if self._level is None else self._level.elevation_m(inputs.stamps_ns)
        poses = self._check_min_height(poses, inputs.heights, elevation_m)
        return poses if self._level is None else raised(poses, inputs.heights.senses_water * elevation_m)

    def _compose(self, inputs: PoseInputs, origin: GeoOrigin | None) -> PoseBatch:
        """Poses with heights as reported, before the ground below is added."""
        heights, attitudes, vehicle_position = inputs.heights, inputs.attitudes, inputs.vehicle_position
        std, has_place = self._stds(inputs), vehicle_position.missing == Missing.NOTHING
        east_north_m = np.where(has_place[:, None], vehicle_position.east_north_m, 0.0)
        pose = Pose(
            position_enu_m=np.column_stack([east_north_m, heights.height_agl_m]),
            wxyz=attitudes.wxyz,
            cov=pose_covariance(attitudes.wxyz, std),
            velocity_enu_mps=vehicle_position.velocity_enu_mps,
            rate_cam_radps=attitudes.rate_cam_radps,
            time_std_s=np.full(len(std), self._time_std_s),
        )
        keys = zip(attitudes.note.tolist(), heights.source.tolist(), has_place.tolist(), strict=True)
        height_reasons = (heights.reasons.get(row, ()) for row in range(len(std)))
        variant_keys = [(*key, why) for key, why in zip(keys, height_reasons, strict=True)]
        numbers = {key: number for number, key in enumerate(dict.fromkeys(variant_keys))}
        variants = []
        for note_number, source_number, is_placed, reasons in numbers:
            note, source = attitudes.notes[note_number], heights.order[source_number]
            variants.append(
                PoseSample(
                    stamp_ns=0,
                    status=Status.OK,
                    reasons=(*note.reasons, *reasons),
                    origin=origin if is_placed else None,
                    height_source=source,
                    height_datum=HEIGHT_SOURCES[source].datum,
                    attitude_source=note.source,
                )
            )
        return PoseBatch(
            stamp_ns=inputs.stamps_ns,
            pose=pose,
            std=std,
            lat_lon_alt=vehicle_position.lat_lon_alt,
            height_age_s=heights.age_s,
            telemetry_age_s=np.maximum(heights.age_s, attitudes.age_s),
            datum_enu_m=np.zeros(len(std)),
            zoom=np.full((len(std), 2), np.nan),
            level=np.full((len(std), 2), np.nan),
            variant_index=np.array([numbers[key] for key in variant_keys], dtype=np.int64),
            variants=tuple(variants),
        )

    def _stds(self, inputs: PoseInputs) -> FloatArray:
        """Standard deviations ``(n, 7)`` as in ``PoseStd``."""
        stated, height_m, attitudes = self._settings.attitude.std, inputs.heights.std_m, inputs.attitudes
        demanded_rad = max(stated.tilt_rad, DEMAND_TILT_STD_RAD)
        tilt_rad = np.array([demanded_rad if note.is_demand else stated.tilt_rad for note in attitudes.notes])
        std = np.empty((len(height_m), 7))
        position = inputs.vehicle_position
        own_m = np.where(np.isnan(position.std_m), stated.horizontal_m, position.std_m)
        std[:, 0], std[:, 1] = height_m, np.hypot(own_m, position.horizontal_std_m)
        std[:, 2], std[:, 3], std[:, 4] = tilt_rad[attitudes.note], stated.pan_rad, stated.roll_rad
        std[:, 5], std[:, 6] = stated.heading_rad, self._time_std_s
        std[:, 2:6] = np.where(np.isnan(attitudes.stated_std_rad), std[:, 2:6], attitudes.stated_std_rad)
        std[:, 2:5] = np.hypot(std[:, 2:5], attitudes.report_std_rad)
        std[:, 5] = np.hypot(std[:, 5], attitudes.heading_std_rad)
        return std

    def _with_remarks(self, poses: PoseBatch, inputs: PoseInputs, clock: ClockMap) -> PoseBatch:
        """Poses with remarks on the clock behind their stamps, on home and on a missing position."""
        is_home = inputs.heights.is_above_home & clock.has_restarted
        is_stale = inputs.vehicle_position.missing == Missing.STALE
        no_utc = not clock.is_utc_known
        is_contradicted, has_doubt = inputs.vehicle_position.is_contradicted, inputs.attitudes.heading_std_rad > 0
        columns = clock.repeats(inputs.stamps_ns), is_home, is_stale, inputs.by_utc & no_utc, is_contradicted, has_doubt
        no_position = f"{no_position_reason(self._settings.height)}: the place is not stated"

        def with_remarks(sample: PoseSample, key: tuple[bool, ...]) -> PoseSample:
            is_repeated, has_home, has_no_place, is_guess, is_contradicted, has_doubt = key
            remarks = (
                *clock.remarks(is_repeated=is_repeated),
                *((HOME_MOVED,) if has_home else ()),
                *(((RECEIVER_CONTRADICTS if is_contradicted else no_position),) if has_no_place else ()),
                *((HEADINGS_DIFFER,) if has_doubt else ()),
                *(((BY_GUESS if is_guess else BY_HOST),) if no_utc else ()),
            )
            return replace(sample, reasons=(*sample.reasons, *remarks))

        poses = poses.with_variants(list(zip(*(column.tolist() for column in columns), strict=True)), with_remarks)
        if not np.any(columns[3]):
            return poses
        time_s = np.where(columns[3], np.hypot(poses.std[:, TIME], HOST_STD_S), poses.std[:, TIME])
        std = poses.std.copy()
        std[:, TIME] = time_s
        return replace(poses, std=std, pose=replace(poses.pose, time_std_s=time_s))

    def _over_ground(self, poses: PoseBatch, inputs: PoseInputs, ground: Ground) -> PoseBatch:
        """Poses in ENU with the ground below added to heights above it; refused where it is unknown."""
        is_above_home, missing = inputs.heights.is_above_home, inputs.vehicle_position.missing
        # A tilted plane needs no position: its slope is the same everywhere.
        is_unplaced = (missing != Missing.NOTHING) & (is_above_home | (not isinstance(ground, Plane)))
        refusals: _Refusals = {
            row: no_position_refusal(Missing(missing[row]), self._settings.height)
            for row in np.flatnonzero(is_unplaced).tolist()
        }
        rows = np.flatnonzero(~is_unplaced)
        surface_m = poses.pose.position_enu_m[rows, :2] + inputs.heights.foot_m[rows]
        below = ground_below(ground, surface_m)
        is_known = below.status == CODE_OF[Status.OK]
        is_significant = below.status == CODE_OF[Status.BEYOND_TERRAIN]
        for k in np.flatnonzero(is_significant | ~(is_above_home[rows] | is_known)).tolist():
            east, north = surface_m[k].tolist()
            where = f"below the camera, {east:.0f} m east and {north:.0f} m north of the origin"
            reason = f"{where}, is {below.what(below.status[k])}"
            refusals[int(rows[k])] = CODES[below.status[k]], (reason,)
        height_m, slope = np.zeros(len(poses)), np.zeros((len(poses), 2))
        is_raised = ~is_above_home[rows] & is_known
        height_m[rows[is_raised]], slope[rows[is_raised]] = below.height_m[is_raised], below.slope[is_raised]
        pose = raised_by_ground(poses.pose, height_m, slope)
        if refusals:
            refused_rows = list(refusals)
            position_enu_m, wxyz, cov = pose.position_enu_m.copy(), pose.wxyz.copy(), pose.cov.copy()
            position_enu_m[refused_rows] = wxyz[refused_rows] = cov[refused_rows] = np.nan
            pose = replace(pose, position_enu_m=position_enu_m, wxyz=wxyz, cov=cov)
        return _with_refusals(replace(poses, pose=pose, datum_enu_m=height_m), refusals)

    def _check_min_height(self, poses: PoseBatch, heights: HeightBatch, elevation_m: FloatArray) -> PoseBatch:
        """The poses, those below the minimum height over the measured plane refused; its elevations are ``(n,)``."""
        minimum_m = self._settings.height.min_m
        over_plane_m = heights.height_agl_m - ~heights.senses_water * elevation_m
        is_low = (over_plane_m < minimum_m) & (poses.status == CODE_OF[Status.OK])
        refusals: _Refusals = {}
        for row in np.flatnonzero(is_low).tolist():
            source, height_m = heights.order[heights.source[row]], over_plane_m[row]
            reason = f"{source} says {height_m:.2f} m, the minimum is {minimum_m:g} m"
            refusals[row] = Status.BELOW_MIN_HEIGHT, (reason,)
        return _with_refusals(poses, refusals)


def _with_refusals(poses: PoseBatch, refusals: _Refusals) -> PoseBatch:
    """Poses with status and reasons of their refusals."""
    if not refusals:
        return poses
    return poses.with_variants(
        [refusals.get(row) for row in range(len(poses))],
        lambda sample, refusal: replace(sample, status=refusal[0], reasons=refusal[1]),
    )


def missing_poses(
    inputs: PoseInputs, settings: TelemetrySettings, clock: ClockMap, has_begun: BoolArray
) -> list[PoseSample]:
    """Refused poses at stamps ``(n,)`` with incomplete inputs.

    Args:
        inputs: Inputs without height or attitude.
        settings: Limits for the reasons.
        clock: The vehicle's clock map.
        has_begun: ``(n,)`` whether there was any telemetry by the stamp.
    """
    dropped, limits = clock.broken_off(), settings.attitude
    reporting = tuple(source for source in limits.order if not is_own_statement(source)) or limits.order
    samples = []
    for row, stamp_ns in enumerate(inputs.stamps_ns.tolist()):
        height, attitude = Missing(inputs.heights.missing[row]), Missing(inputs.attitudes.missing[row])
        reasons: list[str] = []
        if height is Missing.REFUSED:
            reasons += inputs.heights.refusals[row]
        elif height is not Missing.NOTHING:
            reasons.append(no_height_reason(height, settings.height))
        if attitude is Missing.REFUSED:
            reasons.append(inputs.attitudes.refusals[row])
        elif attitude is not Missing.NOTHING:
            reasons.append(missing_reason("camera attitude", attitude, reporting, limits.max_gap_ns))
        if dropped is not None:
            status, reasons = Status.CLOCK_JUMPED, [dropped, *reasons]
        elif not has_begun[row]:
            status = Status.NO_TELEMETRY
            reasons = [*([REBOOTED] if clock.has_restarted else []), *reasons]
        elif height is Missing.REFUSED:
            status = Status.UNHEALTHY
        elif Missing.STALE in (height, attitude):
            status = Status.STALE_TELEMETRY
        else:
            status = Status.NO_HEIGHT if height is Missing.NEVER else Status.NO_ATTITUDE
        samples.append(PoseSample(stamp_ns=stamp_ns, status=status, reasons=tuple(reasons)))
    return samples
