"""Which messages before damage in a .bin log are whole, told by the other messages of their part of the log."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Final

import numpy as np

from aerodft.adapters.telemetry.dataflash.framing import HEAD_SIZE, NEAR_US, TYPES
from aerodft.adapters.telemetry.log_file import Piece
from aerodft.model import BoolArray, ImageArray, IntArray

_WHOLE_ODDS: Final = 1 / 3  # before noise, of a whole message to one that is overwritten from some byte on
_FILL_BYTES: Final = 8  # as many equal ones behind a message are a fill, as of zeros
_SECTION_BYTES: Final = 1 << 19  # of a log: a message is judged by those of its own and of the sections beside it


@dataclass(frozen=True)
class FoundMessages:
    """Messages that were found one behind the other.

    Attributes:
        piece: The part of the log that they are in.
        rows: ``(3, n)`` as of ``scan_dataflash``, with at least one.
    """

    piece: Piece
    rows: IntArray

    @cached_property
    def is_sure(self) -> BoolArray:
        """``(n,)`` whether no damage follows a message."""
        is_sure: BoolArray = self.rows[1] > 0
        return is_sure

    @cached_property
    def layouts(self) -> IntArray:
        """``(n,)`` one number for each type and size."""
        layouts: IntArray = self.bytes_at(HEAD_SIZE - 1, 1)[:, 0] * np.int64(TYPES) + np.abs(self.rows[1])
        return layouts

    @cached_property
    def sure(self) -> dict[int, IntArray]:
        """The messages of each layout that no damage follows."""
        index = np.flatnonzero(self.is_sure)
        index = index[np.argsort(self.layouts[index], kind="stable")]
        layouts, starts = np.unique(self.layouts[index], return_index=True)
        return dict(zip(layouts.tolist(), np.split(index, starts[1:]), strict=True))

    @property
    def last_section(self) -> int:
        """The section of the log that the last message starts in."""
        return int(self.sections(slice(-1, None))[0])

    def sections(self, index: slice | IntArray) -> IntArray:
        """``(m,)`` the sections of the log that some messages start in."""
        sections: IntArray = (self.piece.first + self.rows[0, index]) // _SECTION_BYTES
        return sections

    def bytes_at(self, skip: int, size: int, index: slice | IntArray = slice(None)) -> ImageArray:
        """``(m, size)`` bytes that stand so many behind the start of some messages."""
        data = np.frombuffer(self.piece.raw, dtype=np.uint8)
        places = self.rows[0, index, None] + skip + np.arange(size)
        found: ImageArray = data[np.minimum(places, len(data) - 1)]
        return found

    def is_surrounded(self, last: "FoundMessages") -> bool:
        """Whether all that this is judged by was found, up to the last."""
        return bool(self.is_sure.all()) or last.last_section > self.last_section + 1

    def is_whole(self, surroundings: Iterable["FoundMessages"], before_us: int) -> BoolArray:
        """``(n,)`` whether no damage has reached a message, as far as bytes tell; its time where no other is like it.

        Args:
            surroundings: What was found in the same sections and in those beside them.
            before_us: The last time since boot before the first message.
        """
        is_whole, doubtful = self.is_sure.copy(), np.flatnonzero(~self.is_sure)
        timed = np.flatnonzero(self.rows[2] >= 0)
        is_whole[timed] |= np.abs(np.diff(self.rows[2, timed], prepend=before_us)) < NEAR_US
        places = np.stack([self.sections(doubtful), self.layouts[doubtful]])
        alike, number = np.unique(places, axis=1, return_inverse=True)
        for k, (section, layout) in enumerate(alike.T.tolist()):
            size, index = layout % TYPES, doubtful[number == k]
            sure = np.concatenate([each.sure_bytes(section, layout, size) for each in surroundings])
            if len(sure):
                doubted, after = self.bytes_at(0, size, index), self.bytes_at(size, _FILL_BYTES, index)
                is_whole[index] = _resemble(doubted, after, sure)
        return is_whole

    def sure_bytes(self, section: int, layout: int, size: int) -> ImageArray:
        """``(m, size)`` bytes of messages of a layout, in a section or beside it, that no damage follows."""
        index = self.sure.get(layout, np.empty(0, dtype=np.int64))
        return self.bytes_at(0, size, index[np.abs(self.sections(index) - section) <= 1])


def with_surroundings(batches: Iterable[FoundMessages]) -> Iterator[tuple[FoundMessages, Iterable[FoundMessages]]]:
    """Each batch, and all that have messages of the same sections of the log or of those beside them."""
    held: deque[FoundMessages] = deque()
    turn = 0
    for batch in chain(batches, (None,)):
        if batch is not None:
            held.append(batch)
        while turn < len(held) and (batch is None or held[turn].is_surrounded(batch)):
            yield held[turn], held
            while held[0].last_section < held[turn].last_section - 1:
                held.popleft()
                turn -= 1
            turn += 1


def _resemble(doubtful: ImageArray, after: ImageArray, sure: ImageArray) -> BoolArray:
    """Whether messages before damage are whole, rather than overwritten from some byte on, each as likely as another.

    Args:
        doubtful: ``(m, size)`` their bytes.
        after: ``(m, k)`` what follows each: noise, or a fill of equal bytes.
        sure: ``(n, size)`` the bytes of whole messages of the same type.

    Returns:
        ``(m,)``. By the frequencies of whole messages' values at each place, the last bytes, however many, are likelier
        than noise; before a fill, so many last bytes that are of the fill are likelier than a place of its beginning.
    """
    size, places = sure.shape[1], np.arange(sure.shape[1])
    counts = np.bincount((places * 256 + sure).ravel(), minlength=size * 256).reshape(-1, 256)
    new_values = np.count_nonzero(counts, axis=1, keepdims=True)  # of n, as 1 in 256 of noise's
    bits = np.log2(np.maximum(256 * counts / len(sure), new_values / (len(sure) + 1)))[places, doubtful]
    whole: BoolArray = np.cumsum(bits[:, ::-1], axis=1).min(axis=1) > -np.log2(_WHOLE_ODDS * size)
    is_fill = (after == after[:, :1]).all(axis=1)
    for value in np.unique(after[is_fill, 0]).tolist():
        filled = np.flatnonzero(is_fill & (after[:, 0] == value))
        ends = np.bincount(_end_bytes(sure, value), minlength=size + 1)
        end = _end_bytes(doubtful[filled], value)
        whole[filled] = (end == 0) | (ends[end] * size > len(sure))  # an even chance: logs are allocated ahead
    return whole


def _end_bytes(messages: ImageArray, value: int) -> IntArray:
    """``(n,)`` how many of the last bytes of messages ``(n, size)`` have a value."""
    others = messages[:, ::-1] != value
    ends: IntArray = np.where(others.any(axis=1), others.argmax(axis=1), messages.shape[1])
    return ends
