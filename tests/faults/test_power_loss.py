"""The power fails at any moment of a recording: what was synced is read, and what is missing is said.

As SQLite simulates it: of what was written since a file's last sync any part of a sector's size may have reached the
disk, in any order; of a file's size, and of its name where its folder was not synced since, either state.
"""

import os
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

from aerodft.adapters.recording.recover import recover_folder
from aerodft.adapters.recording.write import segment
from aerodft.errors import AerodftError
from replay.recordings import Recording
from tests.nights import at_night

from .small_recording import FRAMES, STEPS, frames_in, images_in, record, write_at_once

SECTOR = 512
SURVIVALS = ("nothing", "a torn beginning", "any sectors")


@dataclass
class File:
    """What a disk has of a file, and what it was told since."""

    durable: bytearray = field(default_factory=bytearray)
    unsynced: list[tuple[int, bytes | None]] = field(default_factory=list)  # where and what; None: cut there
    has_name: bool = False

    def copy(self) -> "File":
        return File(self.durable.copy(), self.unsynced.copy(), self.has_name)

    def after_the_cut(self, survival: str, dice: np.random.Generator) -> bytes | None:
        """The content that is found; None where not even the name is."""
        if not self.has_name and (survival == "nothing" or dice.random() < 0.5):
            return None
        found = self.durable.copy()
        if survival == "a torn beginning":
            for step in self.unsynced[: dice.integers(len(self.unsynced) + 1)]:
                apply(found, step)
            del found[max(len(self.durable), len(found) - int(dice.integers(SECTOR * 4))) :]
        elif survival == "any sectors":
            sectors = [part for step in self.unsynced for part in in_sectors(step)]
            for part in sectors:
                if dice.random() < 0.5:
                    apply(found, part)
        return bytes(found)


def apply(content: bytearray, step: tuple[int, bytes | None]) -> None:
    at, data = step
    if data is None:
        del content[at:]
        return
    content.extend(bytes(max(0, at - len(content))))  # what did not reach the disk before it reads as zeros
    content[at : at + len(data)] = data


def in_sectors(step: tuple[int, bytes | None]) -> Iterator[tuple[int, bytes | None]]:
    at, data = step
    if data is None:
        yield step
        return
    bounds = [at, *range((at // SECTOR + 1) * SECTOR, at + len(data), SECTOR), at + len(data)]
    for begin, end in pairwise(bounds):
        yield begin, data[begin - at : end - at]


class Disk:
    """The calls of ``os``, real ones, that keeps what a disk would have after each."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._names: dict[int, str] = {}
        self._sizes: dict[int, int] = {}
        self.files: dict[str, File] = {}
        self.given = 0
        self.moments: list[tuple[int, dict[str, File]]] = []

    def __getattr__(self, name: str) -> object:
        return getattr(os, name)

    def _keep(self) -> None:
        self.moments.append((self.given, {name: file.copy() for name, file in self.files.items()}))

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        with self._lock:
            descriptor = os.open(path, flags, mode)
            self._names[descriptor] = "" if flags & os.O_DIRECTORY else Path(path).name
            if flags & os.O_CREAT:
                self.files[Path(path).name] = File()
                self._sizes[descriptor] = 0
                self._keep()
            return descriptor

    def write(self, descriptor: int, data: bytes) -> int:
        with self._lock:
            written = os.write(descriptor, data)
            self.files[self._names[descriptor]].unsynced.append((self._sizes[descriptor], bytes(data[:written])))
            self._sizes[descriptor] += written
            self._keep()
            return written

    def ftruncate(self, descriptor: int, size: int) -> None:
        with self._lock:
            os.ftruncate(descriptor, size)
            self.files[self._names[descriptor]].unsynced.append((size, None))
            self._sizes[descriptor] = size
            self._keep()

    def fsync(self, descriptor: int) -> None:
        with self._lock:
            name = self._names[descriptor]
            if name:
                file = self.files[name]
                steps = len(file.unsynced)
            known = list(self.files)
        os.fsync(descriptor)
        with self._lock:
            if name:
                for step in file.unsynced[:steps]:
                    apply(file.durable, step)
                del file.unsynced[:steps]
            else:
                for each in known:
                    self.files[each].has_name = True
            self._keep()

    fdatasync = fsync


def stock_frames(path: Path) -> list[int]:
    """The numbers of the frames that another reader finds in a file, as far as it is whole."""
    found = []
    with path.open("rb") as stream:
        try:
            for _, channel, message in NonSeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False):
                if channel.message_encoding == "mavlink":
                    found.append(int(message.data[:6]))
        except McapError:
            pass
    return found


def check(folder: Path, given: int, synced: list[int]) -> int:
    """Hold what is read after a cut, before and after its recovery, against what was given and what was synced.

    Returns:
        How many frames are read.
    """
    try:
        recording = Recording(folder)
        before = frames_in(recording)
    except AerodftError:
        assert not synced, "what was synced is refused"
        return 0
    assert before == sorted(set(before))
    assert set(synced) <= set(before) <= set(range(given))
    left_out = recording.left_out(images=True)
    if before != list(range(len(before))):
        assert left_out, "a hole in the middle is more than an unfinished end"
    if len(before) < given:
        assert left_out or not recording.is_whole, "what is missing is missing in silence"
    is_lossy = recover_folder(folder).is_lossy
    assert is_lossy or len(before) == given
    assert not recover_folder(folder).is_lossy, "it was said"
    again = Recording(folder)
    assert again.is_whole
    assert set(before) <= set(frames_in(again)) <= set(range(given))
    images = images_in(again)
    assert images == sorted(set(images))
    assert set(images) <= set(range(given // FRAMES))
    assert not again.left_out(images=True)
    return len(before)


@pytest.mark.parametrize("every", [23, *at_night(1)])
def test_a_power_cut_costs_what_was_not_synced_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, every: int
) -> None:
    caplog.set_level("CRITICAL")
    write_at_once(monkeypatch)
    disk = Disk()
    monkeypatch.setattr(segment, "os", disk)
    disk.given = FRAMES
    for totals in record(tmp_path / "whole"):
        disk.given = min(disk.given + FRAMES, STEPS * FRAMES)
        if totals is not None:
            assert totals.lost == 0
    monkeypatch.setattr(segment, "os", os)
    assert len([name for name in disk.files if name.startswith("data")]) >= 3
    dice, read = np.random.default_rng(every), []
    for given, files in [*disk.moments[::every], disk.moments[-1]]:
        for survival in SURVIVALS:
            with tempfile.TemporaryDirectory(dir=tmp_path) as name:
                synced = []
                for file, content in files.items():
                    if file.startswith("data") and content.has_name:
                        (Path(name) / file).write_bytes(content.durable)
                        synced += stock_frames(Path(name) / file)
                for file, content in files.items():
                    found = content.after_the_cut(survival, dice)
                    (Path(name) / file).unlink(missing_ok=True)
                    if found is not None:
                        (Path(name) / file).write_bytes(found)
                if any(Path(name).glob("data_*")):
                    read.append(check(Path(name), given, synced))
    print(f"\n{len(read)} power cuts: what was synced is read")
    assert read[-len(SURVIVALS) :] == [STEPS * FRAMES] * len(SURVIVALS), "all is synced at the end"
