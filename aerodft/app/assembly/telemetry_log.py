"""Telemetry to import or to look through: logs, and the MAVLink of recordings."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from aerodft.adapters.config.station import Topics
from aerodft.adapters.telemetry import LogSource, open_log
from aerodft.adapters.telemetry.mavlink import FrameCounts
from aerodft.model import Event, RawBlock
from replay.foreign import ForeignRecording, ForeignTelemetry, open_recording
from replay.recordings import RecordingSource, is_mcap


@dataclass(frozen=True, slots=True)
class _Recorded:
    """The telemetry of aerodft's own recording, whose frames were checked as they came."""

    source: RecordingSource
    counts: FrameCounts = field(default_factory=FrameCounts)

    def events(self) -> Iterator[Event]:
        return (event for event in self.source.events() if isinstance(event, RawBlock))

    def warnings(self) -> tuple[str, ...]:
        return ()


def open_telemetry_log(path: Path, topics: Topics | None = None) -> tuple[LogSource, ForeignRecording | None]:
    """Open a log or a recording by what it holds, whatever its name.

    Args:
        path: A log of any registered format, a recording, or another tool's MCAP file or folder.
        topics: Which topic of the latter is what.

    Returns:
        Its telemetry; and the recording, where another tool made it.

    Raises:
        InputError: It cannot be read, or is none of these.
        NoAnswerError: It holds nothing.
    """
    if not is_mcap(path):
        return open_log(path), None
    recording = open_recording(path, topics)
    if isinstance(recording, ForeignRecording):
        return ForeignTelemetry(recording), recording
    return _Recorded(RecordingSource(recording)), None
