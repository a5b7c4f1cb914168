"""Signals that end long work do so between two batches: what they break off elsewhere may hold a lock."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

from aerodft.app import Progress

_WAKE_S: Final = 0.5


def wait_in_main_thread(done: threading.Event) -> None:
    """Wait until an event is set or the handler of a signal raises.

    Wakes twice a second: Python runs handlers in the main thread alone, which a signal that another thread receives, or
    that comes just before the wait begins, does not wake.
    """
    while not done.wait(_WAKE_S):
        pass


@contextmanager
def interruptible(progress: Progress) -> Iterator[Progress]:
    """A progress callback in which the first SIGINT or SIGTERM ends the work; a second one is not waited for.

    Signals are held back from the first call on, and as they were at the end; ignored ones stay ignored.

    Args:
        progress: Called in turn.

    Yields:
        What the work calls between two batches; it raises what the handler of the signal raises that came meanwhile.
    """
    handlers: dict[int, Callable[[int, FrameType | None], object]] = {}
    held: list[tuple[int, FrameType | None]] = []

    def hold(number: int, frame: FrameType | None) -> None:
        held.append((number, frame))
        signal.signal(number, handlers[number])

    def end() -> None:
        for number, frame in held:
            handlers[number](number, frame)

    def between_batches(done: int, total: int) -> None:
        if not handlers:
            for number in (signal.SIGINT, signal.SIGTERM):
                if callable(handler := signal.getsignal(number)):
                    handlers[number] = handler
                    signal.signal(number, hold)
        end()
        progress(done, total)

    try:
        yield between_batches
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    end()
