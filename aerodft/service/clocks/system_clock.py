"""The clock behind the ``Clock`` port."""

import time


class WallClock:
    """Host UTC that never steps: read once, then carried on by the monotonic clock.

    A step of the system clock (first time synchronisation after boot) would otherwise stop the ticks, or skip some.
    """

    def __init__(self) -> None:
        self._epoch_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Host UTC, never decreasing."""
        return self._epoch_ns + time.monotonic_ns()

    def sleep_until(self, when_ns: int) -> None:
        """Return at ``when_ns`` or later."""
        while (rest_ns := when_ns - self.now_ns()) > 0:
            time.sleep(rest_ns / 1e9)
