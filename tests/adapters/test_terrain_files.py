"""Elevation models as GDAL writes them, against PROJ's own azimuthal map around the station."""

import math
import sys
import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pyproj import CRS, Transformer

from aerodft.adapters import terrain
from aerodft.adapters.terrain import load_elevation
from aerodft.errors import InputError
from aerodft.geometry import Plane, Terrain
from aerodft.geometry.terrain import elevation_at
from aerodft.model import CODES, GeoOrigin, Status

rasterio = pytest.importorskip("rasterio", reason="the extra terrain is not installed")
affine = pytest.importorskip("affine", reason="the extra terrain is not installed")

LAT_DEG, LON_DEG, ALT_M = 47.5, 9.2, 400.0
ORIGIN = GeoOrigin(lat_rad=math.radians(LAT_DEG), lon_rad=math.radians(LON_DEG), alt_msl_m=ALT_M)
BARE = GeoOrigin(lat_rad=ORIGIN.lat_rad, lon_rad=ORIGIN.lon_rad)
CENTIMETRE = 0.01
RISE_EAST, RISE_NORTH = 0.1, -0.05


def _plane_m(east_m, north_m):
    return 410.0 + RISE_EAST * east_m + RISE_NORTH * north_m


def _write(
    path,
    crs,
    height_of=_plane_m,
    *,
    pixel=5.0,
    size=(321, 241),
    turn_deg=0.0,
    at=(LAT_DEG, LON_DEG),
    **profile,
):
    """A raster around the station; its heights are a function of the azimuthal map's east and north."""
    columns, rows = size
    centre = Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(at[1], at[0])
    pixels_to_crs = (
        affine.Affine.translation(*centre)
        @ affine.Affine.rotation(turn_deg)
        @ affine.Affine.scale(pixel, -pixel)
        @ affine.Affine.translation(-columns / 2, -rows / 2)
    )
    column, row = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    x, y = pixels_to_crs @ (column, row)
    local = CRS.from_proj4(f"+proj=aeqd +lat_0={at[0]} +lon_0={at[1]} +ellps=WGS84")
    east, north = Transformer.from_crs(crs, local, always_xy=True).transform(x, y)
    heights = np.broadcast_to(height_of(east, north), column.shape)
    written = {"dtype": "float32", "count": 1, "nodata": -9999.0, "crs": profile.pop("declared", crs)} | profile
    heights = np.where(np.isnan(heights), written["nodata"] or 0, heights).astype(written["dtype"])
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, transform=pixels_to_crs, **written
    ) as file:
        for band in range(1, written["count"] + 1):
            file.write(heights, band)
    return path


def _around(radius_m):
    return np.random.default_rng(4).uniform(-radius_m, radius_m, (300, 2))


def _assert_is_the_plane(grid, radius_m, atol):
    places = _around(radius_m)
    want = _plane_m(places[:, 0], places[:, 1]) - ALT_M
    assert_allclose(elevation_at(grid, places), want, atol=atol)


@pytest.mark.parametrize(
    ("crs", "pixel", "cell_m"),
    [
        ("EPSG:32632", 5.0, 5.0),  # UTM
        ("EPSG:3035", 5.0, 5.0),  # Lambert's equal areas, turned against north
        ("EPSG:3857", 5.0, 5.0 * math.cos(math.radians(LAT_DEG))),  # the web's Mercator, not to scale
        ("EPSG:4326", 5e-5, 5e-5 * math.radians(6378137.0) * math.cos(math.radians(LAT_DEG))),
        ("EPSG:4258", 5e-5, 5e-5 * math.radians(6378137.0) * math.cos(math.radians(LAT_DEG))),
    ],
)
def test_heights_come_to_the_stations_axes_from_any_projection(tmp_path, crs, pixel, cell_m):
    path = _write(tmp_path / "ground.tif", crs, pixel=pixel)
    grid = load_elevation(path, ORIGIN)
    assert_allclose(grid.cell_m, cell_m, rtol=0.005)
    _assert_is_the_plane(grid, 350.0, 2 * CENTIMETRE)  # ENU on 400 m is to a scale of 1 + 6e-5
    corner = np.array([grid.east_m, grid.north_m])
    assert_allclose(corner / grid.cell_m, np.round(corner / grid.cell_m), atol=1e-9)


@pytest.mark.parametrize("turn_deg", [30.0, 180.0])
def test_a_turned_raster_lies_where_its_map_says(tmp_path, turn_deg):
    grid = load_elevation(_write(tmp_path / "ground.tif", "EPSG:32632", turn_deg=turn_deg), ORIGIN)
    _assert_is_the_plane(grid, 300.0, 2 * CENTIMETRE)


def test_only_the_square_that_is_asked_for_is_read(tmp_path):
    grid = load_elevation(_write(tmp_path / "ground.tif", "EPSG:32632"), ORIGIN, radius_m=100.0)
    rows, columns = grid.heights_m.shape
    assert rows == columns == 2 * math.floor(100.0 / grid.cell_m) + 1
    assert_allclose(-grid.east_m, 100.0, atol=grid.cell_m)
    assert_allclose(grid.east_m + (columns - 1) * grid.cell_m, 100.0, atol=grid.cell_m)
    assert not np.any(np.isnan(grid.heights_m))
    _assert_is_the_plane(grid, 95.0, CENTIMETRE)


@pytest.mark.parametrize("cell_m", [2.0, 20.0, 33.0])
def test_cells_may_be_finer_or_coarser_than_pixels(tmp_path, cell_m):
    grid = load_elevation(_write(tmp_path / "ground.tif", "EPSG:32632"), ORIGIN, cell_m=cell_m)
    assert grid.cell_m == cell_m
    _assert_is_the_plane(grid, 350.0, 2 * CENTIMETRE)


def test_coarse_cells_are_means_and_holes_do_not_spoil_them(tmp_path):
    def rough(east, north):
        noise = np.random.default_rng(1).choice([-8.0, 8.0], east.shape)
        return np.where(np.hypot(east - 200, north) < 40, np.nan, 450.0 + noise)

    grid = load_elevation(_write(tmp_path / "rough.tif", "EPSG:32632", rough), ORIGIN, cell_m=40.0)
    known = grid.heights_m[np.isfinite(grid.heights_m)]
    assert abs(np.mean(known) - 50.0) < 0.5
    assert np.max(np.abs(known - 50.0)) < 8.0
    assert np.isnan(elevation_at(grid, np.array([200.0, 0.0])))


def test_a_ray_meets_the_slope_of_a_file(tmp_path):
    grid = load_elevation(_write(tmp_path / "slope.tif", "EPSG:32632", lambda e, _: 300.0 + 0.2 * e), ORIGIN)
    down = math.radians(10.0)
    camera, ray = np.array([0.0, 0.0, 0.0]), np.array([math.cos(down), 0.0, -math.sin(down)])
    slope = Plane.sloping([0.0, 0.0, -100.0], math.atan(0.2), math.pi / 2)
    hits = Terrain(grid, 0.0).meet(camera, ray, 0.0)
    assert_allclose(hits.points_enu_m, slope.meet(camera, ray, 0.0).points_enu_m, atol=0.03)
    assert_allclose([hits.points_enu_m[0], hits.range_m], [265.7, 269.8], atol=0.1)


def test_a_ray_does_not_see_through_the_ridge_of_a_file(tmp_path):
    path = _write(tmp_path / "ridge.tif", "EPSG:32632", lambda _, n: ALT_M + 80.0 * ((n > 150) & (n < 260)), pixel=2.0)
    down = math.radians(10.0)
    ray = np.array([0.0, math.cos(down), -math.sin(down)])
    hits = Terrain(load_elevation(path, ORIGIN), 0.0).meet(np.array([0.0, 0.0, 100.0]), ray, 0.0)
    assert abs(hits.points_enu_m[1] - 150.0) <= 2.0


def test_holes_stay_holes_and_may_be_filled_with_water(tmp_path):
    def lake(east, north):
        return np.where(np.hypot(east - 100, north) < 30, np.nan, 430.0)

    path = _write(tmp_path / "lake.tif", "EPSG:32632", lake)
    down = np.array([0.0, 0.0, -1.0])
    above = np.array([100.0, 0.0, 200.0])
    holes, filled = load_elevation(path, ORIGIN), load_elevation(path, ORIGIN, fill_msl_m=425.0)
    assert CODES[int(Terrain(holes, 0.0).meet(above, down, 0.0).status)] is Status.NO_ELEVATION
    assert_allclose(Terrain(filled, 0.0).meet(above, down, 0.0).points_enu_m, [100.0, 0.0, 25.0], atol=1e-9)
    assert_allclose(elevation_at(filled, np.array([0.0, 0.0])), 30.0, atol=1e-5)


def test_heights_above_the_ground_at_a_station_without_altitude(tmp_path):
    path = _write(tmp_path / "ground.tif", "EPSG:32632")
    grid = load_elevation(path, BARE)
    places = _around(300.0)
    assert_allclose(elevation_at(grid, np.zeros(2)), 0.0, atol=1e-9)
    assert_allclose(elevation_at(grid, places), _plane_m(*places.T) - 410.0, atol=2 * CENTIMETRE)


def test_feet_of_the_band_and_of_the_vertical_datum(tmp_path):
    new_york = GeoOrigin(lat_rad=math.radians(40.7), lon_rad=math.radians(-73.9), alt_msl_m=0.0)
    feet = _write(tmp_path / "feet.tif", "EPSG:2263", lambda e, _: 100.0 + 0 * e, at=(40.7, -73.9))
    with rasterio.open(feet, "r+") as file:
        file.units = ["US survey foot"]
    assert_allclose(elevation_at(load_elevation(feet, new_york), np.zeros(2)), 100 * 1200 / 3937, atol=1e-9)
    compound = _write(
        tmp_path / "compound.tif", "EPSG:2263", lambda e, _: 100.0 + 0 * e, at=(40.7, -73.9), declared="EPSG:2263+6360"
    )
    grid = load_elevation(compound, new_york)
    assert_allclose(elevation_at(grid, np.zeros(2)), 100 * 1200 / 3937, atol=1e-9)
    assert_allclose(grid.cell_m, 5.0 * 1200 / 3937, rtol=1e-3)


def test_scale_and_offset_of_the_band_count(tmp_path):
    path = _write(tmp_path / "scaled.tif", "EPSG:32632", lambda e, _: 2000 + 0 * e, dtype="int16", nodata=-32768)
    with rasterio.open(path, "r+") as file:
        file.scales, file.offsets = [0.1], [300.0]
    assert_allclose(elevation_at(load_elevation(path, ORIGIN), np.zeros(2)), 500.0 - ALT_M, atol=1e-9)


def _fails(path, *says, origin=ORIGIN, **options):
    with pytest.raises(InputError) as caught:
        load_elevation(path, origin, **options)
    sentence = str(caught.value)
    assert "\n" not in sentence
    for each in (path.name, *says):
        assert each in sentence
    assert caught.value.exit_code == 3


def test_what_is_no_file_and_no_raster_is_refused(tmp_path):
    _fails(tmp_path / "none.tif", "no elevation model", "No such file")
    _fails(tmp_path, "got a folder")
    text = tmp_path / "text.tif"
    text.write_text("heights: 1 2 3\n")
    _fails(text, "not a readable elevation model", "got text")
    whole = _write(tmp_path / "whole.tif", "EPSG:32632").read_bytes()
    cut = tmp_path / "cut.tif"
    for kept in (40, len(whole) // 2):
        cut.write_bytes(whole[:kept])
        _fails(cut, "not a readable elevation model", "cut short")


def test_a_raster_without_a_place_is_refused(tmp_path):
    heights = np.zeros((1, 9, 9), "float32")
    for name, crs, transform, says in (
        ("nothing.tif", None, None, "got none"),
        ("nocrs.tif", None, affine.Affine(5, 0, 5e5, 0, -5, 5e6), "gdal_edit.py -a_srs"),
        ("noplace.tif", "EPSG:32632", None, "no place for its pixels"),
        ("local.tif", 'LOCAL_CS["yard",UNIT["metre",1]]', affine.Affine(5, 0, 0, 0, -5, 0), "yard"),
    ):
        path = tmp_path / name
        profile = {"driver": "GTiff", "width": 9, "height": 9, "count": 1, "dtype": "float32"}
        if crs:
            profile["crs"] = crs
        if transform:
            profile["transform"] = transform
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(path, "w", **profile) as file:
                file.write(heights)
        _fails(path, "no usable coordinate reference system", says)


def test_a_raster_of_somewhere_else_is_refused(tmp_path):
    path = _write(tmp_path / "ground.tif", "EPSG:32632")
    far = GeoOrigin(lat_rad=math.radians(-35.36), lon_rad=math.radians(149.16), alt_msl_m=584.0)
    _fails(path, "does not cover the station", "latitudes 47.49", "expected -35.36000, 149.16000 inside", origin=far)
    near = GeoOrigin(lat_rad=math.radians(LAT_DEG + 0.01), lon_rad=ORIGIN.lon_rad, alt_msl_m=ALT_M)
    _fails(path, "does not cover the station", origin=near)


def test_the_wrong_band_is_refused(tmp_path):
    _fails(_write(tmp_path / "one.tif", "EPSG:32632"), "no such band", "got 2", "1 to 1", band=2)
    _fails(_write(tmp_path / "zero.tif", "EPSG:32632"), "no such band", "got 0", band=0)
    photo = _write(
        tmp_path / "photo.tif",
        "EPSG:32632",
        lambda e, _: 99 + 0 * e,
        count=3,
        dtype="uint8",
        nodata=None,
        photometric="RGB",
    )
    _fails(photo, "a band that holds no heights", "band 1 of 3: red, uint8")


def test_voids_that_nobody_declared_are_refused(tmp_path):
    def void(east, north):
        return np.where(np.hypot(east, north) < 50, -32768.0, 430.0)

    path = _write(tmp_path / "void.tif", "EPSG:32632", void, nodata=None)
    _fails(path, "an impossible height", "got -32768 m", "-500 to 9000 m", "-a_nodata")


def test_nothing_but_nodata_is_refused(tmp_path):
    path = _write(tmp_path / "empty.tif", "EPSG:32632", lambda e, _: np.nan * e)
    _fails(path, "no heights around the station", "nodata only")
    hole = _write(tmp_path / "hole.tif", "EPSG:32632", lambda e, n: np.where(np.hypot(e, n) < 50, np.nan, 400.0))
    _fails(hole, "no height at the station", "give the station's altitude", origin=BARE)
    assert np.isnan(elevation_at(load_elevation(hole, ORIGIN), np.zeros(2)))


def test_heights_above_the_ellipsoid_are_not_mixed_with_an_altitude(tmp_path):
    path = _write(tmp_path / "ellipsoid.tif", "EPSG:4326", pixel=5e-5, declared="EPSG:4979")
    _fails(path, "heights of another kind", "expected above mean sea level", "above the ground at the station")
    assert_allclose(elevation_at(load_elevation(path, BARE), np.zeros(2)), 0.0, atol=1e-9)


def test_units_that_nobody_knows_are_refused(tmp_path):
    path = _write(tmp_path / "cubits.tif", "EPSG:32632")
    with rasterio.open(path, "r+") as file:
        file.units = ["cubit"]
    _fails(path, "heights in an unknown unit", "'cubit'", "metres or feet")


def test_too_much_and_too_little_ground_is_refused(tmp_path, monkeypatch):
    path = _write(tmp_path / "ground.tif", "EPSG:32632")
    monkeypatch.setattr(terrain, "MAX_NODES", 1000)
    _fails(path, "too much ground", "expected 1000 at most", "smaller radius or larger cells")
    _fails(path, "too little ground", "smaller cells", radius_m=3000.0, cell_m=3000.0)
    pixel = _write(tmp_path / "pixel.tif", "EPSG:32632", size=(1, 1))
    _fails(pixel, "too small", "1 x 1 pixels")


@pytest.mark.parametrize("wrong", [{"radius_m": 0.0}, {"radius_m": math.inf}, {"cell_m": -1.0}, {"cell_m": 9e9}])
def test_lengths_that_make_no_sense_are_refused(tmp_path, wrong):
    with pytest.raises(ValueError, match="expected both above 0"):
        load_elevation(tmp_path / "ground.tif", ORIGIN, **wrong)


def test_without_the_extra_one_sentence_says_so(tmp_path, monkeypatch):
    path = _write(tmp_path / "ground.tif", "EPSG:32632")
    monkeypatch.setitem(sys.modules, "rasterio", None)
    _fails(path, "elevation models need rasterio", "pip install 'aerodft[terrain]'")


def test_metadata_that_names_another_file_is_refused_before_it_is_opened(tmp_path):
    """GDAL opens such a file, or address, with the first look that is coarser than the raster's own pixels."""
    path = _write(tmp_path / "dem.tif", "EPSG:32632")
    with rasterio.open(path, "r+") as file:
        file.update_tags(ns="OVERVIEWS", OVERVIEW_FILE="/vsicurl/http://127.0.0.1:9/other.tif")
    with pytest.raises(InputError, match=r"names another file: got /vsicurl/http://127\.0\.0\.1:9/other\.tif"):
        load_elevation(path, ORIGIN, radius_m=300.0, cell_m=50.0)
