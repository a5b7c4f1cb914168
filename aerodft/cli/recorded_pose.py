"""Camera and pose that a recording had at a time, or would have had with another calibration."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.station import StationConfig, Topics, load_station, refreshed, with_calibration
from aerodft.app.assembly import build_pipeline, recorded_station
from aerodft.cli.option_values import parse_instant
from aerodft.conventions import SECOND_NS
from aerodft.dft import Setup, zoomed
from aerodft.errors import InputError, NoAnswerError
from aerodft.model import STEADY, Event, Observation, PoseSample, RawBlock
from aerodft.service import MergedFeed, PipelineSettings, Source, TelemetrySettings
from replay.foreign import ForeignRecording, ForeignTelemetry, open_recording
from replay.recordings import Recording, RecordingSource

_LATEST_NS = 30 * SECOND_NS
"""Telemetry that came later than this after its stamp is not waited for; less than the pipeline remembers."""


class _PoseOnly:
    """A source without what poses at a stamp do not depend on: images, and landmarks and steady points seen later."""

    def __init__(self, source: Source, station: StationConfig, stamp_ns: int) -> None:
        self._source = source
        landmarks = [each.name for each in station.live.landmarks] if station.live else []
        self._taught_by = frozenset(landmarks + ([STEADY] if station.camera_motion else []))
        self._stamp_ns = stamp_ns

    def events(self) -> Iterator[Event]:
        return (event for event in self._source.events() if isinstance(event, RawBlock) or self._teaches(event))

    def _teaches(self, event: Event) -> bool:
        return isinstance(event, Observation) and event.name in self._taught_by and event.stamp_ns < self._stamp_ns


@dataclass(frozen=True, slots=True, kw_only=True)
class Overrides:
    """What takes the place of what a recording was made with; None for its own.

    Attributes:
        config: Station configuration.
        calibration: Calibration file.
        camera: Camera file.
        topics: Which topic of another tool's recording is what.
    """

    config: Path | None = None
    calibration: Path | None = None
    camera: Path | None = None
    topics: Topics = field(default_factory=Topics)


def recorded_setup(path: Path, at: str, instead: Overrides) -> tuple[Setup, PoseSample]:
    """Camera and pose of a recording at a time.

    Args:
        path: The recording, aerodft's own or another tool's.
        at: Seconds from its start, or UTC.
        instead: What takes the place of its own.

    Raises:
        InputError: There is no recording, or it lacks something.
        UsageError: ``at`` is no time.
        NoAnswerError: The time is outside the recording.
    """
    recording = open_recording(path, instead.topics)
    station = _station_of(recording, instead)
    stamp_ns = parse_instant("--at", at, recording.start_ns)
    if not recording.start_ns - SECOND_NS <= stamp_ns <= recording.end_ns + SECOND_NS:
        length_s = (recording.end_ns - recording.start_ns) / SECOND_NS
        raise NoAnswerError(
            "--at is outside the recording", where=path, got=at, expected=f"0 to {length_s:.1f} s from its start"
        )
    settings = station.pipeline
    setup = Setup(
        camera=settings.camera,
        model=settings.model,
        ground=settings.ground,
        max_range_m=settings.max_range_m,
        config_id=settings.config_id,
    )
    source: Source = RecordingSource(recording) if isinstance(recording, Recording) else ForeignTelemetry(recording)
    setup, sample = zoomed(setup, _pose_at(source, station, stamp_ns))
    return setup, replace(sample, zoom=None)


def _station_of(recording: Recording | ForeignRecording, instead: Overrides) -> StationConfig:
    if instead.config is not None:
        station = load_station(instead.config)
    elif isinstance(recording, Recording):
        station = recorded_station(recording)
    else:
        station = _station_without_config(recording, instead)
    if instead.camera is not None:
        camera = load_camera(instead.camera)
        station = refreshed(replace(station, pipeline=replace(station.pipeline, camera=camera)))
    return station if instead.calibration is None else with_calibration(station, instead.calibration)


def _station_without_config(recording: ForeignRecording, instead: Overrides) -> StationConfig:
    """Telemetry with every default, and the camera that was recorded with the images."""
    camera = load_camera(instead.camera) if instead.camera is not None else recording.camera()
    if camera is None:
        refusal = recording.refusal_without("camera")
        raise InputError(refusal.what, where=refusal.where, got=refusal.got, hint="--camera FILE, or --config FILE")
    pipeline = PipelineSettings(station="recording", camera=camera, probes=(), telemetry=TelemetrySettings())
    return refreshed(StationConfig(pipeline=pipeline))


def _pose_at(source: Source, station: StationConfig, stamp_ns: int) -> PoseSample:
    """The pose at a stamp, from the telemetry around it and what is needed to know the clocks."""
    pipeline = build_pipeline(replace(station, pipeline=replace(station.pipeline, probes=())))
    wait_ns = _LATEST_NS if station.pipeline.telemetry else 0
    feed = MergedFeed([_PoseOnly(source, station, stamp_ns)], station.pipeline.tick_ns)
    for batches in feed.batches():
        pipeline.advance(batches)
        if int(batches.now_ns[-1]) > stamp_ns + wait_ns:
            break
    return pipeline.pose_at(stamp_ns)
