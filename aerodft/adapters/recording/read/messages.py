"""Messages out of a segment's chunks, in the order in which they were written: as columns, or one by one."""

import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Final

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from aerodft.adapters.recording.channels import (
    DEFINITIONS,
    RECORDING_KEY,
    Channel,
    ChannelMessage,
    Channels,
    ForeignChunkError,
    TooMuchDefinedError,
    definition,
)
from aerodft.adapters.recording.layout import MESSAGE_HEAD, NO_OPCODE, RECORD_HEAD
from aerodft.adapters.recording.read.chunks import DAMAGED, HEAD_BYTES, MAX_CHUNK_BYTES, chunk_content, chunk_head
from aerodft.adapters.recording.read.segment_scan import ChunkLocation, SegmentScan
from aerodft.errors import InputError, os_errors_as
from aerodft.jit import njit
from aerodft.model import Batch, BoolArray, ImageArray, IntArray

Times = npt.NDArray[np.uint64]
ChannelFilter = Callable[[Channel], bool]

_HEAD: Final = RECORD_HEAD.size
_MESSAGE: Final = int(Opcode.MESSAGE)
_MESSAGE_HEAD: Final = MESSAGE_HEAD.size
_HEADS: Final = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_ns", "<u8"), ("publish_ns", "<u8")])
_CHANNELS: Final = 1 << 16  # their ids are of 16 bits
_USUAL_BYTES: Final = 64  # of a record, at least; of shorter ones there are several tables
_LEAST, _MOST = 8, 1 << 16  # records of a table: some kilobytes of zeros unpack to millions of empty ones
_MOST_KEPT_BYTES: Final = 4 << 20  # of a content, whatever of it is wanted
_LEAST_KEPT: Final = 0.5  # of a larger one
_MOST_NAMED: Final = 10  # damaged chunks of a file; one that was cut while it is read has thousands
_MOST_DAMAGED: Final = 100_000
_LOOKED_AT: Final = 3  # chunks: one of them is whole

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class ChunkTable(Batch):
    """Messages of one chunk, in the order of writing.

    Attributes:
        content: The chunk's records; may hold more than these messages.
        channels: By id, all that are known.
        channel: ``(n,)`` ids.
        sequence: ``(n,)``.
        log_ns: ``(n,)``.
        start: ``(n,)`` where the payloads begin in the content.
        stop: ``(n,)`` where they end.
    """

    content: bytes
    channels: dict[int, Channel]
    channel: IntArray
    sequence: IntArray
    log_ns: Times
    start: IntArray
    stop: IntArray

    def messages(self) -> Iterator[ChannelMessage]:
        """The messages one by one."""
        columns = (self.log_ns, self.channel, self.start, self.stop, self.sequence)
        for log_ns, channel, start, stop, sequence in zip(*(column.tolist() for column in columns), strict=True):
            yield ChannelMessage(log_ns, self.channels[channel], self.content[start:stop], sequence)

    def kept(self) -> "ChunkTable":
        """The messages without the rest of a large content, which a few of them would keep in memory."""
        length = self.stop - self.start
        if len(self.content) <= _MOST_KEPT_BYTES or length.sum() > _LEAST_KEPT * len(self.content):
            return self
        content = b"".join(
            [self.content[start:stop] for start, stop in zip(self.start.tolist(), self.stop.tolist(), strict=True)]
        )
        stop = np.cumsum(length)
        return replace(self, content=content, start=stop - length, stop=stop)


@dataclass(frozen=True, slots=True, eq=False)
class ChunkRecords:
    """Records of a chunk, one after the other.

    Attributes:
        opcode: ``(n,)``.
        start: ``(n,)`` where contents begin.
        stop: ``(n,)`` where they end.
        rest: Where others begin; None where there are none, or the next is damaged.
        is_damaged: Whether the next one is.
    """

    opcode: IntArray
    start: IntArray
    stop: IntArray
    rest: int | None
    is_damaged: bool


@dataclass(slots=True)
class ChunkReader:
    """Reads the chunks of one file; knows the channels of those that it has read.

    Attributes:
        channels: Known so far.
        damaged: Chunks that were left out.
        damaged_offsets: Where those begin, each named once; may be shared with who reads the same file again.
    """

    channels: Channels = field(default_factory=Channels)
    damaged: int = 0
    damaged_offsets: set[int] = field(default_factory=set)

    def messages(
        self, chunks: Iterable[ChunkLocation], wanted: ChannelFilter | None = None
    ) -> Iterator[ChannelMessage]:
        """The messages of chunks of one file; arguments and errors are those of ``tables``."""
        return chain.from_iterable(map(ChunkTable.messages, self.tables(chunks, wanted)))

    def tables(self, chunks: Iterable[ChunkLocation], wanted: ChannelFilter | None = None) -> Iterator[ChunkTable]:
        """The messages of chunks of one file as columns; a damaged chunk is left out, counted and logged.

        Args:
            chunks: In order; a chunk may define the channels of those behind it.
            wanted: Whose messages; None for everybody's.

        Raises:
            InputError: The file cannot be read.
        """
        for place in chunks:
            self.channels.begin_chunk()
            try:
                yield from self._tables(place, wanted)
            except DAMAGED as error:
                self._leave_out(place, error)

    def _tables(self, place: ChunkLocation, wanted: ChannelFilter | None) -> Iterator[ChunkTable]:
        """Tables of one chunk; its content goes with the generator, before the next chunk is unpacked."""
        content, is_defined = _content(place), True
        for records in record_tables(content):
            for row in np.flatnonzero(np.isin(records.opcode, DEFINITIONS)).tolist():
                data = content[records.start[row] : records.stop[row]]
                self.channels.add(definition(int(records.opcode[row]), data))
            self.channels.check_owner()
            table, all_defined = message_table(content, self.channels.by_id, records, wanted)
            is_defined &= all_defined
            yield table
            del table
            if records.is_damaged:
                raise ValueError("ends within a record, or in none")
        if not is_defined:
            raise ValueError("what some of its messages are is defined nowhere")

    def _leave_out(self, place: ChunkLocation, why: Exception) -> None:
        self.damaged += 1
        if isinstance(why, (TooMuchDefinedError, ForeignChunkError)):  # what others define must have room
            self.channels.undo_chunk()
        if place.offset in self.damaged_offsets or len(self.damaged_offsets) == _MOST_DAMAGED:
            return
        self.damaged_offsets.add(place.offset)
        if len(self.damaged_offsets) > _MOST_NAMED:
            return
        more = "; further ones are left out and not named" if len(self.damaged_offsets) == _MOST_NAMED else ""
        _log.warning("%s: damaged chunk at byte %d left out: %s%s", place.path, place.offset, why, more)


def recording_of(scan: SegmentScan) -> str | None:
    """Id of the recording that a segment belongs to: by its metadata, else by its chunks; None where none says it.

    Raises:
        InputError: The file cannot be read.
    """
    if scan.recording is not None:
        return scan.recording
    reader = ChunkReader(scan.channels.copy(), damaged_offsets={chunk.offset for chunk in scan.chunks})
    for place in (None, *scan.chunks[:_LOOKED_AT]):
        if place is not None:
            for _ in reader.tables((place,)):
                pass
        for channel in reader.channels.by_id.values():
            if RECORDING_KEY in dict(channel.metadata):
                return dict(channel.metadata)[RECORDING_KEY]
    return None


def content_bytes(place: ChunkLocation) -> int:
    """Stated length of a chunk's uncompressed content; 0 where it cannot be read.

    Raises:
        InputError: The file cannot be read.
    """
    if place.is_bare:
        return place.length
    try:
        with place.path.open("rb") as file:
            file.seek(place.offset)
            return chunk_head(file.read(min(HEAD_BYTES, place.length)), place.length).content_bytes
    except OSError as error:
        raise InputError("the recording cannot be read", where=place.path, got=error) from error
    except ValueError:
        return 0


def _content(place: ChunkLocation) -> bytes:
    """A chunk's records, uncompressed and checked.

    Raises:
        InputError: The file cannot be read.
        ValueError: The chunk is damaged.
    """
    with os_errors_as("the recording cannot be read", where=place.path), place.path.open("rb") as file:
        file.seek(place.offset)
        if place.is_bare:
            if place.length > MAX_CHUNK_BYTES:
                raise ValueError(f"claims {place.length} bytes")
            return file.read(place.length)
        head = chunk_head(file.read(min(HEAD_BYTES, place.length)), place.length)
        file.seek(place.offset + head.data_at)
        data = file.read(head.data_bytes)
    return chunk_content(head, data)


def record_tables(content: bytes) -> Iterator[ChunkRecords]:
    """The records of a chunk's content up to the first that is damaged, thousands at a time."""
    position: int | None = 0
    while position is not None:
        table = _record_table(content, position)
        yield table
        position = table.rest


def records_in(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of each record of a chunk's content.

    Raises:
        ValueError: A record ends outside of it, or is none.
    """
    for table in record_tables(content):
        yield from zip(table.opcode.tolist(), table.start.tolist(), table.stop.tolist(), strict=True)
        if table.is_damaged:
            raise ValueError("ends within a record, or in none")


def _record_table(content: bytes, position: int) -> ChunkRecords:
    data = np.frombuffer(content, dtype=np.uint8)
    table = np.empty((min(max(len(content) // _USUAL_BYTES, _LEAST), _MOST), 3), dtype=np.int64)
    count, position = _walk(data, table, position)
    opcode, start, stop = np.ascontiguousarray(table[:count].T)
    is_at_end = position == len(content)
    is_full = count == len(table) and not is_at_end
    return ChunkRecords(opcode, start, stop, position if is_full else None, not is_full and not is_at_end)


def message_table(
    content: bytes, channels: dict[int, Channel], records: ChunkRecords, wanted: ChannelFilter | None = None
) -> tuple[ChunkTable, bool]:
    """The messages among records that are known and, where somebody says so, wanted; whether all channels are known."""
    rows = np.flatnonzero(records.opcode == _MESSAGE)
    start = records.start[rows]
    size = max(len(content) - _MESSAGE_HEAD + 1, 0) if len(start) else 0
    heads = np.ndarray((size,), dtype=f"V{_MESSAGE_HEAD}", buffer=content, strides=(1,))[start].view(_HEADS)
    ids, sequence = heads["channel"].astype(np.int64), heads["sequence"].astype(np.int64)
    times = heads["log_ns"].astype(np.uint64)
    table = ChunkTable(content, channels, ids, sequence, times, start + _MESSAGE_HEAD, records.stop[rows])
    used = np.zeros(_CHANNELS, dtype=np.bool_)
    used[ids] = True
    used_ids = np.flatnonzero(used).tolist()
    known = [number for number in used_ids if number in channels]
    is_wanted = is_one_of(ids, [each for each in known if wanted is None or wanted(channels[each])])
    return table.rows(is_wanted), len(known) == len(used_ids)


def is_one_of(channel: IntArray, ids: Iterable[int]) -> BoolArray:
    """Which channels ``(n,)`` are among some: as numpy's own, which sorts them, in a tenth of its time."""
    wanted = np.zeros(_CHANNELS, dtype=np.bool_)
    wanted[list(ids)] = True
    return wanted[channel]


@njit
def _walk(content: ImageArray, table: IntArray, first: int) -> tuple[int, int]:
    """Number of records, ``n`` at most, and offset of the rest; ``table (n, 3)`` gets opcodes and places."""
    position, count, end = np.int64(first), 0, len(content)
    while position + _HEAD <= end and count < len(table):
        opcode, length = np.int64(content[position]), np.uint64(0)
        for k in range(_HEAD - 1, 0, -1):
            length = (length << np.uint64(8)) | np.uint64(content[position + k])
        start = position + _HEAD
        is_message = opcode == _MESSAGE
        if opcode == NO_OPCODE or length > np.uint64(end - start) or (is_message and length < np.uint64(_MESSAGE_HEAD)):
            break
        position = start + np.int64(length)
        table[count, 0], table[count, 1], table[count, 2] = opcode, start, position
        count += 1
    return count, int(position)
