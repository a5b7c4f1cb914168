"""Images that come in ticks that are taken in together, and which of these ticks can be answered as columns."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from aerodft.model.arrays import IntArray
from aerodft.model.image import Image, StampClock
from aerodft.model.image_rows import ImageRows
from aerodft.model.pose_columns import PoseRows
from aerodft.service.batches import Batches, Happened
from aerodft.service.timing import ClockMap
from aerodft.service.waiting import Job


class Coming(NamedTuple):
    """The images of some ticks, in their order.

    Attributes:
        images: They.
        tick: ``(n,)`` in which each comes.
        stamps_ns: ``(n,)`` theirs in UTC, as it is known then.
        seen: ``(m, 2)`` stamps and ticks of what is observed.
    """

    images: Sequence[Image]
    tick: IntArray
    stamps_ns: IntArray
    seen: IntArray

    @staticmethod
    def of(batches: Batches, clock: ClockMap) -> "Coming":
        """What comes in batches that were taken in."""
        images, seen = batches.images, batches.observations
        seen_ns = _in_utc(seen, batches.observation_tick, clock)
        stamps_ns = _in_utc(images, batches.image_tick, clock)
        return Coming(images, batches.image_tick, stamps_ns, np.stack([seen_ns, batches.observation_tick], axis=-1))

    def between(self, first: int, stop: int) -> slice:
        """Which come in the ticks from ``first`` and before ``stop``."""
        return slice(*np.searchsorted(self.tick, (first, stop)).tolist())

    def asked(self, waiting: Iterable[Job]) -> IntArray:
        """What ``PoseSource.prepare`` takes for all that comes, and for what waits already: stamps and ticks."""
        earlier = np.array([(job.stamp_ns, 0) for job in waiting], dtype=np.int64).reshape(-1, 2)
        return np.concatenate([earlier, np.stack([self.stamps_ns, self.tick], axis=-1), self.seen])

    def odd_ticks(self, batches: Batches, poses: PoseRows | None, wait_ns: int, tick_ns: int) -> IntArray:
        """The ticks ``(m,)`` that cannot be answered as columns, and behind them the end.

        Args:
            batches: The ticks.
            poses: Those that are ready, -1 for each that is not.
            wait_ns: What poses may be waited for.
            tick_ns: Between two ticks.
        """
        is_odd = np.zeros(len(batches) + 1, dtype=np.bool_)
        is_odd[batches.observation_tick] = is_odd[-1] = True
        if poses is not None:
            is_last = -(-(batches.image_arrival_ns + wait_ns) // tick_ns) * tick_ns <= batches.now_ns[self.tick]
            is_odd[self.tick[(poses.rows < 0) | is_last]] = True
        return np.flatnonzero(is_odd)


def _in_utc(events: Sequence[Happened], ticks: IntArray, clock: ClockMap) -> IntArray:
    """UTC of stamps ``(n,)``, as it was known at each event's tick."""
    if isinstance(events, ImageRows):
        stamps_ns, is_utc = events.stamp_ns.copy(), np.full(len(events), events.clock is StampClock.UTC)
    else:
        stamps_ns = np.array([event.stamp_ns for event in events], dtype=np.int64)
        is_utc = np.array([event.clock is StampClock.UTC for event in events], dtype=np.bool_)
    by_host = np.flatnonzero(~is_utc)
    stamps_ns[by_host] = clock.hosts_to_utc(stamps_ns[by_host], ticks[by_host])
    return stamps_ns
