"""``aerodft measure`` against OpenCV, the paper's equations written out here, and Monte-Carlo."""

import json
import math
import subprocess
import sys
from pathlib import Path

import cv2
import jsonschema
import numpy as np
import pytest
from numpy.testing import assert_allclose
from pyproj import Geod

SCHEMA = Path(__file__).parents[2] / "docs/schema/measurement-1.json"
FX, FY, CX, CY = 1600.0, 1550.0, 990.0, 500.0
DISTORTION = (-0.12, 0.03, 1e-3, -2e-3, 0.004)
LENS = f"""
name = "lens"
width_px = 1920
height_px = 1080
fx_px = {FX}
fy_px = {FY}
cx_px = {CX}
cy_px = {CY}
distortion = {list(DISTORTION)}
"""
PLAIN = """
name = "plain"
width_px = 3888
height_px = 2592
hfov_deg = 64.3
vfov_deg = 45.3
"""


@pytest.fixture
def lens(tmp_path):
    path = tmp_path / "lens.toml"
    path.write_text(LENS)
    return path


@pytest.fixture
def plain(tmp_path):
    path = tmp_path / "plain.toml"
    path.write_text(PLAIN)
    return path


def ground_to_camera(tilt_deg, roll_deg):
    """Rows: the camera's right, down and forward in ground axes (X right, Y ahead, Z up)."""
    tilt, roll = math.radians(tilt_deg), math.radians(roll_deg)
    forward = np.array([0.0, math.sin(tilt), -math.cos(tilt)])
    level_right, level_down = np.array([1.0, 0.0, 0.0]), np.array([0.0, -math.cos(tilt), -math.sin(tilt)])
    right = math.cos(roll) * level_right + math.sin(roll) * level_down
    down = -math.sin(roll) * level_right + math.cos(roll) * level_down
    return np.stack([right, down, forward])


def opencv_pixels(points_m, height_m, tilt_deg, roll_deg):
    rotation = ground_to_camera(tilt_deg, roll_deg)
    moved = rotation @ np.array([0.0, 0.0, -height_m])
    matrix = np.array([[FX, 0.0, CX], [0.0, FY, CY], [0.0, 0.0, 1.0]])
    pixels, _ = cv2.projectPoints(
        np.array(points_m, dtype=np.float64), cv2.Rodrigues(rotation)[0], moved, matrix, np.array(DISTORTION)
    )
    return pixels[:, 0, :]


def probe_of(kind, pixels, *options):
    return " ".join([kind, *(f"{u!r},{v!r}" for u, v in np.asarray(pixels).tolist()), *options])


@pytest.mark.parametrize(("tilt_deg", "roll_deg"), [(0.0, 0.0), (35.0, -6.0), (62.0, 4.0)])
@pytest.mark.parametrize("elevation_m", [0.0, 1.5])
def test_pinhole_inverts_opencv(aerodft, lens, tilt_deg, roll_deg, elevation_m):
    height_m = 48.0
    ahead = height_m * math.tan(math.radians(tilt_deg))
    points = [(-9.0, ahead + 3.0, elevation_m), (11.0, ahead - 4.0, elevation_m)]
    pixels = opencv_pixels(points, height_m, tilt_deg, roll_deg)
    at = f"elevation={elevation_m}"
    found = aerodft(
        "measure", "--camera", lens, "--height", height_m, "--tilt", tilt_deg, "--roll", roll_deg, "--json",
        "--probe", probe_of("distance", pixels, at),
        "--probe", probe_of("position", pixels[:1], at),
        "--probe", probe_of("range", pixels[1:], at, "name=far"),
    )  # fmt: skip
    assert (found.code, found.err) == (0, "")
    distance, position, range_ = found.json
    assert [m["kind"] for m in found.json] == ["distance", "position", "range"]
    assert [m["name"] for m in found.json] == ["distance-1", "position-2", "far"]
    assert_allclose(distance["value"], math.dist(*points), atol=1e-6)
    assert_allclose(distance["ground_m"], points, atol=1e-6)
    assert_allclose(position["ground_m"], points[:1], atol=1e-6)
    assert_allclose(range_["value"], math.dist(points[1], (0.0, 0.0, height_m)), atol=1e-6)


def test_dft_is_the_paper_to_the_letter(aerodft, plain):
    """Eq. 2 to 7 on the paper's own camera, written out here."""
    height_m, tilt = 10.48, math.radians(67.0)
    pixels = [(1200.0, 1500.0), (2500.0, 900.0)]
    points = []
    for i, j in pixels:
        phi = (i - 3888 / 2) * math.radians(64.3) / 3888
        psi = tilt + (2592 / 2 - j) * math.radians(45.3) / 2592
        y_m = height_m * math.tan(psi)
        points.append((y_m * math.tan(phi), y_m))
    found = aerodft(
        "measure", "--camera", plain, "--height", height_m, "--tilt", 67, "--model", "dft", "--json",
        "--probe", probe_of("distance", pixels),
        "--probe", probe_of("range", pixels[:1]),
    )  # fmt: skip
    distance, range_ = found.json
    assert distance["model"] == "dft"
    assert_allclose(np.array(distance["ground_m"])[:, :2], points, rtol=1e-12)
    assert_allclose(distance["value"], math.dist(*points), rtol=1e-12)
    assert_allclose(range_["value"], math.sqrt(height_m**2 + points[0][0] ** 2 + points[0][1] ** 2), rtol=1e-12)


def test_stds_are_monte_carlos(aerodft, lens):
    """Every stated error drawn anew, pixels cast to the ground with OpenCV's own undistortion."""
    height_m, tilt_deg, pixels = 48.0, 50.0, np.array([(700.0, 560.0), (1400.0, 520.0)])
    found = aerodft(
        "measure", "--camera", lens, "--height", height_m, "--tilt", tilt_deg, "--json",
        "--std", "height=0.5,tilt=0.3,pan=0.4,roll=0.5,focal=6,px=1.5", "--probe", probe_of("distance", pixels),
    )  # fmt: skip
    (distance,) = found.json
    rng = np.random.default_rng(11)
    widths = []
    for _ in range(4000):
        zoom = 1 + rng.normal() * 6.0 / FX
        matrix = np.array([[FX * zoom, 0.0, CX], [0.0, FY * zoom, CY], [0.0, 0.0, 1.0]])
        seen = pixels + rng.normal(size=(2, 2)) * 1.5
        rays = cv2.undistortPoints(seen[:, None, :], matrix, np.array(DISTORTION))[:, 0, :]
        error = np.radians([0.3, 0.4, 0.5]) * rng.normal(size=3)
        rays = np.column_stack([rays, np.ones(2)]) @ cv2.Rodrigues(error)[0].T @ ground_to_camera(tilt_deg, 0.0)
        down = (height_m + 0.5 * rng.normal()) / -rays[:, 2]
        widths.append(math.dist(*(rays[:, :2] * down[:, None])))
    assert_allclose(distance["std"], np.std(widths), rtol=0.05)
    assert_allclose(distance["value"], np.mean(widths), atol=0.1 * distance["std"])
    assert_allclose(distance["ci95"], distance["value"] + 1.959964 * distance["std"] * np.array([-1, 1]), rtol=1e-6)


def test_latitude_and_longitude_put_it_on_the_map(aerodft, lens):
    found = aerodft(
        "measure", "--camera", lens, "--height", 50, "--tilt", 40, "--heading", 120, "--lat", -35.36, "--lon", 149.16,
        "--json", "--probe", f"position {CX},{CY}",
    )  # fmt: skip
    (point,) = found.json
    away_m = 50 * math.tan(math.radians(40))
    lon, lat, _ = Geod(ellps="WGS84").fwd(149.16, -35.36, 120.0, away_m)
    assert_allclose([point["geo"][0]["lat_deg"], point["geo"][0]["lon_deg"]], [lat, lon], atol=1e-8)
    assert_allclose(point["enu_m"][0][:2], [away_m * math.sin(2 * math.pi / 3), away_m * math.cos(2 * math.pi / 3)])
    assert point["pose"]["lat_deg"] == pytest.approx(-35.36)


def test_every_answer_follows_the_published_schema(aerodft, lens):
    found = aerodft(
        "measure", "--camera", lens, "--height", 50, "--tilt", 60, "--lat", 1, "--lon", 2, "--json",
        "--probe", "distance 812,604.5 1377,611", "--probe", "range 900,-20", "--probe", "position 5,5 elevation=70",
    )  # fmt: skip
    validator = jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text()))
    assert [m["status"] for m in found.json] == ["ok", "OUT_OF_IMAGE", "BELOW_SURFACE"]
    for measurement in found.json:
        validator.validate(measurement)


def test_every_answer_says_what_was_stated_and_what_assumed(aerodft, lens):
    asked = ("measure", "--camera", lens, "--height", 50, "--tilt", 0, "--probe", "range 990,500")
    (assumed,) = aerodft(*asked, "--json").json
    said = "assumed: height 0.5 m, tilt 1 deg, pan 0.3 deg, roll 0.3 deg; taken as exact: position, heading, focal"
    assert assumed["reasons"] == [said, "std of pixels assumed: 1 px"]
    assert assumed["std"] == pytest.approx(0.5, rel=2e-3)
    (partly,) = aerodft(*asked, "--json", "--std", "height=0.1,px=1").json
    said = "assumed: tilt 1 deg, pan 0.3 deg, roll 0.3 deg; taken as exact: position, heading"
    assert partly["reasons"] == [f"std stated: height 0.1 m; {said}, focal", "std of pixels stated: 1 px"]
    (more,) = aerodft(*asked, "--json", "--std", "height=0.1,px=0.5,focal=3,elevation=0.2").json
    pixels, elevation = "std of pixels stated: 0.5 px", "std of the elevation stated: 0.2 m"
    assert more["reasons"] == [f"std stated: height 0.1 m, focal 3 px; {said}", pixels, elevation]
    (exact,) = aerodft(*asked, "--json", "--std", "px=0,height=0,attitude=0").json
    assert exact["std"] == 0.0
    assert said in aerodft(*asked, "--std", "height=0.1").out.decode()


def test_a_focal_length_of_std_0_is_exact_whatever_its_camera_file_says(aerodft, lens, tmp_path):
    (tmp_path / "stated.toml").write_text(f"{lens.read_text()}\nfocal_std_px = 30.0\n")
    asked = ("--height", 50, "--tilt", 0, "--probe", "distance 300,500 900,500", "--json", "--std")
    (stated,) = aerodft("measure", "--camera", tmp_path / "stated.toml", *asked, "height=0,attitude=0,px=0").json
    assert stated["std"] > 0.1
    (exact,) = aerodft("measure", "--camera", tmp_path / "stated.toml", *asked, "height=0,attitude=0,px=0,focal=0").json
    assert exact["std"] == 0.0


def test_people_get_a_table(aerodft, lens):
    found = aerodft("measure", "--camera", lens, "--height", 50, "--tilt", 0, "--probe", "range 990,500")
    assert found.code == 0
    assert "50.000 m" in found.out.decode()


@pytest.mark.parametrize(
    ("probes", "code", "said"),
    [
        (["range 990,500", "range 5000,500"], 3, "pixel 0 (5000, 500) is outside the image of 1920 x 1080 px"),
        (["range 990,0"], 4, "deg above the horizon"),
        (["range 990,500", "range 990,0"], 0, "deg above the horizon"),
    ],
)
def test_misses_have_a_reason_and_an_exit_code(aerodft, lens, probes, code, said):
    asked = [word for probe in probes for word in ("--probe", probe)]
    found = aerodft("measure", "--camera", lens, "--height", 50, "--tilt", 80, "--json", *asked)
    assert found.code == code
    assert said in found.last
    assert found.json[-1]["value"] is None


POSE = ("--height", 50, "--tilt", 60)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--height", 50, "--tilt", 60), 2, "no --probe: expected e.g."),
        (("--tilt", 60, "--probe", "range 1,1"), 2, "no --height: expected 0.001 to 100000 m above the ground"),
        (("--height", 50, "--probe", "range 1,1"), 2, "no --tilt"),
        (
            ("--height", -3, "--tilt", 60, "--probe", "range 1,1"),
            3,
            "--height: got -3, expected 0.001 to 100000 m above",
        ),
        (("--height", "nan", "--tilt", 60, "--probe", "range 1,1"), 3, "--height: got nan"),
        (("--height", 50, "--tilt", 200, "--probe", "range 1,1"), 3, "--tilt: got 200"),
        (("--height", 50, "--tilt", -30, "--probe", "range 1,1"), 3, "pitch of -30 deg is a tilt of 60"),
        ((*POSE, "--roll", 300, "--probe", "range 1,1"), 3, "--roll: got 300"),
        ((*POSE, "--lat", 5, "--probe", "range 1,1"), 2, "--lat and --lon go together"),
        ((*POSE, "--lat", 95, "--lon", 0, "--probe", "range 1,1"), 3, "--lat: got 95"),
        ((*POSE, "--model", "dft", "--roll", 2, "--probe", "range 1,1"), 2, "the paper's camera does not roll"),
        ((*POSE, "--std", "hight=1", "--probe", "range 1,1"), 2, "got name 'hight', expected one of height, position"),
        ((*POSE, "--probe", "girth 1,1"), 2, "got kind 'girth', expected one of position, range, distance"),
        ((*POSE, "--probe", "distance 1,1"), 2, "got 1 pixel, expected 2 for distance"),
        ((*POSE, "--at", "5", "--probe", "range 1,1"), 2, "--recording and --at go together"),
    ],
)
def test_what_makes_no_sense_is_one_sentence(aerodft, lens, arguments, code, said):
    found = aerodft("measure", "--camera", lens, *arguments)
    assert found.code == code
    assert said in found.err
    assert found.err.startswith("aerodft: ")
    assert len(found.err.strip().splitlines()) == 1
    assert found.out == b""


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "camera.toml: no such file"),
        ("", "holds no keys: got an empty file"),
        ("width_px = ", "TOML syntax"),
        (PLAIN.replace("hfov_deg", "hfov_rad"), "hfov_rad: unknown key: expected hfov_deg (in degrees)"),
        (PLAIN.replace("64.3", "640.3"), "hfov_deg: got 640.3, expected less than 180"),
        (PLAIN.replace("3888", '"3888"'), 'width_px: got "3888", expected a whole number'),
    ],
)
def test_a_bad_camera_file_is_one_sentence(aerodft, tmp_path, content, said):
    path = tmp_path / "camera.toml"
    if content is not None:
        path.write_text(content)
    found = aerodft("measure", "--camera", path, *POSE, "--probe", "range 1,1")
    assert found.code == 3
    assert said in found.err
    assert str(path) in found.err
    assert len(found.err.strip().splitlines()) == 1


def test_no_camera_is_a_question_of_usage(aerodft):
    found = aerodft("measure", *POSE, "--probe", "range 1,1")
    assert (found.code, "no --camera" in found.err) == (2, True)


def test_as_a_process_stdout_is_json_alone(lens):
    command = [sys.executable, "-m", "aerodft", "measure", "--camera", str(lens), "--height", "50", "--tilt", "60"]
    good = subprocess.run([*command, "--json", "--probe", "range 990,500"], capture_output=True, check=False)
    assert (good.returncode, good.stderr) == (0, b"")
    assert json.loads(good.stdout)[0]["value"] == pytest.approx(100.0)
