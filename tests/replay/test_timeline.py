"""Recordings as one row: by time, whatever order a file was written in."""

from pathlib import Path

import pytest
from mcap.writer import Writer

from replay.foreign import ForeignRecording
from replay.foreign import recordings as module
from replay.player import timeline

START_NS = 1_795_221_278_000_000_000


def write_apart(path: Path, offset_ns: int) -> Path:
    """Two topics of 500 messages each, one after the other."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2048)
        writer.start()
        for topic in ("/a", "/b"):
            channel = writer.register_channel(topic, "json", 0)
            for k in range(500):
                at_ns = START_NS + offset_ns + k * 10_000_000
                writer.add_message(channel, at_ns, b"{}", at_ns, k)
        writer.finish()
    return path


def test_messages_are_in_order_of_time_over_topics_files_and_recordings(tmp_path: Path) -> None:
    one = ForeignRecording(write_apart(tmp_path / "one.mcap", 0))
    folder = tmp_path / "two"
    folder.mkdir()
    write_apart(folder / "a.mcap", 5_000_000)
    write_apart(folder / "b.mcap", 2_500_000)
    two = ForeignRecording(folder)
    items = list(timeline([one, two], None, None, lambda _, __: True))
    assert [item.log_ns for item in items] == sorted(item.log_ns for item in items)
    assert len(items) == 3000
    assert len({(id(item.recording), item.log_ns, item.message.channel.topic) for item in items}) == 3000
    part = list(timeline([one, two], START_NS + 10**9, START_NS + 2 * 10**9, lambda _, channel: channel.topic == "/b"))
    assert len(part) == 300


def test_more_topics_than_can_be_held_are_in_order_as_far_as_chunks_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    recording = ForeignRecording(write_apart(tmp_path / "one.mcap", 0))
    whole = [(item.log_ns, item.message.channel.topic) for item in timeline([recording], None, None, lambda *_: True)]
    assert not caplog.records
    monkeypatch.setattr(module, "_MOST_HELD_BYTES", 1)
    held = [(item.log_ns, item.message.channel.topic) for item in timeline([recording], None, None, lambda *_: True)]
    assert held == whole
    assert "one behind the other" in caplog.text
    half_ns = whole[len(whole) // 2][0]
    for from_ns, to_ns in ((half_ns, None), (None, half_ns)):
        part = [item.log_ns for item in timeline([recording], from_ns, to_ns, lambda *_: True)]
        assert part == [at for at, _ in whole if (at >= half_ns if from_ns else at < half_ns)]
