"""When the records of a log arrived: their stamps, made not decreasing."""

from collections.abc import Callable
from typing import Final

import numpy as np

from aerodft.adapters.mavlink.layout import BACK_US, JUMP_US, MAX_STAMP_US, STAMP_SIZE, V1, V2, Bytes
from aerodft.geometry.jit import njit_late
from aerodft.model.arrays import IntArray

_MANY: Final = 16  # jumps, from which on each stamp is looked at by itself


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


def settle_all(stamps_us: IntArray, last_us: int, following_us: Callable[[int], int]) -> int:
    """Replace stamps ``(n,)``, -1 where unreadable, by arrivals that do not decrease (``settle``).

    Args:
        stamps_us: Replaced in place.
        last_us: The arrival before them; 0 for none.
        following_us: The stamp of the record that follows the one with this number; -1 where there is none.

    Returns:
        How many stepped back.
    """
    read, before_us, done, jumps = stamps_us.copy(), last_us, 0, 0
    while done < len(read):
        settled = np.maximum.accumulate(np.concatenate([[before_us], read[done:]]))
        too_far = np.flatnonzero(np.diff(settled) > JUMP_US)  # only there does it matter what follows
        count = int(too_far[0]) if len(too_far) else len(read) - done
        stamps_us[done : done + count] = settled[1 : count + 1]
        done, before_us, jumps = done + count, int(settled[count]), jumps + 1
        for k in range(done, len(read) if jumps > _MANY else min(done + 1, len(read))):
            stamps_us[k] = before_us = settle(int(read[k]), before_us, following_us(k))
            done = k + 1
    lasts_us = np.concatenate([[last_us], stamps_us[:-1]])
    return int(np.count_nonzero((read >= 0) & (read < lasts_us - BACK_US)))


def following_stamps(stamps_us: IntArray) -> IntArray:
    """``(n,)`` the first readable stamp behind each of these; -1 where there is none."""
    readable = np.flatnonzero(stamps_us >= 0)
    found = np.searchsorted(readable, np.arange(len(stamps_us)), side="right")
    stamps = np.append(stamps_us[readable], -1)
    following_us: IntArray = stamps[found]
    return following_us


@njit_late
def following_stamp(data: Bytes, at: int) -> int:
    """The stamp of the record that should start at ``at``; -1 where none does."""
    if at + STAMP_SIZE >= len(data) or data[at + STAMP_SIZE] not in (V1, V2):
        return -1
    return big_endian_stamp(data, at)
