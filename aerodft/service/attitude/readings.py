"""Camera attitudes at stamps from readings: gimbal reports interpreted in one way, or a fixed mount."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np

from aerodft.conventions import GIMBAL_SO3_CAM_WXYZ, SECOND_NS
from aerodft.geometry import (
    about_axis,
    camera_from_gimbal,
    from_yaw_pitch_roll,
    inverse,
    matrix,
    multiply,
    rotate,
    slerp,
    to_rotation_vector,
    yaw_pitch_roll,
)
from aerodft.model import Batch, FloatArray, GimbalSource, IntArray, MountAxes, ReportFrame, Selection
from aerodft.service.attitude.mounts import GIMBAL_MOUNTS
from aerodft.service.attitude.slew import Demands, lag_std, step_std
from aerodft.service.settings import DEMAND_TILT_STD_RAD, AttitudeSettings, FixedMount
from aerodft.service.streams import Brackets, Missing

_CAM_FROM_GIMBAL: Final = matrix(inverse(np.array(GIMBAL_SO3_CAM_WXYZ)))
_TYPICAL_TILT_RAD: Final = math.radians(5)  # of a vehicle that does not report its attitude
_MIN_PROBABILITY: Final = 0.05  # of a reading that the 95 % interval must reach


@dataclass(frozen=True, slots=True)
class RotatingFrame:
    """Attitudes with angular rates.

    Attributes:
        wxyz: ``(n, 4)`` ``ref_SO3_moving``.
        rate_radps: ``(n, 3)`` angular rates in the moving axes.
    """

    wxyz: FloatArray
    rate_radps: FloatArray

    def compose(self, other: "RotatingFrame") -> "RotatingFrame":
        """Attitude and rate of ``other``, given in this frame's moving axes, relative to this frame's reference."""
        rate = other.rate_radps + rotate(matrix(inverse(other.wxyz)), self.rate_radps)
        return RotatingFrame(multiply(self.wxyz, other.wxyz), rate)


@dataclass(frozen=True, slots=True)
class AttitudeBrackets:
    """Two attitude samples around each of ``n`` stamps.

    Attributes:
        before: ``(n, 4)`` attitudes.
        after: ``(n, 4)``; equal to ``before`` where a sample is at the stamp.
        weight: ``(n,)`` of the later one.
        gap_ns: ``(n,)`` between the two.
    """

    before: FloatArray
    after: FloatArray
    weight: FloatArray
    gap_ns: IntArray

    @classmethod
    def from_brackets(cls, wxyz: FloatArray, found: Brackets) -> "AttitudeBrackets":
        """From a stream's ``wxyz (m, 4)`` and its brackets."""
        return cls(*found.ends(wxyz), found.weight, found.gap_ns)

    def at_stamps(self) -> FloatArray:
        """Attitudes ``(n, 4)`` interpolated at the stamps."""
        return slerp(self.before, self.after, self.weight)

    def between(self) -> RotatingFrame:
        """Attitudes interpolated at the stamps, with rates."""
        return RotatingFrame(self.at_stamps(), _rate(self.before, self.after, self.gap_ns))


def on_mount(
    report: AttitudeBrackets, axes: MountAxes, vehicle: AttitudeBrackets | None, *, yaw_in_earth: bool
) -> AttitudeBrackets:
    """Attitudes from reported servo angles, see ``Mount.camera_wxyz``, each with the vehicle's sample on its side."""
    mount = GIMBAL_MOUNTS[axes]
    if vehicle is None or mount.is_euler:
        return report
    reported, bodies = (np.concatenate([each.before, each.after]) for each in (report, vehicle))
    before, after = np.split(mount.camera_wxyz(reported, bodies, yaw_in_earth=yaw_in_earth), 2)
    return replace(report, before=before, after=after)


def reference_attitude(vehicle: AttitudeBrackets, frame: ReportFrame, *, yaw_in_earth: bool) -> RotatingFrame:
    """Reference of gimbals' reports, in NED.

    Args:
        vehicle: The vehicle's attitudes ``ned_SO3_body``.
        frame: Reference of the reports' roll and pitch.
        yaw_in_earth: Whether their yaw is relative to north, else to the vehicle's heading.

    Returns:
        The vehicle's heading, its attitude, or its attitude without the heading; with a rate from the two samples.
    """
    ends = np.stack([vehicle.before, vehicle.at_stamps(), vehicle.after])
    before, at, after = reference_wxyz(ends, frame, yaw_in_earth=yaw_in_earth)
    return RotatingFrame(at, _rate(before, after, vehicle.gap_ns))


def reference_wxyz(ned_wxyz_body: FloatArray, frame: ReportFrame, *, yaw_in_earth: bool) -> FloatArray:
    """Reference of a report ``(..., 4)``, as in ``reference_attitude``, from attitudes ``(..., 4)``."""
    heading = heading_of(ned_wxyz_body)
    if frame is ReportFrame.EARTH:
        return multiply(heading, inverse(heading)) if yaw_in_earth else heading
    return multiply(ned_wxyz_body, inverse(heading)) if yaw_in_earth else ned_wxyz_body


def heading_of(ned_wxyz_body: FloatArray) -> FloatArray:
    """The vehicle's heading ``(..., 4)`` as a rotation about the vertical, from attitudes ``(..., 4)``."""
    return about_axis(2, yaw_pitch_roll(ned_wxyz_body)[0])


def _rate(before_wxyz: FloatArray, after_wxyz: FloatArray, gap_ns: IntArray) -> FloatArray:
    """Angular rates ``(n, 3)`` (rad/s) between two samples, in the moving axes."""
    per_s = np.where(gap_ns > 0, SECOND_NS / np.maximum(gap_ns, 1), 0.0)
    return np.asarray(to_rotation_vector(multiply(inverse(before_wxyz), after_wxyz)) * per_s[:, None])


class AttitudeNote(NamedTuple):
    """Source and remarks of an attitude.

    Attributes:
        source: The source.
        is_demand: Whether the report may be a demand, not a measurement.
        reasons: Corrections and unknowns of the report.
    """

    source: GimbalSource
    is_demand: bool
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeBatch(Batch):
    """Camera attitudes at ``n`` stamps.

    Attributes:
        wxyz: ``(n, 4)`` ``enu_SO3_cam``.
        rate_cam_radps: ``(n, 3)`` angular rate in camera axes.
        age_s: ``(n,)`` time to the nearest sample used.
        report_std_rad: ``(n, 3)`` about the camera's axes, in addition to the settings': of a report that jumps, leads
            the camera, or may be relative to the vehicle.
        stated_std_rad: ``(n, 4)`` of tilt, pan, roll, heading, in place of the settings'; NaN where reports have none.
        note: ``(n,)`` indices into ``notes``; -1 where there is no attitude.
        notes: Sources and remarks.
        missing: ``(n,)`` as ``Missing``.
        refusals: By row, a sentence on why reports are rejected.
        heading_std_rad: ``(n,)`` of the heading, in addition to the settings': the vehicle's messages differ.
    """

    wxyz: FloatArray
    rate_cam_radps: FloatArray
    age_s: FloatArray
    report_std_rad: FloatArray
    stated_std_rad: FloatArray
    note: IntArray
    notes: tuple[AttitudeNote, ...]
    missing: IntArray
    refusals: dict[int, str]
    heading_std_rad: FloatArray

    @staticmethod
    def missing_all(count: int) -> "AttitudeBatch":
        """A batch of ``count`` stamps without an attitude."""
        wxyz, rate, std = np.full((count, 4), np.nan), np.full((count, 3), np.nan), np.full((count, 3), np.nan)
        note, missing = np.full(count, -1), np.full(count, int(Missing.NEVER))
        age_s, stated = np.full(count, np.nan), np.full((count, 4), np.nan)
        return AttitudeBatch(wxyz, rate, age_s, std, stated, note, (), missing, {}, np.zeros(count))

    @staticmethod
    def complete(
        wxyz: FloatArray,
        rate: FloatArray,
        age_s: FloatArray,
        std: FloatArray,
        note: IntArray,
        notes: Sequence[AttitudeNote],
    ) -> "AttitudeBatch":
        """A batch with attitudes at all ``n`` stamps."""
        missing = np.full(len(wxyz), int(Missing.NOTHING))
        stated, heading_std = np.full((len(wxyz), 4), np.nan), np.zeros(len(wxyz))
        return AttitudeBatch(wxyz, rate, age_s, std, stated, note, tuple(notes), missing, {}, heading_std)

    def put(self, rows: IntArray, others: "AttitudeBatch") -> "AttitudeBatch":
        """Write ``others`` into rows ``(m,)`` of these arrays; returns the batch with their notes."""
        for name in ("wxyz", "rate_cam_radps", "age_s", "report_std_rad", "stated_std_rad"):
            getattr(self, name)[rows] = getattr(others, name)
        self.note[rows] = others.note + len(self.notes)
        return replace(self, notes=(*self.notes, *others.notes))

    def rows(self, rows: Selection) -> "AttitudeBatch":
        """Attitudes ``(m,)`` of a selection."""
        old_rows = np.arange(len(self.note))[rows].tolist()
        refusals = {new: self.refusals[old] for new, old in enumerate(old_rows) if old in self.refusals}
        return replace(Batch.rows(self, rows), refusals=refusals)


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """One way to read reports, or a fixed mount, at ``n`` stamps.

    Attributes:
        source: The source.
        age_s: ``(n,)`` time to the nearest sample used.
        report: The gimbal's ``ref_SO3_gimbal`` around the stamps; None without a gimbal.
        previous: ``(n, 4)`` the reports before those; NaN where there is none.
        vehicle: The vehicle's ``ned_SO3_body``; None where unknown and not needed.
        frame: Assumed reference of the reports' roll and pitch.
        axes: Assumed servo order, of ``GIMBAL_MOUNTS``; Euler angles if relative to the horizon.
        yaw_in_earth: Whether the reports' yaw is relative to north.
        demands: Earlier demands and their attitudes ``(k, 4)``; None where reports are measurements.
        is_body_found: Whether the frame was decided from the data, not configured, and is the vehicle.
        probabilities: ``(n,)`` probability of each reading, by frame and mount.
    """

    source: GimbalSource
    age_s: FloatArray
    report: AttitudeBrackets | None = None
    previous: FloatArray | None = None
    vehicle: AttitudeBrackets | None = None
    frame: ReportFrame = ReportFrame.EARTH
    axes: MountAxes = MountAxes.TILT_OUTER
    yaw_in_earth: bool = True
    demands: tuple[Demands, FloatArray] | None = None
    is_body_found: bool = False
    probabilities: Mapping[tuple[ReportFrame, MountAxes], FloatArray] = field(default_factory=dict)


class Resolver:
    """Computes attitudes from readings."""

    def __init__(self, settings: AttitudeSettings) -> None:
        self._settings = settings
        self._camera = _mount_rotation(settings.camera_on_gimbal)
        self._squared_axes = (_CAM_FROM_GIMBAL @ matrix(inverse(self._camera.wxyz[0]))) ** 2  # camera from gimbal

    def attitudes(self, readings: Readings) -> AttitudeBatch:
        """Camera attitudes from readings."""
        if readings.report is None:
            return self._on_fixed_mount(readings)
        return self._on_gimbal(readings, readings.report)

    def _on_fixed_mount(self, readings: Readings) -> AttitudeBatch:
        """Attitudes of cameras fixed to the vehicle."""
        assert readings.vehicle is not None  # noqa: S101 - the callers' own condition, for the type checker
        attitude = readings.vehicle.between().compose(_mount_rotation(self._settings.fixed_mount))
        wxyz, rate = _to_camera(attitude)
        note = np.zeros(len(wxyz), dtype=np.int64)
        notes = (AttitudeNote(readings.source, is_demand=False, reasons=()),)
        return AttitudeBatch.complete(wxyz, rate, readings.age_s, np.zeros((len(wxyz), 3)), note, notes)

    def _on_gimbal(self, readings: Readings, report: AttitudeBrackets) -> AttitudeBatch:
        """Attitudes of cameras on gimbals."""
        attitude = _attitude(readings, report, readings.frame, readings.axes)
        ambiguity = _ambiguity_std(readings, report, attitude)
        motion_std = self._report_std(readings, report)
        std = np.hypot(motion_std, ambiguity)
        stds = np.sqrt(rotate(self._squared_axes, std**2))
        wxyz, rate = _to_camera(attitude.compose(self._camera))
        return AttitudeBatch.complete(wxyz, rate, readings.age_s, stds, *self._notes(readings, ambiguity, motion_std))

    def _report_std(self, readings: Readings, report: AttitudeBrackets) -> FloatArray:
        """Standard deviations ``(n, 3)`` of cameras from reports that jump or lead, in gimbal axes."""
        assert readings.previous is not None  # noqa: S101 - goes with the report
        on_axes = on_mount(report, readings.axes, readings.vehicle, yaw_in_earth=readings.yaw_in_earth)
        earlier = replace(report, after=readings.previous)
        previous = on_mount(earlier, readings.axes, readings.vehicle, yaw_in_earth=readings.yaw_in_earth).after
        step = step_std(previous, on_axes.before, on_axes.after, on_axes.weight)
        if readings.demands is None:
            return np.abs(step)
        return np.hypot(step, lag_std(*readings.demands, on_axes.at_stamps(), self._settings.slew_radps))

    def _notes(
        self, readings: Readings, ambiguity: FloatArray, motion_std: FloatArray
    ) -> tuple[IntArray, tuple[AttitudeNote, ...]]:
        """Remarks on corrections and unknowns, by standard deviations ``(n, 3)`` that exceed the configured one.

        Returns:
            Indices ``(n,)`` into the notes, and the notes.
        """
        source, stated_rad = readings.source, self._settings.std.tilt_rad
        if readings.is_body_found:
            added = f"{source} is body-frame (against the vehicle, not the horizon): the vehicle's attitude was added"
        else:
            added = ""
        unknown = (
            f"which servo of the mount carries the other is not known yet: the std of {source} covers both"
            if readings.is_body_found or self._settings.frame is ReportFrame.BODY
            else f"whether {source} is earth-frame or body-frame is not known yet: the std covers both"
        )
        turning = f"the gimbal may still be turning to what {source} says: the std covers its way there"
        is_ambiguous_at = np.max(ambiguity, axis=1) > stated_rad
        is_moving_at = np.max(motion_std, axis=1) > max(stated_rad, DEMAND_TILT_STD_RAD)
        notes = tuple(
            AttitudeNote(
                source,
                readings.demands is not None,
                (*((added,) if added else ()), *((unknown,) if unsure else ()), *((turning,) if moves else ())),
            )
            for unsure in (False, True)
            for moves in (False, True)
        )
        return 2 * is_ambiguous_at + is_moving_at, notes


def _attitude(readings: Readings, report: AttitudeBrackets, frame: ReportFrame, axes: MountAxes) -> RotatingFrame:
    """Gimbals' attitudes in NED, from reports read in one way."""
    vehicle, in_earth = readings.vehicle, readings.yaw_in_earth
    attitude = on_mount(report, axes, vehicle, yaw_in_earth=in_earth).between()
    if vehicle is None or (in_earth and frame is ReportFrame.EARTH):
        return attitude
    return reference_attitude(vehicle, frame, yaw_in_earth=in_earth).compose(attitude)


def _wxyz(readings: Readings, report: AttitudeBrackets, frame: ReportFrame, axes: MountAxes) -> FloatArray:
    """The attitudes ``(n, 4)`` of ``_attitude``."""
    vehicle, in_earth = readings.vehicle, readings.yaw_in_earth
    wxyz = on_mount(report, axes, vehicle, yaw_in_earth=in_earth).at_stamps()
    if vehicle is None or (in_earth and frame is ReportFrame.EARTH):
        return wxyz
    return multiply(reference_wxyz(vehicle.at_stamps(), frame, yaw_in_earth=in_earth), wxyz)


def _ambiguity_std(readings: Readings, report: AttitudeBrackets, attitude: RotatingFrame) -> FloatArray:
    """Standard deviations ``(n, 3)`` in gimbal axes of one reading of reports where others are possible.

    At least half of the difference to any reading that is likelier than 5 %, so that the 95 % interval reaches it.
    """
    variance = np.zeros((len(attitude.wxyz), 3))
    min_variance = np.zeros_like(variance)
    for (frame, axes), probability in readings.probabilities.items():
        if (frame, axes) == (readings.frame, readings.axes) or not np.any(probability):
            continue
        difference_rad = np.full(variance.shape, _TYPICAL_TILT_RAD)
        if readings.vehicle is not None:
            other = _wxyz(readings, report, frame, axes)
            difference_rad = to_rotation_vector(multiply(inverse(attitude.wxyz), other))
        squared = difference_rad**2 * (probability > 0)[:, None]
        variance += probability[:, None] * squared
        min_variance = np.maximum(min_variance, np.where((probability > _MIN_PROBABILITY)[:, None], squared / 4, 0.0))
    return np.sqrt(np.maximum(variance, min_variance))


def _mount_rotation(mount: FixedMount | None) -> RotatingFrame:
    """Rotation of the camera on the body that it is fixed to."""
    if mount is None:
        return RotatingFrame(np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)))
    return RotatingFrame(from_yaw_pitch_roll([mount.yaw_rad], mount.pitch_rad, mount.roll_rad), np.zeros((1, 3)))


def _to_camera(gimbal: RotatingFrame) -> tuple[FloatArray, FloatArray]:
    """``enu_SO3_cam (n, 4)`` and rates ``(n, 3)`` in camera axes, of cameras that look along the gimbal's x in NED."""
    return camera_from_gimbal(gimbal.wxyz), rotate(_CAM_FROM_GIMBAL, gimbal.rate_radps)
