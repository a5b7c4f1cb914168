"""A station's sources: delayed to where they arrive, checked, or stamped by another clock."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

from aerodft.adapters.config.station import StationConfig
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import VISION, Camera, Event, Image, Observation, RawBlock
from aerodft.service import Source
from aerodft.service.clocks import ImageClock

DEFAULT_RATE_HZ: Final = 5.0
"""How often a station without images measures."""


class DelayedSource:
    """A source whose images and observations arrive some time after their stamps, beside the telemetry they need.

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


class SizeChecked:
    """A source whose images must be of the camera's size: intrinsics of another mode give wrong metres."""

    def __init__(self, source: Source, camera: Camera, where: object) -> None:
        self._source = source
        self._camera = camera
        self._where = where

    def events(self) -> Iterator[Event]:
        """The source's events.

        Raises:
            InputError: At the first image of another size.
        """
        for event in self._source.events():
            if isinstance(event, Image):
                check_size(event, self._camera, self._where)
            yield event


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


class _Reoffset:
    """A recording's source under another time offset: images and what was observed in them move alike.

    What aerodft itself saw bears its image's stamp, to which only the images' offset was added. Stamps at a rate are
    nobody's clock, and stay.
    """

    def __init__(self, source: Source, *, old: ImageClock, new: ImageClock, observation_shift_ns: int) -> None:
        self._source = source
        self._old = old
        self._new = new
        self._observation_shift_ns = observation_shift_ns

    def events(self) -> Iterator[Event]:
        """The source's events with their stamps moved."""
        for event in self._source.events():
            if isinstance(event, Image):
                yield replace(event, stamp_ns=self._moved(event.stamp_ns))
            elif isinstance(event, Observation):
                own_ns = 0 if event.source == VISION else self._observation_shift_ns
                yield replace(event, stamp_ns=self._moved(event.stamp_ns) + own_ns)
            else:
                yield event

    def _moved(self, stamp_ns: int) -> int:
        return self._new.utc_ns(self._old.stamp_ns(stamp_ns))


def reoffset(source: Source, old: StationConfig, new: StationConfig) -> Source:
    """The source as the new configuration's time offsets would have stamped it."""
    observations_s = new.observations.time_offset_s - old.observations.time_offset_s
    was, now = old.image_clock, new.image_clock
    if was != now and not _has_camera(source):
        was = now
    if was == now and observations_s == 0:
        return source
    return _Reoffset(source, old=was, new=now, observation_shift_ns=round(observations_s * SECOND_NS))


def _has_camera(source: Source) -> bool:
    """Whether the images are a camera's, by the first of them."""
    first = next((event for event in source.events() if isinstance(event, Image)), None)
    return first is not None and first.width_px is not None
