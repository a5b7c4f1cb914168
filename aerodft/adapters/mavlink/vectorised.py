"""The checks of ``kernels`` over whole arrays, for machines on which nothing can be compiled: the same answers."""

from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.adapters.mavlink.dialect import frame_table
from aerodft.adapters.mavlink.layout import (
    MIN_FRAME,
    SIGNATURE,
    SIGNED,
    TABLE_IDS,
    V1,
    V1_HEAD,
    V2,
    V2_HEAD,
    Bytes,
    Table,
    crc_tables,
)
from aerodft.model.arrays import BoolArray, IntArray

Words = npt.NDArray[np.uint16]

_WIDTHS: Final = (288, 128, 64, 48, 40, 32, 24)  # of copies; the first one holds the longest frame
_TOGETHER: Final = 64  # bytes that have tables of their own: 4 MB of them
_FRONT: Final = _WIDTHS[0]
_BACK: Final = V2_HEAD
_CRC: Final = crc_tables()
_COLUMNS: Final = np.arange(_FRONT, dtype=np.int16)  # compared with many at once: small ones are fast


def _after_zero(crc: Words) -> Words:
    """What a zero byte makes of checksums."""
    shifted: Words = (crc >> 8) ^ _CRC[0][crc & 0xFF]
    return shifted


@cache
def _pair_tables() -> list[Words]:
    """``(65536,)`` each: the checksum of two bytes, low one first, with 0, 2, 4, ... zero bytes after them.

    And a last one: what a checksum becomes with all of these bytes after it.
    """
    pairs = np.arange(1 << 16)
    tables = [_CRC[1][pairs & 0xFF] ^ _CRC[0][pairs >> 8]]
    while len(tables) < _TOGETHER // 2:
        tables.append(_after_zero(_after_zero(tables[-1])))
    shifted = pairs.astype(np.uint16)
    for _ in range(_TOGETHER):
        shifted = _after_zero(shifted)
    return [*tables, shifted]


@cache
def _starts() -> Words:
    """``(n,)`` what is left of the initial 0xFFFF after 0, 1, 2, ... bytes; a checksum is that plus the bytes' own."""
    left = [np.array([0xFFFF], dtype=np.uint16)]
    while len(left) <= _WIDTHS[0]:
        left.append(_after_zero(left[-1]))
    return np.concatenate(left)


def _runs(data: Bytes, starts: IntArray, width: int) -> Bytes:
    """``(n, width)`` copies of the bytes from each start; each is one item, which is fast."""
    items = np.ndarray((len(data) - width + 1,), dtype=f"V{width}", buffer=data, strides=(1,))
    return items[starts].view(np.uint8).reshape(-1, width)


def _padded(data: Bytes, starts: IntArray, width: int) -> Bytes:
    """Bytes of which runs of this width begin at the starts: the same, or with zeros behind where one ends there."""
    if len(starts) and int(starts.max()) + width <= len(data):
        return data
    return np.concatenate([data, np.zeros(width, dtype=np.uint8)])


class Headers:
    """The headers at some places ``(n,)``.

    Args:
        data: Bytes, ten from each place on at least.
        at: The places of V1 or V2.

    Attributes:
        is_v2: ``(n,)``.
        all_v2: Whether all of them are.
        length: ``(n,)`` of the payload.
    """

    def __init__(self, data: Bytes, at: IntArray) -> None:
        self.is_v2 = data[at] == V2
        self.all_v2 = bool(self.is_v2.all())
        self.length = data[at + 1].astype(np.int64)
        self._words = _runs(data, at + 2, 8).view("<i8")[:, 0]  # in MAVLink 1 the flags and four bytes are not there

    def _field(self, v2_bits: int, v1_bits: int, mask: int = 0xFF) -> IntArray:
        field = self._words >> v2_bits & mask
        return field if self.all_v2 else np.where(self.is_v2, field, self._words >> v1_bits & 0xFF)

    def flags(self) -> IntArray:
        """``(n,)`` incompatibility flags; none in MAVLink 1."""
        flags = self._words & 0xFF
        return flags if self.all_v2 else flags * self.is_v2

    def message_id(self) -> IntArray:
        """``(n,)``."""
        return self._field(40, 24, 0xFFFFFF)

    def system(self) -> IntArray:
        """``(n,)``."""
        return self._field(24, 8)

    def component(self) -> IntArray:
        """``(n,)``."""
        return self._field(32, 16)

    def start(self) -> IntArray | int:
        """Of the payload, from the place on: of each ``(n,)``, or the same of all."""
        return V2_HEAD if self.all_v2 else np.where(self.is_v2, V2_HEAD, V1_HEAD)


class Region:
    """Bytes with room on both sides, so that no look at them ends outside.

    Args:
        data: The bytes.
    """

    def __init__(self, data: Bytes) -> None:
        self.size = len(data)
        self._padded = np.empty(_FRONT + len(data) + _BACK, dtype=np.uint8)
        self._padded[:_FRONT] = self._padded[_FRONT + len(data) :] = 0
        self._padded[_FRONT : _FRONT + len(data)] = data

    def bytes_at(self, places: IntArray) -> IntArray:
        """``(n,)`` bytes; places from -288 to ten beyond the end."""
        return self._padded[places + _FRONT].astype(np.int64)

    def windows(self, ends: IntArray, width: int) -> Bytes:
        """``(n, width)`` copies of the bytes before each end."""
        return _runs(self._padded, ends + _FRONT - width, width)

    def magics(self) -> IntArray:
        """Where a frame could begin."""
        data = self._padded[_FRONT : _FRONT + self.size]
        return np.flatnonzero(data - np.uint8(V2) <= V1 - V2)  # below V2 they wrap

    def checksums(self, starts: IntArray, lengths: IntArray, extras: IntArray) -> IntArray:
        """Checksums ``(n,)`` over runs of bytes, each with its CRC_EXTRA."""
        order = np.argsort((_FRONT - lengths).astype(np.int16), kind="stable")  # longest first; of few values: fast
        ends, lengths = (starts + lengths)[order], lengths[order]
        crc = _starts()[lengths]
        first = 0
        for width, shorter in zip(_WIDTHS, (*_WIDTHS[1:], 0), strict=True):
            last = int(np.searchsorted(-lengths, -shorter))
            if last > first:
                crc[first:last] ^= self._own(ends[first:last], lengths[first:last], width)
            first = last
        checksums = np.empty(len(order), dtype=np.int64)
        checksums[order] = (crc >> 8) ^ _CRC[0][(crc ^ extras[order]) & 0xFF]
        return checksums

    def _own(self, ends: IntArray, lengths: IntArray, width: int) -> Words:
        """What the bytes before each end ``(n,)`` add to a checksum, longest first, none longer than the width."""
        rows = self.windows(ends, width)
        odd = np.flatnonzero(lengths & 1)
        rows[odd, width - lengths[odd] - 1] = 0  # a zero in front adds nothing
        reached = np.searchsorted(-lengths, -np.arange(1, width, 2), side="right").tolist()  # by pairs, from the last
        own = np.zeros(len(ends), dtype=np.uint16)
        *tables, shift = _pair_tables()
        pairs = rows.view("<u2").T[::-1]
        for first in reversed(range(0, len(pairs), len(tables))):
            if own.any():
                own = shift[own]
            for table, pair, count in zip(tables, pairs[first:], reached[first:], strict=False):
                if not count:
                    break
                own[:count] ^= table.take(pair[:count], mode="clip")  # none is beyond its end: fastest said so
        return own

    def claims(self, at: IntArray, table: Table) -> tuple[IntArray, IntArray]:
        """What stands at places ``(n,)``, before any checksum (``kernels.measure``).

        Returns:
            The size of the frame that may stand there, 0 for none; and its CRC_EXTRA.
        """
        head = Headers(self._padded, at + _FRONT)
        message_id, flags = head.message_id(), head.flags()
        entry = np.where(message_id < TABLE_IDS, table.take(message_id, mode="clip"), -1)
        fits = (entry >= 0) & (flags & ~SIGNED == 0)
        if not head.all_v2:
            fits &= head.is_v2 | (((entry >> 8 & 0xFF) <= head.length) & (head.length <= entry >> 16))
        size = head.start() + 2 + head.length + SIGNATURE * (flags & SIGNED)
        return np.where(fits & (at + size <= self.size), size, 0), entry & 0xFF

    def good(self, at: IntArray, sizes: IntArray, extras: IntArray) -> BoolArray:
        """Whether frames that fit have the right checksums."""
        signed = (self.bytes_at(at) == V2) & (self.bytes_at(at + 2) & SIGNED != 0)
        ends = at + sizes - 2 - np.where(signed, SIGNATURE, 0)
        said = self.bytes_at(ends) | self.bytes_at(ends + 1) << 8
        good: BoolArray = said == self.checksums(at + 1, ends - at - 1, extras)
        return good

    def frames(self, table: Table) -> IntArray:
        """``(2, n)`` start and size of everything that is a frame, in order; frames may lie in each other."""
        at = self.magics()
        size, extra = self.claims(at, table)
        fits = np.flatnonzero(size)
        at, size, extra = at[fits], size[fits], extra[fits]
        good = self.good(at, size, extra)
        return np.stack([at[good], size[good]])


def count_frames(data: bytes) -> int:
    """How many frames some bytes hold, the checks of which they pass."""
    return Region(np.frombuffer(data, dtype=np.uint8)).frames(frame_table()).shape[1] if data else 0


def read_headers(data: Bytes, frames: IntArray, table: Table, heads: IntArray, *, checked: bool) -> None:
    """As ``kernels.read_headers``."""
    at, size = frames
    index = np.flatnonzero((at >= 0) & (size >= MIN_FRAME) & (at + size <= len(data)))
    if not checked:
        region = Region(data)
        claimed, extra = region.claims(at[index], table)
        fits = claimed == size[index]
        index, extra = index[fits], extra[fits]
        index = index[region.good(at[index], size[index], extra)]
    heads[0] = -1
    if not len(index):
        return
    whole: IntArray | slice = slice(None)
    if len(index) < len(at):
        whole, at = index, at[index]
    head = Headers(_padded(data, at, V2_HEAD), at)
    heads[0, whole], heads[1, whole], heads[2, whole] = head.message_id(), head.system(), head.component()
    heads[3, whole], heads[4, whole] = at + head.start(), head.length


def gather(data: Bytes, places: IntArray, out: Bytes) -> None:
    """As ``payloads.gather``."""
    start, length = places
    width = out.shape[1]
    out[:] = _runs(_padded(data, start, width), start, width)
    out *= _COLUMNS[:width] < length.astype(np.int16)[:, np.newaxis]
