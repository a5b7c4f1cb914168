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
    "4:3 of a 3:2 sensor, 8.8 mm": ((4864, 3648), 24, 3666.7),  # by the XMP data of the FC6310's photos
    "upright": ((2250, 4000), 20, 2311.0),
}
"""Size, focal length for 35 mm film, and focal length in pixels."""


def photo(folder, size, film, *, zoom=None, taken=None, more=()):
    exif, path = PillowImage.Exif(), folder / "view.jpg"
    exif[Base.Model] = "FC0000"
    inner = exif.get_ifd(IFD.Exif)
    inner[Base.ExifImageWidth], inner[Base.ExifImageHeight] = taken or size
    if film is not None:
        inner[Base.FocalLengthIn35mmFilm] = film
    if zoom is not None:
        inner[Base.DigitalZoomRatio] = zoom
    inner.update(more)
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


@pytest.mark.parametrize("zoom", [4.0, 8.7, 1000.0])
def test_a_digital_zoom_that_leaves_the_focal_length_open_is_refused(tmp_path, zoom):
    with pytest.raises(ad.InputError, match=r"does not state its focal length.*give `camera` or calibrate the lens"):
        ad.load_camera(photo(tmp_path, (4000, 3000), 24, zoom=zoom))


def on_sensor(focal_mm, px_per_unit, unit):
    keys = (Base.FocalLength, Base.FocalPlaneXResolution, Base.FocalPlaneResolutionUnit)
    return dict(zip(keys, (focal_mm, px_per_unit, unit), strict=True))


SENSORS = {
    "Canon EOS 1000D, inches": ((3888, 2592), None, on_sensor(18, 3888000 / 876, 2), 18 * 3888 / 22.2),
    "Canon EOS 5D Mark II, made a quarter": ((1404, 936), (5616, 3744), on_sensor(24, 5616000 / 1459, 2), 24 * 39.0),
    "Fujifilm X-T2, centimetres": ((6000, 4000), None, on_sensor(23, 2558, 3), 23 * 6000 / 23.5),
    "Olympus E-M10, millimetres": ((4608, 3456), None, on_sensor(14, 4608 / 17.3, 4), 14 * 4608 / 17.3),
}
"""Size, size when taken, EXIF data without an equivalent, and focal length in pixels by the maker's sensor."""


@pytest.mark.parametrize(("size", "taken", "more", "truth_px"), SENSORS.values(), ids=SENSORS)
def test_without_an_equivalent_the_sensors_pixels_tell(tmp_path, size, taken, more, truth_px):
    camera = ad.load_camera(photo(tmp_path, size, None, taken=taken, more=more))
    assert camera.fx_px == pytest.approx(truth_px, rel=0.03)
    assert camera.std.focal_px == pytest.approx(0.03 * camera.fx_px)


@pytest.mark.parametrize(
    ("size", "film", "words"),
    [((4000, 3000), 1, "1 mm"), ((4000, 3000), 65535, "65535 mm"), ((1200, 300), 26, "joined")],
)
def test_what_cannot_be_is_refused(tmp_path, size, film, words):
    with pytest.raises(ad.InputError, match=words):
        ad.load_camera(photo(tmp_path, size, film))


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
    exif.get_ifd(IFD.Exif)[Base.DigitalZoomRatio] = 2.0
    with PillowImage.open(path) as image:
        image.save(tmp_path / "zoomed.jpg", exif=exif)
    zoomed = ad.load_camera(tmp_path / "zoomed.jpg")
    assert abs(zoomed.fx_px - 2 * known.camera.fx_px) < 1.96 * zoomed.std.focal_px


def test_a_phone_s_own_format_is_named(tmp_path):
    path = tmp_path / "IMG_1.HEIC"
    path.write_bytes(b"\0\0\0\x24ftypheic\0\0\0\0mif1heic\xff\xfe")
    with pytest.raises(ad.AerodftError, match="a HEIC photo, which is to be saved as JPEG"):
        ad.load_camera(path)
