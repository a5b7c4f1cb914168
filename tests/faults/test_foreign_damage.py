"""Other tools' files cut and flipped anywhere: refused in a sentence or read in part, no frame that nobody sent."""

import os
from pathlib import Path

import numpy as np
import pytest

from aerodft.adapters.recording import Channel
from aerodft.adapters.recording.read import scan_segment
from aerodft.errors import AerodftError
from aerodft.model import Image, RawBlock
from replay.foreign import AnyRecording, ForeignImages, ForeignRecording, ForeignTelemetry, open_recording
from replay.player import timeline
from tests.commands import run_aerodft
from tests.nights import at_night
from tests.replay.foreign_files import frames_of, jpegs, write_foreign

SAMPLE = Path(__file__).parents[2] / "samples/copter.tlog"


def everything(recording: AnyRecording, channel: Channel) -> bool:  # noqa: ARG001 - of any recording
    return True


def read_all(path: Path, sent: set[bytes]) -> int:
    """Read whatever can be read; returns the number of frames."""
    frames = 0
    recording = open_recording(path)
    assert list(timeline([recording], None, None, everything)) is not None
    if not isinstance(recording, ForeignRecording):
        return 0
    for block in ForeignTelemetry(recording).events():
        assert isinstance(block, RawBlock)
        got = [block.data[at : at + size] for at, size in zip(block.offset, block.length, strict=True)]
        assert set(got) <= sent
        frames += len(got)
    for image in ForeignImages(recording).events():
        assert isinstance(image, Image)
        if image.pixels is not None:
            image.pixels()
    return frames


@pytest.mark.parametrize(("way", "files"), [("lz4", 30), ("bare", 30), *at_night(("lz4", 750), ("bare", 750))])
def test_damage_costs_messages_and_nothing_else(
    tmp_path: Path, way: str, files: int, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("CRITICAL")
    frames = frames_of(SAMPLE)[:600]
    pictures = jpegs([frames[0][0] + k * 100_000_000 for k in range(5)], 64, 48)
    data = write_foreign(tmp_path / "whole.mcap", frames, pictures, compressed=way == "lz4").read_bytes()
    sent = {frame for _, frame in frames}
    assert read_all(tmp_path / "whole.mcap", sent) == len(frames)
    noise, path = np.random.default_rng(1), tmp_path / "a.mcap"
    read, refusals = 0, list[str]()
    for number in range(files):
        damaged = bytearray(data)
        if number % 3 == 0:
            del damaged[noise.integers(len(data)) :]
        else:
            for place in noise.integers(len(data), size=noise.integers(1, 4)):
                damaged[place] ^= 1 << int(noise.integers(8))
        path.write_bytes(damaged)
        try:
            read += read_all(path, sent) > 0
        except AerodftError as refusal:
            refusals.append(str(refusal))
    print(f"{files} files: {read} read in part, {len(refusals)} refused")
    assert all(each.startswith(str(path)) and "\n" not in each for each in refusals)
    assert read > files // 10


@pytest.mark.parametrize("is_cut", [False, True], ids=["indexed", "cut"])
def test_a_damaged_chunk_is_named_once(tmp_path: Path, caplog: pytest.LogCaptureFixture, *, is_cut: bool) -> None:
    path, frames = tmp_path / "a.mcap", frames_of(SAMPLE)[:600]
    pictures = jpegs([frames[0][0] + k * 100_000_000 for k in range(5)], 64, 48)
    data = bytearray(write_foreign(path, frames, pictures).read_bytes())
    chunk = scan_segment(path).chunks[0]  # without an index it is where channels are looked for, too
    data[chunk.offset + chunk.length // 2] ^= 4
    path.write_bytes(data[: len(data) * 4 // 5] if is_cut else data)
    messages = list(timeline([open_recording(path)], None, None, everything))
    assert is_cut or len(messages) > 500
    assert caplog.text.count("checksum or size differs") == 1
    assert ("defined nowhere" in caplog.text) == is_cut, "whose names went with it"


@pytest.mark.parametrize("command", ["doctor", "replay", "recover", "export", "recompute"])
def test_a_pipe_among_the_segments_holds_nobody_up(tmp_path: Path, command: str) -> None:
    folder = tmp_path / "recording"
    folder.mkdir()
    os.mkfifo(folder / "data_000.mcap")
    out = {"export": ("--format", "csv", "-o", tmp_path / "out"), "recompute": ("-o", tmp_path / "out")}
    done = run_aerodft(command, folder, *out.get(command, ()))
    assert done.code == 3
    assert f"{folder / 'data_000.mcap'}: the recording cannot be re" in done.err
    assert "it is a pipe or a device, not a file" in done.err
    assert not (tmp_path / "out").exists()


def test_of_many_damaged_chunks_the_first_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    frames = frames_of(SAMPLE)[:6000]
    path = write_foreign(tmp_path / "a.mcap", frames)
    chunks = scan_segment(path).chunks
    assert len(chunks) > 20
    data = bytearray(path.read_bytes())
    for chunk in chunks[1:]:
        data[chunk.offset + chunk.length - 20] ^= 0xFF
    path.write_bytes(data)
    recording = open_recording(path)
    assert isinstance(recording, ForeignRecording)
    for _ in range(2):
        assert 0 < sum(len(block.offset) for block in ForeignTelemetry(recording).events()) < len(frames) / 10
    said = [record.getMessage() for record in caplog.records if "damaged chunk" in record.getMessage()]
    assert len(said) == 10
    assert said[-1].endswith("further ones are left out and not named")
    assert "named" not in said[0]
