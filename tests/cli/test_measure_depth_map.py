"""``aerodft measure --depth-map``: files, numbers and refusals."""

import math
from pathlib import Path

import cv2
import numpy as np
import orjson
import pytest
from numpy.testing import assert_allclose
from PIL import Image as PillowImage
from pyproj import Geod, Transformer

from aerodft.geometry import camera_pose, matrix

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
    assert found.json["ground"] == {"kind": "level", "elevation_m": 0.0}
    assert found.json["z_m"] == [0.0, 0.0]
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
    (feature,) = orjson.loads((tmp_path / "out/footprint_local.json").read_bytes())["features"]
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
        (40, ("--model", "dft"), 2, "a depth map with --model dft"),
        (40, ("--probe", "range 3,4"), 2, "--depth-map beside --probe"),
        (40, ("--step", 0.1), 2, "--step without --image"),
        (40, ("--elevation", 50), 4, "the camera is not above the ground: got 50.00 m over ground at 50.00 m"),
        (40, ("--explain",), 2, "--depth-map beside --explain"),
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
    stepless = depth(40, "--image", tmp_path / "image.png", "--step", 0)
    assert (stepless.code, "--step: got 0" in stepless.last) == (3, True)
    alone = aerodft("measure", "--image", tmp_path / "small.png", "--probe", "range 1,2")
    assert (alone.code, "--image without --depth-map" in alone.last) == (2, True)


def test_a_recorded_pose_has_a_depth_map(aerodft, flight_recording, tmp_path):
    found = aerodft("measure", "--recording", flight_recording, "--at", "1", "--depth-map", tmp_path, "--json")
    assert (found.code, found.err) == (0, "")
    assert found.json["range_m"][0] < 40 / math.cos(math.radians(30)) < found.json["range_m"][1]


def test_the_uncertainty_of_every_range_is_that_of_its_pixel(aerodft, depth, tmp_path):
    std = ("--std", "height=0.5,tilt=0.4,pan=0,roll=0.2,heading=1,px=0")
    found = depth(60, *std, "--json")
    pose = ("--camera", tmp_path / "camera.toml", "--height", 50, "--tilt", 60)
    alone = aerodft("measure", *pose, *std, "--probe", "range 40,200", "--json").json[0]
    with np.load(tmp_path / "out/depth.npz") as arrays:
        assert arrays["range_std_m"][200, 40] == pytest.approx(alone["std"], rel=1e-4)
        assert arrays["range_m"][200, 40] == pytest.approx(alone["value"], rel=1e-5)
        assert found.json["range_std_m"]["median"] == pytest.approx(np.median(arrays["range_std_m"]), rel=1e-5)
    assert found.json["range_std_m"]["ill_conditioned_share"] == 0.0
    assert "assumed: height 0.5 m, tilt 1 deg" in " ".join(depth(60, "--json").json["notes"])
    assert depth(60, "--std", "height=0,attitude=0", "--json").json["range_std_m"] is None


def up_of_slope_m(east_north_m):
    return math.tan(math.radians(15)) * (east_north_m @ [math.sin(math.radians(100)), math.cos(math.radians(100))])


def picture_of_square(middle_en_m, side_m, up_of_m):
    """What a camera as above, 50 m high, tilted by 40 and heading for 30 degrees, sees of a bright square."""
    pose = camera_pose(height_agl_m=50.0, tilt_rad=math.radians(40), heading_rad=math.radians(30))
    corners = middle_en_m + side_m * (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5)
    rotation, focal = matrix(pose.wxyz).T, 160 / math.tan(math.radians(30))
    intrinsics = np.array([[focal, 0, 159.5], [0, 120 / math.tan(math.radians(23.41322445)), 119.5], [0, 0, 1.0]])
    points = np.column_stack([corners, up_of_m(corners)])
    turn, shift = cv2.Rodrigues(rotation)[0], -rotation @ pose.position_enu_m
    at = cv2.projectPoints(points, turn, shift, intrinsics, None)[0][:, 0]
    large = np.zeros((960, 1280, 3), dtype=np.uint8)
    cv2.fillConvexPoly(large, np.rint(((at + 0.5) * 4 - 0.5) * 16).astype(np.int32), (255, 255, 255), cv2.LINE_AA, 4)
    return cv2.resize(large, (320, 240), interpolation=cv2.INTER_AREA)


def test_on_a_slope_heights_are_written_and_the_map_is_in_its_place(depth, tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="the extra terrain is not installed")
    middle = np.array([21.0, 33.0])
    cv2.imwrite(str(tmp_path / "square.png"), picture_of_square(middle, 3.0, up_of_slope_m))
    options = ("--heading", 30, "--slope", 15, "--uphill", 100, "--lat", 48, "--lon", 11, "--max-range", 90)
    found = depth(40, *options, "--image", tmp_path / "square.png", "--step", 0.2, "--json")
    assert (found.code, found.err) == (0, "")
    assert found.json["ground"]["kind"] == "slope"
    assert found.json["ground"]["slope_deg"] == pytest.approx(15.0)
    assert found.json["ground"]["uphill_deg"] == pytest.approx(100.0)
    with np.load(tmp_path / "out/depth.npz") as arrays:
        east_north = np.stack([arrays["east_m"], arrays["north_m"]], axis=-1)
        assert_allclose(arrays["z_m"], up_of_slope_m(east_north), atol=1e-3)
        assert np.nanmax(arrays["range_m"]) <= 90.0
        z_m = np.nanmin(arrays["z_m"]), np.nanmax(arrays["z_m"])
        assert found.json["z_m"] == pytest.approx(z_m)
    with rasterio.open(tmp_path / "out/topview.tif") as tif:
        bright = tif.read(1).astype(float)
        rows, columns = np.indices(bright.shape)
        at = np.sum(columns * bright) / np.sum(bright), np.sum(rows * bright) / np.sum(bright)
        x, y = tif.xy(at[1], at[0])
        lon, lat = Transformer.from_crs(tif.crs, "EPSG:4326", always_xy=True).transform(x, y)
    azimuth, _, away_m = Geod(ellps="WGS84").inv(11, 48, lon, lat)
    place = away_m * np.array([math.sin(math.radians(azimuth)), math.cos(math.radians(azimuth))])
    assert np.hypot(*(place - middle)) < 0.2
    assert "rises by 15 deg towards azimuth 100 deg" in depth(40, *options).err


def elevation_model(path, heights_m, cell_m=5.0):
    """Rows to the south, its middle at 48 north 11 east."""
    rasterio = pytest.importorskip("rasterio", reason="the extra terrain is not installed")
    x, y = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True).transform(11, 48)
    rows, columns = heights_m.shape
    transform = rasterio.Affine(cell_m, 0, x - columns / 2 * cell_m, 0, -cell_m, y + rows / 2 * cell_m)
    profile = {"driver": "GTiff", "height": rows, "width": columns, "count": 1, "dtype": "float64"}
    with rasterio.open(path, "w", **profile, crs="EPSG:32632", transform=transform) as dataset:
        dataset.write(heights_m, 1)
    return path


def test_on_terrain_a_ridge_hides_what_is_behind_it(depth, tmp_path):
    """30 m high, 60 to 70 m north, seen from 50 m: it hides the ground as far as 70 * 50 / 20 = 175 m."""
    north = 400.0 - 5.0 * np.arange(161)
    heights = np.repeat(np.where((north > 59) & (north < 71), 30.0, 0.0)[:, None], 161, axis=1) + 500.0
    model = elevation_model(tmp_path / "ridge.tif", heights)
    options = ("--terrain", model, "--lat", 48, "--lon", 11, "--image", tmp_path / "image.png", "--step", 1)
    found = depth(60, *options, "--json")
    assert (found.code, found.err) == (0, "")
    assert found.json["ground"]["kind"] == "terrain"
    assert found.json["ground"]["cell_m"] == pytest.approx(5.0, rel=0.01)
    assert found.json["z_m"] == pytest.approx([0.0, 30.0], abs=0.1)
    assert found.json["range_std_m"] is None
    assert any("hidden" in note for note in found.json["notes"])
    with np.load(tmp_path / "out/depth.npz") as arrays:
        assert "range_std_m" not in arrays
        ahead = arrays["north_m"][:, 159]
    assert not np.any((ahead > 77) & (ahead < 165))
    assert np.any(ahead > 185)
    assert np.any((ahead > 60) & (ahead < 75))
    view = cv2.imread(str(tmp_path / "out/topview.png"), cv2.IMREAD_UNCHANGED)
    about = found.json["top_view"]
    column, rows = int(-about["west_enu_m"]), np.ceil(about["north_enu_m"] - np.array([185.0, 120.0, 40.0])).astype(int)
    assert view[rows, column, 3].tolist() == [255, 0, 255]
    assert len(orjson.loads((tmp_path / "out/footprint.geojson").read_bytes())["features"]) == 1
    assert found.json["footprint_area_m2"] > 10_000
    assert "terrain of 5" in depth(60, *options).err


def test_a_camera_that_sees_no_terrain_says_so(depth, tmp_path):
    model = elevation_model(tmp_path / "small.tif", np.full((9, 9), 500.0))
    found = depth(80, "--terrain", model, "--lat", 48, "--lon", 11)
    assert (found.code, found.out) == (4, b"")
    assert "or the terrain ends before" in found.last
