"""``aerodft recompute``: the same pipeline over a recording's raw input, or over that of many recordings."""

import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import tomli_w
import typer

from aerodft.adapters.config.station import load_station, with_calibration
from aerodft.app.assembly import RunStatistics, build_recorder, closing_recorder, run
from aerodft.cli.ending import Interruptible
from aerodft.cli.option_values import TopicOption, parse_topics
from aerodft.cli.output import progress_bar, say
from aerodft.cli.recompute_many import Many, are_many, recompute_many
from aerodft.cli.recomputing import Recomputation, prepare
from aerodft.cli.summary import report
from aerodft.errors import InputError, UsageError
from replay.batch import recording_hash
from replay.foreign import is_foreign
from replay.recordings import Recording

_SAID = ("recording", "recording_sha256", "config", "calibration")
_FROM_IMAGE_TO_IMAGE = {"objects": "[objects]", "tracked": "tracked probes"}

COMPUTED_FROM: Final = "computed_from.toml"


def recompute(
    recording: Annotated[list[str], typer.Argument(help="Folder of the recording; several, or a pattern in quotes.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="New folder for the new recording; of many: of the Parquet dataset."),
    ] = None,
    config: Annotated[Path | None, typer.Option("--config", "-c", help="Another configuration.")] = None,
    calibration: Annotated[Path | None, typer.Option(help="Another calibration.")] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Many recordings at once: processes (of this machine), or a Dask scheduler's tcp://host:port."
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes of this machine; without it, one for each core.", min=1)
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Of many: replace what the dataset has of other input.")
    ] = False,
    vision: Annotated[
        bool,
        typer.Option("--vision", help="Find markers and steady points again in the recorded images, and compare."),
    ] = False,
    topic: TopicOption = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    r"""Compute a recording's measurements anew.

    With the recording's own configuration the measurements are identical to the byte on the same machine. Images are
    copied, not encoded again. It starts from the recorded observations; with --vision what aerodft itself saw is found
    again in the recorded images, and how far it is from where it was is said. Exit 5 where damaged or missing parts of
    the recording are left out.

    Of many recordings (several, a pattern, or with --scheduler) one row per measurement goes into a Parquet dataset,
    which docs/batch.md describes: ./recomputed without --output. One that fails is reported, the others go on (exit 5);
    started again, it does what is not done.

    \b
    Example:
      aerodft recompute recordings/flight --calibration better.toml -o recordings/flight-better
      aerodft recompute 'flights/*' --scheduler processes -o dataset
    """
    if scheduler is not None or are_many(recording):
        if vision:
            raise UsageError("--vision", got="several recordings", expected="one recording")
        many = Many(config=config, calibration=calibration, overwrite=overwrite)
        recompute_many(recording, output or Path("recomputed"), many, scheduler or "processes", workers, as_json=json)
        return
    for name, given in (("--workers", workers), ("--overwrite", overwrite)):
        if given:
            raise UsageError(name, got="one recording", expected="--scheduler, or several recordings")
    if output is None:
        raise UsageError("--output", got="nothing", expected="a new folder for the new recording")
    path = Path(recording[0])
    if is_foreign(path):
        _measure_foreign(path, output, config, calibration, topic, as_json=json)
    else:
        _recompute_one(path, output, config, calibration, vision=vision, as_json=json)


def _measure_foreign(
    path: Path, output: Path, config: Path | None, calibration: Path | None, topic: list[str] | None, *, as_json: bool
) -> None:
    """Another tool's recording, which has no configuration of its own."""
    if config is None:
        hint = "it says what to measure, and with which camera"
        raise UsageError("no --config for another tool's recording", expected="--config FILE", hint=hint)
    station = load_station(config)
    if calibration is not None:
        station = with_calibration(station, calibration)
    station = replace(station, topics=parse_topics(topic, station.topics))
    from aerodft.cli.flight import measure_flight

    measure_flight(station, path, (), output, where=config, as_json=as_json)


def _recompute_one(
    folder: Path, output: Path, config: Path | None, calibration: Path | None, *, vision: bool, as_json: bool
) -> None:
    ready = prepare(folder, config, calibration, vision=vision)
    old, statistics, source = ready.recording, RunStatistics(), computed_from(ready)
    texts = {COMPUTED_FROM: computed_from_toml(source)}
    recorder = build_recorder(ready.station, output, started_ns=old.start_ns, lossless=True, image_hz=0.0, texts=texts)
    with closing_recorder(recorder, output), progress_bar("recomputing", old.start_ns, old.end_ns) as progress:
        run(Interruptible(ready.feed), ready.pipeline, (recorder, statistics), progress)
    if next(old.image_messages(), None) is not None:
        _copy_images(old, output)
        say(f"images: {len(old.images)} segments copied as they are")
    seen: dict[str, object] = {"computed_from": {key: source[key] for key in _SAID if key in source}}
    warnings: tuple[str, ...] = ()
    if ready.again is not None:
        moved = ready.again.moved
        seen |= {**ready.eyes.report(ready.again.counts), "vision": moved.document()}
        say(moved.sentence())
        warnings = _of_few_images(ready.eyes.names, moved.kept)
    counts, left_out = ready.pipeline.counts, old.left_out(images=vision)
    report(recorder.totals, statistics, counts, as_json=as_json, warnings=warnings, seen=seen, left_out=left_out)


def _of_few_images(names: tuple[str, ...], kept: int) -> tuple[str, ...]:
    """What is to be said where observers that go from image to image were shown some of them only."""
    who = " and ".join(_FROM_IMAGE_TO_IMAGE[name] for name in names if name in _FROM_IMAGE_TO_IMAGE)
    if not kept or not who:
        return ()
    sentence = (
        f"--vision: {kept} observations are of images that are not recorded; {who} go from image to image, and find"
        " other things in fewer of them: record every image (record.video = true of an H.264 stream, else image_hz of"
        " the camera's rate or more), or compare without --vision"
    )
    return (sentence,)


def _copy_images(recording: Recording, output: Path) -> None:
    for number, segment in enumerate(recording.images, start=1):
        try:
            shutil.copy2(segment.path, output / f"images_{number:03d}.mcap")
        except OSError as error:
            hint = "the measurements are complete"
            raise InputError("images cannot be copied", where=segment.path, got=error.strerror, hint=hint) from error


def computed_from(ready: Recomputation) -> dict[str, Any]:
    """The recording's own provenance, which its new measurements no longer name; ids are those in its measurements.

    Where it was computed from another one itself, what it says of that one is in it, under ``computed_from``.

    Raises:
        InputError: A segment cannot be read.
    """
    old, was = ready.recording, ready.was
    known = {
        "recording": str(old.folder.resolve()),
        "recording_sha256": recording_hash([segment.path for segment in old.data]),
        "station": was.pipeline.station,
        "camera": was.pipeline.camera.name,
        "config": was.pipeline.config_id,
        "calibration": None if was.calibration is None else was.calibration.id,
        "config_toml": old.text("config.toml"),
        "computed_from": _before(old),
    }
    return {key: value for key, value in known.items() if value is not None}


def computed_from_toml(document: dict[str, Any]) -> str:
    """The document as a file that people read."""
    return tomli_w.dumps(document, multiline_strings=True)


def _before(recording: Recording) -> dict[str, Any] | None:
    text = recording.text(COMPUTED_FROM)
    if text is None:
        return None
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError("the file is no TOML", where=recording.folder / COMPUTED_FROM, got=error) from error
