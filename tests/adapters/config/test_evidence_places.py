"""Surveys that people published, and places all over the earth, against PROJ: read, brought to metres, and back."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pyproj import CRS, Geod, Proj, Transformer

from aerodft.adapters.config.evidence import LocalFrame, load_evidence
from aerodft.geometry import east_north
from aerodft.model import GeoOrigin

SURVEYS = Path(__file__).parents[4] / "shared" / "data" / "landmarks"
MICROMETRE = 1e-6


def juncal():
    """Gauss-Krueger, Argentina 4; a river and its banks."""
    given = json.loads((SURVEYS / "juncal" / "full_grp_3d.json").read_text())
    return "EPSG:5346", np.stack([given[key] for key in "xy"], -1), np.stack([given[key] for key in "XYZ"], -1)


def geul():
    """RD New, heights of a receiver."""
    given = json.loads((SURVEYS / "geul" / "dk_cam_config.json").read_text())["gcps"]
    return "EPSG:28992", np.array(given["src"], dtype=float), np.array(given["dst"])


def cirn_uas():
    """State plane of North Carolina; a beach."""
    folder = SURVEYS / "cirn_uas"
    points = np.loadtxt(folder / "uasDemoFlight_NCSP_GCPS.txt", delimiter=",")
    seen = scipy.io.loadmat(folder / "uasDemo_gcpUVdInitial.mat", squeeze_me=True)["gcp"]
    by_number = {int(each["num"]): each["UVd"] for each in seen}
    return "EPSG:32119", np.array([by_number[int(row[0])] for row in points]), points[:, 1:]


def read(survey):
    if not SURVEYS.is_dir():
        pytest.skip(f"no surveys at {SURVEYS}")
    return survey()


def as_toml(crs, pixels, places):
    rows = [
        f"[[landmark]]\npixel = {pixel.tolist()}\nposition_m = {place.tolist()}\n"
        for pixel, place in zip(pixels, places, strict=True)
    ]
    return f'crs = "{crs}"\n' + "".join(rows)


def as_csv(pixels, places):
    rows = np.hstack([pixels, places]).tolist()
    return "u,v,X,Y,Z\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)


def positions(found):
    return np.array([each.position_m for each in found.known.evidence])


@pytest.mark.parametrize("survey", [juncal, geul, cirn_uas])
def test_surveys_are_read_to_the_micrometre(tmp_path, survey):
    crs, pixels, places = read(survey)
    toml, table = tmp_path / "x.toml", tmp_path / "x.csv"
    toml.write_text(as_toml(crs, pixels, places))
    table.write_text(as_csv(pixels, places))
    for found in (load_evidence(toml), load_evidence(table, crs)):
        assert [each.pixel for each in found.known.evidence] == [tuple(pixel) for pixel in pixels.tolist()]
        local_m = positions(found)
        assert_allclose(found.frame.file_coordinates(local_m), places, rtol=0, atol=MICROMETRE)
        assert np.abs(local_m[:, :2]).max() < 250
        assert found.frame.origin[2] == np.median(places[:, 2])
        lat_lon = np.array(Transformer.from_crs(crs, "EPSG:4326").transform(*in_axis_order(crs, places[:, :2])))
        said = found.frame.wgs84(local_m)
        assert_allclose(np.degrees(said[:, :2]), lat_lon.T, rtol=0, atol=1e-11)
        assert_allclose(said[:, 2], places[:, 2], atol=MICROMETRE)


@pytest.mark.parametrize("survey", [juncal, geul, cirn_uas])
def test_distances_on_the_ground_are_those_of_the_geodesic(survey):
    """A local metre is a metre at the landmarks' height, not one of the map: RD New and UTM stretch, and sea is low."""
    crs, _, places = read(survey)
    frame = LocalFrame(crs, tuple(places.mean(axis=0).tolist()))
    level = places.copy()
    level[:, 2] = frame.origin[2]
    local_m = frame.local_m(level)
    datum = CRS(crs).geodetic_crs
    to_lon_lat = Transformer.from_crs(crs, datum, always_xy=True)
    lon, lat = to_lon_lat.transform(level[:, 0], level[:, 1])
    _, _, sea_m = (
        CRS(crs).get_geod().inv(np.full(len(lon) - 1, lon[0]), np.full(len(lat) - 1, lat[0]), lon[1:], lat[1:])
    )
    raised_m = np.array(sea_m) * (1 + frame.origin[2] / 6.371e6)
    assert_allclose(np.linalg.norm(local_m[1:] - local_m[0], axis=-1), raised_m, rtol=1e-6)


def in_axis_order(crs, xy):
    """Easting and northing in the order of the register's axes."""
    return xy.T if CRS(crs).axis_info[0].direction == "east" else xy.T[::-1]


@pytest.mark.parametrize(
    ("crs", "origin"),
    [
        ("EPSG:28992", (192100.0, 313158.0, 138.5)),
        ("EPSG:5346", (4355888.0, 6520302.0, 647.0)),
        ("EPSG:32119", (901900.0, 274650.0, 7.0)),
        ("EPSG:25832", (399000.0, 5650000.0, 40.0)),
        ("EPSG:27572", (600000.0, 2200000.0, 100.0)),
        ("EPSG:7415", (192100.0, 313158.0, 138.5)),
        ("EPSG:3857", (650000.0, 6800000.0, 0.0)),
    ],
)
def test_north_is_the_grids_and_headings_turn_by_its_convergence(crs, origin):
    horizontal = CRS(crs).sub_crs_list[0] if CRS(crs).is_compound else CRS(crs)
    frame = LocalFrame(crs, origin)
    along = frame.local_m(np.array(origin) + [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert_allclose(along[0, 0], 0, atol=MICROMETRE)
    assert_allclose(along[1, 1], 0, atol=10 * MICROMETRE)
    to_lon_lat, (x, y, up) = Proj(horizontal), origin
    (west, east, south, north), lats = to_lon_lat([x, x + 100, x, x], [y, y, y - 1, y + 1], inverse=True)
    azimuth, _, _ = horizontal.get_geod().inv(south, lats[2], north, lats[3])
    turned = (frame.true_heading_rad(0.0) + math.pi) % (2 * math.pi) - math.pi
    assert math.degrees(turned) == pytest.approx(azimuth, abs=1e-5)
    _, _, sea_m = horizontal.get_geod().inv(west, lats[0], east, lats[1])
    ground_m = sea_m * (1 + up / 6.37e6)
    assert np.linalg.norm(frame.local_m(np.array(origin) + [100.0, 0, 0])) == pytest.approx(ground_m, rel=1e-6)


LAT, LON, ALT = 47.0667, 15.4333, 350.0


def geo_rows(lat, lon, alt):
    places = zip(lat, lon, alt, strict=True)
    return "".join(
        f"[[landmark]]\npixel = [{index}, 2]\nlat_deg = {la!r}\nlon_deg = {lo!r}\nalt_m = {al!r}\n"
        for index, (la, lo, al) in enumerate(places)
    )


def test_degrees_become_metres_of_true_north(tmp_path):
    azimuths, away = [0.0, 90.0, 200.0], [100.0, 50.0, 80.0]
    lon, lat, _ = Geod(ellps="WGS84").fwd([LON] * 3, [LAT] * 3, azimuths, away)
    path = tmp_path / "x.toml"
    camera = f"[camera]\nlat_deg = {LAT}\nlon_deg = {LON}\nalt_m = {ALT + 8}\nposition_std_m = [0.5, 0.5, 1.0]\n"
    text = f'crs = "geo"\nelevation_m = {ALT}\n{camera}' + geo_rows(lat, lon, [ALT] * 3)
    path.write_text(text)
    found = load_evidence(path)
    priors = found.known.priors
    foot = np.array([priors["east"].value, priors["north"].value])
    want = np.stack([np.sin(np.radians(azimuths)), np.cos(np.radians(azimuths))], -1) * np.array(away)[:, None]
    assert_allclose(positions(found)[:, :2] - foot, want * (1 + ALT / 6.37e6), atol=1e-3)
    assert_allclose(positions(found)[:, 2], 0, atol=2e-3)
    assert priors["height"].value == pytest.approx(8.0, abs=1e-3)
    assert [priors[name].std for name in ("east", "north", "height")] == [0.5, 0.5, 1.0]
    assert found.fixed == {"elevation"}
    origin = found.frame.geo_origin
    assert_allclose(positions(found)[:, :2], east_north(origin, np.radians(lat), np.radians(lon)), atol=MICROMETRE)
    assert found.frame.true_heading_rad(-0.5) == pytest.approx(2 * math.pi - 0.5)


def test_one_scene_is_one_scene_in_degrees_and_in_a_projection(tmp_path):
    """UTM 33 beside WGS84: the same distances, and turned by the convergence."""
    crs, _, xyz = "EPSG:32633", None, np.array([[533000, 5213000, 350], [533080, 5213060, 352], [532950, 5213090, 349]])
    lon, lat = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(*xyz[:, :2].T.tolist())
    grid, geo, table = tmp_path / "grid.toml", tmp_path / "geo.toml", tmp_path / "geo.csv"
    grid.write_text(as_toml(crs, np.arange(6.0).reshape(3, 2), xyz))
    geo.write_text('crs = "geo"\n' + geo_rows(lat, lon, xyz[:, 2].tolist()))
    rows = [
        f"{index};2;{la!r};{lo!r};{al}\n" for index, (la, lo, al) in enumerate(zip(lat, lon, xyz[:, 2], strict=True))
    ]
    table.write_text("u;v;lat;lon;alt\n" + "".join(rows))
    by_grid, by_geo = load_evidence(grid), load_evidence(geo)
    turn = by_grid.frame.true_heading_rad(0.0)
    around = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    one, other = (positions(found)[:, :2] - positions(found)[0, :2] for found in (by_grid, by_geo))
    assert_allclose(one @ around.T, other, atol=1e-5)
    assert_allclose(positions(load_evidence(table)), positions(by_geo), atol=0)


def test_an_unknown_component_stays_unknown(tmp_path):
    path = tmp_path / "x.toml"
    path.write_text(
        'crs = "EPSG:28992"\n'
        '[[landmark]]\npixel = [1, 2]\nposition_m = [192100, 313150, "?"]\n'
        '[[landmark]]\npixel = [2, 2]\nposition_m = [192180, "?", 140]\n'
        '[[landmark]]\npixel = [3, 2]\nposition_m = ["?", 313170, 138]\n'
    )
    found = load_evidence(path)
    got = [each.position_m for each in found.known.evidence]
    assert found.frame.origin == (192140.0, 313160.0, 139.0)
    assert [each.index(None) for each in got] == [2, 1, 0]
    known = LocalFrame("EPSG:28992", found.frame.origin).local_m([192180, 313160, 140])
    assert got[1][0] == pytest.approx(known[0])
    path.write_text('crs = "geo"\n' + geo_rows([47.0, 47.001], [15.0, 15.001], [1.0, 2.0]).replace("2.0", '"?"'))
    assert load_evidence(path).known.evidence[1].position_m[2] is None
    path.write_text('crs = "geo"\n' + geo_rows([47.0, 47.001], [15.0, 15.001], [1.0, 2.0]).replace("15.001", '"?"'))
    east, north, _ = load_evidence(path).known.evidence[1].position_m
    assert east is None
    assert north == pytest.approx(111.17 / 2, abs=0.6)


def test_a_scene_may_lie_across_the_date_line(tmp_path):
    path = tmp_path / "x.toml"
    path.write_text('crs = "geo"\n' + geo_rows([-16.8, -16.8], [179.9999, -179.9999], [1.0, 1.0]))
    found = load_evidence(path)
    assert np.linalg.norm(np.diff(positions(found), axis=0)) == pytest.approx(21.3, abs=0.1)
    assert_allclose(np.abs(found.frame.origin[1]), 180, atol=1e-3)


def test_large_local_coordinates_are_brought_near(tmp_path):
    places = np.array([[4355888.71, 6520302.75, 7.66], [4355894.3, 6520304.63, 7.75]])
    path = tmp_path / "x.toml"
    path.write_text(
        as_toml("local", np.array([[1, 2], [3, 4]]), places) + "[camera]\nposition_m = [4355890, 6520300]\n"
    )
    found = load_evidence(path)
    assert found.frame.origin == (4355892.0, 6520304.0, 7.705)
    assert_allclose(found.frame.file_coordinates(positions(found)), places, rtol=0, atol=1e-9)
    assert (found.known.priors["east"].value, found.known.priors["north"].value) == (-2.0, -4.0)


@given(
    lat=st.floats(-85, 85),
    lon=st.floats(-180, 180),
    alt=st.floats(-400, 4000),
    enu=st.tuples(*[st.floats(-3000, 3000)] * 2, st.floats(-500, 500)),
)
def test_there_and_back_anywhere_on_the_earth(lat, lon, alt, enu):
    frame = LocalFrame("geo", (lat, lon, alt))
    assert_allclose(frame.local_m(frame.file_coordinates(enu)), enu, rtol=0, atol=MICROMETRE)
    assert_allclose(frame.local_m([lat, lon, alt]), [0, 0, 0], rtol=0, atol=MICROMETRE)


def test_only_the_cameras_place_is_enough_for_a_frame(tmp_path):
    path = tmp_path / "x.toml"
    text = (
        'crs = "EPSG:28992"\n[camera]\nposition_m = [192100, 313150]\nheight_agl_m = 5\n'
        "[[range]]\npixel = [1, 2]\nrange_m = 3\n"
    )
    path.write_text(text)
    found = load_evidence(path)
    assert found.frame.origin == (192100.0, 313150.0, 0.0)
    assert found.known.priors["height"].value == 5.0
    assert_allclose([found.known.priors["east"].value, found.known.priors["north"].value], 0, atol=MICROMETRE)
    assert found.frame.geo_origin.lat_rad == pytest.approx(math.radians(50.807), abs=1e-4)
    assert isinstance(found.frame.geo_origin, GeoOrigin)
