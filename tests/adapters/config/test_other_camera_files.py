"""Camera files of other tools, against projections by OpenCV in each tool's own convention."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import aerodft as ad
from aerodft.adapters.config.station import load_station
from aerodft.errors import ConfigError
from aerodft.geometry import pixels_from_rays

SIZE_PX = (1920, 1080)
F, FX, FY, CX, CY = 1390.0, 1400.0, 1390.0, 975.25, 530.75  # of the centre of the top-left pixel
K1, K2, P1, P2, K3, K4, K5, K6 = -0.05, 0.012, 0.0014, -0.0023, 0.003, 0.02, -0.004, 0.001
"""Distortion by OpenCV's names; of fisheye lenses k1 to k4."""
SHARED = Path(__file__).parents[4] / "shared" / "data" / "public" / "formats"

MATRIX = f"{{rows: 3, cols: 3, data: [{FX}, 0, {CX}, 0, {FY}, {CY}, 0, 0, 1]}}"
ROS = f"""image_width: 1920
image_height: 1080
camera_name: mast
camera_matrix: {MATRIX}
distortion_model: MODEL
distortion_coefficients: {{rows: 1, cols: 5, data: NUMBERS}}
"""
ROS_MESSAGE = f"""header:
  frame_id: mast
height: 1080
width: 1920
distortion_model: "plumb_bob"
D: [{K1}, 1.2e-2, {P1}, {P2}, {K3}]
K: [{FX}, 0.0, {CX}, 0.0, {FY}, {CY}, 0.0, 0.0, 1.0]
binning_x: 0
roi:
  x_offset: 0
  y_offset: 0
---
"""
KALIBR = f"""cam0:
  cam_overlaps: []
  camera_model: pinhole
  intrinsics: [{FX}, {FY}, {CX}, {CY}]
  distortion_model: MODEL
  distortion_coeffs: NUMBERS
  resolution: [1920, 1080]
  rostopic: /cam0/image_raw
"""
AGISOFT = f"""<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>MODEL</projection>
  <width>1920</width>
  <height>1080</height>
  <f>{F}</f>
  <cx>{CX + 0.5 - 960}</cx>
  <cy>{CY + 0.5 - 540}</cy>
  <b1>{FX - F}</b1>
  NUMBERS
</calibration>
"""
AGISOFT_EXPORT = f"""<document version="2.0.0"><chunk><sensors><sensor id="0" type="frame">
<resolution width="1920" height="1080"/>
<calibration type="frame" class="initial"><resolution width="1920" height="1080"/><f>1500</f></calibration>
<calibration type="frame" class="adjusted"><resolution width="1920" height="1080"/><f>{F}</f><b1>{FX - F}</b1>
<cx>{CX + 0.5 - 960}</cx><cy>{CY + 0.5 - 540}</cy><k1>{K1}</k1><k2>{K2}</k2><k3>{K3}</k3><p1>{P2}</p1><p2>{P1}</p2>
</calibration></sensor></sensors></chunk></document>
"""


def opencv_file(folder, name, distortion, extra=None):
    """A calibration as OpenCV itself writes it, in YAML, XML or JSON by the name's ending."""
    path = folder / name
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in {"image_width": 1920, "image_height": 1080, **(extra or {})}.items():
        storage.write(key, value)
    storage.write("camera_matrix", np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.array([distortion]))
    storage.release()
    return path.read_text()


def opensfm(kind, **values):
    lengths = {"focal_x": FX / 1920, "focal_y": FY / 1920, "c_x": (CX - 959.5) / 1920, "c_y": (CY - 539.5) / 1920}
    camera = {"projection_type": kind, "width": 1920, "height": 1080} | lengths | values
    return json.dumps({"v2 dji fc220 1920 1080 brown 0.73": camera})


def colmap(model, *numbers):
    return f"# Camera list with one line of data per camera:\n1 {model} 1920 1080 {' '.join(map(str, numbers))}\n"


def xml(**values):
    return "".join(f"<{key}>{value}</{key}>" for key, value in values.items())


CENTRE = (CX + 0.5, CY + 0.5)
BROWN_4, BROWN_5, BROWN_8 = [K1, K2, P1, P2], [K1, K2, P1, P2, K3], [K1, K2, P1, P2, K3, K4, K5, K6]
FISHEYE = [K1, K2, K3, K4]


def fill(text, model, numbers):
    return text.replace("MODEL", model).replace("NUMBERS", str(numbers))


CASES = {
    "ROS plumb_bob": (fill(ROS, "plumb_bob", BROWN_5), False, BROWN_5, None),
    "ROS rational": (fill(ROS, "rational_polynomial", BROWN_8), False, BROWN_8, None),
    "ROS equidistant": (fill(ROS, "equidistant", FISHEYE), True, FISHEYE, None),
    "ROS message": (ROS_MESSAGE, False, BROWN_5, None),
    "Kalibr radtan": (fill(KALIBR, "radtan", BROWN_4), False, BROWN_4, None),
    "Kalibr equidistant": (fill(KALIBR, "equidistant", FISHEYE), True, FISHEYE, None),
    "Kalibr none": (fill(KALIBR, "none", []), False, [0.0] * 4, None),
    "Agisoft frame": (fill(AGISOFT, "frame", xml(k1=K1, k2=K2, k3=K3, p1=P2, p2=P1)), False, BROWN_5, None),
    "Agisoft fisheye": (fill(AGISOFT, "fisheye", xml(k1=K1, k2=K2, k3=K3, k4=K4)), True, FISHEYE, None),
    "Agisoft export": (AGISOFT_EXPORT, False, BROWN_5, None),
    "OpenSfM brown": (opensfm("brown", k1=K1, k2=K2, p1=P1, p2=P2, k3=K3), False, BROWN_5, None),
    "OpenSfM radial": (opensfm("radial", k1=K1, k2=K2), False, [K1, K2, 0, 0], None),
    "OpenSfM fisheye_opencv": (opensfm("fisheye_opencv", k1=K1, k2=K2, k3=K3, k4=K4), True, FISHEYE, None),
    "OpenSfM perspective": (
        json.dumps({"a": {"projection_type": "perspective", "width": 1920, "height": 1080, "focal": 0.72, "k1": K1}}),
        False,
        [K1, 0, 0, 0],
        (0.72 * 1920, 0.72 * 1920, 959.5, 539.5),
    ),
    "OpenSfM fisheye, upright": (
        json.dumps({"projection_type": "fisheye", "width": 1080, "height": 1920, "focal": 0.72, "k1": K1, "k2": K2}),
        True,
        [K1, K2, 0, 0],
        (0.72 * 1920, 0.72 * 1920, 539.5, 959.5),
    ),
    "COLMAP OPENCV": (colmap("OPENCV", FX, FY, *CENTRE, *BROWN_4), False, BROWN_4, None),
    "COLMAP FULL_OPENCV": (colmap("FULL_OPENCV", FX, FY, *CENTRE, *BROWN_8), False, BROWN_8, None),
    "COLMAP OPENCV_FISHEYE": (colmap("OPENCV_FISHEYE", FX, FY, *CENTRE, *FISHEYE), True, FISHEYE, None),
    "COLMAP PINHOLE": (colmap("PINHOLE", FX, FY, *CENTRE), False, [0.0] * 4, None),
    "COLMAP RADIAL": (colmap("RADIAL", F, *CENTRE, K1, K2), False, [K1, K2, 0, 0], (F, F, CX, CY)),
    "COLMAP SIMPLE_RADIAL": (colmap("SIMPLE_RADIAL", F, *CENTRE, K1), False, [K1, 0, 0, 0], (F, F, CX, CY)),
    "COLMAP SIMPLE_PINHOLE": (colmap("SIMPLE_PINHOLE", F, *CENTRE), False, [0.0] * 4, (F, F, CX, CY)),
    "COLMAP RADIAL_FISHEYE": (colmap("RADIAL_FISHEYE", F, *CENTRE, K1, K2), True, [K1, K2, 0, 0], (F, F, CX, CY)),
}
"""Text, whether the lens is a fisheye, OpenCV's coefficients, and fx, fy, cx, cy where they are not those above."""


def rays():
    across, down = np.meshgrid(np.linspace(-0.6, 0.6, 7), np.linspace(-0.35, 0.35, 5))
    return np.column_stack([across.ravel(), down.ravel(), np.ones(across.size)])


def opencv_pixels(is_fisheye, distortion, intrinsics):
    fx, fy, cx, cy = intrinsics
    matrix, nothing = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.zeros(3)
    call = cv2.fisheye.projectPoints if is_fisheye else cv2.projectPoints
    pixels, _ = call(rays()[:, None], nothing, nothing, matrix, np.array(distortion, dtype=float))
    return pixels.reshape(-1, 2)


def check_camera(camera, is_fisheye, distortion, intrinsics=(FX, FY, CX, CY)):
    np.testing.assert_allclose(
        pixels_from_rays(camera, rays()), opencv_pixels(is_fisheye, distortion, intrinsics), atol=1e-6
    )


@pytest.mark.parametrize(("text", "is_fisheye", "distortion", "intrinsics"), CASES.values(), ids=CASES)
def test_cameras_of_other_tools_project_as_opencv_does(tmp_path, text, is_fisheye, distortion, intrinsics):
    path = tmp_path / "yard.txt"
    path.write_text(text)
    camera = ad.load_camera(path)
    check_camera(camera, is_fisheye, distortion, intrinsics or (FX, FY, CX, CY))
    assert {camera.width_px, camera.height_px} == {*SIZE_PX}
    assert camera.name == ("mast" if "camera_name" in text else "yard")


@pytest.mark.parametrize("name", ["camera.yml", "camera.xml", "camera.json"])
@pytest.mark.parametrize("distortion", [BROWN_5, BROWN_8, [*BROWN_5, 0, 0, 0, 0, 0, 0, 0, 0, 0]], ids=len)
def test_calibrations_that_opencv_writes_are_read(tmp_path, name, distortion):
    opencv_file(tmp_path, name, distortion)
    check_camera(ad.load_camera(tmp_path / name), False, distortion)


def test_opencvs_fisheye_sample_is_a_fisheye(tmp_path):
    opencv_file(tmp_path, "camera.yml", FISHEYE, {"fisheye_model": 1})
    check_camera(ad.load_camera(tmp_path / "camera.yml"), True, FISHEYE)


def test_opencvs_omnidirectional_camera_has_its_xi_first(tmp_path):
    opencv_file(tmp_path, "camera.yml", FISHEYE, {"xi": 1.2})
    camera = ad.load_camera(tmp_path / "camera.yml")
    assert (camera.lens, camera.distortion) == ("omnidirectional", (1.2, *FISHEYE))


SHARED_FILES = [each for each in sorted(SHARED.glob("*")) if each.suffix in {".yaml", ".yml", ".xml", ".json", ".txt"}]


@pytest.mark.parametrize("path", SHARED_FILES, ids=lambda path: path.name)
def test_the_shared_samples_are_one_camera(path):
    camera = ad.load_camera(path)
    centre_px = 959.0 if path.suffix == ".xml" else 959.5  # it states cx = -0.5 px from the image's centre
    assert (camera.fx_px, camera.cx_px) == (pytest.approx(1400, abs=1e-3), pytest.approx(centre_px))
    assert camera.distortion[:2] == (-0.05, 0.012)


def test_a_station_takes_another_tools_camera(tmp_path):
    (tmp_path / "camera.yaml").write_text(fill(ROS, "plumb_bob", BROWN_5))
    (tmp_path / "station.toml").write_text(
        '[station]\nname = "s"\n[camera]\nfile = "camera.yaml"\n[pose]\nheight_agl_m = 9\ntilt_deg = 45\n'
    )
    check_camera(load_station(tmp_path / "station.toml").pipeline.camera, False, BROWN_5)


PLUMB = fill(ROS, "plumb_bob", BROWN_5)
KALIBR_RADTAN = fill(KALIBR, "radtan", BROWN_4)
FRAME = fill(AGISOFT, "frame", xml(k1=K1))
REFUSED = [
    (fill(ROS, "thin_prism", BROWN_5), "distortion_model: got the lens model 'thin_prism', expected plumb_bob or"),
    (PLUMB.replace("1400.0", "x"), "camera_matrix: got 'x', expected a finite number"),
    (PLUMB.replace("1400.0", "-1400"), "camera_matrix: got a focal length of -1400 px, expected more than 0"),
    (PLUMB.replace("1400.0, 0,", "1400.0, 3,"), "camera_matrix: got a skew"),
    (
        PLUMB.replace("image_width: 1920", "image_width: 960"),
        "principal point cx: got 975.25 px in an image of 960 x 1080",
    ),
    (PLUMB.replace("image_width: 1920\n", ""), "image_width: got nothing, expected a finite number"),
    (PLUMB.replace("image_width: 1920", "image_width: 1920.5"), "image_width: got 1920.5, expected whole pixels"),
    (PLUMB.replace("image_width: 1920", "image_width: .nan"), "image_width: got '.nan', expected a finite number"),
    (ROS_MESSAGE.replace("binning_x: 0", "binning_x: 2"), "binning_x: got 2, expected an image of all pixels"),
    (ROS_MESSAGE.replace("x_offset: 0", "x_offset: 10"), "roi.x_offset: got 10, expected an image of all pixels"),
    (PLUMB + "a: [1\n", "YAML syntax (at line "),
    (PLUMB + "a: " + "[" * 20_000, "YAML syntax"),
    (PLUMB + "#" * 300_000, "too large for a camera's YAML"),
    (PLUMB.replace(str(K3), ", ".join([str(K3), *["0"] * 3, "0.1"])), "got 9 coefficients, expected at most 8"),
    (fill(KALIBR, "fov", [1.0]), "cam0.distortion_model: got the lens model 'fov', expected radtan or equidistant or"),
    (KALIBR_RADTAN.replace("pinhole", "omni"), "cam0.camera_model: got the lens model 'omni', expected pinhole"),
    (KALIBR_RADTAN + KALIBR_RADTAN.replace("cam0", "cam1"), "its cameras: got 2 cameras, expected one"),
    (KALIBR_RADTAN.replace("[1920, 1080]", "[1920]"), "cam0.resolution: got 1 number, expected 2"),
    (FRAME.replace("frame", "spherical"), "calibration.projection: got the lens model 'spherical', expected frame or"),
    (FRAME.replace("<k1>", "<b2>0.4</b2><k1>"), "calibration.b2: got 0.4, expected 0: no lens model here has it"),
    (FRAME.replace("<f>1390.0</f>", "<f/>"), "calibration.f: got nothing, expected a finite number"),
    (FRAME.replace("<calibration>", '<!DOCTYPE a [<!ENTITY b "c">]><calibration>'), "XML: a DOCTYPE"),
    (FRAME.replace("</calibration>", ""), "XML syntax"),
    (opensfm("spherical"), "the lens model 'spherical', expected perspective or simple_radial"),
    (opensfm("brown", focal_x=0), "focal_x: got 0, expected more than 0"),
    (opensfm("brown", c_x=0.498), "principal point cx: got"),
    (opensfm("brown", k1="x"), "k1: got 'x', expected a finite number"),
    (opensfm("brown").replace("}}", "}"), "JSON syntax"),
    (
        colmap("THIN_PRISM_FISHEYE", *range(12)),
        "MODEL: got the lens model 'THIN_PRISM_FISHEYE', expected SIMPLE_PINHOLE",
    ),
    (colmap("OPENCV", FX, FY, *CENTRE), "PARAMS: got 4 numbers, expected 8 of OPENCV: fx, fy, cx, cy, k1, k2, p1, p2"),
    (colmap("PINHOLE", FX, FY, *CENTRE) + "2 PINHOLE 64 48 50 50 32 24\n", "its cameras: got 2 cameras, expected one"),
    (colmap("PINHOLE", FX, FY, "x", 540), "cx: got 'x', expected a finite number"),
]


@pytest.mark.parametrize(("text", "sentence"), REFUSED, ids=[sentence[:40] for _, sentence in REFUSED])
def test_what_aerodft_does_not_have_is_refused_by_file_and_key(tmp_path, text, sentence):
    path = tmp_path / "camera.any"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        ad.load_camera(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert sentence in str(caught.value)


def test_aliases_of_aliases_cost_nothing(tmp_path):
    bomb = "".join(f"x{at}: &x{at} [{', '.join([f'*x{at - 1}'] * 9)}]\n" for at in range(1, 30))
    path = tmp_path / "camera.yaml"
    path.write_text(f"x0: &x0 [1, 1]\n{bomb}{PLUMB.replace(str(BROWN_5), '*x29')}")
    with pytest.raises(ConfigError, match="distortion_coefficients: got"):
        ad.load_camera(path)


FOREIGN = {
    "track.gpx": ('<?xml version="1.0"?><gpx version="1.1"><trk/></gpx>', "a GPX track", "no camera attitude"),
    "pyorc.json": (
        '{"height": 1080, "width": 1920, "gcps": {"src": [[1, 2]], "dst": [[3, 4]]}}',
        "pyorc's camera configuration",
        "name,u,v,X,Y,Z",
    ),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_files_that_no_reader_takes_are_named(tmp_path, name):
    text, kind, hint = FOREIGN[name]
    path = tmp_path / name
    path.write_text(text)
    calls = [lambda: ad.calibrate(path, camera=ad.load_camera(camera)), lambda: ad.diagnose(path)]
    camera = tmp_path / "camera.toml"
    camera.write_text('name = "c"\nwidth_px = 64\nheight_px = 48\nhfov_deg = 60\n')
    for call in calls if name != "pyorc.json" else calls[:1]:
        with pytest.raises(ad.InputError, match=hint) as caught:
            call()
        assert kind in str(caught.value)
