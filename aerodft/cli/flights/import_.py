"""``aerodft import``: a recorded flight to a recording with measurements, as fast as it goes."""

import math
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.config.station import (
    ImageInput,
    Rate,
    StationConfig,
    Stills,
    VideoFile,
    load_station,
    refreshed,
    stated_start_ns,
    with_calibration,
)
from aerodft.cli.flight import measure_flight
from aerodft.cli.option_values import TopicOption, parse_topics, parse_utc
from aerodft.cli.output import progress, say
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, UsageError
from replay.recordings import is_mcap

_WHOLE_SECONDS_STD_S = 3**-0.5
"""How far, root mean square, a time is from itself cut to whole seconds."""

_MAX_RATE_HZ = 1000  # far beyond any camera


class SyncChoice(StrEnum):
    """Whether the video's clock is to be found."""

    AUTO = "auto"
    OFF = "off"


def import_(
    log: Annotated[Path | None, typer.Argument(help=".tlog, ArduPilot .bin, or an MCAP file with MAVLink.")] = None,
    config: Annotated[Path | None, typer.Option("--config", "-c", help="Station configuration (TOML).")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="New folder for the recording.")] = None,
    video: Annotated[Path | None, typer.Option(help="Video file.")] = None,
    video_start: Annotated[str | None, typer.Option(help="UTC of the video's first image.")] = None,
    images: Annotated[Path | None, typer.Option(help="Folder of stills.")] = None,
    rate: Annotated[float | None, typer.Option(help="Without images: evaluations per second.")] = None,
    observations: Annotated[list[Path] | None, typer.Option(help="JSON-lines file of observed pixels.")] = None,
    calibration: Annotated[Path | None, typer.Option(help="Calibration file (TOML).")] = None,
    sync: Annotated[
        SyncChoice | None, typer.Option(help="auto: find the video's clock as `aerodft sync` does; off: do not.")
    ] = None,
    topic: TopicOption = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    r"""Turn a flight's log, and video or stills, into a recording with measurements.

    \b
    Example:
      aerodft import flight.tlog --video flight.mp4 --video-start 2026-11-21T10:00:00Z \
        --config configs/services/river-flight.toml -o recordings/flight
      aerodft import flight.tlog --video flight.mp4 --sync auto --config station.toml -o recordings/aligned
    """
    if config is None or output is None:
        raise UsageError("no --config" if config is None else "no -o FOLDER", expected="--config FILE and -o FOLDER")
    station = _station(config, video, video_start, images, rate, calibration)
    station = replace(station, topics=parse_topics(topic, station.topics))
    if (log is None) != (station.pipeline.telemetry is None) and not (log is not None and is_mcap(log)):
        have, need = ("[pose]", "no LOG") if log is not None else ("[telemetry]", "a LOG")
        raise InputError(f"the configuration has {have}", where=config, expected=need)
    station = _on_time(station, sync, log, config)
    measure_flight(station, log, tuple(observations or ()), output, where=config, as_json=json)


def _station(
    config: Path,
    video: Path | None,
    video_start: str | None,
    images: Path | None,
    rate: float | None,
    calibration: Path | None,
) -> StationConfig:
    station = load_station(config)
    source = _image_input(station.images.source, video, video_start, images, rate)
    station = refreshed(replace(station, images=replace(station.images, source=source)))
    return station if calibration is None else with_calibration(station, calibration)


def _on_time(station: StationConfig, sync: SyncChoice | None, log: Path | None, config: Path) -> StationConfig:
    """The station with its images' clock as it was asked for, and how well that is known."""
    if sync is SyncChoice.AUTO or (sync is None and station.images.is_auto):
        from aerodft.app.align import aligned_station

        with progress("following the ground") as followed:
            return refreshed(aligned_station(station, log, config, followed))
    return refreshed(_timed(replace(station, images=replace(station.images, is_auto=False))))


def _timed(station: StationConfig) -> StationConfig:
    """The station with its video's start made explicit; one that was read in whole seconds is known to 0.6 s only."""
    source = station.images.source
    if not isinstance(source, VideoFile) or source.start_ns is not None:
        return station
    from aerodft.adapters.images import video_info

    start_ns = video_info(source.path).start_ns
    if start_ns is None or start_ns % SECOND_NS:
        return station
    time_std_s = math.hypot(station.pipeline.time_std_s, _WHOLE_SECONDS_STD_S)
    say(f"aerodft: {source.path}: start in whole seconds: every interval covers {time_std_s:.2f} s of std in time")
    return replace(station, pipeline=replace(station.pipeline, time_std_s=time_std_s))


def _image_input(
    configured: ImageInput | None,
    video: Path | None,
    video_start: str | None,
    images: Path | None,
    rate: float | None,
) -> ImageInput | None:
    """What the options say, else what the configuration says."""
    given = [n for n, value in (("--video", video), ("--images", images), ("--rate", rate)) if value is not None]
    if len(given) > 1:
        raise UsageError(f"{' and '.join(given)} together", expected="one of them")
    if video is None and video_start is not None:
        if given or not isinstance(configured, VideoFile):
            raise UsageError("--video-start without a video", expected="--video FILE")
        video = configured.path
    if video is not None:
        said_ns = None if video_start is None else parse_utc("--video-start", video_start)
        return VideoFile(path=video, start_ns=stated_start_ns(configured, video) if said_ns is None else said_ns)
    if images is not None:
        return replace(configured, folder=images) if isinstance(configured, Stills) else Stills(folder=images)
    if rate is not None and not 0 < rate <= _MAX_RATE_HZ:
        raise UsageError("--rate", got=f"{rate:g}", expected=f"above 0, at most {_MAX_RATE_HZ} per second")
    return configured if rate is None else Rate(rate_hz=rate)
