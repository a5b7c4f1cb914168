"""No images: stamps alone at a rate, so that fixed probes are evaluated from telemetry."""

import threading
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from types import TracebackType
from typing import Self

from aerodft.conventions import SECOND_NS
from aerodft.model import Image, StampClock
from aerodft.service import Clock


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
        """End at once; no call of ``on_image`` begins after this returns."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
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
