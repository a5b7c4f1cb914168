"""An autopilot's stand-in on a loopback socket: sends messages at their intervals, and changes these when asked."""

import math
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512
ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
QUIET = "no acknowledgement"
BY_ID = {
    30: "ATTITUDE",
    33: "GLOBAL_POSITION_INT",
    2: "SYSTEM_TIME",
    24: "GPS_RAW_INT",
    193: "EKF_STATUS_REPORT",
    260: "CAMERA_SETTINGS",
}


def _message(name: str, boot_ms: int) -> dialect.MAVLink_message:
    unix_us = 1_795_221_168_000_000 + 1000 * boot_ms
    return {
        "ATTITUDE": lambda: dialect.MAVLink_attitude_message(boot_ms, 0.01, -0.02, 0.5, 0, 0, 0),
        "GLOBAL_POSITION_INT": lambda: dialect.MAVLink_global_position_int_message(
            boot_ms, -353_600_000, 1_491_600_000, 634_000, 50_000, 0, 0, 0, 0
        ),
        "SYSTEM_TIME": lambda: dialect.MAVLink_system_time_message(unix_us, boot_ms),
        "GPS_RAW_INT": lambda: dialect.MAVLink_gps_raw_int_message(
            boot_ms * 1000, 3, -353_600_000, 1_491_600_000, 634_000, 80, 120, 0, 0, 14, 634_000, 800, 1200
        ),
        "RANGEFINDER": lambda: dialect.MAVLink_rangefinder_message(math.nan, 0.0),
        "CAMERA_SETTINGS": lambda: dialect.MAVLink_camera_settings_message(boot_ms, 0, zoomLevel=0.0),
        "EKF_STATUS_REPORT": lambda: dialect.MAVLink_ekf_status_report_message(831, 0.1, 0.1, 0.1, 0.1, 0.1),
    }[name]()


@dataclass
class StandIn:
    """One vehicle.

    Attributes:
        port: Where it sends to.
        system: Its id.
        component: Whom of it this is.
        heartbeat: Its MAV_TYPE and MAV_AUTOPILOT.
        answers: What it answers to a request for a message id: a MAV_RESULT, or QUIET; others are unsupported.
        key: Signs and checks with it, if it is there.
        falls_silent: Whether it says nothing any more once it was asked for anything.
        commands: Every COMMAND_LONG that it got.
        intervals_s: How often it sends what.
    """

    port: int
    system: int = 1
    component: int = 1
    heartbeat: tuple[int, int] = (2, 3)
    answers: dict[int, int | str] = field(default_factory=lambda: dict.fromkeys(BY_ID, ACCEPTED))
    key: bytes | None = None
    falls_silent: bool = False
    commands: list[dialect.MAVLink_message] = field(default_factory=list)
    intervals_s: dict[str, float] = field(
        default_factory=lambda: {"HEARTBEAT": 0.2, "ATTITUDE": 0.5, "GLOBAL_POSITION_INT": 0.1, "SYSTEM_TIME": 0.25}
    )

    def fly(self, done: threading.Event) -> None:
        link = dialect.MAVLink(None, srcSystem=self.system, srcComponent=self.component)
        link.robust_parsing = True
        if self.key is not None:
            link.signing.secret_key = self.key
            link.signing.sign_outgoing = True
            link.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)
        due = dict.fromkeys(self.intervals_s, 0.0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
            udp.bind(("127.0.0.1", 0))
            udp.settimeout(0.01)
            start = time.monotonic()
            while not done.is_set():
                now = time.monotonic() - start
                for name, interval_s in ({} if self.falls_silent and self.commands else self.intervals_s).items():
                    if now >= due.get(name, 0.0):
                        due[name] = max(due.get(name, 0.0) + interval_s, now)
                        message = self._beat() if name == "HEARTBEAT" else _message(name, int(now * 1000) + 1000)
                        self._send(udp, link, message)
                self._hear(udp, link)

    def _beat(self) -> dialect.MAVLink_message:
        kind, autopilot = self.heartbeat
        return dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)

    def _send(self, udp: socket.socket, link: dialect.MAVLink, message: dialect.MAVLink_message) -> None:
        udp.sendto(bytes(message.pack(link)), ("127.0.0.1", self.port))
        link.seq = (link.seq + 1) % 256

    def _hear(self, udp: socket.socket, link: dialect.MAVLink) -> None:
        try:
            data = udp.recv(4096)
        except (TimeoutError, ConnectionError):
            return
        for message in link.parse_buffer(data) or []:
            if message.get_type() != "COMMAND_LONG":
                continue
            if message.target_component != self.component:
                continue
            self.commands.append(message)
            wanted = int(message.param1)
            answer = self.answers.get(wanted, UNSUPPORTED)
            if answer == ACCEPTED and message.command == REQUEST_MESSAGE:
                self._send(udp, link, _message(BY_ID[wanted], 1000))
            elif answer == ACCEPTED and wanted in BY_ID:
                self.intervals_s[BY_ID[wanted]] = message.param2 / 1e6
            if answer != QUIET:
                ack = dialect.MAVLink_command_ack_message(
                    message.command,
                    answer,
                    target_system=message.get_srcSystem(),
                    target_component=message.get_srcComponent(),
                )
                self._send(udp, link, ack)


@contextmanager
def flying(*vehicles: StandIn) -> Iterator[None]:
    """The vehicles in the air, each on its own thread."""
    done = threading.Event()
    threads = [threading.Thread(target=each.fly, args=(done,)) for each in vehicles]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        done.set()
        for thread in threads:
            thread.join()


def free_port() -> int:
    """A port of the loopback interface that nobody has now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reserved:
        reserved.bind(("127.0.0.1", 0))
        return int(reserved.getsockname()[1])
