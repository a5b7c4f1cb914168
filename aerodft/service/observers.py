"""Images to observations: what observers see, inline over recorded input and beside the ticks over live input.

Either way observations are input like any other: they are recorded, and a flight that is computed anew starts from
them, without looking at an image again.
"""

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

from aerodft.conventions import SECOND_NS
from aerodft.errors import AerodftError
from aerodft.model import Event, Image, Observation
from aerodft.service.ports import ImageObserver, Source

_SLACK = 0.9  # of the period: a camera at exactly the rate jitters around it

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ObserverSchedule:
    """An observer, and how often it looks.

    Attributes:
        observer: What it looks for.
        every_s: Least time between two images that it is shown, by their stamps; 0 for all of them.
    """

    observer: ImageObserver
    every_s: float = 0.0


@dataclass(slots=True)
class ObserverCounts:
    """What became of the images that were due.

    Attributes:
        looked: Looked at.
        skipped: Left out for a newer one, because the look before it took too long.
        unreadable: Without pixels that could be decoded.
    """

    looked: int = 0
    skipped: int = 0
    unreadable: int = 0


class _ScheduledObserver:
    """An observer, when it looked last, and what became of the images that were due."""

    def __init__(self, schedule: ObserverSchedule) -> None:
        self.counts = ObserverCounts()
        self._observer = schedule.observer
        self._period_ns = round(_SLACK * schedule.every_s * SECOND_NS)
        self._last_ns: int | None = None

    def is_due(self, image: Image) -> bool:
        """Whether the image is to be looked at; stamps that go back begin anew."""
        if image.pixels is None:
            return False
        last_ns = self._last_ns
        if last_ns is not None and last_ns <= image.stamp_ns < last_ns + self._period_ns:
            return False
        self._last_ns = image.stamp_ns
        return True

    def look(self, image: Image) -> tuple[Observation, ...]:
        """What is seen; nothing in an image that cannot be read."""
        try:
            seen = self._observer.observe(image)
        except AerodftError as error:
            if not self.counts.unreadable:
                _log.warning("image %d is not looked at: %s", image.index, error)
            self.counts.unreadable += 1
            return ()
        self.counts.looked += 1
        return seen


class ObservedImages:
    """A recorded source, with what observers see in its images right behind each of them."""

    def __init__(self, source: Source, schedules: Sequence[ObserverSchedule]) -> None:
        self._source = source
        self._scheduled = [_ScheduledObserver(schedule) for schedule in schedules]

    @property
    def counts(self) -> tuple[ObserverCounts, ...]:
        """So far, one for each observer."""
        return tuple(scheduled.counts for scheduled in self._scheduled)

    def events(self) -> Iterator[Event]:
        """The source's events; an observation arrives with its image."""
        for event in self._source.events():
            yield event
            if isinstance(event, Image):
                for scheduled in self._scheduled:
                    if scheduled.is_due(event):
                        yield from (replace(each, arrival_ns=event.arrival_ns) for each in scheduled.look(event))


class LiveObservers:
    """Shows live images to observers, each in a thread of its own that never holds up who brings them.

    While an observer looks at one image only the newest of the others waits for it.

    Args:
        schedules: Who looks.
        on_seen: Takes what is seen in one image, from several threads; must not block.
    """

    def __init__(
        self, schedules: Sequence[ObserverSchedule], on_seen: Callable[[tuple[Observation, ...]], None]
    ) -> None:
        self._threads = [_ObserverThread(schedule, on_seen) for schedule in schedules]

    @property
    def counts(self) -> tuple[ObserverCounts, ...]:
        """So far, one for each observer."""
        return tuple(thread.counts for thread in self._threads)

    def __call__(self, image: Image) -> None:
        """Show an image."""
        for thread in self._threads:
            thread.show(image)

    def stop(self) -> None:
        """End after the look under way; what waits is not looked at.

        Raises:
            Exception: What an observer raised beside ``AerodftError``; it has looked at nothing since.
        """
        for thread in self._threads:
            thread.end()
        for thread in self._threads:
            thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


class _ObserverThread:
    """One observer and its thread."""

    def __init__(self, schedule: ObserverSchedule, on_seen: Callable[[tuple[Observation, ...]], None]) -> None:
        self._scheduled = _ScheduledObserver(schedule)
        self._on_seen = on_seen
        self._changed = threading.Condition()
        self._next: Image | None = None
        self._ending = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="image-observer", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> ObserverCounts:
        return self._scheduled.counts

    def show(self, image: Image) -> None:
        with self._changed:
            if self._ending or not self._scheduled.is_due(image):
                return
            self.counts.skipped += self._next is not None
            self._next = image
            self._changed.notify()

    def end(self) -> None:
        with self._changed:
            self._ending, self._next = True, None
            self._changed.notify()

    def join(self) -> None:
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            while (image := self._take()) is not None:
                if seen := self._scheduled.look(image):
                    self._on_seen(seen)
        except Exception as error:  # noqa: BLE001 - join raises it, in the thread that can report it
            _log.error("an image observer ended early: %r", error)
            with self._changed:
                self._error, self._ending, self._next = error, True, None

    def _take(self) -> Image | None:
        """The newest image that is due; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._next is not None or self._ending)
            image, self._next = self._next, None
            return image
