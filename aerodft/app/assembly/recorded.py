"""What is recorded as input again: telemetry of logs and recordings, and the stations that recordings were made by."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from aerodft.adapters.config.station import StationConfig, Topics, load_station, parse_station, with_calibration
from aerodft.adapters.telemetry import LogSource, open_log
from aerodft.adapters.telemetry.mavlink import FrameCounts
from aerodft.app.assembly.sources import check_size
from aerodft.errors import InputError
from aerodft.model import Event, Image, RawBlock
from replay.foreign import ForeignRecording, ForeignTelemetry, open_recording
from replay.recordings import LeftOut, Recording, RecordingSource, is_mcap


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
        """What the recording lacks."""
        return self.recording.left_out()

    def warnings(self) -> tuple[str, ...]:
        """None: it was checked as it came."""
        return ()


def open_telemetry_log(path: Path, topics: Topics | None = None) -> tuple[LogSource, ForeignRecording | None]:
    """Open a log or a recording by what it holds, whatever its name.

    Args:
        path: A log of any registered format, a recording, or another tool's MCAP file or folder.
        topics: Which topic of another tool's recording is what.

    Returns:
        Its telemetry; and the recording, where another tool made it.

    Raises:
        InputError: The file cannot be read, or is no log and no recording.
        NoAnswerError: The file holds nothing.
    """
    if not is_mcap(path):
        return open_log(path), None
    recording = open_recording(path, topics)
    if isinstance(recording, ForeignRecording):
        return ForeignTelemetry(recording), recording
    return RecordedTelemetry(RecordingSource(recording), recording), None


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
            hint="`recompute` takes one as `config`",
        )
    beside = recording.folder if recording.folder.is_dir() else recording.folder.parent
    return parse_station(text.encode(), where=str(recording.folder / "config.toml"), folder=beside)


def stations_of(
    recording: Recording, config: Path | None, calibration: Path | None
) -> tuple[StationConfig, StationConfig]:
    """The configuration that a recording was made with, and the one to compute with.

    Args:
        recording: The recording.
        config: File of the one to compute with; it stands for the recording's own too, where that has none. None to
            compute with the recording's own.
        calibration: File of the calibration to compute with; None for that of the configuration.

    Raises:
        InputError: There is no configuration, or the recorded images are not of its camera.
    """
    station = recorded_station(recording) if config is None else load_station(config)
    is_own = config is None or recording.text("config.toml") is None
    recorded = station if is_own else recorded_station(recording)
    station = station if calibration is None else with_calibration(station, calibration)
    images = (event for event in RecordingSource(recording).events() if isinstance(event, Image))
    if (first := next(images, None)) is not None:  # one source has images of one size
        check_size(first, station.pipeline.camera, recording.folder)
    return recorded, station
