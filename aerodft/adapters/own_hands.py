"""Work that the caller does: where there is one processor, a thread would only take turns with who waits for it."""

import os
import time
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class OwnHands(Generic[T]):
    """As a lossless ``Lane``, without its thread: items are done when there are enough of them, or it is time.

    Args:
        work: Does some items.
        tend: Called after that, at least every ``period_s`` as long as items come.
        enough: Sum of the sizes of items that are worth a call.
        period_s: Seconds that items wait for others.
    """

    def __init__(
        self, work: Callable[[list[T]], None], tend: Callable[[], None], *, enough: int, period_s: float = 0.1
    ) -> None:
        self._work = work
        self._tend = tend
        self._enough = enough
        self._period_s = period_s
        self._items: list[T] = []
        self._size = 0
        self._done_s = time.monotonic()

    def put(self, item: T, size: int = 1) -> bool:
        """Take an item; True, as there is always room.

        Raises:
            Exception: What ``work`` or ``tend`` raised, if anything.
        """
        self._items.append(item)
        self._size += size
        if self._size >= self._enough or time.monotonic() >= self._done_s + self._period_s:
            self._do()
        return True

    def close(self) -> None:
        """Do what is left.

        Raises:
            Exception: As ``put``.
        """
        self._do()

    def _do(self) -> None:
        items, self._items, self._size = self._items, [], 0
        if items:
            self._work(items)
        self._tend()
        self._done_s = time.monotonic()


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
