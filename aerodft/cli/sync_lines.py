"""What an alignment makes of a station, in the digits that are written: ``sync`` prints it, ``import`` uses it."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import tomli_w
from rich.table import Table

from aerodft.adapters.config.station import StationConfig, VideoFile
from aerodft.adapters.images import VideoFileSource
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.output import say, tables
from aerodft.cli.sync_run import DEFAULT_MAX_OFFSET_S, SyncRun, run_sync
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, UsageError
from aerodft.service import TelemetrySettings
from aerodft.version import SOFTWARE
from calibration.sync import Alignment

_SIGMAS_95: Final = 1.96
_NOTABLE_RATIO: Final = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncLines:
    """The settings of one alignment, rounded as they are written.

    Attributes:
        video: The video.
        start_ns: The stamp of its first image before anything is added: the offset belongs to it.
        time_offset_s: Added to a stamp at the reference.
        time_drift: Added to it per second since then.
        time_reference_ns: The reference, by the video's clock.
        time_std_s: Standard deviation of the aligned stamps, at worst over the video.
        delay_s: The gimbal's lag.
        lag_s: By how much more it may be late; None where the data do not tell.
    """

    video: Path
    start_ns: int
    time_offset_s: float
    time_drift: float
    time_reference_ns: int
    time_std_s: float
    delay_s: float
    lag_s: float | None

    @classmethod
    def of(cls, run: SyncRun, stated_std_s: float = 0.0) -> "SyncLines":
        """Those of an alignment.

        Args:
            run: The alignment.
            stated_std_s: What the station says of its stamps already; it stays.
        """
        found = run.alignment
        worst_s = max(found.attitude_std_s(run.seconds / 2), found.attitude_std_s(-run.seconds / 2))
        return cls(
            video=run.video.absolute(),
            start_ns=run.start_ns,
            time_offset_s=round(found.offset_s, 6),
            time_drift=round(found.drift, 8),
            time_reference_ns=found.reference_ns,
            time_std_s=math.ceil(math.hypot(stated_std_s, worst_s) * 1e4) / 1e4,
            delay_s=round(max(found.lag_s, 0.0), 4),
            lag_s=round(found.lateness_s, 4) if found.is_lag_determined else None,
        )

    def text(self) -> str:
        """Lines of a station's file; with them its measurements are those of ``import --sync auto``."""
        images = {
            "video": str(self.video),
            "start": unix_ns_to_iso(self.start_ns),
            "time_offset_s": self.time_offset_s,
            "time_drift": self.time_drift,
            "time_reference": unix_ns_to_iso(self.time_reference_ns),
            "time_std_s": self.time_std_s,
        }
        attitude = {"delay_s": self.delay_s} | ({} if self.lag_s is None else {"lag_s": self.lag_s})
        return tomli_w.dumps({"images": images, "telemetry": {"attitude": attitude}})

    def applied(self, station: StationConfig, telemetry: TelemetrySettings) -> StationConfig:
        """The station as if its file had these lines."""
        attitude = replace(telemetry.attitude, delay_ns=round(self.delay_s * SECOND_NS))
        if self.lag_s is not None:
            attitude = replace(attitude, lag_ns=round(self.lag_s * SECOND_NS))
        images = replace(
            station.images,
            source=VideoFile(path=self.video, start_ns=self.start_ns),
            time_offset_s=self.time_offset_s,
            time_drift=self.time_drift,
            time_reference_ns=self.time_reference_ns,
            is_auto=False,
        )
        telemetry = replace(telemetry, attitude=attitude)
        pipeline = replace(station.pipeline, telemetry=telemetry, time_std_s=self.time_std_s)
        return replace(station, images=images, pipeline=pipeline)


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
    if station.calibration is not None and station.calibration.bias.time_s:
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


def describe_sync(run: SyncRun, lines: SyncLines, files: list[str]) -> dict[str, Any]:
    """The alignment as a document.

    Args:
        run: The alignment.
        lines: What it makes of the station.
        files: What was written.
    """
    found = run.alignment
    offset_std_s, drift_std, lag_std_s = found.stds.tolist()
    attitude_s = found.offset_s - found.lag_s
    return {
        "schema": "aerodft.sync/1",
        "status": "ok",
        "video": str(run.video),
        "log": str(run.log),
        "video_start": unix_ns_to_iso(run.start_ns),
        "video_start_ns": str(run.start_ns),
        "source": str(found.source),
        "reference": unix_ns_to_iso(found.reference_ns),
        "reference_ns": str(found.reference_ns),
        "offset_s": found.offset_s,
        "offset_std_s": offset_std_s,
        "offset_ci95_s": _interval(found.offset_s, offset_std_s),
        "drift": found.drift,
        "drift_std": drift_std,
        "drift_ci95": _interval(found.drift, drift_std),
        "lag_s": found.lag_s,
        "lag_std_s": lag_std_s,
        "lag_ci95_s": _interval(found.lag_s, lag_std_s),
        "lag_told": found.is_lag_determined,
        "time_constant_s": found.time_constant_s,
        "attitude_offset_s": attitude_s,
        "attitude_offset_std_s": found.attitude_std_s(),
        "attitude_offset_ci95_s": _interval(attitude_s, found.attitude_std_s()),
        "covariance": found.cov.tolist(),
        "peak_ratio": found.peak_ratio,
        "seconds": run.seconds,
        "pairs": run.pairs,
        "reasons": reasons(found),
        "config": lines.text(),
        "files": files,
        "software": SOFTWARE,
    }


def reasons(found: Alignment) -> list[str]:
    """What to know about the numbers, in sentences."""
    if not found.is_lag_determined:
        sentence = (
            "the data do not tell the gimbal's lag from the clocks' offset: a typical lag is taken, and its uncertainty"
            " is part of the offset's; the camera's attitude is found all the same"
        )
        return [sentence]
    if found.time_constant_s > found.lag_s / 2:
        sentence = (
            f"the camera sets off at once and catches up slowly (time constant {found.time_constant_s:.2f} s): the"
            " delay is the mean, and `lag_s` allows for the rest"
        )
        return [sentence]
    return []


def say_sync(run: SyncRun, lines: SyncLines, files: list[str]) -> None:
    """The alignment for a person: a table and the configuration's lines on stdout, the rest on stderr."""
    found = run.alignment
    table = Table("what", "value", "std", "95 % interval")
    offset_std_s, drift_std, lag_std_s = found.stds.tolist()
    table.add_row("offset", *_cells(found.offset_s, offset_std_s, 1.0, "s"))
    table.add_row("drift", *_cells(found.drift, drift_std, 100.0, "%"))
    table.add_row("lag", *_cells(found.lag_s, lag_std_s, 1.0, "s"))
    table.add_row("offset less lag", *_cells(found.offset_s - found.lag_s, found.attitude_std_s(), 1.0, "s"))
    tables().print(table)
    tables().print(
        f"A stamp t of the video is t + offset + drift (t - {unix_ns_to_iso(found.reference_ns)}) in the log's UTC; the"
        f" camera is where {found.source} said it was the lag before. {next_best(found.peak_ratio)}",
        soft_wrap=True,
    )
    tables().print(f"This is for --video-start {unix_ns_to_iso(run.start_ns)}; the lines for a station's file:")
    tables().print(f"\n{lines.text()}", soft_wrap=True)
    for sentence in reasons(found):
        say(f"aerodft: {sentence}")
    for file in files:
        say(f"aerodft: wrote {file}")


def next_best(peak_ratio: float) -> str:
    """How far any other offset is from fitting as well, by the share of the best one's evidence that it has."""
    if peak_ratio < _NOTABLE_RATIO:
        return "No other offset fits."
    return f"No other offset fits as well: the next best one explains {peak_ratio:.0%} of what this one does."


def _interval(value: float, std: float) -> list[float]:
    return [value - _SIGMAS_95 * std, value + _SIGMAS_95 * std]


def _cells(value: float, std: float, scale: float, unit: str) -> tuple[str, str, str]:
    low, high = (scale * end for end in _interval(value, std))
    return f"{scale * value:+.4f} {unit}", f"{scale * std:.4f} {unit}", f"{low:+.4f} ... {high:+.4f} {unit}"
