"""Many recordings over one and over two workers: wall time, start and end of the workers included.

    python tests/bench/bench_batch.py [--recordings 20] [--seconds 600]

The wall's ratio needs two cores that nobody else uses; that of the busiest workers' processor times does not.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

from aerodft.app.recompute import recompute_rows
from aerodft.cli.main import main as aerodft
from replay.batch import Dataset, Job, JobOutcome, JobState, jobs_of, run_batch

MOST = 0.6


def one_flight(folder: Path, seconds: float) -> Path:
    """A recording of a hover, measured at 5 Hz, without images."""
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from tests.cli.conftest import CAMERA, STATION, write_tlog  # noqa: PLC0415 - each worker imports this file first

    (folder / "camera.toml").write_text(CAMERA)
    (folder / "station.toml").write_text(STATION)
    log = folder / "flight.tlog"
    with log.open("wb") as whole:  # second by second: each begins with a heartbeat
        for second in range(int(seconds)):
            whole.write(write_tlog(folder / "second.tlog", seconds=0.9, start_s=second).read_bytes())
    sys.argv = ["aerodft", "import", str(log), "-c", str(folder / "station.toml"), "-o", str(folder / "flight")]
    try:
        aerodft()
    except SystemExit as ended:
        if ended.code:
            raise
    return folder / "flight"


def work(job: Job, *, out: Path, log: Path) -> JobOutcome:
    """Recompute one recording, and note the processor time that this worker took since it was started."""
    outcome = recompute_rows(job, dataset=Dataset.at(out))
    (log / str(os.getpid())).write_text(str(time.process_time()))
    return outcome


def timed(flights: Path, folder: Path, workers: int) -> tuple[float, float, int]:
    """Wall time of a batch and processor time of its busiest worker, s; and rows."""
    out, log = folder / "out", folder / "log"
    for each in (out, log):
        each.mkdir(parents=True)
    start = time.perf_counter()
    jobs = jobs_of(sorted(flights.iterdir()))
    outcomes = list(run_batch(jobs, partial(work, out=out, log=log), "processes", workers))
    wall = time.perf_counter() - start
    assert {outcome.state for outcome in outcomes} == {JobState.DONE}
    import pyarrow.dataset as ds  # noqa: PLC0415 - as above

    rows = ds.dataset(out, partitioning="hive").count_rows()
    return wall, max(float(path.read_text()) for path in log.iterdir()), rows


def alone(flights: Path, folder: Path, workers: int) -> tuple[float, float, int]:
    """The same in a process of its own."""
    line = [sys.executable, __file__, "--flights", flights, "--into", folder, "--workers", str(workers)]
    wall, busiest, rows = json.loads(subprocess.run(line, check=True, stdout=subprocess.PIPE).stdout)
    return wall, busiest, rows


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--recordings", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--flights", type=Path, help="only once, of these, for whoever reads JSON")
    parser.add_argument("--into", type=Path)
    parser.add_argument("--workers", type=int)
    options = parser.parse_args(arguments)
    if options.flights:
        print(json.dumps(timed(options.flights, options.into, options.workers)))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        flight = one_flight(folder, options.seconds)
        flights = folder / "flights"
        for number in range(options.recordings):
            shutil.copytree(flight, flights / f"flight-{number:02d}")
        alone(flights, folder / "warm", 2)  # compiled functions are cached from here on
        runs = {workers: alone(flights, folder / str(workers), workers) for workers in (1, 2)}
    for workers, (wall, busiest, rows) in runs.items():
        print(f"{workers} at once: {wall:6.1f} s, busiest worker {busiest:6.1f} s of a processor, {rows} rows")
    wall, busiest = (runs[2][which] / runs[1][which] for which in (0, 1))
    print(f"two workers take {wall:.2f} of the time of one (at most {MOST}), {busiest:.2f} of its processor time each")


if __name__ == "__main__":
    main()
