"""Waiting for the disk in a thread of its own, so that who writes goes on meanwhile."""

import time
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress

from aerodft.adapters.mcap.segment import Segment

SYNC_S = 1.0
_MUCH_BYTES = 8 << 20  # chunks that the disk may not have are kept: of a flight computed again 30 MB a second


class Syncing:
    """Syncs one segment at a time.

    Args:
        stem: What the thread is called after.
    """

    def __init__(self, stem: str) -> None:
        self._began_s = time.monotonic()  # of the last sync; before that of this
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix=f"sync-{stem}")
        self._running: tuple[Future[None], int, int] | None = None

    def begin_where_due(self, segment: Segment) -> None:
        """Sync a segment where it is time, or much of it is not synced yet, unless the last sync still goes on."""
        now_s = time.monotonic()
        is_due = now_s >= self._began_s + SYNC_S or segment.unsynced_bytes > _MUCH_BYTES
        if is_due and self._running is None:
            self._began_s = now_s
            self._running = (self._thread.submit(segment.sync), *segment.place)

    def ended(self, *, wait: bool) -> tuple[int, int] | None:
        """What a sync that has ended since the last call has synced, as ``Segment.place`` said it; else None.

        Args:
            wait: Whether to wait for one that goes on.

        Raises:
            OSError: It failed.
        """
        if self._running is None:
            return None
        future, chunks, size = self._running
        if not (wait or future.done()):
            return None
        self._running = None
        future.result()
        return chunks, size

    def give_up(self) -> None:
        """Wait for a sync that goes on, whatever becomes of it."""
        with suppress(OSError):  # one failure is enough
            self.ended(wait=True)

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown()
