"""How well the GPS receiver knows the height, as it said itself."""

import numpy as np

from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.health import FIX_3D, GpsTrack
from aerodft.service.streams import Stream


class VerticalAccuracy:
    """What a receiver last said of its vertical accuracy; nothing that it loses makes a height better known.

    It counts until the receiver says something else: while it is silent, while it states no accuracy, and after clocks
    started anew. Without a 3D fix it is never less than it was with the last one.
    """

    def __init__(self) -> None:
        self.stream = Stream(0)  # nothing is interpolated
        self._before_m = self._newest_m = self._with_fix_m = 0.0

    def may_append_ticks(self, track: GpsTrack) -> bool:
        """Whether reports of several ticks can be told apart by tick: a first accuracy counts from its own tick on."""
        return not self.stream.is_empty or not np.any(np.isfinite(track.vertical_std_m))

    def append(self, track: GpsTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take in the reports of a step; ``row_end_by_tick`` as in ``Stream.append``."""
        stated = np.flatnonzero(np.isfinite(track.vertical_std_m))
        if self.stream.is_empty:
            self._before_m = self._newest_m
        std_m = track.vertical_std_m[stated]
        for row, has_fix in enumerate(track.fix[stated] >= FIX_3D):
            if has_fix:
                self._with_fix_m = float(std_m[row])
            std_m[row] = self._newest_m = max(float(std_m[row]), self._with_fix_m)
        ends = None if row_end_by_tick is None else np.searchsorted(stated, row_end_by_tick)
        self.stream.append(stamps_ns[stated], ends, std_m=std_m)

    def std_m(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Standard deviations by stamps ``(n,)`` as of ticks ``(n,)``; 0 where none was ever stated."""
        if self.stream.is_empty:
            return np.full(len(stamps_ns), self._newest_m)
        rows = self.stream.last_before(stamps_ns, ticks)
        return np.where(rows >= 0, self.stream.column("std_m")[rows], self._before_m)
