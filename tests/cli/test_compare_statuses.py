"""``aerodft compare`` where an answer came or went: a status that changed, in the unit of the kind."""

import re
from pathlib import Path

import orjson
import pytest

AREA = """
[[probe]]
name = "field"
kind = "area"
pixels = [[10.0, 30.0], [50.0, 30.0], [50.0, 45.0], [10.0, 45.0]]
"""


def units_of_field(text: bytes) -> set[str]:
    return {item["unit"] for item in map(orjson.loads, text.splitlines()) if item["name"] == "field"}


@pytest.fixture
def high_and_low(aerodft, desk, tmp_path: Path) -> tuple[Path, Path]:
    """One flight with an area, and the same where the drone counts as too low to measure anything."""
    config = desk.station(desk.config.read_text() + AREA)
    high, low, limit = tmp_path / "high", tmp_path / "low", tmp_path / "limit.toml"
    assert aerodft("import", desk.log, "-c", config, "-o", high).code == 0
    text = (high / "config.toml").read_text()
    changed = re.sub(r"min_m = \S+", "min_m = 100.0", text)
    assert changed != text
    limit.write_text(changed)
    assert aerodft("recompute", high, "-c", limit, "-o", low).code == 4  # no pose has an answer; it is kept
    return high, low


def test_a_number_that_went_is_a_changed_status(aerodft, high_and_low) -> None:
    high, low = high_and_low
    found = aerodft("compare", high, low, "--json")
    assert found.code == 5
    field = found.json["probes"]["field"]
    images = found.json["probes"]["centre"]["paired"]
    assert (field["unit"], field["paired"], field["only_first"], field["only_second"]) == ("m2", images, 0, 0)
    assert field["status_changes"] == {"ok -> BELOW_MIN_HEIGHT": images}


def test_without_a_number_the_unit_is_that_of_the_kind(aerodft, high_and_low) -> None:
    for folder in high_and_low:
        assert units_of_field(aerodft("export", folder, "--format", "jsonl").out) == {"m2"}


def test_of_an_early_recording_with_metres_for_it_too(aerodft, high_and_low, tmp_path: Path) -> None:
    high, low = high_and_low
    table, early = tmp_path / "low.csv", tmp_path / "early.csv"
    assert aerodft("export", low, "-o", table).code == 0
    text = table.read_text()
    assert text.count(",m2,") > 0
    early.write_text(text.replace(",m2,", ",m,"))
    for other in (table, early):
        found = aerodft("compare", high, other, "--json").json["probes"]
        assert found["field"]["only_first"] == found["field"]["only_second"] == 0
