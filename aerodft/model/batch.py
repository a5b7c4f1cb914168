"""What the pipeline eats: everything that arrived within one tick."""

from dataclasses import dataclass

from aerodft.model.image import Image
from aerodft.model.image_rows import ImageRows
from aerodft.model.observation import Observation
from aerodft.model.telemetry import RawBlock

Event = RawBlock | Image | Observation
Arrival = Event | ImageRows
"""An event, or many images that are read together."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """All events with an arrival in ``(now_ns - tick, now_ns]``, each kind in order of arrival.

    The pipeline's state after a batch depends on the ticks alone, not on how the events were cut into reads: this is
    what makes a recomputed flight byte-identical to the live one.
    """

    now_ns: int
    raw: tuple[RawBlock, ...] = ()
    images: tuple[Image, ...] = ()
    observations: tuple[Observation, ...] = ()

    @property
    def event_count(self) -> int:
        """How many events, each frame of its own."""
        return sum(len(block.length) for block in self.raw) + len(self.images) + len(self.observations)
