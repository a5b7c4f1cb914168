"""Many recordings computed anew, by processes of this machine or of a cluster: which, and what each of them does."""

import glob
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import chain
from operator import itemgetter
from pathlib import Path

import typer

from aerodft.adapters.config.station import resolved_toml
from aerodft.adapters.wire.measurement import encode_measurement
from aerodft.app.assembly import RunStatistics, run
from aerodft.cli.output import LOSS, gaps, print_json, progress_bar, say
from aerodft.cli.recomputing import Recomputation, prepare
from aerodft.errors import AerodftError, InputError, NoAnswerError, UsageError
from aerodft.service import Batches, StepOutputs
from replay.batch import Dataset, InputKey, Job, Outcome, State, input_key, jobs_of, run_batch
from replay.export import ParquetRows


@dataclass(frozen=True, slots=True, kw_only=True)
class Many:
    """How all recordings of a batch are computed.

    Attributes:
        config: Another configuration.
        calibration: Another calibration.
        overwrite: Whether rows of other input are replaced.
    """

    config: Path | None
    calibration: Path | None
    overwrite: bool


def are_many(recordings: Sequence[str]) -> bool:
    """Whether these are several recordings, or a pattern for them."""
    return len(recordings) > 1 or (glob.has_magic(recordings[0]) and not Path(recordings[0]).exists())


def recompute_many(
    recordings: Sequence[str], output: Path, many: Many, scheduler: str, workers: int | None, *, as_json: bool
) -> None:
    """Compute recordings anew into a dataset, and say what became of each.

    Args:
        recordings: Folders, and patterns for folders.
        output: The dataset's folder.
        many: How.
        scheduler: ``processes``, or a Dask scheduler's address.
        workers: Local processes; None for one a core.
        as_json: Print a JSON document as well.

    Raises:
        UsageError: The scheduler is neither.
        InputError: There is no such recording, the scheduler cannot be reached, or the dataset cannot be written.
        Exit: With 5, where a recording failed, or is not whole.
    """
    if scheduler != "processes" and "://" not in scheduler:
        raise UsageError("--scheduler", got=scheduler, expected="processes or tcp://host:port")
    dataset = Dataset.at(output)
    jobs = jobs_of(_folders(recordings, output))
    settled = Many(
        config=None if many.config is None else many.config.resolve(),
        calibration=None if many.calibration is None else many.calibration.resolve(),
        overwrite=many.overwrite,
    )
    work = partial(recompute_rows, dataset=dataset, many=settled)
    outcomes: dict[str, Outcome] = {}
    with progress_bar("recomputing", 0, len(jobs)) as progress:
        for outcome in run_batch(jobs, work, scheduler, workers or len(os.sched_getaffinity(0))):
            outcomes[outcome.recording] = outcome
            progress(len(outcomes))
            if outcome.sentence:
                say(f"aerodft: {outcome.sentence}")
    _report([outcomes[job.recording] for job in jobs], output, as_json=as_json)


def _folders(recordings: Sequence[str], output: Path) -> list[Path]:
    """The folders that are meant, each once, in order of their names within a pattern."""
    found: dict[Path, None] = {}
    for each in recordings:
        is_pattern = glob.has_magic(each) and not Path(each).exists()
        matching = sorted(glob.glob(each)) if is_pattern else [each]  # noqa: PTH207 - an absolute one as well
        for path in map(Path, matching):
            if path.is_file() and path.suffix != ".mcap":
                say(f"aerodft: {path}: no recording; left out")
            elif path.resolve() != output.resolve():
                found.setdefault(path.resolve())
    if not found:
        where = ", ".join(recordings)
        raise InputError("there is no recording", where=where, got="nothing", expected="folders with data_000.mcap")
    return list(found)


def recompute_rows(job: Job, *, dataset: Dataset, many: Many) -> Outcome:
    """Compute one recording anew into its part of the dataset; skips what is done. Runs in a worker's process."""
    try:
        ready = prepare(job.folder, many.config, many.calibration)
        key = _key(ready)
        done = dataset.done(job.recording, key)
        if done is not None:
            return _outcome(job, State.SKIPPED, done, dataset.left_out(job.recording, key))
        statistics = RunStatistics()
        with dataset.part(job.recording, key, overwrite=many.overwrite) as part:
            constants = {
                "recording_folder": str(job.folder),
                "recording_sha256": key.recording,
                "recorded_config": ready.was.pipeline.config_id,
                "recorded_calibration": None if ready.was.calibration is None else ready.was.calibration.id,
            }
            with ParquetRows(part.path, constants=constants, metadata=part.metadata) as rows:
                run(ready.feed, ready.pipeline, (_RowSink(rows), statistics))
                if not rows.count:
                    raise NoAnswerError("nothing was measured", where=job.folder, got="no probe in any image")
                left_out = gaps(ready.recording.left_out())
                rows.describe(dataset.statuses_text(statistics.measurements, left_out))
        return _outcome(job, State.DONE, statistics.measurements, left_out)
    except AerodftError as error:
        sentence = str(error) if str(job.folder) in str(error) else f"{job.folder}: {error}"
        return Outcome(recording=job.recording, state=State.FAILED, sentence=sentence)


def _outcome(job: Job, state: State, statuses: Mapping[str, int], left_out: str) -> Outcome:
    sentence = f"{job.folder}: {left_out}" if left_out else ""
    return Outcome(recording=job.recording, state=state, statuses=dict(statuses), sentence=sentence)


def _key(ready: Recomputation) -> InputKey:
    """What the numbers follow from: the recorded input, its configuration and the one to compute with."""
    texts = (ready.recording.text("config.toml") or "", resolved_toml(ready.station))
    return input_key([segment.path for segment in ready.recording.data], texts)


class _RowSink:
    """Takes measurements, and writes rows."""

    def __init__(self, rows: ParquetRows) -> None:
        self._rows = rows

    def take(self, batches: Batches, outputs: StepOutputs) -> None:  # noqa: ARG002 - the recording holds what was read
        """Add the measurements of some ticks, in their order."""
        parts = [zip(order.tolist(), batch, strict=True) for _, order, batch in outputs.measured()]
        for _, measurements in sorted(chain.from_iterable(parts), key=itemgetter(0)):
            self._rows.add(map(encode_measurement, measurements))

    def close(self) -> None:
        """The rows close themselves."""


def _report(outcomes: list[Outcome], output: Path, *, as_json: bool) -> None:
    """Say what became of all of them.

    Raises:
        Exit: With 5, where one failed, or is not whole.
    """
    if as_json:
        print_json({"dataset": str(output), "recordings": [asdict(outcome) for outcome in outcomes]})
    count = {state: sum(outcome.state is state for outcome in outcomes) for state in State}
    rows = sum(sum(outcome.statuses.values()) for outcome in outcomes)
    say(
        f"{output}: {count[State.DONE]} recordings computed, {count[State.SKIPPED]} were done before,"
        f" {count[State.FAILED]} failed; {rows} measurements"
    )
    if any(outcome.sentence for outcome in outcomes):
        raise typer.Exit(LOSS)
