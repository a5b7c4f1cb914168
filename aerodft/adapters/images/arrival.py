"""A stream's own clock to the host's, by the images that were delayed least.

A stream says when an image was shown after the one before, exactly, but not what time it is; arrival says what time
it is, late by encoding, network and buffers. ``arrival - pts`` is that delay plus a constant, so its minimum over a
few seconds is the constant plus the smallest delay; the rest of the jitter is gone. The smallest delay itself cannot
be seen from here: it is what the configured time offset is for.
"""

from collections import deque

from aerodft.conventions import SECOND_NS

_WINDOW_NS = 5 * SECOND_NS
_JUMP_NS = SECOND_NS
_QUIET_NS = SECOND_NS // 2
_PATIENCE_NS = 2 * SECOND_NS
_IMPROVEMENT_NS = 2_000_000


class ArrivalClock:
    """Maps presentation stamps (ns, any zero) to the host's clock."""

    def __init__(self) -> None:
        self._minima: deque[tuple[int, int]] = deque()  # (arrival, delay); both increase
        self._last_pts_ns = 0
        self._last_arrival_ns = 0
        self._first_arrival_ns = 0
        self._improved_ns = 0
        self.resets = 0

    def observe(self, pts_ns: int, arrival_ns: int) -> None:
        """Take one packet into account.

        Args:
            pts_ns: Its presentation stamp; may step back a little where images are stored out of order.
            arrival_ns: Host UTC, not decreasing.
        """
        if self._minima and self._has_jumped(pts_ns, arrival_ns):
            self._minima.clear()
            self.resets += 1
        self._last_pts_ns, self._last_arrival_ns = pts_ns, arrival_ns
        delay_ns = arrival_ns - pts_ns
        if not self._minima:
            self._first_arrival_ns = self._improved_ns = arrival_ns
        elif delay_ns < self._minima[0][1] - _IMPROVEMENT_NS:
            self._improved_ns = arrival_ns
        while self._minima and self._minima[-1][1] >= delay_ns:
            self._minima.pop()
        self._minima.append((arrival_ns, delay_ns))
        while self._minima[0][0] < arrival_ns - _WINDOW_NS:
            self._minima.popleft()

    def _has_jumped(self, pts_ns: int, arrival_ns: int) -> bool:
        """Whether the sender started anew: its time went back, or on much farther than ours."""
        step_ns = pts_ns - self._last_pts_ns
        return step_ns < -_JUMP_NS or step_ns > arrival_ns - self._last_arrival_ns + _JUMP_NS

    @property
    def settled(self) -> bool:
        """Whether the least delay has stopped to improve; stamps before that would be late by a start-up burst."""
        if not self._minima:
            return False
        quiet = self._last_arrival_ns - self._improved_ns >= _QUIET_NS
        return quiet or self._last_arrival_ns - self._first_arrival_ns >= _PATIENCE_NS

    def stamp_ns(self, pts_ns: int) -> int:
        """Host UTC of a presentation stamp.

        Raises:
            ValueError: Nothing was observed yet.
        """
        if not self._minima:
            raise ValueError("no packet was observed yet")
        return pts_ns + self._minima[0][1]
