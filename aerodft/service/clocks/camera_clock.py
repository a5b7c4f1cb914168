"""A camera's clock against UTC, sources with its stamps mapped to UTC, and this machine's wall clock."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from aerodft.model import Event, RawBlock
from aerodft.service.ports import Source


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageClock:
    """Camera clock: ``utc = stamp + offset + drift (stamp - reference)``.

    Attributes:
        offset_ns: UTC minus the camera's stamp, at the reference.
        drift: Growth of the offset per second of the camera's clock (s/s).
        reference_ns: A stamp by the camera's clock.
    """

    offset_ns: int = 0
    drift: float = 0.0
    reference_ns: int = 0

    def utc_ns(self, stamp_ns: int) -> int:
        """UTC of a stamp."""
        return stamp_ns + self.offset_ns + round(self.drift * (stamp_ns - self.reference_ns))

    def stamp_ns(self, utc_ns: int) -> int:
        """Stamp at a UTC; inverse of ``utc_ns`` to a nanosecond."""
        since_ns = utc_ns - self.offset_ns - self.reference_ns
        return self.reference_ns + since_ns - round(since_ns * self.drift / (1 + self.drift))


class MappedToUtc:
    """A source with stamps mapped from the camera's clock to UTC.

    Args:
        source: Images with the camera's stamps.
        clock: The camera's clock.
    """

    def __init__(self, source: Source, clock: ImageClock) -> None:
        self._source = source
        self._clock = clock

    def events(self) -> Iterator[Event]:
        """The source's events; stamps of images and observations in UTC, arrivals moved by the same amount."""
        for event in self._source.events():
            if isinstance(event, RawBlock):
                yield event
            else:
                utc_ns = self._clock.utc_ns(event.stamp_ns)
                yield replace(event, stamp_ns=utc_ns, arrival_ns=event.arrival_ns + utc_ns - event.stamp_ns)


class WallClock:
    """Host UTC that never steps: read once, then continued by the monotonic clock.

    A step of the system clock (first time synchronisation after boot) would otherwise stop the ticks, or skip some.
    """

    def __init__(self) -> None:
        self._epoch_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Host UTC, never decreasing."""
        return self._epoch_ns + time.monotonic_ns()

    def sleep_until(self, when_ns: int) -> None:
        """Return at ``when_ns`` or later."""
        while (rest_ns := when_ns - self.now_ns()) > 0:
            time.sleep(rest_ns / 1e9)
