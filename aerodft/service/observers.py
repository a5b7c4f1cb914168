"""Detectors bound to images: inline for recorded input, in threads of their own for live input.

Observations are recorded as input in both cases; a recompute starts from them and detects nothing again.
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

_STOP_S = 10.0  # an image may take a river's network some seconds on a small computer
_PERIOD_TOLERANCE = 0.9  # of the period: a camera at exactly the rate jitters around it

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ObserverSchedule:
    """An observer and its rate.

    Attributes:
        observer: The observer.
        every_s: Shortest time between two of its images, by their stamps; 0 for all images.
    """

    observer: ImageObserver
    every_s: float = 0.0


@dataclass(slots=True)
class ObserverCounts:
    """Numbers of images processed and missed by an observer.

    Attributes:
        looked: Images processed.
        skipped: Images replaced by a newer one while the observer was busy.
        unreadable: Images whose pixels could not be decoded.
    """

    looked: int = 0
    skipped: int = 0
    unreadable: int = 0


class _ScheduledObserver:
    """An observer with the stamp of its last image and its counts."""

    def __init__(self, schedule: ObserverSchedule) -> None:
        self.counts = ObserverCounts()
        self._observer = schedule.observer
        self._period_ns = round(_PERIOD_TOLERANCE * schedule.every_s * SECOND_NS)
        self._last_ns: int | None = None

    def is_due(self, image: Image) -> bool:
        """Whether the image is to be processed; the schedule restarts when stamps go back."""
        if image.pixels is None:
            return False
        last_ns = self._last_ns
        if last_ns is not None and last_ns <= image.stamp_ns < last_ns + self._period_ns:
            return False
        self._last_ns = image.stamp_ns
        return True

    def look(self, image: Image) -> tuple[Observation, ...]:
        """Observations in an image; none in an unreadable one."""
        try:
            observations = self._observer.observe(image)
        except AerodftError as error:
            if not self.counts.unreadable:
                _log.warning("image %d is not looked at: %s", image.index, error)
            self.counts.unreadable += 1
            return ()
        self.counts.looked += 1
        return observations


class ObservedImages:
    """A recorded source with observations inserted after each image."""

    def __init__(self, source: Source, schedules: Sequence[ObserverSchedule]) -> None:
        self._source = source
        self._scheduled = [_ScheduledObserver(schedule) for schedule in schedules]

    @property
    def counts(self) -> tuple[ObserverCounts, ...]:
        """Counts of each observer."""
        return tuple(scheduled.counts for scheduled in self._scheduled)

    def events(self) -> Iterator[Event]:
        """The source's events with observations, which arrive with their image."""
        for event in self._source.events():
            yield event
            if isinstance(event, Image):
                for scheduled in self._scheduled:
                    if scheduled.is_due(event):
                        yield from (replace(each, arrival_ns=event.arrival_ns) for each in scheduled.look(event))


class LiveObservers:
    """Passes live images to observers in threads of their own, without blocking the caller.

    While an observer is busy only the newest image waits for it.

    Args:
        schedules: The observers.
        on_seen: Called with the observations in one image, from several threads; must not block.
    """

    def __init__(
        self, schedules: Sequence[ObserverSchedule], on_seen: Callable[[tuple[Observation, ...]], None]
    ) -> None:
        self._threads = [_ObserverThread(schedule, on_seen) for schedule in schedules]

    @property
    def counts(self) -> tuple[ObserverCounts, ...]:
        """Counts of each observer."""
        return tuple(thread.counts for thread in self._threads)

    def __call__(self, image: Image) -> None:
        """Pass an image to all observers."""
        for thread in self._threads:
            thread.show(image)

    def stop(self) -> None:
        """End after the images being processed; waiting images are dropped.

        Raises:
            Exception: Raised by an observer, other than ``AerodftError``; that observer had stopped.
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
    """An observer with its thread."""

    def __init__(self, schedule: ObserverSchedule, on_seen: Callable[[tuple[Observation, ...]], None]) -> None:
        self._scheduled = _ScheduledObserver(schedule)
        self._on_seen = on_seen
        self._condition = threading.Condition()
        self._next: Image | None = None
        self._is_ending = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="image-observer", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> ObserverCounts:
        return self._scheduled.counts

    def show(self, image: Image) -> None:
        with self._condition:
            if self._is_ending or not self._scheduled.is_due(image):
                return
            self.counts.skipped += self._next is not None
            self._next = image
            self._condition.notify()

    def end(self) -> None:
        with self._condition:
            self._is_ending, self._next = True, None
            self._condition.notify()

    def join(self) -> None:
        self._thread.join(_STOP_S)
        if self._thread.is_alive():
            _log.warning("an image observer has not ended within %.0f s; it is left behind", _STOP_S)
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            while (image := self._take()) is not None:
                if observations := self._scheduled.look(image):
                    self._on_seen(observations)
        except Exception as error:  # noqa: BLE001 - join raises it, in the thread that can report it
            _log.error("an image observer ended early: %r", error)
            with self._condition:
                self._error, self._is_ending, self._next = error, True, None

    def _take(self) -> Image | None:
        """The newest waiting image; None at the end."""
        with self._condition:
            self._condition.wait_for(lambda: self._next is not None or self._is_ending)
            image, self._next = self._next, None
            return image
