import json
import socket
import threading
from pathlib import Path

import numpy as np
import pytest
import typer
from pymavlink.dialects.v20 import ardupilotmega as dialect
from typer.testing import CliRunner

from aerodft.cli.flights.doctor import doctor
from aerodft.diagnosis.streams import Stream
from aerodft.errors import InputError, LinkError, NoAnswerError
from tests.replay.foreign_files import frames_of

DATA = Path(__file__).parents[2].parent / "shared" / "data"
app = typer.Typer(pretty_exceptions_enable=False)
app.command()(doctor)


@pytest.fixture
def flight() -> Path:
    if not DATA.is_dir():
        pytest.skip(f"no recorded flights: {DATA} is absent")
    return DATA / "sitl/brushless_consumer.tlog"


def test_json_is_one_document(flight: Path) -> None:
    result = CliRunner().invoke(app, [str(flight), "--json"])
    assert result.exit_code == 0
    assert json.loads(result.stdout)["usable"] is True


def test_people_get_tables_and_sentences(flight: Path) -> None:
    result = CliRunner().invoke(app, [str(flight)])
    assert result.exit_code == 0
    assert "GIMBAL_DEVICE_ATTITUDE_STATUS" in result.stdout
    assert (
        "images could be measured in 179 of 240 s" in result.stdout
    )  # in 8 s the gimbal turns: no probe has an answer
    assert "the recording machine's clock is 1.2 s ahead" in result.stdout
    assert "-0.00 m" not in result.stdout


def test_unreadable_and_useless_input(tmp_path: Path) -> None:
    (tmp_path / "notes.tlog").write_text("not a log at all, just some words\n" * 10)
    result = CliRunner().invoke(app, [str(tmp_path / "notes.tlog")])
    assert isinstance(result.exception, InputError)
    assert result.exception.exit_code == 3
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frame = bytes(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mav))
    (tmp_path / "idle.tlog").write_bytes(b"".join((k * 10**6 + 10**15).to_bytes(8, "big") + frame for k in range(9)))
    result = CliRunner().invoke(app, [str(tmp_path / "idle.tlog"), "--json"])
    assert isinstance(result.exception, NoAnswerError)
    assert result.exception.exit_code == 4
    assert json.loads(result.stdout)["problems"]


def test_a_live_link() -> None:
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = [
        bytes(message.pack(mav))
        for message in (
            dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0),
            dialect.MAVLink_distance_sensor_message(1, 20, 6000, 500, 0, 0, 25, 255),
            dialect.MAVLink_mount_orientation_message(1, 0.0, -60.0, 0.0),
        )
    ]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reserved:
        reserved.bind(("127.0.0.1", 0))
        port = reserved.getsockname()[1]
    done = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not done.wait(0.02):
                for frame in frames:
                    sender.sendto(frame, ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        result = CliRunner().invoke(app, [f"udpin:{port}", "--seconds", "0.5", "--json"])
    finally:
        done.set()
        thread.join()
    found = json.loads(result.stdout)
    assert result.exit_code == 0
    assert {stream["message"] for stream in found["streams"]} == {"ATTITUDE", "DISTANCE_SENSOR", "MOUNT_ORIENTATION"}
    assert [source["source"] for source in found["heights"]] == ["rangefinder"]


def test_a_servo_mount_is_explained_in_a_sentence(flight: Path) -> None:
    result = CliRunner().invoke(app, [str(flight.parent / "servo_consumer.tlog"), "--json"])
    document = json.loads(result.stdout)
    (attitude,) = document["attitudes"]
    assert (attitude["frame"], attitude["contradictory"]) == ("body", False)
    assert attitude["body_probability"] > 0.999
    (sentence,) = [each for each in document["problems"] if "body-frame" in each]
    assert sentence.startswith(
        "GIMBAL_DEVICE_ATTITUDE_STATUS is body-frame (against the vehicle, not the horizon): it undid"
    )
    assert 'telemetry.attitude.frame = "auto"' in sentence


def test_what_keeps_to_the_horizon_is_no_problem(flight: Path) -> None:
    document = json.loads(CliRunner().invoke(app, [str(flight), "--json"]).stdout)
    assert document["attitudes"][0]["frame"] == "earth"
    assert not [each for each in document["problems"] if "-frame" in each]
    assert [each for each in document["notes"] if "is earth-frame (against the horizon" in each]


def test_a_vehicle_that_never_tilts_tells_nothing_of_its_gimbal(flight: Path) -> None:
    document = json.loads(CliRunner().invoke(app, [str(flight.parent / "cold_boot.tlog"), "--json"]).stdout)
    assert document["attitudes"][0]["frame"] is None
    (sentence,) = [each for each in document["problems"] if "body-frame" in each]
    assert "did not move enough to tell the gimbal's frame" in sentence


def test_what_is_neither_a_file_nor_a_link_is_told_which_links_there_are() -> None:
    result = CliRunner().invoke(app, ["foo:14550"])
    assert isinstance(result.exception, LinkError)
    assert "udpin:[HOST:]PORT" in str(result.exception)


def test_help_says_what_its_exit_codes_mean() -> None:
    assert "4 no image could be measured" in " ".join(CliRunner().invoke(app, ["--help"]).stdout.split())


def test_a_clock_that_jumps_by_decades_is_no_endless_loop(aerodft, desk):
    """A second of the log, 30 years later: the moments of the silence between are not asked for one by one."""
    frames = frames_of(desk.log)
    later = [(at_ns + 30 * 365 * 86_400 * 10**9, frame) for at_ns, frame in frames]
    log = desk.folder / "jump.tlog"
    log.write_bytes(b"".join((at_ns // 1000).to_bytes(8, "big") + frame for at_ns, frame in [*frames, *later]))
    done = aerodft("doctor", log, "--json")
    assert done.code in {0, 4}, done.err
    assert done.json["poses"]["seconds"] > 29 * 365 * 86_400
    assert done.json["poses"]["ok_s"] < 10


def test_the_answer_stands_before_the_tables_and_a_log_is_not_asked(flight: Path) -> None:
    said = CliRunner().invoke(app, [str(flight)]).stdout
    assert said.startswith("images could be measured")
    assert said.index("\n- ") < said.index("Sources") < said.index("rate Hz")
    said = CliRunner().invoke(app, [str(flight.parents[1] / "logs/dronekit_quad.tlog")]).stdout
    assert (
        "ATTITUDE came at 2.7 Hz, it is wanted at 10 Hz: before the next flight, for ArduPilot set SR1_EXTRA1" in said
    )
    assert "request-messages" not in said


def test_a_burst_has_no_rate() -> None:
    burst = Stream("PARAM_VALUE", 1, 1, first_ns=0, last_ns=0)
    burst.add(np.arange(40) * 2_538)  # 40 frames in a datagram's time
    assert (burst.count, burst.rate_hz) == (40, 0.0)
    burst.add(np.array([2_000_000_000]))
    assert burst.rate_hz == 20.0
