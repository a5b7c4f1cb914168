"""What tells a camera's attitude at a stamp, and the attitudes that many such readings come to at once."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np

from aerodft.conventions import GIMBAL_SO3_CAM_WXYZ, SECOND_NS
from aerodft.geometry import (
    Brackets,
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
from aerodft.model import FloatArray, GimbalSource, IntArray, MountAxes, ReportFrame
from aerodft.service.attitude.servo_mount import mounted_wxyz
from aerodft.service.attitude.slew import Demands, lag_std, step_std
from aerodft.service.settings import DEMAND_TILT_STD_RAD, AttitudeSettings, FixedMount
from aerodft.service.streams import Missing

_CAM_FROM_STRAIGHT: Final = matrix(inverse(np.array(GIMBAL_SO3_CAM_WXYZ)))  # of a camera that looks along x
_USUAL_TILT_RAD: Final = math.radians(5)  # of a vehicle that does not report its attitude
_LEFT_OUT: Final = 0.05  # the chance of what lies outside a 95 % interval


@dataclass(frozen=True, slots=True)
class RotatingFrame:
    """Attitudes that change.

    Attributes:
        wxyz: ``(n, 4)`` ``ref_SO3_moving``.
        rate_radps: ``(n, 3)`` angular rates in the moving axes.
    """

    wxyz: FloatArray
    rate_radps: FloatArray

    def compose(self, other: "RotatingFrame") -> "RotatingFrame":
        """``other``, which is against this one's moving axes, against this one's reference."""
        rate = other.rate_radps + rotate(matrix(inverse(other.wxyz)), self.rate_radps)
        return RotatingFrame(multiply(self.wxyz, other.wxyz), rate)


@dataclass(frozen=True, slots=True)
class AttitudeBrackets:
    """Two samples around each of ``n`` stamps.

    Attributes:
        before: ``(n, 4)`` attitudes.
        after: ``(n, 4)``; the same where a sample is at the stamp itself.
        weight: ``(n,)`` of the later one.
        gap_ns: ``(n,)`` between the two.
    """

    before: FloatArray
    after: FloatArray
    weight: FloatArray
    gap_ns: IntArray

    @classmethod
    def of(cls, wxyz: FloatArray, found: Brackets) -> "AttitudeBrackets":
        """The samples around stamps, of a stream's ``wxyz (m, 4)`` and the brackets found in it."""
        return cls(*found.ends(wxyz), found.weight, found.gap_ns)

    def between(self) -> RotatingFrame:
        """The attitudes at the stamps."""
        return RotatingFrame(slerp(self.before, self.after, self.weight), _rate(self.before, self.after, self.gap_ns))


def on_mount(
    report: AttitudeBrackets, axes: MountAxes, vehicle: AttitudeBrackets | None, *, yaw_in_earth: bool
) -> AttitudeBrackets:
    """Reports' angles as attitudes, as in ``mounted_wxyz``, each with the vehicle's sample on its side of the stamp."""
    if vehicle is None:
        return report
    before, after = (
        mounted_wxyz(wxyz, axes, body, yaw_in_earth=yaw_in_earth)
        for wxyz, body in ((report.before, vehicle.before), (report.after, vehicle.after))
    )
    return replace(report, before=before, after=after)


def reference_attitude(vehicle: AttitudeBrackets, frame: ReportFrame, *, yaw_in_earth: bool) -> RotatingFrame:
    """What gimbals' reports are against, in NED.

    Args:
        vehicle: The vehicle's attitudes ``ned_SO3_body``.
        frame: What the reports' roll and pitch are against.
        yaw_in_earth: Whether their yaw is against north, else against the vehicle's heading.

    Returns:
        The vehicle's heading, its attitude, or its attitude without the heading; with a rate from the two samples.
    """
    at_stamp = slerp(vehicle.before, vehicle.after, vehicle.weight)
    ends = np.stack([vehicle.before, at_stamp, vehicle.after])
    before, at, after = reference_wxyz(ends, frame, yaw_in_earth=yaw_in_earth)
    return RotatingFrame(at, _rate(before, after, vehicle.gap_ns))


def reference_wxyz(ned_wxyz_body: FloatArray, frame: ReportFrame, *, yaw_in_earth: bool) -> FloatArray:
    """What a report is against ``(..., 4)`` as in ``reference_attitude``, of attitudes ``(..., 4)``."""
    heading = heading_of(ned_wxyz_body)
    if frame is ReportFrame.EARTH:
        return multiply(heading, inverse(heading)) if yaw_in_earth else heading
    return multiply(ned_wxyz_body, inverse(heading)) if yaw_in_earth else ned_wxyz_body


def heading_of(ned_wxyz_body: FloatArray) -> FloatArray:
    """The vehicle's heading alone, as a rotation about the vertical; ``(..., 4)`` of ``(..., 4)``."""
    return from_yaw_pitch_roll(yaw_pitch_roll(ned_wxyz_body)[0], 0.0, 0.0)


def _rate(before_wxyz: FloatArray, after_wxyz: FloatArray, gap_ns: IntArray) -> FloatArray:
    """Angular rates ``(n, 3)`` (rad/s) in the moving frame's own axes between two samples."""
    per_s = np.where(gap_ns > 0, SECOND_NS / np.maximum(gap_ns, 1), 0.0)
    return np.asarray(to_rotation_vector(multiply(inverse(before_wxyz), after_wxyz)) * per_s[:, None])


class AttitudeNote(NamedTuple):
    """What an attitude says besides its numbers.

    Attributes:
        source: Where it came from.
        is_demand: Whether the report may be what the gimbal was told, not what it did.
        reasons: What was corrected, or is not known of the report.
    """

    source: GimbalSource
    is_demand: bool
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeBatch:
    """Where the camera looks at ``n`` stamps.

    Attributes:
        wxyz: ``(n, 4)`` ``enu_SO3_cam``.
        rate_cam_radps: ``(n, 3)`` angular rate in camera axes.
        age_s: ``(n,)`` distance in time to the nearest sample used.
        report_std_rad: ``(n, 3)`` about the camera's axes, beside the settings': how far off the report may be at this
            stamp, because it jumps, leads the camera, or may be against the vehicle.
        note: ``(n,)`` which of ``notes`` belongs to each; -1 where there is no attitude.
        notes: What attitudes say besides their numbers.
        missing: ``(n,)`` why there is none, as ``Missing``.
        refusals: By row, why reports cannot be believed, in a sentence.
    """

    wxyz: FloatArray
    rate_cam_radps: FloatArray
    age_s: FloatArray
    report_std_rad: FloatArray
    note: IntArray
    notes: tuple[AttitudeNote, ...]
    missing: IntArray
    refusals: dict[int, str]

    @staticmethod
    def none(count: int) -> "AttitudeBatch":
        """``count`` stamps without an attitude."""
        wxyz, rate, std = np.full((count, 4), np.nan), np.full((count, 3), np.nan), np.full((count, 3), np.nan)
        note, missing = np.full(count, -1), np.full(count, int(Missing.NEVER))
        return AttitudeBatch(wxyz, rate, np.full(count, np.nan), std, note, (), missing, {})

    @staticmethod
    def known(
        wxyz: FloatArray,
        rate: FloatArray,
        age_s: FloatArray,
        std: FloatArray,
        note: IntArray,
        notes: Sequence[AttitudeNote],
    ) -> "AttitudeBatch":
        """Attitudes at all of ``n`` stamps."""
        missing = np.full(len(wxyz), int(Missing.NOTHING))
        return AttitudeBatch(wxyz, rate, age_s, std, note, tuple(notes), missing, {})

    def put(self, rows: IntArray, others: "AttitudeBatch") -> "AttitudeBatch":
        """With ``others`` written into some rows ``(m,)`` of these arrays."""
        for name in ("wxyz", "rate_cam_radps", "age_s", "report_std_rad"):
            getattr(self, name)[rows] = getattr(others, name)
        self.note[rows] = others.note + len(self.notes)
        return replace(self, notes=(*self.notes, *others.notes))

    def rows(self, rows: IntArray) -> "AttitudeBatch":
        """Attitudes by their indices ``(m,)``."""
        numbers = self.wxyz[rows], self.rate_cam_radps[rows], self.age_s[rows], self.report_std_rad[rows]
        refusals = {new: self.refusals[old] for new, old in enumerate(rows.tolist()) if old in self.refusals}
        return AttitudeBatch(*numbers, self.note[rows], self.notes, self.missing[rows], refusals)


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """What tells a camera's attitude at ``n`` stamps, in one way.

    Attributes:
        source: Where it comes from.
        age_s: ``(n,)`` distance in time to the nearest sample used.
        report: The gimbal's ``ref_SO3_gimbal`` around the stamps; None without a gimbal.
        previous: ``(n, 4)`` the reports before those; NaN where there is none.
        vehicle: The vehicle's ``ned_SO3_body``; None where it is not known, and not needed.
        frame: What the reports' roll and pitch are taken to be against.
        axes: What the reports' angles are taken to come to, as in ``mounted_wxyz``; against the horizon Euler angles.
        yaw_in_earth: Whether their yaw is against north.
        demands: What was demanded before, and these attitudes ``(k, 4)``; None where these are no demands.
        is_body_found: Whether what the reports are against was found, not stated, and is the vehicle.
        probabilities: ``(n,)`` by frame and mount, how likely each reading of the reports is.
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
    """Turns readings into attitudes."""

    def __init__(self, settings: AttitudeSettings) -> None:
        self._settings = settings
        self._camera = _mounted(settings.camera_on_gimbal)

    def attitudes(self, readings: Readings) -> AttitudeBatch:
        """The attitudes that readings come to."""
        if readings.report is None:
            return self._on_fixed_mount(readings)
        return self._on_gimbal(readings, readings.report)

    def _on_fixed_mount(self, readings: Readings) -> AttitudeBatch:
        """Cameras that are bolted to the vehicle."""
        assert readings.vehicle is not None  # noqa: S101 - the callers' own condition, for the type checker
        bolted = readings.vehicle.between().compose(_mounted(self._settings.fixed_mount))
        wxyz, rate = _camera_axes(bolted)
        note = np.zeros(len(wxyz), dtype=np.int64)
        notes = (AttitudeNote(readings.source, is_demand=False, reasons=()),)
        return AttitudeBatch.known(wxyz, rate, readings.age_s, np.zeros((len(wxyz), 3)), note, notes)

    def _on_gimbal(self, readings: Readings, report: AttitudeBrackets) -> AttitudeBatch:
        """Cameras on gimbals."""
        looking = _looking(readings, report, readings.frame, readings.axes)
        doubt = _doubt_std(readings, report, looking)
        slew = self._report_std(readings, report)
        std = np.hypot(slew, doubt)
        cam_from_gimbal = _CAM_FROM_STRAIGHT @ matrix(inverse(self._camera.wxyz[0]))
        stds = np.sqrt(rotate(cam_from_gimbal**2, std**2))
        wxyz, rate = _camera_axes(looking.compose(self._camera))
        return AttitudeBatch.known(wxyz, rate, readings.age_s, stds, *self._notes(readings, doubt, slew))

    def _report_std(self, readings: Readings, report: AttitudeBrackets) -> FloatArray:
        """How far cameras may be from their reports ``(n, 3)``, in gimbal axes, because these jump or lead."""
        assert readings.previous is not None  # noqa: S101 - goes with the report
        own = on_mount(report, readings.axes, readings.vehicle, yaw_in_earth=readings.yaw_in_earth)
        earlier = replace(report, after=readings.previous)
        previous = on_mount(earlier, readings.axes, readings.vehicle, yaw_in_earth=readings.yaw_in_earth).after
        step = step_std(previous, own.before, own.after, own.weight)
        if readings.demands is None:
            return np.abs(step)
        at_stamp = slerp(own.before, own.after, own.weight)
        return np.hypot(step, lag_std(*readings.demands, at_stamp, self._settings.slew_radps))

    def _notes(
        self, readings: Readings, doubt: FloatArray, slew: FloatArray
    ) -> tuple[IntArray, tuple[AttitudeNote, ...]]:
        """What was corrected, or is not known, by standard deviations ``(n, 3)``; a turn counts from its own std on.

        Returns:
            Which of the notes ``(n,)``, and these.
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
        is_doubtful = np.max(doubt, axis=1) > stated_rad
        is_turning = np.max(slew, axis=1) > max(stated_rad, DEMAND_TILT_STD_RAD)
        notes = tuple(
            AttitudeNote(
                source,
                readings.demands is not None,
                (*((added,) if added else ()), *((unknown,) if doubts else ()), *((turning,) if turns else ())),
            )
            for doubts in (False, True)
            for turns in (False, True)
        )
        return 2 * is_doubtful + is_turning, notes


def _looking(readings: Readings, report: AttitudeBrackets, frame: ReportFrame, axes: MountAxes) -> RotatingFrame:
    """Gimbals' attitudes in NED, if reports are read in one way."""
    vehicle, in_earth = readings.vehicle, readings.yaw_in_earth
    looking = on_mount(report, axes, vehicle, yaw_in_earth=in_earth).between()
    if vehicle is None or (in_earth and frame is ReportFrame.EARTH):
        return looking
    return reference_attitude(vehicle, frame, yaw_in_earth=in_earth).compose(looking)


def _doubt_std(readings: Readings, report: AttitudeBrackets, looking: RotatingFrame) -> FloatArray:
    """Standard deviations ``(n, 3)`` in gimbal axes of reading reports in one way where they may be meant in others.

    At least half of what another is apart that is likelier than what a 95 % interval may leave out: it reaches there.
    """
    variance = np.zeros((len(looking.wxyz), 3))
    least = np.zeros_like(variance)
    for (frame, axes), probability in readings.probabilities.items():
        if (frame, axes) == (readings.frame, readings.axes) or not np.any(probability):
            continue
        apart_rad = np.full(variance.shape, _USUAL_TILT_RAD)
        if readings.vehicle is not None:
            other = _looking(readings, report, frame, axes)
            apart_rad = to_rotation_vector(multiply(inverse(looking.wxyz), other.wxyz))
        squared = apart_rad**2 * (probability > 0)[:, None]
        variance += probability[:, None] * squared
        least = np.maximum(least, np.where((probability > _LEFT_OUT)[:, None], squared / 4, 0.0))
    return np.sqrt(np.maximum(variance, least))


def _mounted(mount: FixedMount | None) -> RotatingFrame:
    """The camera on what it is bolted to."""
    if mount is None:
        return RotatingFrame(np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)))
    return RotatingFrame(from_yaw_pitch_roll([mount.yaw_rad], mount.pitch_rad, mount.roll_rad), np.zeros((1, 3)))


def _camera_axes(straight: RotatingFrame) -> tuple[FloatArray, FloatArray]:
    """``enu_SO3_cam (n, 4)`` and rates ``(n, 3)`` in camera axes of cameras that look along x, in NED."""
    return camera_from_gimbal(straight.wxyz), rotate(_CAM_FROM_STRAIGHT, straight.rate_radps)
