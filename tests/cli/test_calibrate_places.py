"""Places come back in the coordinates that they were stated in, to people, in JSON and in the calibration file."""

import math
import re
import tomllib

import cv2
import numpy as np
import pytest

from .calibration_scene import (
    AXES,
    CENTRE_PX,
    EYE_M,
    FOCAL_PX,
    HEADING_DEG,
    HEIGHT_PX,
    POSE,
    RD_M,
    STD_PX,
    TILT_DEG,
    WIDTH_PX,
    Field,
    calibrate,
    landmarks,
    pixels_of,
)
from .conftest import run_aerodft

FIELD = Field.of()
FAR_M = np.array([533_000.0, 5_212_000.0, 0.0])


def figures(run):
    return {key: (each["value"], each["std"]) for key, each in run.json["parameters"].items()}


@pytest.mark.parametrize(("crs", "shift_m"), [("EPSG:28992", RD_M), ("local", FAR_M)])
def test_east_and_north_are_those_of_the_file(tmp_path, crs, shift_m):
    run, output = calibrate(tmp_path, f'crs = "{crs}"\n' + landmarks(FIELD.pixels, FIELD.places + shift_m), "--json")
    assert run.code == 0, run.err
    found = figures(run)
    for key, want in zip(("east_m", "north_m"), EYE_M + shift_m, strict=False):
        value, std = found[key]
        assert abs(value - want) < 4 * std
    np.testing.assert_allclose(run.json["position"][:2], [found["east_m"][0], found["north_m"][0]], atol=1e-9)
    pose = tomllib.loads(output.read_text())["pose"]
    if crs == "local":
        np.testing.assert_allclose([pose["east_m"], pose["north_m"]], run.json["position"][:2], atol=1e-9)
    else:
        assert "east_m" not in pose


def test_an_unknown_elevation_of_the_ground_is_in_the_files_heights(tmp_path):
    """Stated to a metre, and told to centimetres by ranges to the ground."""
    up_m, heading = RD_M[2], np.radians(HEADING_DEG)
    ahead = EYE_M + 15.0 * np.array([np.sin(heading), np.cos(heading), 0.0])
    u, v = pixels_of(np.array([[*ahead[:2], 0.0]]))[0]
    ranges = f"[[range]]\npixel = [{u:.2f}, {v:.2f}]\nrange_m = {np.hypot(15.0, EYE_M[2]):.4f}\nstd_m = 0.01\n"
    text = f'crs = "EPSG:28992"\nelevation_m = {{ value = {up_m + 0.7}, std = 1.0 }}\n'
    text += landmarks(FIELD.pixels, FIELD.places + RD_M) + ranges
    run, _ = calibrate(tmp_path, text, "--json", unknowns=f"{POSE},elevation")
    assert run.code == 0, run.err
    value, std = figures(run)["elevation_m"]
    assert std < 0.1
    assert abs(value - up_m) < 4 * std
    height, std = figures(run)["height_agl_m"]
    assert abs(height - EYE_M[2]) < 4 * std


def test_the_table_shows_what_the_std_leaves_of_large_coordinates(tmp_path):
    run, _ = calibrate(tmp_path, 'crs = "local"\n' + landmarks(FIELD.pixels, FIELD.places + FAR_M))
    assert run.code == 0, run.err
    row = next(line for line in run.out.decode().splitlines() if "east_m" in line)
    value, std = (float(cell) for cell in re.findall(r"[\d.]+", row))
    assert value == pytest.approx(FAR_M[0] + EYE_M[0], abs=4 * std)
    assert value != round(value)


UTM_M = np.array([500_120.0, 5_650_300.0, 210.0])


def gcp_list(head, seen):
    """OpenDroneMap's list; ``seen`` has image, pixels and places of each image's points."""
    rows = [
        f"{x:.4f}\t{y:.4f}\t{z:.4f}\t{u:.3f}\t{v:.3f}\t{image}\tgcp{index}"
        for image, pixels, places in seen
        for index, ((u, v), (x, y, z)) in enumerate(zip(pixels, places, strict=True), 1)
    ]
    return "\n".join([head, *rows, ""])


HEADS = (
    "EPSG:32632",
    "WGS84 UTM 32N",
    "WGS 84 / UTM zone 32N",
    "# by hand\nepsg: 32632 # two days later",
    "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs",
    "'+proj=utm +zone=32 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m +no_defs'",
)


@pytest.mark.parametrize("head", HEADS)
def test_lists_of_opendronemap_are_read(tmp_path, head):
    """Grid north is true north to 0.002 degrees here, and the grid's metres are 0.4 mm short."""
    field = Field.of(9)
    text = gcp_list(head, [("IMG_1.JPG", field.pixels, field.places + UTM_M)])
    run, output = calibrate(tmp_path, text, "--plane-elevation", "210", "--json", suffix=".txt")
    assert run.code == 0, run.err
    assert "heights count from the measured plane at 210 m, as stated" in run.err
    found = {name: each["value"] for name, each in run.json["parameters"].items()}
    stds = {name: each["std"] for name, each in run.json["parameters"].items()}
    truth = {"height_agl_m": EYE_M[2], "tilt_deg": TILT_DEG, "heading_deg": HEADING_DEG}
    for name, value in truth.items():
        assert abs(found[name] - value) < 4 * stds[name] + 0.002, name
    assert [each["name"] for each in run.json["residuals"]] == [f"gcp{index}" for index in range(1, 10)]
    assert output.is_file()


def test_of_several_images_one_is_chosen(tmp_path):
    field = Field.of(9)
    seen = [("a.jpg", field.pixels, field.places + UTM_M), ("b.jpg", field.pixels[:4], field.places[:4] + UTM_M)]
    run, _ = calibrate(tmp_path, gcp_list("EPSG:32632", seen), suffix=".txt")
    assert run.code == 3
    assert "got a.jpg (9), b.jpg (4), expected one image; name the one whose camera is meant by --image" in run.last
    run, _ = calibrate(tmp_path, gcp_list("EPSG:32632", seen), "--image", "b.jpg", "--json", suffix=".txt")
    assert run.code == 0, run.err
    assert len(run.json["residuals"]) == 4


@pytest.mark.parametrize(
    ("image", "name"), [("my yard 2.jpg", "my yard 2.jpg"), ('"my 2.jpg"', "my 2.jpg"), ("new/a.jpg", "old/a.jpg")]
)
def test_an_image_may_have_spaces_in_its_name_or_a_folder(tmp_path, image, name):
    field = Field.of(9)
    seen = [(image, field.pixels, field.places + UTM_M), ("b.jpg", field.pixels[:4], field.places[:4] + UTM_M)]
    run, _ = calibrate(tmp_path, gcp_list("EPSG:32632", seen), "--image", name, "--json", suffix=".txt")
    assert run.code == 0, run.err
    assert [each["name"] for each in run.json["residuals"]] == [f"gcp{index}" for index in range(1, 10)]


@pytest.mark.parametrize("head", ["PUWG1992", "WGS84 longlat"])
def test_a_list_without_a_known_projection_says_so(tmp_path, head):
    run, _ = calibrate(tmp_path, gcp_list(head, [("a.jpg", FIELD.pixels, FIELD.places)]), suffix=".txt")
    assert run.code == 3
    assert f'line 1: got "{head}", expected a projection like EPSG:32633' in run.last


def test_the_measured_plane_of_a_table_is_an_option(tmp_path):
    field = Field.of(9)
    rows = np.column_stack([field.pixels, field.places])
    text = "\n".join(["u,v,X,Y,Z", *(",".join(map(repr, row)) for row in rows.tolist()), ""])
    heights = {}
    for more in ((), ("--plane-elevation", "0.25")):
        run, _ = calibrate(tmp_path, text, "--json", *more, suffix=".csv")
        assert run.code == 0, run.err
        heights[more] = run.json["parameters"]["height_agl_m"]["value"]
        said = [note for note in run.json["notes"] if "measured plane" in note]
        assert len(said) == 1, run.json["notes"]
        assert ("0.25 m, as stated" if more else "--plane-elevation states another") in run.err
    assert heights[()] - heights[("--plane-elevation", "0.25")] == pytest.approx(0.25, abs=1e-6)


@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:28992", "EPSG:2154"])
def test_local_metres_under_a_code_are_told_so(tmp_path, crs):
    field = Field.of(9)
    run, _ = calibrate(tmp_path, f'crs = "{crs}"\n' + landmarks(field.pixels, field.places))
    assert run.code == 3
    assert 'they look like metres from a zero of your own: write crs = "local"' in run.last
    listed = tmp_path / "field.csv"
    rows = [",".join(map(str, each)) for each in np.column_stack([field.pixels, field.places]).tolist()]
    listed.write_text("\n".join(["u,v,x,y,z", *rows]))
    run = run_aerodft("calibrate", listed, "--camera", tmp_path / "camera.toml", "--crs", crs)
    assert run.code == 3
    assert "they look like metres from a zero of your own: take them as a CSV file with --crs local" in run.last


@pytest.mark.parametrize("by_view", [False, True])
def test_distortion_is_found_of_a_camera_file_without_any(tmp_path, by_view):
    field, bent = Field.of(24), np.array([-0.08, 0.02, 0.0, 0.0])
    matrix = np.array([[FOCAL_PX, 0.0, CENTRE_PX[0]], [0.0, FOCAL_PX, CENTRE_PX[1]], [0.0, 0.0, 1.0]])
    in_camera = (field.places - EYE_M) @ AXES.T
    pixels = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), matrix, bent)[0][:, 0]
    pixels += np.random.default_rng(3).normal(0.0, STD_PX, pixels.shape)
    lens = tmp_path / "lens.toml"
    intrinsics = f"fx_px = {FOCAL_PX}\nfy_px = {FOCAL_PX}\ncx_px = {CENTRE_PX[0]}\ncy_px = {CENTRE_PX[1]}\n"
    view = f"hfov_deg = {math.degrees(2 * math.atan(WIDTH_PX / 2 / FOCAL_PX))!r}\n"
    head = f'name = "straight"\nwidth_px = {WIDTH_PX}\nheight_px = {HEIGHT_PX}\n'
    lens.write_text(head + (view if by_view else intrinsics))
    evidence = tmp_path / "bent.toml"
    evidence.write_text('crs = "local"\n' + landmarks(pixels, field.places))
    names = f"{POSE},k1,k2"
    run = run_aerodft("calibrate", evidence, "--camera", lens, "--unknowns", names, "--json", "-o", tmp_path / "o.toml")
    assert run.code == 0, run.err
    for name, truth in (("k1", -0.08), ("k2", 0.02), ("tilt_deg", TILT_DEG)):
        found = run.json["parameters"][name]
        assert abs(found["value"] - truth) < 3 * found["std"], name
    assert len(tomllib.loads((tmp_path / "o.toml").read_text())["camera"]["distortion"]) == 4
