"""``aerodft replay``: on the bus, to a ground station over UDP, and with keys on a terminal."""

import os
import pty
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import closing

import orjson
import pytest
from pymavlink import mavutil

from tests.cli.conftest import HEIGHT_M, UTC0_NS
from tests.nights import at_night
from tests.ports import free_endpoint
from tests.replay.foreign_files import frames_of, write_foreign


def free_port() -> int:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


class GroundStation:
    """A real pymavlink link, and all that it heard."""

    def __init__(self) -> None:
        self.port = free_port()
        self.link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{self.port}", dialect="ardupilotmega")
        self.heard: list[bytes] = []
        self.heights_m: list[float] = []
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._ending.is_set():
            message = self.link.recv_match(blocking=True, timeout=0.1)
            if message is not None:
                self.heard.append(bytes(message.get_msgbuf()))
                if message.get_type() == "GLOBAL_POSITION_INT":
                    self.heights_m.append(message.relative_alt / 1000)

    def close(self) -> None:
        time.sleep(0.3)
        self._ending.set()
        self._thread.join()
        self.link.close()


@pytest.mark.parametrize("kind", ["own", "foreign"])
def test_a_ground_station_hears_every_frame_as_it_was_in_order(aerodft, desk, flight_recording, tmp_path, kind):
    frames = [data for _, data in frames_of(desk.log)]
    path = flight_recording
    if kind == "foreign":
        path = write_foreign(tmp_path / "a.mcap", frames_of(desk.log))
    station = GroundStation()
    found = aerodft(
        "replay", path, "--rate", "10", "--listen", "none", "--mavlink", f"udpout:127.0.0.1:{station.port}", "--json"
    )
    station.close()
    assert found.code == 0, found.err
    assert found.json["mavlink_frames"] == len(frames)
    assert station.heard == frames
    assert set(station.heights_m) == {HEIGHT_M}


def test_what_has_no_mavlink_is_not_sent(aerodft, desk, tmp_path):
    config = tmp_path / "fixed.toml"
    config.write_text('[station]\nname = "f"\n[camera]\nfile = "c.toml"\n[pose]\nheight_agl_m = 5.0\ntilt_deg = 60.0\n')
    (tmp_path / "c.toml").write_text((desk.folder / "camera.toml").read_text())
    made = aerodft(
        "import",
        "-c",
        config,
        "--video",
        desk.video(),
        "--video-start",
        "2026-11-21T00:32:48.55Z",
        "-o",
        tmp_path / "r",
    )
    assert made.code == 0, made.err
    found = aerodft("replay", tmp_path / "r", "--mavlink", f"udpout:127.0.0.1:{free_port()}", "--listen", "none")
    assert (found.code, "no MAVLink to send" in found.last) == (4, True)


def test_to_connect_to_nobody_is_no_success(aerodft, flight_recording, monkeypatch):
    monkeypatch.setattr("aerodft.app.replay._LINK_S", 0.2)
    endpoint = free_endpoint()
    found = aerodft("replay", flight_recording, "--rate", "max", "--listen", "none", "--connect", endpoint)
    assert (found.code, f"{endpoint}: nobody to publish to: got no answer within 0.2 s" in found.last) == (4, True)


def test_nobody_who_listens_is_said(aerodft, flight_recording):
    found = aerodft("replay", flight_recording, "--rate", "max", "--listen", "none", "--json")
    assert (found.code, found.json["subscribers"], found.json["measurements"]) == (0, False, 15)


def test_two_recordings_are_one_row_of_messages(aerodft, flight_recording, tmp_path):
    assert aerodft("recompute", flight_recording, "-o", tmp_path / "again").code == 0
    asked = ("--rate", "max", "--listen", "none", "--json")
    one = aerodft("replay", flight_recording, *asked).json
    both = aerodft("replay", flight_recording, tmp_path / "again", *asked).json
    assert both["measurements"] == 2 * one["measurements"]
    assert both["recording"] == [str(flight_recording), str(tmp_path / "again")]


def test_a_stretch_is_given_in_seconds_or_utc(aerodft, flight_recording):
    asked = ("replay", flight_recording, "--rate", "max", "--listen", "none", "--json")
    zero_ns = UTC0_NS + 550_000_000  # of the first image
    by_seconds = aerodft(*asked, "--from", "1", "--to", "2").json
    assert 0 < by_seconds["measurements"] < 15
    by_utc = aerodft(*asked, "--from", str(zero_ns + 10**9), "--to", "2026-11-21T00:32:50.550Z").json
    assert by_utc == by_seconds


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--rate", "0"), 2, "--rate: got 0, expected 0.01 to 1000 times real time"),
        (("--rate", "fast"), 2, "--rate: got 'fast'"),
        (("--step",), 2, "--step: got no terminal"),
        (("--mavlink", "udpin:127.0.0.1:14550"), 2, "--mavlink: got udpin:127.0.0.1:14550, expected udpout"),
        (("--mavlink", "nowhere"), 3, "no such link"),
        (("--from", "900"), 4, "the recording has nothing there"),
        (("--from", "2", "--to", "1"), 2, "--from is not before --to"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(aerodft, flight_recording, arguments, code, said):
    found = aerodft("replay", flight_recording, "--listen", "none", *arguments)
    assert (found.code, said in found.last) == (code, True), found.err


ON_TERMINAL = "import fcntl, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); from aerodft.cli.main import main; main()"


class Terminal:
    """``aerodft replay`` on a terminal of its own."""

    def __init__(self, *arguments: object) -> None:
        self._master, slave = pty.openpty()
        self.said = b""
        self._process = subprocess.Popen(
            [sys.executable, "-c", ON_TERMINAL, "replay", *map(str, arguments), "--listen", "none", "--json"],
            stdin=slave, stderr=slave, stdout=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        os.close(slave)

    def until(self, text: bytes, timeout_s: float = 30.0) -> None:
        end_s = time.monotonic() + timeout_s
        while text not in self.said and time.monotonic() < end_s:
            if select.select([self._master], [], [], 0.1)[0]:
                self.said += os.read(self._master, 4096)
        assert text in self.said, self.said
        self.said = b""

    def press(self, keys: bytes) -> None:
        os.write(self._master, keys)

    def end(self) -> tuple[int, dict]:
        output = self._process.stdout.read()
        self._process.stdout.close()
        code = self._process.wait(30)
        os.close(self._master)
        return code, orjson.loads(output)


def test_keys_step_go_on_and_end(flight_recording):
    terminal = Terminal(flight_recording, "--step", "--rate", "100")
    terminal.until(b"paused at -0.530 s")
    for key in (b"n", b"\x1b[C"):
        terminal.press(key)
        terminal.until(b"paused at ")
    terminal.press(b"l")
    terminal.until(b"looping")
    terminal.press(b" q")
    code, document = terminal.end()
    assert code == 0
    assert document["measurements"] >= 1


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), *at_night((signal.SIGTERM, 143))])
def test_signals_end_a_loop_cleanly(flight_recording, number, code):
    station = GroundStation()
    line = ["replay", flight_recording, "--loop", "--rate", "50", "--listen", "none"]
    with subprocess.Popen(
        [sys.executable, "-m", "aerodft", *map(str, line), "--mavlink", f"udpout:127.0.0.1:{station.port}"],
        stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        deadline_s = time.monotonic() + 60
        while len(station.heard) < 300 and time.monotonic() < deadline_s:  # more than one round
            time.sleep(0.05)
        process.send_signal(number)
        _, said = process.communicate(timeout=30)
    station.close()
    assert (process.returncode, "Traceback" in said) == (code, False), said
    assert len(station.heard) >= 300


@pytest.mark.nightly
def test_a_folder_that_vanishes_ends_it_in_one_sentence(flight_recording, tmp_path):
    gone = tmp_path / "gone"
    shutil.copytree(flight_recording, gone)
    with subprocess.Popen(
        [sys.executable, "-m", "aerodft", "replay", str(gone), "--loop", "--rate", "50", "--listen", "none"],
        stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert "zenoh listens on nothing" in process.stderr.readline()  # it has opened what it reads
        shutil.rmtree(gone)
        _, said = process.communicate(timeout=30)
    assert (process.returncode, "the recording cannot be read: No such file" in said) == (3, True), said
    assert "Traceback" not in said
