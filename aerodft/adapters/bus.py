"""zenoh: sessions on the configured endpoints, and a station on the bus, which publishes and answers queries."""

import json
import logging
import os
import re
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from operator import attrgetter
from typing import Final, NamedTuple, TypeAlias

import zenoh

from aerodft.adapters.images import encode_jpeg, is_due
from aerodft.adapters.wire.events import encode_image
from aerodft.adapters.wire.keys import DEFAULT_LISTEN, Keys
from aerodft.adapters.wire.measurement import encode_measurement, encode_measurements
from aerodft.adapters.wire.pose import encode_height_switch, encode_poses
from aerodft.adapters.wire.requests import (
    encode_error,
    encode_probes,
    parse_history_request,
    parse_observation,
)
from aerodft.adapters.wire.status import StationStatus, encode_camera_motion, encode_estimate, encode_status
from aerodft.adapters.worker_queue import WorkerQueue
from aerodft.errors import AerodftError, InputError, LinkError
from aerodft.model import (
    CalibrationEstimate,
    CameraMotionEstimate,
    HeightSwitch,
    Image,
    Measurement,
    Observation,
    Probe,
)
from aerodft.service import Batches, StepOutputs

_EXPECTED_ENDPOINT: Final = "an endpoint such as tcp/127.0.0.1:7447"
_PROTOCOLS_WITH_PORT: Final = ("tcp", "udp", "ws", "tls", "quic")
_PROTOCOLS_WITH_PATH: Final = ("unixsock-stream",)
_MOST_PORT: Final = 65535
_OS_ERROR: Final = re.compile(r"\(os error (\d+)\)")

_log = logging.getLogger(__name__)

MOST_HISTORY: Final = 1000
"""Measurements that ``history`` queries can ask for."""
_BUG: Final = 1  # the exit code of what nobody foresaw
_Answer: TypeAlias = Callable[[bytes], bytes]

_QUEUED_TICKS = 256
_LOG_EVERY = 1000
_JPEG_QUALITY = 75

IMAGE_HZ: Final = 2.0
"""Images per second that are published."""


def open_session(listen: str | None, connect: Sequence[str] = ()) -> zenoh.Session:
    """Open a peer without multicast and gossip.

    Args:
        listen: Endpoint such as ``tcp/127.0.0.1:7447``; None to listen nowhere.
        connect: Endpoints to connect to; one that is not there yet is tried again until it is.

    Raises:
        LinkError: An endpoint is busy or makes no sense.
    """
    config = zenoh.Config()
    settings = {
        "mode": "peer",
        "listen/endpoints": [] if listen is None else [listen],
        "listen/exit_on_failure": True,
        "connect/endpoints": list(connect),
        "connect/exit_on_failure": False,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    endpoints = (*([] if listen is None else [listen]), *connect)
    for each in endpoints:
        if fault := _fault_of(each):
            raise LinkError("no endpoint", got=fault, expected=_EXPECTED_ENDPOINT)
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise _link_error(", ".join(endpoints), error) from error
    _log.info("zenoh listens on %s, connects to %s", listen or "nothing", ", ".join(connect) or "nothing")
    return session


@contextmanager
def session_on(listen: str | None, connect: Sequence[str] = ()) -> Iterator[zenoh.Session]:
    """A session that is closed at the end.

    Raises:
        LinkError: As ``open_session``.
    """
    session = open_session(listen, connect)
    try:
        yield session
    finally:
        close_session(session)


def close_session(session: zenoh.Session) -> None:
    """Close a session; one that cannot say goodbye to a stuck peer is left to the end of the process."""
    try:
        session.close()
    except zenoh.ZError as error:
        _log.warning("zenoh did not close in time: %s", _short(error))


def _link_error(where: str, error: zenoh.ZError) -> LinkError:
    if "in use" in str(error):
        return LinkError(
            "the port is busy",
            where=where,
            expected="a free port",
            hint="another service runs there; choose another port",
        )
    _log.debug("zenoh says: %s", error)
    got = _reason_in(str(error)) or "an endpoint that zenoh cannot open"
    return LinkError("the bus cannot be opened", where=where, got=got, expected=_EXPECTED_ENDPOINT)


def _short(error: zenoh.ZError) -> str:
    """The error without the source locations that zenoh puts behind it."""
    return str(error).split(" at /", 1)[0].split(" at ", 1)[0]


def _fault_of(endpoint: str) -> str:
    """Fault in the text of an endpoint; empty where there is none."""
    protocol, _, address = endpoint.partition("/")
    if protocol not in (*_PROTOCOLS_WITH_PORT, *_PROTOCOLS_WITH_PATH):
        return f"{protocol!r} for a protocol" if address else repr(endpoint)
    if protocol in _PROTOCOLS_WITH_PATH:
        return "" if address else f"{endpoint!r}, without a path"
    host, _, port = re.split(r"[?#]", address, maxsplit=1)[0].rpartition(":")
    if not host:
        return f"{endpoint!r}, without {'a port' if address else 'a host'}"
    if not (port.isascii() and port.isdigit() and int(port) <= _MOST_PORT):
        return f"{port!r} for a port"
    return ""


def _reason_in(text: str) -> str:
    """Why the system refused an endpoint, out of zenoh's error; empty where the error does not tell."""
    found = _OS_ERROR.search(text)
    if found is not None:
        return os.strerror(int(found[1]))
    if "lookup address" in text:
        return "a host that nobody knows"
    return "no certificate, which TLS and QUIC need" if "private key" in text else ""


class StationQueries:
    """Answers the queries of one station until it is closed; what has no answer gets a zenoh error reply.

    Args:
        session: Where to.
        keys: The station's.
        probes: The probes that are measured; called in threads of the bus, as ``measure`` is.
        measure: Answers the payload of a ``measure`` query with that of its reply; None where nobody can.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        *,
        probes: Callable[[], Sequence[Probe]],
        measure: Callable[[bytes], bytes] | None,
    ) -> None:
        self._history: deque[tuple[str, bytes]] = deque(maxlen=MOST_HISTORY)
        self._lock = threading.Lock()
        answers: dict[str, _Answer] = {
            keys.probes: lambda _: encode_probes(probes()),
            keys.history: self._answer_history,
        }
        if measure is not None:
            answers[keys.measure] = measure
        self._declared = [_declare(session, key, answer) for key, answer in answers.items()]

    def remember(self, probe: str, payload: bytes) -> None:
        """Take a measurement's payload into what ``history`` answers."""
        with self._lock:
            self._history.append((probe, payload))

    def forget(self) -> None:
        """Begin the history anew."""
        with self._lock:
            self._history.clear()

    def close(self) -> None:
        """Answer nothing any more."""
        for each in self._declared:
            each.undeclare()

    def _answer_history(self, data: bytes) -> bytes:
        last, probe = parse_history_request(data)
        with self._lock:
            found = [payload for name, payload in self._history if probe is None or name == probe]
        return b"[" + b",".join(found[max(len(found) - last, 0) :]) + b"]"


def _declare(session: zenoh.Session, key: str, answer: _Answer) -> "zenoh.Queryable[None]":
    """Answer queries on ``key`` with the JSON that ``answer`` makes of the payload, or with its error."""

    def reply(query: zenoh.Query) -> None:
        with query:
            payload = query.payload
            try:
                found = answer(b"" if payload is None else payload.to_bytes())
            except AerodftError as error:
                refusal = encode_error(error.exit_code, str(error))
            except Exception as error:  # noqa: BLE001 - whatever it is, the client must hear of it
                _log.exception("%s: the question could not be answered", key)
                refusal = encode_error(_BUG, f"{key}: internal error: {type(error).__name__}: {error}")
            else:
                query.reply(key, found, encoding=zenoh.Encoding.APPLICATION_JSON)
                return
            query.reply_err(refusal, encoding=zenoh.Encoding.APPLICATION_JSON)

    return session.declare_queryable(key, reply, complete=True)


def _as_it_is(image: Image) -> Image:
    return image


class _Payload(NamedTuple):
    """One message to publish: its order among those of some ticks, a measurement's probe, key and JSON."""

    order: int
    name: str | None
    key: str
    payload: bytes


_Work: TypeAlias = StepOutputs | StationStatus


class ZenohBus:
    """Publishes what a pipeline makes, answers ``measure``, ``probes`` and ``history``, and takes observations.

    Publishing drops what a slow subscriber does not take, and never waits for one.

    Args:
        station: Its name in key expressions.
        listen: Endpoint; None to listen nowhere.
        connect: Endpoints of others.
        probes: What ``probes`` queries show.
        on_measure: Answers the payload of a ``measure`` query, in a thread of the bus.
        on_observation: Takes observations (their arrival is to be set), in a thread of the bus.
        in_utc: Puts an image's stamp into UTC before it is published, so that an observer's answer is in UTC too.

    Raises:
        LinkError: An endpoint is busy or makes no sense.
    """

    def __init__(
        self,
        station: str,
        listen: str | None = DEFAULT_LISTEN,
        connect: Sequence[str] = (),
        *,
        probes: Sequence[Probe] = (),
        on_measure: Callable[[bytes], list[Measurement]] | None = None,
        on_observation: Callable[[Observation], None] | None = None,
        in_utc: Callable[[Image], Image] = _as_it_is,
    ) -> None:
        self._keys = Keys(station)
        self._last_image_ns: int | None = None
        self._in_utc = in_utc
        self._malformed = self._shed_images = self._shed_outputs = 0
        self._session = open_session(listen, connect)
        self._publishers = _Publishers(self._session)
        self._queue: WorkerQueue[_Work] = WorkerQueue("publish", self._publish, capacity=_QUEUED_TICKS)
        self._image_queue: WorkerQueue[Image] = WorkerQueue("publish-images", self._publish_image, capacity=2)
        self._queries = StationQueries(
            self._session,
            self._keys,
            probes=lambda: probes,
            measure=None if on_measure is None else lambda data: encode_measurements(on_measure(data)),
        )
        self._declared: list[zenoh.LivelinessToken | zenoh.Subscriber[None]] = [
            self._session.liveliness().declare_token(self._keys.alive)
        ]
        if on_observation is not None:
            self._declared.append(self._observations(on_observation))

    def warnings(self) -> tuple[str, ...]:
        """Sentence on observations that were refused."""
        sentence = f"{self._malformed} observations on the bus were none; the first was said when it came"
        return (sentence,) if self._malformed else ()

    @property
    def shed(self) -> int:
        """Ticks and images that were not published because publishing was too slow."""
        return self._shed_outputs + self._shed_images

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        """Publish poses, measurements and estimates of some ticks, and of their images as many as the rate allows."""
        for image in batches.images:
            if image.pixels is not None and is_due(self._last_image_ns, image.arrival_ns, IMAGE_HZ):
                self._last_image_ns = image.arrival_ns
                self._shed_images += not self._image_queue.put(self._in_utc(image))
        is_all_observed = all(isinstance(each.content, Observation) for each in outputs.singles)
        if outputs.images or outputs.observations or not is_all_observed:
            self._shed_outputs += not self._queue.put(outputs)

    def status(self, value: StationStatus) -> None:
        """Publish the station's state."""
        self._queue.put(value)

    def close(self) -> None:
        """Publish what is left, withdraw, and close the session."""
        with ExitStack() as stack:  # whatever one of them raises, the others are closed; last in, first out
            stack.callback(close_session, self._session)
            stack.callback(self._publishers.close)
            for declared in self._declared:
                stack.callback(declared.undeclare)
            stack.callback(self._queries.close)
            stack.callback(self._queue.close)
            stack.callback(self._image_queue.close)

    def _publish(self, work: _Work) -> None:
        if isinstance(work, StationStatus):
            self._publishers.json(self._keys.status, encode_status(work))
            return
        for each in sorted(self._payloads(work), key=attrgetter("order")):
            if each.name is not None:
                self._queries.remember(each.name, each.payload)
            self._publishers.json(each.key, each.payload)

    def _payloads(self, outputs: StepOutputs) -> Iterator[_Payload]:
        """Payloads to publish for the outputs of some ticks; an image's pose comes before its measurements."""
        for block in outputs.images:
            for order, payload in zip(block.order.tolist(), encode_poses(block.poses).each(), strict=True):
                yield _Payload(order, None, self._keys.pose, payload)
        for _, places, batch in outputs.measured():
            for order, measurements in zip(places.tolist(), batch, strict=True):
                for each in measurements:
                    yield _Payload(order, each.name, self._keys.measurement(each.name), encode_measurement(each))
        for single in outputs.singles:
            match single.content:
                case HeightSwitch():
                    yield _Payload(single.order, None, self._keys.height, encode_height_switch(single.content))
                case CalibrationEstimate():
                    yield _Payload(single.order, None, self._keys.calibration, encode_estimate(single.content))
                case CameraMotionEstimate():
                    yield _Payload(single.order, None, self._keys.camera_motion, encode_camera_motion(single.content))

    def _publish_image(self, image: Image) -> None:
        try:
            jpeg = encode_jpeg(image, _JPEG_QUALITY)
        except (AerodftError, OSError, ValueError) as error:
            _log.debug("image %d cannot be published: %s", image.index, error)
            return
        self._publishers.jpeg(self._keys.image, jpeg, encode_image(image))

    def _observations(self, on_observation: Callable[[Observation], None]) -> "zenoh.Subscriber[None]":
        def take(sample: zenoh.Sample) -> None:
            key = str(sample.key_expr)
            name = self._keys.observed_probe(key)
            try:
                seen = parse_observation(sample.payload.to_bytes(), name=name, arrival_ns=0, source=key)
            except InputError as error:
                if self._malformed % _LOG_EVERY == 0:
                    _log.warning("observation left out: %s", error)
                self._malformed += 1
            else:
                on_observation(seen)

        return self._session.declare_subscriber(self._keys.observations, take)


class _Publishers:
    """The publishers of one session; used by several threads, each with keys of its own."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: dict[str, zenoh.Publisher] = {}

    def json(self, key: str, payload: bytes) -> None:
        """Publish a JSON payload."""
        self._publisher(key, zenoh.Encoding.APPLICATION_JSON).put(payload)

    def jpeg(self, key: str, payload: bytes, attachment: bytes) -> None:
        """Publish a JPEG, with the JSON of its image attached."""
        self._publisher(key, zenoh.Encoding.IMAGE_JPEG, zenoh.Priority.DATA_LOW).put(payload, attachment=attachment)

    def close(self) -> None:
        """Withdraw all publishers."""
        for publisher in self._declared.values():
            publisher.undeclare()
        self._declared.clear()

    def _publisher(
        self, key: str, encoding: zenoh.Encoding, priority: zenoh.Priority = zenoh.Priority.DATA
    ) -> zenoh.Publisher:
        publisher = self._declared.get(key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                key, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP, priority=priority
            )
            self._declared[key] = publisher
        return publisher
