"""Live and recorded input as batches on one absolute grid of arrival times.

A batch holds the events with an arrival in ``(now_ns - tick, now_ns]``: per sender one block of frames, then images and
observations in order of arrival. Live and recorded input build it in the same way, so that the pipeline cannot tell
them apart.
"""

import heapq
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model.batch import Batch, Event
from aerodft.model.image import Image
from aerodft.model.observation import Observation
from aerodft.model.telemetry import RawBlock, WireProtocol
from aerodft.service.block_parts import BlockParts
from aerodft.service.ports import Clock, Source

_MOST_SUBJECTS: Final = 2048  # images at 60 Hz for half a minute


def tick_after(arrival_ns: int, tick_ns: int) -> int:
    """The tick that an arrival belongs to: the first multiple of ``tick_ns`` that is not before it."""
    return -(-arrival_ns // tick_ns) * tick_ns


def first_arrival_ns(event: Event) -> int:
    """Arrival of an event, for a block of its first frame."""
    return int(event.arrival_ns[0]) if isinstance(event, RawBlock) else event.arrival_ns


def block_of(protocol: WireProtocol, sender: str, arrivals_ns: Sequence[int], frames: Sequence[bytes]) -> RawBlock:
    """Build a block from whole frames and their arrivals (host UTC, not decreasing)."""
    length = np.fromiter(map(len, frames), dtype=np.int64, count=len(frames))
    offset = np.zeros_like(length)
    np.cumsum(length[:-1], out=offset[1:])
    return RawBlock(
        protocol=protocol,
        sender=sender,
        arrival_ns=np.array(arrivals_ns, dtype=np.int64),
        offset=offset,
        length=length,
        data=b"".join(frames),
    )


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


def batch_of(now_ns: int, events: Iterable[Event]) -> Batch:
    """Build the batch of one tick from its events, each kind in order of arrival.

    Blocks of one sender become one block; blocks stand in order of first arrival, then protocol and sender.
    """
    senders: dict[tuple[WireProtocol, str], list[RawBlock]] = {}
    images: list[Image] = []
    observations: list[Observation] = []
    for event in events:
        if isinstance(event, RawBlock):
            senders.setdefault((event.protocol, event.sender), []).append(event)
        elif isinstance(event, Image):
            images.append(event)
        else:
            observations.append(event)
    raw = [joined_blocks(blocks) for blocks in senders.values()]
    raw.sort(key=lambda block: (int(block.arrival_ns[0]), block.protocol, block.sender))
    images.sort(key=lambda image: image.arrival_ns)
    observations.sort(key=lambda observation: observation.arrival_ns)
    return Batch(now_ns=now_ns, raw=tuple(raw), images=tuple(images), observations=tuple(observations))


def _cut(event: Event, until_ns: int) -> tuple[Event | None, Event | None]:
    """The part of an event that arrived by ``until_ns``, and the rest."""
    if not isinstance(event, RawBlock):
        return (event, None) if event.arrival_ns <= until_ns else (None, event)
    count = len(event.arrival_ns)
    split = int(np.searchsorted(event.arrival_ns, until_ns, side="right"))
    if split == count:
        return event, None
    return (event.rows(0, split) if split else None), event.rows(split, count)


def together(batches: Iterable[Batch], longest_ns: int) -> Iterator[list[Batch]]:
    """Batches in groups that last up to ``longest_ns``, 0 for each alone; images with pixels never wait for others.

    Where many images or observations are to be answered a group ends earlier: all its answers are in memory at once.
    """
    group: list[Batch] = []
    subjects = 0
    for batch in batches:
        has_pixels = any(image.pixels is not None for image in batch.images)
        subjects += len(batch.images) + len(batch.observations)
        if group and (has_pixels or subjects > _MOST_SUBJECTS or batch.now_ns - group[0].now_ns >= longest_ns):
            yield group
            group, subjects = [], len(batch.images) + len(batch.observations)
        group.append(batch)
        if has_pixels or not longest_ns:
            yield group
            group, subjects = [], 0
    if group:
        yield group


class MergedFeed:
    """Recorded sources merged by arrival, as fast as the pipeline takes the batches.

    Ticks without events are skipped, except within ``linger_ns`` after the last event: there time alone matters,
    because an image that waits for telemetry is given up on a tick, with nothing arriving.

    Args:
        sources: Sources whose events come in order of (first) arrival.
        tick_ns: The grid.
        linger_ns: How long after an event empty batches still come.

    Raises:
        ValueError: From ``batches``: a source goes back to a tick that is over.
    """

    def __init__(self, sources: Iterable[Source], tick_ns: int, *, linger_ns: int = 2 * SECOND_NS) -> None:
        self._sources = tuple(sources)
        self._tick_ns = tick_ns
        self._linger_ns = linger_ns

    def batches(self) -> Iterator[Batch]:
        """Batches with increasing ``now_ns``, until every source has ended."""
        streams = (filter(_has_rows, source.events()) for source in self._sources)
        events = heapq.merge(*streams, key=first_arrival_ns)
        coming = next(events, None)
        begun: list[BlockParts] = []  # blocks of which only a part has been due
        now_ns: int | None = None
        while coming is not None or begun:
            ticks_ns = [parts.tick_ns for parts in begun]
            if coming is not None:
                ticks_ns.append(tick_after(first_arrival_ns(coming), self._tick_ns))
            tick_ns = min(ticks_ns)
            if now_ns is not None and tick_ns > now_ns + self._tick_ns:
                yield from self._lingering(now_ns, tick_ns)
            now_ns = tick_ns
            due: list[Event] = [parts.pop() for parts in begun if parts.tick_ns == now_ns]
            while coming is not None and (arrival_ns := first_arrival_ns(coming)) <= now_ns:
                if arrival_ns <= now_ns - self._tick_ns:
                    raise ValueError(f"arrival {arrival_ns} ns in tick {now_ns} ns, must not go back")
                if isinstance(coming, RawBlock):
                    begun.append(BlockParts(coming, self._tick_ns))
                    due.append(begun[-1].pop())
                else:
                    due.append(coming)
                coming = next(events, None)
            begun = [parts for parts in begun if parts.left]
            yield batch_of(now_ns, due)
        if now_ns is not None:
            yield from self._lingering(now_ns, now_ns + self._linger_ns + self._tick_ns)

    def _lingering(self, last_ns: int, before_ns: int) -> Iterator[Batch]:
        """The empty batches between two ticks."""
        stop_ns = min(before_ns, last_ns + self._linger_ns + 1)
        for now_ns in range(last_ns + self._tick_ns, stop_ns, self._tick_ns):
            yield Batch(now_ns=now_ns)


def _has_rows(event: Event) -> bool:
    return not isinstance(event, RawBlock) or len(event.arrival_ns) > 0


class Inbox:
    """Where the threads of live adapters leave what they received; stamps every event with its arrival.

    Arrivals are strictly increasing over all events and never fall into a tick that was taken. When images come faster
    than they are taken the oldest are dropped and counted; telemetry and observations never are.
    """

    def __init__(self, clock: Clock, *, max_images: int = 8) -> None:
        self._clock = clock
        self._max_images = max_images
        self._lock = threading.Lock()
        self._last_ns = 0
        self._events: deque[Event] = deque()
        self._images: deque[Image] = deque()
        self._dropped_images = 0

    @property
    def dropped_images(self) -> int:
        """Images dropped since the start."""
        return self._dropped_images

    def put_frames(self, protocol: WireProtocol, sender: str, frames: Sequence[bytes]) -> None:
        """Leave whole frames, in the order in which they were received."""
        if not frames:
            return
        block = block_of(protocol, sender, range(len(frames)), frames)
        with self._lock:
            first_ns = self._stamp(len(frames))
            self._events.append(replace(block, arrival_ns=block.arrival_ns + first_ns))

    def put_image(self, image: Image) -> None:
        """Leave an image; its arrival is replaced, its stamp kept."""
        with self._lock:
            self._images.append(replace(image, arrival_ns=self._stamp(1)))
            if len(self._images) > self._max_images:
                self._images.popleft()
                self._dropped_images += 1

    def put_observation(self, observation: Observation) -> None:
        """Leave an observation; its arrival is replaced, its stamp kept."""
        self.put_observations((observation,))

    def put_observations(self, observations: Sequence[Observation]) -> None:
        """Leave what was seen in one image, in this order; arrivals are replaced, stamps kept."""
        with self._lock:
            self._events.extend(replace(each, arrival_ns=self._stamp(1)) for each in observations)

    def take(self, until_ns: int) -> Batch:
        """Take all that arrived by ``until_ns``; what comes later is stamped later."""
        due: list[Event] = []
        with self._lock:
            self._last_ns = max(self._last_ns, until_ns)
            while self._events:
                head, tail = _cut(self._events[0], until_ns)
                if head is not None:
                    due.append(head)
                if tail is not None:
                    self._events[0] = tail
                    break
                self._events.popleft()
            while self._images and self._images[0].arrival_ns <= until_ns:
                due.append(self._images.popleft())
        return batch_of(until_ns, due)

    def _stamp(self, count: int) -> int:
        """Reserve ``count`` arrivals, one nanosecond apart; returns the first."""
        first_ns = max(self._clock.now_ns(), self._last_ns + 1)
        self._last_ns = first_ns + count - 1
        return first_ns


class LiveFeed:
    """What is in an inbox, as one batch a tick, empty ones included."""

    def __init__(self, inbox: Inbox, clock: Clock, tick_ns: int) -> None:
        self._inbox = inbox
        self._clock = clock
        self._tick_ns = tick_ns
        self._stopping = threading.Event()
        self._last_ns = 0

    def batches(self) -> Iterator[Batch]:
        """Batches, each at its tick or later where the reader is late, until ``stop``."""
        now_ns = tick_after(self._clock.now_ns(), self._tick_ns)
        while True:
            self._clock.sleep_until(now_ns)
            stopping = self._stopping.is_set()
            yield self._inbox.take(now_ns)
            if stopping and now_ns >= self._last_ns:
                return
            now_ns += self._tick_ns

    def stop(self) -> None:
        """End once all that has arrived is taken, at least one more batch; from any thread or signal handler."""
        if not self._stopping.is_set():
            self._last_ns = self._clock.now_ns() + self._tick_ns  # what is just being read comes along
            self._stopping.set()
