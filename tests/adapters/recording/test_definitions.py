"""Files that define more than is believed: what does costs itself, and nothing that follows."""

from pathlib import Path

import pytest
from mcap.records import Channel, Schema

from aerodft.adapters.recording import ChunkBuffer, encode_records
from aerodft.adapters.recording.channels import MOST_DEFINED_BYTES, Channels, TooMuchDefinedError
from aerodft.adapters.recording.read import ChunkReader, scan_segment
from aerodft.adapters.recording.recover import chunk_scanner, recover_folder
from aerodft.adapters.recording.write import METADATA_NAME, PROFILE, Summary

BIG = MOST_DEFINED_BYTES // 3


def schema(number: int, size: int) -> Schema:
    return Schema(id=number, name=f"s{number}", encoding="x", data=bytes(size))


def channel(number: int, schema_id: int = 0) -> Channel:
    return Channel(id=number, topic=f"/{number}", message_encoding="x", schema_id=schema_id, metadata={})


def unfinished(folder: Path, *chunks: tuple[bytes, int]) -> Path:
    """A segment of ours whose recorder was killed; of each chunk what it defines, and its message's channel."""
    path = folder / "data_000.mcap"
    with path.open("wb") as file:
        file.write(Summary(PROFILE, "ours", [(METADATA_NAME, {"station": "a"})], {}, {}).header)
        for second, (definitions, identity) in enumerate(chunks, start=1):
            buffer = ChunkBuffer(definitions)
            buffer.add(identity, second * 10**9, b"payload")
            chunk = buffer.build(None)
            file.writelines((chunk.head, chunk.content, chunk.indexes))
    return path


@pytest.fixture
def greedy(tmp_path: Path) -> Path:
    too_much = encode_records(*(schema(100 + k, BIG) for k in range(4)), channel(2))
    ours = encode_records(channel(1)), 1
    return unfinished(tmp_path, ours, (too_much, 2), ours, (encode_records(schema(5, 1000), channel(3, 5)), 3))


@pytest.mark.parametrize("as_tables", [False, True])
def test_a_chunk_that_defines_too_much_is_left_out_and_others_are_read(
    greedy: Path, caplog: pytest.LogCaptureFixture, *, as_tables: bool
) -> None:
    scan = scan_segment(greedy)
    reader = ChunkReader()
    if as_tables:
        seconds = [at // 10**9 for table in reader.tables(scan.chunks) for at in table.log_ns.tolist()]
    else:
        seconds = [each.log_ns // 10**9 for each in reader.messages(scan.chunks)]
    assert seconds == [1, 3, 4]
    assert reader.damaged == 1
    assert "schemas and channels of more than 16 MB" in caplog.text
    assert reader.channels.by_id.keys() == {1, 3}


def test_recovery_drops_it_and_says_so(greedy: Path) -> None:
    (segment,) = recover_folder(greedy.parent).segments
    assert segment.messages == 3
    assert any("schemas and channels of more than 16 MB" in loss.what for loss in segment.losses)
    scan = scan_segment(greedy)
    assert scan.is_indexed
    assert [each.log_ns // 10**9 for each in ChunkReader(scan.channels).messages(scan.chunks)] == [1, 3, 4]


def test_recovery_leaves_chunks_beyond_what_an_index_holds_beside_the_segment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(chunk_scanner, "MOST_INDEX_BYTES", 200)  # of which recovery takes half as much again
    path = unfinished(tmp_path, *[(encode_records(channel(1)), 1)] * 10)
    data = path.read_bytes()
    (segment,) = recover_folder(tmp_path).segments
    assert (segment.messages, segment.state) == (4, "completed")
    assert any("more chunks than a file's index may have" in loss.what for loss in segment.losses)
    dropped = (tmp_path / "data_000.mcap.dropped").read_bytes()
    assert data.endswith(dropped)
    assert len(dropped) / len(data) > 0.5
    scan = scan_segment(path)
    assert [each.log_ns // 10**9 for each in ChunkReader(scan.channels).messages(scan.chunks)] == [1, 2, 3, 4]


def test_what_is_defined_again_takes_nothing_and_what_is_replaced_is_not_given_back() -> None:
    channels = Channels()
    for _ in range(100):  # as the recorder repeats them
        channels.add(schema(1, BIG))
        channels.add(channel(1, 1))
    assert channels.by_id[1].schema_data == bytes(BIG)
    channels.add(Schema(id=1, name="another", encoding="x", data=bytes(BIG)))  # a channel may have kept the one before
    with pytest.raises(TooMuchDefinedError):
        channels.add(schema(1, BIG))
