"""A worker thread behind a bounded queue: the caller never waits, unless it asked for a lossless lane."""

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_log = logging.getLogger(__name__)


class Lane(Generic[T]):
    """Does work in the order in which it was put.

    Args:
        name: Of the thread.
        work: Does some items, in the lane's thread.
        tend: Called in the lane's thread at least every ``period_s``.
        capacity: Sum of the sizes of waiting items; one item is always taken.
        lossless: Wait for room instead of refusing, which what is done one by one takes until it is done; up to
            ``period_s`` for more to do at once, too.
        period_s: Seconds between two calls of ``tend`` when nothing comes.
        at_once: Items that are done together where so many wait.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[list[T]], None],
        tend: Callable[[], None],
        *,
        capacity: int,
        lossless: bool = False,
        period_s: float = 0.1,
        at_once: int = 1,
    ) -> None:
        self._work = work
        self._tend = tend
        self._capacity = capacity
        self._lossless = lossless
        self._period_s = period_s
        self._at_once = at_once
        self._counts_work = lossless and at_once == 1
        self._in_work = 0
        self._items: deque[tuple[T, int]] = deque()
        self._size = 0
        self._closing = self._is_asleep = False
        self._held_up = 0  # callers that wait for room
        self._error: Exception | None = None
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, item: T, size: int = 1) -> bool:
        """Hand over an item; False where there was no room (or the lane's thread has died)."""
        with self._changed:
            while self._lossless and self._is_full(size) and self._error is None:
                self._held_up += 1
                self._changed.notify_all()
                self._changed.wait()
                self._held_up -= 1
            if self._is_full(size) or self._error is not None:
                return False
            self._items.append((item, size))
            self._size += size
            if self._is_asleep and self._has_enough():  # waking it costs more than the item
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

    def _has_enough(self) -> bool:
        """Whether there is enough to begin with: where nobody waits for an answer, a few items wait for others."""
        may_wait = self._lossless and self._at_once > 1 and not self._held_up
        return bool(self._items) and not (may_wait and self._size < self._capacity // 2)

    def _is_full(self, size: int) -> bool:
        taken = self._size + self._in_work
        return taken > 0 and taken + size > self._capacity

    def _run(self) -> None:
        try:
            while (items := self._next()) is not None:
                if items:
                    self._work(items)
                    del items  # they may be large
                    self._has_worked()
                self._tend()
        except Exception as error:  # noqa: BLE001 - close raises it, in the thread that can report it
            _log.error("%s ended early: %r", self._thread.name, error)
            with self._changed:
                self._error = error
                self._items.clear()
                self._changed.notify_all()

    def _has_worked(self) -> None:
        if self._in_work:
            with self._changed:
                self._in_work = 0
                if self._held_up:
                    self._changed.notify_all()

    def _next(self) -> list[T] | None:
        """The next items; none when ``tend`` is due; None at the end."""
        with self._changed:
            if not self._has_enough() and not self._closing:
                self._is_asleep = True
                self._changed.wait(self._period_s)
                self._is_asleep = False
            if self._items:
                taken = [self._items.popleft() for _ in range(min(len(self._items), self._at_once))]
                size = sum(size for _, size in taken)
                self._size -= size
                self._in_work = size if self._counts_work else 0
                if self._held_up:
                    self._changed.notify_all()
                return [item for item, _ in taken]
            return None if self._closing else []
