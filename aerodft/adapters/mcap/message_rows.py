"""Messages to be written, as columns; and the loop that lays many of them into a chunk."""

from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode

from aerodft.adapters.mcap.channels import Channel, raw_channel
from aerodft.adapters.mcap.layout import MESSAGE_HEAD, RECORD_HEAD, ChunkBuffer
from aerodft.adapters.texts import Form, Texts
from aerodft.geometry.jit import njit
from aerodft.model.arrays import ImageArray, IntArray
from aerodft.model.telemetry import WireProtocol

_RECORD_HEAD, _MESSAGE_HEAD = RECORD_HEAD.size, MESSAGE_HEAD.size
_OPCODE = int(Opcode.MESSAGE)


@dataclass(frozen=True, slots=True, eq=False)
class MessageRows:
    """``n`` messages in the order in which they are written.

    Attributes:
        channels: Theirs.
        channel: ``(n,)`` which of these.
        log_ns: ``(n,)``.
        sequence: ``(n,)``.
        texts: ``(n,)`` payloads.
    """

    channels: tuple[Channel, ...]
    channel: IntArray
    log_ns: IntArray
    sequence: IntArray
    texts: Texts

    def __len__(self) -> int:
        return len(self.channel)

    @property
    def sizes(self) -> IntArray:
        """``(n,)`` bytes of the payloads."""
        return self.texts.stop - self.texts.start

    def message(self, row: int) -> tuple[Channel, int, bytes, int]:
        """One of them: channel, log time, payload, sequence."""
        return self.channels[self.channel[row]], int(self.log_ns[row]), self.texts.text(row), int(self.sequence[row])

    def lay(self, first: int, stop: int, ids: IntArray, buffer: ChunkBuffer) -> None:
        """Add some of them to a chunk, by the channels' ids ``(channels,)``."""
        rows = slice(first, stop)
        sizes, channel_ids, log_ns = self.sizes[rows], ids[self.channel[rows]], self.log_ns[rows]
        begin = buffer.content_bytes
        out = buffer.more(int(sizes.sum()) + (_RECORD_HEAD + _MESSAGE_HEAD) * len(sizes))
        offset = np.empty(len(sizes), dtype=np.int64)
        heads = np.stack([channel_ids, self.sequence[rows], log_ns, self.texts.start[rows], sizes])
        _lay(np.frombuffer(self.texts.data, dtype=np.uint8), heads, np.frombuffer(out, dtype=np.uint8), offset)
        buffer.add_rows(channel_ids, log_ns, begin + offset)


def warm_up() -> None:
    """Compile now what would hold up the first messages of something live."""
    made = Form.of([b"[", b",", b"]"]).filled(b"[1]", b"[2]", 1, 1)
    one = np.ones(1, dtype=np.int64)
    for texts in (made, Texts(bytes(made.data), made.start, made.stop)):  # as they are made, and as they came
        MessageRows((raw_channel(WireProtocol.MAVLINK, ""),), one - 1, one, one, texts).lay(0, 1, one, ChunkBuffer())


@njit
def _lay(data: ImageArray, heads: IntArray, out: ImageArray, offset: IntArray) -> None:
    """Write message records; ``heads (5, n)`` are channel ids, sequences, log times, payloads' beginnings and sizes."""
    position = 0
    for row in range(len(offset)):
        offset[row] = position
        channel, sequence, log_ns = heads[0, row], heads[1, row], heads[2, row]
        start, size = heads[3, row], heads[4, row]
        out[position] = _OPCODE
        _put(out, position + 1, 8, size + _MESSAGE_HEAD)
        at = position + _RECORD_HEAD
        _put(out, at, 2, channel)
        _put(out, at + 2, 4, sequence)
        _put(out, at + 6, 8, log_ns)
        _put(out, at + 14, 8, log_ns)
        at += _MESSAGE_HEAD
        payload, text = out[at : at + size], data[start : start + size]
        for k in range(size):  # in a tenth of the time that one part takes for the other
            payload[k] = text[k]
        position = at + size


@njit
def _put(out: ImageArray, at: int, size: int, value: int) -> None:
    """A whole number, the lowest byte first."""
    for k in range(size):
        out[at + k] = (value >> (8 * k)) & 0xFF
