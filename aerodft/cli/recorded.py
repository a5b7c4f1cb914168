"""Recordings as input again: their configuration, their sources, and the pose that they had at a time."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from aerodft.adapters.config.loading import parse_station
from aerodft.adapters.config.station import StationConfig
from aerodft.adapters.images.clock import ImageClock
from aerodft.cli.times import parse_instant
from aerodft.cli.wiring import build_pipeline
from aerodft.conventions import SECOND_NS
from aerodft.dft.measure import Setup
from aerodft.dft.zoomed import zoomed
from aerodft.errors import InputError, NoAnswerError
from aerodft.model.batch import Event
from aerodft.model.image import Image
from aerodft.model.observation import VISION, Observation
from aerodft.model.pose import PoseSample
from aerodft.model.steadiness import STEADY
from aerodft.model.telemetry import RawBlock
from aerodft.service.feed import MergedFeed
from aerodft.service.ports import Source
from replay.recording import Recording
from replay.source import RecordingSource

_LATEST_NS = 30 * SECOND_NS
"""Telemetry that came later than this after its stamp is not waited for; less than the pipeline remembers."""


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
    return parse_station(text.encode(), where=str(recording.folder / "config.toml"), folder=recording.folder)


class Reoffset:
    """A recording's source under another time offset: images and what was observed in them move alike.

    What aerodft itself saw bears its image's stamp, to which only the images' offset was added.
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
    if new.image_clock == old.image_clock and observations_s == 0:
        return source
    return Reoffset(
        source,
        old=old.image_clock,
        new=new.image_clock,
        observation_shift_ns=round(observations_s * SECOND_NS),
    )


class _PoseOnly:
    """A source without what poses at a stamp do not depend on: images, and landmarks and steady points seen later."""

    def __init__(self, source: Source, station: StationConfig, stamp_ns: int) -> None:
        self._source = source
        landmarks = [each.name for each in station.live.landmarks] if station.live else []
        self._taught_by = frozenset(landmarks + ([STEADY] if station.watch else []))
        self._stamp_ns = stamp_ns

    def events(self) -> Iterator[Event]:
        return (event for event in self._source.events() if isinstance(event, RawBlock) or self._teaches(event))

    def _teaches(self, event: Event) -> bool:
        return isinstance(event, Observation) and event.name in self._taught_by and event.stamp_ns < self._stamp_ns


def recorded_setup(folder: Path, at: str) -> tuple[Setup, PoseSample]:
    """Camera and pose of a recording at a time.

    Args:
        folder: The recording.
        at: Seconds from its start, or UTC.

    Raises:
        InputError: The folder is no recording.
        UsageError: ``at`` is no time.
        NoAnswerError: The time is outside the recording.
    """
    recording = Recording(folder)
    station = recorded_station(recording)
    stamp_ns = parse_instant("--at", at, recording.start_ns)
    if not recording.start_ns - SECOND_NS <= stamp_ns <= recording.end_ns + SECOND_NS:
        length_s = (recording.end_ns - recording.start_ns) / SECOND_NS
        raise NoAnswerError(
            "--at is outside the recording",
            where=folder,
            got=at,
            expected=f"0 to {length_s:.1f} s from its start",
        )
    settings = station.pipeline
    setup = Setup(
        camera=settings.camera,
        model=settings.model,
        ground=settings.ground,
        max_range_m=settings.max_range_m,
        config_id=settings.config_id,
    )
    setup, sample = zoomed(setup, _pose_at(recording, station, stamp_ns))
    return setup, replace(sample, zoom=None)


def _pose_at(recording: Recording, station: StationConfig, stamp_ns: int) -> PoseSample:
    """The pose at a stamp, from the telemetry around it and what is needed to know the clocks."""
    pipeline = build_pipeline(replace(station, pipeline=replace(station.pipeline, probes=())))
    wait_ns = _LATEST_NS if station.pipeline.telemetry else 0
    feed = MergedFeed([_PoseOnly(RecordingSource(recording), station, stamp_ns)], station.pipeline.tick_ns)
    for batch in feed.batches():
        pipeline.step(batch)
        if batch.now_ns > stamp_ns + wait_ns:
            break
    return pipeline.pose_at(stamp_ns)
