import logging
import os
import pty
import socket
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Final

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink import LinkKind, MavlinkLink, is_link, parse_address
from aerodft.errors import LinkError
from aerodft.model import WireProtocol

WAIT_S: Final = 5.0
LOOPBACK: Final = "127.0.0.1"


class Received:
    """An inbox that can be waited on."""

    def __init__(self) -> None:
        self.frames: dict[str, list[bytes]] = defaultdict(list)
        self._news = threading.Condition()

    def put_frames(self, protocol: str, sender: str, frames: Sequence[bytes]) -> None:
        assert protocol is WireProtocol.MAVLINK
        with self._news:
            self.frames[sender] += frames
            self._news.notify_all()

    def all(self) -> list[bytes]:
        with self._news:
            return [frame for frames in self.frames.values() for frame in frames]

    def wait_for(self, count: int) -> list[bytes]:
        with self._news:
            self._news.wait_for(lambda: sum(map(len, self.frames.values())) >= count, WAIT_S)
        return self.all()


@pytest.fixture
def received() -> Received:
    return Received()


@pytest.fixture
def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def sender() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        yield sock


def _attitudes(count: int, system: int = 1) -> list[bytes]:
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    frames = []
    for k in range(count):
        mav.seq = k % 256
        frames.append(bytes(dialect.MAVLink_attitude_message(k, 0.1, 0.2, k / 1e4, 0, 0, 0).pack(mav)))
    return frames


def _is_heartbeat(data: bytes) -> bool:
    message = dialect.MAVLink(None).parse_char(data)
    return message is not None and message.get_type() == "HEARTBEAT" and message.type == dialect.MAV_TYPE_GCS


def test_a_cut_datagram_holds_nothing_back(received: Received, sender: socket.socket) -> None:
    long = bytes(dialect.MAVLink_statustext_message(6, b"x" * 50, 1).pack(dialect.MAVLink(None)))
    frames = _attitudes(3)
    with MavlinkLink("udpin:127.0.0.1:0", received) as link:
        for piece in (*frames[:2], long[:20], frames[2]):
            sender.sendto(piece, (LOOPBACK, link.local_port))
        assert received.wait_for(3) == frames


def test_udpin_hears_pymavlink(received: Received) -> None:
    with MavlinkLink("udpin:0", received) as link:
        peer = mavutil.mavlink_connection(f"udpout:{LOOPBACK}:{link.local_port}")
        for k in range(50):
            peer.mav.attitude_send(k, 0.1, 0.2, 0.3, 0, 0, 0)
        assert len(received.wait_for(50)) == 50
        peer.close()


def test_udpin_keeps_senders_apart(received: Received, sender: socket.socket) -> None:
    """A stranger's stray bytes between the halves of a frame cost nothing."""
    frames = _attitudes(100)
    with MavlinkLink("udpin:0", received) as link, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        place = (LOOPBACK, link.local_port)
        for frame in frames:
            sender.sendto(frame[:15], place)
            stranger.sendto(b"\xfd\x09\x00", place)
            sender.sendto(frame[15:], place)
        received.wait_for(100)
        assert received.frames[f"{LOOPBACK}:{sender.getsockname()[1]}"] == frames
        assert len(received.frames) == 1


def test_udpin_at_2000_messages_a_second_loses_none(received: Received, sender: socket.socket) -> None:
    frames = _attitudes(4000)
    with MavlinkLink("udpin:0", received) as link:
        start_s = time.monotonic()
        for k, frame in enumerate(frames):
            sender.sendto(frame, (LOOPBACK, link.local_port))
            if k % 20 == 19:
                due_s = start_s + (k + 1) / 2000
                time.sleep(max(0.0, due_s - time.monotonic()))
        assert received.wait_for(4000) == frames


def test_udpin_takes_a_burst(received: Received, sender: socket.socket) -> None:
    frames = _attitudes(2000)
    with MavlinkLink("udpin:0", received) as link:
        for frame in frames:
            sender.sendto(frame, (LOOPBACK, link.local_port))
        assert received.wait_for(2000) == frames


def test_udpout_makes_itself_known(received: Received) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind((LOOPBACK, 0))
        vehicle.settimeout(WAIT_S)
        with MavlinkLink(f"udpout:{LOOPBACK}:{vehicle.getsockname()[1]}", received):
            data, place = vehicle.recvfrom(2048)
            assert _is_heartbeat(data)
            frames = _attitudes(20)
            for frame in frames:
                vehicle.sendto(frame, place)
            assert received.wait_for(20) == frames
            assert _is_heartbeat(vehicle.recvfrom(2048)[0])


def test_udpout_survives_nobody_listening(received: Received, free_port: int) -> None:
    with MavlinkLink(f"udpout:{LOOPBACK}:{free_port}", received):
        vehicle = mavutil.mavlink_connection(f"udpin:{LOOPBACK}:{free_port}")
        assert vehicle.recv_match(type="HEARTBEAT", blocking=True, timeout=WAIT_S) is not None
        vehicle.mav.attitude_send(1, 0.1, 0.2, 0.3, 0, 0, 0)
        assert len(received.wait_for(1)) == 1
        vehicle.close()


def test_tcp_connects_again(received: Received, free_port: int) -> None:
    frames = _attitudes(30)
    with MavlinkLink(f"tcp:{LOOPBACK}:{free_port}", received):
        for k in range(3):
            with socket.create_server((LOOPBACK, free_port)) as server:
                server.settimeout(WAIT_S)
                peer, _ = server.accept()
                with peer:
                    peer.settimeout(WAIT_S)
                    assert k or _is_heartbeat(peer.recv(2048))
                    stream = b"".join(frames[10 * k : 10 * k + 10])
                    peer.sendall(stream[:100])
                    peer.sendall(stream[100:])
                    received.wait_for(10 * k + 10)
    assert received.all() == frames


def test_tcpin_takes_several_peers(received: Received) -> None:
    with MavlinkLink("tcpin:0", received) as link:
        peers = [socket.create_connection((LOOPBACK, link.local_port), WAIT_S) for _ in range(2)]
        for system, peer in enumerate(peers, start=1):
            peer.sendall(b"".join(_attitudes(25, system)))
        received.wait_for(50)
        assert all(_is_heartbeat(peer.recv(2048)) for peer in peers)
        for peer in peers:
            peer.close()
    assert sorted(received.frames.values()) == sorted([_attitudes(25, 1), _attitudes(25, 2)])


def test_serial_device(received: Received) -> None:
    ours, theirs = pty.openpty()
    device = os.ttyname(theirs)
    frames = _attitudes(20)
    with MavlinkLink(f"{device},57600", received):
        assert _is_heartbeat(os.read(ours, 2048))
        os.write(ours, b"".join(frames))
        assert received.wait_for(20) == frames
    os.close(ours)
    os.close(theirs)


def test_a_lost_serial_device_is_said_and_waited_for(received: Received, caplog: pytest.LogCaptureFixture) -> None:
    ours, theirs = pty.openpty()
    device = os.ttyname(theirs)
    with caplog.at_level(logging.WARNING), MavlinkLink(device, received) as link:
        os.close(theirs)
        os.close(ours)
        deadline_s = time.monotonic() + WAIT_S
        while "is lost" not in caplog.text and time.monotonic() < deadline_s:
            time.sleep(0.01)
        start_s = time.monotonic()
        link.close()
        assert time.monotonic() - start_s < 0.5
    assert f"{device} is lost" in caplog.text


def test_close_is_quick_and_gives_the_port_back(received: Received, free_port: int) -> None:
    for text in (f"udpin:{free_port}", f"tcpin:{free_port}", f"tcp:{LOOPBACK}:{free_port}") * 2:
        link = MavlinkLink(text, received)
        start_s = time.monotonic()
        link.close()
        link.close()
        assert time.monotonic() - start_s < 0.5


def test_busy_ports_are_refused(received: Received) -> None:
    with MavlinkLink("udpin:0", received) as link, pytest.raises(LinkError, match="busy") as refusal:
        MavlinkLink(f"udpin:{link.local_port}", received)
    assert f"udpin:{link.address.port or ''}" in str(refusal.value)
    with socket.create_server((LOOPBACK, 0)) as server, pytest.raises(LinkError, match="busy"):
        MavlinkLink(f"tcpin:{server.getsockname()[1]}", received)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("udpin:192.0.2.77:14550", "not an address of this machine"),
        ("/dev/no-such-device,57600", "cannot be opened"),
        ("tcp:no-such-host.invalid:5760", "unknown host"),
        ("udpin:", "no such link"),
        ("udpin:99999", "no such link"),
        ("udpout:14550", "no such link"),
        ("tcp:localhost:port", "no such link"),
        ("14550", "no such link"),
        ("http://localhost:80", "no such link"),
        ("/dev/ttyACM0,fast", "no such link"),
    ],
)
def test_bad_links_are_refused_by_name(received: Received, text: str, what: str) -> None:
    with pytest.raises(LinkError, match=what) as refusal:
        MavlinkLink(text, received)
    assert text in str(refusal.value)


def test_addresses() -> None:
    parsed = parse_address("udp:14550")
    assert (parsed.kind, parsed.host, parsed.port) == (LinkKind.UDP_IN, LOOPBACK, 14550)
    parsed = parse_address("tcpin:0.0.0.0:5760")
    assert (parsed.kind, parsed.host, parsed.port) == (LinkKind.TCP_IN, "0.0.0.0", 5760)  # noqa: S104 - as told
    assert parse_address("/dev/ttyACM0", baud=57600).port == 57600
    assert parse_address("COM3,921600").port == 921600
    assert is_link("udpin:14550")
    assert not is_link("flight.tlog")


def test_what_was_opened_is_said(received: Received, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), MavlinkLink("udpin:0", received) as link:
        assert f"opened {LOOPBACK}:{link.local_port}" in caplog.text


def test_strangers_do_not_fill_the_log(received: Received, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), MavlinkLink("udpin:0", received) as link:
        address = (LOOPBACK, link.local_port)
        for _ in range(40):
            with socket.socket(type=socket.SOCK_DGRAM) as stranger:
                stranger.sendto(b"\xfd", address)
        deadline_s = time.monotonic() + 10
        while "more than 16 senders" not in caplog.text and time.monotonic() < deadline_s:
            time.sleep(0.01)
    assert caplog.text.count("first bytes from") == 16
    assert caplog.text.count("more than 16 senders") == 1
