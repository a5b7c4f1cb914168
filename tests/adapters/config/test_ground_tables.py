"""Slopes, elevation models, full covariances and what lies on top of things, as a station's file says them."""

import hashlib
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from numpy.testing import assert_allclose, assert_array_equal
from pyproj import Geod

from aerodft.adapters.config.station import parse_station, resolved_toml, with_calibration, with_derived_settings
from aerodft.adapters.config.station.loading import station_document
from aerodft.errors import ConfigError, InputError
from aerodft.geometry import STANDARD_REFRACTION, Terrain
from aerodft.model import ProbeKind

LAT, LON = 47.5, 9.2
CAMERA = '[camera]\nname = "A"\nwidth_px = 100\nheight_px = 50\nhfov_deg = 90\n'
STATION = '[station]\nname = "s"\n'
ORIGIN = f"origin = {{ lat_deg = {LAT}, lon_deg = {LON}, alt_msl_m = 400.0 }}\n"
FLIGHT = STATION + CAMERA + "[telemetry]\n"
PLACED = STATION + ORIGIN + CAMERA + "[telemetry]\n"
POSE = "[pose]\nheight_agl_m = 8\ntilt_deg = 60\nheading_deg = 0\n"
PLACE = f"lat_deg = {LAT}\nlon_deg = {LON}\n"
FIXED = STATION + CAMERA + POSE
SLOPE = f"[ground]\nslope_deg = {math.degrees(math.atan(0.2))!r}\nuphill_azimuth_deg = 90\n"
TERRAIN = '[ground]\nterrain = "dem.tif"\n'
COV = np.diag([0.25, 0.04, 0.01, 1e-4, 1e-4, 4e-6]) + np.outer(*2 * [[0.3, 0, 0.05, 0, 0.01, 0]])


def east_of(metres):
    lon, lat, _ = Geod(ellps="WGS84").fwd(LON, LAT, 90.0, metres)
    return f"lat_deg = {lat!r}\nlon_deg = {lon!r}\n"


def parsed(text, folder=Path()):
    return parse_station(text.encode(), where="x.toml", folder=folder)


def reread(station):
    return parse_station(resolved_toml(station).encode(), where="resolved", folder=Path("/nowhere"))


def rows(cov):
    return f"covariance = {np.asarray(cov).tolist()}\n"


def heights(station, *east_north):
    return station.pipeline.ground.height_at(np.array(east_north))


@pytest.fixture
def dem(tmp_path, write_dem):
    """A 20 % slope to the east that is 410 m high at the station; a hole 100 to 150 m north of it."""

    def height_of(east, north):
        return np.where((north > 100) & (north < 150), np.nan, 410.0 + 0.2 * east + 0.0 * north)

    return write_dem(tmp_path / "dem.tif", height_of, LAT, LON)


def test_a_slope_passes_below_the_camera_or_the_origin():
    for text in (FLIGHT, FIXED):
        station = parsed(text + SLOPE)
        assert_allclose(heights(station, [0, 0], [10, 0], [10, 50]), [0, 2, 2], atol=1e-12)
    sample = parsed(FIXED + SLOPE).pipeline.fixed_pose
    assert_allclose(sample.pose.position_enu_m, [0, 0, 8], atol=1e-9)
    apart = parsed(STATION + ORIGIN + CAMERA + POSE + east_of(50.0) + SLOPE)
    assert_allclose(apart.pipeline.fixed_pose.pose.position_enu_m, [50, 0, 8], atol=5e-3)
    assert_allclose(heights(apart, [0, 0]), [-10], atol=1e-3)


def test_a_slope_may_pass_through_a_point_on_the_map():
    point = "point = { " + east_of(100.0).replace("\n", ", ", 1).strip() + " }\n"
    flight = parsed(PLACED + SLOPE + point)
    assert_allclose(heights(flight, [0, 0], [100, 7]), [-20, 0], atol=2e-3)
    fixed = parsed(FIXED + PLACE + SLOPE + point)
    assert_allclose(fixed.pipeline.fixed_pose.pose.position_enu_m, [0, 0, 8 - 20], atol=2e-3)
    assert_allclose(heights(reread(flight), [3, 4]), heights(flight, [3, 4]), atol=0)


def test_errors_in_east_and_north_raise_a_camera_along_its_slope():
    std = "std = { height_m = 0.3, horizontal_m = 2.0 }\n"
    cov = parsed(FIXED + std + SLOPE).pipeline.fixed_pose.pose.cov[:3, :3]
    draws = np.random.default_rng(1).normal(size=(200_000, 3)) * [2.0, 2.0, 0.3]
    draws[:, 2] += 0.2 * draws[:, 0]
    assert_allclose(cov, np.cov(draws.T), atol=0.05)


def test_terrain_lies_in_the_stations_axes(dem, tmp_path):
    station = parsed(PLACED + TERRAIN, tmp_path)
    assert isinstance(station.pipeline.ground, Terrain)
    assert station.pipeline.ground.refraction == STANDARD_REFRACTION
    assert_allclose(heights(station, [0, 0], [100, 50]), [10, 30], atol=0.01)
    unknown = parsed(PLACED.replace(", alt_msl_m = 400.0", "") + TERRAIN, tmp_path)
    assert_allclose(heights(unknown, [0, 0], [100, 50]), [0, 20], atol=0.01)
    assert station.ground.sha256 == hashlib.sha256(dem.read_bytes()).hexdigest()


def test_a_fixed_camera_hangs_above_the_terrain_below_it(dem, tmp_path):  # noqa: ARG001 - it is written
    alone = parsed(FIXED + PLACE + "alt_msl_m = 419.0\n" + TERRAIN, tmp_path)
    origin_msl_m = alone.pipeline.fixed_pose.origin.alt_msl_m
    assert alone.pipeline.fixed_pose.pose.position_enu_m[2] + origin_msl_m == pytest.approx(410.0 + 8.0, abs=0.01)
    apart = parsed(STATION + ORIGIN + CAMERA + POSE + east_of(50.0) + TERRAIN, tmp_path)
    assert_allclose(apart.pipeline.fixed_pose.pose.position_enu_m, [50, 0, 10 + 10 + 8], atol=0.01)


def test_every_key_of_the_terrain_reaches_the_elevation_model(dem, tmp_path):
    more = "radius_m = 200\ncell_m = 20\nfill_msl_m = 405\nrefraction = 0.2\nband = 1\n"
    station = parsed(PLACED + TERRAIN + more, tmp_path)
    grid = station.pipeline.ground.grid
    assert (grid.cell_m, grid.east_m, station.pipeline.ground.refraction) == (20.0, -200.0, 0.2)
    assert_allclose(heights(station, [0, 120]), [5], atol=0.01)
    with pytest.raises(InputError, match="no such band: got 2, expected 1 to 1"):
        parsed(PLACED + TERRAIN + "band = 2\n", tmp_path)
    assert dem.is_file()


def test_a_resolved_station_finds_its_terrain_and_says_which_it_was(dem, tmp_path):
    station = parsed(PLACED + TERRAIN, tmp_path)
    again = reread(station)
    assert resolved_toml(again) == resolved_toml(station)
    assert again.pipeline.config_id == station.pipeline.config_id
    assert_array_equal(again.pipeline.ground.grid.heights_m, station.pipeline.ground.grid.heights_m)
    document = station_document(station)["ground"]
    assert document["terrain"] == str(dem)
    assert (document["radius_m"], document["refraction"], document["band"]) == (2000.0, 0.13, 1)
    assert station_document(station, "terrain.tif")["ground"]["terrain"] == "terrain.tif"


def test_the_id_follows_the_bytes_of_the_terrain_and_not_their_place(dem, tmp_path):
    station = parsed(PLACED + TERRAIN, tmp_path)
    moved = dem.rename(tmp_path / "moved.tif")
    elsewhere = parsed(PLACED + TERRAIN.replace("dem.tif", "moved.tif"), tmp_path)
    assert elsewhere.pipeline.config_id == station.pipeline.config_id
    with moved.open("ab") as file:
        file.write(b"\0")
    others = [
        parsed(PLACED + TERRAIN.replace("dem.tif", "moved.tif"), tmp_path),
        with_derived_settings(replace(station, ground=None)),
        parsed(PLACED + SLOPE),
        parsed(PLACED + SLOPE.replace("90", "91")),
    ]
    assert len({each.pipeline.config_id for each in (station, *others)}) == 5


def test_another_or_a_missing_file_is_refused(dem, tmp_path):
    text = resolved_toml(parsed(PLACED + TERRAIN, tmp_path)).encode()
    digest = hashlib.sha256(dem.read_bytes()).hexdigest()
    with dem.open("ab") as file:
        file.write(b"\0")
    other = hashlib.sha256(dem.read_bytes()).hexdigest()
    with pytest.raises(ConfigError) as caught:
        parse_station(text, where="config.toml", folder=tmp_path)
    assert str(caught.value) == (
        f"config.toml: ground.terrain: got a TIFF image with sha256 {other} at {dem}, expected the elevation model "
        f"with sha256 {digest}; put the original there, or leave ground.sha256 out to compute with this one"
    )
    dem.unlink()
    with pytest.raises(ConfigError) as caught:
        parse_station(text, where="config.toml", folder=tmp_path)
    assert str(caught.value) == (
        f"config.toml: ground.terrain: got nothing at {dem}, expected the elevation model with sha256 {digest}; "
        "put it there, or say where it is"
    )


def test_a_terrain_is_laid_out_once(dem, tmp_path):
    station = parsed(PLACED + TERRAIN, tmp_path)
    dem.unlink()
    again = with_derived_settings(replace(station, images=replace(station.images, time_offset_s=0.5)))
    assert again.pipeline.ground is station.pipeline.ground


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            FLIGHT + TERRAIN,
            "x.toml: ground.terrain: got no place on the map for the station, expected station.origin =",
        ),
        (FIXED + TERRAIN, "ground.terrain: got no place on the map for the station, expected pose.lat_deg and pose.lo"),
        (
            FLIGHT + SLOPE + "point = { lat_deg = 1, lon_deg = 2 }\n",
            "x.toml: ground.point: got no place on the map for the station, expected station.origin = { lat_deg, lon",
        ),
        (
            (FIXED + PLACE + TERRAIN).replace("heading_deg = 0\n", ""),
            "x.toml: pose.heading_deg: got nothing, expected degrees from north, because the ground is laid out on",
        ),
        (
            PLACED.replace("[camera]", '[camera]\nmodel = "dft"') + SLOPE,
            'ground: it stands beside camera.model = "dft"',
        ),
        (PLACED + "[ground]\n", "x.toml: ground: got neither of them, expected either slope_deg with uphill_azimuth"),
        (
            PLACED + SLOPE + 'terrain = "dem.tif"\n',
            "ground.uphill_azimuth_deg: it stands beside terrain, expected",
        ),
        (PLACED + "[ground]\nslope_deg = 5\n", "ground.uphill_azimuth_deg: got nothing, expected where the ground r"),
        (PLACED + SLOPE + "cell_m = 5\n", "x.toml: ground.cell_m: it stands beside slope_deg, expected one of the two"),
        (
            PLACED + TERRAIN + "uphill_azimuth_deg = 5\n",
            "ground.uphill_azimuth_deg: it stands beside terrain, expected",
        ),
        (PLACED + "[ground]\nslope_deg = 90\nuphill_azimuth_deg = 0\n", "slope_deg: got 90, expected less than 90"),
        (PLACED + "[ground]\nslope = 9\n", "x.toml: ground.slope: unknown key; did you mean slope_deg?"),
        (PLACED + TERRAIN + "refraction = 1.0\n", "x.toml: ground.refraction: got 1.0, expected less than 1"),
        (PLACED + TERRAIN + "cell_m = 3000\n", "x.toml: ground.cell_m: got 3000, expected at most radius_m, 2000"),
        (PLACED + TERRAIN + "radius_m = 0\n", "x.toml: ground.radius_m: got 0, expected more than 0"),
        (PLACED + TERRAIN + 'sha256 = "12"\n', 'ground.sha256: got "12", expected 64 hexadecimal digits'),
        (PLACED + TERRAIN.replace("dem", "none"), "none.tif, expected a GeoTIFF elevation model; check the path"),
        (PLACED + TERRAIN.replace("dem.tif", ""), 'x.toml: ground.terrain: got "", expected text in quotes, not em'),
        (STATION + ORIGIN + CAMERA + POSE + east_of(5e5) + TERRAIN, "below the pose: got no more elevation model, exp"),
        (FIXED + PLACE.replace("47.5", "47.50112") + TERRAIN, "no height at the station: got nodata, expected the gr"),
        (
            STATION + ORIGIN + CAMERA + POSE + PLACE.replace("47.5", "47.50112") + TERRAIN,
            "x.toml: below the pose: got a hole in the elevation model, expected ground; check the position, or set f",
        ),
        (PLACED.replace("47.5", "12.5") + TERRAIN, "dem.tif: does not cover the station: got latitudes 47.49"),
    ],
)
def test_wrong_ground_is_refused_in_one_sentence(dem, text, sentence):
    with pytest.raises(InputError) as caught:
        parsed(text, dem.parent)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_calibration_moves_a_camera_over_its_slope(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text("[pose]\nheight_agl_m = 9\ntilt_deg = 61\n" + PLACE)
    station = with_calibration(parsed(STATION + ORIGIN + CAMERA + POSE + east_of(50.0) + SLOPE), path)
    assert_allclose(station.pipeline.fixed_pose.pose.position_enu_m, [0, 0, 9], atol=1e-9)
    path.write_text("[pose]\nheight_agl_m = 9\ntilt_deg = 61\n")
    point = "point = { lat_deg = 47.5, lon_deg = 9.2 }\n"
    with pytest.raises(ConfigError, match=r"c\.toml: ground\.point: got no place on the map .* pose\.lat_deg"):
        with_calibration(parsed(FIXED + PLACE + SLOPE + point), path)


def test_a_full_covariance_is_taken_as_it_is():
    station = parsed(FIXED + rows(COV))
    sample = station.pipeline.fixed_pose
    assert_array_equal(sample.pose.cov, COV)
    assert_allclose(sample.std.height_agl_m, math.sqrt(0.0125))
    assert_allclose([sample.std.tilt_rad, sample.std.pan_rad, sample.std.roll_rad], [1e-2, math.sqrt(2e-4), 2e-3])
    assert sample.std.heading_rad == 0.0
    again = reread(station)
    assert again.fixed_pose == station.fixed_pose
    assert again.pipeline.config_id == station.pipeline.config_id != parsed(FIXED).pipeline.config_id
    assert_array_equal(parsed(FIXED + rows(COV) + SLOPE).pipeline.fixed_pose.pose.cov, COV)
    assert_array_equal(parsed(FIXED + rows(np.zeros((6, 6)))).pipeline.fixed_pose.pose.cov, np.zeros((6, 6)))


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        (
            rows(COV) + "std = { tilt_deg = 1 }\n",
            "x.toml: pose.std: it stands beside covariance, expected one of the two",
        ),
        (rows(COV[:5]), "x.toml: pose.covariance: got 5 rows, expected 6 rows of 6 numbers (east, north, up, then rot"),
        (rows(COV - 0.02 * np.eye(6)), "x.toml: pose.covariance: got [2][2] = -0.0075"),
        (rows(COV + np.outer(*2 * [[0, 1, 0, 0, 0, 0]]) @ np.ones((6, 6))), "got [0][1] = "),
        ("covariance = [[nan]]\n", "x.toml: pose.covariance[0][0]: got nan, expected a finite number"),
        ("covariance = 3\n", "x.toml: pose.covariance: got 3, expected a list"),
    ],
)
def test_a_wrong_covariance_is_refused_in_one_sentence(keys, sentence):
    with pytest.raises(ConfigError) as caught:
        parsed(FIXED + keys)
    assert sentence in str(caught.value)


POLE = '[[probe]]\nname = "pole"\nkind = "height"\npixels = [[50, 40], [50, 20]]\n'
LINE = '[[probe]]\nname = "line"\nkind = "width"\npixels = [[40, 21], [60, 21]]\non_top_of = "pole"\n'


def test_a_probe_on_top_of_an_object():
    station = parsed(FIXED + LINE + POLE + '[[probe]]\nname = "way"\nkind = "bearing"\npixels = [[50, 40]]\n')
    line, pole, way = station.pipeline.probes
    assert (line.on_top_of, pole.on_top_of, way.kind) == ("pole", None, ProbeKind.BEARING)
    assert reread(station).pipeline.probes == station.pipeline.probes
    flat = parsed(FIXED + LINE.replace('on_top_of = "pole"', "") + POLE)
    assert flat.pipeline.config_id != station.pipeline.config_id


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            LINE,
            'probe[0].on_top_of: lies on no object: got "pole", which is not there, expected a height on the',
        ),
        (
            POLE.replace("height", "width") + LINE,
            'x.toml: probe[1].on_top_of: lies on no object: got "pole", which me',
        ),
        (
            '[[probe]]\nname = "pole"\nkind = "height"\nobserved = true\n' + LINE,
            'got "pole", of which the pixels are observed, expected a height on the ground with pixels of its own',
        ),
        (
            POLE + LINE.replace('"line"', '"two"').replace("width", "height") + LINE.replace('"pole"', '"two"'),
            'probe[2].on_top_of: lies on no object: got "two", which lies on top of "pole", expected a height',
        ),
        (POLE + 'on_top_of = "pole"\n', 'lies on no object: got "pole", which lies on top of "pole"'),
        (
            POLE + LINE + "elevation_m = 1\n",
            "x.toml: probe[1].elevation_m: it stands beside on_top_of, expected one of t",
        ),
        (
            POLE + LINE + "elevation_std_m = 1\n",
            "probe[1].elevation_std_m: it stands beside on_top_of, expected one of",
        ),
    ],
)
def test_nothing_lies_on_top_of_what_is_no_object(text, sentence):
    with pytest.raises(ConfigError) as caught:
        parsed(FIXED + text)
    assert sentence in str(caught.value)


def test_an_older_configuration_reads_as_before():
    document = station_document(parsed(FIXED + POLE))
    assert "ground" not in document
    assert "covariance" not in document["pose"]
    assert "covariance" not in document["camera"]
    assert "distortion_std" not in document["camera"]
    assert "on_top_of" not in document["probe"][0]
    assert tomli_w.dumps(document) == resolved_toml(reread(parsed(FIXED + POLE)))
