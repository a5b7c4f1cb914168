"""A station's sources: delayed to where they arrive, checked, or stamped by another clock."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from aerodft.adapters.config.station import StationConfig
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import VISION, Camera, Event, Image, Observation, RawBlock
from aerodft.service import Source

DEFAULT_RATE_HZ: Final = 5.0
"""How often a station without images measures."""


class DelayedSource:
    """A source whose images and observations arrive later, beside the telemetry that they need.

    Args:
        source: Images or observations.
        lateness_ns: Added to arrivals; by the stamp, where it depends on that.
        offset_ns: Added to stamps and arrivals.
    """

    def __init__(self, source: Source, *, lateness_ns: int | Callable[[int], int], offset_ns: int = 0) -> None:
        self._source = source
        self._lateness_ns = lateness_ns
        self._offset_ns = offset_ns

    def events(self) -> Iterator[Event]:
        """The source's events, moved; raw telemetry passes as it is."""
        last_ns = 0
        for event in self._source.events():
            if isinstance(event, RawBlock):
                yield event
            else:
                stamp_ns, late = event.stamp_ns + self._offset_ns, self._lateness_ns
                late_ns = late if isinstance(late, int) else late(stamp_ns)
                last_ns = max(last_ns, event.arrival_ns + self._offset_ns + late_ns)  # none overtakes
                yield replace(event, stamp_ns=stamp_ns, arrival_ns=last_ns)


@dataclass(frozen=True, slots=True)
class _ChangedSource:
    """A source whose events go through a function."""

    source: Source
    change: Callable[[Event], Event]

    def events(self) -> Iterator[Event]:
        return map(self.change, self.source.events())


def size_checked(source: Source, camera: Camera, where: object) -> Source:
    """The source, which raises ``InputError`` at the first image that is not of the camera's size.

    Intrinsics of another mode would give wrong metres.
    """

    def check(event: Event) -> Event:
        if isinstance(event, Image):
            check_size(event, camera, where)
        return event

    return _ChangedSource(source, check)


def check_size(image: Image, camera: Camera, where: object) -> None:
    """Refuse an image that the camera file is not about.

    Raises:
        InputError: The sizes differ.
    """
    if image.width_px is None or (image.width_px, image.height_px) == (camera.width_px, camera.height_px):
        return
    raise InputError(
        "images are of another size than the camera file",
        where=where,
        got=f"{image.width_px} x {image.height_px} px",
        expected=f"{camera.width_px} x {camera.height_px} px of {camera.name!r}",
        hint="a camera file belongs to one mode (size, crop, zoom)",
    )


def reoffset(source: Source, old: StationConfig, new: StationConfig) -> Source:
    """A recording's source as the new configuration's time offsets would have stamped it.

    Images and what was observed in them move by as much. What aerodft itself saw bears its image's stamp, to which only
    the images' offset was added. Stamps at a rate are nobody's clock, and stay.
    """
    shift_ns = round((new.observations.time_offset_s - old.observations.time_offset_s) * SECOND_NS)
    old_clock, new_clock = old.image_clock, new.image_clock
    if old_clock != new_clock and not _has_camera(source):
        old_clock = new_clock
    if old_clock == new_clock and shift_ns == 0:
        return source

    def restamp(event: Event) -> Event:
        if isinstance(event, RawBlock):
            return event
        stamp_ns = new_clock.utc_ns(old_clock.stamp_ns(event.stamp_ns))
        is_observed = isinstance(event, Observation) and event.source != VISION
        return replace(event, stamp_ns=stamp_ns + shift_ns if is_observed else stamp_ns)

    return _ChangedSource(source, restamp)


def _has_camera(source: Source) -> bool:
    """Whether the images are a camera's, by the first of them."""
    first = next((event for event in source.events() if isinstance(event, Image)), None)
    return first is not None and first.width_px is not None
