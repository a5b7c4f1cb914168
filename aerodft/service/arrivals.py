"""When events arrive, whether they come one by one or many as one; and what of them has arrived by some time."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import Arrival, ImageRows, IntArray, RawBlock

_MANY: Final = (RawBlock, ImageRows)
_MOST_FRAMES: Final = 5000  # a second: ten and more vehicles


def first_arrival_ns(event: Arrival) -> int:
    """Arrival of an event, for a block of its first frame, and of many images likewise."""
    return int(event.arrival_ns[0]) if isinstance(event, _MANY) else event.arrival_ns


def arrivals_ns(events: Sequence[Arrival]) -> IntArray:
    """All arrivals among some events ``(n,)``, in no order."""
    many = [event.arrival_ns for event in events if isinstance(event, _MANY)]
    others = np.array([event.arrival_ns for event in events if not isinstance(event, _MANY)], dtype=np.int64)
    return np.concatenate([*many, others])


def is_any(event: Arrival) -> bool:
    """Whether it is not a block of nothing."""
    return not isinstance(event, _MANY) or len(event.arrival_ns) > 0


def subjects(event: Arrival) -> int:
    """How many images and observations it is."""
    if isinstance(event, _MANY):
        return len(event) if isinstance(event, ImageRows) else 0
    return 1


def cut_all(events: Sequence[Arrival], until_ns: int) -> tuple[list[Arrival], list[Arrival]]:
    """What arrived by ``until_ns``, and the rest."""
    parts = [cut(event, until_ns) for event in events]
    return [head for head, _ in parts if head is not None], [tail for _, tail in parts if tail is not None]


def cut(event: Arrival, until_ns: int) -> tuple[Arrival | None, Arrival | None]:
    """The part of an event that arrived by ``until_ns``, and the rest."""
    if not isinstance(event, _MANY):
        return (event, None) if event.arrival_ns <= until_ns else (None, event)
    count = len(event.arrival_ns)
    split = int(np.searchsorted(event.arrival_ns, until_ns, side="right"))
    if split == count:
        return event, None
    return (event.rows(0, split) if split else None), event.rows(split, count)


class ArrivalLimiter:
    """Arrivals of a link's frames, no more of them in a second than a link gives.

    Where a clock steps back by an hour the arrival is held: all of that hour would be in one tick, and in memory.
    """

    def __init__(self) -> None:
        self._last_ns = np.full(_MOST_FRAMES, -SECOND_NS, dtype=np.int64)

    def kept(self, arrival_ns: IntArray) -> IntArray:
        """Arrivals ``(n,)`` that follow those before, none earlier than given, and not decreasing."""
        kept_ns: IntArray = np.maximum(arrival_ns, self._last_ns[-1])
        for first in range(0, len(kept_ns), _MOST_FRAMES):
            part = kept_ns[first : first + _MOST_FRAMES]
            due_ns = np.maximum(part, self._last_ns[: len(part)] + SECOND_NS)
            part[:] = np.maximum.accumulate(np.maximum(due_ns, self._last_ns[-1]))
            self._last_ns = np.concatenate([self._last_ns[len(part) :], part])
        return kept_ns
