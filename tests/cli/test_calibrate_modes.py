"""A camera file belongs to one mode: images of another zoom, crop or size are refused, and provenance covers them."""

import hashlib
import tomllib

import numpy as np
import pytest
from PIL import Image as PillowImage
from PIL.ExifTags import IFD, Base

from aerodft.adapters.config.camera import load_camera
from tests.full_disk import no_file_above

from .calibration_scene import CAMERA, HEIGHT_PX, POSE, WIDTH_PX, Field, landmarks
from .conftest import run_aerodft

FIELD = Field.of()
MODE = '[mode]\ndevice = "FC3411"\nfocal_mm = 8.38\nfocal_35mm_mm = 22.0\ndigital_zoom = 1.0\n'


def write_image(path, size=(WIDTH_PX, HEIGHT_PX), *, device="FC3411", focal=8.38, film=22, zoom=1.0, taken=None):
    exif = PillowImage.Exif()
    exif[Base.Model], exif[Base.Orientation] = device, 1 if taken is None else 6
    inner = exif.get_ifd(IFD.Exif)
    inner[Base.FocalLength], inner[Base.FocalLengthIn35mmFilm], inner[Base.DigitalZoomRatio] = focal, film, zoom
    inner[Base.ExifImageWidth], inner[Base.ExifImageHeight] = taken or size
    PillowImage.fromarray(np.full((size[1], size[0], 3), 90, np.uint8)).save(path, exif=exif)
    return path


def calibrate(folder, mode=MODE, *more):
    (folder / "camera.toml").write_text(CAMERA + mode)
    text = 'crs = "local"\n[image]\nfile = "view.jpg"\n' + landmarks(FIELD.pixels, FIELD.places)
    (folder / "evidence.toml").write_text(text)
    output = folder / "calibration.toml"
    given = ("--camera", folder / "camera.toml", "--unknowns", POSE, "-o", output)
    return run_aerodft("calibrate", folder / "evidence.toml", *given, *more), output


def test_the_mode_of_a_camera_file_is_read_and_kept(tmp_path):
    path = tmp_path / "camera.toml"
    path.write_text(CAMERA + MODE)
    mode = load_camera(path).mode
    assert (mode.device, mode.focal_mm, mode.focal_35mm_mm, mode.digital_zoom) == ("FC3411", 8.38, 22.0, 1.0)


def test_an_image_of_the_same_mode_counts_in_the_provenance(tmp_path):
    image = write_image(tmp_path / "view.jpg")
    run, output = calibrate(tmp_path)
    assert run.code == 0, run.err
    provenance = tomllib.loads(output.read_text())["provenance"]
    assert provenance["images_sha256"] == {"view.jpg": hashlib.sha256(image.read_bytes()).hexdigest()}
    camera = (tmp_path / "camera.toml").read_bytes()
    assert provenance["camera_sha256"] == hashlib.sha256(camera).hexdigest()


@pytest.mark.parametrize(
    ("image", "sentence"),
    [
        ({"focal": 16.8}, "got 16.8 mm focal length, expected 8.38 mm focal length"),
        ({"film": 44}, "got 44 mm focal length for 35 mm film"),
        ({"zoom": 2.0}, "got 2 times digital zoom, expected 1 times digital zoom"),
        ({"device": "FC7303"}, "got FC7303, expected FC3411"),
        ({"size": (3840, 2160)}, "got 3840 x 2160 px, expected 1920 x 1080 px"),
    ],
)
def test_an_image_of_another_mode_is_refused(tmp_path, image, sentence):
    write_image(tmp_path / "view.jpg", **image)
    run, output = calibrate(tmp_path)
    assert run.code == 3
    assert "view.jpg: the image is not of this camera's mode" in run.last
    assert sentence in run.last
    assert not output.exists()


def test_without_a_mode_in_the_file_doubts_are_said(tmp_path):
    write_image(tmp_path / "view.jpg", film=120, taken=(4000, 3000))
    run, _ = calibrate(tmp_path, "")
    assert run.code == 0, run.err
    assert f"view.jpg is shown turned by viewers: pixels count in it as it is stored, {WIDTH_PX} px wide" in run.err
    assert "taken with 4000 x 3000 px and made 1920 x 1080 px afterwards" in run.err
    assert "120 mm for 35 mm film" in run.err
    assert "is it of another zoom?" in run.err


def test_exif_that_says_nothing_is_no_mismatch(tmp_path):
    write_image(tmp_path / "view.jpg", device="", focal=0, film=0, zoom=0)
    assert calibrate(tmp_path)[0].code == 0


def test_a_mode_key_that_there_is_not_is_named(tmp_path):
    run, _ = calibrate(tmp_path, "[mode]\nfocal_length_mm = 8.4\n")
    assert run.code == 3
    assert "mode.focal_length_mm: unknown key" in run.last


@pytest.mark.parametrize("how", ["camera", "evidence"])
def test_nothing_is_written_over_what_is_read(tmp_path, how):
    calibrate(tmp_path)
    path = tmp_path / f"{how}.toml"
    before = path.read_bytes()
    run, _ = calibrate(tmp_path, MODE, "-o", path)
    assert run.code == 2
    assert "which is read" in run.last
    assert path.read_bytes() == before


def test_a_folder_that_is_missing_is_said_before_the_work(tmp_path):
    run, _ = calibrate(tmp_path, MODE, "-o", tmp_path / "none" / "x.toml")
    assert (run.code, run.out) == (3, b"")
    assert "make the folder first" in run.last


def test_boards_of_several_zooms_are_refused(tmp_path):
    write_image(tmp_path / "a.jpg", (320, 240))
    write_image(tmp_path / "b.jpg", (320, 240), focal=16.8)
    run = run_aerodft("calibrate-lens", tmp_path, "--board", "chessboard:9x6:25mm", "-o", tmp_path / "cam.toml")
    assert run.code == 3
    assert "b.jpg: the images are not of one camera mode: got 16.8 mm focal length, expected 8.38 mm" in run.last
    assert not (tmp_path / "cam.toml").exists()


def test_a_disk_that_fills_up_leaves_the_file_that_was_there(tmp_path):
    run, output = calibrate(tmp_path)
    assert run.code == 0, run.err
    before = output.read_bytes()
    given = ("--camera", tmp_path / "camera.toml", "--unknowns", POSE, "-o", output)
    with no_file_above(512):
        done = run_aerodft("calibrate", tmp_path / "evidence.toml", *given)
    assert done.code == 3, done.err
    assert "calibration.toml: the calibration cannot be written: File too large" in done.last
    assert output.read_bytes() == before
    assert sorted(each.name for each in tmp_path.iterdir()) == ["calibration.toml", "camera.toml", "evidence.toml"]
