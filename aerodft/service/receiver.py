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

    def has_begun(self) -> bool:
        """Whether what was stated is known by its stamp: reports of several ticks may come at once then."""
        return len(self.stream.stamps_ns) > 0

    def append(self, track: GpsTrack, stamps_ns: IntArray, edges: IntArray | None = None) -> None:
        """Take reports in; ``edges`` as in ``TrackBuffer.append``."""
        stated = np.flatnonzero(np.isfinite(track.vertical_std_m))
        if not len(self.stream.stamps_ns):
            self._before_m = self._newest_m
        std_m = track.vertical_std_m[stated]
        for row, has_fix in enumerate(track.fix[stated] >= FIX_3D):
            if has_fix:
                self._with_fix_m = float(std_m[row])
            std_m[row] = self._newest_m = max(float(std_m[row]), self._with_fix_m)
        ends = None if edges is None else np.searchsorted(stated, edges)
        self.stream.append(stamps_ns[stated], ends, std_m=std_m)

    def std_m(self, stamp_ns: int) -> float:
        """Standard deviation by a stamp; 0 where none was ever stated."""
        stamps = self.stream.stamps_ns
        row = int(np.searchsorted(stamps, stamp_ns, side="right")) - 1
        if row >= 0:
            return float(self.stream.column("std_m")[row])
        return self._before_m if len(stamps) else self._newest_m

    def stds_m(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """``std_m`` of stamps ``(n,)`` at ticks ``(n,)`` of those that came last; NaN where it is not in the stream."""
        if self.stream.is_empty:
            return np.full(len(stamps_ns), self._newest_m)
        rows = self.stream.last_before(stamps_ns, ticks)
        return np.where(rows >= 0, self.stream.all_of("std_m")[rows], np.nan)
