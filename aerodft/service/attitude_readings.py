"""What tells a camera's attitude at a stamp, and the attitudes that many such readings come to at once."""

import math
from collections.abc import Sequence
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
    slerp,
    to_rotation_vector,
    turned,
)
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import GimbalSource
from aerodft.model.telemetry import ReportFrame
from aerodft.service.carried import Ends, Turning, carrier, heading_of
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.settings import DEMAND_TILT_STD_RAD, AttitudeSettings, FixedMount
from aerodft.service.slew import Demands, jump_std, lag_std

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What tells a camera's attitude at one stamp.

    Attributes:
        source: Where it comes from.
        age_s: Distance in time to the nearest sample used.
        report: The gimbal's ``ref_SO3_gimbal (m, 4)``, and the samples around the stamp; None without a gimbal.
        vehicle: The vehicle's ``ned_SO3_body (m, 4)``, likewise; None where it is not known, and not needed.
        frame: What the report's roll and pitch are against.
        yaw_in_earth: Whether its yaw is against north.
        demands: What was demanded before; None where the report is no demand.
        evidence: What is known of the report's frame.
    """

    source: GimbalSource
    age_s: float
    report: tuple[FloatArray, Bracket] | None = None
    vehicle: tuple[FloatArray, Bracket] | None = None
    frame: ReportFrame = ReportFrame.EARTH
    yaw_in_earth: bool = True
    demands: Demands | None = None
    evidence: FrameEvidence | None = None

    @property
    def way(self) -> tuple[object, ...]:
        """What readings have in common that can be resolved together."""
        return self.source, self.frame, self.yaw_in_earth, self.vehicle is None, self.demands is None

    @property
    def previous(self) -> FloatArray:
        """``(4,)`` the report before those around the stamp; NaN where there is none."""
        if self.report is None or self.report[1].before == 0:
            return np.full(4, np.nan)
        return np.asarray(self.report[0][self.report[1].before - 1])


class Resolver:
    """Turns readings into attitudes."""

    def __init__(self, settings: AttitudeSettings) -> None:
        self._settings = settings
        self._camera = _mounted(settings.camera_on_gimbal)

    def resolved(self, readings: Sequence[Reading]) -> list[CameraAttitude]:
        """The attitudes that readings come to, many at once."""
        alike: dict[tuple[object, ...], list[int]] = {}
        for row, each in enumerate(readings):
            alike.setdefault(each.way, []).append(row)
        attitudes: dict[int, CameraAttitude] = {}
        for rows in alike.values():
            group = [readings[row] for row in rows]
            solve = self._carried if group[0].source is GimbalSource.FIXED_MOUNT else self._stabilised
            attitudes.update(zip(rows, solve(group), strict=True))
        return [attitudes[row] for row in range(len(readings))]

    def _carried(self, readings: list[Reading]) -> list[CameraAttitude]:
        """Cameras that are bolted to the vehicle."""
        vehicle = Ends.of([each.vehicle for each in readings if each.vehicle is not None])
        bolted = vehicle.between().carrying(_mounted(self._settings.fixed_mount))
        return [
            CameraAttitude(
                wxyz=wxyz, rate_cam_radps=rate, source=each.source, age_s=each.age_s, report_std_rad=np.zeros(3)
            )
            for each, wxyz, rate in zip(readings, *_camera_axes(bolted), strict=True)
        ]

    def _stabilised(self, readings: list[Reading]) -> list[CameraAttitude]:
        """Cameras on gimbals that are read in one way."""
        way = readings[0]
        report = Ends.of([each.report for each in readings if each.report is not None])
        looking, vehicle = report.between(), None
        if way.vehicle is not None:
            vehicle = Ends.of([each.vehicle for each in readings if each.vehicle is not None])
        if vehicle is not None and not (way.yaw_in_earth and way.frame is ReportFrame.EARTH):
            looking = carrier(vehicle, way.frame, yaw_in_earth=way.yaw_in_earth).carrying(looking)
        doubt = self._doubt_std(readings, vehicle, looking)
        slew = self._report_std(readings, report)
        std = np.hypot(slew, doubt)
        cam_from_gimbal = _CAM_FROM_STRAIGHT @ matrix(inverse(self._camera.wxyz[0]))
        stds = np.sqrt(turned(cam_from_gimbal**2, std**2))
        wxyz, rates = _camera_axes(looking.carrying(self._camera))
        return [
            CameraAttitude(
                wxyz=wxyz[row],
                rate_cam_radps=rates[row],
                source=each.source,
                age_s=each.age_s,
                report_std_rad=stds[row],
                is_demand=each.demands is not None,
                reasons=(*self._remarks(each, doubt[row]), *self._turning(each.source, slew[row])),
            )
            for row, each in enumerate(readings)
        ]

    def _report_std(self, readings: list[Reading], report: Ends) -> FloatArray:
        """How far cameras may be from their reports ``(n, 3)``, in gimbal axes, because these jump or lead."""
        previous = np.array([each.previous for each in readings])
        jump = jump_std(previous, report.before, report.after, report.weight)
        if readings[0].demands is None:
            return np.abs(jump)
        now = slerp(report.before, report.after, report.weight)
        demands = [each.demands for each in readings if each.demands is not None]
        return np.hypot(jump, lag_std(demands, now, self._settings.slew_radps))

    def _doubt_std(self, readings: list[Reading], vehicle: Ends | None, looking: Turning) -> FloatArray:
        """Standard deviations ``(n, 3)`` in gimbal axes of the standard's reading, wrong or not by the vehicle's tilt.

        0 where the reports' frame is known.
        """
        share = np.array([self._doubt(each.evidence) for each in readings])[:, None]
        if vehicle is None:
            return np.repeat(share * _USUAL_TILT_RAD, 3, axis=1)
        attitude = slerp(vehicle.before, vehicle.after, vehicle.weight)
        tilt_ned = to_rotation_vector(multiply(attitude, inverse(heading_of(attitude))))
        return np.abs(share * turned(matrix(inverse(looking.wxyz)), tilt_ned))

    def _doubt(self, evidence: FrameEvidence | None) -> float:
        if evidence is None or self._settings.frame is not None or evidence.frame is not None:
            return 0.0
        return math.sqrt(evidence.body_probability)

    def _remarks(self, reading: Reading, doubt_std_rad: FloatArray) -> tuple[str, ...]:
        source, evidence = reading.source, reading.evidence
        if self._settings.frame is not None or evidence is None:
            return ()
        if evidence.frame is ReportFrame.BODY:
            return (f"{source} is body-frame (against the vehicle, not the horizon): the vehicle's attitude was added",)
        if np.max(doubt_std_rad) > self._settings.std.tilt_rad:
            return (f"whether {source} is earth-frame or body-frame is not known yet: the std covers both",)
        return ()

    def _turning(self, source: GimbalSource, slew_std_rad: FloatArray) -> tuple[str, ...]:
        """Whether the camera may still be far from what was reported, as its own std counts."""
        if np.max(slew_std_rad) <= max(self._settings.std.tilt_rad, DEMAND_TILT_STD_RAD):
            return ()
        return (f"the gimbal may still be turning to what {source} says: the std covers its way there",)


def _mounted(mount: FixedMount | None) -> Turning:
    """The camera on what it is bolted to."""
    if mount is None:
        return Turning(np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)))
    return Turning(from_yaw_pitch_roll([mount.yaw_rad], mount.pitch_rad, mount.roll_rad), np.zeros((1, 3)))


def _camera_axes(straight: Turning) -> tuple[FloatArray, FloatArray]:
    """``enu_SO3_cam (n, 4)`` and rates ``(n, 3)`` in camera axes of cameras that look along x, in NED."""
    return camera_from_gimbal(straight.wxyz), turned(_CAM_FROM_STRAIGHT, straight.rate_radps)
