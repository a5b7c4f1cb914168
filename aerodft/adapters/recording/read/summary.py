"""The summary at the end of an MCAP file: its definitions, its index and its counts, where it is sound."""

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, McapRecord, MetadataIndex, Schema, Statistics
from mcap.stream_reader import StreamReader

from aerodft.adapters.recording.channels import Channels
from aerodft.adapters.recording.layout import MAGIC, RECORD_HEAD

MAX_SUMMARY_BYTES: Final = 16 << 20
DAMAGED: Final = (McapError, struct.error, ValueError, OverflowError)
"""All that the library raises where a record is damaged."""

_FOOTER_BYTES = 20
_CHECKED_BYTES = RECORD_HEAD.size + 16  # of the footer: all before its checksum
_END_BYTES = RECORD_HEAD.size + _FOOTER_BYTES + len(MAGIC)


@dataclass(slots=True)
class FileSummary:
    """What a summary says.

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


def read_summary(read: Callable[[int, int], bytes], size: int) -> FileSummary | None:
    """The summary of an MCAP file; None where it has none at its end, a damaged one, or one that is too large.

    Args:
        read: Reads so many bytes from an offset of the file.
        size: Bytes of the file.

    Raises:
        OSError: The file cannot be read.
    """
    if size < len(MAGIC) + _END_BYTES:
        return None
    end = read(size - _END_BYTES, _END_BYTES)
    if not end.endswith(MAGIC) or RECORD_HEAD.unpack_from(end) != (Opcode.FOOTER, _FOOTER_BYTES):
        return None
    footer = Footer.read(ReadDataStream(BytesIO(end[RECORD_HEAD.size :])))
    length = size - _END_BYTES - footer.summary_start
    if not footer.summary_start or not 0 <= length <= MAX_SUMMARY_BYTES:
        return None
    data = read(footer.summary_start, length)
    if footer.summary_crc and zlib.crc32(end[:_CHECKED_BYTES], zlib.crc32(data)) != footer.summary_crc:
        return None
    found = FileSummary(footer.summary_start, is_checked=footer.summary_crc != 0)
    try:
        for record in StreamReader(BytesIO(data + end), skip_magic=True, emit_chunks=True).records:
            found.add(record)
    except DAMAGED:
        return None
    return found
