"""``doctor --fix`` against an autopilot's stand-in that really changes its rates."""

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from aerodft.cli.doctor import doctor

from .autopilot import ACCEPTED, DENIED, QUIET, StandIn, flying, free_port

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(doctor)
SECONDS = ("--seconds", "1.5")


def _doctor(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(each) for each in arguments])


def test_every_request_gets_its_answer_and_rates_change() -> None:
    vehicle = StandIn(free_port(), answers={30: ACCEPTED, 24: ACCEPTED, 193: ACCEPTED, 132: QUIET, 271: DENIED})
    with flying(vehicle):
        result = _doctor(f"udpin:{vehicle.port}", *SECONDS, "--fix", "--json")
    assert result.exit_code == 0, result.output
    fixed = {each["message"]: each for each in json.loads(result.stdout)["fix"]}
    assert {name: each["answer"] for name, each in fixed.items()} == {
        "ATTITUDE": "accepted",
        "GPS_RAW_INT": "accepted",
        "EKF_STATUS_REPORT": "accepted",
        "DISTANCE_SENSOR": "no answer",
        "CAMERA_FOV_STATUS": "denied",
        "GIMBAL_DEVICE_ATTITUDE_STATUS": "unsupported",
        "TERRAIN_REPORT": "unsupported",
    }
    assert fixed["ATTITUDE"]["before_hz"] == pytest.approx(2.0, rel=0.2)
    assert fixed["ATTITUDE"]["after_hz"] == pytest.approx(10.0, rel=0.2)
    assert fixed["CAMERA_FOV_STATUS"]["after_hz"] == 0.0
    assert vehicle.intervals_s["ATTITUDE"] == pytest.approx(0.1)
    sent = [
        (int(each.command), int(each.param1), each.target_system, each.target_component) for each in vehicle.commands
    ]
    assert [each[1] for each in sent].count(132) == 3  # asked again where nothing came back
    assert {(command, *target) for command, _, *target in sent} == {(511, 1, 1)}
    repeats = [int(each.confirmation) for each in vehicle.commands if int(each.param1) == 132]
    assert repeats == [0, 1, 2]


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
        refused = _doctor(f"udpin:{port}", "--seconds", "0.8", "--fix")
        assert chosen.commands == other.commands == []
        result = _doctor(f"udpin:{port}", "--seconds", "0.8", "--fix", "--system", 7, "--json")
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
        result = _doctor(f"udpin:{vehicle.port}", *SECONDS, "--fix", "--signing-key", key_file, "--json")
    fixed = {each["message"]: each for each in json.loads(result.stdout)["fix"]}
    assert fixed["ATTITUDE"]["answer"] == "accepted"
    assert fixed["ATTITUDE"]["after_hz"] == pytest.approx(10.0, rel=0.2)
    assert vehicle.commands
    assert all(each.get_signed() for each in vehicle.commands)


def test_a_log_cannot_be_asked(tmp_path: Path) -> None:
    result = _doctor(tmp_path / "flight.tlog", "--fix")
    assert "a log cannot be asked" in str(result.exception)


def test_nobody_to_ask_is_said() -> None:
    result = _doctor(f"udpin:{free_port()}", "--seconds", "0.2", "--fix")
    assert "no vehicle could be asked" in str(result.exception)
