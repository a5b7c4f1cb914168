import contextlib
import io
import json
import queue
import socket
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import av
import numpy as np
import pytest
import zenoh

from aerodft.errors import LinkError, UsageError
from aerodft.service.clocks import WallClock
from aerodft.sim import datagrams, default_camera
from aerodft.sim.live import Outlets, encode_packets, observation_publisher, parse_udp, send_live, udp_sender
from aerodft.sim.scenario import Scenario, survey_scenario
from tests.clock import VirtualClock

if TYPE_CHECKING:
    from aerodft.sim.observations import Sighting


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return survey_scenario(default_camera(320, 240), duration_s=4.0, fps=5.0)


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiving:
        receiving.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        receiving.bind(("127.0.0.1", 0))
        receiving.settimeout(5.0)
        yield receiving


def address_of(receiving: socket.socket) -> str:
    return f"udpout:127.0.0.1:{receiving.getsockname()[1]}"


def test_everything_is_sent_once_and_when_it_is_due(scenario: Scenario) -> None:
    clock = VirtualClock(scenario.trajectory.start_ns)
    sent: list[tuple[int, str, bytes]] = []
    seen: list[tuple[int, Sighting]] = []
    outlets = Outlets(
        telemetry=lambda data: sent.append((clock.now_ns(), "mavlink", data)),
        video=lambda data: sent.append((clock.now_ns(), "video", data)),
        observe=lambda each: seen.append((clock.now_ns(), each)),
        observe_delay_ns=30_000_000,
    )
    video = encode_packets(scenario)
    send_live(scenario, video, outlets, clock)
    expected = datagrams(scenario.trajectory, scenario.autopilot)
    assert [(at, data) for at, kind, data in sent if kind == "mavlink"] == [(d.due_ns, d.data) for d in expected]
    times = [at for at, kind, _ in sent if kind == "video"]
    assert sorted(set(times)) == scenario.image_stamps_ns.tolist()
    assert seen
    assert all(at - each.stamp_ns == 30_000_000 for at, each in seen)
    stream = b"".join(data for _, kind, data in sent if kind == "video")
    with av.open(io.BytesIO(stream), format="mpegts") as container:
        assert len(list(container.decode(video=0))) == len(video) == 20


def test_a_socket_gets_every_datagram(scenario: Scenario, receiver: socket.socket) -> None:
    quick = replace(scenario, autopilot=replace(scenario.autopilot, rates_hz={"ATTITUDE": 50.0}))
    with udp_sender(address_of(receiver)) as send:
        send_live(quick, [], Outlets(telemetry=send), VirtualClock())
    expected = [datagram.data for datagram in datagrams(quick.trajectory, quick.autopilot)]
    assert [receiver.recv(2048) for _ in expected] == expected


def test_the_wall_clock_paces_the_flight(scenario: Scenario) -> None:
    clock = WallClock()
    short = replace(scenario, autopilot=replace(scenario.autopilot, rates_hz={"ATTITUDE": 50.0}))
    short = replace(
        short, trajectory=short.trajectory.cut(short.trajectory.start_ns, short.trajectory.start_ns + 10**9)
    )
    short = short.shifted(clock.now_ns() - short.trajectory.start_ns + 50_000_000)
    at: list[int] = []
    send_live(short, [], Outlets(telemetry=lambda _: at.append(clock.now_ns())), clock)
    due = np.array([datagram.due_ns for datagram in datagrams(short.trajectory, short.autopilot)])
    assert np.all(np.array(at) >= due)
    assert np.median(np.array(at) - due) < 20_000_000


def test_a_shifted_flight_is_the_same_flight(scenario: Scenario) -> None:
    later = scenario.shifted(123_000_000)
    np.testing.assert_array_equal(later.image_stamps_ns - scenario.image_stamps_ns, 123_000_000)
    one = scenario.trajectory.pose(int(scenario.image_stamps_ns[10]))
    other = later.trajectory.pose(int(later.image_stamps_ns[10]))
    np.testing.assert_array_equal(one.wxyz, other.wxyz)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("udpout:127.0.0.1:14550", ("127.0.0.1", 14550)),
        ("udp://localhost:5600", ("localhost", 5600)),
        ("udp://[::1]:5600", ("::1", 5600)),
    ],
)
def test_addresses(text: str, expected: tuple[str, int]) -> None:
    assert parse_udp(text) == expected


@pytest.mark.parametrize("text", ["udpin:127.0.0.1:14550", "udp://127.0.0.1", "udp://127.0.0.1:99999", "14550", ""])
def test_what_is_no_address_is_one_sentence(text: str) -> None:
    with pytest.raises(UsageError, match="no address to send to"):
        parse_udp(text)


def test_an_unknown_host_is_one_sentence() -> None:
    with pytest.raises(LinkError, match="unknown host"), udp_sender("udpout:no-such-host.invalid:14550"):
        pass


def test_observations_reach_a_zenoh_subscriber(scenario: Scenario) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    received: queue.Queue[tuple[str, bytes]] = queue.Queue()
    seen: list[Sighting] = []
    send_live(scenario, [], Outlets(observe=seen.append), VirtualClock())
    with zenoh.open(config) as session, contextlib.ExitStack() as stack:
        subscriber = session.declare_subscriber(
            "aerodft/yard/observation/**", lambda s: received.put((str(s.key_expr), bytes(s.payload)))
        )
        publish = stack.enter_context(observation_publisher(endpoint, "yard"))
        for _ in range(100):  # the subscription takes a moment to be known to the publisher
            publish(seen[0])
            with contextlib.suppress(queue.Empty):
                key, payload = received.get(timeout=0.1)
                break
        else:
            pytest.fail("nothing was received within 10 s")
        subscriber.undeclare()
    assert key == f"aerodft/yard/observation/{seen[0].name}"
    assert payload == seen[0].observation_line()


def test_a_senseless_endpoint_is_one_sentence() -> None:
    with pytest.raises(LinkError, match="no endpoint"), observation_publisher("nonsense", "yard"):
        pass
