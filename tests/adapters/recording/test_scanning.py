"""Files whose chunks are more than can be held: what is known of the first of them, and that others are left out."""

import struct
from pathlib import Path

import pytest
from mcap.opcode import Opcode

from aerodft.adapters.recording import MAGIC, RECORD_HEAD
from aerodft.adapters.recording.read import scan_segment, segment_scan
from aerodft.adapters.recording.read.segment_scan import ChannelSets

EMPTY_CHUNK = struct.pack("<QQQI", 1, 2, 0, 0) + bytes(4) + bytes(8)


def record(opcode: Opcode, content: bytes) -> bytes:
    return RECORD_HEAD.pack(opcode, len(content)) + content


def message(channel: int, at_ns: int) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", channel, 0, at_ns, at_ns))


def test_chunks_beyond_what_can_be_held_are_left_out_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(segment_scan, "_MOST_CHUNKS", 3)
    path, one = tmp_path / "many.mcap", record(Opcode.CHUNK, EMPTY_CHUNK)
    path.write_bytes(MAGIC + one * 3)
    assert not scan_segment(path).damaged_offsets
    path.write_bytes(MAGIC + one * 5)
    found = scan_segment(path)
    assert (len(found.chunks), len(found.damaged_offsets), found.is_whole) == (3, 1, False)
    assert "more than 3 chunks and no index" in caplog.text


def test_sets_of_channels_are_held_once_and_not_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segment_scan, "_MOST_IDS", 5)
    sets = ChannelSets()
    assert sets.of([]) is None
    first = sets.of([1, 2, 3])
    assert first == {1, 2, 3}
    assert sets.of((3, 2, 1)) is first
    assert sets.of([4, 5, 6]) is None  # not known
    assert sets.of([1, 2]) == {1, 2}


def test_chunks_and_messages_know_their_channels(tmp_path: Path) -> None:
    index = b"".join(record(Opcode.MESSAGE_INDEX, struct.pack("<HI", number, 0)) for number in (7, 9))
    chunks, bare = tmp_path / "chunks.mcap", tmp_path / "bare.mcap"
    chunks.write_bytes(MAGIC + record(Opcode.CHUNK, EMPTY_CHUNK) + index + record(Opcode.CHUNK, EMPTY_CHUNK))
    assert [place.channels for place in scan_segment(chunks).chunks] == [{7, 9}, None]
    bare.write_bytes(MAGIC + b"".join(message(number, 50 - number) for number in range(40)))
    (place,) = scan_segment(bare).chunks
    assert (place.channels, place.start_ns, place.end_ns) == (set(range(40)), 11, 50)
    assert place.length == bare.stat().st_size - len(MAGIC)
