"""Camera and pose that a recording had at a time, or would have had with another calibration."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, TypeVar

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.station import (
    Settings,
    StationConfig,
    Topics,
    load_station,
    with_calibration,
    with_derived_settings,
)
from aerodft.app.assembly import build_pipeline, station_of
from aerodft.conventions import SECOND_NS
from aerodft.dft import Setup, zoomed
from aerodft.errors import InputError, NoAnswerError, UsageError
from aerodft.model import FIXED_POINTS, Event, Image, Observation, PoseSample, RawBlock
from aerodft.service import MergedFeed, PipelineSettings, Source, TelemetrySettings
from replay.foreign import ForeignRecording, ForeignTelemetry, open_recording
from replay.recordings import Recording, RecordingSource, pose_at, pose_of

T = TypeVar("T")

_LATEST_NS = 30 * SECOND_NS
"""Telemetry that came later than this after its stamp is not waited for; less than the pipeline remembers."""


class _PoseOnly:
    """A source without what poses at a stamp do not depend on: images, and landmarks and steady points seen later."""

    def __init__(self, source: Source, station: StationConfig, stamp_ns: int) -> None:
        self._source = source
        landmarks = [each.name for each in station.live.landmarks] if station.live else []
        self._taught_by = frozenset(landmarks + ([FIXED_POINTS] if station.camera_motion else []))
        self._stamp_ns = stamp_ns

    def events(self) -> Iterator[Event]:
        for event in self._source.events():
            is_lesson = isinstance(event, Observation) and event.name in self._taught_by
            if isinstance(event, RawBlock) or (is_lesson and event.stamp_ns < self._stamp_ns):
                yield event


@dataclass(frozen=True, slots=True, kw_only=True)
class Overrides:
    """Replacements for parts of a recording's own setup; None keeps its own.

    Attributes:
        config: Station configuration.
        calibration: Calibration file.
        camera: Camera file.
        topics: Which topic of another tool's recording is what.
        settings: Values that replace those of the configuration, by key of the station file.
    """

    config: Path | None = None
    calibration: Path | None = None
    camera: Path | None = None
    topics: Topics = field(default_factory=Topics)
    settings: Settings = field(default_factory=dict)

    @property
    def is_own(self) -> bool:
        """Whether the recording's own setup is used as it is."""
        return self.config is None and self.calibration is None and self.camera is None and not self.settings


_ITS_OWN: Final = Overrides()


class RecordedScenes:
    """Camera, ground and pose of a recording at any time.

    Args:
        path: Its folder or file.
        recording: What is there, aerodft's own or another tool's.
        overrides: What takes the place of its own.

    Attributes:
        setup: Camera and ground, as they are without zoom.

    Raises:
        InputError: It lacks something.
    """

    def __init__(self, path: Path, recording: Recording | ForeignRecording, overrides: Overrides = _ITS_OWN) -> None:
        self._path = path
        self._recording = recording
        self._station = _station_of(recording, overrides)
        self._is_its_own = overrides.is_own
        self.setup = self._station.pipeline.setup

    def at(self, stamp_ns: int) -> tuple[Setup, PoseSample]:
        """The scene at a time: with the pose that was recorded with that stamp, else by the telemetry around it.

        Args:
            stamp_ns: UTC.

        Raises:
            InputError: The recording is damaged.
            NoAnswerError: The time is outside the recording.
        """
        recording = self._recording
        since_ns = stamp_ns - _zero_utc_ns(recording)
        first_ns, last_ns = (each - recording.zero_ns for each in (recording.start_ns, recording.end_ns))
        if not first_ns - SECOND_NS <= since_ns <= last_ns + SECOND_NS:
            got, first, last = (f"{each / SECOND_NS:.1f}" for each in (since_ns, first_ns, last_ns))
            expected = f"{first} to {last} s from its first image"
            raise NoAnswerError("the time is outside the recording", where=self._path, got=got, expected=expected)
        recorded = self._recorded(pose_at, stamp_ns)
        return self._zoomed(recorded or _pose_at(self._source, self._station, stamp_ns))

    def of(self, image: Image) -> tuple[Setup, PoseSample]:
        """The scene of a recorded image; arguments and errors as those of ``at``."""
        recorded = self._recorded(pose_of, image)
        return self.at(image.stamp_ns) if recorded is None else self._zoomed(recorded)

    @property
    def _source(self) -> Source:
        found = self._recording
        return RecordingSource(found) if isinstance(found, Recording) else ForeignTelemetry(found)

    def _recorded(self, find: Callable[[Recording, T], PoseSample | None], what: T) -> PoseSample | None:
        """A recorded pose; None where there is none, or another configuration or calibration counts."""
        return find(self._recording, what) if self._is_its_own and isinstance(self._recording, Recording) else None

    def _zoomed(self, sample: PoseSample) -> tuple[Setup, PoseSample]:
        setup, sample = zoomed(self.setup, sample)
        return setup, replace(sample, zoom=None)


def recorded_setup(
    path: Path, *, at_s: float | None = None, at_ns: int | None = None, overrides: Overrides = _ITS_OWN
) -> tuple[Setup, PoseSample]:
    """Camera and pose of a recording at a time.

    Args:
        path: The recording, aerodft's own or another tool's.
        at_s: Seconds from its first image; without images from its first message.
        at_ns: UTC, where ``at_s`` is None.
        overrides: What takes the place of its own.

    Raises:
        InputError: There is no recording, or it lacks something.
        NoAnswerError: The time is outside the recording.
    """
    recording = open_recording(path, overrides.topics)
    if at_ns is None:
        at_ns = _zero_utc_ns(recording) + round((at_s or 0.0) * SECOND_NS)
    return RecordedScenes(path, recording, overrides).at(at_ns)


def _zero_utc_ns(recording: Recording | ForeignRecording) -> int:
    return recording.zero_utc_ns if isinstance(recording, Recording) else recording.zero_ns


def _station_of(recording: Recording | ForeignRecording, overrides: Overrides) -> StationConfig:
    if isinstance(recording, Recording):
        station = station_of(recording, overrides.config, overrides.settings)
    elif overrides.config is not None:
        station = load_station(overrides.config, settings=overrides.settings)
    else:
        station = _station_without_config(recording, overrides)
    if overrides.camera is not None:
        camera = load_camera(overrides.camera)
        station = with_derived_settings(replace(station, pipeline=replace(station.pipeline, camera=camera)))
    return station if overrides.calibration is None else with_calibration(station, overrides.calibration)


def _station_without_config(recording: ForeignRecording, overrides: Overrides) -> StationConfig:
    """Telemetry with every default, and the camera that was recorded with the images."""
    camera = load_camera(overrides.camera) if overrides.camera is not None else recording.camera()
    if camera is None:
        refusal = recording.refusal_without("camera")
        raise InputError(refusal.what, where=refusal.where, got=refusal.got, hint="name a `camera`, or a `config`")
    if overrides.settings:
        raise UsageError("`settings`", got="a recording without a configuration", expected="`config` beside it")
    pipeline = PipelineSettings(station="recording", camera=camera, probes=(), telemetry=TelemetrySettings())
    return with_derived_settings(StationConfig(pipeline=pipeline))


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
