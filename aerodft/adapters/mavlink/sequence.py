"""Frames that never came, told from the sequence numbers of those that did."""

from typing import Final

import numpy as np

from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.layout import V1, Bytes
from aerodft.model.arrays import BoolArray, IntArray
from aerodft.model.health import LinkTrack
from aerodft.model.telemetry import NO_BOOT_TIME, RawBlock

_V1_SEQUENCE_AT, _V2_SEQUENCE_AT = 2, 4
_MODULUS: Final = 256
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
        own = np.flatnonzero((heads[0] >= 0) & (heads[1] == state[pick.SYSTEM]) & (heads[2] == state[pick.COMPONENT]))
        if not len(own):
            return None
        start = block.offset[own]
        sequence = data[start + np.where(data[start] == V1, _V1_SEQUENCE_AT, _V2_SEQUENCE_AT)].astype(np.int64)
        return LinkTrack(
            arrival_ns=block.arrival_ns[own],
            boot_ns=np.full(len(own), NO_BOOT_TIME, dtype=np.int64),
            lost=self.lost(sequence),
        )

    def lost(self, sequence: IntArray) -> IntArray:
        """How many frames are known to be lost at each of the next ones, by their numbers ``(n,)``."""
        lost = np.zeros_like(sequence)
        before = int(sequence[0]) - 1 if self._came is None else self._last
        in_turn = np.arange(before + 1, before + 1 + len(sequence))
        if (
            self._came is not None
            and before == self._top
            and self._came.all()
            and not np.any((sequence - in_turn) % _MODULUS)
        ):
            self._last = self._top = int(in_turn[-1])  # as nearly always, and quickly
            return lost
        half, first = _MODULUS // 2, 0
        unwrapped = before + np.cumsum((np.diff(sequence, prepend=before) + half) % _MODULUS - half)
        self._last = int(unwrapped[-1])
        while first < len(sequence):
            if self._came is None:
                self._top, self._came = int(unwrapped[first]) - 1, np.ones(_WINDOW, dtype=np.bool_)
            top = np.maximum(np.maximum.accumulate(unwrapped[first:]), self._top)
            anew = np.flatnonzero(top - unwrapped[first:] >= _WINDOW)
            stop = first + int(anew[0]) if len(anew) else len(sequence)
            lost[first:stop] = self._passed(unwrapped[first:stop], top[: stop - first], self._came)
            if len(anew):
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
