"""Every field that is used, of every frame of every recorded flight, against pymavlink and scipy."""

import math
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from scipy.spatial.transform import Rotation

from aerodft.adapters.telemetry import TlogSource
from aerodft.adapters.telemetry.mavlink import MavlinkDecoder
from aerodft.model import (
    NO_BOOT_TIME,
    ClockTrack,
    GimbalTrack,
    HeightTrack,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
)
from tests.nights import at_night

LOGS = [
    "logs/dronekit_quad.tlog",
    "logs/vtol.tlog",
    "sitl/cold_boot.tlog",
    "sitl/servo_consumer.tlog",
    *at_night("sitl/brushless_consumer.tlog", "sitl/brushless_ctl.tlog"),
]
USED = [
    "SYSTEM_TIME",
    "ATTITUDE",
    "GLOBAL_POSITION_INT",
    "DISTANCE_SENSOR",
    "RANGEFINDER",
    "TERRAIN_REPORT",
    "GIMBAL_DEVICE_ATTITUDE_STATUS",
    "MOUNT_STATUS",
]


def _theirs(path: Path) -> dict[str, list[Any]]:
    """Messages by pymavlink, those of system 1 by type, and all good ones under ``*``."""
    log = mavutil.mavlink_connection(str(path))
    found: dict[str, list[Any]] = defaultdict(list)
    while (message := log.recv_msg()) is not None:
        if message.get_type() != "BAD_DATA":
            found["*"].append(bytes(message.get_msgbuf()))
            if message.get_type() in USED and message.get_srcSystem() == 1:
                found[message.get_type()].append(message)
    log.close()
    return found


@cache
def _flight(path: Path) -> tuple[dict[str, list[Any]], list[RawBlock]]:
    return _theirs(path), [event for event in TlogSource(path).events() if isinstance(event, RawBlock)]


def _tracks(blocks: list[RawBlock]) -> dict[str, Track]:
    """Our tracks, joined, by kind and source."""
    decoder = MavlinkDecoder()
    parts: dict[str, list[Track]] = defaultdict(list)
    for block in blocks:
        for track in decoder.decode(block):
            parts[type(track).__name__ + str(getattr(track, "source", ""))].append(track)
    return {key: _joined(tracks) for key, tracks in parts.items()}


def _joined(tracks: list[Track]) -> Track:
    first = tracks[0]
    values = {}
    for name in _fields(first):
        column = [getattr(track, name) for track in tracks]
        values[name] = np.concatenate(column) if isinstance(column[0], np.ndarray) else column[0]
    return type(first)(**values)


def _fields(track: Track) -> list[str]:
    return [name for kind in type(track).__mro__ for name in getattr(kind, "__slots__", ())]


def _zyx(yaw: list[float], pitch: list[float], roll: list[float]) -> np.ndarray:
    return Rotation.from_euler("ZYX", np.transpose([yaw, pitch, roll])).as_quat(scalar_first=True)


def _assert_rotations(ours: np.ndarray, theirs: np.ndarray, atol_rad: float = 1e-6) -> None:
    sign = np.sign(np.sum(ours * theirs, axis=-1, keepdims=True))
    np.testing.assert_allclose(ours * sign, theirs, rtol=0, atol=atol_rad)


@pytest.fixture(params=LOGS)
def flight(request: pytest.FixtureRequest, data_folder: Path) -> tuple[dict[str, list[Any]], list[RawBlock]]:
    return _flight(data_folder / request.param)


def test_the_same_frames_as_pymavlink(flight: tuple[dict[str, list[Any]], list[RawBlock]]) -> None:
    theirs, blocks = flight
    ours = [b.data[o : o + n] for b in blocks for o, n in zip(b.offset.tolist(), b.length.tolist(), strict=True)]
    assert ours == theirs["*"]


def test_clock_attitude_and_position_are_pymavlinks(flight: tuple[dict[str, list[Any]], list[RawBlock]]) -> None:
    theirs, blocks = flight
    tracks = _tracks(blocks)
    clock, vehicle, position = (tracks[kind] for kind in ("ClockTrack", "VehicleTrack", "PositionTrack"))
    assert isinstance(clock, ClockTrack)
    assert isinstance(vehicle, VehicleTrack)
    assert isinstance(position, PositionTrack)
    times = [m for m in theirs["SYSTEM_TIME"] if m.time_unix_usec]
    np.testing.assert_array_equal(clock.unix_ns, [m.time_unix_usec * 1000 for m in times])
    np.testing.assert_array_equal(clock.boot_ns, [m.time_boot_ms * 10**6 for m in times])
    attitudes = theirs["ATTITUDE"]
    np.testing.assert_array_equal(vehicle.boot_ns, [m.time_boot_ms * 10**6 for m in attitudes])
    arrival_us = np.array([round(m._timestamp * 1e6) for m in attitudes])  # noqa: SLF001 - pymavlink's own way
    assert np.abs(vehicle.arrival_ns // 1000 - arrival_us).max() <= 1
    _assert_rotations(
        vehicle.wxyz, _zyx([m.yaw for m in attitudes], [m.pitch for m in attitudes], [m.roll for m in attitudes])
    )
    fixes = [m for m in theirs["GLOBAL_POSITION_INT"] if m.lat or m.lon]
    np.testing.assert_allclose(position.lat_rad, [math.radians(m.lat / 1e7) for m in fixes], rtol=1e-15)
    np.testing.assert_allclose(position.lon_rad, [math.radians(m.lon / 1e7) for m in fixes], rtol=1e-15)
    np.testing.assert_array_equal(position.alt_msl_m, [m.alt / 1000 for m in fixes])
    np.testing.assert_array_equal(position.height_home_m, [m.relative_alt / 1000 for m in fixes])


def test_heights_are_pymavlinks(flight: tuple[dict[str, list[Any]], list[RawBlock]]) -> None:
    theirs, blocks = flight
    tracks = _tracks(blocks)
    down = [m for m in theirs["DISTANCE_SENSOR"] if m.orientation == 25]
    good = [m for m in down if max(m.min_distance, 1) <= m.current_distance < m.max_distance]
    sensor = tracks.get("HeightTrackrangefinder")
    if good:
        assert isinstance(sensor, HeightTrack)
        assert sensor.slant
        np.testing.assert_array_equal(sensor.value_m, [m.current_distance / 100 for m in good])
        np.testing.assert_array_equal(sensor.boot_ns, [m.time_boot_ms * 10**6 for m in good])
    else:
        assert sensor is None
    reports = [m for m in theirs["TERRAIN_REPORT"] if m.spacing and (m.lat or m.lon) and m.current_height >= -20]
    terrain = tracks.get("HeightTrackterrain")
    assert (terrain is None) == (not reports)
    if isinstance(terrain, HeightTrack):
        assert not terrain.slant
        np.testing.assert_array_equal(terrain.value_m, [m.current_height for m in reports])
        assert (terrain.boot_ns == NO_BOOT_TIME).all()


def test_gimbals_are_pymavlinks(flight: tuple[dict[str, list[Any]], list[RawBlock]]) -> None:
    theirs, blocks = flight
    tracks = _tracks(blocks)
    device = tracks.get("GimbalTrackGIMBAL_DEVICE_ATTITUDE_STATUS")
    assert (device is None) == (not theirs["GIMBAL_DEVICE_ATTITUDE_STATUS"])
    if isinstance(device, GimbalTrack):
        messages = theirs["GIMBAL_DEVICE_ATTITUDE_STATUS"]
        _assert_rotations(device.wxyz, np.array([m.q for m in messages]))
        np.testing.assert_array_equal(device.yaw_in_earth, [not m.flags & 32 for m in messages])
        np.testing.assert_array_equal(device.boot_ns, [m.time_boot_ms * 10**6 for m in messages])
    mount = tracks.get("GimbalTrackMOUNT_STATUS")
    messages = [m for m in theirs["MOUNT_STATUS"] if m.pointing_a or m.pointing_b or m.pointing_c]
    assert (mount is None) == (not messages)
    if isinstance(mount, GimbalTrack):
        yaw, pitch, roll = ([math.radians(getattr(m, f"pointing_{k}") / 100) for m in messages] for k in "cab")
        _assert_rotations(mount.wxyz, _zyx(yaw, pitch, roll))
        assert not mount.yaw_in_earth.any()
        assert (mount.boot_ns == NO_BOOT_TIME).all()


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_tracks_do_not_depend_on_how_frames_are_cut(data_folder: Path, size: int) -> None:
    blocks = _flight(data_folder / "sitl/cold_boot.tlog")[1]
    whole = _tracks(blocks)
    cut = _tracks([b.rows(slice(k, k + size)) for b in blocks for k in range(0, len(b.offset), size)])
    assert whole.keys() == cut.keys()
    for key, track in whole.items():
        for name in _fields(track):
            np.testing.assert_array_equal(getattr(cut[key], name), getattr(track, name), err_msg=f"{key}.{name}")
