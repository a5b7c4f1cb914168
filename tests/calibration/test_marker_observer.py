"""Surveyed markers in pictures of a known scene, as a station sees them."""

import numpy as np
import pytest

from aerodft.errors import InputError
from aerodft.model import Camera, Image, MarkerSurvey, StampClock, SurveyedMarker
from calibration.markers import CameraPlace, MarkerObserver

from .marker_pictures import Lens, View, flat, picture

STDS = 5.0
LENS = Lens()
CAMERA = Camera(
    name="c",
    width_px=LENS.width,
    height_px=LENS.height,
    fx_px=LENS.focal[0],
    fy_px=LENS.focal[1],
    cx_px=LENS.centre[0],
    cy_px=LENS.centre[1],
    distortion=(*LENS.distortion, 0.0),
)
VIEW = View(LENS, (0.0, 0.0, 6.0), 55.0, 20.0)
NEAR, FAR = flat(3, (1.5, 6.0, 0.0), 30.0), flat(5, (4.5, 8.0, 0.0), -70.0, side=0.6)


def surveyed(marker, *, corners=False, side_m=None):
    points = marker.corners.tolist() if corners else [marker.centre]
    return SurveyedMarker(id=marker.id, points_m=tuple(map(tuple, points)), side_m=side_m)


def survey(*markers):
    return MarkerSurvey(dictionary="4X4_50", markers=markers)


def image_of(*markers, pixels=None):
    shown = picture(VIEW, markers) if pixels is None else None
    return Image(
        index=12,
        stamp_ns=77,
        arrival_ns=99,
        clock=StampClock.HOST,
        width_px=LENS.width,
        height_px=LENS.height,
        pixels=pixels or (lambda: shown),
    )


def test_centres_and_corners_are_where_opencv_projects_them():
    observer = MarkerObserver(survey(surveyed(NEAR), surveyed(FAR, corners=True)), CAMERA)
    seen = {each.name: each for each in observer.observe(image_of(NEAR, FAR))}
    places = {"marker-3": NEAR.centre} | {f"marker-5-corner-{n + 1}": FAR.corners[n] for n in range(4)}
    assert set(seen) == set(places)
    for name, place in places.items():
        (pixel,) = seen[name].pixels
        np.testing.assert_allclose(pixel, VIEW.pixels(place)[0], atol=STDS * seen[name].std_px)
        assert 0.1 < seen[name].std_px < 0.5


def test_what_is_seen_belongs_to_its_image():
    (seen,) = MarkerObserver(survey(surveyed(NEAR)), CAMERA).observe(image_of(NEAR))
    assert (seen.image, seen.stamp_ns, seen.clock, seen.source) == (12, 77, StampClock.HOST, "vision")


def test_ids_that_nobody_surveyed_are_counted_and_said_once(caplog):
    observer = MarkerObserver(survey(surveyed(NEAR)), CAMERA, ignore=frozenset({7}))
    shown = image_of(NEAR, FAR, flat(7, (-1.0, 7.0, 0.0)))
    for _ in range(3):
        assert [each.name for each in observer.observe(shown)] == ["marker-3"]
    assert observer.strangers == {5: 3}
    assert [record.message for record in caplog.records if "marker-5" in record.message] == [
        "image 12 shows marker-5, which is not surveyed; it is not used, and not mentioned again"
    ]
    assert "marker-7" not in caplog.text


@pytest.mark.parametrize("corners", [False, True])
@pytest.mark.parametrize(("scale", "is_seen"), [(1.0, True), (1.15, True), (0.85, True), (2.0, False), (0.5, False)])
def test_a_marker_of_another_size_is_something_else(corners, scale, is_seen):
    """A toy with the same id, or a poster: it looks as large as no marker of that side could from there."""
    stated = flat(3, NEAR.centre, 30.0, side=NEAR.side * scale)
    known = survey(surveyed(stated, corners=corners, side_m=None if corners else stated.side))
    place = CameraPlace(np.array(VIEW.place), 0.2)
    observer = MarkerObserver(known, CAMERA, place_near=lambda _: place)
    assert bool(observer.observe(image_of(NEAR))) is is_seen
    assert observer.false == ({} if is_seen else {3: 1})


def test_its_size_tells_nothing_where_nobody_knows_how_far_it_is():
    known = survey(surveyed(NEAR, side_m=2 * NEAR.side))
    for place in (None, CameraPlace(np.array(VIEW.place), 10.0)):
        observer = MarkerObserver(known, CAMERA, place_near=lambda _, place=place: place)
        assert len(observer.observe(image_of(NEAR))) == 1


def test_nothing_to_see_is_nothing_seen():
    observer = MarkerObserver(survey(surveyed(NEAR)), CAMERA)
    assert observer.observe(image_of()) == ()
    black = np.zeros((LENS.height, LENS.width, 3), dtype=np.uint8)
    assert observer.observe(image_of(pixels=lambda: black)) == ()


def test_damage_is_for_the_driver_to_count():
    def damaged():
        raise InputError("image cannot be decoded")

    with pytest.raises(InputError):
        MarkerObserver(survey(surveyed(NEAR)), CAMERA).observe(image_of(pixels=damaged))
