"""The simulated autopilot's MAVLink with biases and noise, and the radio that delays and loses it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.conventions import SECOND_NS
from aerodft.geometry import from_rotation_vector, lat_lon, multiply, yaw_pitch_roll
from aerodft.model import BiasValues, FloatArray, PoseStd
from aerodft.sim.trajectory import Trajectory

GIMBAL_FLAGS = (
    dialect.GIMBAL_DEVICE_FLAGS_ROLL_LOCK
    | dialect.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
    | dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
)
_RANGEFINDER_CM = (20, 12000)
_TERRAIN_SPACING_M = 100
_Message: TypeAlias = Any  # pymavlink has no types

DEFAULT_RATES_HZ = {
    "HEARTBEAT": 1.0,
    "SYSTEM_TIME": 2.0,
    "ATTITUDE": 20.0,
    "GLOBAL_POSITION_INT": 20.0,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 20.0,
}
_MILLISECOND_NS = 1_000_000
_REORDER_DELAY_NS = 30 * _MILLISECOND_NS  # of a datagram that is reordered


def draw_biases(std: PoseStd, seed: int) -> BiasValues:
    """Biases of one flight, drawn from normal distributions with these stds."""
    height, tilt, pan, roll, heading = np.random.default_rng(seed).standard_normal(5).tolist()
    return BiasValues(
        height_m=height * std.height_agl_m,
        tilt_rad=tilt * std.tilt_rad,
        pan_rad=pan * std.pan_rad,
        roll_rad=roll * std.roll_rad,
        heading_rad=heading * std.heading_rad,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """Message rates and errors of the simulated autopilot.

    Attributes:
        rates_hz: Rates by message name; absent or 0 is not sent.
        biases: Reported minus true values, constant over a flight: height, tilt, pan, roll, heading.
        noise: White noise of every sample: height, horizontal, tilt/pan/roll (of the gimbal), heading.
        gimbal_lag_ns: Lag of the camera behind the gimbal's reports, which are demands.
        clock_offset_ns: The autopilot's UTC minus the host's.
        booted_ns: Time since boot at the flight's start.
        mavlink1: Whether to send MAVLink 1; then the gimbal needs MOUNT_STATUS in ``rates_hz``.
        system: MAVLink system id.
        seed: Seed of the noise.
    """

    rates_hz: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_RATES_HZ))
    biases: BiasValues = field(default_factory=BiasValues)
    noise: PoseStd = field(default_factory=PoseStd)
    gimbal_lag_ns: int = 0
    clock_offset_ns: int = 0
    booted_ns: int = 60 * SECOND_NS
    mavlink1: bool = False
    system: int = 1
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Radio:
    """Delays and losses of datagrams on a radio link.

    Attributes:
        latency_ns: Delay of every datagram.
        jitter_ns: Standard deviation of a further delay, which is never negative.
        drop: Fraction that is lost.
        duplicate: Fraction that arrives twice.
        reorder: Fraction that arrives behind later ones.
        outages_ns: Intervals ``(start, end)`` since the flight's start in which all is lost.
        seed: Seed of all random choices.
    """

    latency_ns: int = 0
    jitter_ns: int = 0
    drop: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    outages_ns: tuple[tuple[int, int], ...] = ()
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Datagram:
    """Bytes and the host UTC at which they are due."""

    due_ns: int
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReportedState:
    """The vehicle's state at one instant as the autopilot reports it, with errors.

    Attributes:
        boot_ms: Time since boot.
        unix_us: The autopilot's UTC.
        lat_lon_rad: ``(2,)`` WGS84.
        alt_msl_m: Altitude.
        height_home_m: Above home.
        height_agl_m: By sensors of the ground itself (rangefinder, terrain).
        velocity_ned_mps: ``(3,)``.
        ned_wxyz_body: ``(4,)``.
        rate_body_radps: ``(3,)``.
        level_wxyz_gimbal: ``(4,)`` relative to the horizon and the vehicle's heading.
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
        """Latitude and longitude in MAVLink's integers."""
        lat, lon = np.rint(np.degrees(self.lat_lon_rad) * 1e7).astype(int).tolist()
        return lat, lon


def datagrams(trajectory: Trajectory, autopilot: Autopilot) -> list[Datagram]:
    """All datagrams that the autopilot sends during the flight, one frame each, in order.

    Messages are sampled at whole milliseconds of the time since boot and sent at once.

    Raises:
        ValueError: An unknown message, or one that MAVLink 1 cannot carry.
    """
    for name, rate_hz in autopilot.rates_hz.items():
        if name not in PACKERS:
            raise ValueError(f"cannot send {name}, must be one of {', '.join(PACKERS)}")
        if autopilot.mavlink1 and rate_hz > 0 and name in MAVLINK2_ONLY:
            raise ValueError(f"{name} does not exist in MAVLink 1")
    schedule = _schedule(trajectory, autopilot.rates_hz)
    stamps = np.array([stamp for stamp, _ in schedule], dtype=np.int64)
    states = _states(trajectory, autopilot, stamps)
    link = dialect.MAVLink(None, srcSystem=autopilot.system, srcComponent=1)
    sent = []
    for (stamp, name), state in zip(schedule, states, strict=True):
        frame = PACKERS[name](state).pack(link, force_mavlink1=autopilot.mavlink1)
        link.seq = (link.seq + 1) % 256
        sent.append(Datagram(due_ns=stamp, data=bytes(frame)))
    return sent


def _schedule(trajectory: Trajectory, rates_hz: Mapping[str, float]) -> list[tuple[int, str]]:
    schedule = []
    for order, (name, rate_hz) in enumerate(rates_hz.items()):
        if rate_hz <= 0:
            continue
        count = int((trajectory.end_ns - trajectory.start_ns) / SECOND_NS * rate_hz) + 1
        # Streams are a millisecond apart, so that every stream has its own instants, as on a real autopilot.
        elapsed_ms = np.floor(np.arange(count) * 1000 / rate_hz).astype(np.int64) + order
        schedule += [(trajectory.start_ns + ms * _MILLISECOND_NS, name) for ms in elapsed_ms.tolist()]
    return sorted(schedule)


def _states(trajectory: Trajectory, autopilot: Autopilot, stamps_ns: np.ndarray) -> list[ReportedState]:
    generator = np.random.default_rng([autopilot.seed, 1])
    noise, biases, count = autopilot.noise, autopilot.biases, len(stamps_ns)
    truth = trajectory.at(stamps_ns)
    velocity = trajectory.velocity_enu_mps()
    rate = trajectory.body_rate_radps()
    row = np.clip(np.searchsorted(trajectory.stamp_ns, stamps_ns), 0, len(trajectory.stamp_ns) - 1)
    horizontal = truth.position_enu_m[:, :2] + noise.horizontal_m * generator.standard_normal((count, 2))
    positions = lat_lon(trajectory.origin, horizontal)
    up = truth.position_enu_m[:, 2]
    home = up + biases.height_m + noise.height_agl_m * generator.standard_normal(count)
    heading_error = biases.heading_rad + noise.heading_rad * generator.standard_normal(count)
    body = multiply(from_rotation_vector(heading_error[:, None] * np.array([0.0, 0.0, 1.0])), truth.ned_wxyz_body)
    # Camera axes x, y, z are the gimbal's y, z, x.
    bias = np.array([biases.roll_rad, biases.tilt_rad, biases.pan_rad])
    gimbal_noise = np.array([noise.roll_rad, noise.tilt_rad, noise.pan_rad]) * generator.standard_normal((count, 3))
    demand = trajectory.at(stamps_ns + autopilot.gimbal_lag_ns).level_wxyz_gimbal
    gimbal = multiply(demand, from_rotation_vector(bias + gimbal_noise))
    elapsed = stamps_ns - trajectory.start_ns
    ground_msl_m = trajectory.origin.alt_msl_m or 0.0
    return [
        ReportedState(
            boot_ms=int((elapsed[i] + autopilot.booted_ns) // _MILLISECOND_NS),
            unix_us=int(stamps_ns[i] + autopilot.clock_offset_ns) // 1000,
            lat_lon_rad=positions[i],
            alt_msl_m=ground_msl_m + float(home[i]),
            height_home_m=float(home[i]),
            height_agl_m=float(up[i]),
            velocity_ned_mps=velocity[row[i]][[1, 0, 2]] * np.array([1.0, 1.0, -1.0]),
            ned_wxyz_body=body[i],
            rate_body_radps=rate[row[i]],
            level_wxyz_gimbal=gimbal[i],
        )
        for i in range(count)
    ]


def through_radio(datagrams_sent: list[Datagram], radio: Radio) -> list[Datagram]:
    """Datagrams after the radio, in order of arrival; outages count from the first datagram."""
    if not datagrams_sent:
        return []
    generator = np.random.default_rng([radio.seed, 2])
    start_ns = datagrams_sent[0].due_ns
    arrived = []
    for datagram in datagrams_sent:
        is_lost, is_duplicated, is_reordered = generator.random(3) < (radio.drop, radio.duplicate, radio.reorder)
        # Whole nanoseconds: a stamp of today as a float is 256 ns off.
        delays: list[int] = np.rint(np.abs(generator.standard_normal(2)) * radio.jitter_ns).astype(int).tolist()
        elapsed = datagram.due_ns - start_ns
        if is_lost or any(start <= elapsed < end for start, end in radio.outages_ns):
            continue
        due_ns = datagram.due_ns + radio.latency_ns + (_REORDER_DELAY_NS if is_reordered else 0)
        copies = delays if is_duplicated else delays[:1]
        arrived += [Datagram(due_ns=due_ns + delay, data=datagram.data) for delay in copies]
    return sorted(arrived, key=lambda datagram: datagram.due_ns)


def write_tlog(path: Path, arrived: list[Datagram]) -> None:
    """Write a telemetry log as ground stations do: host stamp (us, big-endian, 8 bytes), then the frame."""
    with path.open("wb") as file:
        for datagram in arrived:
            file.write((datagram.due_ns // 1000).to_bytes(8, "big") + datagram.data)


def _heartbeat(_state: ReportedState) -> _Message:
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_QUADROTOR,
        dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
        dialect.MAV_MODE_FLAG_SAFETY_ARMED | dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        0,
        dialect.MAV_STATE_ACTIVE,
        3,
    )


def _system_time(state: ReportedState) -> _Message:
    return dialect.MAVLink_system_time_message(state.unix_us, state.boot_ms)


def _attitude(state: ReportedState) -> _Message:
    yaw, pitch, roll = (float(angle) for angle in yaw_pitch_roll(state.ned_wxyz_body))
    return dialect.MAVLink_attitude_message(state.boot_ms, roll, pitch, yaw, *state.rate_body_radps.tolist())


def _global_position_int(state: ReportedState) -> _Message:
    return dialect.MAVLink_global_position_int_message(
        state.boot_ms,
        *state.lat_lon_dege7,
        round(state.alt_msl_m * 1000),
        round(state.height_home_m * 1000),
        *np.rint(state.velocity_ned_mps * 100).astype(int).tolist(),
        round(math.degrees(state.heading_rad) * 100) % 36000,
    )


def _gimbal_device_attitude_status(state: ReportedState) -> _Message:
    return dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, state.boot_ms, GIMBAL_FLAGS, state.level_wxyz_gimbal.tolist(), math.nan, math.nan, math.nan, 0, math.nan
    )


def _mount_orientation(state: ReportedState) -> _Message:
    yaw, pitch, roll = (math.degrees(angle) for angle in yaw_pitch_roll(state.level_wxyz_gimbal))
    absolute = (math.degrees(state.heading_rad) + yaw + 180) % 360 - 180
    return dialect.MAVLink_mount_orientation_message(state.boot_ms, roll, pitch, yaw, absolute)


def _mount_status(state: ReportedState) -> _Message:
    yaw, pitch, roll = (round(math.degrees(angle) * 100) for angle in yaw_pitch_roll(state.level_wxyz_gimbal))
    return dialect.MAVLink_mount_status_message(0, 0, pitch, roll, yaw, 0)


def _distance_sensor(state: ReportedState) -> _Message:
    _, pitch, roll = yaw_pitch_roll(state.ned_wxyz_body)
    slant_m = state.height_agl_m / float(np.cos(pitch) * np.cos(roll))
    low, high = _RANGEFINDER_CM
    distance_cm = min(max(round(slant_m * 100), 0), 65535)
    laser, down = dialect.MAV_DISTANCE_SENSOR_LASER, dialect.MAV_SENSOR_ROTATION_PITCH_270
    return dialect.MAVLink_distance_sensor_message(state.boot_ms, low, high, distance_cm, laser, 0, down, 255)


def _terrain_report(state: ReportedState) -> _Message:
    terrain_m = state.alt_msl_m - state.height_home_m
    return dialect.MAVLink_terrain_report_message(
        *state.lat_lon_dege7, _TERRAIN_SPACING_M, terrain_m, state.height_agl_m, 0, 504
    )


def _gps_raw_int(state: ReportedState) -> _Message:
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


PACKERS: dict[str, Callable[[ReportedState], _Message]] = {
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
"""Messages with ids beyond MAVLink 1."""
