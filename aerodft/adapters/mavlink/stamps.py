"""Arrival stamps as logs hold them, made not decreasing without trusting a damaged one."""

from aerodft.adapters.mavlink.framing import Bytes
from aerodft.adapters.mavlink.jit import njit

JUMP_US = 60_000_000
BACK_US = 1_000_000
MAX_STAMP_US = 1 << 52  # year 2112; its nanoseconds still fit 64 bits


@njit
def big_endian_stamp(data: Bytes, at: int) -> int:
    """The 8-byte big-endian stamp in front of a tlog's frame; -1 where it cannot be one."""
    stamp = 0
    for i in range(8):
        if i == 1 and stamp != 0:
            return -1
        stamp = stamp << 8 | int(data[at + i])
    return stamp if stamp < MAX_STAMP_US else -1


@njit
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
