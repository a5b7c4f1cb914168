"""Many recordings at once: a dataset in which only what is whole counts, and tasks that die alone."""

import os
import subprocess
import sys
from pathlib import Path

import orjson
import pyarrow.dataset as ds
import pytest

from aerodft.errors import InputError
from replay.batch import Dataset, input_key, jobs_of
from replay.export import ParquetRows

MORTAL = """
import os, signal, sys
from pathlib import Path
import dask, orjson
from distributed import LocalCluster
from replay.batch import Job, JobOutcome, JobState, run_batch

def work(job):
    with open(job.folder / job.recording, "a") as tries:
        tries.write("x")
    if job.recording == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    if job.recording == "strange":
        raise RuntimeError("no sentence of ours")
    return JobOutcome(recording=job.recording, state=JobState.DONE, statuses={"ok": os.getpid()})

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    jobs = [Job(recording=name, folder=folder) for name in ("a", "deadly", "b", "strange", "c", "d")]
    dask.config.set({"distributed.scheduler.allowed-failures": 1})
    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None,
                      local_directory=str(folder / "scratch"), silence_logs=50) as cluster:
        outcomes = run_batch(jobs, work, cluster.scheduler_address, 9)
        got = [(o.recording, o.state, o.sentence) for o in outcomes]
    sys.stdout.buffer.write(orjson.dumps(sorted(got)))
"""


def test_a_worker_that_is_killed_costs_its_own_recording_alone(tmp_path):
    script = tmp_path / "mortal.py"
    script.write_text(MORTAL)
    done = subprocess.run([sys.executable, script, tmp_path], capture_output=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr.decode()
    got = {name: (state, sentence) for name, state, sentence in orjson.loads(done.stdout)}
    assert {name: state for name, (state, _) in got.items()} == {
        "a": "done", "b": "done", "c": "done", "d": "done", "deadly": "failed", "strange": "failed",
    }  # fmt: skip
    assert "the worker died of it, 2 times" in got["deadly"][1]
    assert "RuntimeError: no sentence of ours" in got["strange"][1]
    assert (tmp_path / "deadly").read_text() == "xx"
    assert {(tmp_path / name).read_text() for name in "abcd"} <= {"x", "xx"}


def test_names_tell_recordings_apart():
    folders = [Path("/x/one/flight"), Path("/x/two/flight"), Path("/x/two/other"), Path("/y/two/flight")]
    names = [job.recording for job in jobs_of(folders)]
    assert names == ["one/flight", "x/two/flight", "other", "y/two/flight"]


@pytest.fixture
def made(tmp_path):
    segment = tmp_path / "data_000.mcap"
    segment.write_bytes(b"raw input")
    return Dataset.at(tmp_path / "out"), segment


def written(dataset, key, *, overwrite=False, fail=False):
    with dataset.part("a/b=c", key, overwrite=overwrite) as part:
        with ParquetRows(part.path, metadata=part.metadata) as rows:
            rows.describe(dataset.statuses_text({"ok": 3}))
        if fail:
            raise OSError(28, "No space left on device")


def test_only_a_whole_part_of_the_same_input_is_done(made):
    dataset, segment = made
    key = input_key([segment], ["config"])
    assert dataset.done("a/b=c", key) is None
    with pytest.raises(InputError, match="No space left"):
        written(dataset, key, fail=True)
    assert list(dataset.folder.iterdir()) == []
    written(dataset, key)
    assert dataset.done("a/b=c", key) == {"ok": 3}
    (part,) = dataset.folder.rglob("*.parquet")
    assert ds.dataset(dataset.folder, partitioning="hive").schema.names[-1] == "recording"
    part.write_bytes(part.read_bytes()[:-9])
    assert dataset.done("a/b=c", key) is None
    written(dataset, key)
    assert dataset.done("a/b=c", key) == {"ok": 3}


def test_every_input_is_in_the_key(made):
    _, segment = made
    keys = {input_key([segment], texts).all for texts in (["a", "b"], ["ab", ""], ["a"], ["b", "a"])}
    segment.write_bytes(b"raw inpuT")
    assert len(keys | {input_key([segment], ["a", "b"]).all}) == 5


def test_rows_of_other_input_are_replaced_only_when_asked(made):
    dataset, segment = made
    old, new = input_key([segment], ["old"]), input_key([segment], ["new"])
    written(dataset, old)
    with pytest.raises(InputError, match="add `overwrite`"):
        written(dataset, new)
    assert (dataset.done("a/b=c", old), dataset.done("a/b=c", new)) == ({"ok": 3}, None)
    written(dataset, new, overwrite=True)
    assert (dataset.done("a/b=c", old), dataset.done("a/b=c", new)) == (None, {"ok": 3})


def test_what_a_killed_worker_left_is_no_part_and_goes(made):
    dataset, segment = made
    key = input_key([segment], [])
    ended = subprocess.run(["true"], check=True)
    assert ended.returncode == 0
    folder = dataset.folder / "recording=a%2Fb%3Dc"
    folder.mkdir()
    host = os.uname().nodename
    stem = f"part-{key.all.removeprefix('sha256:')[:16]}"
    gone, alive = (folder / f".{stem}.{host}.{pid}" for pid in (2**22 + 1, os.getppid()))
    for each in (gone, alive):
        each.write_bytes(b"PAR1 half")
    assert dataset.done("a/b=c", key) is None
    assert ds.dataset(dataset.folder, partitioning="hive").count_rows() == 0
    written(dataset, key)
    assert (gone.exists(), alive.exists()) == (False, True)


def test_a_folder_with_something_else_is_no_dataset(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match=r"the folder holds something else: got thesis\.tex"):
        Dataset.at(tmp_path)
