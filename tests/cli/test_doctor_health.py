"""What ``doctor`` says of a vehicle's health, its camera and a configuration, on recorded flights."""

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from aerodft.cli.doctor import doctor

DATA = Path(__file__).parents[2].parent / "shared" / "data"
app = typer.Typer(pretty_exceptions_enable=False)
app.command()(doctor)
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


@pytest.mark.parametrize(("hfov", "is_said"), [(62.0, False), (62.3, False), (70.0, True)])
def test_a_camera_file_is_held_against_what_the_vehicle_says(logs, tmp_path, hfov, is_said) -> None:
    camera = tmp_path / "camera.toml"
    camera.write_text(CAMERA.format(hfov=hfov))
    found = _document(logs / "sitl/brushless_ctl.tlog", "--camera", camera)
    assert found["health"]["cameras"]["CAMERA_FOV_STATUS"]["hfov_deg"] == [62.0, 62.0]
    said = [each for each in found["problems"] if "hfov 62.0 deg, the camera file 70.0 deg" in each]
    assert bool(said) is is_said


def test_requests_name_message_rate_and_parameter(logs) -> None:
    found = _document(logs / "logs/vtol.tlog")
    asked = {each["message"]: each for each in found["requests"]}
    assert asked["ATTITUDE"]["interval_us"] == 100_000
    assert asked["ATTITUDE"]["now_hz"] == pytest.approx(4.27, abs=0.05)
    assert asked["ATTITUDE"]["parameters"] == {"ardupilot": "SR0_EXTRA1 = 10 (MAV1_EXTRA1 from 4.7 on)"}
    assert asked["GIMBAL_DEVICE_ATTITUDE_STATUS"]["now_hz"] == 0
    assert any("MAV_CMD_SET_MESSAGE_INTERVAL with 30 and 100000 us" in each for each in found["problems"])
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
    ],
)
def test_a_configuration_that_does_not_fit_is_said(logs, tmp_path, log, telemetry, said) -> None:
    config = tmp_path / "station.toml"
    config.write_text(STATION.format(telemetry=telemetry))
    assert any(said in each for each in _document(logs / log, "--config", config)["problems"])
