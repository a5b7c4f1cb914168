"""What a recomputed recording says of the one that it was computed from."""

import hashlib
import tomllib
from pathlib import Path

import orjson
import pytest
from mcap.reader import make_reader

from replay.recordings import Recording

BETTER = """
[bias]
height_m = { value = -4.0, std = 0.1 }
"""
BEST = BETTER.replace("-4.0", "-3.0")


def metadata_of(path: Path) -> dict[str, dict[str, str]]:
    with path.open("rb") as file:
        return {record.name: record.metadata for record in make_reader(file).iter_metadata()}


def provenance(folder: Path) -> set[tuple[str, str]]:
    """Configuration and calibration that a recording's measurements name."""
    items = map(orjson.loads, Recording(folder).measurements())
    return {(item["config"], item["calibration"]) for item in items}


@pytest.fixture
def twice(aerodft, flight_recording: Path, tmp_path: Path) -> tuple[Path, Path]:
    """The flight with a better calibration and configuration, and that with a still better calibration."""
    text = (flight_recording / "config.toml").read_text()
    changed = text.replace("home_above_plane_m = 0.0", "home_above_plane_m = 2.5")
    assert changed != text
    for name, content in (("better.toml", BETTER), ("best.toml", BEST), ("other.toml", changed)):
        (tmp_path / name).write_text(content)
    once, again = tmp_path / "once", tmp_path / "again"
    given = ("-c", tmp_path / "other.toml", "--calibration", tmp_path / "better.toml")
    assert aerodft("recompute", flight_recording, "-o", once, *given).code == 0
    found = aerodft("recompute", once, "-o", again, "--calibration", tmp_path / "best.toml", "--json")
    assert found.code == 0
    said = {key: value for key, value in origin(again).items() if key in found.json["computed_from"]}
    assert found.json["computed_from"] == said
    return once, again


def origin(folder: Path) -> dict[str, object]:
    return tomllib.loads((folder / "computed_from.toml").read_text())


def test_it_names_data_configuration_and_calibration_of_before(twice, flight_recording: Path) -> None:
    once, again = twice
    for made, source in ((once, flight_recording), (again, once)):
        found = origin(made)
        assert {(found["config"], found.get("calibration"))} == provenance(source)
        assert provenance(made) != provenance(source)
        assert found["config_toml"] == (source / "config.toml").read_text()
        assert found["recording"] == str(source)
        digests = [hashlib.sha256(path.read_bytes()).digest() for path in sorted(source.glob("data_*.mcap"))]
        assert found["recording_sha256"] == f"sha256:{hashlib.sha256(b''.join(digests)).hexdigest()}"
    assert "computed_from" not in origin(once)
    assert origin(again)["computed_from"] == origin(once)


def test_every_segment_and_the_merged_file_say_it_too(aerodft, twice, tmp_path: Path) -> None:
    _, again = twice
    text = (again / "computed_from.toml").read_text()
    merged = tmp_path / "merged.mcap"
    assert aerodft("export", again, "--format", "mcap", "-o", merged).code == 0
    segments = sorted(again.glob("data_*.mcap"))
    assert segments
    for path in segments:
        assert metadata_of(path)["config"]["computed_from.toml"] == text
    with merged.open("rb") as file:
        attached = {each.name: each.data for each in make_reader(file, validate_crcs=True).iter_attachments()}
    assert attached["computed_from.toml"].decode() == text
    assert Recording(merged).text("computed_from.toml") == text


def test_what_was_made_from_nothing_says_nothing(flight_recording: Path) -> None:
    assert not (flight_recording / "computed_from.toml").exists()
    assert "computed_from.toml" not in metadata_of(flight_recording / "data_000.mcap")["config"]
