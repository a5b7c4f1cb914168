"""ArduPilot logs with TimeMS (before Copter 3.3), of bytes written here: read as pymavlink reads them, in right UTC."""

import datetime as dt
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink import DFReader
from scipy.spatial.transform import Rotation

import aerodft as ad
from aerodft.adapters.telemetry import DataflashDecoder, open_log
from aerodft.adapters.telemetry.dataflash import gps_to_unix_ns
from aerodft.geometry import yaw_pitch_roll
from aerodft.model import ClockTrack, PositionTrack, RawBlock, Track, VehicleTrack

HEAD = b"\xa3\x95"
CODES = {"B": "B", "H": "H", "I": "I", "h": "h", "c": "h", "C": "H", "e": "i", "L": "i", "f": "f"}
SCALE = {"c": 100, "C": 100, "e": 100, "L": 10**7}
FORMATS = {
    "ATT": (1, "Icccccc", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "GPS": (2, "BIHBcLLeeeefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"),
    "CTUN": (4, "Ihhhffecchh", "TimeMS,ThrIn,AngBst,ThrOut,DAlt,Alt,BarAlt,DSAlt,SAlt,DCRt,CRt"),
    "CAM": (5, "IHLLeeccc", "GPSTime,GPSWeek,Lat,Lng,Alt,RelAlt,Roll,Pitch,Yaw"),
    "GPS2": (6, "BIHBcLLeeefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,T"),
}
BOOT_MS, SECONDS = 75_000, 40
STATION = """
[station]
name = "solo"
[camera]
name = "c"
width_px = 1920
height_px = 1080
hfov_deg = 62.0
[telemetry.attitude]
order = ["fixed"]
fixed_mount = { pitch_deg = -90.0 }
[images]
rate_hz = 1
[[probe]]
name = "middle"
kind = "position"
pixels = [[959.5, 539.5]]
"""


def _format(name: str) -> bytes:
    kind, codes, columns = FORMATS[name]
    size = 3 + struct.calcsize("<" + "".join(CODES[code] for code in codes))
    return HEAD + b"\x80" + struct.pack("<BB4s16s64s", kind, size, name.encode(), codes.encode(), columns.encode())


def _message(name: str, *values: float) -> bytes:
    kind, codes, _ = FORMATS[name]
    fields = [round(v * SCALE[code]) if code in SCALE else v for code, v in zip(codes, values, strict=True)]
    fields = [v if code == "f" else int(v) for code, v in zip(codes, fields, strict=True)]
    return HEAD + bytes([kind]) + struct.pack("<" + "".join(CODES[code] for code in codes), *fields)


def _roll_pitch_yaw_deg(boot_ms: float) -> tuple[float, float, float]:
    at_s = (boot_ms - BOOT_MS) / 1000
    return round(8 * np.sin(at_s), 2), round(5 * np.cos(0.7 * at_s), 2), round((20 + 3 * at_s) % 360, 2)


def _log(path: Path, *, week: int = 1866, week_ms: int = 199_650_000, has_fix: bool = True) -> Path:
    """A climb of 1 m/s; fixes are logged 120 ms after their time."""
    log = bytearray(
        HEAD + b"\x80" + struct.pack("<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    )
    log += b"".join(map(_format, FORMATS))
    for step in range(SECONDS * 10):
        boot_ms = BOOT_MS + 100 * step
        roll, pitch, yaw = _roll_pitch_yaw_deg(boot_ms)
        log += _message("ATT", boot_ms, 0, roll, 0, pitch, 0, yaw)
        log += _message("CTUN", boot_ms, 500, 0, 480, 0.1 * step, 0.1 * step, 0.1 * step, 0, 0, 100, 100)
        if step % 2 == 0:
            fix_ms = boot_ms - 120
            of_week, status = week_ms + (fix_ms - BOOT_MS), 3 if has_fix else 1
            place = (46.5888149, 3.877452) if has_fix else (0, 0)
            height = 0.001 * (fix_ms - BOOT_MS)
            numbers = (of_week if has_fix else 0, week if has_fix else 0, 12, 0.9, *place)
            log += _message("GPS", status, *numbers, height, 300.81 + height, 1.0, 90.0, -1.0, fix_ms)
            log += _message("GPS2", status, *numbers, 300.0, 1.0, 90.0, -1.0, fix_ms)
        if step % 150 == 0:
            log += _message("CAM", of_week, week, 46.5888149, 3.877452, 300.0, 10.0, roll, pitch, yaw)
    path.write_bytes(log)
    return path


def _tracks(path: Path, kind: type[Track]) -> list[Track]:
    decoder = DataflashDecoder()
    blocks = [event for event in open_log(path).events() if isinstance(event, RawBlock)]
    return [track for block in blocks for track in decoder.decode(block) if isinstance(track, kind)]


def _by_pymavlink(path: Path, name: str) -> list[DFReader.DFMessage]:
    log, found = DFReader.DFReader_binary(str(path)), []
    while (message := log.recv_match(type=name)) is not None:
        found.append(message)
    log.filehandle.close()
    log.data_map.close()
    return found


@pytest.mark.parametrize(
    ("week", "week_ms", "utc"),
    [  # leap seconds by the IERS; the dates by Python's calendar
        (1866, 199_650_000, dt.datetime(2015, 10, 13, 7, 27, 13, tzinfo=dt.UTC)),  # 17 s
        (1851, 259_217_000, dt.datetime(2015, 7, 1, 0, 0, 0, tzinfo=dt.UTC)),  # the first second of 17 s
        (1851, 259_214_000, dt.datetime(2015, 6, 30, 23, 59, 58, tzinfo=dt.UTC)),  # 16 s, two before it
        (1721, 0, dt.datetime(2012, 12, 29, 23, 59, 44, tzinfo=dt.UTC)),  # 16 s
        (1600, 0, dt.datetime(2010, 9, 4, 23, 59, 45, tzinfo=dt.UTC)),  # 15 s
        (1930, 18_000, dt.datetime(2017, 1, 1, 0, 0, 0, tzinfo=dt.UTC)),  # 18 s
    ],
)
def test_utc_by_the_leap_seconds_of_the_day(tmp_path: Path, week: int, week_ms: int, utc: dt.datetime) -> None:
    truth_ns = round(utc.timestamp()) * 10**9
    assert gps_to_unix_ns(np.array([week]), np.array([week_ms]))[0] == truth_ns
    path = _log(tmp_path / "a.bin", week=week, week_ms=week_ms + 120)  # so that the first fix is at that time
    (clock,) = _tracks(path, ClockTrack)
    assert clock.unix_ns[0] == truth_ns
    assert clock.boot_ns[0] == (BOOT_MS - 120) * 10**6


def test_attitudes_and_heights_are_pymavlinks(tmp_path: Path) -> None:
    path = _log(tmp_path / "a.bin")
    (vehicle,), (position,) = _tracks(path, VehicleTrack), _tracks(path, PositionTrack)
    theirs = _by_pymavlink(path, "ATT")
    truth = Rotation.from_euler("ZYX", [(m.Yaw, m.Pitch, m.Roll) for m in theirs], degrees=True).as_quat(
        scalar_first=True
    )
    sign = np.sign(np.sum(vehicle.wxyz * truth, axis=-1, keepdims=True))
    np.testing.assert_allclose(vehicle.wxyz * sign, truth, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(vehicle.boot_ns, [m.TimeMS * 10**6 for m in theirs])
    fixes = _by_pymavlink(path, "GPS")
    np.testing.assert_allclose(position.height_home_m, [m.RelAlt for m in fixes], atol=1e-9)
    np.testing.assert_allclose(position.alt_msl_m, [m.Alt for m in fixes], atol=1e-9)
    np.testing.assert_allclose(np.degrees(position.lat_rad), [m.Lat for m in fixes], rtol=1e-15)
    np.testing.assert_array_equal(position.boot_ns, [m.T * 10**6 for m in fixes])


def test_import_measures_at_the_right_time(tmp_path: Path) -> None:
    (tmp_path / "station.toml").write_text(STATION)
    result = ad.import_flight(_log(tmp_path / "a.bin"), station=tmp_path / "station.toml", output=tmp_path / "rec")
    assert result.statistics.poses["ok"] > 30
    start_ns = round(dt.datetime(2015, 10, 13, 7, 27, 13, tzinfo=dt.UTC).timestamp()) * 10**9
    rows = [row for row in ad.open_recording(tmp_path / "rec").measurements() if row["status"] == "ok"]
    assert len(rows) > 30
    for row in rows:
        at_s = (row["stamp_ns"] - start_ns) / 1e9  # of the climb of 1 m/s
        assert row["height_agl_m"] == pytest.approx(at_s, abs=0.02)


def test_without_gps_time_the_attitude_is_read_and_the_clock_is_the_files(tmp_path: Path) -> None:
    path = _log(tmp_path / "a.bin", has_fix=False)
    os.utime(path, (1_445_000_000, 1_445_000_000))
    assert not _tracks(path, ClockTrack)
    assert not _tracks(path, PositionTrack)
    vehicle = np.concatenate([track.wxyz for track in _tracks(path, VehicleTrack)])
    assert len(vehicle) == SECONDS * 10
    arrivals_ns = np.concatenate([track.arrival_ns for track in _tracks(path, VehicleTrack)])
    assert arrivals_ns[-1] == 1_445_000_000 * 10**9
    source = open_log(path)
    list(source.events())
    assert any("no GPS time in the log" in sentence for sentence in source.warnings())
    found = ad.diagnose(path)
    assert any("no UTC" in sentence for sentence in found.problems)


def test_a_byte_of_damage_costs_its_message_alone(tmp_path: Path) -> None:
    path = _log(tmp_path / "a.bin")
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 7] = []
    (tmp_path / "cut.bin").write_bytes(data)
    whole, cut = (sum(len(t.wxyz) for t in _tracks(each, VehicleTrack)) for each in (path, tmp_path / "cut.bin"))
    assert whole - 2 <= cut <= whole


def test_the_published_case(data_folder: Path) -> None:
    path = data_folder / "public/logs/timems.bin"
    (vehicle,), (clock,), (position,) = (_tracks(path, kind) for kind in (VehicleTrack, ClockTrack, PositionTrack))
    angles_deg = np.degrees(np.stack(yaw_pitch_roll(vehicle.wxyz)))
    np.testing.assert_allclose(angles_deg, np.tile([[90.0], [-2.0], [1.5]], (1, 600)), atol=1e-9)
    start = dt.datetime(2015, 10, 13, 7, 27, 13, tzinfo=dt.UTC)
    assert clock.unix_ns[0] == round(start.timestamp()) * 10**9
    assert position.height_home_m.min() == 0
    theirs = [message.RelAlt for message in _by_pymavlink(path, "GPS")]
    np.testing.assert_allclose(position.height_home_m, theirs, atol=1e-9)
    assert [len(t.wxyz) for t in _tracks(data_folder / "public/logs/timeus.bin", VehicleTrack)] == [600]
