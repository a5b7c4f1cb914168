"""Images that keep their pixels: those of which a recording will hold a picture."""

from collections.abc import Iterator
from dataclasses import replace

from aerodft.conventions import SECOND_NS
from aerodft.model import Event, Image
from aerodft.service import Source

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


class Thinned:
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
