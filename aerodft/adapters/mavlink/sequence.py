"""Frames that never came, told from the sequence numbers of those that did."""

from typing import Final

import numpy as np

from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.layout import V2_HEAD, Bytes
from aerodft.model.arrays import BoolArray, IntArray
from aerodft.model.health import LinkTrack
from aerodft.model.telemetry import NO_BOOT_TIME, RawBlock

_V1_SEQUENCE_AT, _V2_SEQUENCE_AT = 2, 4
_MODULUS: Final = 256
_TOGETHER: Final = 4096  # frames: after a counter that starts anew, the rest of them is looked at again
_WINDOW: Final = 64  # frames: what is that far behind is not late, but of a counter that started anew


class SequenceWatch:
    """Follows the autopilot's sequence numbers; one that is missing still is lost once 64 later ones were sent.

    A frame that is late, or comes twice, is no loss; nor is a counter that starts anew.
    """

    def __init__(self) -> None:
        self._last = self._top = 0  # without the wrap: of the frame before, and the highest so far
        self._came: BoolArray | None = None  # ``(_WINDOW,)`` which of the highest came, the last of them ``_top``

    def track(self, block: RawBlock, data: Bytes, heads: IntArray, state: IntArray) -> LinkTrack | None:
        """What was found to be lost at each of the autopilot's frames in a block.

        Args:
            block: The frames.
            data: Its bytes.
            heads: ``(5, n)`` from ``kernels.read_headers``.
            state: Of the selection, which knows the autopilot.

        Returns:
            None where the block has no frame of it.
        """
        if state[pick.COMPONENT] < 0:
            return None
        is_own = (heads[0] >= 0) & (heads[1] == state[pick.SYSTEM]) & (heads[2] == state[pick.COMPONENT])
        if not is_own.any():
            return None
        own = slice(None) if is_own.all() else np.flatnonzero(is_own)
        start, arrival_ns = block.offset[own], block.arrival_ns[own]
        at = start + np.where(heads[3, own] - start == V2_HEAD, _V2_SEQUENCE_AT, _V1_SEQUENCE_AT)
        boot_ns = np.full(len(start), NO_BOOT_TIME, dtype=np.int64)
        return LinkTrack(arrival_ns=arrival_ns, boot_ns=boot_ns, lost=self.lost(data[at]))

    def lost(self, sequence: Bytes) -> IntArray:
        """How many frames are known to be lost at each of the next ones, by their numbers ``(n,)``."""
        lost = np.zeros(len(sequence), dtype=np.int64)
        before = int(sequence[0]) - 1 if self._came is None else self._last
        steps = np.diff(sequence, prepend=np.uint8(before % _MODULUS))  # modulo 256
        if self._came is not None and before == self._top and self._came.all() and (steps == 1).all():
            self._last = self._top = before + len(sequence)  # as nearly always, and quickly
            return lost
        first, signed = 0, steps.view(np.int8)
        unwrapped = before + np.cumsum(signed, dtype=np.int64)
        self._last = int(unwrapped[-1])
        while first < len(sequence):
            if self._came is None:
                self._top, self._came = int(unwrapped[first]) - 1, np.ones(_WINDOW, dtype=np.bool_)
            part = slice(first, first + _TOGETHER)
            numbers = top = unwrapped[part]
            stop, is_anew = first + len(numbers), False
            if numbers[0] <= self._top or (signed[part][1:] <= 0).any():  # not one after the other
                top = np.maximum(np.maximum.accumulate(numbers), self._top)
                anew = np.flatnonzero(top - numbers >= _WINDOW)
                is_anew = len(anew) > 0
                stop = first + int(anew[0]) if is_anew else stop
            count = stop - first
            lost[first:stop] = self._passed(numbers[:count], top[:count], self._came)
            if is_anew:
                lost[stop] += np.count_nonzero(~self._came)
                self._came = None
            first = stop
        return lost

    def _passed(self, unwrapped: IntArray, top: IntArray, came: BoolArray) -> IntArray:
        """How many numbers leave the window at each frame without having come; none is behind it."""
        if not len(top):
            return top
        oldest = self._top - _WINDOW + 1
        self._top = int(top[-1])
        all_came = np.concatenate([came, np.zeros(self._top - oldest + 1 - _WINDOW, dtype=np.bool_)])
        all_came[unwrapped - oldest] = True
        self._came = all_came[-_WINDOW:]
        missing = oldest + np.flatnonzero(~all_came[:-_WINDOW])
        return np.bincount(np.searchsorted(top, missing + _WINDOW), minlength=len(top))
