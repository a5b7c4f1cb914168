"""One station on the bus: a ``Sink`` that publishes, and the queries and observations that come in."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from operator import attrgetter
from typing import Final, NamedTuple, TypeAlias

import zenoh

from aerodft.adapters.bus.queries import StationQueries
from aerodft.adapters.bus.session import close_session, open_session
from aerodft.adapters.images import encode_jpeg, is_due
from aerodft.adapters.wire.estimates import encode_camera_motion, encode_estimate
from aerodft.adapters.wire.events import encode_image
from aerodft.adapters.wire.keys import DEFAULT_LISTEN, Keys
from aerodft.adapters.wire.measurement import encode_measurement, encode_measurements
from aerodft.adapters.wire.observations import parse_observation
from aerodft.adapters.wire.pose import encode_height_switch, encode_poses
from aerodft.adapters.wire.requests import MeasureRequest
from aerodft.adapters.wire.status import StationStatus, encode_status
from aerodft.adapters.worker_queue import WorkerQueue
from aerodft.errors import AerodftError, InputError
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

_QUEUED_TICKS = 256
_LOG_EVERY = 1000
_JPEG_QUALITY = 75

IMAGE_HZ: Final = 2.0
"""Images per second that are published."""

_log = logging.getLogger(__name__)


def _as_it_is(image: Image) -> Image:
    return image


class _Payload(NamedTuple):
    """What is published: its place among all of some ticks, the probe of a measurement, the key, the JSON."""

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
        on_measure: Answers ``measure`` queries, in a thread of the bus.
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
        on_measure: Callable[[MeasureRequest], list[Measurement]] | None = None,
        on_observation: Callable[[Observation], None] | None = None,
        in_utc: Callable[[Image], Image] = _as_it_is,
    ) -> None:
        self._keys = Keys(station)
        self._last_image_ns: int | None = None
        self._in_utc = in_utc
        self._malformed = self._shed_images = self._shed_outputs = 0
        self._session = open_session(listen, connect)
        self._publishers = _Publishers(self._session)
        self._queue: WorkerQueue[_Work] = WorkerQueue("publish", self._publish, _nothing, capacity=_QUEUED_TICKS)
        self._image_queue: WorkerQueue[Image] = WorkerQueue("publish-images", self._publish_image, _nothing, capacity=2)
        self._queries = StationQueries(
            self._session,
            self._keys,
            probes=lambda: probes,
            measure=None if on_measure is None else lambda request: encode_measurements(on_measure(request)),
        )
        self._declared: list[zenoh.LivelinessToken | zenoh.Subscriber[None]] = [
            self._session.liveliness().declare_token(self._keys.alive)
        ]
        if on_observation is not None:
            self._declared.append(self._observations(on_observation))

    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the observations that came in, in one sentence."""
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
        """What is published of some ticks; of an image first its pose."""
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


def _nothing() -> None:
    """Publishing needs no tending."""


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
            publisher.undeclare()  # type: ignore[no-untyped-call]  # zenoh is annotated in part
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
