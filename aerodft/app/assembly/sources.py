"""A station's sources, delayed, checked or restamped; and what is recorded as input again, with its station."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from aerodft.adapters.config.station import (
    NO_SETTINGS,
    Settings,
    StationConfig,
    Topics,
    load_station,
    parse_station,
    with_calibration,
)
from aerodft.adapters.images import refuse_other_size
from aerodft.adapters.outputs import Run
from aerodft.adapters.telemetry import LogSource, open_log
from aerodft.adapters.telemetry.mavlink import FrameCounts
from aerodft.app.assembly.pipeline import build_pipeline, outputs_run
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import VISION, Camera, Event, Image, Observation, RawBlock
from aerodft.service import Batches, MergedFeed, Source, TelemetrySettings
from replay.foreign import ForeignRecording, ForeignTelemetry, open_recording
from replay.recordings import LeftOut, Recording, RecordingSource, is_mcap

_log = logging.getLogger(__name__)

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
    if image.width_px is not None and image.height_px is not None:
        refuse_other_size((image.width_px, image.height_px), camera, where)


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


@dataclass(frozen=True, slots=True)
class RecordedTelemetry:
    """The telemetry of aerodft's own recording, whose frames were checked as they came."""

    source: RecordingSource
    recording: Recording
    counts: FrameCounts = field(default_factory=FrameCounts)

    def events(self) -> Iterator[Event]:
        """The telemetry, in order of arrival."""
        return (event for event in self.source.events() if isinstance(event, RawBlock))

    def left_out(self) -> LeftOut:
        """Parts that the recording lacks."""
        return self.recording.left_out()

    def warnings(self) -> tuple[str, ...]:
        """None: it was checked as it came."""
        return ()


def open_telemetry_log(
    path: Path, topics: Topics | None = None, telemetry: TelemetrySettings | None = None
) -> tuple[LogSource, ForeignRecording | None]:
    """Open a log or a recording by what it holds, whatever its name.

    Args:
        path: A log of any registered format, a recording, or another tool's MCAP file or folder.
        topics: Which topic of another tool's recording is what.
        telemetry: Settings that may name a flight table's columns.

    Returns:
        Its telemetry; and the recording, where another tool made it.

    Raises:
        InputError: The file cannot be read, or is no log and no recording.
        NoAnswerError: The file holds nothing.
    """
    if not is_mcap(path):
        return open_log(path, None if telemetry is None else telemetry.columns), None
    recording = open_recording(path, topics)
    if isinstance(recording, ForeignRecording):
        return ForeignTelemetry(recording), recording
    return RecordedTelemetry(RecordingSource(recording), recording), None


def recorded_station(recording: Recording, settings: Settings = NO_SETTINGS) -> StationConfig:
    """The configuration that a recording was made with.

    Args:
        recording: The recording.
        settings: Values that replace some of it, by key of the station file.

    Raises:
        InputError: It has none, or one that this version cannot read.
        ConfigError: A setting is impossible.
    """
    beside = recording.folder if recording.folder.is_dir() else recording.folder.parent
    where = str(recording.folder / "config.toml")
    return parse_station(_config_text(recording), where=where, folder=beside, settings=settings)


def _config_text(recording: Recording) -> bytes:
    text = recording.text("config.toml")
    if text is None:
        raise InputError(
            "no config.toml beside the segments",
            where=recording.folder,
            hint="`recompute` takes one as `config`",
        )
    return text.encode()


def station_of(recording: Recording, config: Path | None, settings: Settings = NO_SETTINGS) -> StationConfig:
    """The configuration to compute a recording with.

    Args:
        recording: The recording.
        config: Another station file; the alignment of the recorded video is kept. None for the recording's own.
        settings: Values that replace those of the configuration, by key of the station file.

    Raises:
        InputError: There is no configuration.
        ConfigError: A configuration or a setting is impossible.
    """
    if config is None:
        station = recorded_station(recording, settings)
    else:
        recorded = recording.text("config.toml")
        station = load_station(config, settings=settings, recorded=None if recorded is None else recorded.encode())
    for key, value in settings.items():
        _log.info("%s = %s", key, value)
    return station


def stations_of(
    recording: Recording, config: Path | None, calibration: Path | None, settings: Settings = NO_SETTINGS
) -> tuple[StationConfig, StationConfig]:
    """The configuration that a recording was made with, and the one to compute with.

    Args:
        recording: The recording.
        config: File of the one to compute with, as in ``station_of``; it stands for the recording's own too, where the
            recording has none.
        calibration: File of the calibration to compute with; None for that of the configuration.
        settings: As in ``station_of``.

    Raises:
        InputError: There is no configuration, or the recorded images are not of its camera.
        ConfigError: A configuration or a setting is impossible.
    """
    station = station_of(recording, config, settings)
    has_own = recording.text("config.toml") is not None
    recorded = recorded_station(recording) if has_own else station
    station = station if calibration is None else with_calibration(station, calibration)
    images = (event for event in RecordingSource(recording).events() if isinstance(event, Image))
    if (first := next(images, None)) is not None:  # one source has images of one size
        check_size(first, station.pipeline.camera, recording.folder)
    return recorded, station


class RecordedRun:
    """The run of a recording's station as it was at any time of it: measured anew from the inputs until then.

    Args:
        recording: The recording.

    Attributes:
        station: The configuration that it was made with.

    Raises:
        InputError: It has no configuration, or one that this version cannot read.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.station = recorded_station(recording)
        self._begin()

    def _begin(self) -> None:
        self._now_ns = 0
        self._pipeline = build_pipeline(self.station)
        self._batches = MergedFeed([RecordingSource(self._recording)], self.station.pipeline.tick_ns).batches()
        self._later: Batches | None = None  # read, and of ticks that are not over

    def at(self, now_ns: int) -> Run:
        """The run when its clock said ``now_ns`` (UTC); where time goes back it begins anew.

        Raises:
            InputError: The recording is damaged there.
        """
        if now_ns < self._now_ns:
            self._begin()
        try:
            while (batches := self._later or next(self._batches, None)) is not None:
                count = int(np.searchsorted(batches.now_ns, now_ns, side="right"))
                if count:
                    self._pipeline.advance(batches[:count])
                self._later = batches[count:] if count < len(batches) else None
                if self._later is not None:
                    break
        except BaseException:
            self._begin()  # and fails there again, instead of an answer without what comes behind it
            raise
        self._now_ns = now_ns
        return outputs_run(self.station, self._pipeline)
