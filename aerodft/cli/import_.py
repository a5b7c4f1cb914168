"""``aerodft import``: a recorded flight to a recording with measurements, as fast as it goes."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.config.loading import load_station, with_calibration
from aerodft.adapters.config.resolved import refreshed
from aerodft.adapters.config.station import Rate, StationConfig, Stills, VideoFile
from aerodft.cli.flight import open_flight
from aerodft.cli.output import print_json, progress_bar, say
from aerodft.cli.times import parse_utc
from aerodft.cli.wiring import Tally, build_pipeline, build_recorder, run
from aerodft.errors import InputError, NoAnswerError, UsageError
from aerodft.service.feed import MergedFeed


def import_(
    log: Annotated[Path | None, typer.Argument(help=".tlog or ArduPilot .bin; none for a fixed camera.")] = None,
    config: Annotated[Path | None, typer.Option("--config", "-c", help="Station configuration (TOML).")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="New folder for the recording.")] = None,
    video: Annotated[Path | None, typer.Option(help="Video file.")] = None,
    video_start: Annotated[str | None, typer.Option(help="UTC of the video's first image.")] = None,
    images: Annotated[Path | None, typer.Option(help="Folder of stills.")] = None,
    rate: Annotated[float | None, typer.Option(help="Without images: evaluations per second.")] = None,
    observations: Annotated[list[Path] | None, typer.Option(help="JSON-lines file of observed pixels.")] = None,
    calibration: Annotated[Path | None, typer.Option(help="Calibration file (TOML).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    r"""Turn a flight's log, and video or stills, into a recording with measurements.

    \b
    Example:
      aerodft import flight.tlog --video flight.mp4 --video-start 2026-11-21T10:00:00Z \
        --config configs/services/river-flight.toml -o recordings/flight
    """
    if config is None or output is None:
        raise UsageError("no --config" if config is None else "no -o FOLDER", expected="--config FILE and -o FOLDER")
    station = _station(config, video, video_start, images, rate, calibration)
    if (log is None) != (station.pipeline.telemetry is None):
        have, need = ("[pose]", "no LOG") if log is not None else ("[telemetry]", "a LOG")
        raise InputError(f"the configuration has {have}", where=config, expected=need)
    flight = open_flight(station, log, (*station.observations.files, *(observations or ())))
    recorder = build_recorder(station, output, started_ns=flight.first_ns, lossless=True)
    tally = Tally()
    pipeline = build_pipeline(station)
    try:
        with progress_bar("importing", flight.first_ns, flight.last_ns) as progress:
            run(MergedFeed(flight.sources, station.pipeline.tick_ns), pipeline, (recorder, tally), progress)
    finally:
        recorder.close()
    report(output, tally, pipeline.counts.unknown_probe, as_json=json)


def report(folder: Path, tally: Tally, unknown_probe: int, *, as_json: bool) -> None:
    """Say what a run made.

    Raises:
        NoAnswerError: Not one pose had an answer.
    """
    if as_json:
        print_json(
            {
                "recording": str(folder),
                "images": tally.images,
                "poses": dict(tally.poses),
                "measurements": dict(tally.measurements),
                "reasons": tally.reasons,
            }
        )
    say(f"recording: {folder}; {tally.images} images; poses: {_counts(tally.poses)}")
    say(f"measurements: {_counts(tally.measurements)}")
    if unknown_probe:
        say(f"{unknown_probe} observations name a probe that the configuration does not observe; they are recorded")
    if not tally.poses.get("ok") and tally.poses:
        raise NoAnswerError(
            "no image has a usable pose",
            where=folder,
            got=", then ".join(f"{status} ({why})" for status, why in tally.reasons.items()),
            hint="the recording is kept",
        )


def _counts(counter: dict[str, int]) -> str:
    return ", ".join(f"{number} {status}" for status, number in counter.items()) or "none"


def _station(
    config: Path,
    video: Path | None,
    video_start: str | None,
    images: Path | None,
    rate: float | None,
    calibration: Path | None,
) -> StationConfig:
    if video is not None and images is not None:
        raise UsageError("--video and --images together", expected="one of them")
    station = load_station(config)
    source = station.images.source
    if video is not None:
        source = VideoFile(
            path=video, start_ns=None if video_start is None else parse_utc("--video-start", video_start)
        )
    elif images is not None:
        pattern = source.pattern if isinstance(source, Stills) else None
        source = Stills(folder=images, pattern=pattern)
    elif rate is not None:
        if not 0 < rate <= 1000:  # noqa: PLR2004 - far beyond any camera
            raise UsageError("--rate", got=f"{rate:g}", expected="above 0, at most 1000 per second")
        source = Rate(rate_hz=rate)
    station = refreshed(replace(station, images=replace(station.images, source=source)))
    return station if calibration is None else with_calibration(station, calibration)
