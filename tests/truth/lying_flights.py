"""Flights whose telemetry lies, as .tlog files by pymavlink, with the truth of what fixed pixels show.

A vehicle flies smooth curves over a level plane with its camera on a gimbal. Everything that it says of itself is the
truth with a little noise; a lie changes some fields of its messages. Nothing of the product is used here: the geometry
is plain numpy.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as dialect

Floats = npt.NDArray[np.float64]

UTC0_S, BOOT0_S = 1_795_221_168, 100.0
SECONDS, LIE_FROM_S = 80.0, 30.0
LAT_DEG, LON_DEG, HOME_MSL_M = 46.5888149, 3.877452, 240.0
WIDTH_PX, HEIGHT_PX, FOCAL_PX = 1920, 1080, 1400.0
PIXELS = {
    "middle": ((959.5, 539.5),),
    "span": ((600.0, 640.0), (1300.0, 700.0)),
    "place": ((800.0, 760.0),),
}
YAW_IN_VEHICLE, YAW_IN_EARTH, DOWN = 32, 64, 25
RATE_HZ = 2.0
STATION = f"""
[station]
name = "liar"
origin = {{ lat_deg = {LAT_DEG}, lon_deg = {LON_DEG}, alt_msl_m = {HOME_MSL_M} }}
[camera]
name = "c"
width_px = {WIDTH_PX}
height_px = {HEIGHT_PX}
fx_px = {FOCAL_PX}
fy_px = {FOCAL_PX}
cx_px = {(WIDTH_PX - 1) / 2}
cy_px = {(HEIGHT_PX - 1) / 2}
[telemetry]
[images]
rate_hz = {RATE_HZ}
[[probe]]
name = "middle"
kind = "range"
pixels = [[959.5, 539.5]]
[[probe]]
name = "span"
kind = "distance"
pixels = [[600.0, 640.0], [1300.0, 700.0]]
[[probe]]
name = "place"
kind = "position"
pixels = [[800.0, 760.0]]
"""


@dataclass
class Row:
    """One message: its name, when it was made and when it came (s since the start), and its fields."""

    name: str
    made_s: float
    came_s: float
    fields: dict[str, Any]


Lie = Callable[[Row], None]


class Flight:
    """A flight of random curves.

    Attributes:
        rng: Of all chances.
    """

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        draw = self.rng.uniform
        self._rates = draw(0.06, 0.16, 6)
        self._phases = draw(0, 2 * np.pi, 6)
        self._heading_rad, self._reach_m, self._height_m = draw(0, 2 * np.pi), draw(15, 35), draw(40, 60)

    def _wave(self, number: int, at_s: Floats) -> Floats:
        return np.sin(self._rates[number] * at_s + self._phases[number])

    def enu_m(self, at_s: Floats) -> Floats:
        """Positions ``(n, 3)``: east, north of home, above the plane of home; on the ground for the first 10 s."""
        flies = np.clip((at_s - 10) / 10, 0, 1)
        flies = flies * flies * (3 - 2 * flies)
        up_m = (self._height_m + 8 * self._wave(2, at_s)) * flies
        return np.stack(
            [self._reach_m * self._wave(0, at_s) * flies, self._reach_m * self._wave(1, at_s) * flies, up_m], -1
        )

    def velocity_enu_mps(self, at_s: Floats) -> Floats:
        """Velocities ``(n, 3)``."""
        return (self.enu_m(at_s + 0.01) - self.enu_m(at_s - 0.01)) / 0.02

    def vehicle_rad(self, at_s: Floats) -> Floats:
        """Roll, pitch, yaw ``(n, 3)``: it leans to accelerate, and gusts shake it."""
        shakes = np.clip((at_s - 10) / 10, 0, 1)
        pitch = 0.12 * np.sin(0.9 * at_s + self._phases[3]) * shakes
        roll = 0.10 * np.sin(1.1 * at_s + self._phases[4]) * shakes
        return np.stack([roll, pitch, self._heading_rad + 0.8 * self._wave(3, at_s)], -1)

    def vehicle_rates_radps(self, at_s: Floats) -> Floats:
        """Rates of roll, pitch and yaw ``(n, 3)``, of small angles about the body's axes."""
        return (self.vehicle_rad(at_s + 0.01) - self.vehicle_rad(at_s - 0.01)) / 0.02

    def camera_rad(self, at_s: Floats) -> Floats:
        """Roll, pitch of the camera against the horizon and its yaw against the vehicle's heading ``(n, 3)``."""
        return np.stack([0 * at_s, np.radians(-55 + 15 * self._wave(5, at_s)), 0.4 * self._wave(4, at_s)], -1)

    def truth(self, at_s: Floats) -> dict[str, Floats]:
        """Ranges, distances and places (east, north) that the pixels show."""
        roll, pitch, yaw = self.camera_rad(at_s).T
        axes = _yaw_pitch_roll(yaw + self.vehicle_rad(at_s)[:, 2], pitch, roll)
        foot_enu = self.enu_m(at_s)
        ground = {}
        for name, pixels in PIXELS.items():
            u, v = np.array(pixels).T
            rays = np.stack(
                [np.ones_like(u), (u - (WIDTH_PX - 1) / 2) / FOCAL_PX, (v - (HEIGHT_PX - 1) / 2) / FOCAL_PX], -1
            )
            ned = np.einsum("nij,kj->nki", axes, rays)
            enu = np.stack([ned[..., 1], ned[..., 0], -ned[..., 2]], -1)
            with np.errstate(divide="ignore", invalid="ignore"):
                ground[name] = foot_enu[:, None] - enu * (foot_enu[:, None, 2:] / enu[..., 2:])
        span = ground["span"]
        return {
            "middle": np.linalg.norm(ground["middle"][:, 0] - foot_enu, axis=-1),
            "span": np.linalg.norm(span[:, 0] - span[:, 1], axis=-1),
            "place": ground["place"][:, 0, :2],
        }


def _yaw_pitch_roll(yaw: Floats, pitch: Floats, roll: Floats) -> Floats:
    """Rotations ``(n, 3, 3)`` from forward, right, down to north, east, down."""
    (cy, sy), (cp, sp), (cr, sr) = ((np.cos(a), np.sin(a)) for a in (yaw, pitch, roll))
    return np.stack(
        [
            np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], -1),
            np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], -1),
            np.stack([-sp, cp * sr, cp * cr], -1),
        ],
        -2,
    )


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    """w, x, y, z of yaw, then pitch, then roll."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw))
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def deg_of(enu_m: Floats) -> tuple[float, float]:
    """Latitude and longitude of a place near home, by the ellipsoid's radii of curvature there."""
    lat = math.radians(LAT_DEG)
    flat = 1 - 0.00669437999014 * math.sin(lat) ** 2
    meridian_m, normal_m = 6_378_137 * (1 - 0.00669437999014) / flat**1.5, 6_378_137 / math.sqrt(flat)
    north, east = enu_m[1] / meridian_m, enu_m[0] / (normal_m * math.cos(lat))
    return LAT_DEG + math.degrees(north), LON_DEG + math.degrees(east)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of lie.

    Attributes:
        lie: Makes what changes the rows, of the flight.
        has_rangefinder: Whether a rangefinder looks down.
        has_mount: Whether MOUNT_ORIENTATION tells the gimbal's attitude too.
    """

    lie: Callable[[Flight], Lie] = field(default=lambda _: lambda _row: None)
    has_rangefinder: bool = False
    has_mount: bool = True


def rows_of(flight: Flight, kind: Kind) -> list[Row]:
    """What the vehicle says, in the order in which it comes."""
    rng, rows = flight.rng, []

    def put(name: str, at_s: float, **fields: Any) -> None:
        rows.append(Row(name, at_s, at_s + 0.004 + rng.exponential(0.004), fields))

    for step in range(int(SECONDS * 10)):
        at_s = 0.1 * step
        at = np.array([at_s])
        enu, velocity = flight.enu_m(at)[0], flight.velocity_enu_mps(at)[0]
        roll, pitch, yaw = flight.vehicle_rad(at)[0] + rng.normal(0, 0.001, 3)
        rates, camera = flight.vehicle_rates_radps(at)[0], flight.camera_rad(at)[0] + rng.normal(0, 0.002, 3)
        boot_ms = round((BOOT0_S + at_s) * 1000)
        names = ("rollspeed", "pitchspeed", "yawspeed")
        put(
            "attitude",
            at_s,
            time_boot_ms=boot_ms,
            roll=roll,
            pitch=pitch,
            yaw=wrap(yaw),
            **dict(zip(names, rates, strict=True)),
        )
        put(
            "gimbal_device_attitude_status",
            at_s,
            target_system=0,
            target_component=0,
            time_boot_ms=boot_ms,
            flags=YAW_IN_VEHICLE,
            q=quaternion(*camera),
            angular_velocity_x=math.nan,
            angular_velocity_y=math.nan,
            angular_velocity_z=math.nan,
            failure_flags=0,
        )
        if kind.has_mount:
            angles = dict(zip(("roll", "pitch", "yaw"), np.degrees(camera), strict=True))
            put("mount_orientation", at_s, time_boot_ms=boot_ms, **angles)
        if kind.has_rangefinder:
            slant_cm = 100 * enu[2] / (math.cos(roll) * math.cos(pitch)) + rng.normal(0, 3)
            distance = {
                "current_distance": round(np.clip(slant_cm, 5, 13_000)),
                "min_distance": 20,
                "max_distance": 13_000,
            }
            put("distance_sensor", at_s, time_boot_ms=boot_ms, **distance, type=0, id=0, orientation=DOWN, covariance=0)
        if step % 2 == 0:
            measured = enu + rng.normal(0, [0.3, 0.3, 0.1])
            lat, lon = deg_of(measured)
            heading = round(math.degrees(yaw) % 360 * 100) % 36_000
            east, north, up = np.round(100 * velocity).astype(int).tolist()
            put(
                "global_position_int",
                at_s,
                time_boot_ms=boot_ms,
                lat=round(lat * 1e7),
                lon=round(lon * 1e7),
                alt=round(1000 * (HOME_MSL_M + measured[2])),
                relative_alt=round(1000 * measured[2]),
                vx=north,
                vy=east,
                vz=-up,
                hdg=heading,
            )
            raw = enu + rng.normal(0, [0.8, 0.8, 0.8])
            lat, lon = deg_of(raw)
            speed = math.hypot(east, north)
            put(
                "gps_raw_int",
                at_s,
                time_usec=boot_ms * 1000,
                fix_type=3,
                lat=round(lat * 1e7),
                lon=round(lon * 1e7),
                alt=round(1000 * (HOME_MSL_M + raw[2])),
                eph=80,
                epv=120,
                vel=round(speed),
                cog=round(math.degrees(math.atan2(east, north)) % 360 * 100) % 36_000,
                satellites_visible=15,
                h_acc=800,
                v_acc=1000,
            )
        if step % 10 == 0:
            flies = at_s >= 9.9
            mode = 128 if flies else 0
            put(
                "heartbeat",
                at_s,
                type=2,
                autopilot=3,
                base_mode=mode,
                custom_mode=0,
                system_status=4,
                mavlink_version=3,
            )
            unix_us = round((UTC0_S + at_s) * 1e6)
            put("system_time", at_s, time_unix_usec=unix_us, time_boot_ms=boot_ms)
            put("extended_sys_state", at_s, vtol_state=0, landed_state=2 if flies else 1)
            ratios = dict.fromkeys(("velocity", "pos_horiz", "pos_vert", "compass", "terrain_alt"), 0.05)
            ekf = {f"{name}_variance": ratio for name, ratio in ratios.items()}
            put("ekf_status_report", at_s, flags=831, **ekf)
            put("home_position", at_s, **_home())
    return rows


def _home() -> dict[str, Any]:
    place = {"latitude": round(LAT_DEG * 1e7), "longitude": round(LON_DEG * 1e7), "altitude": round(HOME_MSL_M * 1000)}
    return {**place, "x": 0, "y": 0, "z": 0, "q": [1, 0, 0, 0], "approach_x": 0, "approach_y": 0, "approach_z": 0}


def wrap(angle_rad: float) -> float:
    """An angle within +-pi."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def write(path: Path, seed: int, kind: Kind) -> tuple[Flight, Floats, Floats]:
    """Write a flight's log.

    Returns:
        The flight; host stamps of the log (s since the start, ascending) and the true times of these.
    """
    flight = Flight(seed)
    rows, lie = rows_of(flight, kind), kind.lie(flight)
    for row in rows:
        lie(row)
    rows.sort(key=lambda row: row.came_s)
    mav, log = dialect.MAVLink(None, srcSystem=1, srcComponent=1), bytearray()
    for row in rows:
        message = getattr(dialect, f"MAVLink_{row.name}_message")(**row.fields)
        stamp_us = round((UTC0_S + row.came_s) * 1e6)
        log += stamp_us.to_bytes(8, "big") + message.pack(mav)
        mav.seq = (mav.seq + 1) % 256
    path.write_bytes(log)
    came, made = np.array([(row.came_s, row.made_s) for row in rows]).T
    return flight, came, made


def later(
    name: str, change: Callable[[dict[str, Any], float], None], from_s: float = LIE_FROM_S, to_s: float = SECONDS
) -> Lie:
    """A lie that changes a message's fields between two times; it is given these and the time since the first one."""

    def lie(row: Row) -> None:
        if row.name == name and from_s <= row.made_s < to_s:
            change(row.fields, row.made_s - from_s)

    return lie


def all_of(*lies: Lie) -> Lie:
    """Several lies at once."""

    def lie(row: Row) -> None:
        for each in lies:
            each(row)

    return lie


def stuck(name: str, *fields: str, from_s: float = LIE_FROM_S) -> Callable[[Flight], Lie]:
    """A lie that repeats a message's fields as they were at a time of each flight."""

    def lie(_: Flight) -> Lie:
        held: dict[str, Any] = {}

        def change(row: dict[str, Any], _: float) -> None:
            for each in fields:
                row[each] = held.setdefault(each, row[each])

        return later(name, change, from_s)

    return lie


def added(name: str, from_s: float = LIE_FROM_S, to_s: float = SECONDS, **steps: float) -> Lie:
    """A lie that adds numbers to a message's fields."""
    return scaled(name, from_s, to_s, {}, steps)


def scaled(
    name: str,
    from_s: float = LIE_FROM_S,
    to_s: float = SECONDS,
    factors: dict[str, float] | None = None,
    steps: dict[str, float] | None = None,
) -> Lie:
    """A lie that multiplies a message's fields, and adds to them."""

    def change(row: dict[str, Any], _: float) -> None:
        for each, factor in (factors or {}).items():
            row[each] = type(row[each])(row[each] * factor)
        for each, step in (steps or {}).items():
            row[each] = type(row[each])(row[each] + step)

    return later(name, change, from_s, to_s)


def gimbal(turn: Callable[[float, float, float], tuple[float, float, float]], from_s: float = LIE_FROM_S) -> Lie:
    """A lie that changes the roll, pitch and yaw that the gimbal's quaternion holds."""

    def change(row: dict[str, Any], _: float) -> None:
        w, x, y, z = row["q"]
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        row["q"] = quaternion(*turn(roll, pitch, yaw))

    return later("gimbal_device_attitude_status", change, from_s)


def clock(change: Callable[[int], int], *names: str, from_s: float = LIE_FROM_S, to_s: float = SECONDS) -> Lie:
    """A lie of the time since boot in messages, all that have one if none is named."""

    def lie(row: Row) -> None:
        if (not names or row.name in names) and from_s <= row.made_s < to_s and "time_boot_ms" in row.fields:
            row.fields["time_boot_ms"] = change(row.fields["time_boot_ms"])

    return lie


def _delayed(seconds: float) -> Callable[[Flight], Lie]:
    """Attitudes of the gimbal that are old, with stamps that are not."""

    def make(flight: Flight) -> Lie:
        def lie(row: Row) -> None:
            if row.name == "gimbal_device_attitude_status" and row.made_s >= LIE_FROM_S:
                row.fields["q"] = quaternion(*flight.camera_rad(np.array([row.made_s - seconds]))[0])

        return lie

    return make


def _body_frame(flight: Flight) -> Lie:
    """Reports of a servo mount: angles against the vehicle, under flags of the horizon."""

    def lie(row: Row) -> None:
        if row.name in {"gimbal_device_attitude_status", "mount_orientation"}:
            at = np.array([row.made_s])
            (roll, pitch, _), (_, camera_pitch, yaw) = flight.vehicle_rad(at)[0], flight.camera_rad(at)[0]
            level = _yaw_pitch_roll(np.array([yaw]), np.array([camera_pitch]), np.zeros(1))[0]
            tilted = _yaw_pitch_roll(np.zeros(1), np.array([pitch]), np.array([roll]))[0].T @ level
            angles = (
                math.atan2(tilted[2, 1], tilted[2, 2]),
                -math.asin(tilted[2, 0]),
                math.atan2(tilted[1, 0], tilted[0, 0]),
            )
            if row.name == "mount_orientation":
                row.fields |= dict(zip(("roll", "pitch", "yaw"), map(math.degrees, angles), strict=True))
            else:
                row.fields["q"] = quaternion(*angles)

    return lie


def _place(north_m: float, east_m: float, from_s: float = LIE_FROM_S, to_s: float = SECONDS) -> Lie:
    lat, lon = deg_of(np.array([east_m, north_m]))
    return added(
        "global_position_int", from_s, to_s, lat=round(1e7 * (lat - LAT_DEG)), lon=round(1e7 * (lon - LON_DEG))
    )


def _swapped(row: dict[str, Any], _: float) -> None:
    row["lat"], row["lon"] = row["lon"], row["lat"]


def _random_range(flight: Flight) -> Lie:
    return later("distance_sensor", lambda row, _: row.update(current_distance=int(flight.rng.integers(20, 12_000))))


def _arrivals(step_s: float) -> Lie:
    """The recording machine's clock jumps."""

    def lie(row: Row) -> None:
        if row.made_s >= LIE_FROM_S:
            row.came_s += step_s

    return lie


def _always(lie: Lie) -> Callable[[Flight], Lie]:
    return lambda _: lie


def _lie(lie: Lie, **has: bool) -> Kind:
    return Kind(lie=_always(lie), **has)


def _height(row: dict[str, Any], metres: float) -> None:
    row["relative_alt"] = row["relative_alt"] + round(1000 * metres)


def _random_heights(flight: Flight) -> Lie:
    return later("global_position_int", lambda row, _: _height(row, flight.rng.normal(0, 15)))


HONEST = {
    "honest": Kind(),
    "honest with a rangefinder": Kind(has_rangefinder=True),
    "honest with one gimbal message": Kind(has_mount=False),
    "honest servo mount": Kind(lie=_body_frame, has_mount=False),
}

HEIGHTS = {
    "height steps by 30 m for 5 s": _lie(
        later("global_position_int", lambda r, _: _height(r, 30), to_s=LIE_FROM_S + 5)
    ),
    "height steps by -12 m": _lie(later("global_position_int", lambda r, _: _height(r, -12))),
    "height drifts by 1 m/s": _lie(later("global_position_int", _height)),
    "height is random": Kind(lie=_random_heights),
    "height is stuck": Kind(lie=stuck("global_position_int", "relative_alt")),
    "height is scaled": _lie(scaled("global_position_int", factors={"relative_alt": 1.4})),
    "height is in feet": _lie(scaled("global_position_int", 0, factors={"relative_alt": 1 / 0.3048})),
    "home moves by 20 m": _lie(
        all_of(added("global_position_int", relative_alt=-20_000), added("home_position", altitude=20_000))
    ),
    "height is 3 m while landed": _lie(added("global_position_int", 0, relative_alt=3000)),
    "rangefinder is stuck": Kind(lie=stuck("distance_sensor", "current_distance"), has_rangefinder=True),
    "rangefinder is random": Kind(lie=_random_range, has_rangefinder=True),
    "rangefinder is pinned": _lie(
        later("distance_sensor", lambda row, _: row.update(current_distance=12_999)), has_rangefinder=True
    ),
    "vertical speed is negated": _lie(scaled("global_position_int", factors={"vz": -1})),
}

GIMBALS = {
    "pitch is negated": _lie(gimbal(lambda r, p, y: (r, -p, y))),
    "pitch is negated, alone": _lie(gimbal(lambda r, p, y: (r, -p, y), 0), has_mount=False),
    "pitch is scaled": _lie(gimbal(lambda r, p, y: (r, 0.7 * p, y))),
    "gimbal is stuck": Kind(lie=stuck("gimbal_device_attitude_status", "q")),
    "gimbal is 3 s late": Kind(lie=_delayed(3.0)),
    "degrees in a hundredth": _lie(gimbal(lambda r, p, y: (r / 100, p / 100, y / 100))),
    "degrees hundredfold": _lie(scaled("mount_orientation", factors={"pitch": 100.0})),
    "yaw is off by 60 deg": _lie(gimbal(lambda r, p, y: (r, p, y + 1.05))),
    "roll is 180 deg": _lie(gimbal(lambda r, p, y: (r + math.pi, p, y))),
    "gimbal is NaN": _lie(later("gimbal_device_attitude_status", lambda row, _: row.update(q=[math.nan] * 4))),
    "yaw is said to be against north": _lie(
        later("gimbal_device_attitude_status", lambda row, _: row.update(flags=YAW_IN_EARTH))
    ),
    "mount is wrong by 20 deg": _lie(added("mount_orientation", pitch=20.0)),
}

ATTITUDES = {
    "attitude is stuck": Kind(lie=stuck("attitude", "roll", "pitch", "yaw"), has_mount=False),
    "attitude is in degrees": _lie(
        scaled("attitude", factors=dict.fromkeys(("roll", "pitch", "yaw"), 180 / math.pi)), has_mount=False
    ),
    "heading is off by 90 deg": _lie(later("attitude", lambda row, _: row.update(yaw=wrap(row["yaw"] + math.pi / 2)))),
    "yaw is negated": _lie(scaled("attitude", factors={"yaw": -1.0})),
    "roll and pitch are zero": Kind(
        lie=lambda flight: all_of(_body_frame(flight), scaled("attitude", factors={"roll": 0.0, "pitch": 0.0})),
        has_mount=False,
    ),
}

POSITIONS = {
    "position jumps by 300 m": _lie(_place(300, 0)),
    "position glitches by 40 m for 3 s": _lie(_place(0, 40, to_s=LIE_FROM_S + 3)),
    "position is 15 m off": _lie(_place(15, 0)),
    "position is frozen": Kind(lie=stuck("global_position_int", "lat", "lon")),
    "latitude and longitude are swapped": _lie(later("global_position_int", _swapped)),
    "swapped from the start": _lie(later("global_position_int", _swapped, 0)),
    "position is zero": _lie(scaled("global_position_int", factors={"lat": 0, "lon": 0})),
    "position is in degrees": _lie(scaled("global_position_int", factors={"lat": 1e-7, "lon": 1e-7})),
    "position is another vehicle's": _lie(
        later("global_position_int", lambda row, _: row.update(lat=466_000_000, lon=38_700_000))
    ),
    "position drifts by 2 m/s": _lie(
        later("global_position_int", lambda row, t: row.update(lat=row["lat"] + round(2 * t / 111_000 * 1e7)))
    ),
}


def _drifting(row: Row) -> None:
    if row.made_s >= LIE_FROM_S and "time_boot_ms" in row.fields:
        row.fields["time_boot_ms"] += round(50 * (row.made_s - LIE_FROM_S))


CLOCKS = {
    "time since boot restarts": _lie(clock(lambda ms: ms - round(1000 * (BOOT0_S + LIE_FROM_S)) + 500)),
    "time since boot steps by 5 s": _lie(clock(lambda ms: ms + 5000)),
    "time since boot steps back by 5 s": _lie(clock(lambda ms: ms - 5000)),
    "time since boot is frozen": _lie(clock(lambda _: round(1000 * (BOOT0_S + LIE_FROM_S)))),
    "time since boot runs 5 % fast": _lie(_drifting),
    "gimbal's time is 2 s off": _lie(clock(lambda ms: ms - 2000, "gimbal_device_attitude_status", "mount_orientation")),
    "position's time is 3 s off": _lie(clock(lambda ms: ms - 3000, "global_position_int")),
    "UTC steps by 10 s": _lie(added("system_time", time_unix_usec=10_000_000)),
    "UTC is frozen": Kind(lie=stuck("system_time", "time_unix_usec")),
    "the recording machine's clock steps by 4 s": _lie(_arrivals(4.0)),
}

LIES = {**HEIGHTS, **GIMBALS, **ATTITUDES, **POSITIONS, **CLOCKS}
