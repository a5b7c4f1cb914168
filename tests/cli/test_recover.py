"""``aerodft recover`` as its user meets it: what was cut or damaged is made whole, and what is lost has a name."""

import shutil
from contextlib import suppress

import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from aerodft.adapters.recording import MAGIC
from aerodft.adapters.recording.read import scan_segment
from aerodft.adapters.recording.write import McapRecorder
from replay.recordings import Recording
from tests.full_disk import no_file_above


def frames(path, reader=make_reader):
    """Log times and payloads, by the stock reader with its checks on."""
    with path.open("rb") as file:
        return [
            (message.log_time, channel.topic, message.data)
            for _, channel, message in reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        ]


@pytest.fixture
def flight(flight_recording, tmp_path):
    """A recording of its own: its folder and its data file."""
    shutil.copytree(flight_recording, tmp_path / "flight")
    return tmp_path / "flight", tmp_path / "flight" / "data_000.mcap"


def cut(path, size):
    path.write_bytes(path.read_bytes()[:size])


def flip(path, *offsets):
    content = bytearray(path.read_bytes())
    for offset in offsets:
        content[offset] ^= 0x10
    path.write_bytes(content)


def test_a_cut_segment_is_completed_and_then_sound(aerodft, flight):
    folder, data = flight
    whole = frames(data)
    last = scan_segment(data).chunks[-1]
    cut(data, last.offset + last.length // 2)
    images = (folder / "images_000.mcap").read_bytes()
    done = aerodft("recover", folder, "--json")
    assert done.code == 5, done.err
    segment = done.json["segments"][0]
    assert (segment["name"], segment["state"]) == ("data_000.mcap", "completed")
    (loss,) = segment["losses"]
    assert (loss["from_ns"], loss["to_ns"]) == (segment["end_ns"], None)
    kept = frames(data)
    assert kept == frames(data, NonSeekingReader) == whole[: len(kept)]
    assert len(kept) == segment["messages"] < len(whole)
    assert f"{data}: lost between 20" in done.err
    assert (folder / "images_000.mcap").read_bytes() == images, "what is sound is not touched"
    assert Recording(folder).is_whole
    content = data.read_bytes()
    again = aerodft("recover", folder, "--json")
    assert (again.code, again.json["is_lossy"], data.read_bytes()) == (0, False, content)


def test_a_damaged_chunk_is_dropped_and_named_with_its_times(aerodft, flight):
    folder, data = flight
    whole, places = frames(data), scan_segment(data).chunks
    assert len(places) > 1
    victim = places[-1]
    damaged = data.read_bytes()[victim.offset - 9 : victim.offset + victim.length]
    flip(data, victim.offset + victim.length // 2)
    done = aerodft("recover", folder, "--json")
    assert done.code == 5, done.err
    (loss,) = done.json["segments"][0]["losses"]
    assert (loss["offset"], loss["length"]) == (victim.offset - 9, victim.length + 9)
    kept = frames(data)
    assert kept == whole[: len(kept)]
    assert loss["messages"] == len(whole) - len(kept)
    assert loss["from_ns"] == str(max(log_ns for log_ns, _, _ in kept))
    assert "a damaged chunk (" in done.err
    assert len((folder / "data_000.mcap.dropped").read_bytes()) == len(damaged)


def test_the_first_chunk_holds_the_names_and_is_not_needed(aerodft, flight):
    folder, data = flight
    whole, first = frames(data), scan_segment(data).chunks[0]
    end = scan_segment(data).chunks[-1]
    flip(data, first.offset + first.length // 2)
    cut(data, end.offset + end.length)  # and no index names them again
    done = aerodft("recover", folder, "--json")
    assert done.code == 5, done.err
    kept = frames(data)
    assert kept == frames(data, NonSeekingReader)
    assert len(kept) > 0.9 * len(whole)
    assert set(kept) <= set(whole)


def test_a_flipped_length_costs_nothing(aerodft, flight):
    folder, data = flight
    whole, places = frames(data), scan_segment(data).chunks
    flip(data, places[0].offset - 4)  # the first chunk now claims gigabytes
    done = aerodft("recover", folder, "--json")
    assert done.code == 0, done.err
    assert frames(data) == whole
    assert done.json["segments"][0]["state"] == "completed"


def test_a_chunk_too_large_to_be_read_here_is_kept_for_others(aerodft, tmp_path):
    folder = tmp_path / "bomb"
    folder.mkdir()
    with (folder / "data_000.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("x-aerodft", "by hand")
        channel = writer.register_channel("t", "json", 0)
        writer.add_message(channel, 1, bytes(1 << 27), 1)
        writer.finish()
    content = (folder / "data_000.mcap").read_bytes()
    done = aerodft("recover", folder, "--json")
    assert done.code == 4, done.err
    kept = (folder / "data_000.mcap.dropped").read_bytes()
    assert kept in content
    assert len(kept) > 0.5 * len(content), "the chunk is in it"


@pytest.mark.parametrize("size", [0, 1, 8, 40])
def test_a_segment_that_was_just_begun_opens_afterwards(aerodft, flight, size):
    folder, data = flight
    (folder / "data_001.mcap").write_bytes(data.read_bytes()[:size])
    done = aerodft("recover", folder)
    assert done.code == 5, done.err
    assert frames(folder / "data_001.mcap") == []
    assert Recording(folder).is_whole


def test_a_missing_segment_is_named(aerodft, flight):
    folder, data = flight
    data.rename(folder / "data_001.mcap")
    done = aerodft("recover", folder, "--json")
    assert done.code == 5
    assert [(each["name"], each["state"]) for each in done.json["segments"][:2]] == [
        ("data_000.mcap", "missing"),
        ("data_001.mcap", "sound"),
    ]


def test_where_nothing_is_left_nothing_is_touched(aerodft, tmp_path):
    (tmp_path / "data_000.mcap").write_bytes(b"\0" * 5000)
    done = aerodft("recover", tmp_path)
    assert (done.code, done.last) == (
        4, f"aerodft: {tmp_path}: nothing can be recovered: no segment holds a whole message",
    )  # fmt: skip
    assert [path.name for path in tmp_path.iterdir()] == ["data_000.mcap"]
    assert (tmp_path / "data_000.mcap").read_bytes() == b"\0" * 5000


def test_the_recording_of_another_tool_is_left_alone(aerodft, tmp_path):
    path = tmp_path / "data_000.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start(library="other 1.0")
        writer.add_message(writer.register_channel("a", "json", 0), 1, b"{}", 1)
        writer.finish()
    cut(path, path.stat().st_size - 30)
    content = path.read_bytes()
    done = aerodft("recover", tmp_path)
    assert done.code == 3
    assert done.last == (
        f"aerodft: {path}: the file cannot be recovered: got one made by other 1.0, expected a recording of aerodft"
    )
    assert path.read_bytes() == content


@pytest.mark.parametrize("is_cut", [False, True])
def test_a_recording_that_was_written_again_without_chunks_stays_as_it_is(aerodft, flight, is_cut):
    """Its messages are readable, and have no checksums: nothing could be made better."""
    folder, data = flight
    held = written_again(data, profile="x-aerodft")
    if is_cut:
        cut(data, data.stat().st_size // 2)
        with data.open("rb") as file:
            whole = frames_so_far(file)
        assert 0 < len(whole) < len(held)
        held = whole
    before = {path: path.read_bytes() for path in folder.iterdir()}
    done = aerodft("recover", folder, "--json")
    assert done.code == (5 if is_cut else 0)
    segment = done.json["segments"][0]
    assert (segment["state"], segment["messages"]) == ("unfinished" if is_cut else "sound", len(held))
    assert len(segment["losses"]) == is_cut
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_a_recording_that_was_written_again_under_the_name_of_aerodft_is_sound(aerodft, flight):
    """Its header names who wrote it first, and no profile: its chunks do not say which recording they belong to."""
    folder, data = flight
    held = written_again(data, use_chunking=True, library="aerodft 0.1.0")
    done = aerodft("recover", folder, "--json")
    segment = done.json["segments"][0]
    assert (done.code, segment["state"], segment["messages"]) == (0, "sound", len(held))


def written_again(path, *, use_chunking=False, **header):
    """Write a segment again as the stock writer does; returns its messages."""
    with path.open("rb") as file:
        reader = make_reader(file)
        records, metadata = list(reader.iter_messages(log_time_order=False)), list(reader.iter_metadata())
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=use_chunking)
        writer.start(**header)
        for each in metadata:
            writer.add_metadata(each.name, each.metadata)
        ids = {}
        for schema, channel, message in records:
            if channel.topic not in ids:
                number = 0 if schema is None else writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(ids[channel.topic], message.log_time, message.data, message.log_time)
        writer.finish()
    return [(message.log_time, message.data) for _, _, message in records]


def frames_so_far(file):
    """What the stock reader reads before it fails."""
    found = []
    with suppress(McapError):
        messages = (record for record in StreamReader(file).records if isinstance(record, Message))
        found.extend((message.log_time, message.data) for message in messages)
    return found


@pytest.mark.parametrize("made", ["nothing", "an empty folder", "a file"])
def test_what_is_no_recording_is_refused(aerodft, tmp_path, made):
    path = tmp_path / "x"
    if made == "an empty folder":
        path.mkdir()
    elif made == "a file":
        path.write_text("x")
    done = aerodft("recover", path)
    assert done.code == 3
    sentence = "no such file or folder" if made == "nothing" else "there is no recording"
    assert done.last.startswith(f"aerodft: {path}: {sentence}")


def test_a_recording_that_is_being_written_is_left_alone(aerodft, flight, tmp_path, monkeypatch):
    recorders = []
    begin = McapRecorder.__init__

    def remembered(self, *arguments, **options):
        begin(self, *arguments, **options)
        recorders.append(self)

    folder, _ = flight
    monkeypatch.setattr(McapRecorder, "__init__", remembered)
    monkeypatch.setattr(McapRecorder, "close", lambda _: None)
    assert aerodft("recompute", folder, "-o", tmp_path / "live").code in {0, 5}
    content = (tmp_path / "live" / "data_000.mcap").read_bytes()
    done = aerodft("recover", tmp_path / "live")
    monkeypatch.undo()
    assert done.code == 3
    assert done.last.endswith("the recording is still being written; stop the recorder first")
    assert (tmp_path / "live" / "data_000.mcap").read_bytes()[: len(content)] == content
    recorders[0].close()
    assert aerodft("recover", tmp_path / "live").code == 0


def test_without_room_for_the_copy_the_segment_stays_as_it_was(aerodft, flight):
    folder, data = flight
    cut(data, data.stat().st_size - 50)
    content = data.read_bytes()
    with no_file_above(5000):
        done = aerodft("recover", folder)
    assert done.code == 3
    assert done.last.endswith("the recording cannot be recovered: File too large")
    assert data.read_bytes() == content
    assert sorted(path.name for path in folder.iterdir()) == ["config.toml", "data_000.mcap", "images_000.mcap"]
    assert content.startswith(MAGIC)
