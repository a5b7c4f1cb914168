"""When the records of a log arrived: their stamps, made not decreasing."""

import numpy as np

from aerodft.adapters.mavlink.layout import JUMP_US, MAX_STAMP_US, STAMP_SIZE, V1, V2, Bytes
from aerodft.geometry.jit import njit, njit_late
from aerodft.model.arrays import IntArray


@njit_late
def big_endian_stamp(data: Bytes, at: int) -> int:
    """The 8-byte big-endian stamp in front of a tlog's frame; -1 where it cannot be one."""
    stamp = 0
    for i in range(8):
        if i == 1 and stamp != 0:
            return -1
        stamp = stamp << 8 | int(data[at + i])
    return stamp if stamp < MAX_STAMP_US else -1


@njit_late
def settle(stamp_us: int, last_us: int, following_us: int) -> int:
    """The arrival of a record, not before the last one.

    A jump forward is believed only when the record that follows confirms it: one garbled stamp in the far future would
    otherwise carry the rest of the file along.

    Args:
        stamp_us: As read; -1 where unreadable.
        last_us: The previous arrival; 0 before the first.
        following_us: The next record's stamp; -1 where there is none.
    """
    if stamp_us <= last_us:
        return last_us
    if stamp_us - last_us <= JUMP_US or abs(following_us - stamp_us) <= JUMP_US:
        return stamp_us
    if following_us < 0:
        return last_us if last_us > 0 else stamp_us
    return max(last_us, min(stamp_us, following_us))


@njit
def settle_all(stamps_us: IntArray, last_us: int) -> None:
    """Replace stamps ``(n,)``, -1 where a record has none, by arrivals that do not decrease (see ``settle``)."""
    following = -1
    nexts = np.empty_like(stamps_us)
    for k in range(len(stamps_us) - 1, -1, -1):
        nexts[k] = following
        if stamps_us[k] >= 0:
            following = stamps_us[k]
    for k in range(len(stamps_us)):
        last_us = settle(stamps_us[k], last_us, nexts[k])
        stamps_us[k] = last_us


@njit_late
def following_stamp(data: Bytes, at: int) -> int:
    """The stamp of the record that should start at ``at``; -1 where none does."""
    if at + STAMP_SIZE >= len(data) or data[at + STAMP_SIZE] not in (V1, V2):
        return -1
    return big_endian_stamp(data, at)
