"""Folders that nobody may write to, files where a folder should be, and folders that vanish: one sentence each."""

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from aerodft.adapters.recording.write import segmented_writer
from aerodft.service import Pipeline
from replay.recordings import Recording

ROOT = Path(__file__).parents[2]
FROZEN = Path(__file__).parent / "frozen-0.1"
READ_ONLY = 'mount --bind "$0" "$0" && mount -o remount,bind,ro "$0" || exit 77; exec "$@"'
TORN_BYTES = 60_000


@pytest.fixture
def shelf(tmp_path: Path) -> Path:
    """A folder with a sound recording and one that was not finished."""
    folder = tmp_path / "shelf"
    for name in ("flight", "torn"):
        shutil.copytree(FROZEN, folder / name)
    os.truncate(folder / "torn" / "data_000.mcap", TORN_BYTES)
    return folder


def content(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


WRITING = (
    ("recover", "./torn"),
    ("recompute", "./flight", "-o", "./again"),
    ("export", "./flight", "--format", "csv", "-o", "./table.csv"),
    ("export", "./flight", "--format", "mcap", "-o", "./one.mcap"),
    ("compare", "./flight", "./torn", "-o", "./difference"),
)
READING = (("recover", "./flight"), ("compare", "./flight", "./flight", "--json"))
ONE_AFTER_THE_OTHER = """
import json, sys
from tests.commands import run_aerodft
runs = [run_aerodft(*line) for line in json.loads(sys.argv[1])]
print(json.dumps([[run.code, run.err] for run in runs]))
"""


def run_on_read_only(folder: Path, lines: list[list[str]]) -> list[tuple[int, str]]:
    """Exit codes and words of commands that see a folder on a read-only mount; skips where that may not be mounted."""
    if shutil.which("unshare") is None:
        pytest.skip("no unshare")
    prefix = ["unshare", "--mount", "--map-root-user", "sh", "-c", READ_ONLY, str(folder)]
    command = [*prefix, sys.executable, "-c", ONE_AFTER_THE_OTHER, json.dumps(lines)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=120)
    if done.returncode == 77 or (done.returncode == 1 and done.stderr.startswith(("unshare", "mount"))):
        pytest.skip(f"no read-only mount here: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_read_only_folder_can_be_read_and_to_write_is_refused_in_one_sentence(shelf: Path) -> None:
    before = content(shelf)
    lines = [
        [str(shelf / word[2:]) if word.startswith("./") else word for word in line] for line in (*WRITING, *READING)
    ]
    runs = run_on_read_only(shelf, lines)
    for code, said in runs[: len(WRITING)]:
        assert code == 3, said
        last = said.strip().splitlines()[-1]
        assert last.startswith(f"aerodft: {shelf}"), said
        assert "Read-only file system" in last
    assert [code for code, _ in runs[len(WRITING) :]] == [0, 0], runs
    assert content(shelf) == before


@pytest.mark.parametrize("command", ["recompute", "export"])
def test_a_file_in_place_of_the_folder_is_one_sentence(aerodft, shelf: Path, command: str) -> None:
    (shelf / "taken").write_text("mine")
    more = ["--format", "csv"] if command == "export" else []
    done = aerodft(command, shelf / "flight", *more, "-o", shelf / "taken" / "inside")
    assert done.code == 3, done.err
    assert "Not a directory" in done.err or "File exists" in done.err
    assert "Traceback" not in done.err
    assert (shelf / "taken").read_text() == "mine"


@pytest.fixture
def vanishing(desk, aerodft, monkeypatch):
    """A recording of small chunks, longer than what is computed at once, and a way to delete a folder meanwhile."""
    monkeypatch.setattr(segmented_writer, "_CHUNK_BYTES", 4096)
    folder = desk.folder / "flight"
    assert aerodft("import", desk.tlog(seconds=100.0), "-c", desk.config, "-o", folder).code == 0
    advance = Pipeline.advance

    def delete_while_computing(gone: Path) -> None:
        def and_delete(self, batches):
            shutil.rmtree(gone, ignore_errors=True)
            return advance(self, batches)

        monkeypatch.setattr(Pipeline, "advance", and_delete)

    return folder, delete_while_computing


def test_a_recording_that_vanishes_while_it_is_read_is_one_sentence(desk, aerodft, vanishing) -> None:
    folder, delete_while_computing = vanishing
    delete_while_computing(folder)
    done = aerodft("recompute", folder, "-o", desk.folder / "again")
    assert done.code == 3, done.err
    assert done.last.startswith(f"aerodft: {folder}/data_000.mcap: the recording cannot be read: No such file")
    assert "holds what was read so far" in done.err
    assert Recording(desk.folder / "again").end_ns > 0, "what was computed until then is whole"


def test_a_recording_that_vanishes_while_it_is_written_is_a_loss(desk, aerodft, vanishing) -> None:
    folder, delete_while_computing = vanishing
    delete_while_computing(desk.folder / "again")
    before = content(folder)
    done = aerodft("recompute", folder, "-o", desk.folder / "again")
    assert done.code == 5, done.err
    assert "messages are not in the recording: they could not be written" in done.last
    assert content(folder) == before


@pytest.mark.parametrize("command", ["replay", "export", "recompute", "compare", "recover"])
def test_nobody_waits_for_who_writes_into_a_pipe(aerodft, tmp_path: Path, command: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    more = {"recompute": ("-o", tmp_path / "out"), "compare": (FROZEN,)}
    done = aerodft(command, tmp_path / "pipe", *more.get(command, ()))
    assert (done.code, done.last[: done.last.index(" got")]) == (
        3,
        f"aerodft: {tmp_path / 'pipe'}: there is no recording:",
    )


@pytest.mark.parametrize("command", ["replay", "export", "recompute", "compare"])
def test_a_folder_that_may_not_be_read_is_one_sentence(aerodft, tmp_path: Path, monkeypatch, command: str) -> None:
    """As if without the right: tests may run as root, who has all of them."""
    closed, list_it = tmp_path / "closed", Path.iterdir
    shutil.copytree(FROZEN, closed)

    def refusing(path: Path):
        if path == closed:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return list_it(path)

    monkeypatch.setattr(Path, "iterdir", refusing)
    more = {"recompute": ("-o", tmp_path / "out"), "compare": (FROZEN,)}
    done = aerodft(command, closed, *more.get(command, ()))
    assert (done.code, done.last) == (
        3,
        f"aerodft: {closed}: the recording cannot be read: Permission denied",
    )
