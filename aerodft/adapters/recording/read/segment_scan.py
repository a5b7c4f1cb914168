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
from mcap.records import ChunkIndex, Header, MessageIndex, Metadata

from aerodft.adapters.files import check_is_no_pipe
from aerodft.adapters.recording.channels import DEFINITIONS, RECORDING_KEY, STATION_KEY, Channels, definition
from aerodft.adapters.recording.layout import CHUNK_HEAD, INDEX_ENTRY_BYTES, MAGIC
from aerodft.adapters.recording.layout import RECORD_HEAD as HEAD
from aerodft.adapters.recording.read.chunks import (
    DAMAGED,
    HEAD_BYTES,
    OPCODES,
    FileSummary,
    chunk_head,
    goes_on,
    indexed_channel,
    is_chunk,
    next_chunk,
    read_summary,
    salvaged_length,
    stated_count,
)
from aerodft.adapters.recording.write import (
    CONFIG_NAME,
    COUNT_BYTES,
    COUNT_NAME,
    METADATA_NAME,
    PROFILE,
    RECOVERED_NAME,
    CopiedSegment,
    copied_segments,
)
from aerodft.errors import InputError, os_errors_as

_OWN_LIBRARY: Final = "aerodft"
_ABOUT_NAMES: Final = frozenset({METADATA_NAME, CONFIG_NAME, RECOVERED_NAME})
_MESSAGE_HEAD = struct.Struct("<HIQ")
_MAX_SMALL_RECORD = 4 << 20
_BARE_BYTES = 1 << 20  # messages without a chunk are read so many at a time
_MOST_CHUNKS = 150_000  # without an index; each takes 230 bytes: half a day of ours, 150 GB of others
_MAX_METADATA_BYTES = 1 << 20
_DATA_END_BYTES: Final = 4
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
class Gap:
    """A part of a recording that is proven to be lost.

    Attributes:
        from_ns: After this log time; None where nothing comes before it.
        to_ns: Before this log time; None where nothing comes after it.
        chunks: How many chunks that was; None where nobody knows.
        messages: How many messages that was; None where nobody knows.
    """

    from_ns: int | None
    to_ns: int | None
    chunks: int | None = None
    messages: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentScan:
    """Contents of a segment, found without decoding its messages.

    Attributes:
        path: The file.
        chunks: Its whole chunks, in order.
        station: From its metadata; None where it has none.
        is_whole: Whether it ends as it should.
        has_end: Whether its data is known to end where the file says so, whatever is behind.
        is_recovered: Whether it was made whole and says what it lost then.
        before: How many chunks and messages the segments before it hold, by its own count; None where it has none.
        after: How many chunks and messages the series holds before the next segment, by its own count; None where it
            says of no next one.
        messages: How many messages it holds, by its indexes; None where it has none.
        gaps: What it is proven to lack, between its chunks.
        texts: The configuration that it carries: files by name; empty where it carries none.
        channels: Those that are known before a chunk is read: all of them where ``is_indexed``; with the id of the
            recording that every chunk has to belong to.
        is_indexed: Whether the file's own index was used.
        surplus: How many chunks there are more than its own; None where nobody knows of any that was put in.
        damaged_offsets: Where damaged chunks begin that were met so far; readers share it.
        copied: The image segments that the recomputed recording holds copies of; empty in others.
        renumbered: Its number in the series where that is not the one in its name.
    """

    path: Path
    chunks: tuple[ChunkLocation, ...]
    station: str | None
    is_whole: bool
    has_end: bool = False
    is_recovered: bool = False
    before: tuple[int, int] | None = None
    after: tuple[int, int] | None = None
    messages: int | None = None
    gaps: tuple[Gap, ...] = ()
    channels: Channels = field(default_factory=Channels)
    is_indexed: bool = False
    texts: dict[str, str] = field(default_factory=dict)
    surplus: int | None = None
    damaged_offsets: set[int] = field(default_factory=set, compare=False, repr=False)
    copied: tuple[CopiedSegment, ...] = ()
    renumbered: int | None = None

    @property
    def number(self) -> int | None:
        """Its number in the series; None where its name has none."""
        digits = self.path.stem.rpartition("_")[2]
        return self.renumbered if self.renumbered is not None else int(digits) if digits.isdecimal() else None

    @property
    def recording(self) -> str | None:
        """Id of the recording that it belongs to; None where it says none."""
        return self.channels.recording

    @property
    def start_ns(self) -> int | None:
        """Earliest log time; None without a chunk."""
        return min((chunk.start_ns for chunk in self.chunks), default=None)

    @property
    def end_ns(self) -> int | None:
        """Latest log time; None without a chunk."""
        return max((chunk.end_ns for chunk in self.chunks), default=None)

    @property
    def damaged_chunks(self) -> int:
        """Damaged chunks that were met so far; what was put in between its own is no loss."""
        return max(len(self.damaged_offsets) - (self.surplus or 0), 0)

    def all_gaps(self) -> list[Gap]:
        """Gaps of the segment, those of damaged chunks that were met so far included."""
        if self.surplus == len(self.damaged_offsets):  # what was put in may have brought counts that show gaps
            return []
        met = []
        for number, chunk in enumerate(self.chunks if self.damaged_chunks else ()):
            if chunk.offset in self.damaged_offsets:
                before = self.chunks[number - 1].end_ns if number else None
                after = self.chunks[number + 1].start_ns if number + 1 < len(self.chunks) else None
                met.append(Gap(from_ns=before, to_ns=after, chunks=1))
        return sorted([*self.gaps, *met], key=lambda gap: gap.from_ns or 0)


def scan_segment(path: Path) -> SegmentScan:
    """Find the chunks of an MCAP file, as far as it is whole.

    Raises:
        InputError: The file cannot be read, or is no MCAP file.
    """
    with os_errors_as("the recording cannot be read", where=path):
        check_is_no_pipe(path)
        with path.open("rb") as file:
            magic = file.read(len(MAGIC))
            if len(magic) < len(MAGIC) and MAGIC.startswith(magic):  # the machine died as the file was made
                return SegmentScan(path=path, chunks=(), station=None, is_whole=False)
            if magic != MAGIC and any(magic):  # zeros: the power failed before its first bytes were on the disk
                raise InputError("the file is no MCAP recording", where=path, got=repr(magic), expected=repr(MAGIC))
            size = path.stat().st_size

            def read(offset: int, length: int) -> bytes:
                file.seek(offset)
                return file.read(length)

            return _indexed_segment(path, read, size) or _Scan(path, file, size).run()


def has_owned_chunks(header: Header) -> bool:
    """Whether each chunk of a file says which recording it belongs to: aerodft made it, and nobody wrote it again."""
    return header.profile == PROFILE and header.library.startswith(_OWN_LIBRARY)


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
        raise InputError("the recording cannot be read", where=place.path, got=error) from error
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


@dataclass(slots=True)
class _OpenGap:
    """A gap behind so many chunks, while their file is being read."""

    place: int
    chunks: int | None = None
    messages: int | None = None


class _Scan:
    """Hops from record to record; where the bytes make no sense it goes on at the next chunk that does."""

    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self._path = path
        self._file = file
        self._size = size
        self._places: list[ChunkLocation] = []
        self._ids: set[int] = set()  # of the last place
        self._sets = ChannelSets()
        self._damaged_offsets: set[int] = set()
        self._heads: set[bytes] = set()  # of the recording's own chunks
        self._skips_indexes = False  # whether no chunk that is read comes right before the next indexes
        self._copies = 0  # chunks that are there a second time
        self._has_end = False
        self._channels = Channels()
        self._about = _About()
        self._before: tuple[int, int] | None = None
        self._after: tuple[int, int] | None = None  # by a count that no chunk has followed yet
        self._messages = 0  # by indexes
        self._gaps: list[_OpenGap] = []
        self._counted_lost = (0, 0)  # chunks and messages that are in gaps
        self._stated_chunks: int | None = None

    def run(self) -> SegmentScan:
        """Scan the file from its start."""
        position, is_whole, is_torn = len(MAGIC), False, False
        while not is_torn and position + HEAD.size <= self._size:
            opcode, length = HEAD.unpack(self._read(position, HEAD.size))
            at = position + HEAD.size
            if self._is_full(opcode, at):
                break
            if at + length <= self._size and self._take(opcode, at, length):
                position = at + length
                if opcode == Opcode.DATA_END and length == _DATA_END_BYTES:
                    self._take_end(position)
                if opcode == Opcode.FOOTER:
                    is_whole = self._size - position == len(MAGIC)
                    break
            elif self._has_end:  # what is damaged tells of messages, and is none
                break
            else:
                position, is_torn = self._skip(position)
        self._settle()
        surplus = None
        if self._stated_chunks is not None:
            self._count_chunks(self._stated_chunks)
            more = len(self._places) - self._stated_chunks
            surplus = more if more > 0 or (more == 0 and self._copies) else None
        places = self._places
        if not all(place.is_bare for place in places) and any(place.is_bare for place in places):
            # No recorder mixes the two: what looks like a message between chunks is a damaged record.
            _log.warning("%s: messages outside its chunks are left out", self._path)
            places = [place for place in places if not place.is_bare]
        self._channels.recording = self._about.recording
        return SegmentScan(
            path=self._path,
            chunks=tuple(places),
            station=self._about.station,
            is_whole=is_whole,
            has_end=self._has_end,
            is_recovered=self._about.is_recovered,
            before=self._before,
            after=self._after if self._has_end else None,
            messages=self._messages,
            gaps=tuple(self._closed(gap) for gap in self._gaps if gap.chunks != 0),
            channels=self._channels,
            texts=self._about.texts,
            surplus=surplus,
            damaged_offsets=self._damaged_offsets,
            copied=self._about.copied,
        )

    def _skip(self, position: int) -> tuple[int, bool]:
        """Offset to go on at behind implausible bytes, and whether the file is torn there."""
        length = salvaged_length(self._read, position, self._size)
        if length is not None:
            self._add_chunk(position + HEAD.size, length)
            return position + HEAD.size + length, False
        following = next_chunk(self._read, position + 1, self._size)
        is_ended = self._read(self._size - len(MAGIC), len(MAGIC)) == MAGIC
        if following is not None or is_ended:
            self._gaps.append(_OpenGap(len(self._places)))
        if following is None:
            return position, True
        has_count = following - COUNT_BYTES > position and _count_before(following, self._read) is not None
        return following - COUNT_BYTES * has_count, False

    def _closed(self, gap: _OpenGap) -> Gap:
        before, after = self._places[: gap.place], self._places[gap.place :]
        return Gap(
            from_ns=max((place.end_ns for place in before), default=None),
            to_ns=min((place.start_ns for place in after), default=None),
            chunks=gap.chunks,
            messages=gap.messages,
        )

    def _read(self, offset: int, length: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(length)

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
        head = self._read(position, min(HEAD_BYTES, length))
        if opcode == Opcode.CHUNK or is_chunk(head, length):
            return self._take_chunk(position, length, head)
        self._file.seek(position)
        if opcode == Opcode.MESSAGE:
            return self._take_message(position, length)
        if opcode == Opcode.MESSAGE_INDEX:
            return self._take_index(length, head)
        if opcode == Opcode.METADATA and length > _MAX_SMALL_RECORD:
            return True  # nobody's configuration: what lies behind it is read
        if opcode in {*DEFINITIONS, Opcode.METADATA, Opcode.HEADER}:
            return length <= _MAX_SMALL_RECORD and self._take_small(opcode, self._file.read(length))
        return opcode in OPCODES or goes_on(self._read, position + length, self._size)

    def _take_chunk(self, position: int, length: int, head: bytes) -> bool:
        try:
            chunk_head(head, length)
        except ValueError:  # a chunk that cannot be read here is one only where records go on behind it
            if length < CHUNK_HEAD.size or not goes_on(self._read, position + length, self._size):
                return False
        self._add_chunk(position, length)
        return True

    def _add_chunk(self, position: int, length: int) -> None:
        head = self._read(position, CHUNK_HEAD.size)
        start_ns, end_ns, _, crc = CHUNK_HEAD.unpack(head)
        self._skips_indexes = head in self._heads
        if self._skips_indexes:
            self._after, self._copies = None, self._copies + 1
            _log.warning("%s: the chunk at byte %d is there twice; it is read once", self._path, position)
            return
        if crc and self._about.recording is not None:
            self._heads.add(head)
        self._add(position, length, start_ns, end_ns, is_bare=False)

    def _take_index(self, length: int, head: bytes) -> bool:
        channel_id = indexed_channel(head, length)
        if channel_id is None or self._skips_indexes:
            return channel_id is not None
        self._ids.add(channel_id)
        self._messages += length // INDEX_ENTRY_BYTES  # its head is shorter than an entry
        return True

    def _take_end(self, position: int) -> None:
        """Take note of the end of the data, and of how many chunks a sound summary behind it says there are."""
        self._has_end = True
        summary = read_summary(self._read, self._size, position)
        if summary is not None and summary.is_checked and summary.statistics is not None:
            self._stated_chunks = summary.statistics.chunk_count

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
        self._after = None
        self._places.append(
            ChunkLocation(
                path=self._path, offset=offset, length=length, start_ns=start_ns, end_ns=end_ns, is_bare=is_bare
            )
        )

    def _take_small(self, opcode: int, data: bytes) -> bool:
        try:
            if opcode in DEFINITIONS:
                self._channels.add(definition(opcode, data))
            elif opcode == Opcode.HEADER:
                self._about.take_header(Header.read(ReadDataStream(BytesIO(data))))
            else:
                metadata = Metadata.read(ReadDataStream(BytesIO(data)))
                if metadata.name == COUNT_NAME:
                    self._take_count(*stated_count(metadata))
                else:
                    self._about.take(metadata)
        except DAMAGED:
            return False
        return True

    def _take_count(self, chunks: int, messages: int) -> None:
        """See by the count before a chunk whether something that was before it is missing."""
        self._after, self._skips_indexes = (chunks, messages), True  # up to the next chunk
        if self._about.is_recovered:  # which said what is missing
            return
        if self._before is None:
            self._before = (chunks - len(self._places), messages - self._messages)
            return
        self._count_chunks(chunks - self._before[0], messages - self._before[1])
        if self._gaps and self._gaps[-1].chunks is None:
            self._gaps[-1].chunks = 0  # no chunk was in the bytes that make no sense

    def _count_chunks(self, chunks: int, messages: int | None = None) -> None:
        """Take note of chunks that are missing where the file is known to have had so many up to here."""
        missing = chunks - len(self._places) - self._counted_lost[0]
        if missing <= 0:
            return
        if not self._gaps or self._gaps[-1].chunks is not None:
            if messages is not None and messages <= self._messages + self._counted_lost[1]:
                return  # every chunk holds messages: the count is damaged
            self._gaps.append(_OpenGap(len(self._places)))
        gap = self._gaps[-1]
        gap.chunks = missing
        if messages is not None:
            gap.messages = messages - self._messages - self._counted_lost[1]
        self._counted_lost = (self._counted_lost[0] + missing, self._counted_lost[1] + (gap.messages or 0))


@dataclass(slots=True)
class _About:
    """Metadata of a segment on itself.

    Attributes:
        station: Name of the station; None where it says none.
        recording: Id of the recording, which its chunks then carry too; None of what another tool wrote again.
        is_recovered: Whether it was made whole.
        texts: Its configuration.
        copied: The image segments that its recording holds copies of.
    """

    station: str | None = None
    recording: str | None = None
    is_recovered: bool = False
    copied: tuple[CopiedSegment, ...] = ()
    texts: dict[str, str] = field(default_factory=dict)
    _is_own: bool = False

    def take_header(self, header: Header) -> None:
        """Learn who wrote the file."""
        self._is_own = has_owned_chunks(header)

    def take(self, metadata: Metadata) -> None:
        """Take one of its metadata records; of several, as in a merged file, the first says what it is."""
        if metadata.name == METADATA_NAME:
            self.station = self.station or metadata.metadata.get(STATION_KEY)
            if self._is_own:
                self.recording = metadata.metadata.get(RECORDING_KEY)
                self.copied = copied_segments(metadata.metadata)
        elif metadata.name == CONFIG_NAME:
            self.texts = self.texts or dict(metadata.metadata)
        elif metadata.name == RECOVERED_NAME:
            self.is_recovered = True


def _indexed_segment(path: Path, read: Callable[[int, int], bytes], size: int) -> SegmentScan | None:
    """Scan by the file's index; None where it has none, or one that is damaged or incomplete.

    Args:
        path: The file's name.
        read: Reads so many bytes from an offset of the file.
        size: Bytes of the file.

    Raises:
        OSError: It cannot be read.
    """
    summary = read_summary(read, size)
    if summary is None or summary.statistics is None or not _is_complete(summary):
        return None
    sets = ChannelSets()
    try:
        opcode, length = HEAD.unpack(read(len(MAGIC), HEAD.size))
        about = _About()
        if opcode == Opcode.HEADER and length <= _MAX_METADATA_BYTES:
            about.take_header(Header.read(ReadDataStream(BytesIO(read(len(MAGIC) + HEAD.size, length)))))
        for index in summary.metadata:
            if index.name in _ABOUT_NAMES and HEAD.size < index.length <= _MAX_METADATA_BYTES:
                content = read(index.offset + HEAD.size, index.length - HEAD.size)
                about.take(Metadata.read(ReadDataStream(BytesIO(content))))
        if about.recording is not None and not _has_room_for_counts_only(summary):
            return None  # the scan finds what lies between
        summary.channels.recording = about.recording
        return SegmentScan(
            path=path,
            chunks=tuple(_place(path, index, sets) for index in summary.chunks),
            station=about.station,
            is_whole=True,
            has_end=True,
            is_recovered=about.is_recovered,
            before=_count_before(summary.chunks[0].chunk_start_offset, read) if summary.chunks else None,
            after=_count_before(_end(summary.chunks[-1]) + COUNT_BYTES, read) if summary.chunks else None,
            messages=summary.statistics.message_count,
            channels=summary.channels,
            is_indexed=True,
            texts=about.texts,
            copied=about.copied,
        )
    except DAMAGED:
        return None


def _has_room_for_counts_only(summary: FileSummary) -> bool:
    """Whether nothing but a count can lie between the chunks that an index lists, in order."""
    ends = map(_end, summary.chunks)
    starts = [each.chunk_start_offset for each in summary.chunks[1:]]
    return all(start - end in {0, COUNT_BYTES} for end, start in zip(ends, starts, strict=False))


def _end(chunk: ChunkIndex) -> int:
    """Offset behind a chunk and its message indexes."""
    return chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length


def _count_before(offset: int, read: Callable[[int, int], bytes]) -> tuple[int, int] | None:
    """Counts stated before a chunk; None where there are none."""
    data = read(max(offset - COUNT_BYTES, 0), COUNT_BYTES)
    try:
        if HEAD.unpack_from(data) != (Opcode.METADATA, COUNT_BYTES - HEAD.size):
            return None
        found = Metadata.read(ReadDataStream(BytesIO(data[HEAD.size :])))
        return stated_count(found) if found.name == COUNT_NAME else None
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
