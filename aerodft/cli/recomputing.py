"""What it takes to compute a recording anew: its stations, then and now, and the pipeline that its input is fed to."""

from dataclasses import dataclass, field
from pathlib import Path

from aerodft.adapters.config.station import StationConfig
from aerodft.app.assembly import ImageObservers, build_observers, build_pipeline, reoffset, stations_of
from aerodft.errors import NoAnswerError, UsageError
from aerodft.service import Feed, MergedFeed, Pipeline, Source
from replay.recordings import Recording, RecordingSource, Redetection


@dataclass(frozen=True, slots=True, kw_only=True)
class Recomputation:
    """A recording, ready to be computed anew.

    Attributes:
        recording: What is read.
        was: The configuration that it was made with; where it has none, the one to compute with.
        station: The configuration to compute with.
        pipeline: Of that.
        feed: The recording's input as that configuration stamps it.
        again: What is looked for again in the recorded images; None where observations are taken as recorded.
        eyes: Who looks.
    """

    recording: Recording
    was: StationConfig
    station: StationConfig
    pipeline: Pipeline
    feed: Feed
    again: Redetection | None = None
    eyes: ImageObservers = field(default_factory=ImageObservers)


def prepare(folder: Path, config: Path | None, calibration: Path | None, *, vision: bool = False) -> Recomputation:
    """Open a recording with its own configuration or another one, and another calibration where there is one.

    Args:
        folder: The recording.
        config: None for its own configuration.
        calibration: None for that of the configuration.
        vision: Look again into the recorded images; else it starts from the recorded observations.

    Raises:
        InputError: The folder is no recording, has no configuration, or its images are not of the camera.
        ConfigError: A configuration or a calibration is not one.
        NoAnswerError: The recording holds nothing, or with ``vision`` no images.
        UsageError: There is nothing to look for.
    """
    recording = Recording(folder)
    was, station = stations_of(recording, config, calibration)
    pipeline = build_pipeline(station)
    source = reoffset(RecordingSource(recording, pixels=vision), was, station)
    again, eyes = None, ImageObservers()
    if vision:
        eyes = build_observers(station, pipeline, config or folder, may_record=True)
        again = _seen_again(source, recording, eyes)
    feed = MergedFeed([source if again is None else again], station.pipeline.tick_ns)
    return Recomputation(
        recording=recording, was=was, station=station, pipeline=pipeline, feed=feed, again=again, eyes=eyes
    )


def _seen_again(source: Source, recording: Recording, eyes: ImageObservers) -> Redetection:
    if not eyes.schedules:
        got = "a configuration without [markers], [camera_motion], [objects], [river] and tracked probes"
        raise UsageError("--vision", got=got, expected="one of them: else aerodft looks for nothing itself")
    if next(recording.image_messages(), None) is None:
        hint = "record.image_hz says how many are kept"
        raise NoAnswerError("no images in the recording", where=recording.folder, hint=hint)
    return Redetection(source, eyes.schedules)
