"""Many recordings computed anew at once over Dask, into a Parquet dataset with a partition for each.

One task a recording, none of which stops the others; needs the extra ``batch``. A part of the dataset is whole, and
known by what it follows from.
"""

import hashlib
import logging
import os
import socket
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, Final, TypeAlias
from urllib.parse import quote

import orjson

from aerodft.adapters.files import check_is_local
from aerodft.errors import InputError, LinkError, os_errors_as
from aerodft.version import SOFTWARE

DaskObject: TypeAlias = Any
"""Of Dask, an extra, which is loaded when it is needed."""

_CONNECT_S: Final = 5
_WORKERS_S: Final = 30
_MOST_DEATHS: Final = 1
"""So often a worker may die of a recording before another try is none."""

_KEY = "aerodft.key"
_STATUSES = "aerodft.statuses"
_LEFT_OUT = "aerodft.left_out"
_NAME_DIGITS = 16


class JobState(StrEnum):
    """Outcomes of a recording's computation."""

    DONE = "done"
    SKIPPED = "skipped"
    FAILED = "failed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One recording to compute.

    Attributes:
        recording: Its name in the dataset, unique in a batch.
        folder: Where it is, for all workers.
    """

    recording: str
    folder: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOutcome:
    """Outcome of one recording's computation.

    Attributes:
        recording: Its name.
        state: Whether it was computed.
        statuses: Measurements by status.
        sentence: Why it failed; of one that was computed, what of it could not be read.
    """

    recording: str
    state: JobState
    statuses: dict[str, int] = field(default_factory=dict)
    sentence: str = ""


Work = Callable[[Job], JobOutcome]


def jobs_of(folders: Sequence[Path]) -> list[Job]:
    """Jobs with the folders' names; where two are the same, with as many folders above as tell them apart."""
    names = {folder: folder.name for folder in folders}
    for depth in range(2, max((len(folder.parts) for folder in folders), default=0) + 1):
        twice = {name for name, count in Counter(names.values()).items() if count > 1}
        names |= {folder: "/".join(folder.parts[-depth:]) for folder in folders if names[folder] in twice}
    return [Job(recording=names[folder], folder=folder) for folder in folders]


def run_batch(jobs: Sequence[Job], work: Work, scheduler: str, workers: int) -> Iterator[JobOutcome]:
    """Run jobs, as many at once as there are threads, and give the outcomes as they come.

    Args:
        jobs: Recordings.
        work: Picklable; run in a worker's process.
        scheduler: ``processes`` for processes of this machine, else a scheduler's address. Whoever owns that can run
            anything on the workers and here: it must be trusted.
        workers: Processes of this machine.

    Raises:
        InputError: The extra is not installed.
        LinkError: The scheduler cannot be reached, or has no worker.
    """
    with _client(scheduler, min(workers, len(jobs))) as client:
        waiting = iter(jobs)
        running = {client.submit(work, job, pure=False): job for job in islice(waiting, _threads(client))}
        futures = _distributed().as_completed(list(running))
        for future in futures:
            job = running.pop(future)
            yield _outcome(job, future)
            for following in islice(waiting, max(_threads(client) - len(running), 0)):
                submitted = client.submit(work, following, pure=False)
                running[submitted] = following
                futures.add(submitted)


def _threads(client: DaskObject) -> int:
    """Number of jobs that run at once; a worker that died is being replaced."""
    count: int = sum(client.nthreads().values())
    return max(count, 1)


def _outcome(job: Job, future: DaskObject) -> JobOutcome:
    error = future.exception()
    if error is None:
        outcome: JobOutcome = future.result()
        return outcome
    if type(error).__name__ == "KilledWorker":
        what = f"the worker died of it, {_MOST_DEATHS + 1} times; killed, or out of memory?"
    else:
        what = f"the worker failed: {type(error).__name__}: {error}"
    return JobOutcome(recording=job.recording, state=JobState.FAILED, sentence=str(InputError(what, where=job.folder)))


@contextmanager
def _client(scheduler: str, workers: int) -> Iterator[DaskObject]:
    """A client of a scheduler with workers; a local one listens on loopback only, and has no dashboard."""
    distributed = _distributed()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what a worker died of is said here
    with ExitStack() as stack:
        address: DaskObject = scheduler
        if scheduler == "processes":
            settings = {
                "distributed.scheduler.allowed-failures": _MOST_DEATHS,
                "distributed.scheduler.worker-saturation": 1.0,
            }
            stack.enter_context(import_module("dask.config").set(settings))
            address = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address=None,
                    scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # of its health; its usual port may be taken
                    worker_dashboard_address=None,
                    local_directory=stack.enter_context(tempfile.TemporaryDirectory(prefix="aerodft-batch-")),
                    silence_logs=logging.CRITICAL,
                )
            )
        try:
            client = stack.enter_context(distributed.Client(address, timeout=_CONNECT_S))
            client.wait_for_workers(1, timeout=_WORKERS_S)
        except (OSError, TimeoutError, ValueError) as error:
            raise LinkError("no scheduler with workers there", where=scheduler, got=error) from error
        yield client


def _distributed() -> DaskObject:
    try:
        return import_module("distributed")
    except ImportError as error:
        raise InputError("many recordings at once need Dask", hint="install aerodft[batch]") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class InputKey:
    """Hashes of all inputs that a part of the dataset depends on.

    Attributes:
        recording: Of the recording's data.
        all: Of that, of the configurations and of the software.
    """

    recording: str
    all: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of the dataset while it is written: where, and what its footer must say."""

    path: Path
    metadata: dict[str, str]


def recording_hash(segments: Sequence[Path]) -> str:
    """``sha256:...`` of a recording's data: of its segments' SHA-256 digests, one behind the other.

    Raises:
        InputError: A segment cannot be read.
    """
    data = hashlib.sha256()
    for path in segments:
        with os_errors_as("the recording cannot be read", where=path), path.open("rb") as file:
            data.update(hashlib.file_digest(file, "sha256").digest())
    return f"sha256:{data.hexdigest()}"


def input_key(segments: Sequence[Path], texts: Sequence[str]) -> InputKey:
    """The key of a recording's data segments and of the texts that they are computed with, by this software.

    Raises:
        InputError: A segment cannot be read.
    """
    recording = recording_hash(segments)
    whole = hashlib.sha256(SOFTWARE.encode())
    whole.update(bytes.fromhex(recording.removeprefix("sha256:")))
    for text in texts:
        whole.update(hashlib.sha256(text.encode()).digest())
    return InputKey(recording=recording, all=f"sha256:{whole.hexdigest()}")


@dataclass(frozen=True, slots=True)
class Dataset:
    """A folder ``recording=<name>/part-<key>.parquet``, partitioned as Hive does it.

    Attributes:
        folder: Where.
    """

    folder: Path

    @classmethod
    def at(cls, folder: Path) -> "Dataset":
        """The dataset in a folder, which is made.

        Raises:
            InputError: It holds something else, or cannot be written.
        """
        check_is_local(folder)
        with os_errors_as("the dataset cannot be written", where=folder):
            folder.mkdir(parents=True, exist_ok=True)
            strange = next((each for each in folder.iterdir() if not each.name.startswith("recording=")), None)
        if strange is not None:
            expected = "a new folder, or a dataset of recording=... folders"
            raise InputError("the folder holds something else", where=folder, got=strange.name, expected=expected)
        return cls(folder.resolve())

    def done(self, recording: str, key: InputKey) -> dict[str, int] | None:
        """Measurements by status of a part that is there for this key; None where it is not."""
        path = self._path(recording, key)
        if not path.is_file():
            return None
        metadata = _metadata(path)
        if metadata is None or metadata.get(_KEY) != key.all:
            return None  # damaged since, or another key of the same beginning: made again
        statuses: dict[str, int] = orjson.loads(metadata.get(_STATUSES, "{}"))
        return statuses

    @contextmanager
    def part(self, recording: str, key: InputKey, *, overwrite: bool) -> Iterator[Part]:
        """A part to be written; it counts when the block is through, and then replaces what was of other input.

        Raises:
            InputError: There are rows of other input, which must not be replaced; or it cannot be written.
        """
        path = self._path(recording, key)
        others = [each for each in path.parent.glob("part-*.parquet") if each != path]
        if others and not overwrite:
            raise InputError(
                "the dataset has rows of it that follow from other input (recording, configuration or software)",
                where=path.parent,
                got=others[0].name,
                expected=path.name,
                hint="choose another `output`, or add `overwrite`",
            )
        partial = path.with_name(f".{path.stem}.{socket.gethostname()}.{os.getpid()}")
        try:
            path.parent.mkdir(exist_ok=True)
            _clear(path.parent, path.stem)
            try:
                yield Part(path=partial, metadata={_KEY: key.all})
                partial.replace(path)
            finally:
                partial.unlink(missing_ok=True)
            for each in others:
                each.unlink()
        except OSError as error:
            raise InputError("the dataset cannot be written", where=path, got=error) from error
        finally:
            _remove_if_empty(path.parent)

    @staticmethod
    def statuses_text(statuses: Mapping[str, int], left_out: str = "") -> dict[str, str]:
        """Footer text of a part: statuses of its rows, and what it leaves out."""
        return {_STATUSES: orjson.dumps(dict(statuses)).decode(), _LEFT_OUT: left_out}

    def left_out(self, recording: str, key: InputKey) -> str:
        """Sentence of a finished part on what is not in it; empty where that is nothing."""
        return (_metadata(self._path(recording, key)) or {}).get(_LEFT_OUT, "")

    def _path(self, recording: str, key: InputKey) -> Path:
        digits = key.all.removeprefix("sha256:")[:_NAME_DIGITS]
        return self.folder / f"recording={quote(recording, safe=' ')}" / f"part-{digits}.parquet"


def _metadata(path: Path) -> dict[str, str] | None:
    from replay.export import parquet_metadata  # noqa: PLC0415 - slow to load, and hashes are asked for without it

    return parquet_metadata(path)


def _clear(folder: Path, stem: str) -> None:
    """Remove what workers of this machine that were killed left of this part."""
    host = socket.gethostname()
    for each in folder.glob(f".{stem}.{host}.*"):
        if not Path(f"/proc/{each.name.rsplit('.', 1)[-1]}").exists():
            each.unlink(missing_ok=True)


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError:
        return  # something is in it, which is the rule
