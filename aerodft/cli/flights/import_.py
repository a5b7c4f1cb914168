"""``aerodft import``: a recorded flight to a recording with measurements, as fast as it goes."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from aerodft.cli.interrupts import interruptible
from aerodft.cli.options import LOG_FORMATS, ConfigOption, JsonOption, TopicOption, parse_topics, parse_utc
from aerodft.cli.output import progress
from aerodft.cli.summary import report
from aerodft.errors import UsageError


def import_(
    log: Annotated[
        list[Path] | None,
        typer.Argument(help=f"A log: {LOG_FORMATS}, or an MCAP file with MAVLink. Of a cut video its parts."),
    ] = None,
    config: ConfigOption = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="New folder for the recording.")] = None,
    video: Annotated[Path | None, typer.Option(help="Video file.")] = None,
    video_start: Annotated[str | None, typer.Option(help="UTC of the video's first image.")] = None,
    images: Annotated[Path | None, typer.Option(help="Folder of stills.")] = None,
    utc_offset: Annotated[
        str | None, typer.Option(help="Whose time stills tell where they do not say so, like +02:00; else UTC.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Without images: evaluations per second.")] = None,
    observations: Annotated[list[Path] | None, typer.Option(help="JSON-lines file of observed pixels.")] = None,
    calibration: Annotated[Path | None, typer.Option(help="Calibration file (TOML).")] = None,
    sync: Annotated[
        Literal["auto", "off"] | None,
        typer.Option(help="auto: find the video's clock as `aerodft sync` does; off: do not."),
    ] = None,
    tilt: Annotated[float | None, typer.Option(help="Camera's tilt from straight down, where none is logged.")] = None,
    max_offset: Annotated[
        float | None, typer.Option(help="With --sync auto: seconds by which the start may be off; else 20.")
    ] = None,
    topic: TopicOption = None,
    json: JsonOption = False,
) -> None:
    r"""Turn a flight's log, and video or stills, into a recording with measurements.

    \b
    Example:
      aerodft import flight.tlog --video flight.mp4 --video-start 2026-11-21T10:00:00Z \
        --config configs/services/river-flight.toml -o recordings/flight
      aerodft import flight.tlog --video flight.mp4 --sync auto --config station.toml -o recordings/aligned
      aerodft import DJI_0001.MP4 DJI_0002.MP4 --config station.toml -o recordings/subtitled
    """
    from aerodft.adapters.config.station import load_station
    from aerodft.app.importing import import_flight

    if config is None or output is None:
        raise UsageError("no --config" if config is None else "no -o FOLDER", expected="--config FILE and -o FOLDER")
    with progress("importing") as bar, interruptible(bar) as between_batches:
        result = import_flight(
            log or None,
            station=config,
            output=output,
            video=video,
            video_start_ns=None if video_start is None else parse_utc("--video-start", video_start),
            images=images,
            utc_offset=utc_offset,
            rate_hz=rate,
            observations=observations or (),
            calibration=calibration,
            sync=None if sync is None else sync == "auto",
            tilt_deg=tilt,
            max_offset_s=max_offset,
            topics=parse_topics(topic, load_station(config).topics) if topic else None,
            progress=between_batches,
        )
    report(result, as_json=json)
