"""``aerodft recompute`` of many recordings: rows that are those of each one alone, failures, and starting again."""

import shutil
import subprocess
import sys

import orjson
import pyarrow.dataset as ds
import pytest

from aerodft.app.recompute import recompute_rows
from replay.batch import Dataset, Job, JobState
from replay.recordings import Recording


def many(*arguments):
    """In a process of its own: workers are started from it."""
    command = [sys.executable, "-m", "aerodft", "recompute", *map(str, arguments), "--json"]
    return subprocess.run(command, capture_output=True, timeout=280, check=False)


@pytest.fixture
def flights(flight_recording, tmp_path):
    folder = tmp_path / "flights"
    for name in ("one", "two"):
        shutil.copytree(flight_recording, folder / name)
    (folder / "empty").mkdir()
    shutil.copytree(flight_recording, folder / "wrong")
    (folder / "wrong" / "config.toml").write_text("[station")
    (folder / "notes.txt").touch()
    return folder


def states(done):
    return {each["recording"]: each["state"] for each in orjson.loads(done.stdout)["recordings"]}


def test_rows_are_those_of_each_recording(flights, flight_recording):
    pattern, out = flights / "*", flights / "dataset"
    first = many(pattern, "--scheduler", "processes", "--workers", 1, "-o", out)
    assert first.returncode == 5, first.stderr.decode()
    assert states(first) == {"wrong": "failed", "empty": "failed", "one": "done", "two": "done"}
    said = first.stderr.decode()
    assert f"aerodft: {flights / 'empty'}: there is no recording: got an empty folder" in said
    assert f"aerodft: {flights / 'wrong' / 'config.toml'}: " in said
    assert "2 recordings computed, 0 were done before, 2 failed; 30 measurements" in said

    table = ds.dataset(out, partitioning="hive").to_table()
    items = [orjson.loads(payload) for payload in Recording(flight_recording).measurements()]
    for name in ("one", "two"):
        rows = [row for row in table.to_pylist() if row["recording"] == name]
        assert [(row["name"], row["stamp_ns"], row["value"], row["std"]) for row in rows] == [
            (item["name"], int(item["stamp_ns"]), item["value"], item["std"]) for item in items
        ]
        assert {row["recording_folder"] for row in rows} == {str(flights / name)}
        assert {row["recorded_config"] for row in rows} == {item["config"] for item in items}


@pytest.mark.nightly
def test_what_is_done_is_not_done_again(flights, flight_recording, tmp_path):
    pattern, out = flights / "*", tmp_path / "dataset"
    many(pattern, "-o", out)
    parts = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
    shutil.copy(flight_recording / "config.toml", flights / "wrong")
    shutil.rmtree(flights / "empty")
    again = many(pattern, "-o", out)
    assert (again.returncode, states(again)) == (0, {"wrong": "done", "one": "skipped", "two": "skipped"})
    assert {path: path.stat().st_mtime_ns for path in parts} == parts


def test_rows_of_another_configuration_take_the_place_of_others_only_when_asked(flights, flight_recording, tmp_path):
    config = tmp_path / "higher.toml"
    text = (flight_recording / "config.toml").read_text()
    config.write_text(text.replace("home_above_plane_m = 0.0", "home_above_plane_m = 2.5"))
    job, dataset = Job(recording="one", folder=flights / "one"), Dataset.at(tmp_path / "out")
    assert recompute_rows(job, dataset=dataset).state is JobState.DONE
    refused = recompute_rows(job, dataset=dataset, config=config)
    assert (refused.state, "add `overwrite`" in refused.sentence) == (JobState.FAILED, True)
    assert recompute_rows(job, dataset=dataset).state is JobState.SKIPPED
    assert recompute_rows(job, dataset=dataset, config=config, overwrite=True).state is JobState.DONE
    rows = ds.dataset(dataset.folder, partitioning="hive").to_table().to_pylist()
    assert len(rows) == 15
    assert {row["config"] == row["recorded_config"] for row in rows} == {False}


def test_what_makes_no_sense_is_one_sentence(aerodft, flights, tmp_path):
    for arguments, code, sentence in (
        ([tmp_path / "none*"], 3, "there is no recording"),
        ([flights / "one", "--scheduler", "slurm"], 2, "--scheduler: got slurm, expected processes or tcp://host:port"),
        ([flights / "one"], 2, "--output: got nothing, expected a new folder for the new recording"),
        ([flights / "one", "--workers", "2", "-o", tmp_path / "x"], 2, "--workers: got one recording"),
        ([flights / "o*", "-o", flights / "notes.txt"], 3, "the dataset cannot be written"),
        ([flights / "o*", "-o", tmp_path / "d", "--scheduler", "tcp://127.0.0.1:1"], 3, "no scheduler with workers"),
    ):
        run = aerodft("recompute", *arguments)
        assert (run.code, run.out, sentence in run.last) == (code, b"", True), run.err
