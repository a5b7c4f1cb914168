"""Recordings as input again: their configuration, and their sources under another time offset."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from aerodft.adapters.config.station import StationConfig, load_station, parse_station, with_calibration
from aerodft.app.assembly.pipeline import check_size
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import VISION, Event, Image, Observation
from aerodft.service import Source
from aerodft.service.clocks import ImageClock
from replay.recordings import Recording, RecordingSource


def recorded_station(recording: Recording) -> StationConfig:
    """The configuration that a recording was made with.

    Raises:
        InputError: It has none, or one that this version cannot read.
    """
    text = recording.text("config.toml")
    if text is None:
        raise InputError(
            "no config.toml beside the segments",
            where=recording.folder,
            hint="`aerodft recompute` takes one with --config",
        )
    beside = recording.folder if recording.folder.is_dir() else recording.folder.parent
    return parse_station(text.encode(), where=str(recording.folder / "config.toml"), folder=beside)


def stations_of(
    recording: Recording, config: Path | None, calibration: Path | None
) -> tuple[StationConfig, StationConfig]:
    """The configuration that a recording was made with, and the one to compute with.

    Args:
        recording: The recording.
        config: The one to compute with, and where the recording has none the one it was made with; None for its own.
        calibration: In place of that configuration's; None to leave it.

    Raises:
        InputError: There is none, or the recorded images are not of its camera.
    """
    new = recorded_station(recording) if config is None else load_station(config)
    is_own = config is None or recording.text("config.toml") is None
    was = new if is_own else recorded_station(recording)
    new = new if calibration is None else with_calibration(new, calibration)
    images = (event for event in RecordingSource(recording).events() if isinstance(event, Image))
    if (first := next(images, None)) is not None:  # one source has images of one size
        check_size(first, new.pipeline.camera, recording.folder)
    return was, new


class Reoffset:
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
    return Reoffset(source, old=was, new=now, observation_shift_ns=round(observations_s * SECOND_NS))


def _has_camera(source: Source) -> bool:
    """Whether the images are a camera's, by the first of them."""
    first = next((event for event in source.events() if isinstance(event, Image)), None)
    return first is not None and first.width_px is not None
