"""A station whose image stamps are to be found: aligned with its log, and written out as if it had been configured."""

from pathlib import Path

from aerodft.adapters.config.inputs import VideoFile
from aerodft.adapters.config.station import StationConfig
from aerodft.adapters.images.video import VideoFileSource
from aerodft.cli.output import say
from aerodft.cli.sync_lines import SyncLines
from aerodft.cli.sync_output import reasons
from aerodft.cli.sync_run import DEFAULT_MAX_OFFSET_S, SyncRun, run_sync
from aerodft.errors import ConfigError, UsageError


def aligned(station: StationConfig, log: Path | None, where: Path) -> StationConfig:
    """The station with offset, drift and delay as its video and its log tell, and how well they are known.

    Args:
        station: The station.
        log: Its log.
        where: Its file, for messages.

    Raises:
        UsageError: There is no log.
        ConfigError: There is no video, or a calibration states a time offset too.
        InputError: A file cannot be read.
        NoAnswerError: The data do not tell.
    """
    source, telemetry = station.images.source, station.pipeline.telemetry
    if log is None or telemetry is None:
        raise UsageError("nothing to align the video with", expected="a LOG, and [telemetry] in the configuration")
    if not isinstance(source, VideoFile):
        raise ConfigError("nothing to align", where=where, got="no video", expected="--video FILE or images.video")
    if station.calibration is not None and station.calibration.time_offset_s:
        raise ConfigError(
            "two time offsets",
            where=where,
            got="one to be found, and one in the calibration",
            expected="one of them",
            hint="leave out the calibration, or --sync auto",
        )
    video = VideoFileSource(source.path, start_ns=source.start_ns)
    run = run_sync(video, log, station.pipeline.camera, telemetry, DEFAULT_MAX_OFFSET_S, station.topics)
    _tell(run)
    return SyncLines.of(run, station.pipeline.time_std_s).applied(station, telemetry)


def _tell(run: SyncRun) -> None:
    found = run.alignment
    offset_s, drift, lag_s = found.stds.tolist()
    say(
        f"aerodft: {run.video}: {found.offset_s:+.3f} s (std {offset_s:.3f} s) and {100 * found.drift:+.3f} % (std"
        f" {100 * drift:.3f} %) off the log, the gimbal {found.lag_s:.3f} s late (std {lag_s:.3f} s)"
    )
    for sentence in reasons(found):
        say(f"aerodft: {sentence}")
