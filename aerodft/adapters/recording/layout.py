"""MCAP's records in bytes: what the recorder writes live, and what recovery writes again.

The stock writer is not used: it does not survive a write that fails (what it believes to be in the file is not), and a
message costs it more than twice as much. The stock reader is the authority on the result.
"""

import struct
import zlib
from typing import NamedTuple, TypeAlias

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import McapRecord, Schema

from aerodft.adapters.recording.channels import Channel
from aerodft.model import IntArray

MAGIC = b"\x89MCAP0\r\n"
NO_OPCODE = 0  # which the format forbids: zeros are no records
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
CHUNK_HEAD = struct.Struct("<QQQI")  # earliest and latest log time, size and CRC of the content
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_MESSAGE = struct.Struct("<BQHIQQ")
_ENTRY = struct.Struct("<QQ")  # log time, offset in the content
_INDEX_HEAD = struct.Struct("<BQHI")
_INDEX_REST_BYTES = 6
INDEX_ENTRY_BYTES, INDEX_HEAD_BYTES = _ENTRY.size, _INDEX_HEAD.size
_COUNT = struct.Struct("<I")
_SIZE = struct.Struct("<Q")
# A third of the time of the usual level 3, and no larger for numbers as text; a window of 256 kB stays in the cache.
_ZSTD = zstandard.ZstdCompressionParameters.from_level(1, window_log=18)
_USUAL_BYTES = 1 << 20  # of a chunk: pages that are never written to take no memory
Compressor: TypeAlias = zstandard.ZstdCompressor


def compressor() -> Compressor:
    """Compressor of chunks; for one thread at a time, and cheaper used again than made anew."""
    return zstandard.ZstdCompressor(compression_params=_ZSTD)


class EncodedChunk(NamedTuple):
    """A chunk as it goes into a file, the message indexes behind it included; says nothing about where.

    Attributes:
        head: The chunk record without its content.
        content: Its content as it is stored.
        indexes: The message indexes behind it.
        compression: ``zstd`` or empty.
        content_bytes: Uncompressed.
        start_ns: Earliest log time.
        end_ns: Latest.
        counts: Messages by channel, in the order of the indexes.
    """

    head: bytes
    content: bytes
    indexes: bytes
    compression: str
    content_bytes: int
    start_ns: int
    end_ns: int
    counts: dict[int, int]

    @property
    def size_bytes(self) -> int:
        """Length of the chunk with its index records in a file."""
        return len(self.head) + len(self.content) + len(self.indexes)

    @property
    def messages(self) -> int:
        """Number of messages in the chunk."""
        return sum(self.counts.values())


class ChunkBuffer:
    """The content of a chunk in progress.

    Args:
        definitions: Schemas and channels to begin with.

    Attributes:
        content_bytes: Uncompressed.
        messages: How many were added.
    """

    def __init__(self, definitions: bytes = b"") -> None:
        self.content_bytes = 0
        self.messages = 0
        self._memory = memoryview(bytearray())
        self._indexes: dict[int, bytearray] = {}
        self._start_ns = self._end_ns = 0
        self.define(definitions)

    def define(self, definition: bytes) -> None:
        """Add a schema or a channel, before its first message."""
        self.more(len(definition))[:] = definition

    def more(self, size: int) -> memoryview:
        """A part of the content of some bytes, to be written next."""
        begin, end = self.content_bytes, self.content_bytes + size
        if end > len(self._memory):
            grown = np.empty(max(end, 2 * len(self._memory), _USUAL_BYTES), dtype=np.uint8).data
            grown[:begin] = self._memory[:begin]
            self._memory = grown
        self.content_bytes = end
        return self._memory[begin:end]

    def add(self, channel_id: int, log_ns: int, data: bytes, sequence: int = 0) -> None:
        """Add a message."""
        index = self._indexes.get(channel_id)
        if index is None:
            index = self._indexes[channel_id] = bytearray()
        index += _ENTRY.pack(log_ns, self.content_bytes)
        record = self.more(_MESSAGE.size + len(data))
        _MESSAGE.pack_into(
            record, 0, Opcode.MESSAGE, MESSAGE_HEAD.size + len(data), channel_id, sequence, log_ns, log_ns
        )
        record[_MESSAGE.size :] = data
        if not self.messages or log_ns < self._start_ns:
            self._start_ns = log_ns
        self._end_ns = max(self._end_ns, log_ns)
        self.messages += 1

    def add_rows(self, channel_ids: IntArray, log_ns: IntArray, offset: IntArray) -> None:
        """Add ``n`` messages that were written into ``more`` of the content.

        Args:
            channel_ids: ``(n,)`` their channels.
            log_ns: ``(n,)`` their log times.
            offset: ``(n,)`` where each begins in the content.
        """
        entries = np.stack([log_ns, offset], axis=-1).astype("<u8", copy=False)
        for channel_id in dict.fromkeys(channel_ids.tolist()):  # as they appear: recovery builds them in that order
            self._indexes.setdefault(channel_id, bytearray()).extend(entries[channel_ids == channel_id].tobytes())
        first_ns, last_ns = int(log_ns.min()), int(log_ns.max())
        self._start_ns = min(self._start_ns, first_ns) if self.messages else first_ns
        self._end_ns = max(self._end_ns, last_ns)
        self.messages += len(log_ns)

    def build(self, compressor: Compressor | None) -> EncodedChunk:
        """The chunk with what was added so far; not compressed without a compressor."""
        content = self._memory[: self.content_bytes]
        data = content if compressor is None else compressor.compress(content)
        if not isinstance(data, bytes) or len(data) < len(content) // 2:
            data = bytes(memoryview(data))  # copied: the library's own bytes keep what the content takes
        head = CHUNK_HEAD.pack(self._start_ns, self._end_ns, len(content), zlib.crc32(content))
        return assemble_chunk(head, b"" if compressor is None else b"zstd", data, self._indexes)


def assemble_chunk(head: bytes, compression: bytes, data: bytes, indexes: dict[int, bytearray]) -> EncodedChunk:
    """A chunk of parts.

    Args:
        head: As ``CHUNK_HEAD`` packs it.
        compression: Its name.
        data: The content, compressed.
        indexes: By channel: log time and offset of each message, as ``index_entry`` packs them.
    """
    start_ns, end_ns, content_bytes, _ = CHUNK_HEAD.unpack(head)
    length = len(head) + _COUNT.size + len(compression) + _SIZE.size + len(data)
    begin = (RECORD_HEAD.pack(Opcode.CHUNK, length), head, _COUNT.pack(len(compression)), compression)
    behind: list[bytes] = []
    for channel_id, entries in indexes.items():
        size = len(entries)
        behind += (_INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, _INDEX_REST_BYTES + size, channel_id, size), bytes(entries))
    return EncodedChunk(
        head=b"".join((*begin, _SIZE.pack(len(data)))),
        content=data,
        indexes=b"".join(behind),
        compression=compression.decode(),
        content_bytes=content_bytes,
        start_ns=start_ns,
        end_ns=end_ns,
        counts={channel_id: len(entries) // _ENTRY.size for channel_id, entries in indexes.items()},
    )


def index_entry(log_ns: int, offset: int) -> bytes:
    """One message in a message index."""
    return _ENTRY.pack(log_ns, offset)


def encode_records(*records: McapRecord) -> bytes:
    """Records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


class Registry:
    """Schemas and channels with their ids, the same in all segments of a series."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, ChannelRecord] = {}
        self._schema_ids: dict[tuple[str, bytes], int] = {}
        self._ids: dict[Channel, int] = {}
        self._definitions = bytearray()

    @property
    def definitions(self) -> bytes:
        """Records of all schemas and channels, as they stand in a chunk."""
        return bytes(self._definitions)

    def find(self, channel: Channel) -> int | None:
        """A channel's id; None where it is new."""
        return self._ids.get(channel)

    def register(self, channel: Channel) -> bytes:
        """Give a new channel its id; returns what defines it."""
        schema_id, definition = 0, b""
        if channel.schema:
            key = (channel.schema, channel.schema_data)
            schema_id = self._schema_ids.get(key, 0)
            if not schema_id:
                schema_id = self._schema_ids[key] = len(self.schemas) + 1
                schema = Schema(
                    id=schema_id, name=channel.schema, encoding=channel.schema_encoding, data=channel.schema_data
                )
                self.schemas[schema_id] = schema
                definition = encode_records(schema)
        record = ChannelRecord(
            id=len(self.channels) + 1,
            topic=channel.topic,
            message_encoding=channel.encoding,
            schema_id=schema_id,
            metadata=dict(channel.metadata),
        )
        self.channels[record.id] = record
        self._ids[channel] = record.id
        definition += encode_records(record)
        self._definitions += definition
        return definition
