"""``aerodft recompute``: the same pipeline over a recording's raw input."""

import shutil
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.config.loading import load_station, with_calibration
from aerodft.adapters.config.station import StationConfig
from aerodft.cli.output import progress_bar
from aerodft.cli.recorded import recorded_station, reoffset
from aerodft.cli.summary import report
from aerodft.cli.wiring import Tally, build_pipeline, build_recorder, check_size, closing_recorder, run
from aerodft.errors import InputError
from aerodft.model.image import Image
from aerodft.service.feed import MergedFeed
from replay.recording import Recording
from replay.source import RecordingSource


def recompute(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="New folder for the new recording.")],
    config: Annotated[Path | None, typer.Option("--config", "-c", help="Another configuration.")] = None,
    calibration: Annotated[Path | None, typer.Option(help="Another calibration.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    r"""Compute a recording's measurements anew.

    With the recording's own configuration the measurements are identical to the byte on the same machine. Images are
    copied, not encoded again.

    \b
    Example:
      aerodft recompute recordings/flight --calibration better.toml -o recordings/flight-better
    """
    old = Recording(recording)
    was, station = _stations(old, config)
    if calibration is not None:
        station = with_calibration(station, calibration)
    _check_sizes(old, station)
    tally, pipeline = Tally(), build_pipeline(station)
    feed = MergedFeed([reoffset(RecordingSource(old), was, station)], station.pipeline.tick_ns)
    recorder = build_recorder(station, output, started_ns=old.start_ns, lossless=True, image_hz=0.0)
    with closing_recorder(recorder, output), progress_bar("recomputing", old.start_ns, old.end_ns) as progress:
        run(feed, pipeline, (recorder, tally), progress)
    _copy_images(old, output)
    report(recorder.totals, tally, pipeline.counts, as_json=json)


def _stations(recording: Recording, config: Path | None) -> tuple[StationConfig, StationConfig]:
    """The recording's own configuration (where it has none: the new one) and the one to compute with."""
    if config is None:
        own = recorded_station(recording)
        return own, own
    new = load_station(config)
    return (new if recording.text("config.toml") is None else recorded_station(recording)), new


def _check_sizes(recording: Recording, station: StationConfig) -> None:
    """Refuse a camera that the recorded images are not from; one source has images of one size.

    Raises:
        InputError: The sizes differ.
    """
    for event in RecordingSource(recording).events():
        if isinstance(event, Image) and event.width_px is not None:
            check_size(event, station.pipeline.camera, recording.folder)
            return


def _copy_images(recording: Recording, output: Path) -> None:
    for number, segment in enumerate(recording.images, start=1):
        try:
            shutil.copy2(segment.path, output / f"images_{number:03d}.mcap")
        except OSError as error:
            hint = "the measurements are complete"
            raise InputError("images cannot be copied", where=segment.path, got=error.strerror, hint=hint) from error
