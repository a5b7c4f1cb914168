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
from itertools import islice
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import Arrival, Image, IntArray, Observation, RawBlock
from aerodft.service.batches import Batches, arrivals_ns, cut, cut_all, first_arrival_ns, is_any, subjects, tick_after
from aerodft.service.ports import Clock, GatheredSource, Source

LONGEST_SPAN_NS: Final = 32 * SECOND_NS
"""Recorded input comes in batches of so many ticks."""

_MOST_SUBJECTS: Final = 2048  # images at 60 Hz for half a minute
_MOST_FRAMES: Final = 50_000  # four minutes of a link's


def block_of(protocol: str, sender: str, arrivals_ns: Sequence[int], frames: Sequence[bytes]) -> RawBlock:
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


class MergedFeed:
    """Recorded sources merged by arrival, as fast as the pipeline takes the batches.

    Ticks without events are skipped, except within ``idle_ticks_ns`` after the last event: there time alone matters,
    because an image that waits for telemetry is given up on a tick, with nothing arriving.

    Args:
        sources: Sources whose events come in order of (first) arrival.
        tick_ns: The grid.
        linger_ns: How long after an event empty ticks still come.
        longest_ns: Ticks that come together at most; 0 for one by one.

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
        self._linger_ns = idle_ticks_ns
        self._longest_ns = longest_ns // tick_ns * tick_ns

    def batches(self) -> Iterator[Batches]:
        """Batches of increasing ticks, until every source has ended; but images with pixels never wait for others.

        Where many images or observations are to be answered a batch ends earlier: its answers are in memory at once.

        Raises:
            ValueError: A source goes back to a tick that is over.
        """
        streams = (filter(is_any, _read(source)) for source in self._sources)
        events = Peekable(heapq.merge(*streams, key=first_arrival_ns))
        begun: list[Arrival] = []  # of which only a part has been due
        last_ns: int | None = None
        while begun or events.next is not None:
            coming = begun if events.next is None else [*begun, events.next]
            first_ns = tick_after(min(map(first_arrival_ns, coming)), self._tick_ns)
            end_ns = self._collected(events, begun, first_ns, first_ns + self._longest_ns)
            due, begun = cut_all(begun, end_ns)
            ticks_ns = np.unique(-(-arrivals_ns(due) // self._tick_ns)) * self._tick_ns
            yield Batches.of(self._with_idle_ticks(last_ns, ticks_ns), due)
            last_ns = int(ticks_ns[-1])
        if last_ns is not None:
            lingering = self._tick_ns * np.arange(1, self._linger_ns // self._tick_ns + 1)
            if len(lingering):
                yield Batches.of(last_ns + lingering, ())

    def _collected(self, events: "Peekable", begun: list[Arrival], first_ns: int, end_ns: int) -> int:
        """Add to ``begun`` what comes in ticks up to ``end_ns``, or to an earlier one, which is given back."""
        count, frames = sum(map(subjects, begun)), 0
        while events.next is not None:
            arrival_ns = first_arrival_ns(events.next)
            if arrival_ns > end_ns:
                break
            if arrival_ns <= first_ns - self._tick_ns:
                raise ValueError(f"arrival {arrival_ns} ns in tick {first_ns} ns, must not go back")
            if isinstance(events.next, RawBlock):
                frames += len(events.next.arrival_ns)
                tick_ns = tick_after(arrival_ns, self._tick_ns)
                if frames > _MOST_FRAMES and tick_ns > first_ns:
                    return tick_ns - self._tick_ns
            else:
                count += subjects(events.next)
                has_pixels = isinstance(events.next, Image) and events.next.pixels is not None
                if has_pixels or count > _MOST_SUBJECTS:
                    tick_ns = tick_after(arrival_ns, self._tick_ns)
                    if tick_ns > first_ns:
                        return tick_ns - self._tick_ns
                    end_ns = first_ns if has_pixels else end_ns
            begun.append(events.pop())
        return end_ns

    def _with_idle_ticks(self, last_ns: int | None, ticks_ns: IntArray) -> IntArray:
        """Ticks with the empty ones that come before each of them, after the last tick before all of them."""
        before_ns = np.concatenate([[ticks_ns[0] if last_ns is None else last_ns], ticks_ns[:-1]])
        empty = np.minimum((ticks_ns - before_ns) // self._tick_ns - 1, self._linger_ns // self._tick_ns)
        late = [before_ns[k] + self._tick_ns * np.arange(1, empty[k] + 1) for k in np.flatnonzero(empty > 0).tolist()]
        return np.sort(np.concatenate([ticks_ns, *late]))


class Peekable:
    """Events of which the next one can be looked at.

    Attributes:
        next: It; None at the end.
    """

    def __init__(self, events: Iterator[Arrival]) -> None:
        self._events = events
        self.next = next(events, None)

    def pop(self) -> Arrival:
        """Take it."""
        taken, self.next = self.next, next(self._events, None)
        assert taken is not None  # noqa: S101 - the callers' own condition, for the type checker
        return taken


def _read(source: Source) -> Iterator[Arrival]:
    return source.gathered() if isinstance(source, GatheredSource) else source.events()


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
        self._events: deque[Arrival] = deque()
        self._images: deque[Image] = deque()
        self._dropped_images = 0

    @property
    def dropped_images(self) -> int:
        """Images dropped since the start."""
        return self._dropped_images

    @property
    def oldest_ns(self) -> int | None:
        """The first arrival of all that waits; None where nothing does."""
        with self._lock:
            firsts = [first_arrival_ns(each) for each in (*islice(self._events, 1), *islice(self._images, 1))]
        return min(firsts, default=None)

    def put_frames(self, protocol: str, sender: str, frames: Sequence[bytes]) -> None:
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

    def take(self, until_ns: int) -> Batches:
        """Take all that arrived by ``until_ns``; what comes later is stamped later."""
        due: list[Arrival] = []
        with self._lock:
            self._last_ns = max(self._last_ns, until_ns)
            while self._events:
                head, tail = cut(self._events[0], until_ns)
                if head is not None:
                    due.append(head)
                if tail is not None:
                    self._events[0] = tail
                    break
                self._events.popleft()
            while self._images and self._images[0].arrival_ns <= until_ns:
                due.append(self._images.popleft())
        return Batches.of(np.array([until_ns]), due)

    def _stamp(self, count: int) -> int:
        """Reserve ``count`` arrivals, one nanosecond apart; returns the first."""
        first_ns = max(self._clock.now_ns(), self._last_ns + 1)
        self._last_ns = first_ns + count - 1
        return first_ns


class LiveFeed:
    """What is in an inbox, tick by tick, empty ones included."""

    def __init__(self, inbox: Inbox, clock: Clock, tick_ns: int) -> None:
        self._inbox = inbox
        self._clock = clock
        self._tick_ns = tick_ns
        self._stopping = threading.Event()
        self._last_ns = 0

    def batches(self) -> Iterator[Batches]:
        """Batches of one tick, each at its tick or later where the reader is late, until ``stop``.

        The first is that of what waits: links may be open long before, and a recording of it begins there as well.
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
        """End once all that has arrived is taken, at least one more batch; from any thread or signal handler."""
        if not self._stopping.is_set():
            self._last_ns = self._clock.now_ns() + self._tick_ns  # what is just being read comes along
            self._stopping.set()
