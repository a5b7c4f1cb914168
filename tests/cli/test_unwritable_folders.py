"""Folders that nobody may write to, files where a folder should be, and folders that vanish: one sentence each."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from aerodft.adapters.recording.write import segmented_writer
from aerodft.service import Pipeline
from replay.recordings import Recording

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


def run_on_read_only(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """A command that sees a folder on a read-only mount of its own; skips where that may not be mounted."""
    if shutil.which("unshare") is None:
        pytest.skip("no unshare")
    command = [sys.executable, "-m", "aerodft", *map(str, arguments)]
    prefix = ["unshare", "--mount", "--map-root-user", "sh", "-c", READ_ONLY, str(folder)]
    done = subprocess.run([*prefix, *command], capture_output=True, text=True, check=False, timeout=120)
    if done.returncode in {1, 77} and not done.stderr.startswith("aerodft"):
        pytest.skip(f"no read-only mount here: {done.stderr.strip()}")
    return done


@pytest.mark.parametrize(
    "arguments",
    [
        ("recover", "./torn"),
        ("recompute", "./flight", "-o", "./again"),
        ("export", "./flight", "--format", "csv", "-o", "./table.csv"),
        ("export", "./flight", "--format", "mcap", "-o", "./one.mcap"),
        ("compare", "./flight", "./torn", "-o", "./difference"),
    ],
    ids=" ".join,
)
def test_a_read_only_folder_is_one_sentence_and_stays_as_it_is(shelf: Path, arguments: tuple[str, ...]) -> None:
    before = content(shelf)
    done = run_on_read_only(shelf, *(shelf / each[2:] if each.startswith("./") else each for each in arguments))
    assert done.returncode == 3, done.stderr
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith(f"aerodft: {shelf}"), done.stderr
    assert "Read-only file system" in last
    assert "Traceback" not in done.stderr
    assert content(shelf) == before


def test_what_is_read_only_can_be_read(shelf: Path) -> None:
    done = run_on_read_only(shelf, "recover", shelf / "flight")
    assert done.returncode == 0, done.stderr
    done = run_on_read_only(shelf, "compare", shelf / "flight", shelf / "flight", "--json")
    assert done.returncode == 0, done.stderr


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
    assert done.last.startswith(f"aerodft: {folder}/data_000.mcap: the recording cannot be read: got No such file")
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
        f"aerodft: {closed}: the recording cannot be read: got Permission denied",
    )
