"""Where the chunks of an MCAP segment are: by its index, or where that is missing by hopping from record to record.

Works on files without an index too: a recorder that was killed leaves whole chunks and a torn end.
"""

import logging
import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, MessageIndex, Metadata, MetadataIndex, Statistics

from aerodft.adapters.file_kind import check_is_no_pipe
from aerodft.adapters.recording.channels import DEFINITIONS, STATION_KEY, Channels, definition
from aerodft.adapters.recording.layout import MAGIC
from aerodft.adapters.recording.layout import RECORD_HEAD as HEAD
from aerodft.adapters.recording.read.chunk_index import ChannelSets, ChunkPlace, SegmentScan
from aerodft.adapters.recording.write import CONFIG_NAME, METADATA_NAME
from aerodft.errors import InputError

_CHUNK_TIMES = struct.Struct("<QQ")
_CHANNEL_ID = struct.Struct("<H")
_MESSAGE_HEAD = struct.Struct("<HIQ")
_MAX_SMALL_RECORD = 4 << 20
_BARE_BYTES = 1 << 20  # messages without a chunk are read so many at a time
_MOST_CHUNKS = 150_000  # without an index; each takes 230 bytes: half a day of ours, 150 GB of others
_DAMAGED = (McapError, struct.error, ValueError, OverflowError)

_FOOTER_BYTES = 20
_END_BYTES = HEAD.size + _FOOTER_BYTES + len(MAGIC)
_MAX_SUMMARY_BYTES = 16 << 20
_MAX_METADATA_BYTES = 1 << 20

_log = logging.getLogger(__name__)


def scan_segment(path: Path) -> SegmentScan:
    """Find the chunks of an MCAP file, as far as it is whole.

    Raises:
        InputError: The file cannot be read, or is no MCAP file.
    """
    try:
        check_is_no_pipe(path)
        with path.open("rb") as file:
            magic = file.read(len(MAGIC))
            if len(magic) < len(MAGIC) and MAGIC.startswith(magic):  # the machine died as the file was made
                return SegmentScan(path=path, chunks=(), station=None, is_whole=False)
            if magic != MAGIC:
                raise InputError("the file is no MCAP recording", where=path, got=repr(magic), expected=repr(MAGIC))
            size = path.stat().st_size
            found = _indexed_segment(path, file, size)
            if found is not None:
                return found
            file.seek(len(MAGIC))
            return _Scan(path, file, size).run()
    except OSError as error:
        raise InputError("the recording cannot be read", where=path, got=error.strerror) from error


def log_times(place: ChunkPlace) -> dict[int, tuple[int, ...]] | None:
    """Log times by channel id, from the message indexes behind a chunk; None where they are missing.

    Raises:
        InputError: The file cannot be read.
    """
    times: dict[int, tuple[int, ...]] = {}
    try:
        with place.path.open("rb") as file:
            file.seek(place.offset + place.length)
            for content in _message_indexes(file):
                index = MessageIndex.read(ReadDataStream(BytesIO(content)))
                times[index.channel_id] = tuple(at for at, _ in index.records)
    except OSError as error:
        raise InputError("the recording cannot be read", where=place.path, got=error.strerror) from error
    except _DAMAGED:
        return None
    return times or None


def _message_indexes(file: BinaryIO) -> Iterator[bytes]:
    """The contents of the message indexes that begin where the file stands."""
    while len(head := file.read(HEAD.size)) == HEAD.size:
        opcode, length = HEAD.unpack(head)
        if opcode != Opcode.MESSAGE_INDEX or length > _MAX_SMALL_RECORD:
            return
        yield file.read(length)


class _Scan:
    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self._path = path
        self._file = file
        self._size = size
        self._places: list[ChunkPlace] = []
        self._ids: set[int] = set()  # of the last place
        self._sets = ChannelSets()
        self._left_out: set[int] = set()
        self._channels = Channels()
        self._station: str | None = None
        self._texts: dict[str, str] = {}

    def run(self) -> SegmentScan:
        is_whole = False
        position = self._file.tell()
        while len(head := self._file.read(HEAD.size)) == HEAD.size:
            opcode, length = HEAD.unpack(head)
            position += HEAD.size
            if position + length > self._size or self._is_full(opcode, position):
                break
            if not self._take(opcode, position, length):
                break
            position += length
            if opcode == Opcode.FOOTER:
                is_whole = self._size - position == len(MAGIC)
                break
            self._file.seek(position)
        self._settle()
        places = self._places
        if not all(place.is_bare for place in places) and any(place.is_bare for place in places):
            # No recorder mixes the two: what looks like a message between chunks is a damaged record.
            _log.warning("%s: messages outside its chunks are left out", self._path)
            places = [place for place in places if not place.is_bare]
        return SegmentScan(
            path=self._path,
            chunks=tuple(places),
            station=self._station,
            is_whole=is_whole,
            channels=self._channels,
            texts=self._texts,
            left_out=self._left_out,
        )

    def _is_full(self, opcode: int, position: int) -> bool:
        """Whether there are more chunks than can be held; what lies behind them is left out."""
        if opcode != Opcode.CHUNK or len(self._places) < _MOST_CHUNKS:
            return False
        self._left_out.add(position)
        _log.warning("%s: more than %d chunks and no index; what follows them is left out", self._path, _MOST_CHUNKS)
        return True

    def _settle(self) -> None:
        """Say of the last place which channels it has."""
        if self._places:
            self._places[-1] = replace(self._places[-1], channels=self._sets.of(self._ids))
        self._ids = set()

    def _take(self, opcode: int, position: int, length: int) -> bool:
        """Look at one record; False where it is damaged."""
        if opcode == Opcode.CHUNK:
            return self._take_chunk(position, length)
        if opcode == Opcode.MESSAGE:
            return self._take_message(position, length)
        if opcode == Opcode.MESSAGE_INDEX:
            return self._take_index(length)
        if opcode == Opcode.METADATA and length > _MAX_SMALL_RECORD:
            return True  # nobody's configuration: what lies behind it is read
        if opcode in {*DEFINITIONS, Opcode.METADATA}:
            return length <= _MAX_SMALL_RECORD and self._take_small(opcode, self._file.read(length))
        return True

    def _take_chunk(self, position: int, length: int) -> bool:
        if length < _CHUNK_TIMES.size:
            return False
        start_ns, end_ns = _CHUNK_TIMES.unpack(self._file.read(_CHUNK_TIMES.size))
        self._add(position, length, start_ns, end_ns, is_bare=False)
        return True

    def _take_index(self, length: int) -> bool:
        if length < _CHANNEL_ID.size:
            return False
        self._ids.update(_CHANNEL_ID.unpack(self._file.read(_CHANNEL_ID.size)))
        return True

    def _take_message(self, position: int, length: int) -> bool:
        """Add a message that stands in no chunk to the ones right before it."""
        if length < _MESSAGE_HEAD.size:
            return False
        channel_id, _, log_ns = _MESSAGE_HEAD.unpack(self._file.read(_MESSAGE_HEAD.size))
        start = position - HEAD.size
        last = self._places[-1] if self._places else None
        if last is not None and last.is_bare and last.offset + last.length == start and last.length < _BARE_BYTES:
            start_ns, end_ns = min(last.start_ns, log_ns), max(last.end_ns, log_ns)
            grown = position + length - last.offset
            self._places[-1] = replace(last, length=grown, start_ns=start_ns, end_ns=end_ns)
        else:
            self._add(start, position + length - start, log_ns, log_ns, is_bare=True)
        self._ids.add(channel_id)
        return True

    def _add(self, offset: int, length: int, start_ns: int, end_ns: int, *, is_bare: bool) -> None:
        self._settle()
        self._places.append(
            ChunkPlace(path=self._path, offset=offset, length=length, start_ns=start_ns, end_ns=end_ns, is_bare=is_bare)
        )

    def _take_small(self, opcode: int, data: bytes) -> bool:
        try:
            if opcode in DEFINITIONS:
                self._channels.add(definition(opcode, data))
            else:
                metadata = Metadata.read(ReadDataStream(BytesIO(data)))
                if metadata.name == METADATA_NAME:
                    self._station = metadata.metadata.get(STATION_KEY)
                elif metadata.name == CONFIG_NAME:
                    self._texts = dict(metadata.metadata)
        except _DAMAGED:
            return False
        return True


def _indexed_segment(path: Path, file: BinaryIO, size: int) -> SegmentScan | None:
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
    except _DAMAGED:
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
        if opcode in DEFINITIONS:
            self._channels.add(definition(opcode, content))
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
