"""One file of a recording's segments: in order of time, as far as what overlaps can be held; and nothing is missing."""

from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader
from mcap.writer import Writer

from replay import merging
from replay.merging import merge_segments
from replay.recording import Recording

COUNT = 300
PAYLOAD = bytes(100)


def backwards(path: Path) -> Recording:
    """A file whose latest messages come first: each chunk may hold what belongs before all others."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1000)
        writer.start()
        channel = writer.register_channel("/t", "application/octet-stream", 0)
        for number in range(COUNT, 0, -1):
            writer.add_message(channel, number * 1000, number.to_bytes(4, "big") + PAYLOAD, number * 1000)
        writer.finish()
    return Recording(path)


def merged(recording: Recording, path: Path) -> list[int]:
    """Numbers of the messages in the merged file, as they stand in it."""
    assert merge_segments(recording, path).messages == COUNT
    with path.open("rb") as file:
        messages = NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [int.from_bytes(message.data[:4], "big") for _, _, message in messages]


def test_what_overlaps_is_put_in_order(tmp_path: Path) -> None:
    assert merged(backwards(tmp_path / "a.mcap"), tmp_path / "b.mcap") == list(range(1, COUNT + 1))


def test_of_what_is_too_much_to_be_held_all_is_there_and_the_earliest_goes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    most = 20
    monkeypatch.setattr(merging, "_MESSAGE_BYTES", 0)
    monkeypatch.setattr(merging, "_MOST_HELD_BYTES", most * (len(PAYLOAD) + 4))
    found = merged(backwards(tmp_path / "a.mcap"), tmp_path / "b.mcap")
    assert sorted(found) == list(range(1, COUNT + 1))
    assert found[:3] == [COUNT - most, COUNT - most - 1, COUNT - most - 2], "each is the earliest of those held"
    assert found[-most:] == sorted(found[-most:]), "the last that are held are in order"
