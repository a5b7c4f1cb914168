"""A recording that is damaged or not all there: what comes of it says so, and ends with exit code 5."""

import shutil
from pathlib import Path

import orjson
import pytest
from mcap.reader import make_reader

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
    lost = damage(flight)
    assert lost > 0
    for form in FORMATS:
        done = aerodft("export", flight, "--format", form, "-o", tmp_path / f"a.{form}", "--json")
        assert (done.code, done.json["damaged_chunks"], done.json["missing_segments"]) == (5, 1, 0), form
        assert done.json.get("measurements", whole - lost) == whole - lost, form
    done = aerodft("recompute", flight, "-o", tmp_path / "again", "--json")
    assert (done.code, done.json["damaged_chunks"]) == (5, 1)
    assert done.last == ("aerodft: the recording is not whole, and so is what came of it: without 1 damaged chunk")
    assert aerodft("recover", flight).code == 5
    assert aerodft("export", flight, "-o", tmp_path / "recovered.csv").code == 0, "what is lost was said"


def test_so_is_a_missing_segment_and_to_stdout(aerodft, flight: Path, tmp_path: Path) -> None:
    (flight / "data_001.mcap").unlink()
    done = aerodft("export", flight)
    assert (done.code, done.out[:8]) == (5, b"time_utc")
    assert done.last.endswith("without 1 missing segment")
    done = aerodft("recompute", flight, "-o", tmp_path / "again", "--json")
    assert (done.code, done.json["damaged_chunks"], done.json["missing_segments"]) == (5, 0, 1)


@pytest.mark.nightly
def test_of_many_it_is_said_which(aerodft, flight: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    flights = tmp_path / "flights"
    for name in ("sound", "torn"):
        shutil.copytree(flight, flights / name)
    damage(flights / "torn")
    torn = f"{flights / 'torn'}: the recording is not whole, and so is what came of it: without 1 damaged chunk"
    for state in ("done", "skipped"):  # computed, and found when it is started again
        done = aerodft("recompute", f"{flights}/*", "-o", tmp_path / "dataset", "--workers", 1, "--json")
        said = {each["recording"]: (each["state"], each["sentence"]) for each in done.json["recordings"]}
        assert (done.code, said) == (5, {"sound": (state, ""), "torn": (state, torn)})
