"""A block of frames, cut by the ticks that they arrived in."""

import numpy as np

from aerodft.model.telemetry import RawBlock


class BlockParts:
    """A block cut into the parts of the ticks that its frames arrived in.

    Attributes:
        tick_ns: The tick of the next part; 0 behind the last.
        left: How many are left.
    """

    def __init__(self, block: RawBlock, tick_ns: int) -> None:
        ticks_ns = -(-block.arrival_ns // tick_ns) * tick_ns
        starts = np.flatnonzero(np.diff(ticks_ns, prepend=ticks_ns[0] - 1))
        self._block = block
        self._parts = zip(
            ticks_ns[starts].tolist(), starts.tolist(), [*starts[1:].tolist(), len(ticks_ns)], strict=True
        )
        self.left = len(starts)
        self.tick_ns, self._start, self._stop = next(self._parts)

    def pop(self) -> RawBlock:
        """The next part."""
        part = self._block.rows(self._start, self._stop)
        self.left -= 1
        self.tick_ns, self._start, self._stop = next(self._parts, (0, 0, 0))
        return part
