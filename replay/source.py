"""A recording's inputs as a ``Source``: the pipeline takes them as it took the live ones."""

from collections.abc import Iterator
from dataclasses import replace

from aerodft.adapters.codec import events
from aerodft.adapters.codec.wire import LATEST_NS
from aerodft.adapters.mcap.channels import SENDER_KEY
from aerodft.adapters.mcap.places import ReadChannel
from aerodft.adapters.mcap.reading import ReadMessage
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, located
from aerodft.model.batch import Event
from aerodft.model.image import Image
from aerodft.model.telemetry import RawBlock, WireProtocol
from aerodft.service.feed import block_of, first_arrival_ns
from replay.pixels import PixelStore
from replay.recording import Recording

_BLOCK_FRAMES = 4096
_INPUTS = frozenset({events.IMAGE_SCHEMA, events.OBSERVATION_SCHEMA})
_PROTOCOLS = frozenset(protocol.value for protocol in WireProtocol)


class RecordingSource:
    """Raw telemetry, images and observations of a recording, in order of first arrival.

    Args:
        recording: The recording.
        from_ns: Earliest arrival; None for the start.
        to_ns: Arrivals stop before it; None for the end.
        pixels: Whether images get their recorded pixels.
    """

    def __init__(
        self, recording: Recording, *, from_ns: int | None = None, to_ns: int | None = None, pixels: bool = False
    ) -> None:
        self._recording = recording
        self._from_ns = from_ns
        self._to_ns = to_ns
        self._pixels = PixelStore(recording) if pixels else None

    def events(self) -> Iterator[Event]:
        """All events, (first) arrivals not decreasing; at most a second of telemetry is held in memory.

        Raises:
            InputError: Arrivals go back: the recording was put together by hand; or a message is damaged.
        """
        last_ns = 0
        for event in self._events():
            arrival_ns = first_arrival_ns(event)
            if arrival_ns < last_ns:  # by its own word: log times were looked at before
                raise self._gone_back(last_ns - arrival_ns)
            last_ns = arrival_ns
            yield event

    def _events(self) -> Iterator[Event]:
        blocks = _Blocks()
        for message in self._inputs():
            if message.channel.encoding in _PROTOCOLS:
                if blocks.is_full(message):
                    yield from blocks.take()
                blocks.add(message)
            else:
                yield from blocks.take()
                with located(self._recording.folder):
                    is_image = message.channel.schema == events.IMAGE_SCHEMA
                    event = self._image(message.data) if is_image else events.decode_observation(message.data)
                yield event
        yield from blocks.take()

    def _inputs(self) -> Iterator[ReadMessage]:
        last_ns = 0
        for message in self._recording.messages(from_ns=self._from_ns, to_ns=self._to_ns):
            if message.channel.encoding not in _PROTOCOLS and message.channel.schema not in _INPUTS:
                continue
            if message.log_ns < last_ns:
                raise self._gone_back(last_ns - message.log_ns)
            if message.log_ns > LATEST_NS:
                raise InputError(
                    "a log time is none",
                    where=self._recording.folder,
                    got=message.log_ns,
                    expected="before the year 2262",
                )
            last_ns = message.log_ns
            yield message

    def _gone_back(self, by_ns: int) -> InputError:
        return InputError(
            "the recording goes back in time",
            where=self._recording.folder,
            got=f"an arrival {by_ns / SECOND_NS:.3f} s before the one before it",
            expected="segments of one recording, each once",
        )

    def _image(self, data: bytes) -> Image:
        image = events.decode_image(data)
        if self._pixels is None:
            return image
        return replace(image, pixels=self._pixels.pixels(image.arrival_ns, image.index))


class _Blocks:
    """Frames by sender, collected until something else arrives."""

    def __init__(self) -> None:
        self._frames: dict[tuple[str, str], tuple[list[int], list[bytes]]] = {}
        self._count = 0
        self._first_ns = 0

    def is_full(self, message: ReadMessage) -> bool:
        return self._count >= _BLOCK_FRAMES or (self._count > 0 and message.log_ns - self._first_ns > SECOND_NS)

    def add(self, message: ReadMessage) -> None:
        if not self._count:
            self._first_ns = message.log_ns
        arrivals_ns, frames = self._frames.setdefault(_sender(message.channel), ([], []))
        arrivals_ns.append(message.log_ns)
        frames.append(message.data)
        self._count += 1

    def take(self) -> list[RawBlock]:
        """What was collected, in order of first arrival."""
        if not self._count:
            return []
        blocks = [
            block_of(WireProtocol(protocol), sender, arrivals_ns, frames)
            for (protocol, sender), (arrivals_ns, frames) in self._frames.items()
        ]
        self._frames.clear()
        self._count = 0
        return sorted(blocks, key=first_arrival_ns)


def _sender(channel: ReadChannel) -> tuple[str, str]:
    return channel.encoding, channel.metadata.get(SENDER_KEY, "")
