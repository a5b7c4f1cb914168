"""A clock that a test drives."""

import threading


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
