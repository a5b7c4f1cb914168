"""``[markers]`` of a station: their places from its origin, wherever they were surveyed, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from aerodft.adapters.config.station import load_station, parse_station, resolved_toml
from aerodft.errors import ConfigError

LAT_DEG, LON_DEG, ALT_M = 52.0, 5.0, 12.0
ORIGIN = f"origin = {{ lat_deg = {LAT_DEG}, lon_deg = {LON_DEG}, alt_msl_m = {ALT_M} }}"
CAMERA = '[camera]\nname = "c"\nwidth_px = 640\nheight_px = 480\nhfov_deg = 60\n'
MILLIMETRE = 0.001
INLINE = """
dictionary = "4x4_50"
side_m = 0.5
[[markers.marker]]
id = 3
position_m = [10.0, 20.0, 0.5]
std_m = 0.02
[[markers.marker]]
id = 5
corners_m = [[0, 1, 0], [0.5, 1, 0], [0.5, 0.5, 0], [0, 0.5, 0]]
"""


def station(markers, *, origin=ORIGIN, more="[telemetry]\n", folder, camera=CAMERA):
    text = f'[station]\nname = "s"\n{origin}\n{camera}{more}[markers]\n{markers}'
    return parse_station(text.encode(), where="s.toml", folder=folder)


def surveyed_file(folder, text):
    (folder / "yard.toml").write_text('dictionary = "4x4_50"\n' + text)
    return 'file = "yard.toml"'


def test_every_surveyed_point_is_a_landmark_of_its_name(tmp_path):
    found = station(INLINE, folder=tmp_path)
    by_name = {each.name: each for each in found.live.landmarks}
    assert list(by_name) == ["marker-3", *(f"marker-5-corner-{n}" for n in (1, 2, 3, 4))]
    assert by_name["marker-3"].position_enu_m == (10.0, 20.0, 0.5)
    assert by_name["marker-3"].std_m == (0.02, 0.02, 0.02)
    assert by_name["marker-5-corner-3"].position_enu_m == (0.5, 0.5, 0.0)
    assert {each.side_m for each in found.markers.survey.markers} == {0.5}


def test_a_file_says_the_same_as_its_text_in_the_station(tmp_path):
    text = INLINE.replace("markers.marker", "marker").replace('dictionary = "4x4_50"\n', "")
    beside, within = station(surveyed_file(tmp_path, text), folder=tmp_path), station(INLINE, folder=tmp_path)
    assert beside.live == within.live
    assert beside.markers == within.markers
    assert beside.pipeline.config_id == within.pipeline.config_id


def by_proj(lat_deg, lon_deg, alt_m):
    """Metres from the station's origin, by PROJ."""
    flat = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84"
        f" +step +proj=topocentric +ellps=WGS84 +lat_0={LAT_DEG} +lon_0={LON_DEG} +h_0={ALT_M}"
    )
    east, north, _ = flat.transform(lon_deg, lat_deg, ALT_M)
    return east, north, alt_m - ALT_M


@given(north=st.floats(-0.002, 0.002), east=st.floats(-0.002, 0.002), alt_m=st.floats(0, 40), zone=st.booleans())
def test_places_on_the_map_are_counted_from_the_origin(tmp_path_factory, north, east, alt_m, zone):
    folder = tmp_path_factory.mktemp("yard")
    lat, lon = LAT_DEG + north, LON_DEG + east
    if zone:
        x, y = Transformer.from_crs("EPSG:4326", "EPSG:32631", always_xy=True).transform(lon, lat)
        text = f'crs = "EPSG:32631"\n[[marker]]\nid = 1\nposition_m = [{x!r}, {y!r}, {alt_m!r}]\n'
    else:
        text = f'crs = "geo"\n[[marker]]\nid = 1\nlat_deg = {lat!r}\nlon_deg = {lon!r}\nalt_m = {alt_m!r}\n'
    (landmark,) = station(surveyed_file(folder, text), folder=folder).live.landmarks
    np.testing.assert_allclose(landmark.position_enu_m, by_proj(lat, lon, alt_m), atol=MILLIMETRE)


def test_local_heights_count_from_the_stated_ground(tmp_path):
    text = "elevation_m = 3.0\n[[marker]]\nid = 1\nposition_m = [10, 20, 3.5]\n"
    (landmark,) = station(surveyed_file(tmp_path, text), folder=tmp_path).live.landmarks
    assert landmark.position_enu_m == (10.0, 20.0, 0.5)


@pytest.mark.parametrize("more", ["", "every_s = 0.5\nignore = [17, 2]\n"])
def test_the_resolved_text_gives_the_same_markers_again(tmp_path, more):
    lone = '[[landmark]]\nname = "gauge"\nposition_m = [1.0, 2.0, 3.0]\n'
    first = station(more + INLINE, more=f"[telemetry]\n{lone}", folder=tmp_path)
    text = resolved_toml(first)
    again = parse_station(text.encode(), where="resolved", folder=tmp_path / "elsewhere")
    assert again.markers == first.markers
    assert again.live == first.live
    assert again.pipeline.config_id == first.pipeline.config_id
    assert resolved_toml(again) == text


def test_how_often_somebody_looks_is_no_part_of_what_numbers_depend_on(tmp_path):
    ids = {station(f"every_s = {s}\n{INLINE}", folder=tmp_path).pipeline.config_id for s in (0, 1.0)}
    moved = station(INLINE.replace("20.0", "20.001"), folder=tmp_path).pipeline.config_id
    assert len(ids) == 1
    assert moved not in ids


FIXED = "[pose]\nheight_agl_m = 5\ntilt_deg = 60\n"
TWICE = '[telemetry]\n[[landmark]]\nname = "marker-3"\nposition_m = [1.0, 2.0, 3.0]\n'


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"origin": ""}, ["station.origin", "[markers]"]),
        ({"more": FIXED}, ["markers", "[pose]", "[telemetry]"]),
        ({"more": TWICE}, ["landmark[0].name", '"marker-3"']),
        ({"camera": CAMERA + 'model = "dft"\n'}, ["markers", "pinhole"]),
        ({"markers": INLINE.replace("id = 5", "id = 3")}, ["marker[1].id", "3", "marker[0]"]),
        ({"markers": INLINE.replace("id = 5", "id = 50")}, ["marker[1].id", "0 to 49"]),
        ({"markers": INLINE.replace("4x4_50", "4x4_51")}, ["dictionary", "4x4_50"]),
        (
            {"markers": INLINE.replace("[10.0, 20.0", "[1.5e5, 4e5").split("[[markers.marker]]\nid = 5")[0]},
            ["marker 3", "427 km", "station.origin"],
        ),
        ({"markers": "every_s = -1\n" + INLINE}, ["markers.every_s", "at least 0"]),
        ({"markers": 'file = "yard.toml"\nevery = 1'}, ["markers.every", "every_s"]),
        ({"markers": 'file = "yard.toml"'}, ["yard.toml", "no such file"]),
        ({"markers": 'dictionary = "4x4_50"'}, ["[markers]", "marker", "nothing"]),
    ],
)
def test_what_cannot_be_is_said(tmp_path, changes, words):
    with pytest.raises(ConfigError) as refused:
        station(**{"markers": INLINE, "folder": tmp_path, **changes})
    for word in words:
        assert word in str(refused.value)


def test_heights_on_the_map_need_the_origins(tmp_path):
    file = surveyed_file(tmp_path, 'crs = "geo"\n[[marker]]\nid = 1\nlat_deg = 52.0\nlon_deg = 5.0\nalt_m = 13.0\n')
    with pytest.raises(ConfigError, match=r"station\.origin\.alt_msl_m"):
        station(file, origin=f"origin = {{ lat_deg = {LAT_DEG}, lon_deg = {LON_DEG} }}", folder=tmp_path)


def test_the_file_is_beside_the_station(tmp_path):
    (tmp_path / "deep").mkdir()
    surveyed_file(tmp_path / "deep", "[[marker]]\nid = 1\nposition_m = [1, 2, 0]\n")
    (tmp_path / "deep" / "s.toml").write_text(
        f'[station]\nname = "s"\n{ORIGIN}\n{CAMERA}[telemetry]\n[markers]\nfile = "yard.toml"\n'
    )
    found = load_station(tmp_path / "deep" / "s.toml")
    assert math.dist(found.live.landmarks[0].position_enu_m, (1, 2, 0)) == 0
