"""One source's reports of one camera's view around a stamp, and whether they are live at all."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.telemetry import CameraTrack
from aerodft.service.streams import Missing, Stream

_LATE: Final = 1.5  # periods that a report of a live source is waited for
_SAME: Final = 0.002  # focal lengths this close, as a share, are one: 32 bits bring them back with an error


@dataclass(frozen=True, slots=True, eq=False)
class ViewBatch:
    """What is reported of a focal length at ``n`` stamps; NaN where there is nothing.

    Attributes:
        value: ``(n,)`` the focal length, in the unit of the reports.
        jump_std: ``(n,)`` standard deviation by not knowing when between two reports it changed.
        age_s: ``(n,)`` since the newest report that is not after the stamp.
        is_silent: ``(n,)`` whether reports that came regularly have stopped.
        missing: ``(n,)`` why there is none, as ``Missing``.
    """

    value: FloatArray
    jump_std: FloatArray
    age_s: FloatArray
    is_silent: BoolArray
    missing: IntArray


class ViewReports:
    """Focal lengths as one source reports them, in a unit of its own.

    Attributes:
        is_live: Whether a report has differed from the first: a parameter that somebody typed in does not.
        size_px: Width and height of the images as last reported; None where they never were.
    """

    def __init__(self, max_gap_ns: int, stream: int | None) -> None:
        self.is_live = False
        self.size_px: tuple[int, int] | None = None
        self._number = stream
        self._first: float | None = None
        self.stream = Stream(max_gap_ns)

    def changes_nothing(self, track: CameraTrack, focal: FloatArray) -> bool:
        """Whether reports of several ticks may be appended at once: what is known for good stays as it is."""
        own = track.stream == self._number
        sizes = track.size_px[own & np.all(track.size_px > 0, axis=-1)]
        if self._number is None or self._first is None or np.any(sizes != self.size_px):
            return False
        return self.is_live or not self._has_changed(focal[own & np.isfinite(focal)])

    def append(
        self, track: CameraTrack, focal: FloatArray, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None
    ) -> None:
        """Take in the reports of a step: those of the stream that was heard first, or is asked for."""
        if self._number is None and len(track.stream):
            self._number = int(track.stream[0])
        own = track.stream == self._number
        sized = own & np.all(track.size_px > 0, axis=-1)
        if np.any(sized):
            width, height = track.size_px[np.flatnonzero(sized)[-1]].tolist()
            self.size_px = (width, height)
        known = own & np.isfinite(focal)
        if not np.any(known):
            return
        if self._first is None:
            self._first = float(focal[known][0])
        self.is_live = self.is_live or self._has_changed(focal[known])
        ends = None if row_end_by_tick is None else np.concatenate([[0], np.cumsum(known)])[row_end_by_tick]
        self.stream.append(stamps_ns[known], ends, focal=focal[known])

    def at(self, stamps_ns: IntArray, ticks: IntArray, watermark_ns: IntArray) -> ViewBatch:
        """Focal lengths at stamps ``(n,)``: between two reports where they are near, else as last reported.

        A change between two reports may have been at any time: the mean of that is the line between them, and the
        variance that of a coin that falls as often as the stamp is past the change. Arguments as in ``Stream.find``.
        """
        nothing = np.full(len(stamps_ns), np.nan)
        if self.stream.is_empty:
            never = np.full(len(stamps_ns), int(Missing.NEVER))
            return ViewBatch(nothing, nothing, nothing, np.full(len(stamps_ns), fill_value=False), never)
        samples_ns, focal = self.stream.stamps_ns, self.stream.column("focal")
        first, end = self.stream.rows_known_at(ticks)
        period_ns = self._period_ns(first, end)
        before = self.stream.last_before(stamps_ns, ticks)
        after = np.minimum(before + 1, np.maximum(end - 1, 0))
        is_last = before + 1 >= end
        gap_ns = samples_ns[after] - samples_ns[before]
        is_between = ~is_last & (before >= 0) & (gap_ns <= self.stream.max_gap_ns)
        weight = np.where(is_between, (stamps_ns - samples_ns[before]) / np.maximum(gap_ns, 1), 0.0)
        change = np.where(is_between, focal[after] - focal[before], 0.0)
        age_s = (stamps_ns - samples_ns[before]) / SECOND_NS
        is_regular = (period_ns > 0) & (period_ns <= self.stream.max_gap_ns)
        newest_ns = samples_ns[np.maximum(end, 1) - 1]
        waits = is_last & (newest_ns < stamps_ns) & is_regular & (watermark_ns - newest_ns <= _LATE * period_ns)
        missing = np.where(end == first, Missing.NEVER, np.where(waits, Missing.PENDING, Missing.NO))
        missing = np.where((before < 0) & ~waits, Missing.NEVER, missing)
        is_silent = (period_ns > 0) & (age_s > np.maximum(self.stream.max_gap_ns, 3 * period_ns) / SECOND_NS)
        jump_std = np.abs(change) * np.sqrt(weight * (1 - weight))
        return ViewBatch(focal[before] + weight * change, jump_std, age_s, is_silent, missing)

    def _has_changed(self, focal: FloatArray) -> bool:
        return self._first is not None and bool(np.any(np.abs(focal - self._first) > _SAME * self._first))

    def _period_ns(self, first: IntArray, end: IntArray) -> IntArray:
        """Between the last two reports before rows ``end (n,)``; 0 before there are two."""
        samples_ns = self.stream.stamps_ns
        last, earlier = np.maximum(end - 1, 0), np.maximum(end - 2, 0)
        return np.where(end - first > 1, samples_ns[last] - samples_ns[earlier], 0)
