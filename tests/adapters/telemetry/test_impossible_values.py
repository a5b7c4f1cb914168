"""A valid frame may hold a value that cannot be: its row is left out and counted by field, its neighbours stay."""

import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.model import (
    GimbalTrack,
    HeartbeatTrack,
    HeightTrack,
    LinkTrack,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
)

Decode = Callable[..., tuple[Track, ...]]

NAN, INF = math.nan, math.inf
NOT_FINITE = (NAN, INF, -INF)
SIGNALLING_NAN = struct.unpack("<f", struct.pack("<I", 0x7F800001))[0]

GOOD: dict[str, dict[str, Any]] = {
    "ATTITUDE": {
        "time_boot_ms": 5000,
        "roll": 0.1,
        "pitch": -0.2,
        "yaw": 0.3,
        "rollspeed": 0,
        "pitchspeed": 0,
        "yawspeed": 0,
    },
    "GLOBAL_POSITION_INT": {
        "time_boot_ms": 5000,
        "lat": -353_632_621,
        "lon": 1_491_652_374,
        "alt": 584_090,
        "relative_alt": 50_000,
        "vx": 0,
        "vy": 0,
        "vz": 0,
        "hdg": 65535,
    },
    "GIMBAL_DEVICE_ATTITUDE_STATUS": {
        "target_system": 0,
        "target_component": 0,
        "time_boot_ms": 5000,
        "flags": 44,
        "q": (1.0, 0.0, 0.0, 0.0),
        "angular_velocity_x": NAN,
        "angular_velocity_y": NAN,
        "angular_velocity_z": NAN,
        "failure_flags": 0,
    },
    "MOUNT_ORIENTATION": {"time_boot_ms": 5000, "roll": 5.0, "pitch": -60.0, "yaw": 20.0},
    "MOUNT_STATUS": {
        "target_system": 0,
        "target_component": 0,
        "pointing_a": -6000,
        "pointing_b": 500,
        "pointing_c": 2000,
    },
    "RANGEFINDER": {"distance": 12.5, "voltage": 0},
    "TERRAIN_REPORT": {
        "lat": -353_632_621,
        "lon": 1_491_652_374,
        "spacing": 100,
        "terrain_height": 540.0,
        "current_height": 44.0,
        "pending": 0,
        "loaded": 504,
    },
    "ALTITUDE": {
        "time_usec": 7_000_000,
        "altitude_monotonic": 0,
        "altitude_amsl": 0,
        "altitude_local": 0,
        "altitude_relative": 0,
        "altitude_terrain": 31.0,
        "bottom_clearance": 30.0,
    },
}
POISON = [
    *(("ATTITUDE", field, value, "no angle") for field in ("roll", "pitch", "yaw") for value in (*NOT_FINITE, 1e30)),
    *(("MOUNT_ORIENTATION", f, v, "no angle") for f in ("roll", "pitch", "yaw") for v in (*NOT_FINITE, 3.4e38, 721)),
    *(
        ("MOUNT_STATUS", f, v, "no angle")
        for f in ("pointing_a", "pointing_b", "pointing_c")
        for v in (72_100, -(2**31))
    ),
    *(("GLOBAL_POSITION_INT", "lat", lat, "no latitude") for lat in (910_000_000, -910_000_000, -(2**31))),
    *(("GLOBAL_POSITION_INT", "lon", lon, "no longitude") for lon in (1_810_000_000, 2**31 - 1, -(2**31))),
    *(("GLOBAL_POSITION_INT", f, v, "no height") for f in ("alt", "relative_alt") for v in (10**9, -(2**31))),
    *(("GIMBAL_DEVICE_ATTITUDE_STATUS", "q", q, "no rotation") for q in ((0.0,) * 4, (NAN,) * 4, (1.0, INF, 0.0, 0.0))),
    *(("GIMBAL_DEVICE_ATTITUDE_STATUS", "q", q, "no rotation") for q in ((3e38,) * 4, (2.0, 0.0, 0.0, 0.0))),
    *(("RANGEFINDER", "distance", value, "no height") for value in (*NOT_FINITE, SIGNALLING_NAN, 1e30)),
    *(("TERRAIN_REPORT", "current_height", value, "no height") for value in (*NOT_FINITE, SIGNALLING_NAN, 1e30, -1e30)),
    *(
        ("ALTITUDE", field, value, "no height")
        for field in ("altitude_terrain", "bottom_clearance")
        for value in (INF, 1e30)
    ),
]


def message(name: str, **fields: object) -> dialect.MAVLink_message:
    return getattr(dialect, f"MAVLink_{name.lower()}_message")(**{**GOOD[name], **fields})


@pytest.fixture
def decode(pack: Callable[..., bytes], block: Callable[[list[bytes]], RawBlock]) -> Decode:
    autopilot = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)

    def decoded(decoder: MavlinkDecoder, *messages: dialect.MAVLink_message) -> tuple[Track, ...]:
        tracks = decoder.decode(block([pack(each) for each in (autopilot, *messages)]))
        return tuple(track for track in tracks if not isinstance(track, HeartbeatTrack | LinkTrack))

    return decoded


def values_of(track: Track) -> np.ndarray:
    match track:
        case VehicleTrack() | GimbalTrack():
            return track.wxyz
        case PositionTrack():
            return np.stack([track.lat_rad, track.lon_rad, track.alt_msl_m, track.height_home_m], axis=-1)
        case HeightTrack():
            return track.value_m
    raise AssertionError(track)


@pytest.mark.parametrize(("name", "field", "value", "what"), POISON)
def test_it_is_left_out_and_counted(decode: Decode, name: str, field: str, value: object, what: str) -> None:
    decoder = MavlinkDecoder()
    (track,) = decode(decoder, message(name), message(name, **{field: value}), message(name))
    (alone,) = decode(MavlinkDecoder(), message(name))
    np.testing.assert_array_equal(values_of(track), np.concatenate([values_of(alone)] * 2))
    assert decoder.rejected == {f"{name}: {field} is {what}": 1}


@pytest.mark.parametrize("name", GOOD)
def test_what_can_be_is_kept(decode: Decode, name: str) -> None:
    decoder = MavlinkDecoder()
    (track,) = decode(decoder, message(name))
    assert np.isfinite(values_of(track)).all()
    assert not decoder.rejected
