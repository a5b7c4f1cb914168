"""Some ticks' events together: what came is cut by ticks only where somebody asks for a single one."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, pairwise
from typing import TypeVar, overload

import numpy as np

from aerodft.model.arrays import IntArray
from aerodft.model.batch import Arrival, Batch
from aerodft.model.image import Image
from aerodft.model.image_rows import ImageRows, joined_images
from aerodft.model.observation import Observation
from aerodft.model.telemetry import RawBlock, WireProtocol

Happened = TypeVar("Happened", Image, Observation)


@dataclass(frozen=True, kw_only=True, eq=False)
class Batches(Sequence[Batch]):
    """All events of ``n`` ticks, one after the other, each kind in order of arrival.

    Attributes:
        now_ns: ``(n,)`` when the ticks end.
        raw: One block for each sender.
        images: Images of all ticks.
        observations: Observations likewise.
    """

    now_ns: IntArray
    raw: tuple[RawBlock, ...]
    images: Sequence[Image]
    observations: Sequence[Observation]

    @staticmethod
    def of(batches: Sequence[Batch]) -> "Batches":
        """Batches as one."""
        if isinstance(batches, Batches):
            return batches
        events: list[Arrival] = []
        for batch in batches:
            events += (*batch.raw, *batch.images, *batch.observations)
        return Batches.from_events(np.array([batch.now_ns for batch in batches], dtype=np.int64), events)

    @staticmethod
    def from_events(now_ns: IntArray, events: Iterable[Arrival]) -> "Batches":
        """Events of ticks that end at ``now_ns (n,)``."""
        raw, images, observations = by_kind(events)
        return Batches(now_ns=now_ns, raw=tuple(raw), images=images, observations=observations)

    def __len__(self) -> int:
        return len(self.now_ns)

    @overload
    def __getitem__(self, index: int) -> Batch: ...

    @overload
    def __getitem__(self, index: slice) -> "Batches": ...

    def __getitem__(self, index: int | slice) -> "Batch | Batches":
        if isinstance(index, int):
            return self._each[index]
        if index == slice(0, None):
            return self
        first, stop, _ = index.indices(len(self))
        edges_ns = self._edges_ns()[[first, stop]]
        raw = [each for block in self.raw for each in _parts(block, edges_ns) if each is not None]
        images = self.images[slice(*np.searchsorted(self.image_tick, (first, stop)).tolist())]
        observations = self.observations[slice(*np.searchsorted(self.observation_tick, (first, stop)).tolist())]
        return Batches(now_ns=self.now_ns[first:stop], raw=tuple(raw), images=images, observations=observations)

    def __iter__(self) -> Iterator[Batch]:
        edges_ns = self._edges_ns()
        raw = zip(*(_parts(block, edges_ns) for block in self.raw), strict=True) if self.raw else [()] * len(self)
        images, observations = _cut(self.images, edges_ns), _cut(self.observations, edges_ns)
        for now_ns, blocks, seen, found in zip(self.now_ns.tolist(), raw, images, observations, strict=True):
            yield one_batch(now_ns, [block for block in blocks if block is not None], seen, found)

    @cached_property
    def _each(self) -> list[Batch]:
        return list(self)

    @cached_property
    def image_arrival_ns(self) -> IntArray:
        """``(m,)`` of the images."""
        return _arrivals_ns(self.images)

    @cached_property
    def image_tick(self) -> IntArray:
        """Number of the tick ``(m,)`` in which each of the images arrived."""
        return np.asarray(np.searchsorted(self.now_ns, self.image_arrival_ns))

    @cached_property
    def observation_tick(self) -> IntArray:
        """The same of the observations."""
        return np.asarray(np.searchsorted(self.now_ns, _arrivals_ns(self.observations)))

    @property
    def event_count(self) -> int:
        """How many events, each frame of its own."""
        return sum(len(block.length) for block in self.raw) + len(self.images) + len(self.observations)

    def _edges_ns(self) -> IntArray:
        """``(n + 1,)`` times between which the events of each tick came; all that came early is the first's."""
        return np.concatenate([[np.iinfo(np.int64).min], self.now_ns])


def by_kind(events: Iterable[Arrival]) -> tuple[list[RawBlock], Sequence[Image], list[Observation]]:
    """Events each kind in order of arrival, and those of one sender as one block."""
    senders: dict[tuple[WireProtocol, str], list[RawBlock]] = {}
    images: list[Image | ImageRows] = []
    observations: list[Observation] = []
    for event in events:
        if isinstance(event, RawBlock):
            senders.setdefault((event.protocol, event.sender), []).append(event)
        elif isinstance(event, (Image, ImageRows)):
            images.append(event)
        else:
            observations.append(event)
    observations.sort(key=lambda observation: observation.arrival_ns)
    return [joined_blocks(blocks) for blocks in senders.values()], joined_images(images), observations


def one_batch(now_ns: int, raw: list[RawBlock], images: Sequence[Image], observations: Sequence[Observation]) -> Batch:
    """The batch of one tick; blocks stand in order of first arrival, then protocol and sender."""
    raw.sort(key=lambda block: (int(block.arrival_ns[0]), block.protocol, block.sender))
    return Batch(now_ns=now_ns, raw=tuple(raw), images=tuple(images), observations=tuple(observations))


def joined_blocks(blocks: list[RawBlock]) -> RawBlock:
    """One block of all frames of one sender's blocks, in order of arrival."""
    if len(blocks) == 1:
        return blocks[0]
    data: list[bytes] = []
    offsets = []
    size = 0
    for _, shared in groupby(blocks, key=lambda block: id(block.data)):
        own = list(shared)
        offset = np.concatenate([block.offset for block in own])
        start = int(offset.min())
        stop = int((offset + np.concatenate([block.length for block in own])).max())
        data.append(own[0].data[start:stop])
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


def _parts(block: RawBlock, edges_ns: IntArray) -> list[RawBlock | None]:
    """The parts of a block that arrived between every two of some times; None where there was nothing."""
    edges = np.searchsorted(block.arrival_ns, edges_ns, side="right").tolist()
    return [block.rows(start, stop) if stop > start else None for start, stop in pairwise(edges)]


def _cut(events: Sequence[Happened], edges_ns: IntArray) -> list[Sequence[Happened]]:
    """Images or observations likewise."""
    edges = np.searchsorted(_arrivals_ns(events), edges_ns, side="right").tolist()
    return [events[start:stop] for start, stop in pairwise(edges)]


def _arrivals_ns(events: Sequence[Image] | Sequence[Observation]) -> IntArray:
    if isinstance(events, ImageRows):
        return events.arrival_ns
    return np.array([event.arrival_ns for event in events], dtype=np.int64)
