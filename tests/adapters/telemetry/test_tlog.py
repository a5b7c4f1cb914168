import os
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry import TlogSource, log_file, open_log
from aerodft.adapters.telemetry.dataflash import DataflashSource
from aerodft.adapters.telemetry.log_file import PIECE_BYTES
from aerodft.adapters.telemetry.tlog import BLOCK_FRAMES
from aerodft.errors import InputError
from aerodft.model import RawBlock

START_US = 1_700_000_000_000_000
SAMPLE = Path(__file__).parents[3] / "samples/copter.tlog"


def _blocks(source: TlogSource) -> list[RawBlock]:
    return [event for event in source.events() if isinstance(event, RawBlock)]


def _arrival_us(path: Path) -> list[int]:
    return [int(ns) // 1000 for block in _blocks(TlogSource(path)) for ns in block.arrival_ns]


@pytest.fixture(scope="session")
def frame(pack: Callable[..., bytes]) -> bytes:
    """One ATTITUDE."""
    return pack(dialect.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0, 0, 0))


@pytest.fixture
def write(tmp_path: Path, frame: bytes) -> Callable[[list[int]], Path]:
    """Writes a log of one frame a stamp (us)."""

    def written(stamps_us: list[int]) -> Path:
        path = tmp_path / "made.tlog"
        path.write_bytes(b"".join(struct.pack(">Q", stamp) + frame for stamp in stamps_us))
        return path

    return written


Write = Callable[[list[int]], Path]


def test_blocks_are_bounded_and_hold_the_frames(write: Write, frame: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_file, "PIECE_BYTES", 1 << 22)
    stamps_us = [START_US + k * 1000 for k in range(2 * BLOCK_FRAMES + 5)]
    source = TlogSource(write(stamps_us))
    blocks = _blocks(source)
    assert [len(b.offset) for b in blocks] == [BLOCK_FRAMES, BLOCK_FRAMES, 5]
    assert {b.data[o : o + n] for b in blocks for o, n in zip(b.offset, b.length, strict=True)} == {frame}
    np.testing.assert_array_equal(np.concatenate([b.arrival_ns for b in blocks]), np.array(stamps_us) * 1000)
    assert {b.sender for b in blocks} == {"made.tlog"}
    assert source.warnings() == ()
    assert len(_blocks(source)) == 3  # a source can be read again


def test_arrival_is_held_where_the_clock_steps_back(write: Write) -> None:
    stamps_us = [START_US, START_US + 10**6, START_US - 5 * 10**6, START_US + 2 * 10**6]
    source = TlogSource(write(stamps_us))
    (block,) = _blocks(source)
    assert (block.arrival_ns // 1000 - START_US).tolist() == [0, 10**6, 10**6, 2 * 10**6]
    assert any("stepped back" in sentence for sentence in source.warnings())


@pytest.mark.parametrize("garbled", [2**63, 2**64 - 1, START_US + 10**12, 2**51])
@pytest.mark.parametrize("place", [0, 2, 4])
def test_one_garbled_stamp_does_not_move_the_others(write: Write, garbled: int, place: int) -> None:
    stamps_us = [START_US + k * 100_000 for k in range(5)]
    stamps_us[place] = garbled
    arrival_us = _arrival_us(write(stamps_us))
    for k in set(range(5)) - {place}:
        assert arrival_us[k] == stamps_us[k]
    assert arrival_us == sorted(arrival_us)


def test_a_confirmed_jump_is_believed(write: Write) -> None:
    stamps_us = [START_US, START_US + 3600 * 10**6, START_US + 3601 * 10**6]
    assert _arrival_us(write(stamps_us)) == stamps_us


def test_sparse_frames_keep_their_stamps(write: Write) -> None:
    stamps_us = [START_US + k * 300 * 10**6 for k in range(4)]
    assert _arrival_us(write(stamps_us))[:3] == stamps_us[:3]


@pytest.mark.parametrize("cut", range(1, 40))
def test_a_cut_file_gives_all_but_the_last_frame(write: Write, frame: bytes, cut: int) -> None:
    path = write([START_US + k for k in range(10)])
    whole = path.read_bytes()
    size = 8 + len(frame)
    path.write_bytes(whole[: -min(cut, size - 1)])
    source = TlogSource(path)
    assert sum(len(b.offset) for b in _blocks(source)) == 9
    assert source.counts.truncated == 1
    assert any("cut off" in sentence for sentence in source.warnings())


def test_a_broken_record_does_not_shift_the_next(write: Write, frame: bytes) -> None:
    path = write([START_US + k for k in range(5)])
    whole = bytearray(path.read_bytes())
    size = 8 + len(frame)
    del whole[2 * size + 3 : 2 * size + 20]
    path.write_bytes(whole)
    assert _arrival_us(path) == [START_US + k for k in (0, 1, 3, 4)]


@pytest.mark.parametrize(
    ("content", "got"),
    [
        (b"", "0 bytes"),
        (b"\x00\x00\x00\x18ftypmp42" + bytes(200), "MP4"),
        (b"\x89MCAP0\r\n" + bytes(200), "MCAP"),
        (b"time,lat,lon\n1,2,3\n", "text"),
        (bytes(range(256)) * 4, "unknown binary data"),
        (b"\xa3\x95\x80" + bytes(200), ".bin log without a valid message"),
        (b"ULog\x01\x12\x35\x01" + bytes(range(200)), ""),
    ],
)
def test_wrong_files_are_refused_in_one_sentence(tmp_path: Path, content: bytes, got: str) -> None:
    path = tmp_path / "wrong.tlog"
    path.write_bytes(content)
    with pytest.raises(InputError) as refusal:
        open_log(path)
    assert str(path) in str(refusal.value)
    assert got in refusal.value.got


def test_frames_without_stamps_are_named(tmp_path: Path, frame: bytes) -> None:
    path = tmp_path / "raw.tlog"
    path.write_bytes(frame * 5)
    with pytest.raises(InputError, match="without stamps"):
        TlogSource(path)


def test_missing_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        open_log(tmp_path / "none.tlog")
    with pytest.raises(InputError, match="is a folder"):
        open_log(tmp_path)


def test_logs_are_opened_by_content(data_folder: Path, tmp_path: Path) -> None:
    renamed = tmp_path / "flight.log"
    renamed.write_bytes((data_folder / "sitl/brushless_cut.BIN").read_bytes()[:200_000])
    assert isinstance(open_log(renamed), DataflashSource)
    assert isinstance(open_log(data_folder / "sitl/cold_boot.tlog"), TlogSource)


@pytest.fixture(params=["tlog", "bin"])
def long_log(request: pytest.FixtureRequest, data_folder: Path, tmp_path: Path) -> Path:
    """A log of several pieces, the ends of which lie inside messages."""
    whole = SAMPLE if request.param == "tlog" else data_folder / "sitl/brushless_cut.BIN"
    path = tmp_path / f"long.{request.param}"
    with path.open("wb") as file:
        while file.tell() < 3 * PIECE_BYTES:
            file.write(whole.read_bytes())
    return path


def test_a_log_that_is_cut_while_it_is_read_is_refused(long_log: Path) -> None:
    events = open_log(long_log).events()
    next(events)
    os.truncate(long_log, PIECE_BYTES + 5000)
    with pytest.raises(InputError, match=f"became shorter while it was read: got {PIECE_BYTES + 5000} bytes"):
        list(events)


def test_a_log_that_is_cut_within_what_is_read_at_once_is_refused(long_log: Path) -> None:
    events = open_log(long_log).events()
    os.truncate(long_log, 5000)
    with pytest.raises(InputError, match="became shorter while it was read: got 5000 bytes"):
        list(events)


def test_what_is_read_does_not_depend_on_the_pieces(long_log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = bytearray(long_log.read_bytes()[: PIECE_BYTES // 2])
    rng = np.random.default_rng(3)
    for place in rng.integers(100_000, len(content) - 500, 40).tolist():
        size = int(rng.integers(1, 400))
        content[place : place + size] = rng.bytes(size) if place % 2 else bytes(size)
    long_log.write_bytes(content)
    read = []
    for piece_bytes in (PIECE_BYTES, 10_007, 300):
        monkeypatch.setattr(log_file, "PIECE_BYTES", piece_bytes)
        source = open_log(long_log)
        blocks = [event for event in source.events() if isinstance(event, RawBlock)]
        frames = b"".join(
            block.data[start : start + size]
            for block in blocks
            for start, size in zip(block.offset.tolist(), block.length.tolist(), strict=True)
        )
        read.append((frames, np.concatenate([block.arrival_ns for block in blocks]).tobytes(), source.counts))
    assert read[0][2].skipped_bytes > 0
    assert read[1] == read[0]
    assert read[2] == read[0]


def test_a_log_that_was_deleted_is_read_to_its_end(long_log: Path) -> None:
    size = long_log.stat().st_size
    events = open_log(long_log).events()
    blocks = [next(events)]
    long_log.unlink()
    blocks += events
    stamps = sum(len(block.length) for block in blocks) * (8 if long_log.suffix == ".tlog" else 0)
    assert sum(block.length.sum() for block in blocks) + stamps > size - 1000 - size // 10
