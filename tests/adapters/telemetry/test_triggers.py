"""Triggers of the camera in logs of every format, and photos that are stamped by them."""

import io
import struct
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest
from PIL import Image
from pymavlink.dialects.v20 import ardupilotmega as common

from aerodft.adapters.telemetry import CompositeDecoder, open_log
from aerodft.model import RawBlock, TriggerTrack
from replay.recordings import Recording
from tests.adapters.telemetry import ulog_writer as w
from tests.commands import run_aerodft

UTC_US = 1_795_221_168_000_000
LEVEL = (1.0, 0.0, 0.0, 0.0)


def triggers_of(path: Path) -> dict[str, list[TriggerTrack]]:
    decoder: CompositeDecoder = CompositeDecoder()
    found: dict[str, list[TriggerTrack]] = {}
    for block in open_log(path).events():
        assert isinstance(block, RawBlock)
        for track in decoder.decode(block):
            if isinstance(track, TriggerTrack):
                found.setdefault(str(track.source), []).append(track)
    return found


def test_mavlink(tmp_path: Path) -> None:
    mav = common.MAVLink(io.BytesIO(), srcSystem=1, srcComponent=1)
    camera = common.MAVLink(io.BytesIO(), srcSystem=1, srcComponent=100)
    messages = [
        (mav, mav.heartbeat_encode(2, 3, 0, 0, 4)),
        (mav, common.MAVLink_camera_trigger_message(5_000_000, 7)),
        (mav, common.MAVLink_camera_feedback_message(UTC_US + 9, 0, 0, 7, 1, 2, 3.0, 4.0, 0, 0, 0, 0, 1)),
        (camera, common.MAVLink_camera_image_captured_message(123, UTC_US + 5, 1, 0, 0, 0, 0, [1, 0, 0, 0], 3, 1, b"")),
        (camera, common.MAVLink_camera_image_captured_message(129, UTC_US + 6, 1, 0, 0, 0, 0, [1, 0, 0, 0], 4, 0, b"")),
    ]
    path = tmp_path / "log.tlog"
    stamped = [struct.pack(">Q", UTC_US + k * 1000) + each.pack(sender) for k, (sender, each) in enumerate(messages)]
    path.write_bytes(b"".join(stamped))
    found = triggers_of(path)
    assert found["CAMERA_TRIGGER"][0].boot_ns.tolist() == [5_000_000_000]
    assert found["CAMERA_FEEDBACK"][0].unix_ns.tolist() == [(UTC_US + 9) * 1000]
    assert found["CAMERA_IMAGE_CAPTURED"][0].unix_ns.tolist() == [(UTC_US + 5) * 1000]
    assert found["CAMERA_IMAGE_CAPTURED"][0].boot_ns.tolist() == [-1]  # the camera's own


def test_dataflash(tmp_path: Path) -> None:
    def fmt(kind: int, length: int, name: bytes, codes: bytes, columns: bytes) -> bytes:
        return struct.pack("<3sBB4s16s64s", b"\xa3\x95\x80", kind, length, name, codes, columns)

    parts = [
        fmt(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"),
        fmt(1, 15, b"CAM", b"QI", b"TimeUS,GPSTime"),
        fmt(2, 15, b"TRIG", b"QI", b"TimeUS,GPSTime"),
    ]
    for k in range(20):
        parts.append(struct.pack("<3sQI", b"\xa3\x95\x02", 1_000_000 + k * 900_000, k))
        parts.append(struct.pack("<3sQI", b"\xa3\x95\x01", 1_060_000 + k * 900_000, k))
    path = tmp_path / "log.bin"
    path.write_bytes(b"".join(parts))
    found = triggers_of(path)
    assert np.concatenate([t.boot_ns for t in found["CAM"]])[:2].tolist() == [1_060_000_000, 1_960_000_000]
    assert sum(len(track.boot_ns) for track in found["TRIG"]) >= 19


def flight(folder: Path, seed: int = 1) -> tuple[Path, np.ndarray]:
    """A PX4 log with 40 captures, and their times since its start (s)."""
    rng = np.random.default_rng(seed)
    captured_s = 3 + np.cumsum(rng.uniform(1.2, 4.0, 40))
    log = w.UlogWriter()
    attitude, home = log.subscribe("vehicle_attitude", w.ATTITUDE), log.subscribe("home_position", w.HOME)
    local, gps = log.subscribe("vehicle_local_position", w.LOCAL), log.subscribe("vehicle_gps_position", w.NEW_GPS)
    capture, trigger = log.subscribe("camera_capture", w.CAPTURE), log.subscribe("camera_trigger", w.TRIGGER)
    log.add(home, 500_000, 0.0, 0.0, 0.0, 0.0, 1)
    due = iter(captured_s)
    next_s = next(due)
    for step in range(int(captured_s[-1] * 10) + 30):
        at_us = 1_000_000 + 100_000 * step
        log.add(attitude, at_us, *LEVEL)
        log.add(local, at_us, -(20.0 + step / 100), 0.0, 0.0, 0.0, 1, 0, 0, 0)
        log.add(gps, at_us, UTC_US + at_us, 47.0, 8.0, 500.0, 0.5, 0.8, 0, 3, 12)
        while at_us / 1e6 + 0.1 > next_s:
            log.add(trigger, round(next_s * 1e6) - 80_000, 0, 0, 0)
            log.add(capture, round(next_s * 1e6), 0, 0, 0.0, 0.0, 0.0, 1)
            next_s = next(due, 1e9)
    path = folder / "flight.ulg"
    path.write_bytes(log.file())
    return path, captured_s


STATION = """
[station]
name = "survey"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[telemetry.attitude]
order = ["fixed"]
fixed_mount = { yaw_deg = 0.0, pitch_deg = -90.0, roll_deg = 0.0 }
[record]
image_hz = 0
[[probe]]
name = "centre"
kind = "range"
pixels = [[31.5, 23.5]]
"""


@pytest.fixture
def survey(tmp_path: Path) -> tuple[Path, np.ndarray, np.ndarray]:
    """A folder with station, log and photos by a clock 3271.4 s behind; and the captures, and those with a photo."""
    (tmp_path / "camera.toml").write_text('name = "small"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n')
    (tmp_path / "station.toml").write_text(STATION)
    _, captured_s = flight(tmp_path)
    kept = np.delete(np.arange(40), [0, 17, 18, 33])
    (tmp_path / "photos").mkdir()
    for number, event in enumerate(kept.tolist()):
        shown = datetime.fromtimestamp(int(UTC_US / 1e6 + captured_s[event] - 3271.4), tz=UTC)
        image, exif = Image.new("RGB", (64, 48)), Image.Exif()
        exif.get_ifd(0x8769)[0x9003] = shown.strftime("%Y:%m:%d %H:%M:%S")
        image.save(tmp_path / "photos" / f"DSC{number:05d}.JPG", exif=exif)
    return tmp_path, captured_s, kept


def imported(folder: Path, *options: str) -> tuple[Any, list[dict[str, Any]]]:
    out = folder / f"out{len(options)}"
    words = ("import", folder / "flight.ulg", "--images", folder / "photos", "-c", folder / "station.toml")
    done = run_aerodft(*words, "-o", out, "--json", *options)
    found = [] if done.code else [orjson.loads(each) for each in Recording(out).measurements()]
    return done, found


def test_photos_are_stamped_by_the_log(survey: tuple[Path, np.ndarray, np.ndarray]) -> None:
    folder, captured_s, kept = survey
    done, found = imported(folder)
    assert done.code == 0, done.err
    stamps_s = np.array([int(each["stamp_ns"]) / 1e9 - UTC_US / 1e6 for each in found])
    np.testing.assert_allclose(stamps_s, captured_s[kept], atol=2e-3)
    heights_m = [each["value"] for each in found if each["status"] == "ok"]
    assert len(heights_m) == len(kept)
    np.testing.assert_allclose(heights_m, 20 + (captured_s[kept] - 1) / 10, atol=0.02)
    said = " ".join(done.err.split())
    assert "36 of 36 photos are stamped by camera_capture: UTC is the camera's clock +3271." in said
    assert "3 camera_capture messages without a photo" in said  # the first one may be the camera's late start


def test_sync_off_keeps_the_photos_own_clock(survey: tuple[Path, np.ndarray, np.ndarray]) -> None:
    folder, *_ = survey
    done, _ = imported(folder, "--sync", "off")
    assert done.code == 3
    assert "do not overlap in time" in done.err
