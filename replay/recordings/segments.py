"""Messages of MCAP files, read from the chunks that have them and no others: as written, or in order of log time."""

import heapq
import re
from collections.abc import Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Final

from aerodft.adapters.recording import MAGIC, Channel, ChannelMessage
from aerodft.adapters.recording.read import (
    ChannelFilter,
    ChunkLocation,
    ChunkReader,
    ChunkTable,
    SegmentScan,
)


def segment_order(path: Path) -> tuple[list[int], str]:
    """Sort key of split files: ``data_1000`` comes after ``data_999``."""
    return [int(digits) for digits in re.findall(r"\d+", path.stem)], path.name


def is_mcap(path: Path) -> bool:
    """Whether a path is an MCAP file, whatever its name, or a folder of them."""
    if path.is_dir():
        return next(path.glob("*.mcap"), None) is not None
    if not path.is_file():  # to open a pipe would wait for its writer
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def messages_of(
    segments: Sequence[SegmentScan],
    *,
    from_ns: int | None = None,
    to_ns: int | None = None,
    wanted: ChannelFilter | None = None,
) -> Iterator[ChannelMessage]:
    """Messages in the order of writing, file after file.

    Args:
        segments: The files.
        from_ns: Earliest log time; None for the start.
        to_ns: Log times stop before it; None for the end.
        wanted: Whose messages; None for everybody's.

    Raises:
        InputError: A file cannot be read.
    """
    for segment in segments:
        reader = ChunkReader(segment.channels.copy(), damaged_offsets=segment.damaged_offsets)
        # Not a loop over them, which would hold on to the last one: an image of megabytes.
        messages = reader.messages(_wanted_chunks(segment, from_ns, to_ns, wanted), wanted)
        yield from filter(lambda message: is_within(message, from_ns, to_ns), messages)


def is_within(message: ChannelMessage, from_ns: int | None, to_ns: int | None) -> bool:
    """Whether a log time is in ``[from_ns, to_ns)``; None for the start, and for the end."""
    return (from_ns is None or message.log_ns >= from_ns) and (to_ns is None or message.log_ns < to_ns)


def message_tables(segments: Sequence[SegmentScan], wanted: ChannelFilter) -> Iterator[ChunkTable]:
    """Messages as columns, chunk after chunk; arguments and errors as in ``messages_of``."""
    for segment in segments:
        reader = ChunkReader(segment.channels.copy(), damaged_offsets=segment.damaged_offsets)
        yield from map(ChunkTable.kept, reader.tables(_wanted_chunks(segment, None, None, wanted), wanted))


def _wanted_chunks(
    segment: SegmentScan, from_ns: int | None, to_ns: int | None, wanted: ChannelFilter | None
) -> Iterator[ChunkLocation]:
    """The chunks that may hold such messages, and those before them that may define their channels."""
    known = segment.channels.by_id
    known_channels = set(known)
    ids = {number for number, channel in known.items() if wanted is None or wanted(channel)}
    for place in segment.chunks:
        is_within = (from_ns is None or place.end_ns >= from_ns) and (to_ns is None or place.start_ns < to_ns)
        defines = place.channels is None or not place.channels <= known_channels
        if place.channels is not None:
            known_channels |= place.channels
        if defines and not segment.is_indexed:
            if to_ns is None or place.start_ns < to_ns:
                yield place
        elif is_within and (place.channels is None or not segment.is_indexed or not ids.isdisjoint(place.channels)):
            yield place


def channels_of(segment: SegmentScan) -> dict[int, Channel]:
    """All channels of a file: by its index, else read from the chunks that define them.

    Raises:
        InputError: The file cannot be read.
    """
    if segment.is_indexed:
        return segment.channels.by_id
    reader = ChunkReader(segment.channels.copy(), damaged_offsets=segment.damaged_offsets)
    known_channels = set(segment.channels.by_id)
    for place in segment.chunks:
        if place.channels is None or not place.channels <= known_channels:
            for _ in reader.messages((place,)):
                pass
            known_channels |= place.channels or set()
    return reader.channels.by_id


_MOST_HELD_BYTES: Final = 48 << 20  # while a chunk is unpacked
_MOST_WAITING_BYTES: Final = 16 << 20  # while something is written
_MESSAGE_BYTES: Final = 300  # what a message takes in memory besides its payload


def messages_by_time(segment: SegmentScan, wanted: ChannelFilter | None = None) -> Iterator[ChannelMessage]:
    """One segment's messages by log time, else as they were written; chunks that overlap are held together.

    Where these are too much to be held, what is earliest of it goes out: a file need not be in order.

    Args:
        segment: The file.
        wanted: Whose messages; None for everybody's.

    Raises:
        InputError: It cannot be read.
    """
    reader = ChunkReader(segment.channels.copy(), damaged_offsets=segment.damaged_offsets)
    starts = [chunk.start_ns for chunk in segment.chunks]
    later = [*list(accumulate(reversed(starts), min))[-2::-1], None]
    heap = _MessageHeap()
    for chunk, limit_ns in zip(segment.chunks, later, strict=True):
        for message in reader.messages((chunk,), wanted):
            heap.add(message)
            del message
            while heap.bytes > _MOST_HELD_BYTES:
                yield heap.pop()
        while heap.is_due(limit_ns) or heap.bytes > _MOST_WAITING_BYTES:
            yield heap.pop()


class _MessageHeap:
    """Messages by log time, of the same time in the order in which they came."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, ChannelMessage]] = []
        self._count = self.bytes = 0

    def is_due(self, limit_ns: int | None) -> bool:
        """Whether there is one from before the limit."""
        return bool(self._heap) and (limit_ns is None or self._heap[0][0] < limit_ns)

    def add(self, message: ChannelMessage) -> None:
        heapq.heappush(self._heap, (message.log_ns, self._count, message))
        self._count += 1
        self.bytes += len(message.data) + _MESSAGE_BYTES

    def pop(self) -> ChannelMessage:
        message = heapq.heappop(self._heap)[2]
        self.bytes -= len(message.data) + _MESSAGE_BYTES
        return message
