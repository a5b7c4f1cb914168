"""Feeds: live and recorded input as batches on one absolute grid of arrival times.

A batch holds the events with an arrival in ``(now_ns - tick, now_ns]``: per sender one block of frames, then images and
observations in order of arrival, for live and recorded input alike.
"""

import heapq
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import Arrival, Image, IntArray, Observation, RawBlock
from aerodft.service.batches import Batches, arrivals_ns, cut, cut_all, first_arrival_ns, has_rows, tick_after, workload
from aerodft.service.ports import Clock, GatheredSource, Source

LONGEST_SPAN_NS: Final = 32 * SECOND_NS
"""Longest span of one batch of recorded input."""

_MAX_SUBJECTS: Final = 2048  # images at 60 Hz for half a minute
_MAX_FRAMES: Final = 50_000  # four minutes of a link


def block_of(protocol: str, sender: str, arrivals_ns: Sequence[int], frames: Sequence[bytes]) -> RawBlock:
    """A block from whole frames and their arrivals (host UTC, not decreasing)."""
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


class MergedFeed:
    """Recorded sources merged by arrival, as fast as batches are taken.

    Ticks without events are skipped, except within ``idle_ticks_ns`` after an event: the deadline of an image that
    waits for telemetry may be there.

    Args:
        sources: Sources with events in order of (first) arrival.
        tick_ns: Step of the grid.
        idle_ticks_ns: Span of empty ticks after an event.
        longest_ns: Longest span of a batch; 0 for one tick each.

    Raises:
        ValueError: From ``batches``: a source goes back to a tick that is over.
    """

    def __init__(
        self,
        sources: Iterable[Source],
        tick_ns: int,
        *,
        idle_ticks_ns: int = 2 * SECOND_NS,
        longest_ns: int = LONGEST_SPAN_NS,
    ) -> None:
        self._sources = tuple(sources)
        self._tick_ns = tick_ns
        self._idle_ns = idle_ticks_ns
        self._longest_ns = longest_ns // tick_ns * tick_ns

    def batches(self) -> Iterator[Batches]:
        """Batches of increasing ticks, until every source has ended.

        A batch ends early at an image with pixels, and at many images or observations: its outputs are all in memory.

        Raises:
            ValueError: A source goes back to a tick that is over.
        """
        streams = (filter(has_rows, _read(source)) for source in self._sources)
        events = Peekable(heapq.merge(*streams, key=first_arrival_ns))
        pending: list[Arrival] = []  # rests of events that were cut
        last_ns: int | None = None
        while pending or events.next is not None:
            upcoming = pending if events.next is None else [*pending, events.next]
            first_ns = tick_after(min(map(first_arrival_ns, upcoming)), self._tick_ns)
            end_ns = self._collect(events, pending, first_ns, first_ns + self._longest_ns)
            due, pending = cut_all(pending, end_ns)
            ticks_ns = np.unique(-(-arrivals_ns(due) // self._tick_ns)) * self._tick_ns
            yield Batches.from_events(self._with_idle_ticks(last_ns, ticks_ns), due)
            last_ns = int(ticks_ns[-1])
        if last_ns is not None:
            idle_ns = self._tick_ns * np.arange(1, self._idle_ns // self._tick_ns + 1)
            if len(idle_ns):
                yield Batches.from_events(last_ns + idle_ns, ())

    def _collect(self, events: "Peekable", pending: list[Arrival], first_ns: int, end_ns: int) -> int:
        """Add events of ticks up to ``end_ns`` to ``pending``; returns the end, earlier where the batch is full."""
        count, frames = sum(map(workload, pending)), 0
        while events.next is not None:
            arrival_ns = first_arrival_ns(events.next)
            if arrival_ns > end_ns:
                break
            if arrival_ns <= first_ns - self._tick_ns:
                raise ValueError(f"arrival {arrival_ns} ns in tick {first_ns} ns, must not go back")
            if isinstance(events.next, RawBlock):
                frames += len(events.next.arrival_ns)
                tick_ns = tick_after(arrival_ns, self._tick_ns)
                if frames > _MAX_FRAMES and tick_ns > first_ns:
                    return tick_ns - self._tick_ns
            else:
                count += workload(events.next)
                has_pixels = isinstance(events.next, Image) and events.next.pixels is not None
                if has_pixels or count > _MAX_SUBJECTS:
                    tick_ns = tick_after(arrival_ns, self._tick_ns)
                    if tick_ns > first_ns:
                        return tick_ns - self._tick_ns
                    end_ns = first_ns if has_pixels else end_ns
            pending.append(events.pop())
        return end_ns

    def _with_idle_ticks(self, last_ns: int | None, ticks_ns: IntArray) -> IntArray:
        """Ticks, with empty ticks before each of them, after ``last_ns`` before the first."""
        before_ns = np.concatenate([[ticks_ns[0] if last_ns is None else last_ns], ticks_ns[:-1]])
        empty = np.minimum((ticks_ns - before_ns) // self._tick_ns - 1, self._idle_ns // self._tick_ns)
        late = [before_ns[k] + self._tick_ns * np.arange(1, empty[k] + 1) for k in np.flatnonzero(empty > 0).tolist()]
        return np.sort(np.concatenate([ticks_ns, *late]))


class Peekable:
    """Iterator of events whose next one can be inspected.

    Attributes:
        next: The next event; None at the end.
    """

    def __init__(self, events: Iterator[Arrival]) -> None:
        self._events = events
        self.next = next(events, None)

    def pop(self) -> Arrival:
        """Remove and return the next event."""
        event, self.next = self.next, next(self._events, None)
        assert event is not None  # noqa: S101 - the callers' own condition, for the type checker
        return event


def _read(source: Source) -> Iterator[Arrival]:
    return source.gathered() if isinstance(source, GatheredSource) else source.events()


class Inbox:
    """Thread-safe queue of events from live adapters; stamps every event with its arrival.

    Arrivals are strictly increasing over all events and never in a tick already taken. Images beyond ``max_images``
    drop the oldest, which are counted; telemetry and observations are never dropped.
    """

    def __init__(self, clock: Clock, *, max_images: int = 8) -> None:
        self._clock = clock
        self._max_images = max_images
        self._lock = threading.Lock()
        self._last_ns = 0
        self._events: deque[Arrival] = deque()
        self._images: deque[Image] = deque()
        self._dropped_images = 0

    @property
    def dropped_images(self) -> int:
        """Number of images dropped since the start."""
        return self._dropped_images

    @property
    def oldest_ns(self) -> int | None:
        """Arrival of the oldest waiting event; None if empty."""
        with self._lock:
            firsts = [first_arrival_ns(each) for each in (*islice(self._events, 1), *islice(self._images, 1))]
        return min(firsts, default=None)

    def put_frames(self, protocol: str, sender: str, frames: Sequence[bytes]) -> None:
        """Append whole frames in the order in which they were received."""
        if not frames:
            return
        block = block_of(protocol, sender, range(len(frames)), frames)
        with self._lock:
            first_ns = self._stamp(len(frames))
            self._events.append(replace(block, arrival_ns=block.arrival_ns + first_ns))

    def put_image(self, image: Image) -> None:
        """Append an image; its arrival is replaced, its stamp kept."""
        with self._lock:
            self._images.append(replace(image, arrival_ns=self._stamp(1)))
            if len(self._images) > self._max_images:
                self._images.popleft()
                self._dropped_images += 1

    def put_observation(self, observation: Observation) -> None:
        """Append an observation; its arrival is replaced, its stamp kept."""
        self.put_observations((observation,))

    def put_observations(self, observations: Sequence[Observation]) -> None:
        """Append observations of one image in order; arrivals are replaced, stamps kept."""
        with self._lock:
            self._events.extend(replace(each, arrival_ns=self._stamp(1)) for each in observations)

    def take(self, until_ns: int) -> Batches:
        """Remove and return all that arrived by ``until_ns``; later events get later arrivals."""
        arrived: list[Arrival] = []
        with self._lock:
            self._last_ns = max(self._last_ns, until_ns)
            while self._events:
                head, tail = cut(self._events[0], until_ns)
                if head is not None:
                    arrived.append(head)
                if tail is not None:
                    self._events[0] = tail
                    break
                self._events.popleft()
            while self._images and self._images[0].arrival_ns <= until_ns:
                arrived.append(self._images.popleft())
        return Batches.from_events(np.array([until_ns]), arrived)

    def _stamp(self, count: int) -> int:
        """Reserve ``count`` arrivals, one nanosecond apart; returns the first."""
        first_ns = max(self._clock.now_ns(), self._last_ns + 1)
        self._last_ns = first_ns + count - 1
        return first_ns


class LiveFeed:
    """Batches of an inbox, tick by tick, empty ticks included."""

    def __init__(self, inbox: Inbox, clock: Clock, tick_ns: int) -> None:
        self._inbox = inbox
        self._clock = clock
        self._tick_ns = tick_ns
        self._stopping = threading.Event()
        self._last_ns = 0

    def batches(self) -> Iterator[Batches]:
        """Batches of one tick, each at its tick or later if the reader is late, until ``stop``.

        The first one is of the oldest waiting event: links may have been open long before, as in a recording.
        """
        now_ns = tick_after(self._clock.now_ns(), self._tick_ns)
        oldest_ns = self._inbox.oldest_ns
        if oldest_ns is not None:
            now_ns = min(now_ns, tick_after(oldest_ns, self._tick_ns))
        while True:
            self._clock.sleep_until(now_ns)
            stopping = self._stopping.is_set()
            yield self._inbox.take(now_ns)
            if stopping and now_ns >= self._last_ns:
                return
            now_ns += self._tick_ns

    def stop(self) -> None:
        """End after all that has arrived is taken, at least one more batch; from any thread or signal handler."""
        if not self._stopping.is_set():
            self._last_ns = self._clock.now_ns() + self._tick_ns  # what is just being read comes along
            self._stopping.set()
