"""Seeking: by a file's own index where it has one, and the same messages without; whatever wrote the file."""

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from aerodft.adapters.recording.read import scan_segment
from replay.recordings import channels_of, messages_of

START_NS = 1_795_221_278_000_000_000
STEP_NS = 1_000_000
COUNT = 3000


def written(path: Path, *, cut: bool = False, **options) -> Path:
    """3000 messages on two topics, the second of which begins late; ``cut``: killed before the end was written."""
    with path.open("wb") as file:
        writer = Writer(file, **({"chunk_size": 4096} | options))
        writer.start()
        schema = writer.register_schema("s", "jsonschema", b"{}")
        early = writer.register_channel("/early", "json", schema)
        late = None
        for k in range(COUNT):
            at_ns = START_NS + k * STEP_NS
            if k == COUNT // 2:
                late = writer.register_channel("/late", "json", schema)
            if late is not None and k % 10 == 0:
                writer.add_message(late, at_ns, b'{"late":%d}' % k, at_ns)
            else:
                writer.add_message(early, at_ns, b'{"early":%d}' % k, at_ns)
        writer.finish()
    if cut:
        data = path.read_bytes()
        path.write_bytes(data[: data.rindex(b"\x0f" + (4).to_bytes(8, "little"))])  # the record that ends the data
    return path


WAYS = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "plain": {"compression": CompressionType.NONE},
    "no chunks": {"use_chunking": False},
    "no index": {"index_types": IndexType.NONE},
    "no summary": {"use_summary_offsets": False, "use_statistics": False},
    "killed": {"cut": True},
}


@pytest.mark.parametrize("way", WAYS)
def test_any_stretch_of_any_file_is_what_the_stock_reader_finds_there(tmp_path: Path, way: str) -> None:
    path = written(tmp_path / "a.mcap", **WAYS[way])
    whole = written(tmp_path / "whole.mcap")
    scan = scan_segment(path)
    assert scan.is_whole == (way != "killed")
    assert {channel.topic for channel in channels_of(scan).values()} == {"/early", "/late"}
    for first, stop in ((0, COUNT), (1234, 1300), (2900, COUNT), (1499, 1502)):
        from_ns, to_ns = START_NS + first * STEP_NS, START_NS + stop * STEP_NS
        with whole.open("rb") as file:
            wanted = [
                (message.log_time, channel.topic, message.data)
                for _, channel, message in make_reader(file).iter_messages(starting_at=from_ns, ending_before=to_ns)
            ]
        got = [(m.log_ns, m.channel.topic, m.data) for m in messages_of([scan], from_ns=from_ns, to_ns=to_ns)]
        assert got == wanted
        late = [m.data for m in messages_of([scan], from_ns=from_ns, wanted=lambda channel: channel.topic == "/late")]
        assert late == [b'{"late":%d}' % k for k in range(max(COUNT // 2, -(-first // 10) * 10), COUNT, 10)]


def test_what_lies_before_the_start_is_not_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = written(tmp_path / "a.mcap")
    scan = scan_segment(path)
    data = bytearray(path.read_bytes())
    last = scan.chunks[-1]
    data[100 : last.offset - 9] = bytes(last.offset - 9 - 100)
    path.write_bytes(data)
    again = scan_segment(path)
    assert again.is_indexed
    got = list(messages_of([again], from_ns=last.start_ns))
    assert [message.log_ns for message in got] == list(range(last.start_ns, last.end_ns + 1, STEP_NS))
    assert caplog.text == ""


def test_an_index_that_lies_is_not_believed(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    whole = list(messages_of([scan_segment(path)]))
    data = bytearray(path.read_bytes())
    data[-1500] ^= 0x40  # within the index of the chunks: its checksum tells
    path.write_bytes(data)
    scan = scan_segment(path)
    assert not scan.is_indexed
    assert list(messages_of([scan])) == whole
