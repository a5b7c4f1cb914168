"""Batches: all events that arrived within some ticks; helpers for single events and blocks of events."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.dft import NO_IMAGE
from aerodft.model import (
    Arrival,
    BoolArray,
    Image,
    ImageRows,
    IntArray,
    Observation,
    RawBlock,
    StampClock,
    concatenate_images,
)

_BLOCK_TYPES: Final = (RawBlock, ImageRows)
_MAX_FRAMES_PER_S: Final = 5000  # ten and more vehicles


def tick_after(arrival_ns: int, tick_ns: int) -> int:
    """Tick of an arrival: the first multiple of ``tick_ns`` not before it."""
    return -(-arrival_ns // tick_ns) * tick_ns


def first_arrival_ns(event: Arrival) -> int:
    """Arrival of an event; of a block, that of its first row."""
    return int(event.arrival_ns[0]) if isinstance(event, _BLOCK_TYPES) else event.arrival_ns


def arrivals_ns(events: Sequence[Arrival]) -> IntArray:
    """Arrivals ``(n,)`` of all rows of events, unsorted."""
    many = [event.arrival_ns for event in events if isinstance(event, _BLOCK_TYPES)]
    others = np.array([event.arrival_ns for event in events if not isinstance(event, _BLOCK_TYPES)], dtype=np.int64)
    return np.concatenate([*many, others])


def has_rows(event: Arrival) -> bool:
    """Whether the event has any rows."""
    return not isinstance(event, _BLOCK_TYPES) or len(event.arrival_ns) > 0


def workload(event: Arrival) -> int:
    """Number of images and observations in an event."""
    if isinstance(event, _BLOCK_TYPES):
        return len(event) if isinstance(event, ImageRows) else 0
    return 1


def cut_all(events: Sequence[Arrival], until_ns: int) -> tuple[list[Arrival], list[Arrival]]:
    """Parts of events that arrived by ``until_ns``, and the remaining parts."""
    parts = [cut(event, until_ns) for event in events]
    return [head for head, _ in parts if head is not None], [tail for _, tail in parts if tail is not None]


def cut(event: Arrival, until_ns: int) -> tuple[Arrival | None, Arrival | None]:
    """The part of an event that arrived by ``until_ns``, and the remaining part; None for an empty one."""
    if not isinstance(event, _BLOCK_TYPES):
        return (event, None) if event.arrival_ns <= until_ns else (None, event)
    count = len(event.arrival_ns)
    split = int(np.searchsorted(event.arrival_ns, until_ns, side="right"))
    if split == count:
        return event, None
    return (event.rows(slice(split)) if split else None), event.rows(slice(split, count))


class ArrivalLimiter:
    """Limits arrivals to as many frames a second as a link can carry.

    After a clock steps back by an hour arrivals stand still: otherwise that hour would be one tick, all in memory.
    """

    def __init__(self) -> None:
        self._last_ns = np.full(_MAX_FRAMES_PER_S, -SECOND_NS, dtype=np.int64)

    def limited(self, arrival_ns: IntArray) -> IntArray:
        """Limited arrivals ``(n,)``: not decreasing, also after those before, and none earlier than given."""
        limited_ns: IntArray = np.maximum(arrival_ns, self._last_ns[-1])
        for first in range(0, len(limited_ns), _MAX_FRAMES_PER_S):
            part = limited_ns[first : first + _MAX_FRAMES_PER_S]
            due_ns = np.maximum(part, self._last_ns[: len(part)] + SECOND_NS)
            part[:] = np.maximum.accumulate(np.maximum(due_ns, self._last_ns[-1]))
            self._last_ns = np.concatenate([self._last_ns[len(part) :], part])
        return limited_ns


@dataclass(frozen=True, kw_only=True, eq=False)
class Batches:
    """All events of ``n`` ticks, each kind in order of arrival.

    The pipeline's outputs depend on the ticks alone, not on how events are split into reads or ticks into batches: so a
    recomputed flight is byte-identical to the live one.

    Attributes:
        now_ns: ``(n,)`` ends of the ticks; the first tick has all that arrived before its end.
        raw: One block for each sender, in order of first arrival, then protocol and sender.
        images: Images of all ticks.
        observations: Observations of all ticks.
    """

    now_ns: IntArray
    raw: tuple[RawBlock, ...] = ()
    images: Sequence[Image] = ()
    observations: Sequence[Observation] = ()

    @staticmethod
    def from_events(now_ns: IntArray, events: Iterable[Arrival]) -> "Batches":
        """Batches from events of ticks that end at ``now_ns (n,)``; blocks of one sender become one block."""
        senders: dict[tuple[str, str], list[RawBlock]] = {}
        images: list[Image | ImageRows] = []
        observations: list[Observation] = []
        for event in events:
            if isinstance(event, RawBlock):
                senders.setdefault((event.protocol, event.sender), []).append(event)
            elif isinstance(event, (Image, ImageRows)):
                images.append(event)
            else:
                observations.append(event)
        raw = [concatenate_blocks(blocks) for blocks in senders.values()]
        return Batches(
            now_ns=now_ns,
            raw=tuple(sorted(raw, key=lambda block: (int(block.arrival_ns[0]), block.protocol, block.sender))),
            images=concatenate_images(images),
            observations=sorted(observations, key=lambda observation: observation.arrival_ns),
        )

    def __len__(self) -> int:
        return len(self.now_ns)

    def __getitem__(self, ticks: slice) -> "Batches":
        first, stop, _ = ticks.indices(len(self))
        if (first, stop) == (0, len(self)):
            return self
        earliest_ns = np.iinfo(np.int64).min if first == 0 else self.now_ns[first - 1]
        span_ns = earliest_ns, self.now_ns[stop - 1]
        blocks = [_rows_between(block, *span_ns) for block in self.raw]
        images, observations = (
            slice(*np.searchsorted(tick, (first, stop)).tolist()) for tick in (self.image_tick, self.observation_tick)
        )
        raw = sorted(
            (block for block in blocks if block is not None),
            key=lambda block: (int(block.arrival_ns[0]), block.protocol, block.sender),
        )
        return Batches(
            now_ns=self.now_ns[first:stop],
            raw=tuple(raw),
            images=self.images[images],
            observations=self.observations[observations],
        )

    @cached_property
    def image_arrival_ns(self) -> IntArray:
        """Arrivals ``(m,)`` of the images."""
        return _arrivals_ns(self.images)

    @cached_property
    def image_tick(self) -> IntArray:
        """Numbers ``(m,)`` of the ticks in which the images arrived."""
        return np.asarray(np.searchsorted(self.now_ns, self.image_arrival_ns))

    @cached_property
    def observation_tick(self) -> IntArray:
        """Numbers ``(k,)`` of the ticks in which the observations arrived."""
        return np.asarray(np.searchsorted(self.now_ns, _arrivals_ns(self.observations)))

    @property
    def event_count(self) -> int:
        """Number of frames, images and observations."""
        return sum(len(block.length) for block in self.raw) + len(self.images) + len(self.observations)


def concatenate_blocks(blocks: list[RawBlock]) -> RawBlock:
    """One block of all frames in one sender's blocks, in order of arrival."""
    if len(blocks) == 1:
        return blocks[0]
    data: list[bytes] = []
    offsets = []
    size = 0
    for _, shared in groupby(blocks, key=lambda block: id(block.data)):
        blocks_of_data = list(shared)
        offset = np.concatenate([block.offset for block in blocks_of_data])
        start = int(offset.min())
        stop = int((offset + np.concatenate([block.length for block in blocks_of_data])).max())
        data.append(blocks_of_data[0].data[start:stop])
        offsets.append(offset - start + size)
        size += stop - start
    arrival_ns = np.concatenate([block.arrival_ns for block in blocks])
    order = np.argsort(arrival_ns, kind="stable")
    return RawBlock(
        protocol=blocks[0].protocol,
        sender=blocks[0].sender,
        arrival_ns=arrival_ns[order],
        offset=np.concatenate(offsets)[order],
        length=np.concatenate([block.length for block in blocks])[order],
        data=b"".join(data),
        checked=all(block.checked for block in blocks),
    )


def stamps_of(events: Sequence[Image] | Sequence[Observation]) -> tuple[IntArray, BoolArray]:
    """Stamps ``(n,)`` by the events' own clocks, and whether these are UTC."""
    if isinstance(events, ImageRows):
        return events.stamp_ns, np.full(len(events), events.clock is StampClock.UTC)
    stamps_ns = np.array([event.stamp_ns for event in events], dtype=np.int64)
    return stamps_ns, np.array([event.clock is StampClock.UTC for event in events], dtype=np.bool_)


def numbers_of(images: Sequence[Image]) -> IntArray:
    """Running numbers ``(n,)`` of images; ``NO_IMAGE`` for a stamp without pixels."""
    if isinstance(images, ImageRows):
        return images.indices if images.width_px is not None else np.full(len(images), NO_IMAGE)
    numbers = [NO_IMAGE if image.width_px is None else image.index for image in images]
    return np.array(numbers, dtype=np.int64)


def _rows_between(block: RawBlock, after_ns: int, until_ns: int) -> RawBlock | None:
    """Rows of a block that arrived after ``after_ns`` and by ``until_ns``; None if there are none."""
    start, stop = np.searchsorted(block.arrival_ns, [after_ns, until_ns], side="right").tolist()
    return block.rows(slice(start, stop)) if stop > start else None


def _arrivals_ns(events: Sequence[Image] | Sequence[Observation]) -> IntArray:
    if isinstance(events, ImageRows):
        return events.arrival_ns
    return np.array([event.arrival_ns for event in events], dtype=np.int64)
