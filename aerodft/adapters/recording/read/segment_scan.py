"""Where the chunks of an MCAP segment are: by its index, or where that is missing by hopping from record to record.

Works on files without an index too: a recorder that was killed leaves whole chunks and a torn end.
"""

import logging
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, MessageIndex, Metadata

from aerodft.adapters.file_kind import check_is_no_pipe
from aerodft.adapters.recording.channels import DEFINITIONS, STATION_KEY, Channels, definition
from aerodft.adapters.recording.layout import MAGIC
from aerodft.adapters.recording.layout import RECORD_HEAD as HEAD
from aerodft.adapters.recording.read.summary import DAMAGED, FileSummary, read_summary
from aerodft.adapters.recording.write import CONFIG_NAME, METADATA_NAME
from aerodft.errors import InputError

_CHUNK_TIMES = struct.Struct("<QQ")
_CHANNEL_ID = struct.Struct("<H")
_MESSAGE_HEAD = struct.Struct("<HIQ")
_MAX_SMALL_RECORD = 4 << 20
_BARE_BYTES = 1 << 20  # messages without a chunk are read so many at a time
_MOST_CHUNKS = 150_000  # without an index; each takes 230 bytes: half a day of ours, 150 GB of others
_MAX_METADATA_BYTES = 1 << 20
_MOST_IDS: Final = 500_000  # of channels, in the sets that chunks have: these are megabytes in a claimed index

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class ChannelSets:
    """The sets of channels that chunks have: few that differ, each of which is kept once."""

    _known: dict[frozenset[int], frozenset[int]] = field(default_factory=dict)
    _ids: int = 0

    def of(self, ids: Iterable[int]) -> frozenset[int] | None:
        """The set of these ids; None, for what is not known, where there are none, or more than can be held."""
        found = frozenset(ids)
        if found not in self._known and self._ids + len(found) <= _MOST_IDS:
            self._known[found] = found
            self._ids += len(found)
        return self._known.get(found) or None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkLocation:
    """A whole chunk in a file, or some messages that stand in no chunk.

    Attributes:
        path: The file.
        offset: Where the content begins: of the chunk record, or of the first message record.
        length: Bytes of it.
        start_ns: Earliest log time in it.
        end_ns: Latest.
        channels: Ids of the channels that have messages in it; None where that is not known.
        is_bare: Whether these are messages without a chunk.
    """

    path: Path
    offset: int
    length: int
    start_ns: int
    end_ns: int
    channels: frozenset[int] | None = None
    is_bare: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentScan:
    """What a segment holds.

    Attributes:
        path: The file.
        chunks: Its whole chunks, in order.
        station: From its metadata; None where it has none.
        is_whole: Whether it ends as it should.
        texts: The configuration that it carries: files by name; empty where it carries none.
        channels: Those that are known before a chunk is read: all of them where ``is_indexed``.
        is_indexed: Whether the file's own index was used.
        damaged_offsets: Where damaged chunks begin that were met so far; readers share it.
    """

    path: Path
    chunks: tuple[ChunkLocation, ...]
    station: str | None
    is_whole: bool
    channels: Channels = field(default_factory=Channels)
    is_indexed: bool = False
    texts: dict[str, str] = field(default_factory=dict)
    damaged_offsets: set[int] = field(default_factory=set, compare=False, repr=False)


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


def log_times(place: ChunkLocation) -> dict[int, tuple[int, ...]] | None:
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
    except DAMAGED:
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
        self._places: list[ChunkLocation] = []
        self._ids: set[int] = set()  # of the last place
        self._sets = ChannelSets()
        self._damaged_offsets: set[int] = set()
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
            damaged_offsets=self._damaged_offsets,
        )

    def _is_full(self, opcode: int, position: int) -> bool:
        """Whether there are more chunks than can be held; what lies behind them is left out."""
        if opcode != Opcode.CHUNK or len(self._places) < _MOST_CHUNKS:
            return False
        self._damaged_offsets.add(position)
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
            ChunkLocation(
                path=self._path, offset=offset, length=length, start_ns=start_ns, end_ns=end_ns, is_bare=is_bare
            )
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
        except DAMAGED:
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

    def read(offset: int, length: int) -> bytes:
        file.seek(offset)
        return file.read(length)

    summary = read_summary(read, size)
    if summary is None or not _is_complete(summary):
        return None
    sets = ChannelSets()
    try:
        return SegmentScan(
            path=path,
            chunks=tuple(_place(path, index, sets) for index in summary.chunks),
            station=_metadata(summary, METADATA_NAME, read).get(STATION_KEY),
            is_whole=True,
            channels=summary.channels,
            is_indexed=True,
            texts=_metadata(summary, CONFIG_NAME, read),
        )
    except DAMAGED:
        return None


def _is_complete(summary: FileSummary) -> bool:
    """Whether the index lists every chunk once, inside the file, and every channel that has messages.

    The chunks are put into the order of the file.
    """
    statistics, chunks = summary.statistics, summary.chunks
    if statistics is None or statistics.chunk_count != len(chunks) or (statistics.message_count and not chunks):
        return False
    chunks.sort(key=lambda each: each.chunk_start_offset)
    ends = [each.chunk_start_offset + each.chunk_length for each in chunks]
    is_inside = all(
        len(MAGIC) <= each.chunk_start_offset and end <= summary.start and each.chunk_length > HEAD.size
        for each, end in zip(chunks, ends, strict=True)
    )
    is_apart = all(end <= after.chunk_start_offset for end, after in zip(ends, chunks[1:], strict=False))
    used = set(statistics.channel_message_counts).union(*(each.message_index_offsets for each in chunks))
    return is_inside and is_apart and used <= summary.channels.by_id.keys()


def _place(path: Path, index: ChunkIndex, sets: ChannelSets) -> ChunkLocation:
    return ChunkLocation(
        path=path,
        offset=index.chunk_start_offset + HEAD.size,
        length=index.chunk_length - HEAD.size,
        start_ns=index.message_start_time,
        end_ns=index.message_end_time,
        channels=sets.of(index.message_index_offsets),
    )


def _metadata(summary: FileSummary, name: str, read: Callable[[int, int], bytes]) -> dict[str, str]:
    """The metadata of this name; empty where there is none."""
    for index in summary.metadata:
        if index.name == name and HEAD.size < index.length <= _MAX_METADATA_BYTES:
            content = read(index.offset + HEAD.size, index.length - HEAD.size)
            found = Metadata.read(ReadDataStream(BytesIO(content)))
            return dict(found.metadata) if found.name == name else {}
    return {}
