"""The messages of a chunk as columns, for who reads nearly all of them: where each is, of which channel and when."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from aerodft.adapters.mcap.layout import MESSAGE_HEAD, RECORD_HEAD
from aerodft.adapters.mcap.places import ReadChannel
from aerodft.geometry.jit import expect, is_loaded, njit
from aerodft.model.arrays import BoolArray, ImageArray, IntArray

Times = npt.NDArray[np.uint64]

_HEAD: Final = RECORD_HEAD.size
_MESSAGE: Final = int(Opcode.MESSAGE)
_MESSAGE_HEAD: Final = MESSAGE_HEAD.size
_HEADS: Final = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_ns", "<u8"), ("publish_ns", "<u8")])
_CHANNELS: Final = 1 << 16  # their ids are of 16 bits
_USUAL_BYTES: Final = 64  # of a record, at least; of shorter ones the table is made once more
_FEW: Final = 8  # records that are told apart as fast without the compiler


@dataclass(frozen=True, slots=True, eq=False)
class ChunkTable:
    """Messages of one chunk, in the order in which they were written.

    Attributes:
        content: The chunk's records; may hold more than these messages.
        channels: By id, all that are known.
        channel: ``(n,)`` ids.
        log_ns: ``(n,)``.
        start: ``(n,)`` where the payloads begin in the content.
        stop: ``(n,)`` where they end.
    """

    content: bytes
    channels: dict[int, ReadChannel]
    channel: IntArray
    log_ns: Times
    start: IntArray
    stop: IntArray

    def rows(self, rows: BoolArray | IntArray) -> "ChunkTable":
        """Some of the messages."""
        return ChunkTable(
            self.content, self.channels, self.channel[rows], self.log_ns[rows], self.start[rows], self.stop[rows]
        )


@dataclass(frozen=True, slots=True, eq=False)
class RecordTable:
    """All records of a chunk, up to the first that is damaged.

    Attributes:
        opcode: ``(n,)``.
        start: ``(n,)`` where contents begin.
        stop: ``(n,)`` where they end.
        is_whole: Whether there is nothing behind them.
    """

    opcode: IntArray
    start: IntArray
    stop: IntArray
    is_whole: bool


def record_table(content: bytes) -> RecordTable:
    """The records of a chunk's content."""
    few = _few_records(content, _FEW if is_loaded() else len(content))
    if few is not None:
        expect(2 * len(few.opcode))
        return few
    data = np.frombuffer(content, dtype=np.uint8)
    table = np.empty((len(content) // _USUAL_BYTES, 3), dtype=np.int64)
    count, is_whole = _walk(data, table)
    if count > len(table):
        table = np.empty((count, 3), dtype=np.int64)
        _walk(data, table)
    opcode, start, stop = np.ascontiguousarray(table[:count].T)
    return RecordTable(opcode, start, stop, is_whole)


def message_table(content: bytes, channels: dict[int, ReadChannel], records: RecordTable) -> ChunkTable:
    """The messages among records, of channels that are known."""
    rows = np.flatnonzero(records.opcode == _MESSAGE)
    start = records.start[rows]
    size = max(len(content) - _MESSAGE_HEAD + 1, 0) if len(start) else 0
    heads = np.ndarray((size,), dtype=f"V{_MESSAGE_HEAD}", buffer=content, strides=(1,))[start].view(_HEADS)
    ids, times = heads["channel"].astype(np.int64), heads["log_ns"].astype(np.uint64)
    table = ChunkTable(content, channels, ids, times, start + _MESSAGE_HEAD, records.stop[rows])
    return table.rows(is_one_of(ids, channels))


def is_one_of(channel: IntArray, ids: Iterable[int]) -> BoolArray:
    """Which channels ``(n,)`` are among some: as numpy's own, which sorts them, in a tenth of its time."""
    wanted = np.zeros(_CHANNELS, dtype=np.bool_)
    wanted[list(ids)] = True
    return wanted[channel]


def _few_records(content: bytes, most: int) -> RecordTable | None:
    """As ``_walk``, for a few records; None where there are more."""
    rows: list[tuple[int, int, int]] = []
    position = 0
    while position + _HEAD <= len(content):
        if len(rows) == most:
            return None
        opcode, length = RECORD_HEAD.unpack_from(content, position)
        start = position + _HEAD
        if length > len(content) - start or (opcode == _MESSAGE and length < _MESSAGE_HEAD):
            break
        position = start + length
        rows.append((opcode, start, position))
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    is_whole = position == len(content)
    return RecordTable(table[:, 0], table[:, 1], table[:, 2], is_whole)


@njit
def _walk(content: ImageArray, table: IntArray) -> tuple[int, bool]:
    """How many records there are, and whether the content ends there; in ``table (n, 3)`` their opcodes and places."""
    position, count, end = np.int64(0), 0, len(content)
    while position + _HEAD <= end:
        opcode, length = np.int64(content[position]), np.uint64(0)
        for k in range(_HEAD - 1, 0, -1):
            length = (length << np.uint64(8)) | np.uint64(content[position + k])
        start = position + _HEAD
        if length > np.uint64(end - start) or (opcode == _MESSAGE and length < np.uint64(_MESSAGE_HEAD)):
            return count, False
        position = start + np.int64(length)
        if count < len(table):
            table[count, 0], table[count, 1], table[count, 2] = opcode, start, position
        count += 1
    return count, position == end
