"""The table that says which attitude is believed, how a gimbal's reports are read, and how well they are known."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from aerodft.adapters.config.tables import (
    Duration,
    Gap,
    HeadingDeg,
    NonNegative,
    Order,
    Positive,
    RollDeg,
    Table,
    impossible,
)
from aerodft.adapters.config.units import to_deg, to_ns, to_s
from aerodft.model.pose import GimbalSource, PoseStd
from aerodft.model.telemetry import ReportFrame
from aerodft.service.settings import AttitudeSettings, FixedMount

AttitudeName = Literal["GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION", "MOUNT_STATUS", "MNT", "fixed"]
PitchDeg = Annotated[float, Field(ge=-180, le=180)]


class FixedMountTable(Table):
    """A camera bolted to the vehicle: yaw, pitch (0 forward, -90 straight down), roll against its body."""

    yaw_deg: HeadingDeg = 0.0
    pitch_deg: PitchDeg
    roll_deg: RollDeg = 0.0


class CameraOnGimbalTable(Table):
    """How the camera sits on its gimbal: yaw, pitch (negative: it looks lower than the gimbal says), roll."""

    yaw_deg: HeadingDeg = 0.0
    pitch_deg: PitchDeg = 0.0
    roll_deg: RollDeg = 0.0


class AttitudeTable(Table):
    """Which attitude is believed, and how a gimbal's reports are read."""

    order: Order[AttitudeName] = ("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION", "MOUNT_STATUS", "MNT")
    fixed_mount: FixedMountTable | None = None
    camera_on_gimbal: CameraOnGimbalTable | None = None
    frame: Literal["auto", "earth", "body"] = "auto"
    feedback: Literal["auto", "measured", "demand"] = "auto"
    delay_s: Duration = 0.0
    lag_s: Duration = 0.3
    slew_dps: Positive = 60.0
    max_gap_s: Gap = 1.0
    tilt_std_deg: NonNegative = 1.0
    pan_std_deg: NonNegative = 1.0
    roll_std_deg: NonNegative = 1.0
    heading_std_deg: NonNegative = 2.0

    @model_validator(mode="after")
    def _fixed_mount_is_there(self) -> Self:
        if "fixed" in self.order and self.fixed_mount is None:
            raise impossible("fixed_mount", got="nothing", expected='a table, because "fixed" is in order')
        return self


def attitude_from(table: AttitudeTable, horizontal_std_m: float) -> AttitudeSettings:
    """The table in SI units."""
    return AttitudeSettings(
        order=tuple(GimbalSource(name) for name in table.order),
        fixed_mount=_mount(table.fixed_mount),
        camera_on_gimbal=_mount(table.camera_on_gimbal),
        frame=None if table.frame == "auto" else ReportFrame(table.frame),
        is_demand=None if table.feedback == "auto" else table.feedback == "demand",
        delay_ns=to_ns(table.delay_s),
        lag_ns=to_ns(table.lag_s),
        slew_radps=math.radians(table.slew_dps),
        std=PoseStd(
            horizontal_m=horizontal_std_m,
            tilt_rad=math.radians(table.tilt_std_deg),
            pan_rad=math.radians(table.pan_std_deg),
            roll_rad=math.radians(table.roll_std_deg),
            heading_rad=math.radians(table.heading_std_deg),
        ),
        max_gap_ns=to_ns(table.max_gap_s),
    )


def attitude_document(settings: AttitudeSettings) -> dict[str, Any]:
    """The settings as a table; what is not stated is left out."""
    feedback = {None: None, True: "demand", False: "measured"}
    std = settings.std
    table = {
        "order": [str(source) for source in settings.order],
        "fixed_mount": _mount_document(settings.fixed_mount),
        "camera_on_gimbal": _mount_document(settings.camera_on_gimbal),
        "frame": None if settings.frame is None else str(settings.frame),
        "feedback": feedback[settings.is_demand],
        "delay_s": to_s(settings.delay_ns) or None,
        "lag_s": to_s(settings.lag_ns),
        "slew_dps": to_deg(settings.slew_radps),
        "max_gap_s": to_s(settings.max_gap_ns),
        "tilt_std_deg": to_deg(std.tilt_rad),
        "pan_std_deg": to_deg(std.pan_rad),
        "roll_std_deg": to_deg(std.roll_rad),
        "heading_std_deg": to_deg(std.heading_rad),
    }
    return {key: value for key, value in table.items() if value is not None}


def _mount(table: FixedMountTable | CameraOnGimbalTable | None) -> FixedMount | None:
    if table is None:
        return None
    return FixedMount(
        yaw_rad=math.radians(table.yaw_deg),
        pitch_rad=math.radians(table.pitch_deg),
        roll_rad=math.radians(table.roll_deg),
    )


def _mount_document(mount: FixedMount | None) -> dict[str, float] | None:
    if mount is None:
        return None
    return {
        "yaw_deg": to_deg(mount.yaw_rad),
        "pitch_deg": to_deg(mount.pitch_rad),
        "roll_deg": to_deg(mount.roll_rad),
    }
