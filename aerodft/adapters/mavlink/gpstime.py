"""GPS weeks to UTC."""

from typing import Final

import numpy as np

from aerodft.model.arrays import IntArray

_EPOCH_NS: Final = 315_964_800 * 10**9  # 1980-01-06 as Unix time
_WEEK_NS: Final = 604_800 * 10**9
# From each Unix time on: GPS minus UTC in seconds (leap seconds that autopilot logs can meet).
_LEAPS: Final = ((1_230_768_000, 15), (1_341_100_800, 16), (1_435_708_800, 17), (1_483_228_800, 18))


def gps_to_unix_ns(week: IntArray, week_ms: IntArray) -> IntArray:
    """UTC as Unix ns from GPS week and milliseconds of the week, shapes ``(n,)``; leap seconds taken off."""
    gps_ns = _EPOCH_NS + week.astype(np.int64) * _WEEK_NS + week_ms.astype(np.int64) * 1_000_000
    starts_ns = np.array([start * 10**9 for start, _ in _LEAPS[1:]])
    leaps_ns = np.array([leap * 10**9 for _, leap in _LEAPS])
    leap_ns: IntArray = leaps_ns[np.searchsorted(starts_ns, gps_ns - leaps_ns[-1], side="right")]
    return gps_ns - leap_ns
