"""An output that aerodft has not heard of is one module and one line of a registry, with a table of its own."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import orjson
import pytest

from aerodft.adapters.config.station import load_station, parse_station, resolved_toml
from aerodft.adapters.outputs import OUTPUTS
from aerodft.errors import ConfigError
from replay.recordings import Recording
from tests.adapters.outputs import width_table
from tests.cli.conftest import CAMERA, STATION, write_tlog
from tests.commands import run_aerodft


@pytest.fixture
def registered() -> Iterator[None]:
    OUTPUTS.append(width_table)
    yield
    OUTPUTS.remove(width_table)


@pytest.fixture
def station(tmp_path: Path) -> Path:
    (tmp_path / "camera.toml").write_text(CAMERA)
    path = tmp_path / "station.toml"
    path.write_text(f'{STATION}\n[width_table]\nfile = "{tmp_path / "widths.csv"}"\n')
    return path


@pytest.mark.usefixtures("registered")
def test_a_flight_is_imported_into_it(station: Path, tmp_path: Path) -> None:
    done = run_aerodft("import", write_tlog(tmp_path / "flight.tlog"), "-c", station, "-o", tmp_path / "out")
    assert done.code == 0, done.err
    recorded = [orjson.loads(each) for each in Recording(tmp_path / "out").measurements()]
    title, *lines = (tmp_path / "widths.csv").read_text().splitlines()
    assert title == "# test"
    assert lines == [f"{each['stamp_ns']},centre,{40.0 / math.cos(math.radians(30.0)):.3f}" for each in recorded]
    assert len(lines) > 10


@pytest.mark.usefixtures("registered")
def test_its_table_is_checked_and_written_again(station: Path, tmp_path: Path) -> None:
    config = load_station(station)
    again = parse_station(resolved_toml(config).encode(), where="again", folder=tmp_path)
    assert again.outputs == config.outputs
    assert set(config.outputs) == {"zenoh", "width_table"}
    fewer = replace(config, outputs={})
    assert parse_station(resolved_toml(fewer).encode(), where="x", folder=tmp_path).pipeline.config_id == (
        config.pipeline.config_id
    )
    station.write_text(station.read_text() + 'colour = "red"\n')
    with pytest.raises(ConfigError, match="width_table"):
        load_station(station)


def test_without_the_line_nobody_knows_it(station: Path) -> None:
    with pytest.raises(ConfigError, match="width_table"):
        load_station(station)
