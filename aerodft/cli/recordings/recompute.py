"""``aerodft recompute``: the same pipeline over a recording's raw input, or over that of many recordings."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from aerodft.cli.flights.import_ import import_
from aerodft.cli.interrupts import interruptible
from aerodft.cli.options import ConfigOption, JsonOption, SettingOptions, TopicOption, grouped
from aerodft.cli.output import LOSS, print_json, progress, say
from aerodft.cli.summary import report
from aerodft.errors import UsageError

_PROVENANCE_KEYS = ("recording", "recording_sha256", "config", "calibration", "settings")


@dataclass(frozen=True, slots=True, kw_only=True)
class ManyOptions:
    """Options for many recordings at once."""

    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Many recordings at once: processes (of this machine), or a Dask scheduler's tcp://host:port."
        ),
    ] = None
    workers: Annotated[
        int | None, typer.Option(help="Processes of this machine; without it, one for each core.", min=1)
    ] = None
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Of many: replace what the dataset has of other input.")
    ] = False


@grouped
def recompute(
    recording: Annotated[list[str], typer.Argument(help="Folder of the recording; several, or a pattern in quotes.")],
    many: ManyOptions,
    changes: SettingOptions,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="New folder for the new recording; of many: of the Parquet dataset."),
    ] = None,
    config: ConfigOption = None,
    calibration: Annotated[Path | None, typer.Option(help="Another calibration.")] = None,
    redetect: Annotated[
        bool,
        typer.Option("--redetect", help="Find markers and steady points again in the recorded images, and compare."),
    ] = False,
    topic: TopicOption = None,
    json: JsonOption = False,
) -> None:
    r"""Compute a recording's measurements anew.

    With the recording's own configuration the measurements are identical to the byte on the same machine. --set and
    --home-above-plane change keys of it; another one (--config) keeps the clock that sync found, unless it states one.
    Images are copied, not encoded again. It starts from the recorded observations; with --redetect what aerodft itself
    saw is found again in the recorded images, and how far it is from where it was is said. Exit 5 where damaged or
    missing parts of the recording are left out.

    Of many recordings (several, a pattern, or with --scheduler) one row per measurement goes into a Parquet dataset,
    which docs/batch.md describes: ./recomputed without --output. One that fails is reported, the others go on (exit 5);
    started again, it does what is not done.

    \b
    Example:
      aerodft recompute recordings/flight --calibration better.toml -o recordings/flight-better
      aerodft recompute recordings/flight --home-above-plane 3.0 --set limits.max_range_m=80 -o recordings/higher
      aerodft recompute 'flights/*' --scheduler processes -o dataset
    """
    from aerodft.app.recompute import is_pattern
    from replay.foreign import is_foreign

    if many.scheduler is not None or len(recording) > 1 or is_pattern(recording[0]):
        if redetect:
            raise UsageError("--redetect", got="several recordings", expected="one recording")
        source = _Source(config, calibration, changes.settings())
        _recompute_many(recording, output or Path("recomputed"), source, many, as_json=json)
        return
    for name, given in (("--workers", many.workers), ("--overwrite", many.overwrite)):
        if given:
            raise UsageError(name, got="one recording", expected="--scheduler, or several recordings")
    if output is None:
        raise UsageError("--output", got="nothing", expected="a new folder for the new recording")
    path = Path(recording[0])
    if is_foreign(path):
        if config is None:
            hint = "it says what to measure, and with which camera"
            raise UsageError("no --config for another tool's recording", expected="--config FILE", hint=hint)
        changes.refuse("a recording of aerodft: of another tool's the file of --config is changed")
        import_([path], config, output, calibration=calibration, topic=topic, json=json)
    else:
        source = _Source(config, calibration, changes.settings())
        _recompute_one(path, output, source, redetect=redetect, as_json=json)


@dataclass(frozen=True, slots=True)
class _Source:
    """The configuration and calibration to compute with; None for the recording's own."""

    config: Path | None
    calibration: Path | None
    settings: dict[str, Any]


def _recompute_one(folder: Path, output: Path, source: _Source, *, redetect: bool, as_json: bool) -> None:
    from aerodft.app.recompute import recompute as recompute_recording

    with progress("recomputing") as bar, interruptible(bar) as between_batches:
        result = recompute_recording(
            folder,
            output,
            config=source.config,
            calibration=source.calibration,
            settings=source.settings,
            redetect=redetect,
            progress=between_batches,
        )
    if result.image_segments:
        say(f"images: {result.image_segments} segments copied as they are")
    provenance = {key: result.provenance[key] for key in _PROVENANCE_KEYS if key in result.provenance}
    details: dict[str, object] = {"computed_from": provenance, **result.observers}
    if result.redetection is not None:
        details["vision"] = result.redetection.document()
        say(result.redetection.sentence())
    report(result, as_json=as_json, details=details)


def _recompute_many(recordings: list[str], output: Path, source: _Source, many: ManyOptions, *, as_json: bool) -> None:
    """Compute many recordings, and say what became of all.

    Raises:
        Exit: With 5, where one failed, or is not whole.
    """
    from aerodft.app.recompute import recompute_many

    scheduler = many.scheduler or "processes"
    if scheduler != "processes" and "://" not in scheduler:
        raise UsageError("--scheduler", got=scheduler, expected="processes or tcp://host:port")
    with progress("recomputing") as bar:
        outcomes = recompute_many(
            recordings,
            output,
            config=source.config,
            calibration=source.calibration,
            settings=source.settings,
            overwrite=many.overwrite,
            scheduler=scheduler,
            workers=many.workers,
            progress=bar,
        )
    if as_json:
        print_json({"dataset": str(output), "recordings": [asdict(outcome) for outcome in outcomes]})
    states = [str(outcome.state) for outcome in outcomes]
    rows = sum(sum(outcome.statuses.values()) for outcome in outcomes)
    say(
        f"{output}: {states.count('done')} recordings computed, {states.count('skipped')} were done before,"
        f" {states.count('failed')} failed; {rows} measurements"
    )
    if any(outcome.sentence for outcome in outcomes):
        raise typer.Exit(LOSS)
