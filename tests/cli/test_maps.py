"""Maps, read by GDAL: layers, names, types, places and systems of what ``export`` writes."""

import sqlite3
from contextlib import closing
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import orjson
import pytest
from pyproj import Geod, Transformer

from replay.export import MapCrs, MapFeature, geopackage
from tests.cli.conftest import CAMERA

pyogrio = pytest.importorskip("pyogrio")

RECORDING = "tests/cli/frozen-0.1"
LAYERS = {"position": "Point Z", "area": "Polygon Z", "range": "Point Z", "distance": "LineString Z"}


@pytest.fixture(scope="module")
def rows(aerodft):
    """The recording's table, which maps have to agree with."""
    return [orjson.loads(line) for line in aerodft("export", RECORDING, "--format", "jsonl").out.splitlines()]


@pytest.fixture(scope="module")
def reach(aerodft, tmp_path_factory):
    """A function that surveys the river below a bridge into a new folder."""

    def survey(*options):
        folder = tmp_path_factory.mktemp("river") / "reach"
        image, camera = "configs/calibration/bridge.jpg", "configs/cameras/demo-1080p.toml"
        pose = ("--height", 7.93, "--tilt", 62.3, "--roll", -0.6, "--seed", "960,150", "--spacing", 3)
        done = aerodft("river", image, "--camera", camera, *pose, *options, "-o", folder)
        assert done.code == 0, done.err
        return folder

    return survey


@pytest.fixture(scope="module")
def placed(reach):
    return reach("--lat", 47.06, "--lon", 15.43)


def test_a_geopackage_has_a_layer_for_each_kind(aerodft, rows, tmp_path):
    done = aerodft("export", RECORDING, "-o", tmp_path / "x.gpkg")
    assert (done.code, done.err.strip()) == (0, f"{tmp_path}/x.gpkg: 118 measurements")
    layers = dict(pyogrio.list_layers(tmp_path / "x.gpkg").tolist())
    assert layers.pop("layer_styles") is None
    assert layers == LAYERS
    for layer in layers:
        info = pyogrio.read_info(tmp_path / "x.gpkg", layer=layer)
        assert (info["crs"], info["features"]) == ("EPSG:4326", sum(row["kind"] == layer for row in rows))
    frame = pyogrio.read_dataframe(tmp_path / "x.gpkg", layer="distance")
    wanted = [row for row in rows if row["kind"] == "distance"]
    np.testing.assert_array_equal(frame["distance_m"], np.array([row["value"] for row in wanted], dtype=float))
    np.testing.assert_array_equal(frame["std_m"], np.array([row["std"] for row in wanted], dtype=float))
    ends = np.array([row["ci95"] or (np.nan, np.nan) for row in wanted])
    np.testing.assert_array_equal(frame[["ci95_low_m", "ci95_high_m"]].to_numpy(), ends)
    assert frame["stamp_ns"].tolist() == [int(row["stamp_ns"]) for row in wanted]
    assert frame["time_utc"].iloc[0].value // 10**6 == int(wanted[0]["stamp_ns"]) // 10**6
    for shape, row in zip(frame.geometry, wanted, strict=True):
        assert (shape is None) == (not row["geo"])
        if shape is not None:
            places = [(each["lon_deg"], each["lat_deg"], each["alt_msl_m"]) for each in row["geo"]]
            np.testing.assert_array_equal(np.array(shape.coords), places)
            if row["value"] is not None:
                metres = Geod(ellps="WGS84").geometry_length(shape)
                assert metres == pytest.approx(row["value"], rel=1e-3)
    area = pyogrio.read_dataframe(tmp_path / "x.gpkg", layer="area")
    assert {"area_m2", "std_m2", "ci95_low_m2", "ci95_high_m2"} <= set(area.columns)
    assert area.geometry.dropna().is_valid.all()


def test_a_layer_written_in_parts_is_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(geopackage, "_FEATURES_AT_ONCE", 3)
    places = [{"type": "Point", "coordinates": [0.1 * k, 47.0, 5.0]} if k % 4 else None for k in range(10)]
    rows = [{"name": f"p{k}", "image": k if k % 3 else None, "range_m": 0.5 * k if k % 2 else None} for k in range(10)]
    features = [MapFeature("range", place, row) for place, row in zip(places, rows, strict=True)]
    assert geopackage.write_geopackage(tmp_path / "x.gpkg", features, MapCrs.wgs84()) == {"range": 10}
    frame = pyogrio.read_dataframe(tmp_path / "x.gpkg", layer="range")
    assert [None if shape is None else list(shape.coords[0]) for shape in frame.geometry] == [
        None if place is None else place["coordinates"] for place in places
    ]
    for name in ("name", "image", "range_m"):
        assert frame[name].astype(object).where(frame[name].notna(), None).tolist() == [row[name] for row in rows]
    assert list(tmp_path.iterdir()) == [tmp_path / "x.gpkg"]


def test_every_layer_carries_its_style_for_qgis(aerodft, placed, tmp_path):
    for source, layers in ((RECORDING, set(LAYERS)), (placed, {"centreline", "banks", "transects", "water"})):
        aerodft("export", source, "-o", tmp_path / "x.gpkg", "--overwrite")
        styles = pyogrio.read_dataframe(tmp_path / "x.gpkg", layer="layer_styles")
        assert set(styles["f_table_name"]) == layers
        assert styles["useAsDefault"].all()
        for each in styles.itertuples():
            columns = set(pyogrio.read_info(tmp_path / "x.gpkg", layer=each.f_table_name)["fields"])
            style = ET.fromstring(each.styleQML)  # noqa: S314 - our own
            assert style.find("renderer-v2/symbols/symbol/layer") is not None
            assert style.find("renderer-v2").get("attr", "status") in columns | {"status"}
            label = style.find("labeling/settings/text-style")
            if each.f_table_name in {"transects", "centreline"}:
                assert label.get("fieldName").startswith('format_number("width_m"')
            if label is not None:
                assert "(95 %)" in label.get("fieldName")
                assert {part for part in label.get("fieldName").split('"') if part.endswith(("_m", "_m2"))} <= columns


def test_a_geopackage_keeps_the_rules_of_its_standard(aerodft, tmp_path):
    aerodft("export", RECORDING, "-o", tmp_path / "x.gpkg", "--crs", "EPSG:7855")
    with closing(sqlite3.connect(tmp_path / "x.gpkg")) as package:
        assert package.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
        assert package.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert package.execute("PRAGMA foreign_key_check").fetchall() == []
        systems = [row[0] for row in package.execute("SELECT srs_id FROM gpkg_spatial_ref_sys")]
        assert {-1, 0, 4326, 7855} == set(systems)
        contents = dict(package.execute("SELECT table_name, srs_id FROM gpkg_contents WHERE data_type = 'features'"))
        assert contents == dict.fromkeys(LAYERS, 7855)
        indexed = package.execute("SELECT table_name FROM gpkg_extensions WHERE extension_name = 'gpkg_rtree_index'")
        assert {row[0] for row in indexed} == set(LAYERS)


@pytest.mark.parametrize("form", ["gpkg", "geojson"])
def test_maps_are_in_the_system_that_was_chosen(aerodft, rows, tmp_path, form):
    path = tmp_path / f"x.{form}"
    assert aerodft("export", RECORDING, "-o", path, "--crs", "EPSG:7855").code == 0
    layer = {"layer": "position"} if form == "gpkg" else {}
    frame = pyogrio.read_dataframe(path, **layer)
    assert frame.crs.to_epsg() == 7855
    shapes = frame[frame["kind"] == "position"].geometry.dropna()
    wanted = [row["geo"][0] for row in rows if row["kind"] == "position" and row["geo"]]
    back = Transformer.from_crs(7855, 4326, always_xy=True)
    lon, lat = back.transform([shape.x for shape in shapes], [shape.y for shape in shapes])
    np.testing.assert_allclose(lon, [each["lon_deg"] for each in wanted], atol=1e-9)
    np.testing.assert_allclose(lat, [each["lat_deg"] for each in wanted], atol=1e-9)


def test_kml_has_folders_with_typed_columns(aerodft, rows, tmp_path):
    assert aerodft("export", RECORDING, "-o", tmp_path / "x.kml").code == 0
    assert {name for name, _ in pyogrio.list_layers(tmp_path / "x.kml")} == set(LAYERS)
    frame = pyogrio.read_dataframe(tmp_path / "x.kml", layer="distance")
    wanted = [row for row in rows if row["kind"] == "distance"]
    assert frame["Name"].tolist() == [row["name"] for row in wanted]
    np.testing.assert_array_equal(frame["distance_m"], np.array([row["value"] for row in wanted], dtype=float))
    assert frame["timestamp"].iloc[0].value // 10**6 == int(wanted[0]["stamp_ns"]) // 10**6
    first = next(row for row in wanted if row["geo"])
    shape = frame.geometry[wanted.index(first)]
    places = [(each["lon_deg"], each["lat_deg"]) for each in first["geo"]]
    np.testing.assert_array_equal(np.array(shape.coords)[:, :2], places)


@pytest.mark.parametrize("form", ["gpkg", "kml", "geojson"])
def test_a_river_is_a_map_of_layers(aerodft, placed, tmp_path, form):
    path = tmp_path / f"river.{form}"
    done = aerodft("export", placed, "-o", path, "--json")
    result = orjson.loads((placed / "result.json").read_bytes())
    measured = [each for each in result["transects"] if each["status"] == "ok"]
    counts = {"centreline": 1, "banks": 2, "transects": len(measured), "water": 1}
    assert {name: done.json[name] for name in counts} == counts
    frame = pyogrio.read_dataframe(path, **({} if form == "geojson" else {"layer": "transects"}))
    frame = frame if form != "geojson" else frame[frame["layer"] == "transects"]
    assert frame.crs.to_epsg() == 4326
    for column, key in (("width_m", "width_m"), ("std_m", "std"), ("wetted_std_m", "wetted_std")):
        np.testing.assert_array_equal(frame[column], [each[key] for each in measured])
    np.testing.assert_array_equal(frame[["ci95_low_m", "ci95_high_m"]], [each["ci95"] for each in measured])
    lengths = [Geod(ellps="WGS84").geometry_length(shape) for shape in frame.geometry]
    np.testing.assert_allclose(lengths, frame["width_m"], rtol=2e-3)


def test_the_rivers_own_geojson_has_scalars_only(placed):
    features = orjson.loads((placed / "river.geojson").read_bytes())["features"]
    assert {type(value) for each in features for value in each["properties"].values()} <= {str, float, int, type(None)}
    centre = next(each["properties"] for each in features if each["properties"]["name"] == "centreline")
    width = orjson.loads((placed / "result.json").read_bytes())["width_m"]
    assert [centre[name] for name in ("width_m", "std_m", "ci95_low_m", "ci95_high_m")] == [
        width["median"], width["std"], *width["ci95"],
    ]  # fmt: skip


def test_local_metres_are_never_on_earth(aerodft, reach, tmp_path):
    folder = reach()
    assert aerodft("export", folder, "-o", tmp_path / "x.gpkg").code == 0
    for layer in ("centreline", "banks", "transects", "water"):
        info = pyogrio.read_info(tmp_path / "x.gpkg", layer=layer)
        assert "Undefined Cartesian" in info["crs"]
        assert "EPSG" not in info["crs"].partition("UNIT")[0]
        assert np.abs(info["total_bounds"]).max() < 100
    for options in (("x.kml",), ("x.geojson",), ("y.gpkg", "--crs", "EPSG:32633")):
        refused = aerodft("export", folder, "-o", tmp_path / options[0], *options[1:])
        assert (refused.code, (tmp_path / options[0]).exists()) == (2, False)
        assert "metres" in refused.last


STATION = """
[station]
name = "bridge"
[camera]
name = "bridge-cam"
width_px = 1920
height_px = 1080
hfov_deg = 62.0
[pose]
height_agl_m = 7.85
tilt_deg = 62.0
[images]
stills = "stills"
pattern = "{unix_ms}.jpg"
[[probe]]
name = "span"
kind = "width"
pixels = [[700.0, 800.0], [1300.0, 780.0]]
"""


def test_a_camera_without_a_place_measures_in_metres(aerodft, tmp_path):
    (tmp_path / "station.toml").write_text(STATION)
    (tmp_path / "stills").mkdir()
    picture = Path("configs/calibration/bridge.jpg").read_bytes()
    (tmp_path / "stills/1795221278000.jpg").write_bytes(picture)
    assert aerodft("import", "--config", tmp_path / "station.toml", "-o", tmp_path / "rec").code == 0
    assert aerodft("export", tmp_path / "rec", "-o", tmp_path / "x.gpkg").code == 0
    (row,) = pyogrio.read_dataframe(tmp_path / "x.gpkg", layer="width").itertuples()
    assert row.geometry.length == pytest.approx(row.width_m, rel=1e-9)
    assert "Undefined Cartesian" in pyogrio.read_info(tmp_path / "x.gpkg", layer="width")["crs"]
    done = aerodft("export", tmp_path / "rec", "-o", tmp_path / "x.geojson")
    assert "write .gpkg" in done.err
    assert [each["geometry"] for each in orjson.loads((tmp_path / "x.geojson").read_bytes())["features"]] == [None]
    for name, options in (("x.kml", ()), ("y.gpkg", ("--crs", 25832))):
        assert aerodft("export", tmp_path / "rec", "-o", tmp_path / name, *options).code == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("-o", "x.kml", "--crs", "EPSG:25832"), "KML is in WGS84"),
        (("-o", "x.csv", "--crs", "EPSG:25832"), "--crs for csv"),
        (("-o", "x.gpkg", "--crs", "EPSG:5701"), "got EPSG:5701 (ODN height)"),
        (("-o", "x.gpkg", "--crs", "somewhere"), "such as EPSG:25832"),
        (("-o", "x.gpkg", "--crs", "EPSG:32600"), "such as EPSG:25832"),  # of all zones
        (("--format", "gpkg"), "--format gpkg without --output"),
    ],
)
def test_what_cannot_be_is_one_sentence(aerodft, tmp_path, monkeypatch, options, said):
    source = (tmp_path / "recording").absolute()
    source.symlink_to(tmp_path.cwd() / RECORDING)
    monkeypatch.chdir(tmp_path)
    done = aerodft("export", source, *options)
    assert (done.code, said in done.last) == (2, True), done.err
    assert list(tmp_path.iterdir()) == [source]


def test_the_footprint_of_a_camera_without_a_place_is_no_geojson(aerodft, tmp_path):
    (tmp_path / "camera.toml").write_text(CAMERA)
    pose = ("--camera", tmp_path / "camera.toml", "--height", 50, "--tilt", 40)
    done = aerodft("measure", *pose, "--depth-map", tmp_path / "out", "--json")
    assert not (tmp_path / "out/footprint.geojson").exists()
    assert str(tmp_path / "out/footprint_local.json") in done.json["files"]
    local = orjson.loads((tmp_path / "out/footprint_local.json").read_bytes())
    assert (local["unit"], "type" in local) == ("m", False)
    with pytest.raises(pyogrio.errors.DataSourceError):
        pyogrio.read_info(tmp_path / "out/footprint_local.json")
