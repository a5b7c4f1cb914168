"""Recordings with bytes flipped, cut out and claimed: refused or read in part, never wrongly, never a traceback."""

import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st

from aerodft.adapters.recording.read import scan_segment
from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.errors import AerodftError, InputError
from aerodft.model import Camera, WireProtocol
from aerodft.service import MergedFeed, block_of
from replay.recordings import Recording, RecordingSource
from tests.batches import one_tick, take

CAMERA = Camera.from_fov(name="c", width_px=4, height_px=4, hfov_rad=1, vfov_rad=1)


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("r") / "r"
    patch = pytest.MonkeyPatch()
    patch.setattr("aerodft.adapters.recording.write.segmented_writer.FLUSH_S", 0.0)
    recorder = McapRecorder(folder, RecorderSettings(station="s", camera=CAMERA, lossless=True), started_ns=1)
    noise = np.random.default_rng(7)
    for step in range(1, 60):
        frames = [noise.bytes(30) for _ in range(3)]
        block = block_of(WireProtocol.MAVLINK, "a", [step * 100 + k for k in range(3)], frames)
        take(recorder, one_tick(step * 100 + 50, [block]))
    recorder.close()
    patch.undo()
    return (folder / "data_000.mcap").read_bytes()


def frames_in(content: bytes) -> list[tuple[int, bytes]]:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "data_000.mcap").write_bytes(content)
        got: list[tuple[int, bytes]] = []
        for batch in MergedFeed([RecordingSource(Recording(Path(folder)))], 50, idle_ticks_ns=0).batches():
            for raw in batch.raw:
                for at, start, size in zip(raw.arrival_ns, raw.offset, raw.length, strict=True):
                    got.append((int(at), raw.data[start : start + size]))
        return got


@settings(max_examples=150, deadline=None)
@example(flips=[(16199, 147), (22129, 155)], start=25534, missing=5000)  # a record that claims more than memory has
@given(
    flips=st.lists(st.tuples(st.integers(0, 1 << 30), st.integers(1, 255)), max_size=4),
    start=st.integers(0, 1 << 30),
    missing=st.sampled_from([0, 0, 1, 9, 5000]),
)
def test_flipped_and_missing_bytes_cost_messages_at_most(
    content: bytes, flips: list[tuple[int, int]], start: int, missing: int
) -> None:
    damaged = bytearray(content)
    for place, flip in flips:
        damaged[place % len(content)] ^= flip
    start %= len(content) + 1
    del damaged[start : start + missing]
    whole = set(frames_in(content))
    try:
        got = frames_in(bytes(damaged))
    except AerodftError:
        return
    assert set(got) <= whole
    assert len(got) == len(set(got))


def test_a_chunk_that_claims_a_gigabyte_is_not_unpacked(content: bytes, caplog: pytest.LogCaptureFixture) -> None:
    bomb = zstandard.compress(bytes(64 << 20))
    for claimed in (64 << 20 | 1, 1 << 40, 100):
        body = (
            struct.pack("<QQQI", 1, 2, claimed, 0)
            + struct.pack("<I", 4)
            + b"zstd"
            + struct.pack("<Q", len(bomb))
            + bomb
        )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "data_000.mcap"
            path.write_bytes(content)
            first = scan_segment(path).chunks[0]
            cut = first.offset + first.length
            path.write_bytes(content[:cut] + struct.pack("<BQ", 6, len(body)) + body + content[cut:])
            recording = Recording(Path(folder))
            assert len(list(recording.messages())) == 59 * 3 + 2
    assert caplog.text.count("damaged chunk") == 3


def test_a_segment_that_is_there_twice_is_not_computed_twice(content: bytes, tmp_path: Path, caplog) -> None:
    path = tmp_path / "data_000.mcap"
    path.write_bytes(content)
    alone = len(list(RecordingSource(Recording(tmp_path)).events()))
    copy = tmp_path / "data_000-copy.mcap"
    copy.write_bytes(content)
    assert len(list(RecordingSource(Recording(tmp_path)).events())) == alone
    assert "once more; it is left out" in caplog.text
    last = scan_segment(path).chunks[-1]
    copy.write_bytes(content[: last.offset - 9])  # of an earlier day's copy nobody knows what it is
    with pytest.raises(InputError, match="goes back in time: got an arrival"):
        list(RecordingSource(Recording(tmp_path)).events())


@pytest.mark.parametrize("kept", [0, 1, 7])
def test_a_segment_that_was_just_made_as_the_machine_died_costs_nothing(
    content: bytes, tmp_path: Path, kept: int
) -> None:
    (tmp_path / "data_000.mcap").write_bytes(content)
    for name in ("data_001.mcap", "images_000.mcap"):
        (tmp_path / name).write_bytes(content[:kept])
    recording = Recording(tmp_path)
    assert not recording.is_whole
    assert sum(message.channel.encoding == WireProtocol.MAVLINK for message in recording.messages()) == 59 * 3
