"""A worker thread behind a bounded queue: the caller never waits, unless the queue is lossless."""

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

T = TypeVar("T")
_PERIOD_S: Final = 0.1

_log = logging.getLogger(__name__)


class WorkerQueue(Generic[T]):
    """Does work in the order in which it was put.

    Args:
        name: Of the thread.
        work: Does one item, in the worker's thread.
        capacity: Sum of the sizes of waiting items; one item is always taken.
        tend: Called in the worker's thread after each item, and at least every 0.1 s.
        lossless: Wait for room instead of refusing; an item takes room until it is done, then.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[T], None],
        *,
        capacity: int,
        tend: Callable[[], object] = lambda: None,
        lossless: bool = False,
    ) -> None:
        self._work = work
        self._tend = tend
        self._capacity = capacity
        self._lossless = lossless
        self._size_at_work = 0
        self._items: deque[tuple[T, int]] = deque()
        self._size = 0
        self._closing = False
        self._waiting_callers = 0
        self._error: Exception | None = None
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, item: T, size: int = 1) -> bool:
        """Hand over an item; False where there was no room (or the worker's thread has died)."""
        with self._changed:
            while self._lossless and self._is_full(size) and self._error is None:
                self._waiting_callers += 1
                self._changed.wait()
                self._waiting_callers -= 1
            if self._is_full(size) or self._error is not None:
                return False
            self._items.append((item, size))
            self._size += size
            self._changed.notify_all()
            return True

    def close(self) -> None:
        """Do what is left, and end the thread.

        Raises:
            Exception: What ``work`` or ``tend`` raised, if anything.
        """
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _is_full(self, size: int) -> bool:
        occupied = self._size + self._size_at_work
        return occupied > 0 and occupied + size > self._capacity

    def _run(self) -> None:
        try:
            while self._wait():
                if self._items:
                    self._work(self._next())
                    self._free_room()
                self._tend()
        except Exception as error:  # noqa: BLE001 - close raises it, in the thread that can report it
            _log.error("%s ended early: %r", self._thread.name, error)
            with self._changed:
                self._error = error
                self._items.clear()
                self._changed.notify_all()

    def _wait(self) -> bool:
        """Wait for an item, or until ``tend`` is due; False at the end."""
        with self._changed:
            if not self._items and not self._closing:
                self._changed.wait(_PERIOD_S)
            return bool(self._items) or not self._closing

    def _next(self) -> T:
        with self._changed:
            item, size = self._items.popleft()
            self._size -= size
            self._size_at_work = size if self._lossless else 0
            self._changed.notify_all()
            return item

    def _free_room(self) -> None:
        with self._changed:
            self._size_at_work = 0
            self._changed.notify_all()
