"""Recordings compared and exported, and the commands that do it."""

import csv
import io
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import orjson
import pytest
from mcap.writer import Writer

from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.adapters.wire.measurement import MEASUREMENT_SCHEMA, encode_measurement
from aerodft.adapters.wire.schemas import schema_text
from aerodft.cli.main import main
from aerodft.errors import InputError
from aerodft.model import Camera, GeoPoint, Measurement, PoseSample, ProbeKind, ProjectionModel, Status
from replay.compare import Comparison, compare_measurements, parse_tolerance
from replay.export import EXPORTERS, MapCrs, parse_measurement
from replay.recordings import Recording
from tests.batches import one_tick, take

START_NS = 1_795_221_278_000_000_000
CAMERA = Camera.from_fov(name="c", width_px=8, height_px=6, hfov_rad=1, vfov_rad=1)


def a_measurement(index: int, value: float | None = None, **changes: object) -> Measurement:
    base = Measurement(
        name="w",
        kind=ProbeKind.DISTANCE,
        status=Status.OK,
        reasons=(),
        stamp_ns=START_NS + index,
        pixels=((1.0, 2.0), (3.0, 4.0)),
        std_px=1.0,
        camera="c",
        model=ProjectionModel.PINHOLE,
        pose=PoseSample(stamp_ns=START_NS, status=Status.NO_HEIGHT),
        value=float(index) if value is None else value,
        std=0.3,
        image=index,
    )
    return replace(base, **changes)


def record(folder: Path, values: Sequence[Measurement]) -> Path:
    recorder = McapRecorder(folder, RecorderSettings(station="s", camera=CAMERA, lossless=True), started_ns=START_NS)
    take(recorder, one_tick(START_NS + 50, []), *values)
    recorder.close()
    return folder


def compared(
    tmp_path: Path, first: Sequence[Measurement], second: Sequence[Measurement], *tolerance: str
) -> Comparison:
    folders = [tmp_path / f"{side}{len(list(tmp_path.iterdir()))}" for side in "ab"]
    one, other = (Recording(record(*each)) for each in zip(folders, (first, second), strict=True))
    return compare_measurements(one.folder, other.folder, parse_tolerance(tolerance))


def test_the_same_measurements_are_identical(tmp_path: Path) -> None:
    values = [a_measurement(index) for index in range(5)]
    got = compared(tmp_path, values, values)
    assert (got.is_identical, got.total.paired, got.differs) == (True, 5, False)
    assert got.total.max_abs == 0.0


def test_differences_are_told_in_units_and_in_stds(tmp_path: Path) -> None:
    first = [a_measurement(index) for index in range(4)]
    second = [a_measurement(index, index + 0.1 * index, std=0.4) for index in range(4)]
    got = compared(tmp_path, first, second)
    assert not got.is_identical
    assert got.total.max_abs == pytest.approx(0.3)
    assert got.total.median_abs == pytest.approx(0.15)
    assert got.total.max_std_abs == pytest.approx(0.1)
    assert got.total.max_sigmas == pytest.approx(0.3 / np.hypot(0.3, 0.4))
    assert (got.total.unit, list(got.probes)) == ("m", ["w"])
    assert got.differs
    assert compared(tmp_path, first, second, "0.29").differs
    assert not compared(tmp_path, first, second, "0.31").differs


def test_missing_ones_and_changed_statuses_are_counted(tmp_path: Path) -> None:
    first = [a_measurement(0), a_measurement(1), a_measurement(2), a_measurement(2, 5.0)]
    lost = replace(a_measurement(1), value=None, std=None, status=Status.NO_HEIGHT)
    second = [a_measurement(0), lost, a_measurement(2), a_measurement(2, 5.0), a_measurement(7, name="x")]
    second = [*second, a_measurement(0, image=None)]
    got = compared(tmp_path, first, second, "1e9")
    assert (got.total.paired, got.total.only_first, got.total.only_second) == (4, 0, 2)
    assert got.total.status_changes == {"ok -> NO_HEIGHT": 1}
    assert got.total.count == 3
    assert got.differs


def test_another_order_is_not_identical_but_equal(tmp_path: Path) -> None:
    values = [a_measurement(index) for index in range(3)]
    got = compared(tmp_path, values, values[::-1])
    assert not got.is_identical
    assert not got.differs


GEO = (
    GeoPoint(lat_rad=np.radians(-35.5), lon_rad=np.radians(149.0), alt_msl_m=584.0),
    GeoPoint(lat_rad=np.radians(-35.25), lon_rad=np.radians(149.5), alt_msl_m=None),
)


def exported(payloads: list[bytes], form: str) -> str:
    """Measurements in a text format."""
    return "".join(EXPORTERS[form].text(map(parse_measurement, payloads), MapCrs.wgs84()))


def payloads(tmp_path: Path) -> list[bytes]:
    values = [
        a_measurement(0, geo=GEO, ci95=(-1.0, 1.0), range_m=(7.0, 8.0)),
        a_measurement(1, geo=GEO[:1], kind=ProbeKind.POSITION),
        replace(a_measurement(2), value=None, status=Status.NO_HEIGHT, reasons=("no, height", 'said "no"')),
        a_measurement(3, geo=(GeoPoint(lat_rad=np.nan, lon_rad=0.0, alt_msl_m=None),)),
    ]
    return list(Recording(record(tmp_path / "r", values)).measurements())


def test_the_table_is_csv_that_a_stock_reader_reads(tmp_path: Path) -> None:
    text = exported(payloads(tmp_path), "csv")
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [row["value"] for row in rows] == ["0.0", "1.0", "", "3.0"]
    assert rows[0]["time_utc"] == "2026-11-21T01:54:38.000000+00:00".replace("01:54", rows[0]["time_utc"][11:16])
    assert rows[0]["stamp_ns"] == str(START_NS)
    assert (rows[0]["ci95_low"], rows[0]["range_m"]) == ("-1.0", "7.0")
    assert float(rows[0]["lat_deg"]) == pytest.approx(-35.5, abs=1e-12)
    assert (rows[2]["status"], rows[2]["reasons"], rows[2]["lat_deg"]) == ("NO_HEIGHT", 'no, height; said "no"', "")


def test_the_map_is_geojson(tmp_path: Path) -> None:
    document = orjson.loads(exported(payloads(tmp_path), "geojson"))
    assert document["type"] == "FeatureCollection"
    line, point, nothing, unknown = document["features"]
    assert line["geometry"]["type"] == "LineString"
    np.testing.assert_allclose(line["geometry"]["coordinates"][0], [149.0, -35.5], atol=1e-10)
    np.testing.assert_allclose(line["geometry"]["coordinates"][1], [149.5, -35.25], atol=1e-10)
    assert point["geometry"]["type"] == "Point"
    assert (nothing["geometry"], unknown["geometry"]) == (None, None)
    assert (nothing["properties"]["status"], line["properties"]["distance_m"]) == ("NO_HEIGHT", 0.0)


def test_no_measurements_are_an_empty_table_and_map() -> None:
    assert orjson.loads(exported([], "geojson"))["features"] == []
    assert exported([], "csv").count("\n") == 1


@pytest.mark.parametrize("form", [each.name for each in EXPORTERS.values() if each.is_text])
def test_what_is_no_measurement_is_not_exported(form: str) -> None:
    with pytest.raises(InputError, match="a recorded measurement is none"):
        exported([b"{}"], form)


class Done(NamedTuple):
    code: int
    out: str
    err: str


Command = Callable[..., Done]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    def run(*arguments: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["aerodft", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return Done(int(ended.value.code or 0), *capsys.readouterr())

    return run


def test_compare_exits_0_or_5_and_prints_one_document(tmp_path: Path, command: Command) -> None:
    a = record(tmp_path / "a", [a_measurement(1)])
    b = record(tmp_path / "b", [a_measurement(1, 1.5)])
    same = command("compare", a, a, "--json")
    assert (same.code, orjson.loads(same.out)["identical"]) == (0, True)
    other = command("compare", a, b, "--json")
    assert other.code == 5
    assert orjson.loads(other.out)["total"]["max_abs"] == 0.5
    near = command("compare", a, b, "--tolerance", 1)
    assert near.code == 0
    assert "equal within the tolerance" in near.err
    assert command("compare", a, tmp_path / "none").code == 3


def test_export_writes_the_file_or_says_why_not(tmp_path: Path, command: Command) -> None:
    a = record(tmp_path / "a", [a_measurement(1)])
    empty = record(tmp_path / "empty", [])
    target = tmp_path / "out.geojson"
    done = command("export", a, "--format", "geojson", "-o", target, "--json")
    whole = {"damaged_chunks": 0, "missing_segments": 0, "damaged_messages": 0, "gaps": []}
    assert orjson.loads(done.out) == {"file": str(target), "format": "geojson", "measurements": 1, **whole}
    assert len(orjson.loads(target.read_bytes())["features"]) == 1
    assert command("export", a).out.startswith("time_utc,stamp_ns,name")
    nothing = command("export", empty, "-o", tmp_path / "no.csv")
    assert (nothing.code, (tmp_path / "no.csv").exists()) == (4, False)
    refused = command("export", a, "-o", tmp_path / "nowhere" / "x.csv")
    assert (refused.code, refused.err.count("\n")) == (3, 1)


def test_replay_says_what_it_published(tmp_path: Path, command: Command) -> None:
    a = record(tmp_path / "a", [a_measurement(1)])
    done = command("replay", a, "--rate", "max", "--listen", "none", "--json")
    assert orjson.loads(done.out)["measurements"] == 1
    assert command("replay", a, "--from", "9", "--to", "3", "--listen", "none").code == 2
    assert command("replay", tmp_path, "--listen", "none").code == 3


def recorded_before(folder: Path, payloads: list[bytes]) -> Path:
    """Each measurement a record of its own, on its probe's topic."""
    folder.mkdir()
    with (folder / "data_000.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="x-aerodft", library="aerodft 0.1.0")
        schema = writer.register_schema(MEASUREMENT_SCHEMA, "jsonschema", schema_text(MEASUREMENT_SCHEMA))
        channels: dict[bytes, int] = {}
        for at_ns, payload in enumerate(payloads, start=1):
            name = payload.split(b'"', 8)[7]
            if name not in channels:
                channels[name] = writer.register_channel(f"aerodft/s/measurement/{name.decode()}", "json", schema)
            writer.add_message(channels[name], at_ns, payload, at_ns)
        writer.finish()
    return folder


def test_recordings_of_before_with_a_record_for_each_measurement_are_read_as_ever(tmp_path: Path) -> None:
    values = [a_measurement(index, name=name) for index in range(5) for name in ("w", "v")]
    payloads = list(map(encode_measurement, values))
    old, new = Recording(recorded_before(tmp_path / "old", payloads)), Recording(record(tmp_path / "new", values))
    assert list(old.measurements()) == list(new.measurements()) == payloads
    assert compare_measurements(old.folder, new.folder).is_identical
