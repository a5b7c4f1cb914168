"""One source's reports of one camera's view around a stamp, and whether they are live at all."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.telemetry import CameraTrack
from aerodft.service.streams import Missing, Stream

_LATE: Final = 1.5  # periods that a report of a live source is waited for
_SAME: Final = 0.002  # focal lengths this close, as a share, are one: 32 bits bring them back with an error


@dataclass(frozen=True, slots=True)
class View:
    """What is reported of a focal length at a stamp.

    Attributes:
        value: The focal length, in the unit of the reports.
        jump_std: Standard deviation by not knowing when between two reports it changed.
        age_s: Since the newest report that is not after the stamp.
    """

    value: float
    jump_std: float
    age_s: float


class ViewReports:
    """Focal lengths ``(n,)`` as one source reports them, in a unit of its own.

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

    def append(self, track: CameraTrack, focal: FloatArray, stamps_ns: IntArray) -> None:
        """Take reports in: those of the stream that was heard first, or is asked for."""
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
        self.is_live = self.is_live or bool(np.any(np.abs(focal[known] - self._first) > _SAME * self._first))
        self.stream.append(stamps_ns[known], focal=focal[known])

    def at(self, stamp_ns: int, watermark_ns: int) -> View | Missing:
        """The focal length at a stamp: between two reports where they are near, else as last reported.

        A change between two reports may have been at any time: the mean of that is the line between them, and the
        variance that of a coin that falls as often as the stamp is past the change.
        """
        stamps = self.stream.stamps_ns
        if not len(stamps):
            return Missing.NEVER
        focal, after = self.stream.column("focal"), int(np.searchsorted(stamps, stamp_ns))
        if after == len(stamps) and self._awaited(watermark_ns):
            return Missing.PENDING
        if after < len(stamps) and int(stamps[after]) == stamp_ns:
            return View(float(focal[after]), 0.0, 0.0)
        if after == 0:
            return Missing.NEVER
        before_ns, value = int(stamps[after - 1]), float(focal[after - 1])
        age_s = (stamp_ns - before_ns) / SECOND_NS
        if after == len(stamps) or int(stamps[after]) - before_ns > self.stream.max_gap_ns:
            return View(value, 0.0, age_s)
        weight = (stamp_ns - before_ns) / (int(stamps[after]) - before_ns)
        change = float(focal[after]) - value
        return View(value + weight * change, abs(change) * math.sqrt(weight * (1 - weight)), age_s)

    def silent(self, age_s: float) -> bool:
        """Whether reports that came regularly have stopped."""
        return age_s > max(self.stream.max_gap_ns, 3 * self._period_ns()) / SECOND_NS and self._period_ns() > 0

    def _awaited(self, watermark_ns: int) -> bool:
        """Whether the next report is still due; of a source that speaks only when something changes none is."""
        period_ns = self._period_ns()
        last = self.stream.last_ns
        return last is not None and 0 < period_ns <= self.stream.max_gap_ns and watermark_ns - last <= _LATE * period_ns

    def _period_ns(self) -> int:
        """Between the last two reports; 0 before there are two."""
        stamps = self.stream.stamps_ns
        return int(stamps[-1] - stamps[-2]) if len(stamps) > 1 else 0
