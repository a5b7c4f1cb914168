"""One address of several from which frames with the followed autopilot's ids come: vehicles may have the same ids."""

from collections import Counter
from dataclasses import replace
from typing import Final

import numpy as np

from aerodft.adapters.mavlink import selection as pick
from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import IntArray
from aerodft.model.telemetry import RawBlock

OF_ANOTHER_ADDRESS: Final = "frames: with the autopilot's ids, from another address"
_SILENCE_NS: Final = SECOND_NS  # of the followed address, before another one is taken for its successor


class OneAddress:
    """Leaves out what a second address says in the name of the autopilot, while the first goes on.

    Addresses that follow each other are one sender: a bridge that reconnects, or that opens a port for every datagram
    and so never speaks twice from the same. A gimbal or a camera may have an address of its own.
    """

    def __init__(self) -> None:
        self._followed: str | None = None
        self._last_ns = 0
        self._spoke_again = False

    def kept(
        self, block: RawBlock, heads: IntArray, state: IntArray, rejected: Counter[str]
    ) -> tuple[RawBlock, IntArray]:
        """A block and its headers ``(5, n)``, without what is of somebody else.

        Args:
            block: Frames of one sender.
            heads: From ``kernels.read_headers``.
            state: Of the selection, which knows the autopilot.
            rejected: Counts what is left out.
        """
        if state[pick.COMPONENT] < 0:
            return block, heads
        own = (heads[0] >= 0) & (heads[1] == state[pick.SYSTEM]) & (heads[2] == state[pick.COMPONENT])
        if not own.any() or self._admits(block.sender, block.arrival_ns[own]):
            return block, heads
        rejected[f"{OF_ANOTHER_ADDRESS} than {self._followed}"] += int(own.sum())
        rows = {name: getattr(block, name)[~own] for name in ("arrival_ns", "offset", "length")}
        return replace(block, **rows), np.ascontiguousarray(heads[:, ~own])

    def _admits(self, sender: str, arrival_ns: IntArray) -> bool:
        if sender == self._followed:
            self._spoke_again = True
        elif self._spoke_again and int(arrival_ns[0]) - self._last_ns <= _SILENCE_NS:
            return False
        else:
            self._followed, self._spoke_again = sender, False
        self._last_ns = int(arrival_ns[-1])
        return True
