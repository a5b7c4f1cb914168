"""Frames that never came, told from the sequence numbers of those that did."""

from typing import Final

import numpy as np

from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.layout import Bytes
from aerodft.model.arrays import IntArray
from aerodft.model.health import LinkTrack
from aerodft.model.telemetry import NO_BOOT_TIME, RawBlock

_V1: Final = 0xFE
_V1_SEQUENCE_AT, _V2_SEQUENCE_AT = 2, 4
_MODULUS: Final = 256


class SequenceWatch:
    """Follows the autopilot's sequence numbers; a step back (a late frame, or one that came twice) is no loss."""

    def __init__(self) -> None:
        self._last: int | None = None

    def track(self, block: RawBlock, data: Bytes, heads: IntArray, state: IntArray) -> LinkTrack | None:
        """What is missing before each of the autopilot's frames in a block.

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
        sequence = data[start + np.where(data[start] == _V1, _V1_SEQUENCE_AT, _V2_SEQUENCE_AT)].astype(np.int64)
        missing = (np.diff(sequence, prepend=self._before(sequence)) - 1) % _MODULUS
        self._last = int(sequence[-1])
        return LinkTrack(
            arrival_ns=block.arrival_ns[own],
            boot_ns=np.full(len(own), NO_BOOT_TIME, dtype=np.int64),
            lost=np.where(missing < _MODULUS // 2, missing, 0),
        )

    def _before(self, sequence: IntArray) -> int:
        return int(sequence[0]) - 1 if self._last is None else self._last
