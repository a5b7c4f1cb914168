"""``aerodft sync``: a video and a log in, offset and drift of their clocks and the gimbal's lag out."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.config.station import Topics, load_station, stated_start_ns
from aerodft.adapters.images import VideoFileSource
from aerodft.cli.option_values import TopicOption, parse_topics, parse_utc
from aerodft.cli.output import print_json
from aerodft.cli.sync_lines import SyncLines, describe_sync, say_sync
from aerodft.cli.sync_run import DEFAULT_MAX_OFFSET_S, run_sync
from aerodft.errors import ConfigError, UsageError
from aerodft.model import Camera
from aerodft.service import TelemetrySettings

_MOST_OFFSET_S = 600.0


def sync(
    video: Annotated[Path, typer.Argument(help="Video file.")],
    log: Annotated[
        Path, typer.Argument(help=".tlog, ArduPilot .bin, or an MCAP file with MAVLink, of the same flight.")
    ],
    camera: Annotated[Path | None, typer.Option(help="Camera file (TOML); else the configuration's.")] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Station configuration: camera, and how attitudes are read.")
    ] = None,
    video_start: Annotated[
        str | None, typer.Option(help="UTC of the video's first image; else the configuration's, or the file's.")
    ] = None,
    max_offset: Annotated[
        float, typer.Option(help="Seconds by which that may be wrong, either way.")
    ] = DEFAULT_MAX_OFFSET_S,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder for a plot of both, sync.png.")] = None,
    topic: TopicOption = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    r"""Align a video with a log by how the camera turned, and say what to write into the configuration.

    The ground is followed from image to image; how the camera turned is compared with what gimbal and vehicle say.
    Offset and drift (of the video's clock against the log's) and the gimbal's lag come with stds; where the camera
    hardly turns, or moves so regularly that several offsets fit, there is no answer (exit 4).

    \b
    Example:
      aerodft sync flight.mp4 flight.tlog --camera configs/cameras/demo-1080p.toml -o sync
      aerodft sync flight.mp4 flight.tlog --config station.toml --video-start 2026-11-21T10:00:00Z --json
    """
    if not 0 < max_offset <= _MOST_OFFSET_S:
        raise UsageError("--max-offset", got=f"{max_offset:g}", expected=f"above 0, at most {_MOST_OFFSET_S:g} s")
    told = _told(video, camera, config)
    start_ns = told.start_ns if video_start is None else parse_utc("--video-start", video_start)
    topics = parse_topics(topic, told.topics)
    run = run_sync(VideoFileSource(video, start_ns=start_ns), log, told.camera, told.telemetry, max_offset, topics)
    lines = SyncLines.of(run, told.time_std_s)
    files = []
    if output is not None:
        from aerodft.cli.sync_figure import draw_sync

        files.append(draw_sync(run, output))
    if json:
        print_json(describe_sync(run, lines, files))
    else:
        say_sync(run, lines, files)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Told:
    """Camera, settings, topics; when the video began and how well its stamps are known, where the station says so."""

    camera: Camera
    telemetry: TelemetrySettings
    start_ns: int | None = None
    time_std_s: float = 0.0
    topics: Topics | None = None


def _told(video: Path, camera: Path | None, config: Path | None) -> _Told:
    if config is None:
        if camera is None:
            raise UsageError("no camera", expected="--camera FILE or --config FILE")
        return _Told(camera=load_camera(camera), telemetry=TelemetrySettings())
    station = load_station(config)
    pipeline = station.pipeline
    if pipeline.telemetry is None:
        raise ConfigError("the configuration has [pose]", where=config, expected="[telemetry]")
    return _Told(
        camera=pipeline.camera if camera is None else load_camera(camera),
        telemetry=pipeline.telemetry,
        start_ns=stated_start_ns(station.images.source, video),
        time_std_s=pipeline.time_std_s,
        topics=station.topics,
    )
