"""The camera that a photograph tells of, in pixels of the image as it is stored."""

import math

import pytest

from aerodft.adapters.images import camera_of_still
from aerodft.adapters.photographs import lens_of_tags, photo_tags
from aerodft.app.measure import camera_of_photograph
from aerodft.errors import InputError
from aerodft.model import CameraMode
from tests.photo_writer import dji, exif, packet, write_photo

DEWARP = "2018-09-07;3657.02,3650.62,-4.03,23.1,-0.267098,0.111977,0.000924881,0.0000882056,-0.0331614"
FULL = {
    "CalibratedFocalLength": "3666.666504",
    "CalibratedOpticalCenterX": "2736.0",
    "CalibratedOpticalCenterY": "1824.0",
}


def lens(folder, size_px, mode=None, values=None, **tags):
    photo = write_photo(
        folder / "a.jpg", packet(values or dji(**tags)), exif(make="DJI", model="FC6310R"), size_px=size_px
    )
    return lens_of_tags(photo_tags(photo), mode or CameraMode())


def test_dewarp_data_are_of_the_full_size_with_offsets_from_the_centre(tmp_path):
    camera = lens(tmp_path, (684, 456), DewarpData=DEWARP, DewarpFlag="0", **FULL).camera
    assert camera.fx_px == pytest.approx(3657.02 / 8)
    assert camera.fy_px == pytest.approx(3650.62 / 8)
    assert camera.cx_px == pytest.approx(341.5 - 4.03 / 8)
    assert camera.cy_px == pytest.approx(227.5 + 23.1 / 8)
    assert camera.distortion == pytest.approx((-0.267098, 0.111977, 0.000924881, 0.0000882056, -0.0331614))
    assert camera.std.focal_px == pytest.approx(0.003 * camera.fx_px)


def test_an_image_that_was_dewarped_has_no_distortion(tmp_path):
    assert lens(tmp_path, (684, 456), DewarpData=DEWARP, DewarpFlag="1", **FULL).camera.distortion == ()


def test_a_calibrated_focal_length_is_nominal(tmp_path):
    camera = lens(tmp_path, (684, 456), **FULL).camera
    assert camera.fx_px == pytest.approx(3666.666504 / 8)
    assert camera.std.focal_px >= 0.01 * camera.fx_px


def test_a_crop_of_full_width_keeps_the_focal_length(tmp_path):
    camera = lens(tmp_path, (684, 385), DewarpData=DEWARP, **FULL)
    assert camera is None or camera.camera.fx_px == pytest.approx(3657.02 / 8)


@pytest.mark.parametrize(
    "data",
    [
        "",
        "2018-09-07;1,2,3",
        "2018-09-07;nan,3650,0,0,0,0,0,0,0",
        "2018-09-07;1e9,1e9,0,0,0,0,0,0,0",
        "x;-5,-5,0,0,0,0,0,0,0",
    ],
)
def test_impossible_dewarp_data_are_not_used(tmp_path, data):
    assert lens(tmp_path, (684, 456), DewarpData=data) is None


def test_the_colour_cameras_calibration_is_not_the_thermal_images(tmp_path):
    values = {
        "drone-skydio:Latitude": 29.8,
        "drone-skydio:CalibratedFocalLength": {"X": 4892.0, "Y": 4870.4},
        "drone-skydio:CalibratedOpticalCenter": {"X": 1989.3, "Y": 1443.8},
    }
    assert lens(tmp_path, (640, 512), values=values) is None
    own = lens(tmp_path, (1989, 1444), values=values)
    assert own.camera.fx_px == pytest.approx(4892.0 / 2, rel=1e-3)


def test_a_digital_zoom_leaves_the_calibration_aside(tmp_path):
    assert lens(tmp_path, (684, 456), CameraMode(digital_zoom=2.0), DewarpData=DEWARP, **FULL) is None


def test_a_field_of_view_across(tmp_path):
    camera = lens(tmp_path, (640, 512), values={"exif:CameraHorizontalFOV": "31534363/1000000"}).camera
    assert math.degrees(camera.hfov_rad) == pytest.approx(31.534363)


def test_35_mm_equivalents_are_by_the_diagonal_of_the_full_frame(tmp_path):
    """A Phantom 3's 16:9 photograph of a 4:3 sensor: 2311 px of 4000, not the cropped diagonal's 2121."""
    photo = write_photo(tmp_path / "a.jpg", None, exif(make="DJI", model="X", focal_35mm_mm=20), size_px=(400, 225))
    assert camera_of_still(photo).fx_px == pytest.approx(231.1, abs=0.2)


def test_contradicting_focal_lengths_are_wide_and_said(tmp_path):
    values = dji(DewarpData=DEWARP, **FULL)
    for focal_35mm_mm, is_same in ((24, True), (48, False)):
        info = exif(make="DJI", model="FC6310R", focal_35mm_mm=focal_35mm_mm)
        photo = write_photo(tmp_path / "a.jpg", packet(values), info, size_px=(684, 456))
        camera, said = camera_of_photograph(photo)
        assert ("contradict" not in said) is is_same
        assert (camera.std.focal_px > 400) is not is_same


def test_a_fisheye_is_refused(tmp_path):
    photo = write_photo(tmp_path / "a.jpg", None, exif(make="PARROT", model="Disco", focal_35mm_mm=6))
    with pytest.raises(InputError, match="fisheye"):
        camera_of_photograph(photo)
