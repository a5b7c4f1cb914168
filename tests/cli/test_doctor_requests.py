"""``doctor --request-messages`` against an autopilot's stand-in that really changes its rates."""

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from aerodft.cli.flights.doctor import doctor
from aerodft.errors import NoAnswerError

from .autopilot import ACCEPTED, DENIED, QUIET, REQUEST_MESSAGE, SET_MESSAGE_INTERVAL, StandIn, flying, free_port

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(doctor)
SECONDS = ("--seconds", "1.5")


def _doctor(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(each) for each in arguments])


def test_every_request_gets_its_answer_and_rates_change() -> None:
    vehicle = StandIn(free_port(), answers={30: ACCEPTED, 24: ACCEPTED, 193: ACCEPTED, 132: QUIET, 136: DENIED})
    with flying(vehicle):
        result = _doctor(f"udpin:{vehicle.port}", *SECONDS, "--request-messages", "--json")
    assert isinstance(result.exception, NoAnswerError)  # without a gimbal: what it was asked for still counts
    fixed = {each["message"]: each for each in json.loads(result.stdout)["fix"]}
    assert {name: each["answer"] for name, each in fixed.items()} == {
        "ATTITUDE": "accepted",
        "GPS_RAW_INT": "accepted",
        "EKF_STATUS_REPORT": "accepted",
        "DISTANCE_SENSOR": "no answer",
        "GIMBAL_DEVICE_ATTITUDE_STATUS": "unsupported",
        "TERRAIN_REPORT": "denied",
    }
    assert fixed["ATTITUDE"]["before_hz"] == pytest.approx(2.0, rel=0.2)
    assert fixed["ATTITUDE"]["after_hz"] == pytest.approx(10.0, rel=0.2)
    assert fixed["TERRAIN_REPORT"]["after_hz"] == 0.0
    assert vehicle.intervals_s["ATTITUDE"] == pytest.approx(0.1)
    sent = [
        (int(each.command), int(each.param1), each.target_system, each.target_component) for each in vehicle.commands
    ]
    assert [each[1] for each in sent].count(132) == 3  # asked again where nothing came back
    assert {(command, *target) for command, _, *target in sent} == {(511, 1, 1)}
    repeats = [int(each.confirmation) for each in vehicle.commands if int(each.param1) == 132]
    assert repeats == [0, 1, 2]


def test_what_a_gimbal_says_of_itself_is_not_the_autopilots_rate() -> None:
    port = free_port()
    vehicle = StandIn(port, answers={30: DENIED})
    gimbal = StandIn(port, component=154, intervals_s={"ATTITUDE": 0.05})
    with flying(vehicle, gimbal):
        result = _doctor(f"udpin:{port}", *SECONDS, "--request-messages", "--json")
    (fixed,) = [each for each in json.loads(result.stdout)["fix"] if each["message"] == "ATTITUDE"]
    assert (fixed["component"], fixed["answer"]) == (1, "denied")
    assert fixed["before_hz"] == pytest.approx(2.0, rel=0.3)
    assert fixed["after_hz"] == pytest.approx(2.0, rel=0.3)
    assert {each.target_component for each in vehicle.commands} == {1}


def test_a_camera_is_asked_itself_and_once() -> None:
    port = free_port()
    vehicle = StandIn(port)
    camera = StandIn(port, component=100, heartbeat=(30, 8), intervals_s={"HEARTBEAT": 0.2}, answers={260: ACCEPTED})
    with flying(vehicle, camera):
        result = _doctor(f"udpin:{port}", "--seconds", "0.8", "--request-messages", "--json")
    document = json.loads(result.stdout)
    fixed = [each for each in document["fix"] if each["component"] == 100]
    assert [(each["message"], each["answer"], each["count"]) for each in fixed] == [
        ("CAMERA_SETTINGS", "accepted", 1),
        ("CAMERA_FOV_STATUS", "unsupported", 0),
        ("VIDEO_STREAM_INFORMATION", "unsupported", 0),
    ]
    assert {(each.command, int(each.param2)) for each in camera.commands} == {(REQUEST_MESSAGE, 0)}
    assert {each.command for each in vehicle.commands} == {SET_MESSAGE_INTERVAL}
    assert not {260, 269, 271} & {int(each.param1) for each in vehicle.commands}
    assert [each["camera"] for each in document["health"]["cameras"]] == [100]
    assert not [each for each in document["requests"] if each["component"] == 100]


def test_without_fix_nothing_is_sent() -> None:
    vehicle = StandIn(free_port())
    with flying(vehicle):
        result = _doctor(f"udpin:{vehicle.port}", "--seconds", "0.6", "--json")
    document = json.loads(result.stdout)
    assert "ATTITUDE" in {each["message"] for each in document["requests"]}
    assert "fix" not in document
    assert vehicle.commands == []


def test_only_the_chosen_vehicle_is_asked() -> None:
    port = free_port()
    chosen, other = StandIn(port, system=7), StandIn(port, system=3)
    with flying(chosen, other):
        refused = _doctor(f"udpin:{port}", "--seconds", "0.8", "--request-messages")
        assert chosen.commands == other.commands == []
        result = _doctor(f"udpin:{port}", "--seconds", "0.8", "--request-messages", "--system", 7, "--json")
    assert "several vehicles (systems 3, 7)" in str(refused.exception)
    assert {each["system"] for each in json.loads(result.stdout)["fix"]} == {7}
    assert {each.target_system for each in chosen.commands} == {7}
    assert other.commands == []


def test_requests_on_a_signed_link_are_signed(tmp_path: Path) -> None:
    key = bytes(range(32))
    key_file = tmp_path / "vehicle.key"
    key_file.write_text(key.hex())
    key_file.chmod(0o600)
    vehicle = StandIn(free_port(), key=key)
    with flying(vehicle):
        result = _doctor(f"udpin:{vehicle.port}", *SECONDS, "--request-messages", "--signing-key", key_file, "--json")
    fixed = {each["message"]: each for each in json.loads(result.stdout)["fix"]}
    assert fixed["ATTITUDE"]["answer"] == "accepted"
    assert fixed["ATTITUDE"]["after_hz"] == pytest.approx(10.0, rel=0.2)
    assert vehicle.commands
    assert all(each.get_signed() for each in vehicle.commands)


STATION = """
[station]
name = "s"
[camera]
name = "c"
width_px = 1920
height_px = 1080
hfov_deg = 62.0
[telemetry]
connection = "udpin:127.0.0.1:1"
signing = { key_file = "vehicle.key" }
[[probe]]
name = "p"
kind = "range"
pixels = [[960, 540]]
"""


def test_a_configurations_key_checks_the_link(tmp_path: Path) -> None:
    (tmp_path / "vehicle.key").write_text(bytes(32).hex())
    (tmp_path / "vehicle.key").chmod(0o600)
    (tmp_path / "station.toml").write_text(STATION)
    genuine, forger = StandIn(free_port(), key=bytes(32)), StandIn(free_port(), key=bytes(range(32)))
    found = {}
    for vehicle in (genuine, forger):
        with flying(vehicle):
            result = _doctor(f"udpin:{vehicle.port}", "--seconds", "0.6", "-c", tmp_path / "station.toml", "--json")
        found[vehicle.port] = json.loads(result.stdout)
    assert found[genuine.port]["signing"]["verified"] > 5
    assert found[genuine.port]["signing"]["refused"] == {}
    assert found[forger.port]["signing"]["verified"] == 0
    assert found[forger.port]["signing"]["refused"]["wrong signature"] > 5
    assert found[forger.port]["streams"] == []


def test_a_signed_link_without_a_key_is_said() -> None:
    vehicle = StandIn(free_port(), key=bytes(32))
    with flying(vehicle):
        result = _doctor(f"udpin:{vehicle.port}", "--seconds", "0.6", "--json")
    document = json.loads(result.stdout)
    assert document["frames"]["signed"] > 5
    assert any(each.startswith("this link is signed") for each in document["problems"])


def test_what_was_heard_before_a_vehicle_fell_silent_is_kept() -> None:
    vehicle = StandIn(free_port(), answers={}, falls_silent=True)
    with flying(vehicle):
        result = _doctor(f"udpin:{vehicle.port}", "--seconds", "0.8", "--request-messages", "--json")
    document = json.loads(result.stdout)
    assert "ATTITUDE" in {each["message"] for each in document["streams"]}
    assert document["problems"][0].startswith("the vehicle is silent since it was asked")
    assert {each["count"] for each in document["fix"]} == {0}


def test_a_log_cannot_be_asked(tmp_path: Path) -> None:
    result = _doctor(tmp_path / "flight.tlog", "--request-messages")
    assert "a log cannot be asked" in str(result.exception)


def test_nobody_to_ask_is_said() -> None:
    result = _doctor(f"udpin:{free_port()}", "--seconds", "0.2", "--request-messages")
    assert "no vehicle could be asked" in str(result.exception)
