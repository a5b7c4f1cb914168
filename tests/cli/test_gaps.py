"""A recording that is damaged or not all there: what comes of it says so, and ends with exit code 5."""

import shutil
from pathlib import Path

import orjson
import pytest
from mcap.reader import make_reader

from aerodft.adapters.recording import MAGIC
from aerodft.adapters.recording.write import COUNT_BYTES, segmented_writer
from tests.nights import at_night

SEGMENTED = "[record]\nsegment_s = 1\n"
FORMATS = ("csv", "geojson", "jsonl", "parquet", "mcap")


@pytest.fixture
def flight(aerodft, desk, tmp_path: Path) -> Path:
    """Some segments of a second each."""
    config = desk.station(SEGMENTED + desk.config.read_text())
    assert aerodft("import", desk.log, "-c", config, "-o", tmp_path / "flight").code == 0
    assert len(list((tmp_path / "flight").glob("data_*.mcap"))) > 2
    return tmp_path / "flight"


def damage(folder: Path) -> int:
    """Flip a byte in the largest chunk of the second segment; returns how many measurements were in it."""
    path = folder / "data_001.mcap"
    with path.open("rb") as file:
        reader = make_reader(file)
        chunk = max(reader.get_summary().chunk_indexes, key=lambda each: each.chunk_length)
        span = range(chunk.message_start_time, chunk.message_end_time + 1)
        held = [
            len(orjson.loads(message.data)["measurements"])
            for schema, _, message in reader.iter_messages()
            if schema and schema.name == "aerodft.measurements/1" and message.log_time in span
        ]
    data = bytearray(path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    path.write_bytes(data)
    return sum(held)


def rows(aerodft, folder: Path) -> int:
    return len(aerodft("export", folder, "--format", "jsonl").out.splitlines())


def test_a_whole_recording_has_no_gaps(aerodft, flight: Path, tmp_path: Path) -> None:
    done = aerodft("recompute", flight, "-o", tmp_path / "again", "--json")
    assert (done.code, done.json["damaged_chunks"], done.json["missing_segments"]) == (0, 0, 0)
    done = aerodft("export", flight, "-o", tmp_path / "a.csv", "--json")
    assert (done.code, done.json["damaged_chunks"], done.json["missing_segments"]) == (0, 0, 0)


def test_a_damaged_chunk_is_counted_in_what_comes_of_it(aerodft, flight: Path, tmp_path: Path) -> None:
    whole = rows(aerodft, flight)
    begin, end = (min(log_times(flight / name)) for name in ("data_001.mcap", "data_002.mcap"))
    lost = damage(flight)
    assert lost > 0
    for form in FORMATS:
        done = aerodft("export", flight, "--format", form, "-o", tmp_path / f"a.{form}", "--json")
        assert (done.code, done.json["damaged_chunks"], done.json["missing_segments"]) == (5, 1, 0), form
        assert done.json.get("measurements", whole - lost) == whole - lost, form
    done = aerodft("recompute", flight, "-o", tmp_path / "again", "--json")
    assert (done.code, done.json["damaged_chunks"]) == (5, 1)
    assert done.last.startswith(
        "aerodft: the recording is not whole, and so is what came of it: without 1 damaged chunk and what was between "
    )
    assert all(begin <= int(gap["from_ns"]) <= int(gap["to_ns"]) <= end for gap in done.json["gaps"])
    recovered = aerodft("recover", flight)
    assert recovered.code == 5
    assert recovered.err.count(": a damaged chunk (") == 1, recovered.err
    assert aerodft("export", flight, "-o", tmp_path / "recovered.csv").code == 0, "what is lost was said"


@pytest.mark.parametrize("share", [0.0, 0.5], ids=["all", "half"])
def test_images_that_were_cut_are_a_loss_where_the_data_was_finished(
    aerodft, flight_recording: Path, tmp_path: Path, share: float
) -> None:
    flight = shutil.copytree(flight_recording, tmp_path / "flight")
    path = flight / "images_000.mcap"
    cut(path, max(len(MAGIC), int(path.stat().st_size * share)))
    exported, *others = commands(aerodft, flight, tmp_path)
    assert (exported.code, [done.code for done in others]) == (0, [5, 5]), "a table needs no images"
    assert all(done.json["gaps"][0]["to_ns"] is not None for done in others)
    assert aerodft("recover", flight).code == 5


def test_so_is_a_missing_segment_and_to_stdout(aerodft, flight: Path, tmp_path: Path) -> None:
    (flight / "data_001.mcap").unlink()
    done = aerodft("export", flight)
    assert (done.code, done.out[:8]) == (5, b"time_utc")
    assert done.last.endswith("without 1 missing segment")
    done = aerodft("recompute", flight, "-o", tmp_path / "again", "--json")
    assert (done.code, done.json["damaged_chunks"], done.json["missing_segments"]) == (5, 0, 1)


def test_a_missing_last_segment_is_told_by_the_one_before_it(aerodft, flight: Path, tmp_path: Path) -> None:
    """As after a power cut exactly between the two."""
    max(flight.glob("data_*.mcap")).unlink()
    done = aerodft("export", flight, "-o", tmp_path / "a.csv", "--json")
    assert (done.code, [gap["to_ns"] for gap in done.json["gaps"]]) == (5, [None])
    done = aerodft("recover", flight)
    assert done.code == 5
    assert "in a segment that is not there" in done.err
    assert aerodft("recover", flight).code == 0
    assert aerodft("export", flight, "-o", tmp_path / "recovered.csv").code == 0, "what is lost was said"


@pytest.mark.nightly
def test_of_many_it_is_said_which(aerodft, flight: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    flights = tmp_path / "flights"
    for name in ("sound", "torn"):
        shutil.copytree(flight, flights / name)
    damage(flights / "torn")
    torn = f"{flights / 'torn'}: the recording is not whole, and so is what came of it: without 1 damaged chunk and "
    for state in ("done", "skipped"):  # computed, and found when it is started again
        done = aerodft("recompute", f"{flights}/*", "-o", tmp_path / "dataset", "--workers", 1, "--json")
        said = {each["recording"]: (each["state"], each["sentence"][: len(torn)]) for each in done.json["recordings"]}
        assert (done.code, said) == (5, {"sound": (state, ""), "torn": (state, torn)})


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segmented_writer, "_CHUNK_BYTES", 1024)


def spans(folder: Path, name: str) -> list[tuple[int, int, int]]:
    """Of all chunks: where they begin, their length, and how many messages are in each.

    A message index is of 15 bytes, and of 16 for each of its entries.
    """
    with (folder / name).open("rb") as file:
        summary = make_reader(file).get_summary()
    return [
        (
            each.chunk_start_offset,
            each.chunk_length,
            (each.message_index_length - 15 * len(each.message_index_offsets)) // 16,
        )
        for each in summary.chunk_indexes
    ]


def victim(found: list[tuple[int, int, int]]) -> tuple[int, int, int]:
    """The chunk with the most messages, of everything that there is, but the first and the last."""
    return max(found[1:-1], key=lambda each: each[2])


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


def log_times(path: Path) -> list[int]:
    with path.open("rb") as file:
        return [message.log_time for _, _, message in make_reader(file).iter_messages()]


def unfinish_images(flight: Path) -> None:
    """Leave of image segments what a kill would."""
    for path in flight.glob("images_*.mcap"):
        cut(path, sum(spans(flight, path.name)[-1][:2]))


def commands(aerodft, flight: Path, tmp_path: Path):
    yield aerodft("export", flight, "-o", tmp_path / "a.csv", "--overwrite", "--json")
    yield aerodft("recompute", flight, "-o", tmp_path / "again", "--json")
    shutil.rmtree(tmp_path / "again")
    yield aerodft("replay", flight, "--rate", "max", "--listen", "none", "--json")


@pytest.mark.usefixtures("small_chunks")
def test_a_cut_segment_before_others_is_a_loss_with_its_times(aerodft, flight: Path, tmp_path: Path) -> None:
    following, found = log_times(flight / "data_001.mcap"), spans(flight, "data_000.mcap")
    offset, length, _ = found[2]
    cut(flight / "data_000.mcap", offset + length // 2)
    for done in commands(aerodft, flight, tmp_path):
        assert done.code == 5, done.err
        (gap,) = done.json["gaps"]
        assert gap["to_ns"] == str(min(following))
        assert gap["messages"] == sum(messages for _, _, messages in found[2:])
        assert "without what was between 20" in done.last
    done = aerodft("recover", flight, "--json")
    assert done.code == 5
    (loss,) = done.json["segments"][0]["losses"]
    assert {key: loss[key] for key in gap} == gap
    assert "half a second" not in done.err
    assert aerodft("export", flight, "-o", tmp_path / "recovered.csv").code == 0, "what is lost was said"
    assert aerodft("recover", flight).code == 0


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize(("place", "removed"), [(0, True), (-1, False), *at_night((0, False), (-1, True))])
def test_damage_behind_the_data_is_no_loss(aerodft, flight: Path, tmp_path: Path, *, place: int, removed: bool) -> None:
    """The index, the statistics and the footer tell of messages; that none is missing is told by the others."""
    path = sorted(flight.glob("data_*.mcap"))[place]
    whole, data = log_times(path), bytearray(path.read_bytes())
    data[-300:] = b"" if removed else bytes(300)
    path.write_bytes(data)
    for done in commands(aerodft, flight, tmp_path):
        assert (done.code, done.json["gaps"]) == (0, []), done.err
    assert aerodft("recover", flight).code == 0
    assert log_times(path) == whole


@pytest.mark.usefixtures("small_chunks")
def test_a_cut_last_segment_may_have_been_killed(aerodft, flight: Path, tmp_path: Path) -> None:
    paths = sorted(flight.glob("data_*.mcap"))
    for path in paths[1:]:
        path.unlink()
    offset, length, _ = spans(flight, "data_000.mcap")[-2]
    cut(paths[0], offset + length // 2)
    done = aerodft("export", flight, "-o", tmp_path / "a.csv")
    assert done.code == 5, "the recorder has finished the images"
    assert "and the end" in done.last
    unfinish_images(flight)
    assert aerodft("export", flight, "-o", tmp_path / "a.csv", "--overwrite").code == 0, "as after a kill"
    done = aerodft("recover", flight, "--json")
    assert "nobody knows how much" in done.err


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("damage", ["kind", "huge length", *at_night("length", "both"), "zeros", "gone"])
@pytest.mark.parametrize("is_finished", [True, False])
def test_one_damaged_chunk_costs_itself_at_most(
    aerodft, desk, tmp_path: Path, damage: str, *, is_finished: bool
) -> None:
    """Of an only segment: no later one tells what is missing."""
    flight = tmp_path / "flight"
    assert aerodft("import", desk.log, "-c", desk.config, "-o", flight).code == 0
    (path,) = flight.glob("data_*.mcap")
    found = spans(flight, path.name)
    offset, length, messages = victim(found)
    all_messages = len(log_times(path))
    data = bytearray(path.read_bytes())
    if damage in {"kind", "both"}:
        data[offset] ^= 1
    if damage in {"length", "both"}:
        data[offset + 2] ^= 4
    if damage == "huge length":
        data[offset + 1 : offset + 9] = (1 << 40).to_bytes(8, "little")
    if damage == "zeros":
        data[offset : offset + length] = bytes(length)
    if damage == "gone":
        del data[offset : offset + length]
    if not is_finished:
        last = found[-1][0] + found[-1][1]
        data = data[: last - length * (damage == "gone")]
        unfinish_images(flight)
    path.write_bytes(data)
    lost = messages if damage in {"zeros", "gone"} else 0
    codes = {done.code for done in commands(aerodft, flight, tmp_path)}
    assert codes <= ({0, 5} if is_finished else {5 if lost else 0}), "by its index no more is read than is needed"
    assert (5 in codes) == (lost > 0)
    done = aerodft("recover", flight, "--json")
    segment = next(each for each in done.json["segments"] if each["name"] == path.name)
    assert segment["messages"] == all_messages - lost, "no more is lost than is damaged"
    inside = [loss for loss in segment["losses"] if loss["to_ns"] is not None]
    assert [loss["messages"] for loss in inside] == ([lost] if lost else [])
    assert len(log_times(path)) == segment["messages"]


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("damage", ["flipped", *at_night("gone")])
def test_a_lost_first_chunk_is_said_once(aerodft, flight: Path, tmp_path: Path, damage: str) -> None:
    """Of its own segment: the one before it lacks nothing."""
    path = flight / "data_001.mcap"
    offset, length, messages = spans(flight, path.name)[0]
    data = bytearray(path.read_bytes())
    if damage == "flipped":
        data[offset + length // 2] ^= 1
    else:
        del data[offset : spans(flight, path.name)[1][0]]
    path.write_bytes(data)
    done = aerodft("recover", flight, "--json")
    losses = {each["name"]: each["losses"] for each in done.json["segments"] if each["losses"]}
    assert (done.code, list(losses)) == (5, [path.name])
    assert [loss["messages"] for loss in losses[path.name]] == [messages]
    assert aerodft("recover", flight).code == 0
    assert aerodft("export", flight, "-o", tmp_path / "b.csv").code == 0, "what is lost was said"


@pytest.fixture
def other(aerodft, desk, flight: Path, tmp_path: Path) -> Path:
    """Another recording of the same flight."""
    config = flight.parent / "station.toml"
    assert aerodft("import", desk.log, "-c", config, "-o", tmp_path / "other").code == 0
    return tmp_path / "other"


@pytest.mark.usefixtures("small_chunks")
def test_a_segment_of_another_recording_is_named(aerodft, flight: Path, other: Path, tmp_path: Path, caplog) -> None:
    whole = rows(aerodft, flight)
    shutil.copy(other / "data_001.mcap", flight / "data_001.mcap")
    for done in commands(aerodft, flight, tmp_path):
        assert (done.code, done.json["missing_segments"]) == (5, 1), done.err
    assert "data_001.mcap: belongs to recording " in caplog.text
    assert rows(aerodft, flight) < whole
    done = aerodft("recover", flight, "--json")
    assert [each["state"] for each in done.json["segments"]][:4] == ["foreign", "sound", "missing", "sound"]
    assert "it belongs to recording " in done.err


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("is_finished", [True, False])
def test_a_chunk_of_another_recording_is_left_out_and_named(
    aerodft, flight: Path, other: Path, tmp_path: Path, caplog, *, is_finished: bool
) -> None:
    """As a disk gives old blocks back after a power cut."""
    path = flight / "data_001.mcap"
    found, strange = spans(flight, path.name), spans(other, path.name)
    offset, length, messages = victim(found)
    theirs = (other / path.name).read_bytes()[victim(strange)[0] :][: victim(strange)[1]]
    data = bytearray(path.read_bytes())
    data[offset : offset + length] = theirs
    path.write_bytes(data if is_finished else data[: found[-1][0] + found[-1][1] + len(theirs) - length])
    whole, kept = len(log_times(other / path.name)), None
    assert 5 in {done.code for done in commands(aerodft, flight, tmp_path)}
    assert "it belongs to recording " in caplog.text
    done = aerodft("recover", flight, "--json")
    segment = done.json["segments"][1]
    kept = segment["messages"]
    assert any("it belongs to recording " in loss["what"] for loss in segment["losses"])
    assert kept == whole - messages, "the others are there"


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("whose", ["another recording's", "its own"])
def test_a_chunk_that_was_put_in_is_no_loss(aerodft, flight: Path, other: Path, tmp_path: Path, whose: str) -> None:
    """Neither of another recording nor a second time: counts say that nothing of the segment's own is missing."""
    path = flight / "data_001.mcap"
    whole, times, found = rows(aerodft, flight), log_times(path), spans(flight, path.name)
    folder = flight if whose == "its own" else other
    at, length, _ = victim(spans(folder, path.name))
    count = 0 if whose == "its own" else COUNT_BYTES  # another's comes with its own count, which is none here
    extra = (folder / path.name).read_bytes()[at - count : at + length]
    data = bytearray(path.read_bytes())
    data[found[-1][0] - count : found[-1][0] - count] = extra
    path.write_bytes(data)
    for done in commands(aerodft, flight, tmp_path):
        assert (done.code, done.json["gaps"]) == (0, []), done.err
    assert rows(aerodft, flight) == whole
    done = aerodft("recover", flight, "--json")
    (loss,) = done.json["segments"][1]["losses"]
    assert (done.code, loss["messages"], loss["length"]) == (0, 0, length)
    assert loss["what"].startswith("an extra chunk (it ")
    assert log_times(path) == times


def test_a_copy_of_a_segment_is_left_out_before_and_after_recovery(aerodft, flight: Path, tmp_path: Path) -> None:
    whole = rows(aerodft, flight)
    last = max(flight.glob("data_*.mcap"))
    damage(flight)
    kept = rows(aerodft, flight)
    shutil.copy(flight / "data_001.mcap", flight / "data_099.mcap")
    assert rows(aerodft, flight) == kept < whole
    done = aerodft("export", flight, "-o", tmp_path / "a.csv", "--json")
    assert (done.json["missing_segments"], done.json["damaged_chunks"]) == (0, 1), "98 are not missing"
    states = {each["name"]: each["state"] for each in aerodft("recover", flight, "--json").json["segments"]}
    assert (states["data_099.mcap"], states["data_001.mcap"], states[last.name]) == ("copy", "completed", "sound")


@pytest.mark.usefixtures("small_chunks")
def test_zeros_at_the_beginning_of_an_only_segment_are_a_loss(aerodft, desk, tmp_path: Path) -> None:
    """As where the first pages never reached the disk: its first count says what was before."""
    flight = tmp_path / "flight"
    assert aerodft("import", desk.log, "-c", desk.config, "-o", flight).code == 0
    path = flight / "data_000.mcap"
    times, found = log_times(path), spans(flight, path.name)
    end = found[len(found) // 2][0] - 200  # its count stays
    data = bytearray(path.read_bytes())
    data[:end], data[-300:] = bytes(end), bytes(300)
    path.write_bytes(data)
    lost = sum(messages for _, _, messages in found[: len(found) // 2])
    done = aerodft("export", flight, "-o", tmp_path / "a.csv", "--json")
    assert [(gap["from_ns"], gap["messages"]) for gap in done.json["gaps"]] == [(None, lost)]
    assert done.code == 5
    done = aerodft("recover", flight, "--json")
    assert [loss["messages"] for loss in done.json["segments"][0]["losses"]] == [lost]
    assert log_times(path) == times[-done.json["segments"][0]["messages"] :]
