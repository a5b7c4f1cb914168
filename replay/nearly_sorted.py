"""One file's messages in order of log time, as far as what overlaps can be held."""

import heapq
from collections.abc import Iterator
from itertools import accumulate
from typing import Final

from aerodft.adapters.mcap.places import SegmentScan
from aerodft.adapters.mcap.reading import ChunkReader, ReadMessage, Wanted

_MOST_HELD_BYTES: Final = 48 << 20  # while a chunk is unpacked
_MOST_WAITING_BYTES: Final = 16 << 20  # while something is written
_MESSAGE_BYTES: Final = 300  # what a message takes in memory besides its payload


def nearly_sorted(segment: SegmentScan, wanted: Wanted | None = None) -> Iterator[ReadMessage]:
    """One segment's messages by log time, else as they were written; chunks that overlap are held together.

    Where these are too much to be held, what is earliest of it goes out: a file need not be in order.

    Args:
        segment: The file.
        wanted: Whose messages; None for everybody's.

    Raises:
        InputError: It cannot be read.
    """
    reader = ChunkReader(segment.channels.copy(), left_out=segment.left_out)
    starts = [chunk.start_ns for chunk in segment.chunks]
    later = [*list(accumulate(reversed(starts), min))[-2::-1], None]
    held = _Held()
    for chunk, limit_ns in zip(segment.chunks, later, strict=True):
        for message in reader.messages((chunk,), wanted):
            held.add(message)
            del message
            while held.bytes > _MOST_HELD_BYTES:
                yield held.pop()
        while held.is_due(limit_ns) or held.bytes > _MOST_WAITING_BYTES:
            yield held.pop()


class _Held:
    """Messages by log time, of the same time in the order in which they came."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, ReadMessage]] = []
        self._count = self.bytes = 0

    def is_due(self, limit_ns: int | None) -> bool:
        """Whether there is one from before the limit."""
        return bool(self._heap) and (limit_ns is None or self._heap[0][0] < limit_ns)

    def add(self, message: ReadMessage) -> None:
        heapq.heappush(self._heap, (message.log_ns, self._count, message))
        self._count += 1
        self.bytes += len(message.data) + _MESSAGE_BYTES

    def pop(self) -> ReadMessage:
        message = heapq.heappop(self._heap)[2]
        self.bytes -= len(message.data) + _MESSAGE_BYTES
        return message
