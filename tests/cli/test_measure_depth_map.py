"""``aerodft measure --depth-map``: files, numbers and refusals."""

import math
from pathlib import Path

import cv2
import numpy as np
import orjson
import pytest
from numpy.testing import assert_allclose
from PIL import Image as PillowImage
from pyproj import Geod

CAMERA = 'name = "wide"\nwidth_px = 320\nheight_px = 240\nhfov_deg = 60.0\nvfov_deg = 46.8264489\n'


@pytest.fixture
def depth(aerodft, tmp_path):
    (tmp_path / "camera.toml").write_text(CAMERA)
    pixels = np.random.default_rng(3).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "image.png"), pixels)

    def run(tilt_deg, *options, height_m=50, to="out"):
        where = ["--camera", tmp_path / "camera.toml", "--height", height_m, "--tilt", tilt_deg]
        return aerodft("measure", *where, "--depth-map", tmp_path / to, *options)

    return run


def test_everything_is_written_and_said(depth, tmp_path):
    options = ("--heading", 30, "--lat", 48, "--lon", 11, "--image", tmp_path / "image.png")
    found = depth(40, *options, "--json")
    assert (found.code, found.err) == (0, "")
    names = {Path(file).name for file in found.json["files"]}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    assert {"depth.npz", "depth.png", "footprint.geojson", "topview.png", "topview.pgw", "topview.prj"} <= names
    with np.load(tmp_path / "out/depth.npz") as arrays:
        assert {array.shape for array in arrays.values()} == {(240, 320)}
        assert {array.dtype for array in arrays.values()} == {np.dtype(np.float32)}
        assert_allclose(arrays["range_m"][119:121, 159:161].mean(), 50 / math.cos(math.radians(40)), rtol=1e-4)
        assert_allclose(
            np.hypot(arrays["x_m"], arrays["y_m"]), np.hypot(arrays["east_m"], arrays["north_m"]), rtol=1e-5
        )
    with PillowImage.open(tmp_path / "out/depth.png") as drawn:
        assert drawn.size[0] > 1000
    assert found.json["horizon_px"] is None
    assert found.json["ground_share"] == 1.0
    assert found.json["top_view"]["crs"] == "EPSG:32632"
    (feature,) = orjson.loads((tmp_path / "out/footprint.geojson").read_bytes())["features"]
    lon, lat = np.array(feature["geometry"]["coordinates"][0]).T
    assert (lon[0], lat[0]) == (lon[-1], lat[-1])
    geodesic_m2, _ = Geod(ellps="WGS84").polygon_area_perimeter(lon, lat)  # above 0: counterclockwise
    assert geodesic_m2 == pytest.approx(found.json["footprint_area_m2"], rel=1e-4)
    words = depth(40, *options)
    assert (words.code, words.out) == (0, b"")
    assert "100 % of the image shows ground" in words.err
    assert "the horizon is not in view" in words.err


def test_without_a_place_the_footprint_is_in_the_ground_frame(depth, tmp_path):
    found = depth(85, "--heading", 200, "--json")
    (feature,) = orjson.loads((tmp_path / "out/footprint.geojson").read_bytes())["features"]
    assert "ground frame" in feature["properties"]["coordinates"]
    x, y = np.array(feature["geometry"]["coordinates"][0]).T
    assert_allclose(np.max(np.hypot(x, y)), math.sqrt(5000**2 - 50**2), rtol=1e-6)
    assert np.min(y) > 0
    assert_allclose(-x.min(), x.max(), rtol=1e-6)
    (line,) = found.json["horizon_px"]
    focal = 120 / math.tan(math.radians(46.8264489 / 2))
    assert_allclose(np.array(line)[:, 1], 119.5 - focal * math.tan(math.radians(5)), atol=1e-6)
    assert found.json["max_range_m"] == 5000.0
    assert "the horizon runs from (-0.5," in depth(85).err


@pytest.mark.parametrize(
    ("tilt_deg", "options", "code", "said"),
    [
        (140, (), 4, "the image shows no ground"),
        (40, ("--model", "dft"), 2, "--depth-map with --model dft"),
        (40, ("--probe", "range 3,4"), 2, "--depth-map beside --probe"),
        (40, ("--explain",), 2, "--depth-map beside --probe, --compare or --explain"),
        (40, ("--image", "missing.png"), 3, "the image cannot be read"),
        (40, ("--image", Path(__file__)), 3, "image cannot be decoded"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(depth, tmp_path, tilt_deg, options, code, said):
    found = depth(tilt_deg, *options)
    assert (found.code, found.out) == (code, b"")
    assert said in found.last
    assert not (tmp_path / "out").exists()


def test_images_of_another_size_and_files_in_the_way_are_refused(depth, aerodft, tmp_path):
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((24, 32, 3), dtype=np.uint8))
    (tmp_path / "empty.png").touch()
    (tmp_path / "taken").touch()
    small = depth(40, "--image", tmp_path / "small.png")
    assert (small.code, small.out) == (3, b"")
    assert "got 32 x 24 px, expected an image of 320 x 240 px" in small.last
    assert "an empty file" in depth(40, "--image", tmp_path / "empty.png").last
    taken = depth(40, to="taken")
    assert taken.code == 3
    assert "the depth map cannot be written" in taken.last
    alone = aerodft("measure", "--image", tmp_path / "small.png", "--probe", "range 1,2")
    assert (alone.code, "--image without --depth-map" in alone.last) == (2, True)


def test_a_recorded_pose_has_a_depth_map(aerodft, flight_recording, tmp_path):
    found = aerodft("measure", "--recording", flight_recording, "--at", "1", "--depth-map", tmp_path, "--json")
    assert (found.code, found.err) == (0, "")
    assert found.json["range_m"][0] < 40 / math.cos(math.radians(30)) < found.json["range_m"][1]
