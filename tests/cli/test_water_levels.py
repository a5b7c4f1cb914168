"""Flights over water whose level changes, through the commands: closed forms, and recordings without their gauge."""

import json
import math

import orjson
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from replay.recordings import Recording
from tests.cli.test_replay_queries import ask, stepped

UTC0_NS = 1_795_221_168_000_000_000
HOME_M, MSL_M = 40.0, 600.0
ENDS = ((8.0, 23.5), (50.0, 23.5))
GAP_S = 900

FLIGHT = f"""
[station]
name = "test"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[telemetry.health]
gps_s = 1e5
[images]
rate_hz = 5
[[probe]]
name = "width"
kind = "width"
pixels = {[list(end) for end in ENDS]}
[[probe]]
name = "spot"
kind = "position"
pixels = [[31.5, 23.5]]
"""
LEVEL = '[ground]\nlevel = "gauge.csv"\nlevel_std_m = 0.03\n'


def write_hover(path, seconds=3.0, below_m=None):
    """A hover that looks straight down from 40 m above home, with a rangefinder where one is to be there."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    half = math.radians(-90.0) / 2
    log = bytearray()
    for boot_ms in range(0, round(seconds * 1000) + 1, 100):
        home_mm, alt_mm = round(1e3 * HOME_M), round(1e3 * (MSL_M + HOME_M))
        messages = [
            dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3),
            dialect.MAVLink_system_time_message(UTC0_NS // 1000 + boot_ms * 1000, boot_ms),
            dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0, 0, 0),
            dialect.MAVLink_global_position_int_message(boot_ms, -353600000, 1491600000, alt_mm, home_mm, 0, 0, 0, 0),
            dialect.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, 44, [math.cos(half), 0.0, math.sin(half), 0.0], math.nan, math.nan, math.nan, 0
            ),
        ]
        if below_m is not None:
            messages.append(
                dialect.MAVLink_distance_sensor_message(boot_ms, 20, 12_000, round(100 * below_m), 0, 0, 25, 0)
            )
        for message in messages:
            log.extend((UTC0_NS // 1000 + boot_ms * 1000 + 20_000).to_bytes(8, "big") + message.pack(mav))
    path.write_bytes(log)


def write_gauge(folder, level_m, rise_m=0.0):
    """Readings every quarter of an hour around the flight, in Unix seconds."""
    rows = [f"{UTC0_NS // 10**9 + k * GAP_S},{level_m + k * rise_m:.3f}" for k in range(-4, 5)]
    (folder / "gauge.csv").write_text("unix_s,level_m\n" + "\n".join(rows) + "\n")


@pytest.fixture
def water(desk):
    write_hover(desk.folder / "hover.tlog")
    return desk


def imported(aerodft, desk, text, name, *, code=0):
    out = desk.folder / name
    config = desk.station(text, f"{name}.toml")
    run = aerodft("import", desk.folder / "hover.tlog", "-c", config, "-o", out, "--json")
    assert run.code == code, run.err
    return out


def measured(folder, name):
    return [m for m in map(orjson.loads, Recording(folder).measurements()) if m["name"] == name]


def usable(folder, name="width"):
    found = [m for m in measured(folder, name) if m["status"] == "ok"]
    assert len(found) > 5
    return found


def width_m(height_m):
    focal_px = 32 / math.tan(math.radians(30.0))
    return height_m * (ENDS[1][0] - ENDS[0][0]) / focal_px


def test_a_repeated_flight_measures_the_water_of_its_day(aerodft, water):
    for level_m in (-1.5, 0.0, 2.25):
        write_gauge(water.folder, level_m)
        out = imported(aerodft, water, FLIGHT + LEVEL, f"day{level_m}")
        for width, spot in zip(usable(out), usable(out, "spot"), strict=True):
            assert width["value"] == pytest.approx(width_m(HOME_M - level_m), rel=1e-6)
            assert width["pose"]["height_agl_m"] == pytest.approx(HOME_M - level_m, abs=1e-6)
            said = width["pose"]["level"]
            assert said["level_m"] == said["elevation_m"] == pytest.approx(level_m)
            assert (said["datum"], said["source"], said["in_height"]) == ("station", "gauge.csv", False)
            assert 0.03 <= said["std_m"] < 0.035
            assert spot["enu_m"][0][2] == pytest.approx(level_m)  # the station's frame does not float
            assert spot["ground_m"][0][2] == pytest.approx(0.0, abs=1e-9)
            assert spot["geo"][0]["alt_msl_m"] == pytest.approx(MSL_M + level_m, abs=1e-3)


def test_questions_over_the_bus_are_measured_on_the_water_of_their_stamps(aerodft, water):
    write_gauge(water.folder, 2.25, rise_m=3.0)  # 1 cm in the flight's 3 s
    out = imported(aerodft, water, FLIGHT + LEVEL, "day")
    with stepped(out, 8) as (session, _):
        published = ask(session, "aerodft/test/history", {"name": "width"})
        assert len(published) > 3
        for newest in (published[-1], published[0]):
            question = {"name": "width", "kind": "width", "pixels": ENDS, "stamp_ns": newest["stamp_ns"]}
            (width,) = ask(session, "aerodft/test/measure", question)
            level_m = 2.25 + 3.0 * (int(newest["stamp_ns"]) - UTC0_NS) / (GAP_S * 10**9)
            assert width["status"] == "ok"
            assert width["value"] == pytest.approx(width_m(HOME_M - level_m), abs=2e-5)
            assert width["value"] == pytest.approx(newest["value"], abs=1e-6)
            assert width["std"] == pytest.approx(newest["std"], rel=1e-6)
            assert width["pose"]["level"] == newest["pose"]["level"]
            (spot,) = ask(session, "aerodft/test/measure", {**question, "kind": "position", "pixels": [[31.5, 23.5]]})
            assert spot["enu_m"][0][2] == pytest.approx(level_m, abs=1e-4)
            assert spot["geo"][0]["alt_msl_m"] == pytest.approx(MSL_M + level_m, abs=1e-3)
        late = {"name": "w", "kind": "width", "pixels": ENDS, "stamp_ns": str(UTC0_NS + 6 * 3600 * 10**9)}
        (answer,) = ask(session, "aerodft/test/measure", late)
        assert (answer["value"], answer["status"] != "ok") == (None, True)


def test_the_level_widens_a_width_as_a_height_of_its_std_does(aerodft, water):
    write_gauge(water.folder, 1.0)
    exact = usable(imported(aerodft, water, FLIGHT + LEVEL.replace("0.03", "0.0"), "exact"))[0]
    vague = usable(imported(aerodft, water, FLIGHT + LEVEL.replace("0.03", "0.5"), "vague"))[0]
    own_m = width_m(1.0) * math.sqrt(vague["pose"]["level"]["std_m"] ** 2 - exact["pose"]["level"]["std_m"] ** 2)
    assert vague["std"] == pytest.approx(math.hypot(exact["std"], own_m), rel=2e-3)
    assert vague["pose"]["std"]["height_agl_m"] == pytest.approx(math.hypot(1.0, 0.5), rel=1e-3)


def test_a_rangefinder_sees_the_water_itself_whatever_the_gauge_says(aerodft, water):
    write_hover(water.folder / "hover.tlog", below_m=HOME_M - 2.0)
    write_gauge(water.folder, 2.0)
    text = FLIGHT.replace('["home"]', '["rangefinder", "home"]')
    exact = imported(aerodft, water, text + LEVEL.replace("0.03", "0.0"), "exact")
    vague = imported(aerodft, water, text + LEVEL.replace("0.03", "2.0"), "vague")
    for one, other in zip(usable(exact), usable(vague), strict=True):
        assert one["value"] == pytest.approx(width_m(HOME_M - 2.0), rel=1e-6)
        assert other["pose"]["level"]["in_height"]
        assert one["std"] == pytest.approx(other["std"], rel=1e-9)
        assert not [why for why in one["reasons"] if "apart" in why]  # home and rangefinder agree
    cov = [usable(folder, "spot")[0]["cov_enu_m2"][2][2] for folder in (exact, vague)]
    assert cov[1] - cov[0] == pytest.approx(4.0, rel=1e-3)


def test_a_flight_outside_the_readings_is_refused(aerodft, water):
    write_gauge(water.folder, 1.0)
    rows = (water.folder / "gauge.csv").read_text().splitlines()
    (water.folder / "gauge.csv").write_text("\n".join(rows[:4]) + "\n")  # it ends half an hour before
    out = imported(aerodft, water, FLIGHT + LEVEL, "late", code=4)
    found = [m for m in map(orjson.loads, Recording(out).measurements()) if m["status"] != "NO_TELEMETRY"]
    assert {m["status"] for m in found} == {"NO_LEVEL"}
    assert {m["value"] for m in found} == {None}
    assert "gauge.csv" in found[0]["reasons"][0]


def test_a_recording_is_computed_anew_to_the_byte_without_its_gauge(aerodft, water):
    write_gauge(water.folder, 1.0, rise_m=0.2)
    out = imported(aerodft, water, FLIGHT + LEVEL, "flight")
    (water.folder / "gauge.csv").unlink()
    again = water.folder / "again"
    run = aerodft("recompute", out, "-o", again)
    assert run.code == 0, run.err
    assert list(Recording(again).measurements()) == list(Recording(out).measurements())


def test_heights_of_landmarks_do_not_count_from_water_that_rises(aerodft, water):
    write_gauge(water.folder, 1.0, rise_m=0.1)
    folder = imported(aerodft, water, FLIGHT + LEVEL, "rising")
    landmarks = water.folder / "landmarks.csv"
    landmarks.write_text("name,u,v,x,y,z\nleft,8,23.5,0,0,0.5\nright,50,23.5,9,0,0.7\n")
    options = ("--recording", folder, "--at", "1", "--landmarks", landmarks, "--probe", "distance @left @right")
    refused = aerodft("measure", *options)
    assert refused.code == 2
    assert "no surveyed point has a height above the measured plane, expected level ground at a" in refused.err


def test_another_gauge_takes_the_place_of_the_recorded_readings(aerodft, water):
    write_gauge(water.folder, 1.0)
    out = imported(aerodft, water, FLIGHT + LEVEL, "flight")
    write_gauge(water.folder, 3.0)
    other = (water.folder / "gauge.csv").rename(water.folder / "other.csv")
    for key, value in (("level", str(other)), ("level_zero_m", -2.0), ("level_m", 3.0)):
        again = water.folder / key
        run = aerodft("recompute", out, "-o", again, "--set", f"ground.{key}={json.dumps(value)}")
        assert run.code == 0, run.err
        assert usable(again)[0]["value"] == pytest.approx(width_m(HOME_M - 3.0), rel=1e-6)


@pytest.mark.parametrize("key", ["ground.level", "camera.file"])
def test_a_file_that_is_a_number_is_refused_in_a_sentence(aerodft, water, key):
    write_gauge(water.folder, 1.0)
    out = imported(aerodft, water, FLIGHT + LEVEL, "flight")
    run = aerodft("recompute", out, "-o", water.folder / "again", "--set", f"{key}=3.5")
    assert run.code == 3
    assert f"{key}: got 3.5, expected" in run.err


def test_one_level_is_the_case_of_readings_that_are_all_the_same(aerodft, water):
    write_gauge(water.folder, 1.0)
    series = usable(imported(aerodft, water, FLIGHT + LEVEL, "series"))
    single = usable(imported(aerodft, water, FLIGHT + "[ground]\nlevel_m = 1.0\nlevel_std_m = 0.03\n", "single"))
    for one, other in zip(series, single, strict=True):
        assert one["value"] == other["value"]
        assert other["pose"]["level"]["std_m"] == 0.03
        assert 0.03 <= one["pose"]["level"]["std_m"] < 0.031


def test_low_over_a_flood_is_below_the_minimum_height(aerodft, water):
    write_gauge(water.folder, HOME_M - 0.5)
    out = imported(aerodft, water, FLIGHT + LEVEL, "flood", code=4)
    found = [m for m in map(orjson.loads, Recording(out).measurements()) if m["status"] != "NO_TELEMETRY"]
    assert {m["status"] for m in found} == {"BELOW_MIN_HEIGHT"}
    assert "home says 0.50 m" in found[0]["reasons"][0]


def test_doctor_says_that_no_reading_is_of_the_flights_time(aerodft, water):
    config = water.station(FLIGHT + LEVEL, "doctor.toml")
    for shift_s, is_known in ((0, True), (86_400, False)):
        rows = [f"{UTC0_NS // 10**9 + shift_s + k * GAP_S},1.0" for k in range(-4, 5)]
        (water.folder / "gauge.csv").write_text("unix_s,level_m\n" + "\n".join(rows) + "\n")
        run = aerodft("doctor", water.folder / "hover.tlog", "-c", config)
        assert (b"NO_LEVEL" in run.out) is not is_known, run.out
