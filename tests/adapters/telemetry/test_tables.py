"""Flight tables of other tools: a public log's own values, and small tables of each layout."""

import math
import random
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest

from aerodft.adapters.telemetry import CompositeDecoder, open_log
from aerodft.errors import InputError
from aerodft.geometry import yaw_pitch_roll
from aerodft.model import GimbalTrack, RawBlock, Track, VehicleTrack
from replay.recordings import Recording
from tests.adapters.telemetry import height_table
from tests.commands import run_aerodft
from tests.nights import at_night

UTC_NS = 1_565_265_600_000_000_000  # 2019-08-08 12:00:00
AIRDATA = (
    "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff(feet),"
    "height_above_ground_at_drone_location(feet),altitude_above_seaLevel(feet),speed(mph), xSpeed(mph),"
    " compass_heading(degrees), pitch(degrees), roll(degrees),isPhoto,isVideo,gimbal_heading(degrees),"
    "gimbal_pitch(degrees),gimbal_roll(degrees),message"
)
LITCHI = (
    "latitude,longitude,altitude(m),ascent(m),speed(mps),time(millisecond),datetime(utc),datetime(local),satellites,"
    "pitch(deg),roll(deg),yaw(deg),gimbalPitchRaw,gimbalRollRaw,gimbalYawRaw"
)


def airdata(count: int = 30) -> str:
    rows = [
        f"{100 * k + 237},2019-08-08 12:00:{(437 + 100 * k) // 1000:02d},{47 + k * 1e-6:.7f},8.5,"
        f"{(40 + k / 10) / 0.3048:.4f},9999,1500.0,3.0,1.0,{170 + k / 10:.1f},-5.0,2.0,0,1,{171 + k / 10:.1f},"
        '-60.0,0.0,"a, b"'
        for k in range(count)
    ]
    return "\n".join([AIRDATA, *rows, ""])


def litchi(count: int = 30) -> str:
    rows = [
        f"{47 + k * 1e-6:.7f},8.5,{40 + k / 10:.1f},0,3.0,{100 * k},2019-08-08 12:00:{k // 10:02d}.{k % 10}00,"
        f"2019-08-08 14:00:{k // 10:02d}.{k % 10}00,15,-5.0,2.0,{170 + k / 10:.1f},-600,0,{1710 + k}"
        for k in range(count)
    ]
    return "\n".join([LITCHI, *rows, ""])


def mission_planner(count: int = 30) -> str:
    lines = ["2019-08-08T14:00:00.000,FE,C, 7D, 1, 1, 2,mavlink_system_time_t,time_unix_usec,1565265600000000,,Len,20"]
    for k in range(count):
        at = f"2019-08-08T14:00:{k // 10:02d}.{k % 10}00"
        lines.append(
            f"{at},FE,1C,7D, 1, 1,1E,mavlink_attitude_t,time_boot_ms,{k},roll,{math.radians(2)},"
            f"pitch,{math.radians(-5)},yaw,{math.radians(170 + k / 10)},rollspeed,0,,Len,36"
        )
        lines.append(
            f"{at},FE,1C,7D, 1, 1,21,mavlink_global_position_int_t,time_boot_ms,{k},lat,{470000000 + 10 * k},"
            f"lon,85000000,alt,500000,relative_alt,{40000 + 100 * k},vx,0,,Len,36"
        )
    return "\r\n".join([*lines, ""])


def tracks_of(path: Path, columns: dict[str, str] | None = None) -> tuple[dict[str, Any], CompositeDecoder]:
    decoder, found = CompositeDecoder(), {}
    for block in open_log(path, columns).events():
        assert isinstance(block, RawBlock)
        for track in decoder.decode(block):
            found[f"{type(track).__name__} {getattr(track, 'source', '')}".strip()] = track
    return found, decoder


def angles(track: Track) -> np.ndarray:
    assert isinstance(track, VehicleTrack | GimbalTrack)
    return np.degrees(np.stack(yaw_pitch_roll(track.wxyz), axis=-1))


def test_a_converted_dji_flight_log(data_folder: Path) -> None:
    path = data_folder / "flights/other/DJI_P4P_TXTlogToCSV_every8th.csv"
    if not path.exists():
        pytest.skip("no flights in the data folder")
    found, decoder = tracks_of(path)
    place, height, gimbal = (found[k] for k in ("PositionTrack", "HeightTrack home", "GimbalTrack table"))
    assert len(place.arrival_ns) == len(height.arrival_ns) == 306
    assert decoder.rejected == Counter()
    np.testing.assert_allclose(np.degrees(place.lat_rad)[[0, -1]], [55.507158, 55.507157], atol=1e-9)
    np.testing.assert_allclose(np.degrees(place.lon_rad)[[0, -1]], [10.717078, 10.717069], atol=1e-9)
    np.testing.assert_allclose(height.value_m[[0, 53, -1]], [0.0, 64.5, 0.6])
    assert np.degrees(yaw_pitch_roll(gimbal.wxyz[0])) == pytest.approx((135.4, 0.0, 0.0), abs=1e-6)
    assert math.degrees(yaw_pitch_roll(gimbal.wxyz[53])[1]) == pytest.approx(-90.0, abs=1e-4)
    seconds = (height.arrival_ns - height.arrival_ns[0]) / 1e9
    np.testing.assert_allclose(seconds[[53, -1]], [42.372, 245.579], atol=1e-6)
    assert "its clock states no zone" in " ".join(open_log(path).warnings())


@pytest.mark.parametrize(("text", "first_ns"), [(airdata(), UTC_NS + 437_000_000), (litchi(), UTC_NS)])
def test_airdata_in_feet_and_litchi_in_tenths(tmp_path: Path, text: str, first_ns: int) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\ufeff" + text, encoding="utf-8")
    found, decoder = tracks_of(path)
    assert decoder.rejected == Counter()
    k = np.arange(30)
    np.testing.assert_allclose(found["HeightTrack home"].value_m, 40 + k / 10, atol=2e-5)
    np.testing.assert_allclose(np.degrees(found["PositionTrack"].lat_rad), 47 + k * 1e-6, atol=1e-9)
    expected = np.stack([171 + k / 10, np.full(30, -60.0), np.zeros(30)], axis=-1)
    np.testing.assert_allclose(angles(found["GimbalTrack table"]), expected, atol=1e-6)
    body = np.stack([170 + k / 10, np.full(30, -5.0), np.full(30, 2.0)], axis=-1)
    np.testing.assert_allclose(angles(found["VehicleTrack"]), body, atol=1e-6)
    stamps = found["PositionTrack"].arrival_ns
    np.testing.assert_allclose(np.diff(stamps), 1e8)
    assert abs(int(stamps[0]) - first_ns) <= 100_000_000  # dates are cut to seconds: known to a row's interval


def test_mission_planners_rows_name_themselves(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(mission_planner())
    found, _ = tracks_of(path)
    k = np.arange(30)
    np.testing.assert_allclose(found["HeightTrack home"].value_m, 40 + k / 10, atol=1e-6)
    body = np.stack([170 + k / 10, np.full(30, -5.0), np.full(30, 2.0)], axis=-1)
    np.testing.assert_allclose(angles(found["VehicleTrack"]), body, atol=1e-6)
    assert abs(int(found["VehicleTrack"].arrival_ns[0]) - UTC_NS) < 10  # the host's zone is taken off by SYSTEM_TIME


def test_stated_columns(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("Zeit;Hoehe ft;Breite;Laenge\n1565265600,5;131,2336;47,5;8,5\n1565265601,5;132,2336;47,5;8,5\n")
    columns = {"unix_s": "Zeit", "height_home_ft": "hoehe FT", "lat_deg": "Breite", "lon_deg": "Laenge"}
    found, _ = tracks_of(path, columns)
    np.testing.assert_allclose(found["HeightTrack home"].value_m, [40.0, 40.3048], atol=1e-6)
    np.testing.assert_allclose(np.degrees(found["PositionTrack"].lat_rad), 47.5)
    assert found["PositionTrack"].arrival_ns[0] == UTC_NS + 500_000_000
    with pytest.raises(InputError, match="not there"):
        open_log(path, {"unix_s": "Zeit", "lat_deg": "Lat"})
    with pytest.raises(InputError, match="names no time"):
        open_log(path, {"lat_deg": "Breite"})
    with pytest.raises(InputError, match="wrong type of file"):
        open_log(path)


def test_heights_without_a_unit_are_not_used(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(airdata().replace("height_above_takeoff(feet)", "height_above_takeoff"))
    assert "HeightTrack home" not in tracks_of(path)[0]


def test_impossible_values_are_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    lines = litchi(6).splitlines()
    lines[1] = lines[1].replace("47.0000000,8.5", "0.0,0.0")
    lines[2] = lines[2].replace("47.0000010", "147.0")
    lines[3] = lines[3].replace(",40.2,", ",9e99,")
    lines[4] = lines[4].replace(",40.3,", ",nan,")
    lines[5] = lines[5].replace(",40.4,", ",4_0,")
    path.write_text("\n".join(lines))
    found, decoder = tracks_of(path)
    assert len(found["PositionTrack"].lat_rad) == 4
    np.testing.assert_allclose(found["HeightTrack home"].value_m, [40.0, 40.1, 40.5])
    assert decoder.rejected == {
        "TABLE: no position yet": 1,
        "TABLE: impossible lat_deg": 1,
        "TABLE: impossible height_home_m": 1,
    }


@pytest.mark.parametrize("first", [0, *at_night(*range(200, 2000, 200))])
def test_damaged_tables_give_what_was_written_or_nothing(tmp_path: Path, first: int) -> None:
    texts = [airdata(), litchi(), mission_planner()]
    path = tmp_path / "log.csv"
    heights = np.round(40 + np.arange(30) / 10, 1)
    for seed in range(first, first + 200):
        draw = random.Random(seed)  # noqa: S311
        data = draw.choice(texts).encode()
        for _ in range(draw.randrange(1, 4)):
            at = draw.randrange(len(data))
            end = data.find(b"\n", at) + 1
            data = draw.choice(
                [
                    data[:end],
                    data[:end] + data[data.find(b"\n", end) + 1 :],
                    data[:end] + draw.randbytes(20).replace(b"\n", b"") + b"\n" + data[end:],
                    data[:end] + b"\n\n" + data[end:],
                    b"\xef\xbb\xbf" + data,
                    data[:at] + b'"' + data[at:],
                    data[:end] + data[end:].replace(b",40", b",nan", 1),
                ]
            )
        path.write_bytes(data)
        try:
            found, _ = tracks_of(path)
        except InputError:
            continue
        track = found.get("HeightTrack home")
        assert track is None or np.abs(track.value_m[:, None] - heights).min(axis=1).max(initial=0.0) < 1e-4, seed
        place = found.get("PositionTrack")
        assert place is None or np.all(np.diff(place.arrival_ns) > 0)


STATION = """
[station]
name = "table"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[images]
rate_hz = 5
[[probe]]
name = "centre"
kind = "range"
pixels = [[31.5, 23.5]]
"""


@pytest.mark.parametrize("own", [False, True])
def test_a_table_is_imported_and_recomputed(tmp_path: Path, *, own: bool) -> None:
    (tmp_path / "camera.toml").write_text('name = "small"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n')
    text = litchi(40)
    station = STATION
    if own:
        text = text.replace("altitude(m)", "alt").replace("gimbal", "cam").replace("datetime(local)", "local")
        station = station.replace(
            "[telemetry.height]",
            '[telemetry.columns]\nutc = "datetime(utc)"\nheight_home_m = "alt"\ngimbal_yaw_decideg = "camYawRaw"\n'
            'gimbal_pitch_decideg = "camPitchRaw"\ngimbal_roll_decideg = "camRollRaw"\n[telemetry.height]',
        )
    (tmp_path / "station.toml").write_text(station)
    (tmp_path / "log.csv").write_text(text)
    done = run_aerodft(
        "import", tmp_path / "log.csv", "-c", tmp_path / "station.toml", "-o", tmp_path / "out", "--json"
    )
    assert done.code == 0, done.err
    found = [orjson.loads(each) for each in Recording(tmp_path / "out").measurements()]
    ok = [each for each in found if each["status"] == "ok"]
    assert len(ok) >= 15
    for each in ok:
        seconds = (int(each["stamp_ns"]) - UTC_NS) / 1e9
        assert each["value"] == pytest.approx((40 + seconds) / math.cos(math.radians(30)), abs=0.01)
    assert run_aerodft("recompute", tmp_path / "out", "-o", tmp_path / "again", "--json").code == 0
    again = [orjson.loads(each)["value"] for each in Recording(tmp_path / "again").measurements()]
    assert again == [each["value"] for each in found]
    done = run_aerodft("doctor", tmp_path / "log.csv", "-c", tmp_path / "station.toml", "--json")
    assert done.code == 0, done.err
    assert done.json["attitudes"][0]["source"] == "table"


def test_another_formats_table_is_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "flight.csv"
    path.write_bytes(height_table._HEADER + b"1,2,3\n")  # noqa: SLF001
    with pytest.raises(InputError, match="wrong type of file"):
        open_log(path)
