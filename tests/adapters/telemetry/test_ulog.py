"""PX4's logs: against pyulog, and by a small writer for what no sample holds."""

import math
import random
import struct
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest
from pyulog import ULog
from scipy.spatial.transform import Rotation

from aerodft.adapters.telemetry import CompositeDecoder, open_log
from aerodft.adapters.telemetry.ulog import UlogDecoder, UlogSource
from aerodft.errors import InputError
from aerodft.model import (
    ClockTrack,
    GimbalTrack,
    GpsTrack,
    HeightTrack,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
)
from replay.recordings import Recording
from tests.adapters.telemetry import ulog_writer as w
from tests.commands import run_aerodft
from tests.nights import at_night

UTC_US = 1_795_221_168_000_000
EARTH, VEHICLE, LOCK = 64, 32, 16
LEVEL = (1.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="session", params=["sample_logging_tagged_and_default_params.ulg", "sample_px4_events.ulg"])
def sample(request: pytest.FixtureRequest, data_folder: Path) -> Path:
    path = data_folder / "flights/ulog" / request.param
    if not path.exists():
        pytest.skip("no flights in the data folder")
    return path


def blocks_of(path: Path) -> list[RawBlock]:
    return [event for event in UlogSource(path).events() if isinstance(event, RawBlock)]


def columns_of(blocks: list[RawBlock], kind: type[Track], source: str = "") -> dict[str, Any]:
    """Fields of the tracks of one kind and source, joined."""
    decoder, columns = UlogDecoder(), defaultdict(list)
    for block in blocks:
        for track in decoder.decode(block):
            if isinstance(track, kind) and str(getattr(track, "source", "")) == source:
                for cls in type(track).__mro__:
                    for name in getattr(cls, "__slots__", ()):
                        columns[name].append(getattr(track, name))
    return {name: np.concatenate(v) if isinstance(v[0], np.ndarray) else v[0] for name, v in columns.items()}


def flight(**changes: Any) -> w.UlogWriter:
    """A hop to 10 m above home of 4 s, whose estimator's origin is 0.8 m above home."""
    log = w.UlogWriter()
    old = changes.get("old", False)
    attitude, home = log.subscribe("vehicle_attitude", w.ATTITUDE), log.subscribe("home_position", w.HOME)
    local = log.subscribe("vehicle_local_position", w.LOCAL)
    gps = log.subscribe("vehicle_gps_position", w.OLD_GPS if old else w.NEW_GPS)
    place = (634170622, 104082151, 66814) if old else (63.4170622, 10.4082151, 66.814)
    z_home = 0.8
    log.add(home, 500_000, 0.0, 0.0, math.nan, z_home, 1)
    for step in range(40):
        at_us = 1_000_000 + 100_000 * step
        log.add(attitude, at_us, *LEVEL)
        z = z_home - step / 4
        bottom = changes.get("bottom", (math.nan, 0, 0))
        log.add(local, at_us + 1000, z, 0.0, bottom[0], math.nan, 1, 0, bottom[1], bottom[2])
        if step % 2 == 0:
            fix = 3 if step >= 10 else 0
            log.add(gps, at_us + 2000, UTC_US + at_us + 2000, *place, 0.5, 0.8, 0, fix, 12)
    return log


def written(folder: Path, log: w.UlogWriter) -> Path:
    path = folder / "log.ulg"
    path.write_bytes(log.file())
    return path


def test_attitudes_and_clock_as_by_pyulog(sample: Path) -> None:
    theirs, blocks = ULog(str(sample)), blocks_of(sample)
    data = theirs.get_dataset("vehicle_attitude").data
    ours = columns_of(blocks, VehicleTrack)
    np.testing.assert_array_equal(ours["boot_ns"], data["timestamp"].astype(np.int64) * 1000)
    xyzw = np.stack([data[f"q[{k}]"] for k in (1, 2, 3, 0)], axis=-1)
    apart = Rotation.from_quat(ours["wxyz"], scalar_first=True).inv() * Rotation.from_quat(xyzw)
    assert apart.magnitude().max() < 1e-6
    gps = theirs.get_dataset("vehicle_gps_position").data
    fix = columns_of(blocks, GpsTrack)["fix"]
    np.testing.assert_array_equal(fix, gps["fix_type"])


def test_first_and_last_values_of_the_samples(data_folder: Path) -> None:
    folder = data_folder / "flights/ulog"
    if not folder.exists():
        pytest.skip("no flights in the data folder")
    tagged = blocks_of(folder / "sample_logging_tagged_and_default_params.ulg")
    wxyz = columns_of(tagged, VehicleTrack)["wxyz"]
    yaw, pitch, roll = Rotation.from_quat(wxyz[[0, -1]], scalar_first=True).as_euler("ZYX", degrees=True).T
    np.testing.assert_allclose([roll[0], pitch[0], yaw[0]], [-0.06, 0.16, 0.22], atol=0.006)
    np.testing.assert_allclose([roll[1], pitch[1], yaw[1]], [-0.16, 0.09, 0.09], atol=0.006)
    events = blocks_of(folder / "sample_px4_events.ulg")
    place = columns_of(events, PositionTrack)
    estimated = place["boot_ns"] >= 0
    assert np.degrees(place["lat_rad"][estimated][-1]) == pytest.approx(47.39774173, abs=1e-8)
    assert np.degrees(place["lon_rad"][estimated][-1]) == pytest.approx(8.54559432, abs=1e-8)
    assert place["alt_msl_m"][-1] == pytest.approx(487.848, abs=1e-3)
    clock = columns_of(events, ClockTrack)
    np.testing.assert_array_equal(clock["unix_ns"], clock["boot_ns"])  # a simulator's epoch stamps


def test_heights_are_of_the_local_estimate_against_home(data_folder: Path) -> None:
    path = data_folder / "flights/ulog/sample_px4_events.ulg"
    if not path.exists():
        pytest.skip("no flights in the data folder")
    theirs = ULog(str(path))
    local, home = (theirs.get_dataset(name).data for name in ("vehicle_local_position", "home_position"))
    ours = columns_of(blocks_of(path), HeightTrack, "home")
    z_m = dict(zip(local["timestamp"].tolist(), local["z"].tolist(), strict=True))
    above_m = [-z_m[at // 1000] for at in ours["boot_ns"].tolist()]
    home_m = np.array(ours["value_m"]) - above_m
    valid = home["z"][home["valid_lpos"] != 0]
    by_place = np.min(np.abs(home_m[:, None] - valid), axis=1) < 1e-6
    origins_m = np.unique(np.float64(local["ref_alt"][local["z_global"] != 0]))
    by_altitude = np.unique(origins_m[:, None] - home["alt"])
    is_by_altitude = np.min(np.abs(home_m[:, None] - by_altitude), axis=1) < 1e-5
    assert np.all(by_place | is_by_altitude)
    assert ours["boot_ns"][0] // 1000 < home["timestamp"][home["valid_lpos"] != 0][0]  # PX4 knows the altitude first
    assert ours["value_m"].max() == pytest.approx(2.159, abs=0.3)


def test_home_is_known_by_its_altitude_alone(data_folder: Path) -> None:
    """PX4 sends alt - home.alt as relative_alt as soon as ``valid_alt`` is set, whatever ``valid_lpos``."""
    path = data_folder / "flights/ulog/sample_logging_tagged_and_default_params.ulg"
    if not path.exists():
        pytest.skip("no flights in the data folder")
    theirs = ULog(str(path))
    home, local = (theirs.get_dataset(name).data for name in ("home_position", "vehicle_local_position"))
    ours = columns_of(blocks_of(path), HeightTrack, "home")
    after = local["timestamp"] > home["timestamp"][0]
    expected_m = (local["ref_alt"] - local["z"] - home["alt"][0])[after]
    assert (home["valid_alt"][0], home["valid_lpos"][0]) == (1, 0)
    assert len(expected_m) - 20 < len(ours["value_m"]) <= len(expected_m)  # the logger writes topics in bursts
    np.testing.assert_allclose(ours["value_m"][-5:], expected_m[-5:], atol=1e-4)


@pytest.mark.parametrize("old", [False, True])
def test_units_of_both_generations(tmp_path: Path, *, old: bool) -> None:
    blocks = blocks_of(written(tmp_path, flight(old=old)))
    place = columns_of(blocks, PositionTrack)
    assert len(place["lat_rad"]) == 15  # with a fix
    np.testing.assert_allclose(np.degrees(place["lat_rad"]), 63.4170622, atol=1e-9)
    np.testing.assert_allclose(np.degrees(place["lon_rad"]), 10.4082151, atol=1e-9)
    np.testing.assert_allclose(place["alt_msl_m"], 66.814, atol=1e-6)
    assert np.isnan(place["height_home_m"]).all()
    clock = columns_of(blocks, ClockTrack)
    np.testing.assert_array_equal(clock["unix_ns"] - clock["boot_ns"], UTC_US * 1000)
    assert len(clock["unix_ns"]) == 15
    assert blocks[0].arrival_ns[-1] == UTC_US * 1000 + 4_901_000_000
    height = columns_of(blocks, HeightTrack, "home")
    np.testing.assert_allclose(height["value_m"], np.arange(40) / 4, atol=1e-6)
    assert np.isnan(height["std_m"]).all()


def test_the_receivers_places_end_where_the_estimators_begin(tmp_path: Path) -> None:
    log = flight()
    estimate = log.subscribe("vehicle_global_position", w.GLOBAL)
    log.add(estimate, 6_000_000, 63.5, 10.5, 70.0)
    gps = log.subscribe("vehicle_gps_position", w.NEW_GPS)
    log.add(gps, 6_100_000, UTC_US + 6_100_000, 63.6, 10.6, 70.0, 0.5, 0.8, 0, 3, 12)
    lat = np.degrees(columns_of(blocks_of(written(tmp_path, log)), PositionTrack)["lat_rad"])
    assert lat.max() == pytest.approx(63.5)


@pytest.mark.parametrize(
    ("bottom", "is_used"),
    [
        ((12.5, 1, 1), True),
        ((12.5, 1, 3), True),  # rangefinder and flow
        ((0.1, 1, 0), False),  # on the ground without a sensor
        ((12.5, 1, 2), False),  # optical flow alone
        ((12.5, 0, 1), False),
        ((math.nan, 1, 1), False),
        ((-1.0, 1, 1), False),
    ],
)
def test_heights_above_the_bottom_need_a_rangefinder(tmp_path: Path, bottom: Any, *, is_used: bool) -> None:
    found = columns_of(blocks_of(written(tmp_path, flight(bottom=bottom))), HeightTrack, "rangefinder")
    assert bool(found) == is_used
    if found:
        np.testing.assert_allclose(found["value_m"], 12.5)
        assert found["slant"] is False


@pytest.mark.parametrize("has_sensor", [False, True])
def test_without_the_sensors_bits_readings_must_be_there(tmp_path: Path, *, has_sensor: bool) -> None:
    log = w.UlogWriter()
    local, sensor = log.subscribe("vehicle_local_position", w.OLD_LOCAL), log.subscribe("distance_sensor", w.SENSOR)
    if has_sensor:
        log.add(sensor, 1_000_000, 0.2, 50.0, 12.0, 0.01, -1, 25)
    for step in range(5):
        log.add(local, 1_100_000 + step * 100_000, -12.0, 12.1, 1)
        if has_sensor:
            log.add(sensor, 1_150_000 + step * 100_000, 0.2, 50.0, 12.0, 0.01, -1, 25)
    found = columns_of(blocks_of(written(tmp_path, log)), HeightTrack, "rangefinder")
    assert ("value_m" in found) == has_sensor
    if has_sensor:  # the sensor's own reading until the estimator's heights come
        np.testing.assert_allclose(found["value_m"], [12.0] + [12.1] * 5)


def test_readings_of_a_rangefinder(tmp_path: Path) -> None:
    log = w.UlogWriter()
    ahead = log.subscribe("distance_sensor", w.SENSOR, 0)
    down = log.subscribe("distance_sensor", w.SENSOR, 1)
    other = log.subscribe("distance_sensor", w.SENSOR, 2)
    readings = [(0.1, -1), (12.0, -1), (13.0, 0), (50.0, 80), (14.0, 80), (math.nan, 80)]
    for step, (distance_m, quality) in enumerate(readings):
        log.add(ahead, 1_000_000 + step * 100_000, 0.2, 50.0, 3.0, 0.01, -1, 0)
        log.add(down, 1_001_000 + step * 100_000, 0.2, 50.0, distance_m, 0.04, quality, 25)
        log.add(other, 1_002_000 + step * 100_000, 0.2, 50.0, 9.0 if step > 1 else 0.0, 0.04, 100, 25)
    found = columns_of(blocks_of(written(tmp_path, log)), HeightTrack, "rangefinder")
    np.testing.assert_allclose(found["value_m"], [12.0, 14.0])
    np.testing.assert_allclose(found["std_m"], 0.2, rtol=1e-6)
    assert found["slant"] is True


def test_home_moves_and_a_reset_of_the_height_widens(tmp_path: Path) -> None:
    log = w.UlogWriter()
    home, local = log.subscribe("home_position", w.HOME), log.subscribe("vehicle_local_position", w.LOCAL)

    def row(at_us: int, z: float, counter: int, delta_z: float = 0.0) -> None:
        log.add(local, at_us, z, delta_z, math.nan, 0.0, 1, counter, 0, 0)

    row(1_000_000, -1.0, 0)
    log.add(home, 1_050_000, 0.0, 0.0, 0.0, -5.0, 0)  # not valid
    row(1_100_000, -1.0, 0)
    log.add(home, 1_150_000, 0.0, 0.0, 0.0, -0.795, 1)
    row(1_200_000, -10.759, 0)
    log.add(home, 1_250_000, 0.0, 0.0, 0.0, -0.835, 1)
    row(1_300_000, -10.759, 0)
    row(1_400_000, -14.759, 1, -4.0)
    log.add(home, 1_450_000, 0.0, 0.0, 0.0, -4.8, 1)
    row(1_500_000, -14.759, 1, -4.0)
    found = columns_of(blocks_of(written(tmp_path, log)), HeightTrack, "home")
    np.testing.assert_allclose(found["value_m"], [9.964, 9.924, 13.924, 9.959], atol=1e-5)
    np.testing.assert_allclose(found["std_m"], [math.nan, math.nan, math.hypot(1.0, 4.0), math.nan], rtol=1e-6)


@pytest.mark.parametrize(
    ("flags", "in_earth"),
    [
        (EARTH, True),
        (VEHICLE, False),
        (EARTH | LOCK, True),
        (VEHICLE | LOCK, False),
        (LOCK, True),
        (0, False),
        (8 | 4, False),
    ],
)
def test_a_gimbals_frame_by_its_flags(tmp_path: Path, flags: int, *, in_earth: bool) -> None:
    log = flight()
    gimbal = log.subscribe("gimbal_device_attitude_status", w.GIMBAL)
    xyzw = Rotation.from_euler("ZYX", [30.0, -60.0, 0.0], degrees=True).as_quat()
    for step in range(3):
        log.add(gimbal, 5_000_000 + step * 50_000, *np.roll(xyzw, 1), 0.0, 0, flags, 1)
        log.add(gimbal, 5_001_000 + step * 50_000, *LEVEL, 0.0, 0, flags, 2)  # of another one
    log.add(gimbal, 6_000_000, *LEVEL, 0.0, 32, flags, 1)  # a failing motor
    found = columns_of(blocks_of(written(tmp_path, log)), GimbalTrack, "GIMBAL_DEVICE_ATTITUDE_STATUS")
    assert found["yaw_in_earth"].tolist() == [in_earth] * 3
    angles = Rotation.from_quat(found["wxyz"], scalar_first=True).as_euler("ZYX", degrees=True)
    np.testing.assert_allclose(angles, [[30.0, -60.0, 0.0]] * 3, atol=1e-5)


def test_a_reports_age_is_taken_off_its_utc(tmp_path: Path) -> None:
    log = w.UlogWriter()
    gps = log.subscribe("vehicle_gps_position", w.NEW_GPS)
    log.add(gps, 2_000_000, UTC_US + 1_880_000, 63.6, 10.6, 70.0, 0.5, 0.8, -120_000, 3, 12)
    clock = columns_of(blocks_of(written(tmp_path, log)), ClockTrack)
    assert clock["unix_ns"][0] - clock["boot_ns"][0] == UTC_US * 1000


def test_without_gps_the_files_time_is_said_to_be_taken(tmp_path: Path) -> None:
    log = w.UlogWriter()
    attitude = log.subscribe("vehicle_attitude", w.ATTITUDE)
    log.add(attitude, 1_000_000, *LEVEL)
    log.other("O", struct.pack("<H", 30))
    log.add(attitude, 1_100_000, *LEVEL)
    log.other("O", struct.pack("<H", 250))
    log.add(attitude, 1_500_000, *LEVEL)
    source = UlogSource(written(tmp_path, log))
    assert sum(len(block.arrival_ns) for block in source.events() if isinstance(block, RawBlock)) == 8
    said = " ".join(source.warnings())
    assert "no GPS time" in said
    assert "dropped messages 2 times, for 0.28 s in all, 0.25 s at the longest" in said


def test_data_appended_after_a_crash_are_read(tmp_path: Path) -> None:
    log = w.UlogWriter(flags=bytes(40))
    attitude = log.subscribe("vehicle_attitude", w.ATTITUDE)
    for step in range(5):
        log.add(attitude, 1_000_000 + step * 1000, *LEVEL)
    whole = log.file()[:-9]  # the last message is cut off by the crash
    flags = bytes(8) + b"\x01" + bytes(7) + struct.pack("<3Q", len(whole), 0, 0)
    log.parts = [log.parts[0], w.message("B", flags)]
    rest = appended_attitudes(attitude)
    path = tmp_path / "log.ulg"
    path.write_bytes(log.file() + whole[16 + 43 :] + rest)
    source = UlogSource(path)
    found = columns_of([block for block in source.events() if isinstance(block, RawBlock)], VehicleTrack)
    assert found["boot_ns"].tolist() == [1_000_000_000 + step * 1_000_000 for step in (0, 1, 2, 3, 9, 10)]
    assert "damaged bytes left out" in " ".join(source.warnings())


def appended_attitudes(number: int) -> bytes:
    return b"".join(w.message("D", struct.pack("<HQ4f", number, 1_000_000 + step * 1000, *LEVEL)) for step in (9, 10))


def test_a_later_version_of_the_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.ulg"
    path.write_bytes(w.UlogWriter(flags=bytes(8) + b"\x02" + bytes(31)).file())
    with pytest.raises(InputError, match="later version"):
        open_log(path)


@pytest.mark.parametrize("data", [b"", b"ULog\x01\x12\x35", w.UlogWriter().file(), flight().file()[:300]])
def test_what_holds_no_data_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "log.ulg"
    path.write_bytes(data)
    with pytest.raises(InputError):
        open_log(path)


def test_formats_that_cannot_be_read_cost_their_own_data_alone(tmp_path: Path) -> None:
    log = w.UlogWriter()
    log.other("F", b"strange:uint64_t timestamp;strange[3] inner;")
    log.other("F", b"nonsense")
    log.other("F", b"\xff\xfe:\xff")
    log.other("A", struct.pack("<BH", 0, 77) + b"strange")
    attitude = log.subscribe("vehicle_attitude", w.ATTITUDE)
    log.subscribe("vehicle_local_position", "uint64_t timestamp;float height;")
    log.add(attitude, 1_000_000, *LEVEL)
    log.add(1, 1_000_500, 5.0)
    log.add(attitude, 1_001_000, *LEVEL)
    blocks, decoder = blocks_of(written(tmp_path, log)), CompositeDecoder()
    tracks = [track for block in blocks for track in decoder.decode(block)]
    assert [len(track.boot_ns) for track in tracks] == [2]
    assert decoder.rejected == {"vehicle_local_position: unknown layout": 1}


@pytest.mark.parametrize("seed", [0, *at_night(*range(1, 20))])
def test_tracks_do_not_depend_on_how_messages_are_cut_into_blocks(tmp_path: Path, seed: int) -> None:
    draw, log = random.Random(seed), flight(bottom=(9.0, 1, 1))  # noqa: S311
    sensor, gimbal = (
        log.subscribe("distance_sensor", w.SENSOR),
        log.subscribe("gimbal_device_attitude_status", w.GIMBAL),
    )
    estimate = log.subscribe("vehicle_global_position", w.GLOBAL)
    parts = [
        *(
            w.message("D", struct.pack("<HQ4fbB", sensor, 1_000_000 + k * 90_000, 0.2, 50, 8.0, 0.01, 80, 25))
            for k in range(40)
        ),
        *(
            w.message("D", struct.pack("<HQ5fIHB", gimbal, 1_000_000 + k * 90_000, *LEVEL, 0, 0, 64, 1))
            for k in range(40)
        ),
        *(w.message("D", struct.pack("<HQ2df", estimate, 1_500_000 + k * 90_000, 63.4, 10.4, 60.0)) for k in range(30)),
    ]
    definitions = [part for part in log.parts if part[2:3] in b"FA" or part.startswith(w.MAGIC)]
    data = sorted([*parts, *(p for p in log.parts if p not in definitions)], key=lambda p: p[5:13][::-1])
    log.parts = [*definitions, *data]
    (block,) = blocks_of(written(tmp_path, log))

    def joined(blocks: list[RawBlock]) -> dict[str, list[Any]]:
        decoder, rows = UlogDecoder(), defaultdict(list)
        for each in blocks:
            for track in decoder.decode(each):
                name = f"{type(track).__name__} {getattr(track, 'source', '')}"
                values = [
                    v
                    for f in type(track).__mro__
                    for n in getattr(f, "__slots__", ())
                    if isinstance(v := getattr(track, n), np.ndarray)
                ]
                rows[name] += [repr([v[k].tolist() for v in values]) for k in range(len(track.boot_ns))]
        return {**rows, "rejected": sorted(decoder.rejected.items())}

    cuts = sorted({0, len(block.offset), *(draw.randrange(len(block.offset)) for _ in range(40))})
    parts_of = [block.rows(slice(a, b)) for a, b in pairwise(cuts)]
    assert joined(parts_of) == joined([block])


@pytest.mark.parametrize("first", [0, *at_night(*range(20, 200, 20))])
def test_damage_is_said_and_never_read_as_data(tmp_path: Path, first: int) -> None:
    """Bytes lost, inserted or doubled: each attitude that is read was written, and what is lost is said."""
    whole = flight().file()
    good = {tuple(row) for row in zip(*_attitudes(written(tmp_path, flight()))[:2], strict=True)}
    for seed in range(first, first + 20):
        draw, data = random.Random(seed), whole  # noqa: S311
        for _ in range(draw.randrange(1, 4)):
            at = draw.randrange(16, len(data))
            size = draw.choice([1, 2, 7, 30, 300])
            garbage = draw.randbytes(size)
            data = draw.choice([data[:at] + data[at + size :], data[:at] + garbage + data[at:], data[:at]])
        path = tmp_path / f"{seed}.ulg"
        path.write_bytes(data)
        try:
            boot_ns, wxyz, said = _attitudes(path)
        except InputError:
            continue
        rows = list(zip(boot_ns, wxyz, strict=True))
        assert {tuple(row) for row in rows} <= good
        assert said or len(rows) == len(good), f"{len(rows)} of {len(good)} without a word"


@pytest.mark.parametrize("first", [0, *at_night(*range(60, 600, 60))])
def test_flipped_bytes_raise_nothing(tmp_path: Path, first: int) -> None:
    whole = flight(bottom=(9.0, 1, 1)).file()
    for seed in range(first, first + 60):
        draw, data = random.Random(seed), bytearray(whole)  # noqa: S311
        for _ in range(draw.randrange(1, 20)):
            data[draw.randrange(len(data))] = draw.randrange(256)
        path = tmp_path / "flipped.ulg"
        path.write_bytes(data)
        try:
            source = UlogSource(path)
        except InputError:
            continue
        decoder = CompositeDecoder()
        for block in source.events():
            assert isinstance(block, RawBlock)
            assert np.all(np.diff(block.arrival_ns) >= 0)
            decoder.decode(block)


def _attitudes(path: Path) -> tuple[list[int], list[tuple[float, ...]], bool]:
    source, decoder = UlogSource(path), UlogDecoder()
    boot_ns: list[int] = []
    wxyz: list[tuple[float, ...]] = []
    for block in source.events():
        for track in decoder.decode(block) if isinstance(block, RawBlock) else ():
            if isinstance(track, VehicleTrack):
                boot_ns += track.boot_ns.tolist()
                wxyz += map(tuple, track.wxyz.tolist())
    return boot_ns, wxyz, bool(source.warnings() or decoder.rejected)


STATION = """
[station]
name = "px4"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[telemetry.attitude]
order = ["GIMBAL_DEVICE_ATTITUDE_STATUS"]
[images]
rate_hz = 5
[[probe]]
name = "centre"
kind = "range"
pixels = [[31.5, 23.5]]
"""


@pytest.mark.parametrize("has_altitude", [False, True])
def test_the_planes_altitude_is_that_of_home(tmp_path: Path, *, has_altitude: bool) -> None:
    (tmp_path / "camera.toml").write_text('name = "small"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n')
    (tmp_path / "station.toml").write_text(STATION.replace('["home"]', '["home"]\nhome_above_plane_m = 2.0'))
    path = written(tmp_path, hover(home_alt_m=460.25 if has_altitude else math.nan))
    folder = tmp_path / "recording"
    done = run_aerodft("import", path, "--config", tmp_path / "station.toml", "-o", folder)
    assert done.code == 0, done.err
    values = [orjson.loads(each) for each in Recording(folder).measurements()]
    altitudes = [each["geo"][0]["alt_msl_m"] for each in values if each["status"] == "ok"]
    known = [each for each in altitudes if each is not None]
    assert altitudes[0] is None  # until home's altitude is logged
    assert altitudes == [None] * (len(altitudes) - len(known)) + known
    assert bool(known) == has_altitude
    np.testing.assert_allclose(known, 458.25)


def hover(home_alt_m: float = math.nan) -> w.UlogWriter:
    """Six seconds 40 m above a home whose altitude comes after three, a gimbal 30 degrees from straight down."""
    log = w.UlogWriter()
    attitude, home = log.subscribe("vehicle_attitude", w.ATTITUDE), log.subscribe("home_position", w.HOME)
    local, gps = log.subscribe("vehicle_local_position", w.LOCAL), log.subscribe("vehicle_gps_position", w.NEW_GPS)
    gimbal = log.subscribe("gimbal_device_attitude_status", w.GIMBAL)
    looks_down = Rotation.from_euler("ZYX", [0.0, -60.0, 0.0], degrees=True).as_quat(scalar_first=True)
    log.add(home, 500_000, 0.0, 0.0, math.nan, 0.5, 1)
    for step in range(60):
        at_us = 1_000_000 + 100_000 * step
        if step == 30:
            log.add(home, at_us, 47.0, 8.0, home_alt_m, 0.5, 1)
        log.add(attitude, at_us, *LEVEL)
        log.add(local, at_us, -39.5, 0.0, math.nan, math.nan, 1, 0, 0, 0)
        log.add(gimbal, at_us, *looks_down, 0.0, 0, EARTH, 1)
        log.add(gps, at_us, UTC_US + at_us, 47.0, 8.0, 500.0, 0.5, 0.8, 0, 3, 12)
    return log


def test_a_flight_is_imported_and_recomputed(tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_text('name = "small"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n')
    (tmp_path / "station.toml").write_text(STATION)
    path = written(tmp_path, hover())
    done = run_aerodft("import", path, "-c", tmp_path / "station.toml", "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    ranges_m = _ranges_m(tmp_path / "out")
    assert len(ranges_m) > 20
    np.testing.assert_allclose(ranges_m, 40.0 / math.cos(math.radians(30.0)), rtol=1e-6)
    done = run_aerodft("recompute", tmp_path / "out", "-o", tmp_path / "again", "--json")
    assert done.code == 0, done.err
    assert _ranges_m(tmp_path / "again") == ranges_m
    done = run_aerodft("doctor", path, "--json")
    assert {each["message"] for each in done.json["streams"]} >= {"vehicle_attitude", "home_position"}
    assert done.json["heights"] == [{"source": "home", "count": 60, "unit": "m", "low": 40.0, "high": 40.0}]


def _ranges_m(folder: Path) -> list[float]:
    values = [orjson.loads(each) for each in Recording(folder).measurements()]
    return [each["value"] for each in values if each["status"] == "ok"]
