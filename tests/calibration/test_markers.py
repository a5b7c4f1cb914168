"""Markers in pictures whose truth OpenCV's projection gives, and in the photo of a surveyed hall."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from aerodft.model import Camera, MarkerSurvey, SurveyedMarker
from calibration.markers import find_markers, other_dictionary
from calibration.markers.detection import MIN_STD_PX
from tests.nights import at_night

from .marker_pictures import Lens, View, flat, picture, upright

LENS = Lens()
CAMERA = Camera(
    name="scene",
    width_px=LENS.width,
    height_px=LENS.height,
    fx_px=LENS.focal[0],
    fy_px=LENS.focal[1],
    cx_px=LENS.centre[0],
    cy_px=LENS.centre[1],
    distortion=LENS.distortion,
)
VIEW = View(LENS, (2.0, -1.0, 6.0), tilt_deg=55.0, heading_deg=20.0)
PHOTO = Path(__file__).parents[3] / "shared" / "data" / "landmarks" / "markers" / "20191029_110429.jpg"


def survey(ids, dictionary="4X4_50"):
    markers = tuple(SurveyedMarker(id=each, points_m=((float(each), 0.0, 0.0),)) for each in ids)
    return MarkerSurvey(dictionary=dictionary, markers=markers)


def ground(u, v):
    """Where a pixel meets the ground."""
    ray = VIEW.rays([[u, v]])[0]
    return tuple(np.array(VIEW.place) - VIEW.place[2] / ray[2] * ray)


def scattered(seed, sizes_px, count=8):
    """Markers all over the image, on the ground and standing, about so many px large."""
    rng = np.random.default_rng(seed)
    columns, rows = np.meshgrid([170, 480, 800, 1110], [330, 580])
    centres = np.stack([columns.ravel(), rows.ravel()], axis=1) + rng.uniform(-50, 50, (8, 2))
    markers = []
    for index, (u, v) in enumerate(centres[:count]):
        place = ground(u, v)
        side = rng.uniform(*sizes_px) * np.linalg.norm(np.array(place) - VIEW.place) / LENS.focal[0]
        facing = VIEW.heading_deg + 180 + rng.uniform(-50, 50)
        made = flat(index, place, rng.uniform(0, 360), side) if index % 2 else upright(index, place, facing, side)
        markers.append(made)
    return markers


def seen_and_true(markers, found):
    truth = {marker.id: marker for marker in markers}
    assert {each.id for each in found} <= set(truth)
    centres = np.array([VIEW.pixels([truth[each.id].centre])[0] for each in found])
    corners = np.array([VIEW.pixels(truth[each.id].corners) for each in found])
    return centres, corners


@pytest.mark.parametrize("dictionary", ["4X4_50", "6X6_250", "APRILTAG_36h11"])
def test_centres_and_corners_are_where_opencv_projects_them(dictionary):
    markers = scattered(3, (45, 110))
    found = find_markers(picture(VIEW, markers, dictionary), survey(range(8), dictionary), CAMERA)
    assert [each.id for each in found] == list(range(8))
    centres, corners = seen_and_true(markers, found)
    np.testing.assert_allclose([each.pixel for each in found], centres, atol=0.3)
    np.testing.assert_allclose([each.corners for each in found], corners, atol=0.5)


def test_a_centre_is_not_the_mean_of_corners():
    near = [flat(5, ground(640, 420), 30.0, side=2.2)]
    found = find_markers(picture(VIEW, near), survey([5]), CAMERA)
    centres, corners = seen_and_true(near, found)
    assert np.linalg.norm(corners[0].mean(axis=0) - centres[0]) > 3.0
    np.testing.assert_allclose(found[0].pixel, centres[0], atol=0.3)


def test_edges_that_the_lens_bends_are_straightened_first():
    wide = Lens(focal=(620.0, 618.0), distortion=(-0.32, 0.12, 0.0, 0.0))
    view = View(wide, (0.0, 0.0, 3.0), tilt_deg=15.0, heading_deg=0.0)
    marker = flat(2, (1.6, 1.3, 0.0), 10.0, side=1.0)
    camera = Camera(
        name="wide",
        width_px=1280,
        height_px=720,
        fx_px=620.0,
        fy_px=618.0,
        cx_px=wide.centre[0],
        cy_px=wide.centre[1],
        distortion=wide.distortion,
    )
    image = picture(view, [marker])
    (knowing,) = find_markers(image, survey([2]), camera)
    (straight,) = find_markers(image, survey([2]))
    truth = view.pixels(marker.corners)
    assert np.max(np.abs(knowing.corners - truth)) < 0.3
    assert np.max(np.abs(straight.corners - truth)) > 1.0
    np.testing.assert_allclose(knowing.pixel, view.pixels([marker.centre])[0], atol=0.15)


@pytest.mark.parametrize(("sizes_px", "blur_px", "noise"), [((22, 40), 0.7, 2.5), ((40, 110), 1.8, 6.0)])
def test_errors_are_as_large_as_stated(sizes_px, blur_px, noise):
    off, stds = [], []
    for seed in range(6):
        markers = scattered(seed, sizes_px)
        image = picture(VIEW, markers, blur_px=blur_px, noise=noise, seed=seed)
        found = find_markers(image, survey(range(8)), CAMERA)
        centres, _ = seen_and_true(markers, found)
        off.append(np.array([each.pixel for each in found]) - centres)
        stds += [each.std_px for each in found]
    scaled = np.concatenate(off) / np.array(stds)[:, None]
    assert len(stds) >= 35
    assert min(stds) >= MIN_STD_PX
    assert np.mean(np.abs(scaled) < 3) >= 0.97
    assert np.std(scaled) < 1.2


def test_thoroughness_finds_what_one_look_does_not():
    markers = [upright(each, ground(200 + 150 * each, 400), 200.0, side=0.14) for each in range(7)]
    image = picture(VIEW, markers)
    once = find_markers(image, survey(range(7)), CAMERA)
    found = find_markers(image, survey(range(7)), CAMERA, thorough=True)
    assert len(once) < len(found)
    centres, _ = seen_and_true(markers, found)
    np.testing.assert_allclose([each.pixel for each in found], centres, atol=0.5)


def test_every_marker_is_reported_surveyed_or_not_and_as_often_as_it_is_there():
    there = [(4, 300, 400), (9, 640, 420), (4, 1000, 500)]
    image = picture(VIEW, [flat(marker, ground(u, v), side=0.7) for marker, u, v in there])
    assert [each.id for each in find_markers(image, survey([4]))] == [4, 4, 9]
    assert [each.id for each in find_markers(image, survey([4, 20]), thorough=True)] == [4, 4, 9]


def test_grey_and_colour_are_the_same():
    image = picture(VIEW, scattered(1, (50, 80), count=3))
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    assert find_markers(grey, survey(range(3)), CAMERA) == find_markers(image, survey(range(3)), CAMERA)


def stains(seed, grid, darkest_to):
    """Uneven ground with many dark, square, cloudy stains."""
    rng = np.random.default_rng(seed)
    ground_grey = rng.uniform(100, 235, (60, 90)).astype(np.float32)
    image = cv2.resize(ground_grey, (1350, 900), interpolation=cv2.INTER_CUBIC)
    for row in range(18):
        for column in range(27):
            size = int(rng.integers(18, 42))
            cloud = rng.uniform(0, darkest_to, (grid, grid)).astype(np.float32)
            v, u = row * 48 + 10, column * 48 + 10
            image[v : v + size, u : u + size] = cv2.resize(cloud, (size, size), interpolation=cv2.INTER_CUBIC)
    return image.clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize(("seed", "grid", "darkest_to"), [(4, 5, 150), *at_night((2, 3, 130), (6, 6, 110))])
def test_textures_are_not_taken_for_markers(seed, grid, darkest_to):
    image = stains(seed, grid, darkest_to)
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_1000)
    few = cv2.aruco.DetectorParameters()
    few.minMarkerPerimeterRate = 40 / 1350
    believed = cv2.aruco.ArucoDetector(known, few).detectMarkers(image)[0]
    assert len(believed) > 0, "OpenCV alone must be taken in for this to show anything"
    assert find_markers(image, survey(range(6), "4X4_1000"), thorough=True) == []


def test_another_dictionary_is_suggested_where_its_markers_are_there():
    image = picture(VIEW, scattered(2, (60, 90), count=3), "5X5_100")
    assert other_dictionary(image, "4X4_50") == "5X5_50"
    assert not other_dictionary(image, "5X5_100")
    assert not other_dictionary(picture(VIEW, []), "4X4_50")


@pytest.mark.nightly
@pytest.mark.skipif(not PHOTO.is_file(), reason="the photo of the hall is not here")
def test_the_hall_shows_five_of_its_six_markers_and_no_other():
    """Its dictionary is 4X4_50, the first of 4X4_1000, in which twenty times as much may be taken for a marker."""
    image = cv2.imread(str(PHOTO), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    found = find_markers(image, survey(range(1, 7), "4X4_1000"), thorough=True)
    assert [each.id for each in found] == [1, 3, 4, 5, 6]
    assert all(MIN_STD_PX <= each.std_px < 0.6 for each in found)
