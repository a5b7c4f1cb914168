"""Recordings and tables that somebody copied, cut or put together by hand: said in a sentence, and nothing made up."""

import csv
import shutil
from collections import Counter
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer

from aerodft.adapters.files import whole_file
from aerodft.adapters.recording import MAGIC, RECORD_HEAD
from aerodft.errors import InputError
from tests.ports import free_endpoint

FROZEN = Path(__file__).parent / "frozen-0.1"


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A recording with its segment a second time, under the next number."""
    folder = tmp_path / "copied"
    shutil.copytree(FROZEN, folder)
    shutil.copy(folder / "data_000.mcap", folder / "data_001.mcap")
    return folder


def test_a_segment_that_is_there_twice_is_read_once(aerodft, copied: Path, tmp_path: Path, caplog) -> None:
    done = aerodft("compare", FROZEN, copied, "--json")
    assert done.code == 0, done.err
    assert "data_001.mcap is data_000.mcap once more; it is left out" in caplog.text
    done = aerodft("recompute", copied, "-o", tmp_path / "again", "--json")
    assert done.code == 0, done.err
    assert aerodft("compare", FROZEN, tmp_path / "again", "--tolerance", "1").code in {0, 5}


def test_a_folder_that_is_called_like_a_segment_is_named(aerodft, tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    shutil.copytree(FROZEN, folder)
    (folder / "data_001.mcap").mkdir()
    for command in (("recover", folder), ("compare", folder, folder)):
        done = aerodft(*command)
        assert done.code == 3, done.err
        assert f"{folder / 'data_001.mcap'}" in done.last
        assert "Is a directory" in done.last


@pytest.fixture
def table(aerodft, tmp_path: Path) -> list[list[str]]:
    assert aerodft("export", FROZEN, "--format", "csv", "-o", tmp_path / "whole.csv").code == 0
    with (tmp_path / "whole.csv").open(newline="") as file:
        return list(csv.reader(file))


def write(path: Path, rows: list[list[str]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return path


def test_a_table_that_was_cut_is_not_believed_up_to_half_a_number(aerodft, table, tmp_path: Path) -> None:
    whole = (tmp_path / "whole.csv").read_text()
    line = next(line for line in whole.splitlines() if ",ok," in line and ",range," in line)
    value = line.split(",")[5]
    cut = tmp_path / "cut.csv"
    cut.write_text(whole[: whole.index(line) + line.index(value) + 2])
    done = aerodft("compare", FROZEN, cut)
    assert done.code == 3, done.err
    number = whole[: whole.index(line)].count("\n") + 1
    assert f"{cut}, line {number}: a row is not whole: got fewer columns, expected {len(table[0])}" in done.last


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda rows: [*rows, *rows], "stamp_ns"),
        (lambda rows: [rows[0], [*rows[1], "more"]], "more columns"),
        (lambda rows: [rows[0], rows[1][:5]], "fewer columns"),
    ],
    ids=["two tables in one file", "a column too many", "columns missing"],
)
def test_what_is_wrong_in_a_table_is_said_with_its_name(aerodft, table, tmp_path: Path, change, said: str) -> None:
    path = write(tmp_path / "changed.csv", change(table))
    done = aerodft("compare", FROZEN, path)
    assert done.code == 3, done.err
    assert done.last.startswith(f"aerodft: {path}")
    assert said in done.last


def remade(folder: Path, *, data=lambda _, data: data, log_ns=lambda _, log_ns: log_ns, name=lambda name: name) -> Path:
    """The frozen recording as somebody else's program writes it again, with payloads, log times or schemas changed."""
    folder.mkdir()
    shutil.copy(FROZEN / "config.toml", folder)
    with (FROZEN / "data_000.mcap").open("rb") as source, (folder / "data_000.mcap").open("wb") as target:
        writer, channels = Writer(target), {}
        writer.start("x-aerodft", "by hand")
        messages = make_reader(source).iter_messages(log_time_order=False)
        for index, (schema, channel, message) in enumerate(messages):
            if channel.topic not in channels:
                known = writer.register_schema(name(schema.name), schema.encoding, schema.data) if schema else 0
                channels[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, known, channel.metadata
                )
            writer.add_message(
                channels[channel.topic],
                log_ns(index, message.log_time),
                data(channel, message.data),
                message.publish_time,
                message.sequence,
            )
        writer.finish()
    return folder


@pytest.mark.parametrize(
    ("log_ns", "said"),
    [
        (lambda _index, _log_ns: 0, "the recording goes back in time"),
        (lambda index, _log_ns: index * 10_000_000, "the recording goes back in time"),
        (lambda index, log_ns: log_ns if index < 400 else log_ns + 10**18, "the recording goes back in time"),
        (lambda index, log_ns: log_ns - index * 50_000_000, "the recording goes back in time"),
        (lambda _index, _log_ns: 2**64 - 1, "a log time is none: got 18446744073709551615"),
    ],
    ids=["none", "since 1970", "ahead by decades", "backwards", "beyond all"],
)
def test_log_times_that_are_not_the_arrivals_are_one_sentence(aerodft, tmp_path: Path, log_ns, said: str) -> None:
    folder = remade(tmp_path / "remade", log_ns=log_ns)
    done = aerodft("recompute", folder, "-o", tmp_path / "again")
    assert done.code == 3, done.err
    assert done.last.startswith(f"aerodft: {folder}: {said}")
    assert "Traceback" not in done.err
    replayed = aerodft("replay", folder, "--rate", "max", "--listen", free_endpoint(), "--json")
    assert (replayed.code, replayed.json["measurements"]) == (0, 118), replayed.err


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[: len(data) // 2],
        lambda _: b"[1,2]",
        lambda data: data.replace(b'"stamp_ns":"', b'"stamp_ns":"x'),
        lambda _: b'{"schema":' + b"[" * 5000 + b"]" * 5000 + b"}",
    ],
    ids=["cut", "a list", "no number", "5000 deep"],
)
@pytest.mark.parametrize("command", ["recompute", "compare", "export"])
def test_a_payload_that_is_none_is_named_with_its_recording(aerodft, tmp_path: Path, command: str, damage) -> None:
    def damaged(channel, data: bytes) -> bytes:
        return damage(data) if channel.message_encoding == "json" else data

    folder = remade(tmp_path / "remade", data=damaged)
    more = {"compare": (FROZEN,), "export": ("--format", "csv", "-o", tmp_path / "table.csv")}
    done = aerodft(command, folder, *more.get(command, ("-o", tmp_path / "again")))
    assert done.code == 3, done.err
    assert done.last.startswith(f"aerodft: {folder}: ")
    assert "Traceback" not in done.err
    assert not (tmp_path / "table.csv").exists()


@pytest.mark.parametrize("is_cut", [False, True])
def test_a_newer_version_s_recording_says_what_is_left_out(aerodft, tmp_path: Path, caplog, *, is_cut: bool) -> None:
    folder = remade(tmp_path / "newer", name=lambda name: name.replace("measurement/1", "measurement/2"))
    if is_cut:  # without its index: the channels are known when the chunks are read
        path = folder / "data_000.mcap"
        path.write_bytes(path.read_bytes()[:-200])
    done = aerodft("export", folder, "--format", "csv", "-o", tmp_path / "table.csv")
    assert done.code == 4, done.err
    assert f"{folder}: aerodft.measurement/2 is unknown to aerodft" in caplog.text
    caplog.clear()
    assert aerodft("recompute", folder, "-o", tmp_path / "again").code == 0  # its input is of this version
    assert caplog.text.count("aerodft.measurement/2 is unknown") == 1


def test_replay_leaves_out_what_is_damaged_and_counts_it(aerodft, tmp_path: Path, caplog) -> None:
    """Every third payload is cut: the rest is published, and the first of them named."""
    count = iter(range(10**6))

    def damaged(channel, data: bytes) -> bytes:
        is_measured = channel.topic.startswith("aerodft/") and "/measurement/" in channel.topic
        return data[: len(data) // 2] if is_measured and next(count) % 3 == 0 else data

    folder = remade(tmp_path / "remade", data=damaged)
    done = aerodft("replay", folder, "--rate", "max", "--listen", free_endpoint(), "--json")
    assert done.code == 5, done.err
    measured = next(count)
    assert measured == 118
    assert done.json["damaged_messages"] == -(-measured // 3)
    assert done.json["measurements"] == measured - done.json["damaged_messages"]
    assert caplog.text.count(f"{folder}: damaged payloads are left out: ") == 1
    assert done.last.endswith("without 40 damaged messages")


def test_a_merged_file_keeps_what_is_damaged_and_counts_it(aerodft, tmp_path: Path, caplog) -> None:
    """Every fifth pose is cut: it is in the file as it was, and no transform is drawn of it."""
    poses: list[bytes] = []

    def damaged(channel, data: bytes) -> bytes:
        if not channel.topic.endswith("/pose"):
            return data
        poses.append(data if len(poses) % 5 else data[: len(data) // 2])
        return poses[-1]

    folder = remade(tmp_path / "remade", data=damaged)
    done = aerodft("export", folder, "-o", tmp_path / "all.mcap", "--json")
    lost, drawn = len(poses[::5]), sum(b'"wxyz":[' in each and each.endswith(b"}") for each in poses)
    assert lost > 0 < drawn
    assert (done.code, done.json["damaged_messages"]) == (5, lost), done.err
    assert done.last.endswith(f"without {lost} damaged messages")
    assert caplog.text.count("a message is damaged; it is kept as it is") == 1
    with (tmp_path / "all.mcap").open("rb") as file:
        topics = Counter(channel.topic.rpartition("/")[2] for _, channel, _ in make_reader(file).iter_messages())
    assert (topics["pose"], topics["transform"]) == (len(poses), drawn)


def test_a_file_called_dash_is_not_made(aerodft, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = aerodft("export", FROZEN, "--format", "csv", "-o", "-")
    assert (done.code, done.last) == (
        2,
        "aerodft: --output: got -, expected a file; without --output, text goes to stdout",
    )
    assert not list(tmp_path.iterdir())


def test_a_file_that_somebody_made_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"

    def write_while_somebody_else_does() -> None:
        with whole_file(path, overwrite=False) as mine:
            mine.write_text("mine")
            path.write_text("theirs")

    with pytest.raises(InputError, match="the file exists; somebody made it meanwhile"):
        write_while_somebody_else_does()
    assert path.read_text() == "theirs"
    assert list(tmp_path.iterdir()) == [path]
    with whole_file(path, overwrite=True) as mine:
        mine.write_text("mine")
    assert path.read_text() == "mine"


def test_what_lies_behind_a_large_record_of_metadata_is_read(aerodft, tmp_path: Path) -> None:
    """Somebody's own metadata of 5 MB, in a file without an index: there seemed to be nothing behind it."""
    folder = tmp_path / "flight"
    shutil.copytree(FROZEN, folder)
    data = (folder / "data_000.mcap").read_bytes()
    front = len(MAGIC) + RECORD_HEAD.size + RECORD_HEAD.unpack_from(data, len(MAGIC))[1]  # behind the header
    end = front
    while data[end] != Opcode.DATA_END:
        end += RECORD_HEAD.size + RECORD_HEAD.unpack_from(data, end)[1]
    name, value = b"\x04\0\0\0mine", (5 << 20).to_bytes(4, "little") + bytes(5 << 20)
    pair = b"\x01\0\0\0x" + value
    content = name + len(pair).to_bytes(4, "little") + pair
    large = RECORD_HEAD.pack(Opcode.METADATA, len(content)) + content
    (folder / "data_000.mcap").write_bytes(data[:front] + large + data[front : end + RECORD_HEAD.size + 4])
    done = aerodft("export", folder, "--format", "jsonl")
    assert (done.code, done.out) == (0, aerodft("export", FROZEN, "--format", "jsonl").out)
    assert done.out
