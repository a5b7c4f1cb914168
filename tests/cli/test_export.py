"""``aerodft export``: the same measurements in every table, nothing overwritten, nothing half."""

import csv
import io
import math
from datetime import UTC, datetime

import orjson
import pyarrow.parquet as pq
import pytest

from replay.export import EXPORTERS, MapCrs, parse_measurement
from replay.export.table import COLUMNS, ColumnType, geometry_of
from replay.recordings import Recording


def exported(payloads, form):
    """Measurements in a text format."""
    return "".join(EXPORTERS[form].text(map(parse_measurement, payloads), MapCrs.wgs84()))


def rows_of_csv(text):
    return list(csv.DictReader(io.StringIO(text)))


def same(cell, value, kind):
    """Whether a CSV cell and a Parquet value are the same."""
    if value is None:
        return cell == ""
    if kind is ColumnType.TIME:
        return datetime.fromisoformat(cell) == value
    if kind is ColumnType.NUMBER:
        return float(cell) == value
    return (orjson.loads(cell) if kind in {ColumnType.NUMBERS, ColumnType.VECTORS} else type(value)(cell)) == value


def test_csv_and_parquet_hold_the_same(aerodft, flight_recording, tmp_path):
    for form in ("csv", "parquet"):
        done = aerodft("export", flight_recording, "--format", form, "-o", tmp_path / f"x.{form}", "--json")
        assert (done.code, done.json["measurements"]) == (0, 15), done.err
    table = pq.read_table(tmp_path / "x.parquet")
    rows = rows_of_csv((tmp_path / "x.csv").read_text())
    assert table.column_names == list(rows[0]) == list(COLUMNS)
    for row, values in zip(rows, table.to_pylist(), strict=True):
        wrong = [name for name, kind in COLUMNS.items() if not same(row[name], values[name], kind)]
        assert wrong == []


def test_lines_are_the_measurements_as_they_were_sent(aerodft, flight_recording):
    lines = aerodft("export", flight_recording, "--format", "jsonl").out.splitlines()
    assert [orjson.loads(line) for line in lines] == list(map(orjson.loads, Recording(flight_recording).measurements()))
    assert len(lines) == 15


def test_without_a_pose_no_std_is_stated_and_what_is_level_is_zero(flight_recording):
    item = orjson.loads(next(Recording(flight_recording).measurements()))
    pose = item["pose"] | {"roll_deg": -1.89e-14, "height_age_s": 0.25}
    missed = pose | {"tilt_deg": None, "roll_deg": None, "heading_deg": None, "height_agl_m": None}
    payloads = [orjson.dumps(item | {"pose": each}) for each in (pose, missed)]
    known, unknown = rows_of_csv(exported(payloads, "csv"))
    assert (known["roll_deg"], known["height_age_s"]) == ("0.0", "0.25")
    stds = [name for name in COLUMNS if "_std_" in name and not name.startswith("level_")]
    assert [unknown[name] for name in stds] == [""] * 5
    assert all(float(known[name]) == item["pose"]["std"][name.replace("_std", "")] for name in stds)


def test_both_banks_of_a_width_are_in_its_row(aerodft, flight_recording):
    row = next(row for row in rows_of_csv(aerodft("export", flight_recording).out.decode()) if row["name"] == "width")
    lat, lon = math.radians(float(row["lat_deg"])), float(row["lon_deg"])
    north_m = (float(row["lat_2_deg"]) - float(row["lat_deg"])) * 110_956  # a degree of latitude at 35.4 degrees S
    east_m = (float(row["lon_2_deg"]) - lon) * 111_320 * math.cos(lat)
    assert math.hypot(north_m, east_m) == pytest.approx(float(row["value"]), rel=2e-3)
    (e1, n1, _), (e2, n2, _) = orjson.loads(row["enu_m"])
    assert math.hypot(e2 - e1, n2 - n1) == pytest.approx(float(row["value"]), rel=1e-9)
    assert orjson.loads(row["pixels_px"]) == [[10, 24], [50, 24]]
    assert row["geo_wkt"].startswith(f"LINESTRING Z ({row['lon_deg']} {row['lat_deg']} ")


def test_an_area_is_a_closed_counterclockwise_polygon(flight_recording):
    item = orjson.loads(next(Recording(flight_recording).measurements()))
    corners = [(-35.0, 149.0), (-34.9, 149.0), (-34.9, 149.1)]  # north, then east: clockwise
    item |= {"kind": "area", "geo": [{"lat_deg": lat, "lon_deg": lon, "alt_msl_m": 5.0} for lat, lon in corners]}
    payload = orjson.dumps(item)
    document = orjson.loads(exported([payload], "geojson"))
    geometry = document["features"][0]["geometry"]
    assert geometry["type"] == "Polygon"
    ring = [[149.1, -34.9, 5.0], [149.0, -34.9, 5.0], [149.0, -35.0, 5.0], [149.1, -34.9, 5.0]]
    assert geometry["coordinates"] == [ring]
    (row,) = rows_of_csv(exported([payload], "csv"))
    assert row["geo_wkt"] == "POLYGON Z ((149.1 -34.9 5.0, 149.0 -34.9 5.0, 149.0 -35.0 5.0, 149.1 -34.9 5.0))"


def test_a_point_without_an_altitude_makes_all_flat():
    geo = [{"lat_deg": 1.0, "lon_deg": 2.0, "alt_msl_m": 3.0}, {"lat_deg": 4.0, "lon_deg": 5.0, "alt_msl_m": None}]
    assert geometry_of({"geo": geo, "kind": "distance"})["coordinates"] == [[2.0, 1.0], [5.0, 4.0]]
    assert geometry_of({"geo": [geo[0] | {"lat_deg": None}], "kind": "position"}) is None


@pytest.mark.parametrize("form", ["csv", "geojson", "jsonl", "parquet"])
def test_nothing_is_overwritten_unless_asked(aerodft, flight_recording, tmp_path, form):
    target = tmp_path / "kept"
    target.write_text("mine")
    refused = aerodft("export", flight_recording, "--format", form, "-o", target)
    assert (refused.code, target.read_text()) == (3, "mine")
    assert refused.last == f"aerodft: {target}: the file exists; choose another name, or add --overwrite"
    asked = aerodft("export", flight_recording, "--format", form, "-o", target, "--overwrite")
    assert (asked.code, target.stat().st_size > 1000) == (0, True)
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("form", ["csv", "geojson", "jsonl", "parquet"])
def test_what_fails_on_the_way_leaves_no_file(aerodft, flight_recording, tmp_path, form, monkeypatch):
    def broken(recording):
        yield from list(Recording.original(recording))[:7]
        yield b'{"name": 1}'

    monkeypatch.setattr(Recording, "original", Recording.measurements, raising=False)
    monkeypatch.setattr(Recording, "measurements", broken)
    done = aerodft("export", flight_recording, "--format", form, "-o", tmp_path / "x")
    assert (done.code, "a recorded measurement is none" in done.last) == (3, True)
    assert list(tmp_path.iterdir()) == []


def test_a_binary_format_needs_a_file(aerodft, flight_recording):
    done = aerodft("export", flight_recording, "--format", "parquet")
    assert (done.code, done.out) == (2, b"")
    assert "--format parquet without --output" in done.last


def test_times_are_utc(aerodft, flight_recording):
    (row, *_) = rows_of_csv(aerodft("export", flight_recording).out.decode())
    assert datetime.fromisoformat(row["time_utc"]).tzinfo == UTC
    assert datetime.fromisoformat(row["time_utc"]).timestamp() == pytest.approx(int(row["stamp_ns"]) / 1e9, abs=1e-6)
