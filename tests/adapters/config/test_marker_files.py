"""Files of surveyed markers: what they say, and what they cannot say."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

from aerodft.adapters.config.evidence import load_markers
from aerodft.errors import ConfigError
from aerodft.model import Landmark, MarkerSighting, Prior

EXAMPLE = Path(__file__).parents[3] / "configs" / "calibration" / "yard-markers.toml"
SQUARE = [[0.0, 5.0, 1.4], [0.4, 5.0, 1.4], [0.4, 5.0, 1.0], [0.0, 5.0, 1.0]]


def written(tmp_path, text):
    path = tmp_path / "markers.toml"
    path.write_text(text)
    return path


def sighting(marker, u=100.0, v=200.0):
    corners = ((u - 9, v - 9), (u + 9, v - 9), (u + 9, v + 9), (u - 9, v + 9))
    return MarkerSighting(id=marker, pixel=(u, v), std_px=0.25, corners=corners, corner_std_px=0.4)


def file(*markers, head='dictionary = "4x4_50"'):
    return "\n".join([head, *(f"[[marker]]\n{each}" for each in markers)])


def test_the_example_says_what_it_explains():
    found = load_markers(EXAMPLE)
    assert found.survey.dictionary == "4X4_50"
    assert found.ignore == {17}
    markers = found.survey.by_id
    assert {marker: len(each.points_m) for marker, each in markers.items()} == {1: 1, 2: 1, 5: 1, 9: 4}
    assert [markers[marker].side_m for marker in (1, 5)] == [0.4, 0.6]
    assert markers[1].points_m == ((12.31, 45.62, 0.02),)
    assert markers[9].std_m == (0.005, 0.005, 0.005)


def test_sightings_become_landmarks_beside_what_else_the_file_knows(tmp_path):
    head = 'dictionary = "4x4_50"\n[camera]\nheight_agl_m = { value = 7.5, std = 0.5 }\n'
    known = head + "[[landmark]]\npixel = [5, 6]\nposition_m = [9, 9, 0]\n"
    text = known + file("id = 3\nposition_m = [1, 2, 0]\nstd_m = 0.01", f"id = 8\ncorners_m = {SQUARE}", head="")
    found = load_markers(written(tmp_path, text)).evidence([sighting(8), sighting(3, 40.0)], (640, 480), "view.png")
    by_name = {each.name: each for each in found.known.evidence}
    assert list(by_name) == ["landmark-1", *(f"marker-8 corner {corner}" for corner in (1, 2, 3, 4)), "marker-3"]
    assert by_name["marker-3"] == Landmark(
        name="marker-3", pixel=(40.0, 200.0), position_m=(1.0, 2.0, 0.0), std_px=0.25, std_m=(0.01, 0.01, 0.01)
    )
    assert by_name["marker-8 corner 3"].pixel == (109.0, 209.0)
    assert by_name["marker-8 corner 3"].position_m == tuple(SQUARE[2])
    assert by_name["marker-8 corner 3"].std_px == 0.4
    assert by_name["marker-8 corner 3"].std_m == (0.005, 0.005, 0.005)
    assert found.known.priors == {"height": Prior(value=7.5, std=0.5)}
    assert (found.image, found.image_size_px) == ("view.png", (640, 480))


def test_places_in_degrees_and_projections_are_the_same_metres(tmp_path):
    to_grid = Transformer.from_crs("EPSG:4326", "EPSG:32633", always_xy=True)
    places = [(15.43, 47.06, 350.0), (15.4304, 47.0603, 351.5)]
    geo = [f"id = {i}\nlat_deg = {lat}\nlon_deg = {lon}\nalt_m = {alt}" for i, (lon, lat, alt) in enumerate(places)]
    grid = [f"id = {i}\nposition_m = {[*to_grid.transform(lon, lat), alt]}" for i, (lon, lat, alt) in enumerate(places)]
    apart = []
    for crs, markers in (("geo", geo), ("EPSG:32633", grid)):
        path = written(tmp_path, file(*markers, head=f'dictionary = "4x4_50"\ncrs = "{crs}"'))
        first, second = (np.array(each.points_m[0]) for each in load_markers(path).survey.markers)
        apart.append(np.linalg.norm(second - first))
    assert apart[0] == pytest.approx(apart[1], abs=1e-4)
    assert apart[0] == pytest.approx(np.hypot(45.1, 1.5), abs=0.3)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("4X4_50", "4X4_50"),
        ("DICT_6X6_250", "6X6_250"),
        ("apriltag_36h11", "APRILTAG_36h11"),
        ("tag36h11", "APRILTAG_36h11"),
        ("AprilTag25h9", "APRILTAG_25h9"),
        ("aruco_original", "ARUCO_ORIGINAL"),
    ],
)
def test_dictionaries_are_known_by_the_names_that_people_use(tmp_path, given, name):
    path = written(tmp_path, file("id = 1\nposition_m = [0, 0, 0]", head=f'dictionary = "{given}"'))
    assert load_markers(path).survey.dictionary == name


ONE = "id = 1\nposition_m = [0, 0, 0]"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (file(ONE, head='dictionary = "4x4_60"'), ["dictionary", '"4x4_60"', "did you mean 4x4_50?"]),
        (file(ONE, head=""), ["dictionary", "got nothing"]),
        ('dictionary = "4x4_50"', ["marker", "got nothing"]),
        ('dictionary = "4x4_50"\nmarker = []', ["marker", "[[marker]]"]),
        (file(ONE, "id = 50\nposition_m = [1, 0, 0]"), ["marker[1].id", "got 50", "0 to 49"]),
        (file("id = -1\nposition_m = [1, 0, 0]"), ["marker[0].id", "at least 0"]),
        (file(ONE, "id = 1\nposition_m = [1, 0, 0]"), ["marker[1].id", "marker[0]"]),
        (file(ONE, "id = 2\nposition_m = [0, 0, 0]"), ["marker[1]: place", "marker[0]"]),
        (file("id = 1"), ["marker[0].position_m", "got nothing"]),
        (file("id = 1\nposition_m = [1, 2]"), ["marker[0].position_m"]),
        (file('id = 1\nlat_deg = 47\nlon_deg = 15\nalt_m = "?"'), ["marker[0]", '"?"', "whole place"]),
        (file(f"id = 1\nposition_m = [0, 0, 0]\ncorners_m = {SQUARE}"), ["corners_m", "beside position_m"]),
        (file(ONE, "id = 2\nlat_deg = 47\nlon_deg = 15\nalt_m = 3"), ["marker[1]: place", "of one kind"]),
        (file(ONE, head='dictionary = "4x4_50"\ncrs = "EPSG:2056"'), ["marker[0]: place", "easting 0"]),
        (file(ONE, head='dictionary = "4x4_50"\nignore = [1]'), ["ignore[0]", "got 1"]),
        (file(ONE, head='dictionary = "4x4_50"\nignored = [2]'), ["unknown key", "ignore"]),
        (file(ONE, head='dictionary = "4x4_50"\nside_cm = 20.0'), ["unknown key", "side_m"]),
        (file(f"id = 1\ncorners_m = {SQUARE[:3]}"), ["corners_m", "at least 4"]),
        (
            file(f"id = 1\ncorners_m = {[SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]]}"),
            ["marker[0].corners_m", "a square", "top left, top right"],
        ),
        (file(f"id = 1\nside_m = 0.5\ncorners_m = {SQUARE}"), ["marker[0].corners_m", "side_m, 0.5 m"]),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(tmp_path, text, words):
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as refused:
        load_markers(path)
    sentence = str(refused.value)
    assert refused.value.exit_code == 3
    assert str(path) in sentence
    assert "\n" not in sentence
    for word in words:
        assert word in sentence
