"""The two clocks behind the ``Clock`` port: the wall's, and one that recorded input drives."""

import threading
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


class VirtualClock:
    """A clock that stands still until somebody sleeps on it or sets it; safe to share between threads."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns
        self._lock = threading.Lock()

    def now_ns(self) -> int:
        """The time that was last reached."""
        return self._now_ns

    def sleep_until(self, when_ns: int) -> None:
        """Move the time to ``when_ns`` at once; it never moves back."""
        with self._lock:
            self._now_ns = max(self._now_ns, when_ns)
