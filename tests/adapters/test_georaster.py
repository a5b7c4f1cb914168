"""Georeferenced top views against PROJ, and read back by others' readers."""

import math

import cv2
import numpy as np
import orjson
import pytest
from numpy.testing import assert_allclose
from pyproj import CRS, Geod, Transformer

from aerodft.dft.maps import TopView
from aerodft.errors import InputError
from aerodft.geometry import lat_lon
from aerodft.model import GeoOrigin
from aerodft.reports.depth import georeference, map_projection, write_top_view

MILLIMETRE = 1e-3


def place(lat_deg, lon_deg):
    return GeoOrigin(lat_rad=math.radians(lat_deg), lon_rad=math.radians(lon_deg), alt_msl_m=100.0)


@pytest.fixture
def view():
    pixels = np.random.default_rng(1).integers(0, 255, (200, 300, 4), dtype=np.uint8)
    pixels[..., 3] = 255
    return TopView(pixels=pixels, west_m=-20.0, north_m=350.0, step_m=0.5)


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "epsg"),
    [
        (48.0, 11.0, 32632),
        (-35.36, 149.17, 32755),
        (0.0, -180.0, 32601),
        (10.0, 179.9, 32660),
        (10.0, 190.0, 32602),
        (86.0, 20.0, 32661),
        (-85.0, 20.0, 32761),
    ],
)
def test_every_pixel_lies_where_its_latitude_and_longitude_are(view, lat_deg, lon_deg, epsg):
    origin = place(lat_deg, lon_deg)
    assert map_projection(origin).to_epsg() == epsg
    found = georeference(view, origin)
    corners = np.array([[0, 0], [300, 0], [300, 200], [0, 200], [150, 100]])
    x, y = found.affine @ np.column_stack([corners, np.ones(5)]).T
    lon, lat = Transformer.from_crs(found.crs, "EPSG:4326", always_xy=True).transform(x, y)
    want = np.degrees(lat_lon(origin, [-20.0, 350.0] + corners * [0.5, -0.5]))
    _, _, off_m = Geod(ellps="WGS84").inv(lon, lat, want[:, 1], want[:, 0])
    assert np.max(off_m) < MILLIMETRE
    assert found.misfit_m < MILLIMETRE


def test_files_are_read_back_by_others(view, tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="the extra terrain is not installed")
    about = write_top_view(view, place(48.0, 11.0), tmp_path)
    assert sorted(about["files"]) == sorted(path.name for path in tmp_path.iterdir())
    assert np.array_equal(cv2.imread(str(tmp_path / "topview.png"), cv2.IMREAD_UNCHANGED), view.pixels)
    assert CRS.from_wkt((tmp_path / "topview.prj").read_text()).to_epsg(min_confidence=20) == 32632
    assert orjson.loads((tmp_path / "topview.json").read_bytes()) == about
    with rasterio.open(tmp_path / "topview.tif") as tif, rasterio.open(tmp_path / "topview.png") as png:
        assert tif.crs.to_epsg() == 32632
        assert_allclose(tuple(tif.transform)[:6], np.ravel(about["affine"]), atol=1e-9)
        assert_allclose(tuple(png.transform)[:6], np.ravel(about["affine"]), atol=1e-6)
        assert np.array_equal(tif.read(), png.read())
        assert_allclose(tif.read(1), view.pixels[..., 2])


def test_without_a_place_it_is_laid_out_in_metres(view, tmp_path):
    about = write_top_view(view, None, tmp_path)
    assert about["crs"] == "local"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["topview.json", "topview.pgw", "topview.png"]
    numbers = [float(line) for line in (tmp_path / "topview.pgw").read_text().splitlines()]
    assert numbers == [0.5, 0.0, 0.0, -0.5, -19.75, 349.75]


def test_a_folder_that_is_none_is_one_sentence(view, tmp_path):
    with pytest.raises(InputError, match="the top view cannot be written"):
        write_top_view(view, None, tmp_path / "missing")
