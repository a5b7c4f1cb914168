"""A recording's segments as one MCAP file, in order of log time, with what lies beside them attached."""

import heapq
import mimetypes
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import accumulate
from pathlib import Path
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata
from mcap.writer import CompressionType, Writer

from aerodft.adapters.codec.wire import SOFTWARE
from aerodft.adapters.mcap.layout import MAGIC
from aerodft.adapters.mcap.places import ReadChannel, SegmentScan
from aerodft.adapters.mcap.reading import ChunkReader, ReadMessage
from aerodft.adapters.mcap.segment import PROFILE
from aerodft.errors import InputError
from replay.recording import Recording

_CHUNK_BYTES: Final = 1 << 20
_MOST_HELD_BYTES: Final = 64 << 20
_MESSAGE_BYTES: Final = 300  # what a message takes in memory besides its payload
_MOST_BYTES: Final = 256 << 20
_HEAD: Final = struct.Struct("<BQ")
_DAMAGED: Final = (McapError, struct.error, UnicodeDecodeError, OverflowError)


@dataclass(slots=True)
class Merged:
    """What went into the file.

    Attributes:
        messages: Of all segments.
        attachments: Of the segments, and files beside them.
    """

    messages: int = 0
    attachments: int = 0


def merge_segments(recording: Recording, path: Path) -> Merged:
    """Write all messages, metadata and attachments of a recording as one file, with chunks, checksums and an index.

    At a time it holds those chunks that overlap in time, and one attachment. What is not in it, ``recording.left_out``
    says afterwards.

    Args:
        recording: The recording.
        path: The file.

    Raises:
        InputError: A segment cannot be read.
        OSError: The file cannot be written.
    """
    segments = [*recording.data, *(each for each in recording.images if each not in recording.data)]
    totals = Merged()
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile=PROFILE, library=SOFTWARE)
        _write_extras(writer, recording, segments, totals)
        ids: dict[int, int] = {}
        known: dict[str, int] = {}
        kept: list[ReadChannel] = []  # an id stays one object's as long as the object is kept
        for message in _by_time(segments):
            channel = ids.get(id(message.channel))
            if channel is None:
                channel = ids[id(message.channel)] = _registered(writer, message.channel, known)
                kept.append(message.channel)
            writer.add_message(channel, message.log_ns, message.data, message.log_ns, message.sequence)
            totals.messages += 1
        writer.finish()  # type: ignore[no-untyped-call]  # annotated in part
    return totals


def _registered(writer: Writer, channel: ReadChannel, known: dict[str, int]) -> int:
    """The file's number of a channel; segments that have the same one share it."""
    schema_key = repr((channel.schema, channel.schema_encoding, channel.schema_data))
    key = repr((channel.topic, channel.encoding, sorted(channel.metadata.items()), schema_key))
    if key not in known:
        if channel.schema and schema_key not in known:
            known[schema_key] = writer.register_schema(channel.schema, channel.schema_encoding, channel.schema_data)
        schema = known[schema_key] if channel.schema else 0
        known[key] = writer.register_channel(channel.topic, channel.encoding, schema, dict(channel.metadata))
    return known[key]


def _by_time(segments: list[SegmentScan]) -> Iterator[ReadMessage]:
    """The messages of all segments by log time; of the same time, in order of the segments. Opens each when due."""
    waiting: list[tuple[int, int, ReadMessage | None]] = [
        (min(chunk.start_ns for chunk in segment.chunks), number, None)
        for number, segment in enumerate(segments)
        if segment.chunks
    ]
    heapq.heapify(waiting)
    streams = [_sorted(segment) for segment in segments]
    while waiting:
        _, number, message = waiting[0]
        if message is not None:
            yield message
        following = next(streams[number], None)
        if following is None:
            heapq.heappop(waiting)
        else:
            heapq.heapreplace(waiting, (following.log_ns, number, following))


def _sorted(segment: SegmentScan) -> Iterator[ReadMessage]:
    """One segment's messages by log time, else as they were written; chunks that overlap are held together.

    Where these are too much to be held, what is earliest of it goes out: a file need not be in order.
    """
    reader = ChunkReader(segment.channels.copy(), left_out=segment.left_out)
    starts = [chunk.start_ns for chunk in segment.chunks]
    later = [*list(accumulate(reversed(starts), min))[-2::-1], None]
    held = _Held()
    for chunk, limit_ns in zip(segment.chunks, later, strict=True):
        for message in reader.messages((chunk,)):
            held.add(message)
            while held.is_full:
                yield held.pop()
        while held.is_due(limit_ns):
            yield held.pop()


class _Held:
    """Messages by log time, of the same time in the order in which they came."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, ReadMessage]] = []
        self._count = self._bytes = 0

    @property
    def is_full(self) -> bool:
        return self._bytes > _MOST_HELD_BYTES

    def is_due(self, limit_ns: int | None) -> bool:
        """Whether there is one from before the limit."""
        return bool(self._heap) and (limit_ns is None or self._heap[0][0] < limit_ns)

    def add(self, message: ReadMessage) -> None:
        heapq.heappush(self._heap, (message.log_ns, self._count, message))
        self._count += 1
        self._bytes += len(message.data) + _MESSAGE_BYTES

    def pop(self) -> ReadMessage:
        message = heapq.heappop(self._heap)[2]
        self._bytes -= len(message.data) + _MESSAGE_BYTES
        return message


def _write_extras(writer: Writer, recording: Recording, segments: list[SegmentScan], totals: Merged) -> None:
    """Metadata, each once; attachments; and the files beside the segments as attachments."""
    seen: set[str] = set()
    for segment in segments:
        for record in _extras(segment.path):
            if isinstance(record, Attachment):
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
                totals.attachments += 1
            elif (key := repr((record.name, sorted(record.metadata.items())))) not in seen:
                seen.add(key)
                writer.add_metadata(record.name, record.metadata)
    if not recording.folder.is_dir():
        return
    for path in sorted(recording.folder.iterdir()):
        if path.is_file() and path.suffix != ".mcap" and not path.name.startswith("."):
            try:
                data = path.read_bytes()
            except OSError as error:
                raise InputError("the file cannot be read", where=path, got=error.strerror) from error
            kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
            writer.add_attachment(recording.start_ns, recording.start_ns, path.name, kind, data)
            totals.attachments += 1


def _extras(path: Path) -> Iterator[Metadata | Attachment]:
    """The metadata and attachments of a file, as far as it is whole."""
    kinds: dict[int, type[Metadata | Attachment]] = {Opcode.METADATA: Metadata, Opcode.ATTACHMENT: Attachment}
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            file.seek(len(MAGIC))
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                opcode, length = _HEAD.unpack(head)
                end = file.tell() + length
                if end > size:
                    return
                kind = kinds.get(opcode)
                if kind is not None and length <= _MOST_BYTES:
                    try:
                        yield kind.read(ReadDataStream(BytesIO(file.read(length))))
                    except _DAMAGED:
                        return
                file.seek(end)
    except OSError as error:
        raise InputError("the recording cannot be read", where=path, got=error.strerror) from error
