"""What ``doctor`` says of a vehicle's health, its camera and a configuration, on recorded flights."""

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from aerodft.cli.flights.doctor import doctor
from aerodft.cli.flights.import_ import import_
from aerodft.errors import NoAnswerError
from tests.nights import at_night

DATA = Path(__file__).parents[2].parent / "shared" / "data"
app = typer.Typer(pretty_exceptions_enable=False)
app.command()(doctor)
flight = typer.Typer(pretty_exceptions_enable=False)
flight.command()(import_)
CAMERA = 'name = "c"\nwidth_px = 1920\nheight_px = 1080\nhfov_deg = {hfov}\n'
STATION = """
[station]
name = "s"
[camera]
name = "c"
width_px = 1920
height_px = 1080
hfov_deg = 62.0
[telemetry]
{telemetry}
[[probe]]
name = "p"
kind = "range"
pixels = [[960, 540]]
"""


@pytest.fixture
def logs() -> Path:
    if not DATA.is_dir():
        pytest.skip(f"no recorded flights: {DATA} is absent")
    return DATA


def _document(*arguments: object) -> dict:
    return json.loads(CliRunner().invoke(app, [*map(str, arguments), "--json"]).stdout)


@pytest.mark.parametrize(("hfov", "is_said"), [(62.3, False), (70.0, True), *at_night((62.0, False))])
def test_a_camera_file_is_held_against_what_the_vehicle_says(logs, tmp_path, hfov, is_said) -> None:
    camera = tmp_path / "camera.toml"
    camera.write_text(CAMERA.format(hfov=hfov))
    found = _document(logs / "sitl/brushless_ctl.tlog", "--camera", camera)
    (view,) = found["health"]["cameras"]
    assert (view["camera"], view["message"], view["hfov_deg"]) == (1, "CAMERA_FOV_STATUS", [62.0, 62.0])
    said = [each for each in found["problems"] if "hfov 62.0 deg, the camera file 70.0 deg" in each]
    assert bool(said) is is_said


def test_requests_name_message_rate_and_parameter(logs) -> None:
    found = _document(logs / "logs/vtol.tlog")
    asked = {each["message"]: each for each in found["requests"]}
    assert asked["ATTITUDE"]["interval_us"] == 100_000
    assert asked["ATTITUDE"]["now_hz"] == pytest.approx(4.27, abs=0.05)
    assert asked["ATTITUDE"]["parameters"]["ardupilot"].startswith(
        "SR0_EXTRA1 = 10 (SR0 is this link's port by its rates, usually USB)"
    )
    assert not {"GIMBAL_DEVICE_ATTITUDE_STATUS", "DISTANCE_SENSOR"} & asked.keys()  # MNT_TYPE, RNGFND_TYPE = 0
    assert any("rangefinder are switched off by RNGFND_TYPE = 0" in each for each in found["problems"])
    assert any("before the next flight, for ArduPilot set SR0_EXTRA1 = 10" in each for each in found["problems"])
    assert found["health"]["link"]["lost"] > 0


def test_a_good_link_lost_nothing(logs) -> None:
    found = _document(logs / "sitl/brushless_ctl.tlog")["health"]
    assert found["link"] == {"received": 55_510, "lost": 0}  # as pymavlink counts the autopilot's frames
    assert found["estimator"]["worst_test_ratios"]["compass"] == pytest.approx(0.1453, abs=1e-4)


@pytest.mark.parametrize(
    ("log", "telemetry", "said"),
    [
        ("logs/vtol.tlog", "system = 9", "telemetry.system = 9 is not heard"),
        ("logs/vtol.tlog", "", "telemetry.height.order lists rangefinder, which does not come"),
        ("logs/vtol.tlog", "", "telemetry.attitude.order lists GIMBAL_DEVICE_ATTITUDE_STATUS"),
        ("sitl/servo_consumer.tlog", 'attitude = { frame = "earth" }', "reports against the vehicle"),
        ("sitl/cold_boot.tlog", "height = { min_m = 80 }", "min_m is 80 m, and the highest flown is 0.0 m"),
    ],
)
def test_a_configuration_that_does_not_fit_is_said(logs, tmp_path, log, telemetry, said) -> None:
    config = tmp_path / "station.toml"
    config.write_text(STATION.format(telemetry=telemetry))
    assert any(said in each for each in _document(logs / log, "--config", config)["problems"])


@pytest.mark.parametrize(
    ("log", "telemetry", "is_usable"),
    [
        ("logs/vtol.tlog", "", False),
        ("sitl/cold_boot.tlog", "", False),
        ("sitl/cold_boot.tlog", "height = { home_above_plane_m = 30.0 }", True),
        ("logs/vtol.tlog", "system = 9", False),
    ],
)
def test_usable_is_what_an_import_would_make_of_it(logs, tmp_path, log, telemetry, is_usable) -> None:
    (tmp_path / "station.toml").write_text(STATION.format(telemetry=telemetry))
    log, config = logs / log, tmp_path / "station.toml"
    found = _document(log, "--config", config)
    imported = CliRunner().invoke(flight, [str(log), "--rate", "1", "-c", str(config), "-o", str(tmp_path / "out")])
    assert found["usable"] is is_usable
    assert isinstance(imported.exception, NoAnswerError) is not is_usable


def test_the_configurations_own_heights_are_compared(logs, tmp_path) -> None:
    (tmp_path / "station.toml").write_text(STATION.format(telemetry="height = { home_above_plane_m = 20.0 }"))
    found = _document(logs / "sitl/servo_consumer.tlog", "--config", tmp_path / "station.toml")
    (sentence,) = [each for each in found["problems"] if "heights disagree" in each]
    assert "home is 20.0" in sentence
    assert sentence.endswith("set telemetry.height.home_above_plane_m = 0")


STRICT = """health = { max_test_ratio = 0.14, gps_horizontal_std_m = 0.1, heartbeat_s = 0.5 }
zoom = { hfov_std_deg = 0.5 }
height = { order = ["home", "terrain"], std_m = { home = 0.5 } }"""
LAX = """zoom = { hfov_std_deg = 0.7 }
height = { order = ["home", "terrain"], std_m = { home = 30.0 } }"""


def test_what_comes_is_held_against_the_stations_own_limits(logs, tmp_path) -> None:
    sentences = {
        "its test ratio of compass reaches 0.15, nothing is measured from 0.14 on",
        "horizontally at its worst, 0.1 m is wanted",
        "nothing is measured later than 0.5 s after one",
        "hfov 62.0 deg, the camera file 62.6 deg (std of the two 0.5 deg)",
        "heights disagree: terrain is",
    }
    config, said = tmp_path / "station.toml", []
    for telemetry in (STRICT, LAX):
        config.write_text(STATION.format(telemetry=telemetry).replace("62.0\n[telemetry]", "62.6\n[telemetry]"))
        found = _document(logs / "sitl/brushless_ctl.tlog", "--config", config)["problems"]
        said.append({sentence for sentence in sentences if any(sentence in each for each in found)})
    assert said == [sentences, set()]
