"""MISB KLV: against the standard's examples, rotations by SciPy, and flights that a small writer makes."""

import math
import random
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest
from scipy.spatial.transform import Rotation

from aerodft.adapters.telemetry import CompositeDecoder, carries_telemetry, klv, open_log
from aerodft.errors import InputError
from aerodft.model import CameraTrack, GimbalTrack, HeightTrack, PositionTrack, RawBlock, Track, VehicleTrack
from replay.recordings import Recording
from tests.adapters.telemetry import gpmf_writer as gpmf
from tests.adapters.telemetry import klv_writer as w
from tests.commands import run_aerodft
from tests.nights import at_night

START_US = 1_700_000_000_000_000
HEIGHT_M, LAT, LON, GROUND_M = 80.0, 47.0, 8.0, 430.0
PLATFORM = {5: 40.0, 6: 3.0, 7: -2.0}
SENSOR = {18: 350.0, 19: -60.0, 20: 1.0}


def axis_ned(values: dict[int, float]) -> np.ndarray:
    """The optical axis: the sensor's yaw, elevation and roll behind the platform's heading, pitch and roll."""
    platform = Rotation.from_euler("ZYX", [values[tag] for tag in (5, 6, 7)], degrees=True)
    sensor = Rotation.from_euler("ZYX", [values[tag] for tag in (18, 19, 20)], degrees=True)
    return (platform * sensor).apply([1.0, 0.0, 0.0])


def values_at(step: int, **changes: float) -> dict[int, float]:
    values = {**PLATFORM, **SENSOR, 13: LAT + step * 2e-6, 14: LON, 15: GROUND_M + HEIGHT_M, 16: 60.0, 25: GROUND_M}
    values[5] = (values[5] + step) % 360
    north_m, east_m, _ = axis_ned(values) * HEIGHT_M / axis_ned(values)[2]
    values[23] = values[13] + math.degrees(north_m / 6_371_000)
    values[24] = values[14] + math.degrees(east_m / 6_371_000 / math.cos(math.radians(LAT)))
    return {**values, **{int(tag[1:]): value for tag, value in changes.items()}}


def flight(count: int = 40, **changes: float) -> list[bytes]:
    return [w.local_set(START_US + step * 100_000, values_at(step, **changes)) for step in range(count)]


def written(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "flight.klv"
    path.write_bytes(data)
    return path


def tracks_of(path: Path) -> tuple[dict[type[Track], list[Any]], dict[str, int], tuple[str, ...]]:
    """Tracks by kind, what was left out, and the reader's sentences."""
    source, decoder = open_log(path), CompositeDecoder()
    found: dict[type[Track], list[Any]] = {}
    for block in source.events():
        assert isinstance(block, RawBlock)
        for track in decoder.decode(block):
            found.setdefault(type(track), []).append(track)
    return found, dict(decoder.rejected), source.warnings()


def test_values_of_the_standards_example(data_folder: Path) -> None:
    """ST 0902's example carries a wrong checksum (klvdata says 3E1E as well), and is discarded with it."""
    path = data_folder / "flights/other/DynamicConstantMISMMSPacketData.bin"
    if not path.exists():
        pytest.skip("no flights in the data folder")
    with pytest.raises(InputError, match="wrong checksum"):
        open_log(path)
    data = path.read_bytes()[:-2]
    assert w.checksum(data).hex() == "3e1e"
    values, fault = klv._read_set(data + w.checksum(data))  # noqa: SLF001
    assert not fault
    expected = {
        5: 159.974,
        6: -0.4315,
        7: 3.4059,
        13: 60.176823,
        14: 128.426759,
        15: 14190.72,
        18: 160.719,
        19: -168.792,
        20: 176.865,
        23: -10.542389,
        24: 29.157890,
        25: 3216.04,
    }
    for tag, value in expected.items():
        assert values[tag] == pytest.approx(value, abs=6e-3 if tag in {15, 25} else 6e-4)
    assert values[2] == 1_231_798_102_000_000_000  # 2009-01-12 22:08:22 UTC


@pytest.mark.parametrize("in_video", [False, True])
def test_a_flight_is_read_as_it_was_written(tmp_path: Path, *, in_video: bool) -> None:
    path = tmp_path / "flight.ts"
    if in_video:
        w.transport_stream(path, flight())
    else:
        path = written(tmp_path, b"".join(flight()))
    assert carries_telemetry(path) == in_video
    found, rejected, _ = tracks_of(path)
    assert not rejected
    (place,), (height,), (camera,) = found[PositionTrack], found[HeightTrack], found[GimbalTrack]
    np.testing.assert_allclose(np.degrees(place.lat_rad), [LAT + step * 2e-6 for step in range(40)], atol=1e-7)
    np.testing.assert_allclose(place.alt_msl_m, GROUND_M + HEIGHT_M, atol=0.16)
    np.testing.assert_allclose(height.value_m, HEIGHT_M, atol=0.31)
    np.testing.assert_array_equal(place.arrival_ns, (START_US + np.arange(40) * 100_000) * 1000)
    axes = Rotation.from_quat(camera.wxyz, scalar_first=True).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(axes, [axis_ned(values_at(step)) for step in range(40)], atol=2e-4)
    np.testing.assert_allclose(found[CameraTrack][0].hfov_rad, math.radians(60), atol=3e-5)
    assert camera.yaw_in_earth.all()


def test_the_middle_of_an_image_lies_at_the_frame_centre(tmp_path: Path) -> None:
    video = tmp_path / "flight.ts"
    w.transport_stream(video, flight())
    (tmp_path / "camera.toml").write_text('name = "c"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n')
    (tmp_path / "station.toml").write_text(
        '[station]\nname = "s"\n[camera]\nfile = "camera.toml"\n[telemetry.height]\norder = ["terrain"]\n'
        '[telemetry.attitude]\norder = ["klv"]\n[[probe]]\nname = "p"\nkind = "position"\npixels = [[31.5, 23.5]]\n'
    )
    drafted = run_aerodft("init", video, "-o", tmp_path / "mine")
    assert drafted.code == 0, drafted.err
    for each in ('order = ["klv"]', 'order = ["terrain"]', "flight.ts"):
        assert each in (tmp_path / "mine/station.toml").read_text()
    done = run_aerodft("import", video, "--config", tmp_path / "station.toml", "-o", tmp_path / "rec", "--json")
    assert done.code == 0, done.err
    found = [orjson.loads(each) for each in Recording(tmp_path / "rec").measurements()]
    good = [each for each in found if each["status"] == "ok"]
    assert len(good) >= 35
    for each in good:
        step = (int(each["stamp_ns"]) / 1000 - START_US) / 100_000
        assert abs(step - round(step)) < 0.05
        truth = values_at(round(step))
        north_m = math.radians(each["geo"][0]["lat_deg"] - truth[23]) * 6_371_000
        east_m = math.radians(each["geo"][0]["lon_deg"] - truth[24]) * 6_371_000 * math.cos(math.radians(LAT))
        assert math.hypot(north_m, east_m) < 0.8  # altitudes have steps of 0.3 m, earths differ by 0.3 %
        assert math.sqrt(each["cov_enu_m2"][0][0] + each["cov_enu_m2"][1][1]) > 1.0  # 3 m of height, 32 deg from nadir


@pytest.mark.parametrize(
    ("changes", "missing", "reason"),
    [
        ({"t19": -10.0}, {GimbalTrack, HeightTrack}, "contradict each other"),
        ({"t18": 100.0}, {GimbalTrack, HeightTrack}, "contradict each other"),
        ({"t19": math.nan}, {GimbalTrack}, ""),
        ({"t7": math.nan}, {GimbalTrack, VehicleTrack}, ""),
        ({"t25": 600.0}, {HeightTrack}, "not above its frame centre"),
        ({"t13": 0.0, "t14": 0.0}, {PositionTrack, GimbalTrack, HeightTrack}, "no position yet"),
        ({"t13": math.nan}, {PositionTrack}, ""),
    ],
)
def test_values_that_cannot_be_are_left_out(
    tmp_path: Path, changes: dict[str, float], missing: set[type[Track]], reason: str
) -> None:
    found, rejected, _ = tracks_of(written(tmp_path, b"".join(flight(**changes))))
    whole, _, _ = tracks_of(written(tmp_path, b"".join(flight())))
    assert whole.keys() - found.keys() == missing
    assert any(reason in each for each in rejected) if reason else not rejected


def test_full_angles_replace_those_of_small_range(tmp_path: Path) -> None:
    found, _, _ = tracks_of(written(tmp_path, b"".join(flight(t6=20.0, t90=35.0, t91=-2.0))))
    pitch_deg = Rotation.from_quat(found[VehicleTrack][0].wxyz, scalar_first=True).as_euler("ZYX", degrees=True)[:, 1]
    np.testing.assert_allclose(pitch_deg, 35.0, atol=1e-6)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (lambda good: good[:-1] + bytes([good[-1] ^ 1]), "wrong checksum"),
        (lambda good: good[:30] + bytes([good[30] ^ 4]) + good[31:], "wrong checksum"),
        (lambda good: good[:60], "cut off"),
        (lambda _: w.local_set(None, values_at(1)), "no time"),
        (lambda _: w.local_set(1000, values_at(1)), "impossible year"),
        (lambda _: w.local_set(START_US, {}, b"\x05\x03abc"), "tag 5 has a wrong length"),
        (lambda _: w.local_set(START_US, {}, b"\x05\x7fabc"), "longer than its set"),
    ],
)
def test_damaged_sets_are_left_out_and_said(tmp_path: Path, bad: Any, reason: str) -> None:
    sets = flight(10)
    sets[4] = bad(sets[4])
    found, _, said = tracks_of(written(tmp_path, b"".join(sets)))
    assert len(found[PositionTrack][0].lat_rad) == 9
    assert any(reason in each and "1 of 10" in each for each in said)


def test_a_video_that_was_cut_is_not_measured(tmp_path: Path) -> None:
    sets = flight(80)
    video = tmp_path / "cut.ts"
    w.transport_stream(video, sets[:20] + sets[60:])
    source = open_log(video)
    with pytest.raises(InputError, match="does not keep to its video's time line"):
        _ = source.start_ns  # type: ignore[attr-defined]


@pytest.mark.parametrize("first", [0, *at_night(*range(200, 2000, 200))])
def test_mutated_files_give_nothing_that_was_not_written(tmp_path: Path, first: int) -> None:
    whole = b"".join(flight(12))
    written_deg = {round(w_deg, 6) for step in range(12) for w_deg in [LAT + step * 2e-6]}
    for seed in range(first, first + 200):
        draw, data = random.Random(seed), bytearray(whole)  # noqa: S311
        for _ in range(draw.randrange(1, 12)):
            kind, at = draw.randrange(4), draw.randrange(len(data))
            if kind == 0:
                data[at] = draw.randrange(256)
            elif kind == 1:
                del data[at : at + draw.randrange(1, 40)]
            elif kind == 2:
                data[at:at] = bytes(draw.randrange(256) for _ in range(draw.randrange(1, 20)))
            else:
                data[at:at] = data[at : at + draw.randrange(1, 200)]
        try:
            found, _, said = tracks_of(written(tmp_path, bytes(data)))
        except InputError:
            continue
        places = np.concatenate([np.degrees(each.lat_rad) for each in found.get(PositionTrack, [])] or [[]])
        assert {round(float(each), 6) for each in places} <= written_deg
        assert len(places) == 12 or said


@pytest.mark.parametrize("name", ["clip.ts", "clip.mp4"])
@pytest.mark.parametrize("first", [0, *at_night(*range(40, 400, 40))])
def test_mutated_videos_are_read_or_refused(tmp_path: Path, name: str, first: int) -> None:
    """PyAV raises more than its own errors of streams that are not there."""
    path = tmp_path / name
    if name == "clip.ts":
        w.transport_stream(path, flight(20))
    else:
        at = datetime(2026, 5, 1, tzinfo=UTC)
        gpmf.video(path, [gpmf.gps5(at + timedelta(seconds=k), [(47.0, 8.0, 400.0)] * 18) for k in range(3)])
    whole = path.read_bytes()
    for seed in range(first, first + 40):
        draw, data = random.Random(seed), bytearray(whole)  # noqa: S311
        for _ in range(draw.randrange(1, 30)):
            at_byte = draw.randrange(len(data))
            if draw.random() < 0.7:
                data[at_byte] = draw.randrange(256)
            else:
                del data[at_byte : at_byte + draw.randrange(1, 400)]
        path.write_bytes(data[: draw.randrange(1, len(data))] if seed % 5 == 0 else data)
        try:
            tracks_of(path)
        except InputError:
            continue
