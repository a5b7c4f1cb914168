"""Payload rows to telemetry tracks: units to SI, angles to quaternions, and what is no value left out and counted."""

import math
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from aerodft.geometry import from_yaw_pitch_roll, yaw_pitch_roll
from aerodft.model import (
    FIX_3D,
    NO_BOOT_TIME,
    Batch,
    BoolArray,
    CameraTrack,
    ClimbTrack,
    ClockTrack,
    EstimatorTrack,
    FloatArray,
    GimbalFailureTrack,
    GimbalSource,
    GimbalTrack,
    GimbalTypeTrack,
    GpsTrack,
    HeadingTrack,
    HeartbeatTrack,
    HeightSource,
    HeightTrack,
    IntArray,
    LandedTrack,
    PositionTrack,
    ReceiverTrack,
    SyncTrack,
    Track,
    TriggerSource,
    TriggerTrack,
    VehicleTrack,
    ZoomSource,
)
from aerodft.service import AngleScale

MIN_UNIX_NS: Final = 946_684_800 * 10**9  # 2000-01-01
MAX_UNIX_NS: Final = 7_258_118_400 * 10**9  # 2200-01-01
# Beyond any convention for angles: a wrapped angle is at most a full turn.
MAX_ANGLE_RAD: Final = 2 * math.pi + 0.01
# Higher than anything that carries a camera, and farther than any rangefinder sees.
MAX_HEIGHT_M: Final = 50_000.0

_RETRACTED, _NEUTRAL, _YAW_LOCK, _YAW_IN_VEHICLE, _YAW_IN_EARTH = 1, 2, 16, 32, 64
_HAS_ROLL_AXIS, _HAS_TILT_AXIS = 4, 32  # of cap_flags
# Bits of failure_flags. A gimbal at its limit is not where its demand is; that it has no manager (512) says nothing.
GIMBAL_FAILURES = {
    "it is at its roll limit": 1,
    "it is at its pitch limit": 2,
    "it is at its yaw limit": 4,
    "encoder error": 8,
    "power error": 16,
    "motor error": 32,
    "software error": 64,
    "communication error": 128,
    "calibration is running": 256,
    "an unknown one": 0xFFFFFC00,
}
_QUALITY_INVALID = 1
_COVARIANCE_UNKNOWN = 255
_DISTANCE_CLIPPED_CM = 65535
_TERRAIN_UNKNOWN_M = -1000.0
_BOOT_FIELD: Final = "time_boot_ms"
_UNDERGROUND_M = -20.0  # a database without the tile that the vehicle is above
_QUATERNION_NORM_SLACK = 0.1
_MAX_LAT_DEG, _MAX_LON_DEG = 90.0, 180.0
_MAX_BOOT_US = 10**15  # 31 years; more is a Unix time
_CAMERA_NUMBER: Final = "camera_device_id"
MOST_ATTACHED: Final = 6  # cameras that an autopilot speaks for
_MIN_FOV_DEG, _MAX_FOV_DEG = 0.1, 180.0  # a lens of ten metres sees a tenth of a degree
_FULL_LEVEL: Final = 100.0
_SATELLITES_UNKNOWN: Final = 255
_MAX_FIX: Final = 8
_FULL_TURN_CDEG: Final = 36_000
_MIN_TURN_RADPS: Final = 0.05  # chosen: 0.3 deg a row at 10 Hz, far above a gyroscope's drift
_MAX_RATE_RADPS: Final = 100.0  # more than gyroscopes measure (2000 deg/s are 35 rad/s)
_MAX_EULER_PITCH_RAD: Final = 1.4  # nearer to the vertical yaw and roll are one
_MOST_MM: Final = 10**8  # what says that it is off by 100 km says nothing
_HAS_ATTITUDE: Final = 1  # of EKF_STATUS_FLAGS and of ESTIMATOR_STATUS_FLAGS
_UNINITIALIZED: Final = 1024
_MOST_RATIO: Final = 1e6
_ARMED: Final = 128  # of MAV_MODE_FLAG
_LANDED_UNKNOWN, _ON_GROUND = 0, 1  # of MAV_LANDED_STATE
_MAX_CLIMB_MPS: Final = 1000.0  # of anything that carries a camera


NO_SCALE: Final = AngleScale()
"""Of gimbals whose angles are as their messages say."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows(Batch):
    """Rows of one message: ``(n,)`` structured payload, arrival and time since boot (ns).

    ``scale`` is what a field's numbers are multiplied by, where that is not 1; ``angle_scale`` what a gimbal's angles
    are.
    """

    name: str
    payload: npt.NDArray[np.void]
    arrival_ns: IntArray
    boot_ns: IntArray
    scale: Mapping[str, float]
    angle_scale: AngleScale = NO_SCALE

    def column(self, field: str) -> FloatArray:
        """A field as float64, scaled."""
        with np.errstate(invalid="ignore"):  # damaged senders write signalling NaN too
            raw = self.payload[field].astype(np.float64)
        scale = self.scale.get(field, 1.0)
        return raw if scale == 1 else raw * scale

    def wxyz(self, fields: Sequence[str], unit_rad: float) -> FloatArray:
        """Attitudes ``(n, 4)`` of the fields of yaw, pitch and roll."""
        return from_yaw_pitch_roll(*(self.column(field) * unit_rad for field in fields))

    def accepted(self, rejected: Counter[str], faults: dict[str, BoolArray]) -> "Rows":
        """The rows without a fault; a faulty row counts once, under its first fault."""
        bad = np.zeros(len(self.payload), dtype=np.bool_)
        for fault, where in faults.items():
            fresh = int(np.count_nonzero(where & ~bad))
            if fresh:
                rejected[f"{self.name}: {fault}"] += fresh
                bad |= where
        return self.rows(~bad) if bad.any() else self

    def stamps(self) -> dict[str, Any]:
        """The stamps as a track's arguments."""
        return {"arrival_ns": self.arrival_ns, "boot_ns": self.boot_ns}


def is_beyond(values: FloatArray, limit: float) -> BoolArray:
    """Mask of values that are NaN, or larger in size than a limit."""
    return ~(np.abs(values) <= limit)


def no_height(rows: Rows, *fields: str, unit_m: float = 1.0) -> dict[str, BoolArray]:
    """A fault for each field: not finite, or higher than anything flies."""
    return {f"{field} is no height": is_beyond(rows.column(field) * unit_m, MAX_HEIGHT_M) for field in fields}


def no_angle(rows: Rows, *fields: str, unit_rad: float = 1.0) -> dict[str, BoolArray]:
    """A fault for each field: not finite, or more than a full turn."""
    return {f"{field} is no angle": is_beyond(rows.column(field) * unit_rad, MAX_ANGLE_RAD) for field in fields}


def clock_track(rows: Rows, rejected: Counter[str]) -> Track:
    """SYSTEM_TIME; without a fix the time is zero, with a broken clock it is in another century."""
    unix_us = rows.payload["time_unix_usec"]
    early = unix_us < MIN_UNIX_NS // 1000
    good = rows.accepted(rejected, {"no UTC yet": early, "impossible year": unix_us >= MAX_UNIX_NS // 1000})
    return ClockTrack(unix_ns=good.payload["time_unix_usec"].astype(np.int64) * 1000, **good.stamps())


def sync_track(rows: Rows, rejected: Counter[str]) -> Track:
    """TIMESYNC: its sender's own time, in a request (tc1 is 0) as in an answer; the rest is somebody else's."""
    request, answer = rows.payload["ts1"], rows.payload["tc1"]
    own_ns = np.where(answer == 0, request, answer)
    impossible = (own_ns < 0) | (own_ns >= _MAX_BOOT_US * 1000)
    good = replace(rows, boot_ns=own_ns.astype(np.int64)).accepted(rejected, {"no time since boot": impossible})
    return SyncTrack(**good.stamps())


def vehicle_track(
    rows: Rows, rejected: Counter[str], fields: Sequence[str] = ("yaw", "pitch", "roll"), unit_rad: float = 1.0
) -> Track:
    """ATTITUDE, radians; or another message with yaw, pitch and roll in such fields and unit."""
    good = rows.accepted(rejected, no_angle(rows, *reversed(fields), unit_rad=unit_rad))
    return VehicleTrack(wxyz=good.wxyz(fields, unit_rad), **good.stamps())


class StuckAngles:
    """Finds rows of ATTITUDE of which an angle stands still, to the last bit, while their own rates say that it turns.

    An angle that stands still is not believed until it changes, also where the vehicle happens not to turn.
    """

    def __init__(self) -> None:
        self._last: npt.NDArray[np.float64] | None = None  # boot time, roll, pitch, yaw
        self._is_stuck = np.zeros(3, dtype=np.bool_)

    def mask(self, rows: Rows) -> BoolArray:
        """Rows ``(n,)``, after those of the last call, that are stuck."""
        count = len(rows.payload)
        if not count:
            return np.zeros(0, dtype=np.bool_)
        angles = np.stack([rows.column(field) for field in ("roll", "pitch", "yaw")], axis=-1)
        boot_ms = rows.column(_BOOT_FIELD)[:, None]
        own = np.concatenate([boot_ms, angles], axis=-1)
        before = np.concatenate([own[:1] + 1 if self._last is None else self._last, own[:-1]])
        is_same = own[:, 1:] == before[:, 1:]
        turns = np.abs(_euler_rates(rows, angles)) > _MIN_TURN_RADPS
        is_found = is_same & turns & (own[:, :1] > before[:, :1])
        found = np.cumsum(is_found, axis=0)
        # How many had been found when each run of equal angles began; -1 in a run that was stuck in the last call.
        begun = np.maximum.accumulate(np.where(is_same, -1, found), axis=0)
        begun = np.where(begun < 0, np.where(self._is_stuck, -1, 0), begun)
        is_stuck = found > begun
        self._last, self._is_stuck = own[-1:], is_stuck[-1]
        return np.asarray(np.any(is_stuck, axis=-1))


def _euler_rates(rows: Rows, angles: FloatArray) -> FloatArray:
    """Rates ``(n, 3)`` of roll, pitch and yaw, of body rates at ``angles (n, 3)`` of these; 0 where unknown."""
    body_rates = (rows.column(field) for field in ("rollspeed", "pitchspeed", "yawspeed"))
    p, q, r = (np.where(is_beyond(rate, _MAX_RATE_RADPS), 0.0, rate) for rate in body_rates)
    roll, pitch = np.where(is_beyond(angles, MAX_ANGLE_RAD), 0.0, angles)[:, :2].T
    pitch = np.clip(pitch, -_MAX_EULER_PITCH_RAD, _MAX_EULER_PITCH_RAD)
    yaw_rate = (q * np.sin(roll) + r * np.cos(roll)) / np.cos(pitch)
    return np.stack([p + yaw_rate * np.sin(pitch), q * np.cos(roll) - r * np.sin(roll), yaw_rate], axis=-1)


def position_track(
    rows: Rows,
    rejected: Counter[str],
    fields: tuple[str, str, str, str] = ("lat", "lon", "alt", "relative_alt"),
    *,
    per_deg: float = 1e7,
    per_m: float = 1000.0,
    down: str | None = "vz",
) -> Track:
    """GLOBAL_POSITION_INT; before the first fix latitude and longitude are zero.

    Or another message with latitude, longitude, height above the sea and above home in such fields and units, and with
    a speed downwards (cm/s) or none.
    """
    lat, lon, alt, height = fields
    unit_rad = math.radians(1 / per_deg)
    faults = {
        "no position yet": (rows.payload[lat] == 0) & (rows.payload[lon] == 0),
        f"{lat} is no latitude": is_beyond(rows.column(lat), _MAX_LAT_DEG * per_deg),
        f"{lon} is no longitude": is_beyond(rows.column(lon), _MAX_LON_DEG * per_deg),
        **no_height(rows, alt, height, unit_m=1 / per_m),
    }
    good = rows.accepted(rejected, faults)
    return PositionTrack(
        lat_rad=good.column(lat) * unit_rad,
        lon_rad=good.column(lon) * unit_rad,
        alt_msl_m=good.column(alt) / per_m,
        height_home_m=good.column(height) / per_m,
        climb_mps=None if down is None else -good.column(down) / 100,
        **good.stamps(),
    )


def climb_track(rows: Rows, rejected: Counter[str], down: str) -> Track:
    """A message without a position that has a speed downwards (m/s) in such a field."""
    impossible = is_beyond(rows.column(down), _MAX_CLIMB_MPS)
    good = rows.accepted(rejected, {f"{down} is no vertical speed": impossible})
    return ClimbTrack(climb_mps=-good.column(down), **good.stamps())


def landed_track(rows: Rows, rejected: Counter[str]) -> Track:
    """EXTENDED_SYS_STATE: whether the vehicle stands on the ground."""
    good = rows.accepted(rejected, {"landed_state is unknown": rows.payload["landed_state"] == _LANDED_UNKNOWN})
    return LandedTrack(is_landed=good.payload["landed_state"] == _ON_GROUND, **good.stamps())


def gimbal_device_track(rows: Rows, rejected: Counter[str]) -> Track:
    """GIMBAL_DEVICE_ATTITUDE_STATUS: the yaw's frame from the flags, the lock bit only where no frame bit is set.

    PX4 sets neutral, which precedes all locks, and all of them for servos: their yaw is relative to the vehicle.
    """
    q = rows.column("q")
    norm = np.sqrt(np.sum(q * q, axis=-1))
    failures, flags = rows.payload["failure_flags"], rows.payload["flags"]
    faults = {
        **{f"gimbal reports a failure ({words})": (failures & bits) != 0 for words, bits in GIMBAL_FAILURES.items()},
        "gimbal is retracted": (flags & _RETRACTED) != 0,
        "q is no rotation": ~(np.abs(norm - 1) <= _QUATERNION_NORM_SLACK),
    }
    good = rows.accepted(rejected, faults)
    q = good.column("q")
    flags = good.payload["flags"]
    framed = (flags & (_YAW_IN_VEHICLE | _YAW_IN_EARTH)) != 0
    earth = np.where(framed, (flags & _YAW_IN_VEHICLE) == 0, (flags & (_YAW_LOCK | _NEUTRAL)) == _YAW_LOCK)
    return GimbalTrack(
        source=GimbalSource.GIMBAL_DEVICE,
        wxyz=q / np.sqrt(np.sum(q * q, axis=-1, keepdims=True)),
        yaw_in_earth=earth,
        **good.stamps(),
    )


def scaled(track: GimbalTrack, scale: AngleScale) -> GimbalTrack:
    """The track with its yaw, pitch and roll multiplied by the factors, unless its decoder has done so."""
    if track.is_scaled:
        return track
    yaw_rad, pitch_rad, roll_rad = yaw_pitch_roll(track.wxyz)
    wxyz = from_yaw_pitch_roll(yaw_rad * scale.yaw, pitch_rad * scale.pitch, roll_rad * scale.roll)
    return replace(track, wxyz=wxyz, is_scaled=True)


def mount_orientation_track(rows: Rows, rejected: Counter[str]) -> Track:
    """MOUNT_ORIENTATION, degrees; yaw against the vehicle."""
    return mount_track(GimbalSource.MOUNT_ORIENTATION, rows, rejected, ("yaw", "pitch", "roll"), {})


def mount_track(
    source: GimbalSource, rows: Rows, rejected: Counter[str], fields: Sequence[str], faults: dict[str, BoolArray]
) -> Track:
    """A message with yaw (against the vehicle), pitch and roll in such fields, degrees."""
    return _angles_track(source, rows, rejected, fields, faults, unit_rad=math.radians(1))


def mount_status_track(rows: Rows, rejected: Counter[str]) -> Track:
    """MOUNT_STATUS, centidegrees: a is pitch, b is roll, c is yaw against the vehicle; no stamp, zero when unknown."""
    fields = ("pointing_c", "pointing_a", "pointing_b")
    zero = np.logical_and.reduce([rows.payload[field] == 0 for field in fields])
    faults = {"all angles zero": zero}
    return _angles_track(GimbalSource.MOUNT_STATUS, rows, rejected, fields, faults, unit_rad=math.radians(0.01))


def _angles_track(
    source: GimbalSource,
    rows: Rows,
    rejected: Counter[str],
    fields: Sequence[str],
    faults: dict[str, BoolArray],
    *,
    unit_rad: float,
) -> Track:
    """A gimbal's message with yaw (against the vehicle), pitch and roll in such fields, times their factors."""
    scale = rows.angle_scale
    factors = dict(zip(fields, (scale.yaw, scale.pitch, scale.roll), strict=True))
    rows = replace(rows, scale={**rows.scale, **{name: rows.scale.get(name, 1.0) * k for name, k in factors.items()}})
    good = rows.accepted(rejected, {**faults, **no_angle(rows, *reversed(fields), unit_rad=unit_rad)})
    return replace(vehicle_yaw_track(source, good, good.wxyz(fields, unit_rad)), is_scaled=True)


def vehicle_yaw_track(source: GimbalSource, rows: Rows, wxyz: FloatArray) -> GimbalTrack:
    """Attitudes ``(n, 4)`` of a gimbal whose yaw is against the vehicle."""
    return GimbalTrack(source=source, wxyz=wxyz, yaw_in_earth=np.zeros(len(wxyz), dtype=np.bool_), **rows.stamps())


def distance_sensor_track(rows: Rows, rejected: Counter[str]) -> Track:
    """DISTANCE_SENSOR that looks down, centimetres along the body's down axis; what it cannot see is no value."""
    distance, limit = rows.payload["current_distance"], rows.payload["max_distance"]
    faults = {
        "signal quality is invalid": rows.payload["signal_quality"] == _QUALITY_INVALID,
        "distance is zero": distance == 0,
        "distance is clipped": distance == _DISTANCE_CLIPPED_CM,
        "below the sensor's minimum": distance < rows.payload["min_distance"],
        "at the sensor's maximum or above": (limit > 0) & (distance >= limit),
    }
    good = rows.accepted(rejected, faults)
    variance_cm2 = good.column("covariance")
    # Autopilots that know no variance send 0, as often as the agreed 255.
    unknown = (variance_cm2 == _COVARIANCE_UNKNOWN) | (variance_cm2 == 0)
    return HeightTrack(
        source=HeightSource.RANGEFINDER,
        value_m=good.column("current_distance") / 100,
        slant=True,
        std_m=np.where(unknown, np.nan, np.sqrt(variance_cm2) / 100),
        **good.stamps(),
    )


def rangefinder_track(rows: Rows, rejected: Counter[str]) -> Track:
    """RANGEFINDER, metres along the body's down axis; zero before its first reading."""
    distance_m = rows.column("distance")
    faults = {**no_height(rows, "distance"), "distance is zero": distance_m == 0, "distance < 0": distance_m < 0}
    good = rows.accepted(rejected, faults)
    return height_track(HeightSource.RANGEFINDER, good, good.column("distance"), slant=True)


def terrain_track(rows: Rows, rejected: Counter[str]) -> Track:
    """TERRAIN_REPORT: height above the terrain database; with spacing 0 or without a position it is none."""
    faults = {
        "spacing is 0": rows.payload["spacing"] == 0,
        "no position yet": (rows.payload["lat"] == 0) & (rows.payload["lon"] == 0),
        **no_height(rows, "current_height"),
        "far below the ground": rows.payload["current_height"] < _UNDERGROUND_M,
    }
    good = rows.accepted(rejected, faults)
    lat_lon_rad = np.radians(1e-7 * np.stack([good.column("lat"), good.column("lon")], axis=-1))
    track = height_track(HeightSource.TERRAIN, good, good.column("current_height"), slant=False)
    return replace(track, lat_lon_rad=lat_lon_rad)


def altitude_track(rows: Rows, rejected: Counter[str]) -> Track:
    """ALTITUDE: the clearance below; where there is none, the altitude above terrain.

    In this order, because PX4 fills ``altitude_terrain`` with the terrain's own altitude, and always together with a
    clearance.
    """
    clearance_m, terrain_m = rows.column("bottom_clearance"), rows.column("altitude_terrain")
    has_clearance = np.isfinite(clearance_m) & (clearance_m >= 0)
    has_terrain = np.isfinite(terrain_m) & (terrain_m >= _TERRAIN_UNKNOWN_M)
    faults = {
        "bottom_clearance is no height": clearance_m > MAX_HEIGHT_M,
        "altitude_terrain is no height": terrain_m > MAX_HEIGHT_M,
        "no height above terrain": ~(has_clearance | has_terrain),
        "altitude_terrain is far below the ground": ~has_clearance & (terrain_m < _UNDERGROUND_M),
    }
    good = rows.accepted(rejected, faults)
    clearance_m, terrain_m = good.column("bottom_clearance"), good.column("altitude_terrain")
    use_clearance = np.isfinite(clearance_m) & (clearance_m >= 0)
    value_m = np.where(use_clearance, clearance_m, terrain_m)
    return height_track(HeightSource.TERRAIN, good, value_m, slant=False)


def height_track(source: HeightSource, rows: Rows, value_m: FloatArray, *, slant: bool) -> HeightTrack:
    """Heights ``(n,)`` of which no message says how well they are known."""
    return HeightTrack(
        source=source, value_m=value_m, slant=slant, std_m=np.full(len(value_m), np.nan), **rows.stamps()
    )


def boot_ns_of(payload: npt.NDArray[np.void]) -> IntArray:
    """Time since boot in ns ``(n,)``; ``NO_BOOT_TIME`` where the message has none."""
    fields = payload.dtype.names or ()
    if _BOOT_FIELD in fields:
        return payload[_BOOT_FIELD].astype(np.int64) * 1_000_000
    if "time_usec" in fields:
        time_us = payload["time_usec"]
        known = time_us < _MAX_BOOT_US
        return np.where(known, np.where(known, time_us, 0).astype(np.int64) * 1000, NO_BOOT_TIME)
    return np.full(len(payload), NO_BOOT_TIME, dtype=np.int64)


def number_cameras(payload: npt.NDArray[np.void], component: IntArray) -> None:
    """Number the cameras ``(n,)`` as MAVLink's missions do, in place of what the messages say.

    A camera that an autopilot speaks for has a number from 1 to 6 in the message; any other one is a component of its
    own, and says 0: its number is its component's.
    """
    said = payload[_CAMERA_NUMBER]
    payload[_CAMERA_NUMBER] = np.where((said > 0) & (said <= MOST_ATTACHED), said, component)


def fov_track(rows: Rows, rejected: Counter[str]) -> Track:
    """CAMERA_FOV_STATUS, degrees."""
    return _fov_track(ZoomSource.CAMERA_FOV_STATUS, rows, rejected)


def video_stream_track(rows: Rows, rejected: Counter[str]) -> Track:
    """VIDEO_STREAM_INFORMATION: whole degrees, 0 where not known; and the size of the images."""
    return _fov_track(
        ZoomSource.VIDEO_STREAM_INFORMATION, rows, rejected, ("resolution_h", "resolution_v"), stream="stream_id"
    )


def _fov_track(
    source: ZoomSource, rows: Rows, rejected: Counter[str], size: tuple[str, ...] = (), *, stream: str | None = None
) -> Track:
    hfov_deg = rows.column("hfov")
    known = np.logical_or.reduce([rows.payload[field] > 0 for field in size]) if size else False
    impossible = ~((hfov_deg == 0) | ((hfov_deg >= _MIN_FOV_DEG) & (hfov_deg < _MAX_FOV_DEG)))
    good = rows.accepted(
        rejected, {"impossible hfov": impossible, "hfov is not known": (hfov_deg == 0) & ~np.asarray(known)}
    )
    hfov_deg = good.column("hfov")
    sizes = [good.payload[field].astype(np.int64) for field in size] or [_zeros(good)] * 2
    return CameraTrack(
        source=source,
        device=good.payload[_CAMERA_NUMBER].astype(np.int64),
        stream=_zeros(good) if stream is None else good.payload[stream].astype(np.int64),
        hfov_rad=np.where(hfov_deg > 0, np.radians(hfov_deg), np.nan),
        level=np.full(len(hfov_deg), np.nan),
        size_px=np.stack(sizes, axis=-1),
        **good.stamps(),
    )


def settings_track(rows: Rows, rejected: Counter[str]) -> Track:
    """CAMERA_SETTINGS: the zoom in percent of its range, NaN of a camera that cannot zoom."""
    percent = rows.column("zoomLevel")
    outside = ~((percent >= 0) & (percent <= _FULL_LEVEL))
    good = rows.accepted(rejected, {"zoomLevel is not known": np.isnan(percent), "impossible zoomLevel": outside})
    count = len(good.arrival_ns)
    return CameraTrack(
        source=ZoomSource.CAMERA_SETTINGS,
        device=good.payload[_CAMERA_NUMBER].astype(np.int64),
        stream=_zeros(good),
        hfov_rad=np.full(count, np.nan),
        level=good.column("zoomLevel") / _FULL_LEVEL,
        size_px=np.zeros((count, 2), dtype=np.int64),
        **good.stamps(),
    )


def _zeros(rows: Rows) -> IntArray:
    return np.zeros(len(rows.arrival_ns), dtype=np.int64)


def camera_trigger_track(rows: Rows, rejected: Counter[str]) -> Track:
    """CAMERA_TRIGGER: a command to the camera."""
    return _trigger_track(TriggerSource.CAMERA_TRIGGER, rows, rejected, "time_usec")


def camera_feedback_track(rows: Rows, rejected: Counter[str]) -> Track:
    """CAMERA_FEEDBACK: ArduPilot's geotag of an image."""
    return _trigger_track(TriggerSource.CAMERA_FEEDBACK, rows, rejected, "time_usec")


def image_captured_track(rows: Rows, rejected: Counter[str]) -> Track:
    """CAMERA_IMAGE_CAPTURED: the camera's own report of an image; failed ones are left out.

    Its time since boot is the camera's, which may be a component of its own.
    """
    good = rows.accepted(rejected, {"no image was captured": rows.payload["capture_result"] != 1})
    good = replace(good, boot_ns=np.full(len(good.payload), NO_BOOT_TIME, dtype=np.int64))
    return _trigger_track(TriggerSource.IMAGE_CAPTURED, good, rejected, "time_utc")


def _trigger_track(source: TriggerSource, rows: Rows, _rejected: Counter[str], field: str) -> Track:
    unix_us = rows.payload[field]
    is_unix = (unix_us >= MIN_UNIX_NS // 1000) & (unix_us < MAX_UNIX_NS // 1000)
    unix_ns = np.where(is_unix, unix_us, 0).astype(np.int64) * 1000
    return TriggerTrack(source=source, unix_ns=unix_ns, **rows.stamps())


def heartbeat_track(rows: Rows, _rejected: Counter[str]) -> Track:
    """HEARTBEAT of the autopilot."""
    is_armed = (rows.payload["base_mode"] & _ARMED) != 0
    return HeartbeatTrack(autopilot=rows.payload["autopilot"].astype(np.int64), is_armed=is_armed, **rows.stamps())


def gps_track(rows: Rows, rejected: Counter[str]) -> Track:
    """GPS_RAW_INT: the kind of fix, and the accuracy where the receiver states one (0: not stated)."""
    good = rows.accepted(rejected, {"impossible fix type": rows.payload["fix_type"] > _MAX_FIX})
    satellites = good.payload["satellites_visible"].astype(np.int64)
    sent = {**good.stamps(), "boot_ns": np.full(len(satellites), NO_BOOT_TIME, dtype=np.int64)}  # it has the fix's time
    return GpsTrack(
        fix=good.payload["fix_type"].astype(np.int64),
        satellites=np.where(satellites == _SATELLITES_UNKNOWN, -1, satellites),
        horizontal_std_m=_accuracy_m(good, "h_acc"),
        vertical_std_m=_accuracy_m(good, "v_acc"),
        alt_msl_m=good.column("alt") / 1000,
        **sent,
    )


def heading_track(rows: Rows) -> Track:
    """Headings of GLOBAL_POSITION_INT, centidegrees: 65535 where unknown, by some senders 0."""
    good = rows.rows((rows.payload["hdg"] > 0) & (rows.payload["hdg"] < _FULL_TURN_CDEG))
    return HeadingTrack(heading_rad=np.radians(good.column("hdg") / 100), **good.stamps())


def receiver_track(rows: Rows) -> Track:
    """Places of GPS_RAW_INT with a 3D fix, degE7; their stamps are arrivals, as those of ``gps_track``."""
    lat_deg, lon_deg = rows.column("lat") / 1e7, rows.column("lon") / 1e7
    is_fix = (rows.payload["fix_type"] >= FIX_3D) & (rows.payload["fix_type"] <= _MAX_FIX)
    is_place = ~is_beyond(lat_deg, _MAX_LAT_DEG) & ~is_beyond(lon_deg, _MAX_LON_DEG) & ((lat_deg != 0) | (lon_deg != 0))
    good = rows.rows(is_fix & is_place)
    lat_lon_rad = np.radians(np.stack([good.column("lat"), good.column("lon")], axis=-1) / 1e7)
    sent = {**good.stamps(), "boot_ns": np.full(len(lat_lon_rad), NO_BOOT_TIME, dtype=np.int64)}
    return ReceiverTrack(lat_lon_rad=lat_lon_rad, std_m=_accuracy_m(good, "h_acc"), **sent)


def _accuracy_m(rows: Rows, field: str) -> FloatArray:
    accuracy_mm = rows.column(field)
    return np.where((accuracy_mm > 0) & (accuracy_mm < _MOST_MM), accuracy_mm / 1000, np.nan)


def ekf_track(rows: Rows, rejected: Counter[str]) -> Track:
    """EKF_STATUS_REPORT (ArduPilot); flags of 0 come from vehicles whose estimator does not report."""
    fields = ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance")
    return _estimator_track(rows, rejected, fields, {"no estimator yet": rows.payload["flags"] == 0})


def estimator_track(rows: Rows, rejected: Counter[str]) -> Track:
    """ESTIMATOR_STATUS (PX4)."""
    return _estimator_track(rows, rejected, ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"), {})


def _estimator_track(
    rows: Rows, rejected: Counter[str], fields: tuple[str, ...], faults: dict[str, BoolArray]
) -> Track:
    values = {field: rows.column(field) for field in fields}
    impossible = {f"{field} is no ratio": is_beyond(each, _MOST_RATIO) | (each < 0) for field, each in values.items()}
    good = rows.accepted(rejected, {**faults, **impossible})
    flags = good.payload["flags"].astype(np.int64)
    return EstimatorTrack(
        ratios=np.stack([good.column(field) for field in fields], axis=-1),
        has_attitude=((flags & _HAS_ATTITUDE) != 0) & ((flags & _UNINITIALIZED) == 0),
        **good.stamps(),
    )


def gimbal_type_track(rows: Rows, _rejected: Counter[str]) -> Track:
    """GIMBAL_DEVICE_INFORMATION or GIMBAL_MANAGER_INFORMATION: which gimbal it is, by all fields but the time."""
    fields = [field for field in rows.payload.dtype.names or () if field != _BOOT_FIELD]
    said = rows.payload[fields].tolist()
    identity = np.array([zlib.crc32(repr(each).encode()) for each in said])
    cannot_roll = rows.payload["cap_flags"] & (_HAS_ROLL_AXIS | _HAS_TILT_AXIS) == _HAS_TILT_AXIS
    return GimbalTypeTrack(message=rows.name, identity=identity, cannot_roll=cannot_roll, **rows.stamps())


def gimbal_failure_tracks(rows: Rows) -> Iterator[GimbalFailureTrack]:
    """Failures by GIMBAL_DEVICE_ATTITUDE_STATUS: such rows hold no attitude, and others may fill the gap."""
    failures = rows.payload["failure_flags"]
    if not np.any(failures):
        return
    for words, bits in GIMBAL_FAILURES.items():
        failed = (failures & bits) != 0
        if np.any(failed):
            what = f"the gimbal reports a failure ({words})"
            yield GimbalFailureTrack(what=what, arrival_ns=rows.arrival_ns[failed], boot_ns=rows.boot_ns[failed])
