"""One telemetry stream around a stamp: its two neighbours, or why there are none."""

from enum import Enum, auto

import numpy as np
import numpy.typing as npt

from aerodft.conventions import SECOND_NS
from aerodft.geometry.interpolation import Bracket, Brackets, bracket, brackets
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.service.buffers import TrackBuffer

HISTORY_NS = 120 * SECOND_NS
"""How long samples are kept: longer than any image waits for its telemetry."""

END_OF_TIME = np.iinfo(np.int64).max
"""The watermark of a stream that will not go on."""

_ON_ANOTHER_CLOCK = np.iinfo(np.int64).min


class Missing(Enum):
    """Why a stream has no value at a stamp."""

    PENDING = auto()  # the next sample may still come
    STALE = auto()  # there were samples, none close enough on both sides
    NEVER = auto()  # there was no sample by then


class Stream:
    """A buffer with the longest gap that may be interpolated over."""

    def __init__(self, max_gap_ns: int) -> None:
        self.max_gap_ns = max_gap_ns
        self._first_ns: int | None = None
        self._buffer = TrackBuffer(HISTORY_NS)

    @property
    def last_ns(self) -> int | None:
        """Stamp of the newest sample."""
        return int(self._buffer.stamps_ns[-1]) if len(self._buffer) else None

    @property
    def stamps_ns(self) -> IntArray:
        """``(n,)`` strictly ascending."""
        return self._buffer.stamps_ns

    @property
    def has_begun(self) -> bool:
        """Whether there ever was a sample."""
        return self._first_ns is not None

    def append(self, stamps_ns: IntArray, edges: IntArray | None = None, **columns: npt.NDArray[np.generic]) -> None:
        """Add samples in order of arrival; ``edges`` as in ``TrackBuffer.append``."""
        self._buffer.append(stamps_ns, edges, **columns)
        if self._first_ns is None and len(stamps_ns):
            self._first_ns = int(stamps_ns[0])

    def began_by(self, stamp_ns: int) -> bool:
        """Whether there was a sample at the stamp or before it."""
        return self._first_ns is not None and self._first_ns <= stamp_ns

    def newest_by_tick(self) -> IntArray:
        """As ``TrackBuffer.newest_by_tick``."""
        return self._buffer.newest_by_tick()

    def settle(self) -> None:
        """All ticks so far are over."""
        self._buffer.settle()

    def see(self, tick: int) -> None:
        """Look at the samples that had come by one of the ticks of those that came last."""
        self._buffer.see(tick)

    def clear(self) -> None:
        """Forget all samples: their stamps are of another clock."""
        self._buffer.clear()
        if self._first_ns is not None:
            self._first_ns = _ON_ANOTHER_CLOCK

    def shift(self, by_ns: int) -> None:
        """Move all samples: what time it was when they were taken is known better now."""
        self._buffer.shift(by_ns)
        if self._first_ns is not None and self._first_ns != _ON_ANOTHER_CLOCK:
            self._first_ns += by_ns

    def column(self, name: str) -> FloatArray:
        """``(n, ...)`` values."""
        return self._buffer.column(name)

    def find(self, stamp_ns: int, watermark_ns: int) -> Bracket | Missing:
        """The samples around a stamp.

        Args:
            stamp_ns: UTC.
            watermark_ns: Newest stamp of any stream: once it has passed the stamp, and the last sample by more than
                the longest gap, there is nothing left to wait for.
        """
        last = self.last_ns
        gone = Missing.STALE if self.began_by(stamp_ns) else Missing.NEVER
        if last is not None and last >= stamp_ns:
            return bracket(self._buffer.stamps_ns, stamp_ns, self.max_gap_ns) or gone
        over = watermark_ns >= stamp_ns and (last is None or watermark_ns - last > self.max_gap_ns)
        return gone if over else Missing.PENDING

    def find_all(self, stamps_ns: IntArray, ticks: IntArray) -> Brackets:
        """The samples around stamps ``(n,)``, each at a tick ``(n,)`` of those that came last; others are not known.

        Returns:
            Rows of ``all_of``.
        """
        buffer = self._buffer
        return brackets(buffer.all_stamps_ns, stamps_ns, self.max_gap_ns, buffer.seen_by(ticks))

    def last_before(self, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
        """Rows of ``all_of`` that are the newest by stamps ``(n,)`` at ticks ``(n,)``; -1 where none is there."""
        first, end = self._buffer.seen_by(ticks)
        rows = np.minimum(np.searchsorted(self._buffer.all_stamps_ns, stamps_ns, side="right"), end) - 1
        return np.where(rows >= first, rows, -1)

    def all_of(self, name: str) -> FloatArray:
        """``(n, ...)`` values, those of later ticks too."""
        return self._buffer.all_of(name)

    def newest_at(self, ticks: IntArray) -> IntArray:
        """Stamps of the newest samples at ticks ``(n,)`` of those that came last; 0 where none is there."""
        first, end = self._buffer.seen_by(ticks)
        if self.is_empty:
            return np.zeros(len(ticks), dtype=np.int64)
        return np.where(end > first, self._buffer.all_stamps_ns[np.maximum(end, 1) - 1], 0)

    def first_at(self, ticks: IntArray) -> IntArray:
        """The first rows of ``all_of`` that are there at ticks ``(n,)`` of those that came last."""
        return self._buffer.seen_by(ticks)[0]

    @property
    def all_stamps_ns(self) -> IntArray:
        """``(n,)`` strictly ascending, those of later ticks too."""
        return self._buffer.all_stamps_ns

    @property
    def is_empty(self) -> bool:
        """Whether there is no sample, of no tick."""
        return len(self._buffer.all_stamps_ns) == 0

    def ages_s(self, stamps_ns: IntArray, found: Brackets) -> FloatArray:
        """Distances in time ``(n,)`` of stamps to the nearer of the samples around them."""
        before, after = found.ends(self._buffer.all_stamps_ns)
        return np.asarray(np.minimum(stamps_ns - before, after - stamps_ns) / SECOND_NS)

    def age_s(self, stamp_ns: int) -> float | None:
        """Distance in time to the nearest sample."""
        stamps = self._buffer.stamps_ns
        if len(stamps) == 0:
            return None
        after = int(np.searchsorted(stamps, stamp_ns))
        near = stamps[max(after - 1, 0) : after + 1]
        return float(np.min(np.abs(near - stamp_ns))) / SECOND_NS
