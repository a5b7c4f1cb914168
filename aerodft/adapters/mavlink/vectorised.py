"""The checks of ``kernels`` over whole arrays, for machines on which nothing can be compiled: the same answers."""

from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

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

_WIDTHS: Final = (16, 24, 32, 40, 48, 64, 96, 128, 288)  # the last one holds the longest frame
_FRONT: Final = _WIDTHS[-1]
_BACK: Final = V2_HEAD
_CRC: Final = crc_tables()
_COLUMNS: Final = np.arange(_FRONT, dtype=np.int16)  # compared with many at once: small ones are fast


def _after_zero(crc: Words) -> Words:
    """What a zero byte makes of checksums."""
    shifted: Words = (crc >> 8) ^ _CRC[0][crc & 0xFF]
    return shifted


@cache
def _pair_tables() -> list[Words]:
    """``(65536,)`` each: the checksum of two bytes, low one first, with 0, 2, 4, ... zero bytes after them."""
    pairs = np.arange(1 << 16)
    tables = [_CRC[1][pairs & 0xFF] ^ _CRC[0][pairs >> 8]]
    while len(tables) < _WIDTHS[-1] // 2:
        tables.append(_after_zero(_after_zero(tables[-1])))
    return tables


@cache
def _starts() -> Words:
    """``(n,)`` what is left of the initial 0xFFFF after 0, 1, 2, ... bytes; a checksum is that plus the bytes' own."""
    left = [np.array([0xFFFF], dtype=np.uint16)]
    while len(left) <= _WIDTHS[-1]:
        left.append(_after_zero(left[-1]))
    return np.concatenate(left)


def _runs(data: Bytes, starts: IntArray, width: int) -> Bytes:
    """``(n, width)`` copies of the bytes from each start; each is one item, which is fast."""
    items = np.ndarray((len(data) - width + 1,), dtype=f"V{width}", buffer=data, strides=(1,))
    return items[starts].view(np.uint8).reshape(-1, width)


class Region:
    """Bytes with room on both sides, so that no look at them ends outside.

    Args:
        data: The bytes.
    """

    def __init__(self, data: Bytes) -> None:
        self.size = len(data)
        self._padded = np.zeros(_FRONT + len(data) + _BACK, dtype=np.uint8)
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
        return np.flatnonzero((data == V1) | (data == V2))

    def checksums(self, starts: IntArray, lengths: IntArray, extras: IntArray) -> IntArray:
        """Checksums ``(n,)`` over runs of bytes, each with its CRC_EXTRA."""
        crc = _starts()[lengths]
        shorter = 0
        for width in _WIDTHS:
            index = np.flatnonzero((lengths > shorter) & (lengths <= width))
            shorter = width
            if not len(index):
                continue
            rows = self.windows(starts[index] + lengths[index], width)
            rows *= _COLUMNS[:width] >= (width - lengths[index]).astype(np.int16)[:, np.newaxis]
            own = np.zeros(len(index), dtype=np.uint16)
            for table, pair in zip(_pair_tables(), rows.view("<u2").T[::-1], strict=False):
                own ^= table.take(pair, mode="clip")  # none is beyond its end: the fastest way to say so
            crc[index] ^= own
        return np.asarray((crc >> 8) ^ _CRC[0][(crc ^ extras) & 0xFF], dtype=np.int64)

    def head(self, at: IntArray) -> npt.NDArray[np.int32]:
        """``(10, n)`` the bytes of a MAVLink 2 header at places ``(n,)``."""
        return self.windows(at + V2_HEAD, V2_HEAD).T.astype(np.int32)

    def claims(self, at: IntArray, table: Table) -> tuple[IntArray, IntArray]:
        """What stands at places ``(n,)``, before any checksum (``kernels.measure``).

        Returns:
            The size of the frame that may stand there, 0 for none; and its CRC_EXTRA.
        """
        head = self.head(at)
        is_v2, length, flags = head[0] == V2, head[1], head[2]
        message_id = _message_id(head)
        entry = np.where(message_id < TABLE_IDS, table.take(message_id, mode="clip"), -1)
        fits_v1 = ((entry >> 8 & 0xFF) <= length) & (length <= entry >> 16) & (head[0] == V1)
        fits = (entry >= 0) & np.where(is_v2, flags & ~SIGNED == 0, fits_v1)
        signature = SIGNATURE * (is_v2 & (flags & SIGNED != 0))
        size = np.where(is_v2, V2_HEAD + 2, V1_HEAD + 2) + length + signature
        return np.where(fits & (at + size <= self.size), size, 0).astype(np.int64), entry & 0xFF

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


def _message_id(head: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Message ids ``(n,)`` out of headers ``(10, n)``."""
    return np.asarray(np.where(head[0] == V2, head[7] | head[8] << 8 | head[9] << 16, head[5]))


def read_headers(data: Bytes, frames: IntArray, table: Table, heads: IntArray, *, checked: bool) -> None:
    """As ``kernels.read_headers``."""
    at, size = frames
    index = np.flatnonzero((at >= 0) & (size >= MIN_FRAME) & (at + size <= len(data)))
    region = Region(data)
    if not checked:
        claimed, extra = region.claims(at[index], table)
        fits = claimed == size[index]
        index, extra = index[fits], extra[fits]
        index = index[region.good(at[index], size[index], extra)]
    head = region.head(at[index])
    is_v2 = head[0] == V2
    heads[0] = -1
    whole = index if len(index) < len(at) else slice(None)
    heads[0, whole] = _message_id(head)
    heads[1:3, whole] = np.where(is_v2, head[5:7], head[3:5])
    heads[3, whole] = at[index] + np.where(is_v2, V2_HEAD, V1_HEAD)
    heads[4, whole] = head[1]


def gather(data: Bytes, places: IntArray, out: Bytes) -> None:
    """As ``payloads.gather``."""
    start, length = places
    width = out.shape[1]
    padded = np.concatenate([data, np.zeros(width, dtype=np.uint8)])
    out[:] = _runs(padded, start, width)
    out *= _COLUMNS[:width] < length.astype(np.int16)[:, np.newaxis]
