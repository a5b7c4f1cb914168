"""Focal lengths from EXIF data, against those that makers' sensors and lenses have."""

import numpy as np
import pytest
from PIL import Image as PillowImage
from PIL.ExifTags import IFD, Base

import aerodft as ad

SIZES = {
    "16:9 of a 4:3 sensor": ((4000, 2250), 20, 2311.0),
    "4:3, all of the sensor": ((4000, 3000), 24, 4000 / 6.3 * 4.39),  # 1/2.3 inch, 6.3 mm wide
    "3:2, all of the sensor": ((5472, 3648), 24, 5472 / 13.2 * 8.8),
    "16:9 of a 3:2 sensor": ((5472, 3078), 24, 5472 / 13.2 * 8.8),
    "4:3 of a 3:2 sensor": ((4864, 3648), 24, 5472 / 13.2 * 8.8),
    "upright": ((2250, 4000), 20, 2311.0),
}
"""Size, focal length for 35 mm film, and focal length in pixels."""


def photo(folder, size, film, *, zoom=None, taken=None):
    exif, path = PillowImage.Exif(), folder / "view.jpg"
    exif[Base.Model] = "FC0000"
    inner = exif.get_ifd(IFD.Exif)
    inner[Base.ExifImageWidth], inner[Base.ExifImageHeight] = taken or size
    if film is not None:
        inner[Base.FocalLengthIn35mmFilm] = film
    if zoom is not None:
        inner[Base.DigitalZoomRatio] = zoom
    PillowImage.fromarray(np.zeros((size[1], size[0]), np.uint8)).save(path, exif=exif)
    return path


@pytest.mark.parametrize(("size", "film", "truth_px"), SIZES.values(), ids=SIZES)
def test_focal_lengths_are_within_their_intervals(tmp_path, size, film, truth_px):
    camera = ad.load_camera(photo(tmp_path, size, film))
    assert abs(camera.fx_px - truth_px) <= 1.96 * camera.std.focal_px
    assert camera.std.focal_px < 0.05 * camera.fx_px
    assert (camera.width_px, camera.height_px, camera.fx_px) == (*size, camera.fy_px)


def test_a_wide_still_is_taken_for_a_crop_of_a_four_to_three_sensor(tmp_path):
    camera = ad.load_camera(photo(tmp_path, (4000, 2250), 20))
    assert camera.fx_px == pytest.approx(2311, abs=1)
    assert camera.fx_px - 1.96 * camera.std.focal_px < 2121


def test_digital_zoom_may_be_in_the_equivalent_or_not(tmp_path):
    camera = ad.load_camera(photo(tmp_path, (4000, 3000), 24, zoom=2.0))
    assert abs(camera.fx_px - 2 * 5000 / 43.27 * 24) < 1.96 * camera.std.focal_px


@pytest.mark.parametrize(("film", "taken", "words"), [(None, None, "no focal length"), (20, (4000, 3000), "cropped")])
def test_what_tells_no_focal_length_is_refused(tmp_path, film, taken, words):
    with pytest.raises(ad.AerodftError, match=words):
        ad.load_camera(photo(tmp_path, (4000, 2250), film, taken=taken))


def test_a_camera_of_the_library_is_recognised(tmp_path):
    (known,) = ad.find_cameras("FC7303 4000x3000")
    path = photo(tmp_path, (4000, 3000), 24)
    with PillowImage.open(path) as image:
        exif = image.getexif()
        exif[Base.Model] = "FC7303"
        image.save(tmp_path / "mini.jpg", exif=exif)
    assert ad.load_camera(tmp_path / "mini.jpg") == known.camera
