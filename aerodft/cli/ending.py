"""Signals that end long work do so between two batches: what they break off elsewhere may hold a lock."""

import signal
from collections.abc import Iterator
from types import FrameType

from aerodft.service import Batches, Feed


class Interruptible:
    """A feed that the first SIGINT or SIGTERM ends before the next batch; a second one is not waited for.

    Args:
        feed: What is read, in the main thread.
    """

    def __init__(self, feed: Feed) -> None:
        self._feed = feed

    def batches(self) -> Iterator[Batches]:
        """The feed's batches.

        Raises:
            BaseException: What the handler of the signal raises that came meanwhile.
        """
        return _until_asked(self._feed.batches())


def _until_asked(batches: Iterator[Batches]) -> Iterator[Batches]:
    """What comes before somebody asks for the end."""
    asked: list[tuple[int, FrameType | None]] = []

    def note(number: int, frame: FrameType | None) -> None:
        asked.append((number, frame))
        signal.signal(number, before[number])

    before = {int(each): signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        for number in before:
            signal.signal(number, note)
        for batch in batches:
            if asked:
                break
            yield batch
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    for number, frame in asked:
        ends = before[number]
        if callable(ends):
            ends(number, frame)
