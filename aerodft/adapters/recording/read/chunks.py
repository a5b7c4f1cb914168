"""What an MCAP file is made of: its summary, where it is sound, and chunks, checked before any record is believed."""

import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import Final, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    ChunkIndex,
    Footer,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.stream_reader import StreamReader

from aerodft.adapters.recording.channels import Channels
from aerodft.adapters.recording.layout import CHUNK_HEAD, MAGIC, RECORD_HEAD

MAX_SUMMARY_BYTES: Final = 16 << 20
OPCODES: Final = frozenset(int(opcode) for opcode in Opcode)
DAMAGED: Final = (McapError, struct.error, ValueError, OverflowError)
"""All that the library raises where a record is damaged."""

_FOOTER_BYTES = 20
_CHECKED_BYTES = RECORD_HEAD.size + 16  # of the footer: all before its checksum
_END_BYTES = RECORD_HEAD.size + _FOOTER_BYTES + len(MAGIC)

MAX_CHUNK_BYTES = 32 << 20
"""A few kilobytes of zstd can claim gigabytes; the recorder's own chunks are of a megabyte, or of one image."""

_COUNT = struct.Struct("<I")
_SIZE = struct.Struct("<Q")
_INDEX_HEAD = struct.Struct("<HI")
_LONGEST_NAME = 8
LEAST_CHUNK_BYTES = CHUNK_HEAD.size + _COUNT.size + _SIZE.size
HEAD_BYTES = LEAST_CHUNK_BYTES + _LONGEST_NAME


@dataclass(slots=True)
class FileSummary:
    """The summary section of an MCAP file.

    Attributes:
        start: Where it begins.
        is_checked: Whether it has a checksum, which then is right.
        channels: The channels of the file.
        chunks: The index of its chunks.
        metadata: The index of its metadata.
        statistics: The file's counts; None where it has none.
    """

    start: int
    is_checked: bool
    channels: Channels = field(default_factory=Channels)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    statistics: Statistics | None = None

    def add(self, record: McapRecord) -> None:
        """Take one of its records."""
        match record:
            case Schema() | Channel():
                self.channels.add(record)
            case ChunkIndex():
                self.chunks.append(record)
            case MetadataIndex():
                self.metadata.append(record)
            case Statistics():
                self.statistics = record


def read_summary(read: Callable[[int, int], bytes], size: int, start: int | None = None) -> FileSummary | None:
    """The summary of an MCAP file; None where it has none at its end, a damaged one, or one that is too large.

    Args:
        read: Reads so many bytes from an offset of the file.
        size: Bytes of the file.
        start: Where the summary begins; None for where the file says so, which is wrong once bytes are put in.

    Raises:
        OSError: The file cannot be read.
    """
    if size < len(MAGIC) + _END_BYTES:
        return None
    end = read(size - _END_BYTES, _END_BYTES)
    if not end.endswith(MAGIC) or RECORD_HEAD.unpack_from(end) != (Opcode.FOOTER, _FOOTER_BYTES):
        return None
    footer = Footer.read(ReadDataStream(BytesIO(end[RECORD_HEAD.size :])))
    start = footer.summary_start if start is None else start
    length = size - _END_BYTES - start
    if not footer.summary_start or not 0 <= length <= MAX_SUMMARY_BYTES:
        return None
    data = read(start, length)
    if footer.summary_crc and zlib.crc32(end[:_CHECKED_BYTES], zlib.crc32(data)) != footer.summary_crc:
        return None
    found = FileSummary(start, is_checked=footer.summary_crc != 0)
    try:
        for record in StreamReader(BytesIO(data + end), skip_magic=True, emit_chunks=True).records:
            found.add(record)
    except DAMAGED:
        return None
    return found


class ChunkHead(NamedTuple):
    """The head of a chunk record, which describes its content.

    Attributes:
        start_ns: Earliest log time.
        end_ns: Latest.
        content_bytes: Uncompressed.
        crc: Of the content; 0 for none.
        compression: Its name.
        data_at: Where the content begins in the record.
        data_bytes: Of the content as it is stored.
    """

    start_ns: int
    end_ns: int
    content_bytes: int
    crc: int
    compression: bytes
    data_at: int
    data_bytes: int


def chunk_head(data: bytes, length: int) -> ChunkHead:
    """The head of a chunk record.

    Args:
        data: The record's beginning, ``HEAD_BYTES`` of it where it has so many.
        length: Of the whole record.

    Raises:
        ValueError: It is none, or claims more than is believed.
    """
    if len(data) < min(HEAD_BYTES, LEAST_CHUNK_BYTES, length):
        raise ValueError("too short for a chunk")
    try:
        start_ns, end_ns, content_bytes, crc = CHUNK_HEAD.unpack_from(data)
        (name_bytes,) = _COUNT.unpack_from(data, CHUNK_HEAD.size)
        name_at = CHUNK_HEAD.size + _COUNT.size
        if name_bytes > _LONGEST_NAME:
            raise ValueError("names no compression")
        (data_bytes,) = _SIZE.unpack_from(data, name_at + name_bytes)
    except struct.error:
        raise ValueError("too short for a chunk") from None
    data_at = name_at + name_bytes + _SIZE.size
    if data_at + data_bytes != length:
        raise ValueError("claims another size than it has")
    if max(content_bytes, data_bytes) > MAX_CHUNK_BYTES:
        raise ValueError(f"claims {max(content_bytes, data_bytes)} bytes")
    return ChunkHead(start_ns, end_ns, content_bytes, crc, data[name_at : name_at + name_bytes], data_at, data_bytes)


def chunk_content(head: ChunkHead, data: bytes) -> bytes:
    """A chunk's records, uncompressed and checked.

    Args:
        head: What the record says.
        data: The content as it is stored.

    Raises:
        ValueError: It is damaged, or of a compression that is not known.
    """
    try:
        content = _uncompressed(head, data)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise ValueError(str(error)) from error
    if len(content) != head.content_bytes or (head.crc and zlib.crc32(content) != head.crc):
        raise ValueError("checksum or size differs")
    return content


_CHUNK: Final = re.compile(rb"\x06[\s\S]{5}\x00{3}")  # shorter than a terabyte
_WINDOW_BYTES: Final = 1 << 20
_CANDIDATE_BYTES: Final = RECORD_HEAD.size + HEAD_BYTES
_COMPRESSIONS: Final = frozenset({b"", b"zstd", b"lz4"})


def is_chunk(data: bytes, length: int) -> bool:
    """Whether a record holds a chunk, as far as its sizes tell, whatever it says of its kind.

    Args:
        data: The record's beginning, ``HEAD_BYTES`` of it where it has so many.
        length: Of the whole record.
    """
    try:
        head = chunk_head(data, length)
    except ValueError:
        return False
    return head.compression in _COMPRESSIONS and head.start_ns <= head.end_ns


def indexed_channel(data: bytes, length: int) -> int | None:
    """The channel of a message index record, by its beginning and length; None where its sizes do not fit."""
    if length < _INDEX_HEAD.size:
        return None
    channel_id, entries_bytes = _INDEX_HEAD.unpack_from(data)
    return int(channel_id) if _INDEX_HEAD.size + entries_bytes == length else None


def salvaged_length(read: Callable[[int, int], bytes], start: int, end: int) -> int | None:
    """The length of a chunk whose record says another kind or length: its own sizes, where its checksum is right.

    Args:
        read: Reads so many bytes from an offset of the file.
        start: Where the record begins.
        end: Where it has to end.

    Returns:
        Of the record's content; None where there is no such chunk.
    """
    at = start + RECORD_HEAD.size
    data = read(at, HEAD_BYTES)
    if len(data) < LEAST_CHUNK_BYTES:
        return None
    (name_bytes,) = _COUNT.unpack_from(data, CHUNK_HEAD.size)
    data_at = CHUNK_HEAD.size + _COUNT.size + name_bytes + _SIZE.size
    if name_bytes > _LONGEST_NAME or len(data) < data_at:
        return None
    length = data_at + _SIZE.unpack_from(data, data_at - _SIZE.size)[0]
    if length > MAX_CHUNK_BYTES or at + length > end or not is_chunk(data, length):
        return None
    head = chunk_head(data, length)
    try:
        chunk_content(head, read(at + head.data_at, head.data_bytes))
    except ValueError:
        return None
    return length if head.crc else None


def next_chunk(read: Callable[[int, int], bytes], start: int, end: int) -> int | None:
    """Offset of the next chunk record whose sizes are plausible; None where there is none.

    Args:
        read: Reads so many bytes from an offset of the file.
        start: From where on.
        end: Where it has to end.
    """
    for position in range(start, end, _WINDOW_BYTES):
        window = read(position, _WINDOW_BYTES + _CANDIDATE_BYTES)
        for found in _CHUNK.finditer(window):
            data = window[found.start() :][:_CANDIDATE_BYTES]
            if found.start() >= _WINDOW_BYTES or len(data) < RECORD_HEAD.size:
                break
            _, length = RECORD_HEAD.unpack_from(data)
            at = position + found.start()
            if at + RECORD_HEAD.size + length <= end and is_chunk(data[RECORD_HEAD.size :], length):
                return at
    return None


def goes_on(read: Callable[[int, int], bytes], start: int, end: int) -> bool:
    """Whether a record of a known kind fits there; arguments as of ``next_chunk``."""
    head = read(start, RECORD_HEAD.size)
    if len(head) < RECORD_HEAD.size:
        return False
    opcode, length = RECORD_HEAD.unpack(head)
    return opcode in OPCODES and start + RECORD_HEAD.size + length <= end


def stated_count(metadata: Metadata) -> tuple[int, int]:
    """Chunks and messages before a chunk.

    Raises:
        ValueError: It does not say them.
    """
    values = metadata.metadata
    return int(values.get("chunks", "")), int(values.get("messages", ""))


def _uncompressed(head: ChunkHead, data: bytes) -> bytes:
    if head.compression == b"":
        return data
    if head.compression == b"zstd":
        claimed = zstandard.get_frame_parameters(data).content_size
        if claimed not in {head.content_bytes, zstandard.CONTENTSIZE_UNKNOWN}:
            raise ValueError("claims two sizes")
        return zstandard.decompress(data, head.content_bytes)
    if head.compression == b"lz4":
        # One byte more than claimed: a frame that goes on is told from one that ends there.
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, head.content_bytes + 1))
    raise ValueError(f"compression {head.compression!r} is not known")


ATTACHMENT_HEAD_BYTES: Final = 1 << 16
"""All but an attachment's data, which may be of any size, is shorter."""
CRC_BYTES: Final = 4
MOST_ATTACHMENTS: Final = 10_000
"""Of a file: they are held by what they say of themselves."""


class AttachmentHead(NamedTuple):
    """The head of an attachment record.

    Attributes:
        about: Name and times, without the data.
        data_at: Where the data begins in the record's content.
        data_bytes: Of it.
    """

    about: Attachment
    data_at: int
    data_bytes: int


def attachment_head(data: bytes, length: int) -> AttachmentHead:
    """The head of an attachment record.

    Args:
        data: The content's beginning, ``ATTACHMENT_HEAD_BYTES`` of it where it has so many.
        length: Of the whole content.

    Raises:
        ValueError: It is damaged; others as the library has them.
    """
    stream = ReadDataStream(BytesIO(data))
    log_ns, create_ns = stream.read8(), stream.read8()
    name, kind = stream.read_prefixed_string(), stream.read_prefixed_string()
    data_bytes = stream.read8()
    if stream.count + data_bytes + CRC_BYTES != length:
        raise ValueError("claims another size than it has")
    about = Attachment(create_time=create_ns, log_time=log_ns, name=name, media_type=kind, data=b"")
    return AttachmentHead(about, stream.count, data_bytes)
