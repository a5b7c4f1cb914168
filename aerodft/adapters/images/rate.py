"""Rates: stamps alone, so that fixed probes are evaluated from telemetry; and which images keep their pixels."""

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Self

from aerodft.conventions import SECOND_NS
from aerodft.model import Event, Image, StampClock
from aerodft.service import Clock, Source


def _period_ns(rate_hz: float) -> Fraction:
    """The exact period of a rate as it was written: 0.1 Hz is 10 s."""
    if not rate_hz > 0:
        raise ValueError(f"rate {rate_hz} Hz, must be above 0")
    return SECOND_NS / Fraction(repr(float(rate_hz)))


def _bare_image(index: int, stamp_ns: int, arrival_ns: int) -> Image:
    return Image(index=index, stamp_ns=stamp_ns, arrival_ns=arrival_ns, clock=StampClock.HOST)


class RateSource:
    """Stamps on the host's clock over stretches of a recorded flight, each up to and without its stop."""

    def __init__(self, stretches_ns: Sequence[tuple[int, int]], rate_hz: float) -> None:
        """Raise ``ValueError`` unless ``rate_hz`` is above 0."""
        self._stretches_ns = stretches_ns
        self._period_ns = _period_ns(rate_hz)

    def events(self) -> Iterator[Image]:
        """Images without pixels; no rounding adds up."""
        index = 0
        for start_ns, stop_ns in self._stretches_ns:
            first = index
            while (stamp_ns := start_ns + round((index - first) * self._period_ns)) < stop_ns:
                yield _bare_image(index, stamp_ns, stamp_ns)
                index += 1


class LiveRate:
    """Stamps as time passes, at whole multiples of the period; a multiple that was missed is left out."""

    def __init__(self, rate_hz: float, on_image: Callable[[Image], None], clock: Clock) -> None:
        """Raise ``ValueError`` unless ``rate_hz`` is above 0; ``on_image``, called from a thread, must not block."""
        self._period_ns = _period_ns(rate_hz)
        self._on_image = on_image
        self._clock = clock
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="image-rate", daemon=True)

    def start(self) -> None:
        """Begin; once only."""
        self._thread.start()

    def stop(self) -> None:
        """End at once; no call of ``on_image`` begins after this returns, unless one has blocked for 10 s."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(_STOP_S)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self) -> None:
        multiple = self._clock.now_ns() // self._period_ns
        index = 0
        while True:
            multiple = max(multiple + 1, -(-self._clock.now_ns() // self._period_ns))
            stamp_ns = round(multiple * self._period_ns)
            while (wait_ns := stamp_ns - self._clock.now_ns()) > 0:
                if self._stopping.wait(wait_ns / SECOND_NS):
                    return
            if self._stopping.is_set():
                return
            self._on_image(_bare_image(index, stamp_ns, self._clock.now_ns()))
            index += 1


_STOP_S = 10.0  # whoever takes the images must not block
_SLACK = 0.9  # of the period: a camera at exactly the rate jitters around it


def is_due(last_ns: int | None, arrival_ns: int, rate_hz: float) -> bool:
    """Whether an image is to be kept.

    Args:
        last_ns: Arrival of the last one that was; None before the first.
        arrival_ns: Its own.
        rate_hz: How many are kept; 0 for none.
    """
    if rate_hz <= 0 or last_ns is None:
        return rate_hz > 0
    return arrival_ns - last_ns >= _SLACK * SECOND_NS / rate_hz


class ThinnedPixels:
    """A source of which the images between those that are due come without their pixels, which would only wait.

    Args:
        source: Images, by themselves or among other events.
        rate_hz: As in :func:`is_due`; the recorder then finds the same ones due.
    """

    def __init__(self, source: Source, rate_hz: float) -> None:
        self._source = source
        self._rate_hz = rate_hz

    def events(self) -> Iterator[Event]:
        """The source's events."""
        last_ns: int | None = None
        for event in self._source.events():
            if isinstance(event, Image) and event.pixels is not None:
                if is_due(last_ns, event.arrival_ns, self._rate_hz):
                    last_ns = event.arrival_ns
                    yield event
                else:
                    yield replace(event, pixels=None)
            else:
                yield event
