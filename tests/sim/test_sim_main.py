import json
import socket
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.images import VideoFileSource
from aerodft.errors import UsageError
from aerodft.sim.__main__ import main, parse_biases, parse_numbers, parse_radio, parse_size, parse_stds
from aerodft.sim.scenario import EPOCH_NS, trajectory_from_log

FILES = ("flight.tlog", "observations.jsonl", "truth.jsonl", "poses.jsonl", "camera.toml", "world.geojson")


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int | str | None:
    monkeypatch.setattr(sys, "argv", ["aerodft.sim", *arguments])
    with pytest.raises(SystemExit) as exit_info:
        main()
    return exit_info.value.code


def test_a_flight_as_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    options = ("--out", str(tmp_path), "--duration", "4", "--fps", "5", "--size", "320x240", "--std", "tilt=0.3")
    assert run(monkeypatch, *options) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["images"] == 20
    assert int(told["start_ns"]) == EPOCH_NS
    assert 0 < abs(told["bias"]["tilt_deg"]) < 1.5
    assert all((tmp_path / name).stat().st_size > 0 for name in FILES)
    camera = load_camera(tmp_path / "camera.toml")
    assert (camera.width_px, camera.height_px) == (320, 240)
    stamps = [image.stamp_ns for image in VideoFileSource(tmp_path / "video.mp4").events()]
    poses = [json.loads(line) for line in (tmp_path / "poses.jsonl").read_text().splitlines()]
    assert stamps == [int(pose["stamp_ns"]) for pose in poses]
    flight = trajectory_from_log(tmp_path / "flight.tlog")
    assert flight.start_ns - EPOCH_NS < 1e9
    seen = [json.loads(line) for line in (tmp_path / "observations.jsonl").read_text().splitlines()]
    truth = [json.loads(line) for line in (tmp_path / "truth.jsonl").read_text().splitlines()]
    assert [(line["stamp_ns"], line["name"]) for line in seen] == [(line["stamp_ns"], line["name"]) for line in truth]
    assert {int(line["stamp_ns"]) for line in seen} <= set(stamps)
    world = json.loads((tmp_path / "world.geojson").read_text())
    assert world["type"] == "FeatureCollection"
    assert world["origin"]["lat_deg"] == pytest.approx(-35.363262)
    assert tomllib.loads((tmp_path / "camera.toml").read_text())["lens"] == "brown"


def test_the_same_seed_writes_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        options = ("--duration", "3", "--size", "320x240", "--no-video", "--std", "tilt=0.3", "--radio", "drop=0.1")
        assert run(monkeypatch, "--out", str(tmp_path / name), "--seed", seed, *options) == 0
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert (tmp_path / "a" / "flight.tlog").read_bytes() != (tmp_path / "c" / "flight.tlog").read_bytes()


@pytest.mark.parametrize(
    ("options", "code", "sentence"),
    [
        (("--size", "321x240"), 2, "two even numbers"),
        (("--std", "tilt=-1"), 2, "of at least 0"),
        (("--std", "yaw=1"), 2, "one of height"),
        (("--bias", "tilt=much"), 2, "a number"),
        (("--autopilot", "lag=-1"), 2, "at least 0"),
        (("--std", "height=1e300"), 2, "at most 100000"),
        (("--radio", "drop=2"), 2, "at most 1,"),
        (("--autopilot", "clock=1e10"), 2, "at most 1e+09"),
        (("--mavlink", "udpout:127.0.0.1:14550"), 2, "--live"),
        (("--live", "--mavlink", "udpin:127.0.0.1:14550"), 2, "no address"),
        (("--log", "missing.tlog"), 3, "missing.tlog"),
        (("--camera", "missing.toml"), 3, "missing.toml"),
    ],
)
def test_mistakes_are_one_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    code: int,
    sentence: str,
) -> None:
    assert run(monkeypatch, "--out", str(tmp_path / "out"), *options) == code
    said = capfd.readouterr()
    assert sentence in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert not (tmp_path / "out").exists()


def test_a_live_flight_reaches_a_socket_and_its_own_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiving:
        receiving.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        receiving.bind(("127.0.0.1", 0))
        receiving.settimeout(5.0)
        port = receiving.getsockname()[1]
        options = ("--duration", "2", "--fps", "5", "--size", "320x240", "--video", "udp://127.0.0.1:9")
        options = (*options, "--out", str(tmp_path), "--live", "--mavlink", f"udpout:127.0.0.1:{port}")
        before_ns = time.time_ns()
        assert run(monkeypatch, *options, "--image", "exposure=0.01") == 0
        told = json.loads(capfd.readouterr().out)
        assert before_ns < int(told["start_ns"]) < int(told["end_ns"]) <= time.time_ns()
        logged = (tmp_path / "flight.tlog").read_bytes()
        while logged:
            datagram = receiving.recv(2048)
            assert logged[8 : 8 + len(datagram)] == datagram
            logged = logged[8 + len(datagram) :]
    assert not (tmp_path / "video.mp4").exists()


def test_an_unwritable_folder_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert run(monkeypatch, "--out", str(tmp_path / "file"), "--duration", "2", "--no-video") == 3
    assert "cannot be written" in capfd.readouterr().err


def test_the_module_runs_and_helps() -> None:
    done = subprocess.run([sys.executable, "-m", "aerodft.sim", "--help"], capture_output=True, text=True, check=True)
    assert "python -m aerodft.sim --out" in done.stdout
    assert done.stderr == ""


def test_numbers_are_read_with_their_units() -> None:
    assert parse_size("1920x1080") == (1920, 1080)
    assert parse_stds("--std", "tilt=180, height=2").tilt_rad == pytest.approx(3.14159265)
    assert parse_biases("--bias", "height=-1.5").height_m == -1.5
    assert parse_numbers("--observe", "std=0", {"std": 0.5, "delay": 0.05}) == {"std": 0.0, "delay": 0.05}
    radio = parse_radio("--radio", "latency=0.02,mute=5,unmute=7", seed=9)
    assert (radio.latency_ns, radio.outages_ns, radio.seed) == (20_000_000, ((5_000_000_000, 7_000_000_000),), 9)
    with pytest.raises(UsageError):
        parse_radio("--radio", "latency", seed=1)


def test_a_camera_file_of_somebody_elses_is_not_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "camera.toml").write_text("mine")
    assert run(monkeypatch, "--out", str(tmp_path), "--duration", "2", "--no-video") == 3
    assert "is no simulated flight: got a camera.toml in it" in capfd.readouterr().err
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("camera.toml", "mine")]
