"""The library of cameras against calibrations that others published, and against what photos say of themselves."""

import math

import pytest
from PIL import Image

import aerodft as ad
from aerodft.adapters.config.camera import known_cameras
from tests.commands import run_aerodft

# OpenSfM's camera_calibration.yaml; CalibratedFocalLength in the XMP data of photos; lensfun's crop factors.
PUBLISHED = {
    "FC300X 4000x3000": (0.5931 * 4000, "OpenSfM, of the FC300S, which has its lens"),
    "FC330 4000x3000": (0.5931 * 4000, "OpenSfM, of the FC300S, which has its lens"),
    "Zenmuse X4S 5472x3648": (3666.67, "XMP of the FC6310, which has its sensor and focal length"),
    "L2D-20c 5280x3956": (3725.15, "XMP of the M3E, which has its lens"),
    "M3M 5280x3956": (3725.15, "XMP of the M3E, which has its lens"),
    "FC220 4000x3000": (4.73 * 5.64 / 43.27 * 1.25 * 4000, "lensfun: crop factor 5.64"),
    "FC3411 5472x3648": (8.38 * 2.73 / 43.27 * 1.2019 * 5472, "lensfun: crop factor 2.73"),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_focal_lengths_are_within_two_stds_of_published_ones(name):
    (known,) = ad.find_cameras(name)
    truth_px, whose = PUBLISHED[name]
    assert known.known_from != "calibrated"
    assert abs(known.camera.fx_px - truth_px) < 2 * known.camera.std.focal_px, whose


def test_the_library_is_large_and_names_its_sources():
    assert len({known.name for known in known_cameras()}) >= 40
    assert all(known.source and known.camera.std.focal_px > 0.01 * known.camera.fx_px for known in known_cameras())
    assert len({(known.camera.name) for known in known_cameras()}) == len(known_cameras())


def photo(path, size, device, focal_35mm_mm=None):
    exif = Image.Exif()
    exif[0x0110] = device
    if focal_35mm_mm:
        exif.get_ifd(0x8769)[0xA405] = focal_35mm_mm
    Image.new("RGB", size).save(path, exif=exif)
    return path


def test_a_photo_tells_its_camera_by_device_size_and_lens(tmp_path):
    (known,) = ad.find_cameras(photo(tmp_path / "a.jpg", (4000, 3000), "FC7303"))
    assert known.name == "DJI Mini 2"
    (known,) = ad.find_cameras(photo(tmp_path / "b.jpg", (640, 512), "M3T", 40))
    assert known.name == "DJI Mavic 3 Thermal, thermal"
    with pytest.raises(ad.NoAnswerError, match="FC7303"):
        ad.find_cameras(photo(tmp_path / "c.jpg", (1000, 750), "FC7303"))
    with pytest.raises(ad.NoAnswerError):
        ad.find_cameras(photo(tmp_path / "d.jpg", (640, 512), "M3T", 162))


def test_a_photo_of_a_camera_outside_the_library_tells_by_its_exif_data(tmp_path):
    (known,) = ad.find_cameras(photo(tmp_path / "a.jpg", (4000, 2250), "FC300S", 20))
    assert known.known_from == "photo"
    assert known.camera.fx_px == pytest.approx(20 / 43.2666 * math.hypot(4000, 3000), rel=1e-4)  # by the 4:3 diagonal
    fisheye = photo(tmp_path / "b.jpg", (1920, 1088), "Disco", 6)
    with pytest.raises(ad.NoAnswerError):
        ad.find_cameras(fisheye)
    with pytest.raises(ad.InputError, match="a fisheye, whose lens EXIF does not describe"):
        ad.draft_station([fisheye], tmp_path / "mine")


def test_a_camera_file_is_written_that_measures(tmp_path):
    (known,) = ad.find_cameras("M3E photo")
    ad.write_camera(known, tmp_path / "m3e.toml")
    camera = ad.load_camera(tmp_path / "m3e.toml")
    assert camera == known.camera
    pose = ad.CameraPose(height_m=50.0, tilt_deg=0.0, std=ad.PoseStd(height_m=0.0, tilt_deg=0.0))
    width = ad.measure(camera, pose, ad.Distance([(1000.0, 1978.0), (4000.0, 1978.0)]))
    assert width.std == pytest.approx(0.015 * width.value, rel=0.3)  # the focal length's share is the width's
    with pytest.raises(ad.InputError, match="exists"):
        ad.write_camera(known, tmp_path / "m3e.toml")


def test_the_command_lists_and_writes(tmp_path):
    assert "Mavic 3 Enterprise" in run_aerodft("cameras").out.decode()
    done = run_aerodft("cameras", "FC6310R photo", "-o", tmp_path / "camera.toml", "--json")
    assert done.code == 0
    assert done.json[0]["width_px"] == ad.load_camera(tmp_path / "camera.toml").width_px == 5472
    assert run_aerodft("cameras", "FC6310", "-o", tmp_path / "no.toml").code == 2
    assert run_aerodft("cameras", "Brownie").code == 4
