"""Many recordings at once over Dask: one task each, none of which stops the others; needs the extra ``batch``."""

import logging
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, Final

from aerodft.errors import InputError, LinkError

_CONNECT_S: Final = 5
_WORKERS_S: Final = 30
_MOST_DEATHS: Final = 1
"""So often a worker may die of a recording before another try is none."""


class State(StrEnum):
    """What became of a recording."""

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
class Outcome:
    """What became of one recording.

    Attributes:
        recording: Its name.
        state: Whether it was computed.
        statuses: Measurements by status.
        sentence: Why it failed; of one that was computed, what of it could not be read.
    """

    recording: str
    state: State
    statuses: dict[str, int] = field(default_factory=dict)
    sentence: str = ""


Work = Callable[[Job], Outcome]


def jobs_of(folders: Sequence[Path]) -> list[Job]:
    """Jobs with the folders' names; where two are the same, with as many folders above as tell them apart."""
    names = {folder: folder.name for folder in folders}
    for depth in range(2, max((len(folder.parts) for folder in folders), default=0) + 1):
        twice = {name for name, count in Counter(names.values()).items() if count > 1}
        names |= {folder: "/".join(folder.parts[-depth:]) for folder in folders if names[folder] in twice}
    return [Job(recording=names[folder], folder=folder) for folder in folders]


def run_batch(jobs: Sequence[Job], work: Work, scheduler: str, workers: int) -> Iterator[Outcome]:
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


def _threads(client: Any) -> int:  # noqa: ANN401 - an extra's
    """How many jobs run at once; a worker that died is being replaced."""
    count: int = sum(client.nthreads().values())
    return max(count, 1)


def _outcome(job: Job, future: Any) -> Outcome:  # noqa: ANN401 - an extra's
    error = future.exception()
    if error is None:
        outcome: Outcome = future.result()
        return outcome
    if type(error).__name__ == "KilledWorker":
        what = f"the worker died of it, {_MOST_DEATHS + 1} times; killed, or out of memory?"
    else:
        what = f"the worker failed: {type(error).__name__}: {error}"
    return Outcome(recording=job.recording, state=State.FAILED, sentence=str(InputError(what, where=job.folder)))


@contextmanager
def _client(scheduler: str, workers: int) -> Iterator[Any]:
    """A client of a scheduler with workers; a local one listens on loopback only, and has no dashboard."""
    distributed = _distributed()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what a worker died of is said here
    with ExitStack() as stack:
        address: Any = scheduler
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


def _distributed() -> Any:  # noqa: ANN401 - an extra's, and slow to load
    try:
        return import_module("distributed")
    except ImportError as error:
        raise InputError("many recordings at once need Dask", hint="install aerodft[batch]") from error
