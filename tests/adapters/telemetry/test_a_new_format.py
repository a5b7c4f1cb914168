"""A log format that aerodft has not heard of is one module and one line of a registry, from the file to the numbers."""

import math
from collections.abc import Iterator
from pathlib import Path

import orjson
import pytest

from aerodft.adapters.telemetry import LOG_FORMATS
from replay.recordings import Recording
from tests.adapters.telemetry import height_table
from tests.commands import run_aerodft

STATION = """
[station]
name = "test"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["terrain"]
[images]
rate_hz = 5
[[probe]]
name = "centre"
kind = "range"
pixels = [[31.5, 23.5]]
"""


@pytest.fixture
def registered() -> Iterator[None]:
    LOG_FORMATS.append(height_table)
    yield
    LOG_FORMATS.remove(height_table)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "camera.toml").write_text('name = "small"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60.0\n')
    (tmp_path / "station.toml").write_text(STATION)
    rows = [f"{1_795_221_168 + step / 10:.1f},40.0,30.0" for step in range(30)]
    log = tmp_path / "flight.csv"
    log.write_text("\n".join(["unix_s,height_m,tilt_deg", *rows, ""]))
    return log


def ranges_m(folder: Path) -> list[float]:
    return [orjson.loads(each)["value"] for each in Recording(folder).measurements()]


@pytest.mark.usefixtures("registered")
def test_its_flights_are_imported_and_computed_again(log: Path, tmp_path: Path) -> None:
    done = run_aerodft("import", log, "-c", tmp_path / "station.toml", "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    found = ranges_m(tmp_path / "out")
    assert len(found) >= 10
    assert found == pytest.approx([40.0 / math.cos(math.radians(30.0))] * len(found))
    done = run_aerodft("recompute", tmp_path / "out", "-o", tmp_path / "again", "--json")
    assert done.code == 0, done.err
    assert ranges_m(tmp_path / "again") == found


@pytest.mark.usefixtures("registered")
def test_the_doctor_takes_it(log: Path) -> None:
    done = run_aerodft("doctor", log, "--json")
    assert done.code in {0, 4}, done.err
    assert "height-table" in {each["message"] for each in done.json["streams"]}


@pytest.mark.usefixtures("registered")
def test_refusals_name_it(tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("nothing of that kind")
    done = run_aerodft("doctor", tmp_path / "note.txt")
    assert done.code == 3
    assert " or ".join(each.TITLE for each in LOG_FORMATS) in done.err


def test_without_the_line_nobody_knows_it(log: Path, tmp_path: Path) -> None:
    done = run_aerodft("import", log, "-c", tmp_path / "station.toml", "-o", tmp_path / "out")
    assert done.code == 3
    assert "wrong type of file" in done.err


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize("command", ["import", "doctor", "sync"])
def test_the_help_names_it(command: str) -> None:
    shown = " ".join(run_aerodft(command, "--help").out.decode().split())
    assert ", ".join(each.TITLE for each in LOG_FORMATS) in shown
