"""A simulated flight in real time: rendered and encoded beforehand, then sent byte by byte when due."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from urllib.parse import urlsplit

import zenoh

from aerodft.adapters.bus import session_on
from aerodft.adapters.telemetry import SignatureCheck, SigningState
from aerodft.conventions import SECOND_NS
from aerodft.errors import LinkError, UsageError
from aerodft.service import Clock
from aerodft.sim.observations import Sighting, sightings
from aerodft.sim.scenario import Progress, Scenario, images_with_progress
from aerodft.sim.telemetry import datagrams, through_radio
from aerodft.sim.video import TransportStream

Send = Callable[[bytes], None]
Observe = Callable[[Sighting], None]
_MAX_PORT = 65535
_ADDRESSES = "udpout:HOST:PORT or udp://HOST:PORT"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlets:
    """Outputs of a live flight; None for outputs that are not sent.

    Attributes:
        telemetry: Sends MAVLink datagrams.
        video: Sends MPEG-TS datagrams.
        observe: Sends sightings.
        observe_delay_ns: Processing time of an observer.
    """

    telemetry: Send | None = None
    video: Send | None = None
    observe: Observe | None = None
    observe_delay_ns: int = SECOND_NS // 20


def encode_packets(scenario: Scenario, progress: Progress | None = None) -> list[list[bytes]]:
    """Datagrams of every image; the slow part, done before the clock starts."""
    with TransportStream(scenario.fps) as stream:
        start_ns = int(scenario.image_stamps_ns[0])
        return [stream.encode(image, stamp - start_ns) for stamp, image in images_with_progress(scenario, progress)]


def send_live(scenario: Scenario, video: list[list[bytes]], outlets: Outlets, clock: Clock) -> None:
    """Send everything when it is due by ``clock``, in one thread; returns after the last byte.

    Args:
        scenario: The flight, shifted to its time.
        video: Datagrams of each image, by :func:`encode_packets`.
        outlets: The outputs.
        clock: Paces the flight; its time is the scenario's host UTC.
    """
    for due_ns, send_due in sorted(_sends(scenario, video, outlets), key=lambda each: each[0]):
        clock.sleep_until(due_ns)
        send_due()


def _sends(scenario: Scenario, video: list[list[bytes]], outlets: Outlets) -> Iterator[tuple[int, Callable[[], None]]]:
    stamps: list[int] = scenario.image_stamps_ns.tolist()
    if outlets.telemetry is not None:
        for datagram in through_radio(datagrams(scenario.trajectory, scenario.autopilot), scenario.radio):
            yield datagram.due_ns, partial(outlets.telemetry, datagram.data)
    if outlets.video is not None:
        for stamp, packets in zip(stamps, video, strict=True):
            yield stamp, partial(_send_all, outlets.video, packets)
    if outlets.observe is not None:
        for sighting in sightings(scenario.world, scenario.camera, scenario.trajectory, stamps, scenario.observing):
            yield sighting.stamp_ns + outlets.observe_delay_ns, partial(outlets.observe, sighting)


def _send_all(send: Send, packets: list[bytes]) -> None:
    for packet in packets:
        send(packet)


def parse_udp(text: str) -> tuple[str, int]:
    """Host and port of ``udpout:HOST:PORT`` or ``udp://HOST:PORT``.

    Raises:
        UsageError: Anything else.
    """
    url = f"udp://{text.removeprefix('udpout:')}" if text.startswith("udpout:") else text
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if parts.scheme != "udp" or not host or not port or port > _MAX_PORT:
        raise UsageError("no address to send to", got=text, expected=_ADDRESSES)
    return host, port


def signing_sender(send: Send, key: bytes, clock: Clock) -> Send:
    """A sender that signs each MAVLink 2 frame before sending."""
    check = SignatureCheck(key, SigningState(), clock.now_ns)
    return lambda frame: send(check.sign(frame))


@contextmanager
def udp_sender(text: str) -> Iterator[Send]:
    """A sender of UDP datagrams, whether or not anybody receives them.

    Raises:
        UsageError: Not an address.
        LinkError: The host is unknown or unreachable.
    """
    host, port = parse_udp(text)
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except socket.gaierror:
        raise LinkError("unknown host", where=text, got=host, hint="check the name, or give the address") from None
    with socket.socket(family, kind, protocol) as link:

        def send(data: bytes) -> None:
            try:
                link.sendto(data, address)
            except OSError as error:
                raise LinkError("cannot send", where=text, got=error, hint="check the network") from error

        yield send


@contextmanager
def observation_publisher(endpoint: str, station: str) -> Iterator[Observe]:
    """A zenoh publisher of sightings that connects only (no listening, no scouting) and waits for the service.

    Args:
        endpoint: The service's endpoint, for example ``tcp/127.0.0.1:7447``.
        station: The station's name in key expressions.

    Raises:
        LinkError: The endpoint is invalid.
    """
    with session_on(None, [endpoint]) as session:

        def publish(seen: Sighting) -> None:
            key = f"aerodft/{station}/observation/{seen.name}"
            session.put(key, seen.observation_line(), encoding=zenoh.Encoding.APPLICATION_JSON)

        yield publish
