"""What a damaged or unfinished segment still holds, read strictly from its beginning to its end.

Nothing that a record claims is believed before it fits: sizes against the file and a limit, chunks against their
checksum. Where the bytes make no sense the next chunk that does is looked for. So a flipped bit costs one chunk.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Header, Metadata

from aerodft.adapters.recording.channels import (
    DEFINITIONS,
    RECORDING_KEY,
    Channels,
    ForeignChunkError,
    definition,
)
from aerodft.adapters.recording.layout import (
    CHUNK_HEAD,
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    EncodedChunk,
    assemble_chunk,
    index_entry,
)
from aerodft.adapters.recording.read import (
    ATTACHMENT_HEAD_BYTES,
    CRC_BYTES,
    HEAD_BYTES,
    MAX_SUMMARY_BYTES,
    MOST_ATTACHMENTS,
    AttachmentHead,
    ChunkHead,
    FileSummary,
    attachment_head,
    chunk_content,
    chunk_head,
    goes_on,
    has_owned_chunks,
    indexed_channel,
    is_chunk,
    next_chunk,
    read_summary,
    records_in,
    salvaged_length,
    stated_count,
)
from aerodft.adapters.recording.write import (
    COUNT_BYTES,
    COUNT_NAME,
    METADATA_NAME,
    MOST_INDEX_BYTES,
    index_bytes,
    pieces,
)

_MAX_SMALL_BYTES = 4 << 20
_COUNT_BEGIN = RECORD_HEAD.pack(Opcode.METADATA, COUNT_BYTES - RECORD_HEAD.size)
_DATA_END_BYTES = RECORD_HEAD.size + 4
_UNREADABLE = (McapError, struct.error, UnicodeDecodeError, OverflowError)


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeChunk:
    """A chunk that is whole.

    Attributes:
        offset: Of the record.
        chunk: It, with the times and the message indexes that its messages give.
        content: Its records.
        defines: Ids of the channels that it defines.
        is_as_built: Whether the file has the same bytes there, indexes included.
        before: How many chunks and messages the series holds before it, by the file; None where it does not say.
    """

    offset: int
    chunk: EncodedChunk
    content: bytes
    defines: frozenset[int]
    is_as_built: bool
    before: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DamagedBytes:
    """Bytes that are no whole record.

    Attributes:
        offset: Where.
        length: How many.
        why: What is wrong with them.
        is_chunk: Whether a chunk was there, known to be damaged.
        is_torn: Whether the file ends in them.
        is_extra: Whether they are a whole chunk that is not its own: of another recording, or a copy.
    """

    offset: int
    length: int
    why: str
    is_chunk: bool = False
    is_torn: bool = False
    is_extra: bool = False


class _CopiedChunkError(ValueError):
    """A chunk that the file holds already."""


class ChunkScanner:
    """Walks through one file.

    Attributes:
        header: The file's; None where it is missing or damaged.
        metadata: Names and values.
        attachments: Those that are whole: where their records are, and what they say.
        channels: By the chunks so far, and from the beginning by the summary, if its checksum is right.
        count: How many chunks and messages came before what is next, in the series, by the file; None where it says
            nothing.
        indexes: The summary's index of the chunks, if its checksum is right, by their place.
        stated_messages: How many messages there are by the summary; None without a sound one.
        has_end: Whether the data is known to end where the file says so.
        is_whole: Whether the file ends as it should, with a sound summary and nothing behind it.

    Args:
        descriptor: Open for reading.

    Raises:
        OSError: From all methods: the file cannot be read.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._size = os.fstat(descriptor).st_size
        self.header: Header | None = None
        self.metadata: list[Metadata] = []
        self.attachments: list[tuple[int, AttachmentHead]] = []
        self.channels = Channels()
        self.count: tuple[int, int] | None = None
        self.indexes: list[ChunkIndex] = []
        self._indexed: list[int] = []
        self._heads: set[bytes] = set()
        self._metadata_bytes = self._index_bytes = 0
        self._most_index_bytes = MOST_INDEX_BYTES * 3 // 2  # a segment may have to go on to the next key image
        self.stated_messages: int | None = None
        self._position = 0
        summary_start = self._summary_start()
        self.has_end = self.is_whole = summary_start is not None
        self._end = self._size
        if summary_start is not None:  # it was found to be within its limit
            self._end, self._most_index_bytes = summary_start - _DATA_END_BYTES, 2 * MAX_SUMMARY_BYTES

    def items(self) -> Iterator[WholeChunk | DamagedBytes]:
        """All chunks that are whole, and what lies between them, in order; attributes are final afterwards."""
        magic = self._read(0, len(MAGIC))
        self._position = len(MAGIC)
        if magic != MAGIC:
            yield DamagedBytes(offset=0, length=len(magic), why="no MCAP file", is_torn=MAGIC.startswith(magic))
        while self._position < self._end and self._index_bytes <= self._most_index_bytes:
            item = self._next()
            if item is not None:
                yield item
        if self._position < self._end:
            length = self._end - self._position
            yield DamagedBytes(offset=self._position, length=length, why="more chunks than a file's index may have")
            self._position = self._end
        if not self.is_whole and self._position < self._size:
            why = "no sound index"
            yield DamagedBytes(offset=self._position, length=self._size - self._position, why=why, is_torn=True)

    def _next(self) -> WholeChunk | DamagedBytes | None:
        start = self._position
        head = self._read(start, RECORD_HEAD.size)
        if len(head) < RECORD_HEAD.size:
            return self._lost(start, "ends within a record")
        opcode, length = RECORD_HEAD.unpack(head)
        end = start + RECORD_HEAD.size + length
        content = self._read(start + RECORD_HEAD.size, min(HEAD_BYTES, length))
        if opcode == Opcode.CHUNK or is_chunk(content, length):
            return self._chunk(start, length, end)
        is_attached = opcode == Opcode.ATTACHMENT and end <= self._end and self._take_attachment(start, length)
        if not is_attached and (end > self._end or length > _MAX_SMALL_BYTES):
            return self._lost(start, "a record that claims more than there is")
        if opcode == Opcode.DATA_END and end - start == _DATA_END_BYTES:
            self.has_end, self._end = True, end
            self._take_count(read_summary(self._read, self._size, end))
        elif opcode in {Opcode.HEADER, Opcode.METADATA}:
            if not self._take(opcode, self._read(start + RECORD_HEAD.size, length)):
                return self._lost(start, "a damaged record")
        elif not (is_attached or (opcode == Opcode.MESSAGE_INDEX and indexed_channel(content, length) is not None)):
            return self._lost(start, "no record of a recording")
        self._position = end
        return None

    def _take_attachment(self, start: int, length: int) -> bool:
        """Take note of an attachment; False where it is damaged."""
        if len(self.attachments) == MOST_ATTACHMENTS:
            return False
        at, end = start + RECORD_HEAD.size, start + RECORD_HEAD.size + length - CRC_BYTES
        try:
            head = attachment_head(self._read(at, min(ATTACHMENT_HEAD_BYTES, length)), length)
        except (*_UNREADABLE, ValueError):
            return False
        crc = 0
        for piece in pieces(self._descriptor, at, end - at):
            crc = zlib.crc32(piece, crc)
        if int.from_bytes(self._read(end, CRC_BYTES), "little") not in {0, crc}:
            return False
        self.attachments.append((start, head))
        return True

    def _take(self, opcode: int, content: bytes) -> bool:
        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == Opcode.HEADER:
                self.header = Header.read(stream)
            elif (total := self._metadata_bytes + len(content)) <= _MAX_SMALL_BYTES:
                self._take_metadata(Metadata.read(stream), total)
            else:
                return False
        except (*_UNREADABLE, ValueError):
            return False
        return stream.count == len(content)

    def _take_metadata(self, found: Metadata, total: int) -> None:
        """Take one of the metadata records.

        Raises:
            ValueError: It is a count that counts nothing.
        """
        if found.name == COUNT_NAME:
            self.count = stated_count(found)
            return
        self.metadata.append(found)
        self._metadata_bytes = total
        if found.name == METADATA_NAME and self.header is not None and has_owned_chunks(self.header):
            self.channels.recording = found.metadata.get(RECORDING_KEY)

    def _chunk(self, start: int, length: int, end: int) -> WholeChunk | DamagedBytes:
        at = start + RECORD_HEAD.size
        try:
            head = chunk_head(self._read(at, min(HEAD_BYTES, length)), length)
        except ValueError as error:
            return self._lost(start, str(error))
        if end > self._end:
            return self._lost(start, "ends within a chunk")
        data = self._read(at + head.data_at, head.data_bytes)
        try:
            content = chunk_content(head, data)
            chunk = _with_indexes(head, data, content)
            if chunk.head in self._heads:
                raise _CopiedChunkError("it is there already")
            defines = self._define(content)
        except ValueError as error:
            self.count = None
            if goes_on(self._read, end, self._size):
                self._position = end
                is_extra = isinstance(error, (ForeignChunkError, _CopiedChunkError))
                return DamagedBytes(offset=start, length=end - start, why=str(error), is_chunk=True, is_extra=is_extra)
            return self._lost(start, str(error), may_salvage=False)
        self._position = end
        count, self.count = self.count, None
        is_as_built = self._read(start, len(chunk.head)) == chunk.head
        if self._read(end, len(chunk.indexes)) == chunk.indexes:
            self._position += len(chunk.indexes)
        else:
            is_as_built = False
        self._index_bytes += index_bytes(chunk)
        if head.crc and self.channels.recording is not None:
            self._heads.add(chunk.head)
        return WholeChunk(
            offset=start, chunk=chunk, content=content, defines=defines, is_as_built=is_as_built, before=count
        )

    def _define(self, content: bytes) -> frozenset[int]:
        """Take a chunk's schemas and channels, all or none; returns the ids of the channels.

        Raises:
            ValueError: One is damaged, or they are too much.
        """
        ids: set[int] = set()
        self.channels.begin_chunk()
        try:
            for opcode, begin, end in records_in(content):
                if opcode in DEFINITIONS:
                    record = definition(opcode, content[begin:end])
                    self.channels.add(record)
                    if opcode == Opcode.CHANNEL:
                        ids.add(record.id)
            self.channels.check_owner()
        except _UNREADABLE as error:
            self.channels.undo_chunk()
            raise ValueError("a damaged definition") from error
        except ValueError:
            self.channels.undo_chunk()
            raise
        return frozenset(ids)

    def _lost(self, start: int, why: str, *, may_salvage: bool = True) -> WholeChunk | DamagedBytes:
        """Go on where something makes sense again.

        Args:
            start: Where the damaged record begins.
            why: What is wrong with it.
            may_salvage: Whether it may be a chunk whose kind or length alone is damaged.
        """
        if may_salvage and (length := salvaged_length(self._read, start, self._end)) is not None:
            return self._chunk(start, length, start + RECORD_HEAD.size + length)
        self.count = None
        found = next_chunk(self._read, start + 1, self._end)
        indexed = (each for each in self._indexed if start < each < (self._end if found is None else found))
        at = next((each for each in indexed if salvaged_length(self._read, each, self._end) is not None), found)
        if at is None:
            self._position = self._end
            return DamagedBytes(offset=start, length=self._end - start, why=why, is_torn=not self.has_end)
        if at - COUNT_BYTES > start and self._read(at - COUNT_BYTES, len(_COUNT_BEGIN)) == _COUNT_BEGIN:
            at -= COUNT_BYTES
        self._position = at
        return DamagedBytes(offset=start, length=at - start, why=why)

    def _summary_start(self) -> int | None:
        """Offset of the summary, its definitions read; None where the file has no sound one at its end."""
        summary = read_summary(self._read, self._size)
        if summary is None or not summary.is_checked or summary.start < len(MAGIC) + _DATA_END_BYTES:
            return None
        self.channels = summary.channels
        self.indexes = sorted(summary.chunks, key=lambda each: each.chunk_start_offset)
        self._indexed = [each.chunk_start_offset for each in self.indexes]
        self._take_count(summary)
        return summary.start

    def _take_count(self, summary: FileSummary | None) -> None:
        if summary is not None and summary.is_checked and summary.statistics is not None:
            self.stated_messages = summary.statistics.message_count

    def _read(self, offset: int, length: int) -> bytes:
        return os.pread(self._descriptor, length, offset)


def _with_indexes(head: ChunkHead, data: bytes, content: bytes) -> EncodedChunk:
    """A chunk with the times and the indexes that its messages give.

    Raises:
        ValueError: Its content is no sequence of whole records.
    """
    indexes: dict[int, bytearray] = {}
    start_ns = end_ns = 0
    for opcode, begin, _ in records_in(content):
        if opcode != Opcode.MESSAGE:
            continue
        channel_id, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content, begin)
        start_ns = min(start_ns, log_ns) if indexes else log_ns
        end_ns = max(end_ns, log_ns)
        indexes.setdefault(channel_id, bytearray()).extend(index_entry(log_ns, begin - RECORD_HEAD.size))
    times = CHUNK_HEAD.pack(start_ns, end_ns, head.content_bytes, head.crc)
    return assemble_chunk(times, head.compression, data, indexes)
