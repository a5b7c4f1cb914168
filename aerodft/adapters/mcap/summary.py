"""The index at the end of a finished MCAP file: its channels and chunks, without a look at what lies before it."""

import struct
import zlib
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Metadata, MetadataIndex, Schema, Statistics

from aerodft.adapters.mcap.channels import STATION_KEY
from aerodft.adapters.mcap.layout import MAGIC
from aerodft.adapters.mcap.layout import RECORD_HEAD as HEAD
from aerodft.adapters.mcap.places import Channels, ChannelSets, ChunkPlace, SegmentScan
from aerodft.adapters.mcap.segment import CONFIG_NAME, METADATA_NAME

_FOOTER_BYTES = 20
_END_BYTES = HEAD.size + _FOOTER_BYTES + len(MAGIC)
_MAX_SUMMARY_BYTES = 16 << 20
_MAX_METADATA_BYTES = 1 << 20
_UNREADABLE = (McapError, struct.error, UnicodeDecodeError, OverflowError, ValueError)


def indexed_segment(path: Path, file: BinaryIO, size: int) -> SegmentScan | None:
    """What the file's index says; None where it has none, or one that is damaged or does not cover all messages.

    Args:
        path: The file's name.
        file: The file, open.
        size: Bytes of it.

    Raises:
        OSError: It cannot be read.
    """
    try:
        return _Summary(path, file, size).scan()
    except _UNREADABLE:
        return None


class _Summary:
    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self._path = path
        self._file = file
        self._size = size
        self._channels = Channels()
        self._places: list[ChunkPlace] = []
        self._used: set[int] = set()
        self._metadata: list[MetadataIndex] = []
        self._statistics: Statistics | None = None
        self._sets = ChannelSets()

    def scan(self) -> SegmentScan | None:
        start = self._read_records()
        if start is None or not self._is_complete(start):
            return None
        return SegmentScan(
            path=self._path,
            chunks=tuple(self._places),
            station=self._values(METADATA_NAME).get(STATION_KEY),
            is_whole=True,
            channels=self._channels,
            is_indexed=True,
            texts=self._values(CONFIG_NAME),
        )

    def _read_records(self) -> int | None:
        """Read the section; returns where it begins, None where there is none."""
        if self._size < len(MAGIC) + _END_BYTES:
            return None
        self._file.seek(self._size - _END_BYTES)
        end = self._file.read(_END_BYTES)
        if not end.endswith(MAGIC) or HEAD.unpack_from(end) != (Opcode.FOOTER, _FOOTER_BYTES):
            return None
        footer = Footer.read(ReadDataStream(BytesIO(end[HEAD.size :])))
        length = self._size - _END_BYTES - footer.summary_start
        if not footer.summary_start or not 0 <= length <= _MAX_SUMMARY_BYTES:
            return None
        self._file.seek(footer.summary_start)
        data = self._file.read(length)
        # The checksum is of the summary and of the footer up to the checksum.
        if footer.summary_crc and zlib.crc32(end[: HEAD.size + 16], zlib.crc32(data)) != footer.summary_crc:
            return None
        position = 0
        while position + HEAD.size <= length:
            opcode, size = HEAD.unpack_from(data, position)
            position += HEAD.size
            if position + size > length:
                return None
            self._take(opcode, data[position : position + size])
            position += size
        return int(footer.summary_start)

    def _take(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            self._channels.add_schema(Schema.read(stream))
        elif opcode == Opcode.CHANNEL:
            self._channels.add(Channel.read(stream))
        elif opcode == Opcode.CHUNK_INDEX:
            self._places.append(self._place(ChunkIndex.read(stream)))  # smaller than the record
        elif opcode == Opcode.STATISTICS:
            self._statistics = Statistics.read(stream)
        elif opcode == Opcode.METADATA_INDEX:
            self._metadata.append(MetadataIndex.read(stream))

    def _is_complete(self, start: int) -> bool:
        """Whether the index lists every chunk once, inside the file, and every channel that has messages."""
        statistics = self._statistics
        if statistics is None or statistics.chunk_count != len(self._places):
            return False
        if not self._places and statistics.message_count:
            return False
        self._places.sort(key=lambda each: each.offset)
        least = len(MAGIC) + HEAD.size
        inside = all(
            least <= each.offset and each.offset + each.length <= start and each.length > 0 for each in self._places
        )
        apart = all(one.offset + one.length + HEAD.size <= other.offset for one, other in pairwise(self._places))
        used = self._used.union(statistics.channel_message_counts)
        return inside and apart and used <= self._channels.by_id.keys()

    def _place(self, index: ChunkIndex) -> ChunkPlace:
        self._used.update(index.message_index_offsets)
        return ChunkPlace(
            path=self._path,
            offset=index.chunk_start_offset + HEAD.size,
            length=index.chunk_length - HEAD.size,
            start_ns=index.message_start_time,
            end_ns=index.message_end_time,
            channels=self._sets.of(index.message_index_offsets),
        )

    def _values(self, name: str) -> dict[str, str]:
        """The metadata of this name; empty where there is none."""
        for index in self._metadata:
            if index.name == name and HEAD.size < index.length <= _MAX_METADATA_BYTES:
                self._file.seek(index.offset + HEAD.size)
                content = self._file.read(index.length - HEAD.size)
                found = Metadata.read(ReadDataStream(BytesIO(content)))
                return dict(found.metadata) if found.name == name else {}
        return {}
