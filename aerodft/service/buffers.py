"""Recent telemetry, ordered by UTC stamp, in arrays that grow at one end and are trimmed at the other."""

from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.model.arrays import IntArray

_NO_TICKS: Final = (np.empty(0, dtype=np.int64),) * 2


class TrackBuffer:
    """A sliding window over one track: stamps and named columns.

    A row whose stamp is not after the last one's is dropped and counted: what a stamp's neighbours are must not
    depend on how late a stray row came. Rows of several ticks may come at once; ``see`` then says which of these ticks
    it is: later rows are not there yet.
    """

    def __init__(self, window_ns: int) -> None:
        self.out_of_order = 0
        self._window_ns = window_ns
        self._stamps: IntArray = np.empty(0, dtype=np.int64)
        self._columns: dict[str, npt.NDArray[np.generic]] = {}
        self._start = self._stop = 0
        self._first = self._end = 0  # what is there at the tick that it is
        self._ticks = _NO_TICKS  # what is there at each of those that came last

    def __len__(self) -> int:
        return self._end - self._first

    @property
    def stamps_ns(self) -> IntArray:
        """``(n,)`` strictly ascending."""
        return self._stamps[self._first : self._end]

    def column(self, name: str) -> npt.NDArray[np.float64]:
        """``(n, ...)`` values of one column."""
        return np.asarray(self._columns[name][self._first : self._end])

    def append(self, stamps_ns: IntArray, edges: IntArray | None = None, **columns: npt.NDArray[np.generic]) -> None:
        """Add rows; those not after their predecessors are dropped.

        Args:
            stamps_ns: ``(n,)`` in order of arrival.
            edges: ``(ticks,)`` how many of them had come by each of several ticks; None for one tick.
            columns: ``(n, ...)`` values.
        """
        if len(stamps_ns) == 0:
            return
        last = int(self._stamps[self._stop - 1]) if self._stop > self._start else np.iinfo(np.int64).min
        ceiling = np.maximum.accumulate(np.concatenate([[last], stamps_ns]))[:-1]
        keep = stamps_ns > ceiling
        kept = np.cumsum(keep)
        count = int(kept[-1])
        self.out_of_order += len(keep) - count
        self._reserve(count, columns)
        before, rows = self._stop, slice(self._stop, self._stop + count)
        self._stamps[rows] = stamps_ns[keep]
        for name, values in columns.items():
            self._columns[name][rows] = values[keep]
        self._stop += count
        if edges is None:
            edges = np.array([len(keep)])
        self._note_ticks(before + np.concatenate([[0], kept])[edges])

    def seen_by(self, ticks: IntArray) -> tuple[IntArray, IntArray]:
        """First row that is there, and the one behind the last, at ticks ``(n,)`` of the rows that came last.

        Rows are those of ``all_stamps_ns``, whatever tick it is.
        """
        if not len(self._ticks[0]):
            there = np.ones_like(ticks)
            return (self._first - self._start) * there, (self._end - self._start) * there
        first, end = self._ticks
        return first[ticks] - self._start, end[ticks] - self._start

    @property
    def all_stamps_ns(self) -> IntArray:
        """``(n,)`` strictly ascending; those of later ticks too."""
        return self._stamps[self._start : self._stop]

    def all_of(self, name: str) -> npt.NDArray[np.float64]:
        """``(n, ...)`` values of one column, of all rows."""
        return np.asarray(self._columns[name][self._start : self._stop])

    def newest_by_tick(self) -> IntArray:
        """``(ticks,)`` the newest stamp at each of the ticks of the rows that came last; empty where there are none."""
        return self._stamps[np.maximum(self._ticks[1] - 1, 0)]

    def settle(self) -> None:
        """All ticks so far are over."""
        self._ticks = _NO_TICKS

    def see(self, tick: int) -> None:
        """Look at what was there at one of the ticks of the rows that came last."""
        if len(self._ticks[0]):
            self._first, self._end = (int(rows[tick]) for rows in self._ticks)

    def clear(self) -> None:
        """Forget everything, as after a jump of the clock."""
        self._start = self._stop = self._first = self._end = 0
        self._ticks = _NO_TICKS

    def shift(self, by_ns: int) -> None:
        """Move all stamps, as after a jump of what the time is."""
        self._stamps[self._start : self._stop] += by_ns

    def _note_ticks(self, ends: IntArray) -> None:
        """What is there at each tick, if rows end there; what no tick looks at is given free."""
        stamps = self._stamps[self._start : self._stop]
        newest = stamps[np.maximum(ends - self._start - 1, 0)]
        firsts = self._start + np.searchsorted(stamps, newest - self._window_ns)
        self._start = int(firsts[0])
        self._ticks = firsts, ends
        self.see(-1)

    def _reserve(self, count: int, columns: dict[str, npt.NDArray[np.generic]]) -> None:
        if self._stop + count <= len(self._stamps):
            return
        kept, held = self._stop - self._start, slice(self._start, self._stop)
        size = 2 * (kept + count) + 64
        stamps = np.empty(size, dtype=np.int64)
        stamps[:kept] = self._stamps[held]
        for name, values in columns.items():
            grown = np.empty((size, *values.shape[1:]), dtype=values.dtype)
            if name in self._columns:
                grown[:kept] = self._columns[name][held]
            self._columns[name] = grown
        self._stamps, self._start, self._stop = stamps, 0, kept
