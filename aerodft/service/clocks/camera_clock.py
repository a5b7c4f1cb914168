"""A camera's clock against UTC: an offset that may grow, and images moved from the one to the other."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from aerodft.model import Event, RawBlock
from aerodft.service.ports import Source


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageClock:
    """``utc = stamp + offset + drift (stamp - reference)``.

    Attributes:
        offset_ns: UTC minus the camera's stamp, at the reference.
        drift: By how much that grows per second of the camera's clock, in seconds.
        reference_ns: A stamp by the camera's clock.
    """

    offset_ns: int = 0
    drift: float = 0.0
    reference_ns: int = 0

    def utc_ns(self, stamp_ns: int) -> int:
        """UTC of a stamp."""
        return stamp_ns + self.offset_ns + round(self.drift * (stamp_ns - self.reference_ns))

    def stamp_ns(self, utc_ns: int) -> int:
        """The stamp at a UTC: what ``utc_ns`` makes of it is that again, but for a nanosecond."""
        since_ns = utc_ns - self.offset_ns - self.reference_ns
        return self.reference_ns + since_ns - round(since_ns * self.drift / (1 + self.drift))


class OnClock:
    """A source whose images bear UTC.

    Args:
        source: Images with the camera's stamps.
        clock: The camera's.
    """

    def __init__(self, source: Source, clock: ImageClock) -> None:
        self._source = source
        self._clock = clock

    def events(self) -> Iterator[Event]:
        """The source's events; images and observations with their stamps in UTC, and arrivals moved with them."""
        for event in self._source.events():
            if isinstance(event, RawBlock):
                yield event
            else:
                utc_ns = self._clock.utc_ns(event.stamp_ns)
                yield replace(event, stamp_ns=utc_ns, arrival_ns=event.arrival_ns + utc_ns - event.stamp_ns)
