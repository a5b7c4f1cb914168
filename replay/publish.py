"""A recording on the bus again: original payloads on original keys, in order, at the pace that is asked for."""

import heapq
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import cast

import zenoh

from aerodft.adapters.codec import estimate, events, height, measurement, pose, status, steadiness
from aerodft.adapters.codec.keys import Keys
from aerodft.adapters.mcap.reading import ReadMessage
from aerodft.service.ports import Clock
from replay.pixels import IMAGE_SCHEMA, jpeg_of
from replay.recording import Recording

_PUBLISHED = frozenset(
    {measurement.SCHEMA, pose.SCHEMA, status.SCHEMA, height.SCHEMA, estimate.SCHEMA, steadiness.SCHEMA}
)
_READ = _PUBLISHED | {events.IMAGE_SCHEMA, IMAGE_SCHEMA}
_POLL_S = 0.02


@dataclass(slots=True)
class Published:
    """How many messages went out."""

    measurements: int = 0
    others: int = 0
    images: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Republisher:
    """Publishes recordings; a slow subscriber slows it down, nothing is dropped.

    Inputs other than images are not published: a station that is live would take them for its own.

    Attributes:
        session: Where to.
        clock: Paces it.
        rate: Times real time; None for as fast as it goes.
    """

    session: zenoh.Session
    clock: Clock
    rate: float | None
    _publishers: dict[str, zenoh.Publisher] = field(default_factory=dict)

    def wait_for_subscriber(self, recording: Recording, timeout_s: float) -> bool:
        """Wait until somebody subscribes to the recording's measurements; False after ``timeout_s``."""
        key = f"{Keys(recording.station).root}/measurement/*"
        end_s = time.monotonic() + timeout_s
        with self.session.declare_publisher(key) as publisher:
            while not _matches(publisher):
                if time.monotonic() >= end_s:
                    return False
                time.sleep(_POLL_S)
        return True

    def publish(
        self,
        recording: Recording,
        *,
        from_ns: int | None = None,
        to_ns: int | None = None,
        on_time: Callable[[int], None] | None = None,
    ) -> Published:
        """Publish log times in ``[from_ns, to_ns)``.

        Args:
            recording: What.
            from_ns: None for the start.
            to_ns: None for the end.
            on_time: Called with each log time that has been reached.

        Returns:
            What went out.

        Raises:
            InputError: The recording is damaged in a way that cannot be left out.
        """
        totals = Published()
        keys = Keys(recording.station)
        start_ns = self.clock.now_ns()
        first_ns: int | None = None
        image_stamps: dict[int, bytes] = {}
        try:
            for message in _merged(recording, from_ns, to_ns):
                first_ns = message.log_ns if first_ns is None else first_ns
                if self.rate is not None:
                    self.clock.sleep_until(start_ns + int((message.log_ns - first_ns) / self.rate))
                if message.channel.schema == events.IMAGE_SCHEMA:
                    image_stamps = {message.sequence: message.data}
                elif message.channel.schema == IMAGE_SCHEMA:
                    self._publish_jpeg(keys.image, message, image_stamps)
                    totals.images += 1
                else:
                    self._publisher(message.channel.topic, zenoh.Encoding.APPLICATION_JSON).put(message.data)
                    is_measurement = message.channel.schema == measurement.SCHEMA
                    totals.measurements += is_measurement
                    totals.others += not is_measurement
                if on_time is not None:
                    on_time(message.log_ns)
        finally:
            self._withdraw()
        return totals

    def _publish_jpeg(self, key: str, message: ReadMessage, image_stamps: dict[int, bytes]) -> None:
        publisher = self._publisher(key, zenoh.Encoding.IMAGE_JPEG)
        publisher.put(jpeg_of(message.data), attachment=image_stamps.get(message.sequence))

    def _publisher(self, key: str, encoding: zenoh.Encoding) -> zenoh.Publisher:
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self.session.declare_publisher(
                key, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK
            )
            self._publishers[key] = publisher
        return publisher

    def _withdraw(self) -> None:
        for publisher in self._publishers.values():
            publisher.undeclare()  # type: ignore[no-untyped-call]  # zenoh is annotated in part
        self._publishers.clear()


def _matches(publisher: zenoh.Publisher) -> bool:
    # zenoh's annotation says bool, what comes is a MatchingStatus, and that is always true.
    return cast("zenoh.MatchingStatus", publisher.matching_status).matching


def _merged(recording: Recording, from_ns: int | None, to_ns: int | None) -> Iterator[ReadMessage]:
    """What is published, and the images' stamps, by log time; a JPEG comes after its image's stamps."""
    data = recording.messages(from_ns=from_ns, to_ns=to_ns)
    images = recording.image_messages(from_ns=from_ns, to_ns=to_ns)
    merged = heapq.merge(data, images, key=lambda message: message.log_ns)
    return (message for message in merged if message.channel.schema in _READ)
