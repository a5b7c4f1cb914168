"""A recording's inputs as a ``Source``: the pipeline takes them as it took the live ones."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from aerodft.adapters.recording import SENDER_KEY, Channel, is_raw
from aerodft.adapters.recording.read import ChunkTable, is_one_of
from aerodft.adapters.wire.events import IMAGE_SCHEMA, OBSERVATION_SCHEMA, decode_images, decode_observations
from aerodft.adapters.wire.payload import LATEST_NS
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, located
from aerodft.model import Arrival, Event, Image, ImageRows, IntArray, Observation, RawBlock
from aerodft.service import first_arrival_ns
from replay.recordings.pixels import PixelStore
from replay.recordings.recording import Recording

_INPUTS = frozenset({IMAGE_SCHEMA, OBSERVATION_SCHEMA})
_MIN_SHARE = 0.25  # of a chunk
_BATCH_IMAGES: Final = 256  # images: spans of ticks are bounded by them


_Subject: TypeAlias = Image | Observation


class _ChunkEvents(NamedTuple):
    """Images, or observations, by their rows ``(n,)`` in a chunk."""

    rows: IntArray
    events: Sequence[_Subject]

    @property
    def arrivals_ns(self) -> IntArray:
        """Arrivals ``(n,)``."""
        if isinstance(self.events, ImageRows):
            return self.events.arrival_ns
        return np.array([event.arrival_ns for event in self.events], dtype=np.int64)


class RecordingSource:
    """Raw telemetry, images and observations of a recording, in order of first arrival.

    Args:
        recording: The recording.
        pixels: Whether images get their recorded pixels.
    """

    def __init__(self, recording: Recording, *, pixels: bool = False) -> None:
        self._recording = recording
        self._pixels = PixelStore(recording) if pixels else None
        self._decoders: dict[str, Callable[[Sequence[bytes]], Sequence[_Subject]]] = {
            IMAGE_SCHEMA: self._images,
            OBSERVATION_SCHEMA: decode_observations,
        }

    def events(self) -> Iterator[Event]:
        """All events, (first) arrivals not decreasing; a chunk of the recording is held in memory.

        Raises:
            InputError: Arrivals go back: the recording was put together by hand; or a message is damaged.
        """
        for table, parts in self._chunks():
            by_row = {row: one for part in parts for row, one in zip(part.rows.tolist(), part.events, strict=True)}
            single: list[Event] = [by_row[row] for row in sorted(by_row)]
            yield from sorted([*_blocks(table), *single], key=first_arrival_ns)

    def gathered(self) -> Iterator[Arrival]:
        """All events in order of arrival, images of a chunk together.

        Raises:
            InputError: Arrivals go back, or a message is damaged.
        """
        for table, parts in self._chunks():
            together = chain.from_iterable(_image_batches(part.events) for part in parts)
            yield from sorted([*_blocks(table), *together], key=first_arrival_ns)

    def _chunks(self) -> Iterator[tuple[ChunkTable, list[_ChunkEvents]]]:
        """The input of each chunk: where it is, and images and observations."""
        last_ns = 0
        for table in self._recording.tables(_is_input):
            if not len(table.log_ns):
                continue
            parts = self._images_and_observations(table)
            last_ns = self._last_arrival_ns(table, parts, last_ns)
            yield table, parts

    def _last_arrival_ns(self, table: ChunkTable, parts: Sequence[_ChunkEvents], last_ns: int) -> int:
        """The last arrival of a chunk, none of which goes back: by log times, and by what images say themselves."""
        newest_ns = int(table.log_ns.max())
        if newest_ns > LATEST_NS:
            where, expected = self._recording.folder, "before the year 2262"
            raise InputError("a log time is none", where=where, got=newest_ns, expected=expected)
        log_ns = np.concatenate([[last_ns], table.log_ns.astype(np.int64)])
        arrivals = log_ns.copy()
        for part in parts:
            arrivals[1 + part.rows] = part.arrivals_ns
        for times in (log_ns, arrivals):
            back_ns = np.diff(times)
            if np.any(back_ns < 0):
                raise self._backwards_error(-int(back_ns[back_ns < 0][0]))
        return int(arrivals[-1])

    def _images_and_observations(self, table: ChunkTable) -> list[_ChunkEvents]:
        """Images and observations of a chunk."""
        found: list[_ChunkEvents] = []
        with located(self._recording.folder):
            for schema, decoded in self._decoders.items():
                wanted = [number for number, channel in table.channels.items() if channel.schema == schema]
                rows = np.flatnonzero(is_one_of(table.channel, wanted))
                places = zip(table.start[rows].tolist(), table.stop[rows].tolist(), strict=True)
                found.append(_ChunkEvents(rows, decoded([table.content[start:stop] for start, stop in places])))
        return found

    def _backwards_error(self, by_ns: int) -> InputError:
        return InputError(
            "the recording goes back in time",
            where=self._recording.folder,
            got=f"an arrival {by_ns / SECOND_NS:.3f} s before the one before it",
            expected="segments of one recording, each once",
        )

    def _images(self, data: Sequence[bytes]) -> Sequence[Image]:
        images, pixels = decode_images(data), self._pixels
        if pixels is None:
            return images
        return [replace(image, pixels=pixels.pixels(image)) for image in images]


def _image_batches(events: Sequence[_Subject]) -> Sequence[Arrival]:
    """Images in parts of moderate size where they are alike; others one by one."""
    if isinstance(events, ImageRows):
        return [events[first : first + _BATCH_IMAGES] for first in range(0, len(events), _BATCH_IMAGES)]
    return events


def _is_input(channel: Channel) -> bool:
    return is_raw(channel) or channel.schema in _INPUTS


def _blocks(table: ChunkTable) -> Iterator[RawBlock]:
    """The frames of a chunk, by sender; they stay where they are, if they are much of it."""
    senders: dict[tuple[str, str], list[int]] = {}
    for number in np.unique(table.channel).tolist():
        channel = table.channels[number]
        if is_raw(channel):
            senders.setdefault((channel.encoding, dict(channel.metadata)[SENDER_KEY]), []).append(number)
    for (protocol, sender), numbers in senders.items():
        own = table.rows(is_one_of(table.channel, numbers))
        length, offset, data = own.stop - own.start, own.start, table.content
        if length.sum() < _MIN_SHARE * len(data):  # answers lie between them: a chunk would be kept for a few frames
            data = b"".join([data[start:stop] for start, stop in zip(offset.tolist(), own.stop.tolist(), strict=True)])
            offset = np.cumsum(length) - length
        yield RawBlock(
            protocol=protocol,
            sender=sender,
            arrival_ns=own.log_ns.astype(np.int64),
            offset=offset,
            length=length,
            data=data,
        )
