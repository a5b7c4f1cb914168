"""``serve`` as a process, with telemetry at a rate; for whoever kills it, ends it, or fills its disk."""

import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tomli_w
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.config.camera import camera_document
from aerodft.conventions import SECOND_NS
from aerodft.sim import default_camera

RATE_HZ, IMAGES_HZ = 200, 10
PATIENCE_S = 120.0


def free_port() -> int:
    with socket.socket(type=socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@dataclass
class Flight:
    """A service, and the telemetry that is sent to it: every frame bears its number as its time since boot.

    A frame that a busy machine sends late says when it was due, in both of its times: where an autopilot's two times
    differ by that, stamps go back.
    """

    folder: Path
    tables: dict[str, object] = field(default_factory=dict)
    sent: list[tuple[int, int]] = field(default_factory=list)  # number, host time
    port: int = field(default_factory=free_port)
    program: tuple[str, ...] = ("-m", "aerodft")

    def __post_init__(self) -> None:
        self.folder.mkdir()
        (self.folder / "camera.toml").write_text(tomli_w.dumps(camera_document(default_camera(640, 360))))
        document = {
            "station": {"name": "killed"},
            "camera": {"file": "camera.toml"},
            "telemetry": {"connection": f"udpin:127.0.0.1:{self.port}", "height": {"order": ["home"]}},
            "images": {"rate_hz": IMAGES_HZ},
            "zenoh": {"enabled": False},
            "record": {"folder": str(self.folder / "none")},
            "probe": [{"name": "centre", "kind": "range", "pixels": [[319.5, 179.5]]}],
            **self.tables,
        }
        (self.folder / "station.toml").write_text(tomli_w.dumps(document))

    @property
    def recording(self) -> Path:
        return self.folder / "recording"

    @contextmanager
    def served(self, recording: Path) -> Iterator[tuple[subprocess.Popen[bytes], Callable[[], None]]]:
        """The service, and what ends the telemetry that comes to it."""
        words = ("serve", self.folder / "station.toml", "-o", recording, "--json")
        line = [sys.executable, *map(str, (*self.program, *words))]
        out = (self.folder / "summary.json").open("wb")
        with out, (self.folder / "said").open("wb") as said, subprocess.Popen(line, stderr=said, stdout=out) as process:
            stop = threading.Event()
            sender = threading.Thread(target=self._send, args=(stop,))

            def quiet() -> None:
                stop.set()
                if sender.ident is not None:
                    sender.join()

            try:
                self._await(process)
                sender.start()
                yield process, quiet
            finally:
                quiet()
                process.kill()

    def _await(self, process: subprocess.Popen[bytes]) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while b"recording to" not in (self.folder / "said").read_bytes():
            assert process.poll() is None, (self.folder / "said").read_text()
            assert time.monotonic() < until_s
            time.sleep(0.01)

    def fly(self, seconds: float, number: int) -> tuple[int, float, int]:
        """Send for so long, then end the service; returns when that was, how long it took, and its exit code."""
        with self.served(self.recording) as (process, quiet):
            time.sleep(seconds)
            if number == signal.SIGTERM:
                quiet()
                time.sleep(0.05)  # what is under way arrives
            at_ns = time.time_ns()
            process.send_signal(number)
            process.wait(PATIENCE_S)
            took_s = (time.time_ns() - at_ns) / SECOND_NS
        return at_ns, took_s, process.returncode

    def _send(self, stop: threading.Event) -> None:
        mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        begin_s, begin_us = time.monotonic(), time.time_ns() // 1000
        with socket.socket(type=socket.SOCK_DGRAM) as out:
            out.connect(("127.0.0.1", self.port))
            number = 0
            while not stop.is_set():
                due = int((time.monotonic() - begin_s) * RATE_HZ)
                for number in range(number, due):  # noqa: B020 - goes on where it was
                    try:
                        out.send(message(number, begin_us).pack(mav))
                    except ConnectionRefusedError:  # nobody there any more
                        return
                    self.sent.append((number, time.time_ns()))
                number = max(number, due)
                stop.wait(0.002)


def message(number: int, begin_us: int) -> dialect.MAVLink_message:
    """One of what a pose needs, of a vehicle that booted at this UTC; all of them say their number."""
    kind = number % 10
    if kind == 0:
        return dialect.MAVLink_system_time_message(begin_us + number * 5000, number * 5)
    if kind in {1, 6}:
        return dialect.MAVLink_global_position_int_message(
            number * 5, -353_600_000, 1_491_600_000, 640_000, 40_000, 0, 0, 0, 0
        )
    if kind in {2, 7}:
        half = np.radians(-60.0) / 2
        q = [float(np.cos(half)), 0.0, float(np.sin(half)), 0.0]
        nan = float("nan")
        return dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, number * 5, 44, q, nan, nan, nan, 0)
    return dialect.MAVLink_attitude_message(number * 5, 0.0, 0.0, 0.5, 0, 0, 0)
