"""Messages out of a segment's chunks, in the order in which they were written."""

import logging
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from aerodft.adapters.mcap.scanning import ChunkPlace
from aerodft.errors import InputError

MAX_CHUNK_BYTES = 256 << 20  # a few kilobytes of zstd can claim gigabytes
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQ")
_MESSAGE_HEAD_BYTES = 22

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadChannel:
    """A channel as it was found; ``schema`` is its name, empty where there is none."""

    topic: str
    encoding: str
    schema: str
    metadata: dict[str, str]


class ReadMessage(NamedTuple):
    """One message; ``log_ns`` is an input's arrival, or the tick that made an output."""

    log_ns: int
    channel: ReadChannel
    data: bytes
    sequence: int


@dataclass(slots=True)
class ChunkReader:
    """Reads the chunks of one file; knows the channels of those that it has read.

    Attributes:
        damaged: Chunks that were left out.
    """

    damaged: int = 0
    _channels: dict[int, ReadChannel] = field(default_factory=dict)
    _schemas: dict[int, str] = field(default_factory=dict)

    def messages(self, chunks: Iterable[ChunkPlace]) -> Iterator[ReadMessage]:
        """The messages of chunks of one file; a damaged chunk is left out, counted and logged.

        Raises:
            InputError: The file cannot be read.
        """
        for place in chunks:
            try:
                content = _content(place)
            except (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError) as error:
                self.damaged += 1
                _log.warning("%s: damaged chunk at byte %d left out: %s", place.path, place.offset, error)
                continue
            yield from self._records(content, place)

    def _records(self, content: bytes, place: ChunkPlace) -> Iterator[ReadMessage]:
        position, end = 0, len(content)
        while position + _HEAD.size <= end:
            opcode, length = _HEAD.unpack_from(content, position)
            position += _HEAD.size
            stop = position + length
            if stop > end:
                self.damaged += 1
                _log.warning("%s: chunk at byte %d ends within a message", place.path, place.offset)
                return
            if opcode == Opcode.MESSAGE:
                identity, sequence, log_ns = _MESSAGE.unpack_from(content, position)
                channel = self._channels.get(identity)
                if channel is not None:
                    yield ReadMessage(log_ns, channel, content[position + _MESSAGE_HEAD_BYTES : stop], sequence)
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(content[position:stop])))
                self._schemas[schema.id] = schema.name
            elif opcode == Opcode.CHANNEL:
                self._register(Channel.read(ReadDataStream(BytesIO(content[position:stop]))))
            position = stop

    def _register(self, channel: Channel) -> None:
        self._channels[channel.id] = ReadChannel(
            topic=channel.topic,
            encoding=channel.message_encoding,
            schema=self._schemas.get(channel.schema_id, ""),
            metadata=dict(channel.metadata),
        )


def _content(place: ChunkPlace) -> bytes:
    """A chunk's records, uncompressed and checked.

    Raises:
        InputError: The file cannot be read.
        McapError, ValueError, ZstdError: The chunk is damaged.
    """
    try:
        with place.path.open("rb") as file:
            file.seek(place.offset)
            chunk = Chunk.read(ReadDataStream(BytesIO(file.read(place.length))))
    except OSError as error:
        raise InputError("the recording cannot be read", where=place.path, got=error.strerror) from error
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ValueError(f"claims {chunk.uncompressed_size} bytes")
    if chunk.compression == "zstd":
        if zstandard.get_frame_parameters(chunk.data).content_size not in {
            chunk.uncompressed_size,
            zstandard.CONTENTSIZE_UNKNOWN,
        }:
            raise ValueError("claims two sizes")
        content = zstandard.decompress(chunk.data, chunk.uncompressed_size)
    elif chunk.compression == "":
        content = chunk.data
    else:
        raise ValueError(f"compression {chunk.compression!r} is not used in recordings")
    if len(content) != chunk.uncompressed_size or (
        chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc
    ):
        raise ValueError("checksum or size differs")
    return content
