"""A recording's inputs as a ``Source``: the pipeline takes them as it took the live ones; and its pixels.

Pixels are found by an image's arrival and decoded when somebody asks: JPEGs one by one, video in order.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf.message import DecodeError

from aerodft.adapters.images import FramePixels, PacketDecoder, decode_jpeg, is_key_packet
from aerodft.adapters.recording import SENDER_KEY, Channel, ChannelMessage, is_raw
from aerodft.adapters.recording.read import ChunkLocation, ChunkReader, ChunkTable, SegmentScan, is_one_of, log_times
from aerodft.adapters.recording.write import image_sequence
from aerodft.adapters.wire.events import IMAGE_SCHEMA, OBSERVATION_SCHEMA, decode_images, decode_observations
from aerodft.adapters.wire.payload import LATEST_NS
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, located
from aerodft.model import Arrival, Event, Image, ImageArray, ImageRows, IntArray, Observation, RawBlock
from aerodft.service import first_arrival_ns
from replay.recordings.recording import ENCODED_IMAGE_SCHEMAS, JPEG_SCHEMA, VIDEO_SCHEMA, Recording
from replay.recordings.segments import channels_of


def jpeg_of(data: bytes) -> bytes:
    """The JPEG in a ``foxglove.CompressedImage``.

    Raises:
        InputError: It is none.
    """
    try:
        return bytes(CompressedImage.FromString(data).data)
    except DecodeError as error:
        raise InputError("a recorded image is damaged", got=error) from error


def _still_at(
    place: ChunkLocation, segment: SegmentScan, log_ns: int, sequence: int, most_px: int | None
) -> ImageArray:
    """The pixels of a JPEG of a chunk, of images of so many at most.

    Raises:
        InputError: The recording is damaged there.
    """
    where = f"{place.path}, image at {log_ns} ns"
    for message in _messages_at(segment, place):
        found = message.log_ns == log_ns and message.sequence == sequence
        if found and message.channel.schema == JPEG_SCHEMA:
            return decode_jpeg(jpeg_of(message.data), where, most_px)
    raise InputError("the recorded image is gone", where=where)


_NEAR_NS: Final = 4 * SECOND_NS
"""To an image so close ahead decoding goes on from where it is."""
_KEY_WITHIN_NS: Final = (_NEAR_NS, 60 * SECOND_NS)
"""A key image is looked for so long before an image; where there is none, decoding begins at the start."""


class _VideoReader:
    """A recording's video packets, decoded in order from the last key image before the one that is wanted."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._packets: Iterator[ChannelMessage] = iter(())
        self._decoder: PacketDecoder | None = None
        self._last: tuple[int, FramePixels | None] = (0, None)

    def at(self, log_ns: int, most_px: int | None) -> ImageArray:
        """The pixels of the packet with this log time, of images of so many at most.

        Raises:
            InputError: It is damaged, or refers to images that are missing.
        """
        if self._decoder is None or not 0 <= log_ns - self._last[0] <= _NEAR_NS:
            self._packets, self._decoder = self._recording.image_messages(from_ns=self._key_before(log_ns)), None
            self._last = (0, None)
        while self._last[0] != log_ns or self._decoder is None:
            message = next(self._packets, None)
            if message is None or message.log_ns > log_ns:
                break
            if message.channel.schema == VIDEO_SCHEMA:
                self._last = (message.log_ns, self._decoded(message, most_px))
        stamp_ns, pixels = self._last
        if pixels is None or stamp_ns != log_ns:
            where = f"{self._recording.folder}, image at {log_ns} ns"
            raise InputError("the recorded video cannot be decoded there", where=where)
        return pixels()

    def _key_before(self, log_ns: int) -> int | None:
        """Log time of the last key image up to a time; None where none is near, or the codec does not tell."""
        for within_ns in _KEY_WITHIN_NS:
            found = None
            for message in self._recording.image_messages(from_ns=log_ns - within_ns, to_ns=log_ns + 1):
                if message.channel.schema == VIDEO_SCHEMA and _is_key(message.data):
                    found = message.log_ns
            if found is not None:
                return found
        return None

    def _decoded(self, message: ChannelMessage, most_px: int | None) -> FramePixels | None:
        try:
            packet = CompressedVideo.FromString(message.data)
            self._decoder = self._decoder or PacketDecoder(packet.format, most_px)
            frame = self._decoder.decode(packet.data)
        except (DecodeError, ValueError) as error:
            raise InputError("a recorded video packet is damaged", where=self._recording.folder, got=error) from error
        return None if frame is None else FramePixels(frame)


def _is_key(data: bytes) -> bool:
    try:
        packet = CompressedVideo.FromString(data)
    except DecodeError:  # said where it is decoded
        return False
    return is_key_packet(packet.format, packet.data)


class PixelStore:
    """Which images of a recording have pixels."""

    def __init__(self, recording: Recording) -> None:
        self._stills: dict[int, tuple[ChunkLocation, SegmentScan]] = {}
        self._packets: set[int] = set()
        self._video = _VideoReader(recording)
        for segment in recording.images:
            schemas = {number: channel.schema for number, channel in channels_of(segment).items()}
            for place in segment.chunks:
                for schema, log_ns in _images_in(segment, place, schemas):
                    if schema == VIDEO_SCHEMA:
                        self._packets.add(log_ns)
                    else:
                        self._stills[log_ns] = (place, segment)

    def __len__(self) -> int:
        return len(self._stills) + len(self._packets)

    def pixels(self, image: Image) -> Callable[[], ImageArray] | None:
        """The pixels of an image; None where none were recorded."""
        at_ns, found = image.arrival_ns, self._stills.get(image.arrival_ns)
        most_px = image.width_px * image.height_px if image.width_px and image.height_px else None
        if found is not None:
            return partial(_still_at, *found, at_ns, image_sequence(image.index), most_px)
        return partial(self._video.at, at_ns, most_px) if at_ns in self._packets else None


def _images_in(segment: SegmentScan, place: ChunkLocation, schemas: dict[int, str]) -> Iterator[tuple[str, int]]:
    """Schema and log time of a chunk's pictures: from its indexes, or where it has none from itself."""
    times = log_times(place)
    if times is None:
        for message in _messages_at(segment, place):
            if message.channel.schema in ENCODED_IMAGE_SCHEMAS:
                yield message.channel.schema, message.log_ns
        return
    for number, each in times.items():
        if schemas.get(number) in ENCODED_IMAGE_SCHEMAS:
            yield from ((schemas[number], log_ns) for log_ns in each)


def _messages_at(segment: SegmentScan, place: ChunkLocation) -> Iterator[ChannelMessage]:
    """The messages of one chunk; where no index names the channels, the first chunk does."""
    first = segment.chunks[0]
    reader = ChunkReader(segment.channels.copy(), damaged_offsets=segment.damaged_offsets)
    if not segment.is_indexed and place.offset != first.offset:
        for _ in reader.messages((first,)):
            pass
    return reader.messages((place,))


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
