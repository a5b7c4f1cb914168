"""One file of a recording's segments: in order of time, as far as what overlaps can be held; and nothing is missing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Attachment
from mcap.writer import Writer

from aerodft.adapters.recording import encode_records
from aerodft.adapters.recording.recover import recover_folder
from aerodft.errors import InputError
from replay.export.merging import FileAttachment, MergedRecordingWriter, merge_segments
from replay.recordings import Recording, segments

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
    monkeypatch.setattr(segments, "_MESSAGE_BYTES", 0)
    monkeypatch.setattr(segments, "_MOST_HELD_BYTES", most * (len(PAYLOAD) + 4))
    found = merged(backwards(tmp_path / "a.mcap"), tmp_path / "b.mcap")
    assert sorted(found) == list(range(1, COUNT + 1))
    assert found[:3] == [COUNT - most, COUNT - most - 1, COUNT - most - 2], "each is the earliest of those held"
    assert found[-most:] == sorted(found[-most:]), "the last that are held are in order"


def test_an_attachment_is_the_record_that_the_stock_library_writes(tmp_path: Path) -> None:
    data = np.random.default_rng(2).bytes(3 << 20)
    (tmp_path / "a.bin").write_bytes(b"before" + data + b"behind")
    about = Attachment(create_time=5, log_time=7, name="a.bin", media_type="x/y", data=b"")
    path = tmp_path / "all.mcap"
    with path.open("wb") as file, MergedRecordingWriter(file, ()) as whole:
        whole.attach(FileAttachment(about, tmp_path / "a.bin", 6, len(data)))
        with pytest.raises(InputError, match="became shorter"):
            list(FileAttachment(about, tmp_path / "a.bin", 6, len(data) + 7).pieces())
    assert encode_records(replace(about, data=data)) in path.read_bytes()
    with path.open("rb") as file:
        (found,) = make_reader(file, validate_crcs=True).iter_attachments()
    assert found == replace(about, data=data)


def test_recovery_keeps_what_is_attached(tmp_path: Path) -> None:
    frozen = Path(__file__).parents[1] / "cli/frozen-0.1"
    path = tmp_path / "data_000.mcap"
    merge_segments(Recording(frozen), path)
    whole = path.read_bytes()
    (segment,) = recover_folder(tmp_path).segments
    assert segment.state == "sound"
    assert path.read_bytes() == whole
    path.write_bytes(whole[:-100])  # its index is lost
    (segment,) = recover_folder(tmp_path).segments
    assert segment.state != "sound"
    with path.open("rb") as file:
        (found,) = make_reader(file, validate_crcs=True).iter_attachments()
    assert found.data == (frozen / "config.toml").read_bytes()


def test_a_damaged_attachment_is_left_out_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for name in ("one.txt", "two.txt"):
            writer.add_attachment(1, 1, name, "text/plain", b"what is attached")
        channel = writer.register_channel("/t", "application/octet-stream", 0)
        writer.add_message(channel, 1000, b"", 1000)
        writer.finish()
    data = bytearray(path.read_bytes())
    data[data.index(b"what is attached") - 8] ^= 1  # its size
    path.write_bytes(data)
    done = merge_segments(Recording(path), tmp_path / "b.mcap")
    assert (done.messages, done.attachments) == (1, 1)
    assert "a damaged record at byte" in caplog.text
    with (tmp_path / "b.mcap").open("rb") as file:
        assert [each.name for each in NonSeekingReader(file, validate_crcs=True).iter_attachments()] == ["two.txt"]
