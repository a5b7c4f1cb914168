"""Every call that a recorder makes to the disk fails once, each in a recording of its own: nothing is lost by it.

By day every eighth of them.
"""

import errno
import itertools
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader

from aerodft.adapters.recording.recover import recover_folder
from aerodft.adapters.recording.write import (
    McapRecorder,
    RecorderSettings,
    RecordingTotals,
    segment,
    segmented_writer,
)
from aerodft.errors import InputError
from aerodft.model import WireProtocol
from aerodft.service import block_of
from replay.recordings import Recording
from tests.batches import one_tick, take
from tests.nights import at_night

from .small_recording import CAMERA, FRAMES, STEPS, frames_in, images_in, record, write_at_once

CALLS = ("open", "write", "ftruncate", "fdatasync", "fsync", "close", "statvfs")


class FaultyDisk:
    """The calls of ``os``, real ones, but for the ``which``-th of one name.

    Counted by name: two threads call, and of all calls together the ``which``-th is another one in each run.
    """

    def __init__(self, name: str, which: int, number: int) -> None:
        self._name = name
        self._which = which
        self._number = number
        self._calls = itertools.count()
        self.failed = ""

    def __getattr__(self, name: str):
        real = getattr(os, name)
        if name not in CALLS:
            return real

        def call(*arguments):
            if name == "close":  # a file that is closed with an error is closed
                real(*arguments)
                self.check(name)
                return None
            if name != "write":
                self.check(name)
            if name == "write" and self.failed == "short":
                self.failed = "write"
                raise OSError(self._number, os.strerror(self._number))
            if name == self._name == "write" and next(self._calls) == self._which:  # half of it, and then nothing more
                self.failed = "short"
                return real(arguments[0], arguments[1][: len(arguments[1]) // 2])
            return real(*arguments)

        return call

    def check(self, name: str) -> None:
        if name == self._name and next(self._calls) == self._which:
            self.failed = name
            raise OSError(self._number, os.strerror(self._number))


def check_files(folder: Path, totals: RecordingTotals) -> None:
    """What the recorder says is what stock and own readers find, in order, once."""
    assert totals.offered == totals.messages + totals.lost_messages
    assert totals.offered_images == totals.images + totals.lost_images + totals.shed_images == STEPS
    assert recover_folder(folder).is_lossy == bool(totals.lost)
    for path in sorted(folder.glob("*.mcap")):
        with path.open("rb") as stream:
            stock = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())
        assert stock > 0
    recording = Recording(folder)
    frames, images = frames_in(recording), images_in(recording)
    assert (sum(1 for _ in recording.messages()), len(images)) == (totals.messages, totals.images)
    assert frames == sorted(set(frames)), "in order, and none twice"
    assert len(frames) == STEPS * FRAMES - totals.lost_messages
    assert images == sorted(set(images))
    assert recording.is_whole
    assert not recording.left_out(images=True)


@pytest.fixture
def folder() -> Iterator[Path]:
    """Where a sync costs nothing, if there is such a place."""
    memory = Path("/dev/shm")  # noqa: S108 - a folder of its own is made in it
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else None) as name:
        yield Path(name)


@pytest.mark.parametrize(
    ("number", "every", "mode"),
    [
        (errno.ENOSPC, 8, "import"),
        (errno.EIO, 8, "live"),
        *at_night(*itertools.product([errno.ENOSPC, errno.EIO], [1], ["import", "live"])),
    ],
)
def test_a_call_that_fails_once_costs_nothing(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    every: int,
    mode: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level("CRITICAL")
    write_at_once(monkeypatch)
    allocate = segment.allocate
    failed: dict[str, int] = {}
    refused = lost = count = 0
    names = [*CALLS, "fallocate"]
    while names:
        name, which = names[0], failed.get(names[0], 0)
        faults = FaultyDisk(name, which, number)

        def faulty_allocate(*arguments, faults=faults):
            faults.check("fallocate")
            allocate(*arguments)

        monkeypatch.setattr(segment, "os", faults)
        monkeypatch.setattr(segment, "allocate", faulty_allocate)
        try:
            *_, totals = record(folder / f"{name}_{which}", lossless=mode == "import")
        except InputError:
            refused += 1
        else:
            monkeypatch.setattr(segment, "os", os)
            monkeypatch.setattr(segment, "allocate", allocate)
            assert totals is not None
            check_files(folder / f"{name}_{which}", totals)
            lost += totals.lost
        if faults.failed:
            failed[name] = which + every
            count += 1
        else:  # there are no more of this name
            names.pop(0)
    print(
        f"\n{os.strerror(number)}: {failed}; refused at the start {refused}, lost {lost} messages in {count} recordings"
    )
    assert set(failed) >= {"open", "write", "fdatasync", "fsync", "fallocate", "ftruncate"}
    assert lost == 0
    assert refused < 30


def test_a_folder_that_vanishes_is_a_loss_that_is_counted(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(segmented_writer, "FLUSH_S", 0.0)
    monkeypatch.setattr(segmented_writer, "SYNC_S", 0.0)
    settings = RecorderSettings(station="s", camera=CAMERA, lossless=True)
    made = McapRecorder(folder / "r", settings, started_ns=1)

    def send(step: int) -> None:
        block = block_of(WireProtocol.MAVLINK, "a", [step * 100], [b"x" * 100])
        take(made, one_tick(step * 100, [block]))

    send(1)
    shutil.rmtree(folder / "r")
    until_s, step = time.monotonic() + 30, 1
    while not made.totals.lost_messages and time.monotonic() < until_s:
        step += 1
        send(step)
        time.sleep(0.01)
    made.close()
    totals = made.totals
    assert totals.messages == 0, "nothing is there"
    assert totals.offered == totals.lost_messages >= step
    assert (totals.images, totals.lost_images) == (0, 0), "none was offered"
    assert "No such file or directory" in caplog.text
    assert not (folder / "r").exists()
