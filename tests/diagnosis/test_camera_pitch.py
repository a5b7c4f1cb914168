"""Gimbals with a wrong sign or unit: doctor counts what import measures, and the key that it names corrects them."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

import aerodft as ad
from aerodft.adapters.telemetry import CompositeDecoder, log_formats
from aerodft.adapters.telemetry.mavlink import FollowedIds
from aerodft.geometry import yaw_pitch_roll
from aerodft.model import GimbalTrack
from aerodft.service import AngleScale, block_of
from tests.adapters.telemetry import height_table
from tests.commands import Run, run_aerodft

UTC_NS = 1_795_221_168_000_000_000
SECONDS, TRUE_PITCH_DEG, HEIGHT_M = 20, -40.0, 50.0
RANGE_M = HEIGHT_M / math.sin(math.radians(-TRUE_PITCH_DEG))
STATION = """
[station]
name = "test"
[camera]
name = "c"
width_px = 1920
height_px = 1080
fx_px = 1400
fy_px = 1400
cx_px = 959.5
cy_px = 539.5
[images]
rate_hz = 1
[telemetry]
{more}
[[probe]]
name = "middle"
kind = "range"
pixels = [[959.5, 539.5]]
"""
Report = Callable[[int, float], dialect.MAVLink_message]


def _orientation(pitch: float) -> Report:
    return lambda boot_ms, _: dialect.MAVLink_mount_orientation_message(boot_ms, 0.0, pitch, 0.0)


def _status(raw: float) -> Report:
    return lambda *_: dialect.MAVLink_mount_status_message(1, 1, round(raw), 0, 1)


def _device(pitch_deg: float) -> Report:
    half = math.radians(pitch_deg) / 2
    q = [math.cos(half), 0.0, math.sin(half), 0.0]
    return lambda boot_ms, _: dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, boot_ms, 32, q, math.nan, math.nan, math.nan, 0
    )


def _log(path: Path, report: Report) -> Path:
    """A hover 50 m above home whose gimbal looks 40 deg below the horizon, by such a report of it."""
    mav, log = dialect.MAVLink(None, srcSystem=1, srcComponent=1), bytearray()
    for boot_ms in range(0, SECONDS * 1000, 100):
        messages = [
            dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3),
            dialect.MAVLink_system_time_message(UTC_NS // 1000 + boot_ms * 1000, boot_ms),
            dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.5, 0, 0, 0),
            dialect.MAVLink_global_position_int_message(
                boot_ms, -353_600_000, 1_491_600_000, 640_000, round(HEIGHT_M * 1000), 0, 0, 0, 0
            ),
            report(boot_ms, 0.0),
        ]
        stamp = (UTC_NS // 1000 + boot_ms * 1000).to_bytes(8, "big")
        log += b"".join(stamp + message.pack(mav) for message in messages)
    path.write_bytes(log)
    return path


def _doctor(*arguments: object) -> tuple[Run, dict]:
    done = run_aerodft("doctor", *arguments, "--json")
    return done, json.loads(done.out)


FAULTS = {
    "orientation inverted": (_orientation(40.0), "MOUNT_ORIENTATION", "sign inverted", "ABOVE_HORIZON"),
    "device inverted": (_device(40.0), "GIMBAL_DEVICE_ATTITUDE_STATUS", "sign inverted", "ABOVE_HORIZON"),
    "status inverted": (_status(4000), "MOUNT_STATUS", "sign inverted", "ABOVE_HORIZON"),
    "radians": (_orientation(math.radians(-40.0)), "MOUNT_ORIENTATION", "radians", "ILL_CONDITIONED"),
    "radians inverted": (_orientation(math.radians(40.0)), "MOUNT_ORIENTATION", "radians", "ABOVE_HORIZON"),
    "degrees for centidegrees": (_status(-40), "MOUNT_STATUS", "field of centidegrees", "ILL_CONDITIONED"),
    "centidegrees for degrees": (_orientation(-4000.0), "MOUNT_ORIENTATION", "hundredths of a degree", None),
    "tenths": (_orientation(-400.0), "MOUNT_ORIENTATION", "tenths of a degree", None),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_angle_is_counted_as_import_does_and_its_key_mends_it(tmp_path: Path, fault: str) -> None:
    report, source, cause, status = FAULTS[fault]
    log, config = _log(tmp_path / "a.tlog", report), tmp_path / "station.toml"
    config.write_text(STATION.format(more=""))
    done, found = _doctor(log, "--config", config)
    sees_some_ground = cause in {"radians", "field of centidegrees"}  # at the image's lower border
    assert done.code == (0 if sees_some_ground else 4)
    assert found["poses"]["ok_s"] == 0
    imported = run_aerodft("import", log, "--config", config, "-o", tmp_path / "before", "--json")
    if status is not None:  # else there is no attitude at all
        assert found["poses"]["no_answer_s"] == {status: pytest.approx(SECONDS, abs=1.1)}
        assert imported.json["measurements"] == {status: pytest.approx(SECONDS, abs=1)}
    (sentence,) = [each for each in found["problems"] if cause in each]
    assert source in sentence
    if status is not None:
        assert sentence in imported.err
        assert "never sees the ground" in sentence
    _, without_station = _doctor(log)
    assert sentence in without_station["problems"]

    key = re.search(r"telemetry\.(attitude\.scale\.\w+) = (\{.*\})", sentence)
    assert key is not None
    config.write_text(STATION.format(more=f"{key[1]} = {key[2]}"))
    done, found = _doctor(log, "--config", config)
    assert done.code == 0
    assert found["poses"]["ok_s"] == pytest.approx(SECONDS, abs=1.1)
    assert not [each for each in found["problems"] if cause in each]
    first, again = tmp_path / "first", tmp_path / "again"
    run_aerodft("import", log, "--config", config, "-o", first)
    run_aerodft("recompute", first, "-o", again)
    for recording in (first, again):
        measured = list(ad.open_recording(recording).measurements())
        assert {each["status"] for each in measured} == {"ok"}
        assert [each["value"] for each in measured] == pytest.approx([RANGE_M] * len(measured), rel=0.01)


@pytest.mark.parametrize("report", [_orientation(-40.0), _device(-40.0), _status(-4000)])
def test_a_right_angle_is_not_suspected(tmp_path: Path, report: Report) -> None:
    done, found = _doctor(_log(tmp_path / "a.tlog", report))
    assert done.code == 0
    assert not [each for each in found["problems"] if "attitude.scale" in each]


def test_a_camera_that_looks_up_a_little_is_not_called_inverted(tmp_path: Path) -> None:
    _, found = _doctor(_log(tmp_path / "a.tlog", _device(3.0)))
    assert not [each for each in found["problems"] if "attitude.scale" in each]


def test_a_mount_that_looks_up_is_named(tmp_path: Path) -> None:
    config = tmp_path / "station.toml"
    mount = '[telemetry.attitude]\norder = ["fixed"]\nfixed_mount = { pitch_deg = 40.0 }'
    config.write_text(STATION.format(more=mount))
    _, found = _doctor(_log(tmp_path / "a.tlog", _device(-40.0)), "--config", config)
    assert any("invert telemetry.attitude.fixed_mount.pitch_deg" in each for each in found["problems"])


@pytest.mark.parametrize(("factor", "says"), [("0", "a factor other than 0"), ("1e9", "1e+07")])
def test_an_impossible_factor_is_refused(tmp_path: Path, factor: str, says: str) -> None:
    config = tmp_path / "station.toml"
    config.write_text(STATION.format(more=f"[telemetry.attitude.scale.MOUNT_STATUS]\npitch = {factor}"))
    done = run_aerodft("doctor", _log(tmp_path / "a.tlog", _status(-4000)), "--config", config)
    assert done.code == 3
    assert "telemetry.attitude.scale.MOUNT_STATUS.pitch" in done.err
    assert says in done.err


def test_the_angles_of_a_format_that_knows_nothing_of_factors_are_scaled_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_formats, "LOG_FORMATS", [*log_formats.LOG_FORMATS, height_table])
    line = b"1795221168.0,50.0,50.0\n"  # a tilt of 50 deg
    block = block_of(height_table.PROTOCOL, "a", [UTC_NS], [line])
    scale = {"MOUNT_ORIENTATION": AngleScale(pitch=-1.0)}
    for scales, pitch_deg in (({}, -40.0), (scale, 40.0)):
        tracks = CompositeDecoder(FollowedIds(angle_scales=scales)).decode(block)
        (gimbal,) = (track for track in tracks if isinstance(track, GimbalTrack))
        assert np.degrees(yaw_pitch_roll(gimbal.wxyz)[1]) == pytest.approx([pitch_deg])
