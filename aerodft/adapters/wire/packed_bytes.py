"""Many texts in one piece of memory, and the loop that puts numbers into the holes of one that they have in common."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerodft.jit import njit
from aerodft.model import ImageArray, IntArray

_ONE = np.uint64(1)


@dataclass(frozen=True, slots=True, eq=False)
class PackedBytes:
    """``n`` texts; memory may hold more than these.

    Attributes:
        data: All of them.
        start: ``(n,)`` where each begins.
        stop: ``(n,)`` where it ends.
    """

    data: bytes | memoryview
    start: IntArray
    stop: IntArray

    @staticmethod
    def of(texts: Sequence[bytes]) -> "PackedBytes":
        """Texts one behind the other."""
        stop = np.cumsum(np.fromiter(map(len, texts), dtype=np.int64, count=len(texts)))
        return PackedBytes(b"".join(texts), np.concatenate([[0], stop[:-1]])[: len(stop)], stop)

    @staticmethod
    def joined(parts: "Sequence[PackedBytes]", order: IntArray) -> "PackedBytes":
        """The texts of all parts, put into an order: ``(n,)`` numbers, counted part after part."""
        ahead = np.cumsum([0, *(len(part.data) for part in parts)])
        start = np.concatenate([part.start + by for part, by in zip(parts, ahead[:-1], strict=True)])
        stop = np.concatenate([part.stop + by for part, by in zip(parts, ahead[:-1], strict=True)])
        return PackedBytes(b"".join(part.data for part in parts), start[order], stop[order])

    def __len__(self) -> int:
        return len(self.start)

    def each(self) -> list[bytes]:
        """The texts."""
        return [self.text(row) for row in range(len(self))]

    def text(self, row: int) -> bytes:
        """One of the texts."""
        return bytes(self.data[self.start[row] : self.stop[row]])


@dataclass(frozen=True, slots=True, eq=False)
class JsonTemplate:
    """A text with holes: pieces, between every two of which something is put.

    Attributes:
        data: The pieces one behind the other.
        stop: ``(m,)`` where each ends.
        source: ``(m - 1,)`` which of the sources each hole is filled from.
    """

    data: ImageArray
    stop: IntArray
    source: IntArray

    @staticmethod
    def of(pieces: Sequence[bytes], source: Sequence[int]) -> "JsonTemplate":
        """A form of ``m`` pieces, and of each hole the number of its source."""
        texts = PackedBytes.of(pieces)
        return JsonTemplate(np.frombuffer(texts.data, dtype=np.uint8), texts.stop, np.array(source, dtype=np.int64))

    def filled(self, sources: Sequence[bytes], separators: bytes, count: int) -> PackedBytes:
        """``count`` texts, whose holes are filled one after the other.

        Args:
            sources: What goes into the holes, of each source its parts in their order.
            separators: What stands between the parts of each source.
            count: How many.
        """
        arrays = tuple(np.frombuffer(source, dtype=np.uint8) for source in sources)
        out = np.empty(count * len(self.data) + sum(map(len, arrays)), dtype=np.uint8)
        stop = np.empty(count, dtype=np.int64)
        _fill(self.data, self.stop, self.source, arrays, np.frombuffer(separators, dtype=np.uint8), out, stop)
        used = int(stop[-1]) if count else 0
        return PackedBytes(out[:used].data, np.concatenate([[0], stop[:-1]])[:count], stop)


@njit
def _fill(
    pieces: ImageArray,
    ends: IntArray,
    source_of: IntArray,
    sources: tuple[ImageArray, ...],
    separators: ImageArray,
    out: ImageArray,
    stop: IntArray,
) -> None:
    """Positions are unsigned: the compiler looks at signed ones for being counted from the end, byte by byte."""
    at = np.zeros(len(sources), dtype=np.uint64)
    position = np.uint64(0)
    for row in range(len(stop)):
        begin = np.uint64(0)
        for hole in range(len(ends)):
            end = np.uint64(ends[hole])
            while begin < end:
                out[position] = pieces[begin]
                begin += _ONE
                position += _ONE
            if hole < len(source_of):
                own = source_of[hole]
                position, at[own] = _put(sources[own], separators[own], at[own], out, position)
        stop[row] = position


@njit
def _put(
    source: ImageArray, separator: np.uint8, at: np.uint64, out: ImageArray, position: np.uint64
) -> tuple[np.uint64, np.uint64]:
    """Copy up to the next separator; gives back what is behind."""
    end = np.uint64(len(source))
    while at < end and source[at] != separator:
        out[position] = source[at]
        at += _ONE
        position += _ONE
    return position, at + _ONE
