"""``dataflash_kernels.scan_dataflash`` over whole arrays: only which message follows which is looked up one by one."""

from typing import Final

import numpy as np

from aerodft.adapters.mavlink.dataflash_format import FMT_TYPE, HEAD, HEAD_SIZE
from aerodft.adapters.mavlink.dataflash_kernels import TIMED, learn
from aerodft.adapters.mavlink.layout import AT_SYNC, MAX_STAMP_US, N_OK, N_SKIPPED, N_TRUNCATED, Bytes
from aerodft.model.arrays import BoolArray, IntArray

_MESSAGE: Final = 64  # bytes of a usual one
_AT_FIRST: Final = 1 << 12  # bytes at once after a type was learned: most are at the start, one after the other
_NONE: Final = -1


class _Candidates:
    """Everything that starts and ends as a whole message of a known type between two places; some lie in others.

    Args:
        data: The bytes.
        start: Where to look from.
        stop: And to where.
        types: Of ``scan_dataflash``.

    Attributes:
        start: ``(n,)`` where each of them starts, in order.
        size: ``(n,)``.
        timed: ``(n,)`` whether it starts with its time.
    """

    def __init__(self, data: Bytes, start: int, stop: int, types: IntArray) -> None:
        places = start + np.flatnonzero(data[start:stop] == HEAD[0])
        kinds = _kinds(data, places, types)
        sizes = kinds & 0xFF
        good = (sizes > 0) & (places + sizes <= len(data))
        self.start, self.size, self.timed = places[good], sizes[good], kinds[good] & TIMED > 0
        self._data, self._types = data, types

    def following(self) -> IntArray:
        """``(n,)`` the number of the one that starts where each of them ends, -1 where none does."""
        ends = self.start + self.size
        found = np.searchsorted(self.start, ends)
        follows = self.start.take(found, mode="clip") == ends if len(found) else found > 0
        return np.where(follows, found, _NONE)

    def confirmed(self) -> BoolArray:
        """``(n,)`` whether the bytes end with it, or something of a known type follows."""
        ends = self.start + self.size
        confirmed: BoolArray = (ends == len(self._data)) | (_kinds(self._data, ends, self._types) > 0)
        return confirmed

    def times_us(self, chosen: IntArray) -> IntArray:
        """Time since boot of some ``(k,)`` of them, -1 where they have none."""
        places = self.start[chosen] + HEAD_SIZE
        timed = np.flatnonzero(self.timed[chosen] & (places + 8 <= len(self._data)))
        raw = self._data[places[timed, np.newaxis] + np.arange(8)].view("<u8")[:, 0]
        times_us = np.full(len(chosen), -1, dtype=np.int64)
        times_us[timed] = np.where(raw < MAX_STAMP_US, raw, MAX_STAMP_US)
        times_us[times_us == MAX_STAMP_US] = -1
        return times_us


def _kinds(data: Bytes, places: IntArray, types: IntArray) -> IntArray:
    """``(n,)`` what ``types`` has of the messages that start at these places; 0 where none of a known type does."""
    first, second, kind = (data.take(places + k, mode="clip") for k in range(HEAD_SIZE))
    is_head = (first == HEAD[0]) & (second == HEAD[1]) & (places + HEAD_SIZE <= len(data))
    return np.where(is_head, types[kind], 0)


def scan_dataflash(
    data: Bytes, start: int, limit: int, types: IntArray, rows: IntArray, state: IntArray
) -> tuple[int, int]:
    """As ``dataflash_kernels.scan_dataflash``; goes less far at once."""
    limit = min(limit, len(data), start + _MESSAGE * rows.shape[1])
    at, found, span = start, 0, _AT_FIRST
    while at < limit and found < rows.shape[1]:
        candidates = _Candidates(data, at, min(at + span, limit), types)
        chosen, at, learned = _walk(data, candidates, (at, min(at + span, limit)), rows.shape[1] - found, types, state)
        part = rows[:, found : found + len(chosen)]
        part[0], part[1] = candidates.start[chosen], candidates.size[chosen]
        part[2] = candidates.times_us(chosen)
        found += len(chosen)
        span = _AT_FIRST if learned else 4 * span
    return found, at


def _walk(
    data: Bytes, candidates: _Candidates, part: tuple[int, int], most: int, types: IntArray, state: IntArray
) -> tuple[IntArray, int, bool]:
    """Go from message to message through a part of the bytes, until a type is learned.

    Returns:
        The numbers of the messages, where to go on, and whether a type was learned.
    """
    (at, stop), learned = part, False
    following = candidates.following().tolist()
    is_format = (data[candidates.start + HEAD_SIZE - 1] == FMT_TYPE).tolist()
    starts, confirmed = candidates.start, None
    chosen: list[int] = []
    k = int(np.searchsorted(starts, at)) if at == state[AT_SYNC] else _NONE
    k = k if 0 <= k < len(starts) and starts[k] == at else _NONE
    while at < stop and len(chosen) < most and not learned:
        if k == _NONE:
            confirmed = np.flatnonzero(candidates.confirmed()) if confirmed is None else confirmed
            k, at = _regained(data, starts, confirmed, (at, stop), types, state)
            continue
        while k != _NONE and len(chosen) < most and not learned:
            chosen.append(k)
            if is_format[k]:
                learned = _learns(data, int(starts[k]), types)
            last, k = k, following[k]
        at = int(starts[last] + candidates.size[last])
        state[AT_SYNC] = at
    state[N_OK] += len(chosen)
    return np.array(chosen, dtype=np.int64), at, learned


def _regained(
    data: Bytes, starts: IntArray, confirmed: IntArray, part: tuple[int, int], types: IntArray, state: IntArray
) -> tuple[int, int]:
    """Count the damage from here on; the number of the next message that another one confirms (or -1), and where."""
    at, stop = part
    if at == state[AT_SYNC]:
        size = int(_kinds(data, np.array([at]), types)[0]) & 0xFF
        state[N_TRUNCATED] += at + size > len(data) or len(data) - at < HEAD_SIZE
    place = int(np.searchsorted(starts[confirmed], at))
    k = int(confirmed[place]) if place < len(confirmed) else _NONE
    end = int(starts[k]) if k != _NONE else stop
    state[N_SKIPPED] += end - at
    return k, end


def _learns(data: Bytes, at: int, types: IntArray) -> bool:
    """Take in what a FMT message declares; whether it was new."""
    before = types.copy()
    learn(data, at, types)
    return bool((types != before).any())
