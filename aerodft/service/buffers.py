"""Recent telemetry, ordered by UTC stamp, in arrays that grow at one end and are trimmed at the other."""

import numpy as np
import numpy.typing as npt

from aerodft.model.arrays import IntArray


class TrackBuffer:
    """A sliding window over one track: stamps and named columns.

    A row whose stamp is not after the last one's is dropped and counted: what a stamp's neighbours are must not
    depend on how late a stray row came.
    """

    def __init__(self, window_ns: int) -> None:
        self.out_of_order = 0
        self._window_ns = window_ns
        self._stamps: IntArray = np.empty(0, dtype=np.int64)
        self._columns: dict[str, npt.NDArray[np.generic]] = {}
        self._start = self._stop = 0

    def __len__(self) -> int:
        return self._stop - self._start

    @property
    def stamps_ns(self) -> IntArray:
        """``(n,)`` strictly ascending."""
        return self._stamps[self._start : self._stop]

    def column(self, name: str) -> npt.NDArray[np.float64]:
        """``(n, ...)`` values of one column."""
        return np.asarray(self._columns[name][self._start : self._stop])

    def append(self, stamps_ns: IntArray, **columns: npt.NDArray[np.generic]) -> None:
        """Add rows; those not after their predecessors are dropped."""
        if len(stamps_ns) == 0:
            return
        last = int(self._stamps[self._stop - 1]) if len(self) else np.iinfo(np.int64).min
        ceiling = np.maximum.accumulate(np.concatenate([[last], stamps_ns]))[:-1]
        keep = stamps_ns > ceiling
        self.out_of_order += int(np.count_nonzero(~keep))
        count = int(np.count_nonzero(keep))
        self._reserve(count, columns)
        rows = slice(self._stop, self._stop + count)
        self._stamps[rows] = stamps_ns[keep]
        for name, values in columns.items():
            self._columns[name][rows] = values[keep]
        self._stop += count
        if count:
            self._trim()

    def clear(self) -> None:
        """Forget everything, as after a jump of the clock."""
        self._start = self._stop = 0

    def shift(self, by_ns: int) -> None:
        """Move all stamps, as after a jump of what the time is."""
        self._stamps[self._start : self._stop] += by_ns

    def _trim(self) -> None:
        oldest = int(self._stamps[self._stop - 1]) - self._window_ns
        self._start += int(np.searchsorted(self.stamps_ns, oldest))

    def _reserve(self, count: int, columns: dict[str, npt.NDArray[np.generic]]) -> None:
        if self._stop + count <= len(self._stamps):
            return
        size, held = 2 * (len(self) + count) + 64, slice(self._start, self._stop)
        kept = len(self)
        stamps = np.empty(size, dtype=np.int64)
        stamps[:kept] = self._stamps[held]
        for name, values in columns.items():
            grown = np.empty((size, *values.shape[1:]), dtype=values.dtype)
            if name in self._columns:
                grown[:kept] = self._columns[name][held]
            self._columns[name] = grown
        self._stamps, self._start, self._stop = stamps, 0, kept
