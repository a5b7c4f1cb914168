"""What the simulated autopilot knows, as MAVLink messages in their wire units."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.geometry.rotation import yaw_pitch_roll
from aerodft.model.arrays import FloatArray

GIMBAL_FLAGS = (
    dialect.GIMBAL_DEVICE_FLAGS_ROLL_LOCK
    | dialect.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
    | dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
)
_RANGEFINDER_CM = (20, 12000)
_TERRAIN_SPACING_M = 100


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """One instant as the autopilot reports it, its errors included.

    Attributes:
        boot_ms: Time since boot.
        unix_us: The autopilot's UTC.
        lat_lon_rad: ``(2,)`` WGS84.
        alt_msl_m: Altitude.
        height_home_m: Above home.
        height_agl_m: What looks at the ground itself (rangefinder, terrain) says.
        velocity_ned_mps: ``(3,)``.
        ned_wxyz_body: ``(4,)``.
        rate_body_radps: ``(3,)``.
        level_wxyz_gimbal: ``(4,)`` against the horizon and the vehicle's heading.
    """

    boot_ms: int
    unix_us: int
    lat_lon_rad: FloatArray
    alt_msl_m: float
    height_home_m: float
    height_agl_m: float
    velocity_ned_mps: FloatArray
    ned_wxyz_body: FloatArray
    rate_body_radps: FloatArray
    level_wxyz_gimbal: FloatArray

    @property
    def heading_rad(self) -> float:
        """The vehicle's heading in [0, 2 pi)."""
        return float(yaw_pitch_roll(self.ned_wxyz_body)[0]) % (2 * math.pi)

    @property
    def lat_lon_dege7(self) -> tuple[int, int]:
        """As MAVLink's integers."""
        lat, lon = np.rint(np.degrees(self.lat_lon_rad) * 1e7).astype(int).tolist()
        return lat, lon


def _heartbeat(_state: State) -> Any:  # noqa: ANN401 (pymavlink is untyped, here and below)
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_QUADROTOR,
        dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
        dialect.MAV_MODE_FLAG_SAFETY_ARMED | dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        0,
        dialect.MAV_STATE_ACTIVE,
        3,
    )


def _system_time(state: State) -> Any:  # noqa: ANN401
    return dialect.MAVLink_system_time_message(state.unix_us, state.boot_ms)


def _attitude(state: State) -> Any:  # noqa: ANN401
    yaw, pitch, roll = (float(angle) for angle in yaw_pitch_roll(state.ned_wxyz_body))
    return dialect.MAVLink_attitude_message(state.boot_ms, roll, pitch, yaw, *state.rate_body_radps.tolist())


def _global_position_int(state: State) -> Any:  # noqa: ANN401
    return dialect.MAVLink_global_position_int_message(
        state.boot_ms,
        *state.lat_lon_dege7,
        round(state.alt_msl_m * 1000),
        round(state.height_home_m * 1000),
        *np.rint(state.velocity_ned_mps * 100).astype(int).tolist(),
        round(math.degrees(state.heading_rad) * 100) % 36000,
    )


def _gimbal_device_attitude_status(state: State) -> Any:  # noqa: ANN401
    return dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, state.boot_ms, GIMBAL_FLAGS, state.level_wxyz_gimbal.tolist(), math.nan, math.nan, math.nan, 0, math.nan
    )


def _mount_orientation(state: State) -> Any:  # noqa: ANN401
    yaw, pitch, roll = (math.degrees(angle) for angle in yaw_pitch_roll(state.level_wxyz_gimbal))
    absolute = (math.degrees(state.heading_rad) + yaw + 180) % 360 - 180
    return dialect.MAVLink_mount_orientation_message(state.boot_ms, roll, pitch, yaw, absolute)


def _mount_status(state: State) -> Any:  # noqa: ANN401
    yaw, pitch, roll = (round(math.degrees(angle) * 100) for angle in yaw_pitch_roll(state.level_wxyz_gimbal))
    return dialect.MAVLink_mount_status_message(0, 0, pitch, roll, yaw, 0)


def _distance_sensor(state: State) -> Any:  # noqa: ANN401
    _, pitch, roll = yaw_pitch_roll(state.ned_wxyz_body)
    slant_m = state.height_agl_m / float(np.cos(pitch) * np.cos(roll))
    low, high = _RANGEFINDER_CM
    distance_cm = min(max(round(slant_m * 100), 0), 65535)
    laser, down = dialect.MAV_DISTANCE_SENSOR_LASER, dialect.MAV_SENSOR_ROTATION_PITCH_270
    return dialect.MAVLink_distance_sensor_message(state.boot_ms, low, high, distance_cm, laser, 0, down, 255)


def _terrain_report(state: State) -> Any:  # noqa: ANN401
    terrain_m = state.alt_msl_m - state.height_home_m
    return dialect.MAVLink_terrain_report_message(
        *state.lat_lon_dege7, _TERRAIN_SPACING_M, terrain_m, state.height_agl_m, 0, 504
    )


def _gps_raw_int(state: State) -> Any:  # noqa: ANN401
    speed_cmps = round(float(np.hypot(*state.velocity_ned_mps[:2])) * 100)
    return dialect.MAVLink_gps_raw_int_message(
        state.unix_us,
        dialect.GPS_FIX_TYPE_3D_FIX,
        *state.lat_lon_dege7,
        round(state.alt_msl_m * 1000),
        80,
        120,
        speed_cmps,
        65535,
        14,
        round(state.alt_msl_m * 1000),
        800,
        1200,
    )


PACKERS: dict[str, Callable[[State], Any]] = {
    "HEARTBEAT": _heartbeat,
    "SYSTEM_TIME": _system_time,
    "ATTITUDE": _attitude,
    "GLOBAL_POSITION_INT": _global_position_int,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": _gimbal_device_attitude_status,
    "MOUNT_ORIENTATION": _mount_orientation,
    "MOUNT_STATUS": _mount_status,
    "DISTANCE_SENSOR": _distance_sensor,
    "TERRAIN_REPORT": _terrain_report,
    "GPS_RAW_INT": _gps_raw_int,
}
"""The messages that the simulated autopilot can send, by name."""

MAVLINK2_ONLY = frozenset({"GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION"})
"""Their ids do not fit into MAVLink 1."""


class Packer:
    """Messages to frames with running sequence numbers.

    Args:
        mavlink1: Whether frames are MAVLink 1.
        system: System id.
        component: Component id.
    """

    def __init__(self, *, mavlink1: bool = False, system: int = 1, component: int = 1) -> None:
        self._mavlink1 = mavlink1
        self._link = dialect.MAVLink(None, srcSystem=system, srcComponent=component)

    def pack(self, name: str, state: State) -> bytes:
        """One whole frame.

        Raises:
            ValueError: An unknown message, or one that MAVLink 1 has no room for.
        """
        if name not in PACKERS:
            raise ValueError(f"cannot send {name}, must be one of {', '.join(PACKERS)}")
        if self._mavlink1 and name in MAVLINK2_ONLY:
            raise ValueError(f"{name} does not exist in MAVLink 1")
        frame = bytes(PACKERS[name](state).pack(self._link, force_mavlink1=self._mavlink1))
        self._link.seq = (self._link.seq + 1) % 256
        return frame
