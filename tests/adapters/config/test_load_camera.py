import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from aerodft.adapters.config.camera import camera_document, load_camera
from aerodft.errors import ConfigError
from aerodft.model import Camera, CameraStd, LensModel

CAMERAS = Path(__file__).parents[3] / "configs" / "cameras"
PAPER_TABLE_1 = {  # name: width, height, horizontal and vertical field of view
    "canon-1000d": (3888, 2592, 64.30, 45.30),
    "samsung-sdz-3750": (704, 576, 55.5, 42.5),
    "samsung-snb-3000": (640, 480, 35.67, 26.87),
    "dlink-dcs-2120": (320, 240, 49.60, 37.20),
    "nokia-n900": (2584, 1938, 44.90, 33.67),
    "logitech-webcam": (1600, 1200, 60.00, 45.00),
    "nao-robot": (640, 480, 27.84, 20.88),
}
FOV = 'name = "A"\nwidth_px = 100\nheight_px = 50\nhfov_deg = 90\n'
INTRINSICS = 'name = "A"\nwidth_px = 100\nheight_px = 50\nfx_px = 80\nfy_px = 81.5\ncx_px = 48\ncy_px = 26\n'

COVARIANCE = "covariance = [[4.0, 3.9, 0, 0], [3.9, 4.0, 0, 0], [0, 0, 0.25, 0], [0, 0, 0, 0.25]]\n"


def camera_file(folder: Path, text: str) -> Path:
    path = folder / "camera.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", PAPER_TABLE_1)
def test_camera_of_the_paper_has_the_papers_figures(name: str) -> None:
    camera = load_camera(CAMERAS / f"{name}.toml")
    width, height, hfov_deg, vfov_deg = PAPER_TABLE_1[name]
    assert (camera.width_px, camera.height_px) == (width, height)
    assert math.degrees(camera.hfov_rad) == pytest.approx(hfov_deg, abs=1e-9)
    assert math.degrees(camera.vfov_rad) == pytest.approx(vfov_deg, abs=1e-9)
    assert (camera.cx_px, camera.cy_px) == ((width - 1) / 2, (height - 1) / 2)


def test_every_camera_file_that_we_ship_loads() -> None:
    names = {path.stem for path in CAMERAS.glob("*.toml")}
    assert names == {*PAPER_TABLE_1, "demo-1080p"}
    demo = load_camera(CAMERAS / "demo-1080p.toml")
    assert len(demo.distortion) == 5
    assert demo.cx_px != (demo.width_px - 1) / 2
    assert demo.std == CameraStd(focal_px=1.5, principal_point_px=1.0)


def test_horizontal_field_of_view_alone_means_square_pixels(tmp_path: Path) -> None:
    camera = load_camera(camera_file(tmp_path, FOV))
    assert camera.fx_px == camera.fy_px == pytest.approx(50.0)


def test_how_well_each_intrinsic_is_known(tmp_path: Path) -> None:
    text = INTRINSICS + "distortion = [0.1, 0, 0, 0]\ndistortion_std = [0.01, 0.02, 0, 0]\nfocal_std_px = 2\n"
    stated = load_camera(camera_file(tmp_path, text))
    assert stated.std == CameraStd(focal_px=2.0, distortion=(0.01, 0.02, 0.0, 0.0))
    full = load_camera(camera_file(tmp_path, INTRINSICS + COVARIANCE))
    assert full.covariance[:2] == ((4.0, 3.9, 0.0, 0.0), (3.9, 4.0, 0.0, 0.0))
    assert full.std == CameraStd()
    by_view = load_camera(camera_file(tmp_path, FOV + COVARIANCE))
    assert by_view.covariance == full.covariance


def test_intrinsics_are_taken_as_they_stand(tmp_path: Path) -> None:
    text = INTRINSICS + 'lens = "fisheye"\ndistortion = [0.1, 0, 0, 0]\nfocal_std_px = 2\n'
    camera = load_camera(camera_file(tmp_path, text))
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (80.0, 81.5, 48.0, 26.0)
    assert camera.lens is LensModel.FISHEYE
    assert camera.distortion == (0.1, 0.0, 0.0, 0.0)
    assert camera.std == CameraStd(focal_px=2.0)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "camera.toml: holds no keys: got an empty file, expected TOML tables and keys"),
        ("name = \n", "camera.toml: TOML syntax: Invalid value (at line 1, column 8); correct that line"),
        (FOV + "hfov = 3\n", "camera.toml: hfov: unknown key; did you mean hfov_deg?"),
        (FOV + "vfov_rad = 1\n", "camera.toml: vfov_rad: unknown key: expected vfov_deg (in degrees); write vfov_deg"),
        (FOV + "colour = 1\n", "camera.toml: colour: unknown key; known keys here are name, width_px, "),
        (FOV.replace("90", "190"), "camera.toml: hfov_deg: got 190, expected less than 180"),
        (FOV.replace("90", '"90"'), 'camera.toml: hfov_deg: got "90", expected a number'),
        (FOV.replace("90", "nan"), "camera.toml: hfov_deg: got nan, expected a finite number"),
        (FOV.replace("90", "true"), "camera.toml: hfov_deg: got true, expected a number"),
        (FOV.replace("100", "100.0"), "camera.toml: width_px: got 100.0, expected a whole number"),
        (FOV.replace("100", "0"), "camera.toml: width_px: got 0, expected more than 0"),
        (FOV.replace('name = "A"\n', ""), "camera.toml: name: got nothing, expected a value"),
        (FOV + "focal_std_px = -1\n", "camera.toml: focal_std_px: got -1, expected at least 0"),
        (FOV + "fx_px = 80\n", "got a field of view and fx_px, expected either hfov_deg and vfov_deg, or fx_px"),
        (FOV + "distortion = [0, 0, 0, 0]\n", "distortion: it stands beside a field of view, expected intrinsics; a "),
        (FOV.replace("hfov", "vfov"), "got neither field of view nor intrinsics, expected hfov_deg, dfov_deg, or fx"),
        (INTRINSICS.replace("cy_px = 26\n", ""), "camera.toml: cy_px: got nothing, expected all of fx_px, fy_px,"),
        (INTRINSICS + "distortion = [1]\n", "distortion: got 1 coefficient, expected 0 or 4 or 5 or 8 for a brown"),
        (INTRINSICS + "focal_std_px = 1e300\n", "camera.toml: focal_std_px: got 1e+300, expected at most 1e+12"),
        (INTRINSICS.replace("cy_px = 26", "cy_px = -1e300"), "cy_px: got -1e+300, expected at least -1e+12"),
        (INTRINSICS + "distortion_std = [1]\n", "distortion_std: got 1 of them, expected 0, as many as in distortion"),
        (
            FOV + "distortion_std = [0, 0, 0, 0]\n",
            "distortion_std: it stands beside a field of view, expected intrinsics",
        ),
        (
            INTRINSICS + f"focal_std_px = 0\n{COVARIANCE}",
            "focal_std_px: it stands beside covariance, expected one of the",
        ),
        (
            INTRINSICS + f"distortion = [0, 0, 0, 0]\n{COVARIANCE}",
            "got 4 rows, expected 8 rows of 8 numbers (fx, fy, c",
        ),
        (INTRINSICS + COVARIANCE.replace("3.9", "4.1"), "got correlations with an eigenvalue of -0.025, expected none"),
        (INTRINSICS + COVARIANCE.replace("[3.9", "[3.8"), "got [0][1] = 3.9 and [1][0] = 3.8, expected the same numb"),
        (INTRINSICS + COVARIANCE.replace("0.25", '"x"'), 'camera.toml: covariance[2][2]: got "x", expected a number'),
        (
            INTRINSICS + 'lens = "wide"\n',
            "camera.toml: lens: got \"wide\", expected one of 'brown', 'fisheye', 'division' or 'omnidirectional'",
        ),
    ],
)
def test_a_wrong_camera_file_is_refused_in_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_camera(camera_file(tmp_path, text))
    assert sentence in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 3


def test_files_that_are_no_toml_are_named_for_what_they_are(tmp_path: Path) -> None:
    photo = tmp_path / "photo.toml"
    photo.write_bytes(b"\xff\xd8\xff\xe0" + bytes(40))
    with pytest.raises(ConfigError, match=r"photo\.toml: not a text file: got a JPEG image, expected TOML"):
        load_camera(photo)
    video = tmp_path / "video.toml"
    with video.open("wb") as file:
        file.write(bytes(4) + b"ftyp")
        file.truncate(17 << 20)
    with pytest.raises(ConfigError, match=r"video\.toml: too large for a configuration: got an MP4 or MOV video of m"):
        load_camera(video)
    with pytest.raises(ConfigError, match=r"absent\.toml: no such file; check the path"):
        load_camera(tmp_path / "absent.toml")
    with pytest.raises(ConfigError, match="cannot be read: got a folder, expected a TOML file"):
        load_camera(tmp_path)


lengths = st.floats(1e-3, 1e6)
cameras = st.builds(
    Camera,
    name=st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1, max_size=20),
    width_px=st.integers(1, 10_000),
    height_px=st.integers(1, 10_000),
    fx_px=lengths,
    fy_px=lengths,
    cx_px=st.floats(-1e5, 1e5),
    cy_px=st.floats(-1e5, 1e5),
    lens=st.just(LensModel.BROWN),
    distortion=st.one_of([st.lists(st.floats(-1, 1), min_size=n, max_size=n).map(tuple) for n in (0, 4, 5, 8)]),
    std=st.builds(CameraStd, focal_px=st.floats(0, 100), principal_point_px=st.floats(0, 100)),
)


@st.composite
def known_cameras(draw: st.DrawFn) -> Camera:
    """Cameras with stds of their distortion, or a covariance of all, or neither."""
    camera = draw(cameras)
    count = len(camera.distortion)
    if draw(st.booleans()):
        stds = draw(st.lists(st.floats(0, 0.1), min_size=count, max_size=count).map(tuple))
        return replace(camera, std=replace(camera.std, distortion=stds))
    if draw(st.booleans()):
        root = np.random.default_rng(draw(st.integers(0, 99))).normal(size=(4 + count, 9))
        return replace(camera, std=CameraStd(), covariance=tuple(map(tuple, (root @ root.T).tolist())))
    return camera


@given(camera=known_cameras())
def test_a_camera_survives_its_own_file(tmp_path_factory: pytest.TempPathFactory, camera: Camera) -> None:
    path = tmp_path_factory.getbasetemp() / "round.toml"
    path.write_text(tomli_w.dumps(camera_document(camera)))
    assert load_camera(path) == camera


def by_field(folder: Path, keys: str, size_px: tuple[int, int] = (5472, 3648)) -> Camera:
    text = f'name = "A"\nwidth_px = {size_px[0]}\nheight_px = {size_px[1]}\n{keys}\n'
    return load_camera(camera_file(folder, text))


def test_the_diagonal_field_of_view_is_the_angle_between_opposite_corners(tmp_path: Path) -> None:
    camera = by_field(tmp_path, "dfov_deg = 84\nfocal_std_px = 30")
    corners = np.array([[-0.5, -0.5], [5471.5, 3647.5]])
    rays = np.column_stack([(corners - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px], np.ones(2)])
    cosine = rays[0] @ rays[1] / np.linalg.norm(rays, axis=1).prod()
    assert math.degrees(math.acos(cosine)) == pytest.approx(84, abs=1e-9)
    assert camera.fx_px == camera.fy_px
    assert camera.std.focal_px == 30


@pytest.mark.parametrize(
    ("keys", "hint"),
    [
        ("hfov_deg = 84\nvfov_deg = 84", "a diagonal? write dfov_deg = 84 alone"),
        ("hfov_deg = 84\nvfov_deg = 53.1", "a diagonal? write dfov_deg = 84 alone"),
        ("hfov_deg = 73.7\nvfov_deg = 84", "a diagonal? write dfov_deg = 84 alone"),
        ("hfov_deg = 53.1\nvfov_deg = 73.7", "swapped? write hfov_deg = 73.7 and vfov_deg = 53.1"),
        ("hfov_deg = 50\nvfov_deg = 20", "remove the wrong one, or state pixels of this shape by fx_px"),
    ],
)
def test_fields_of_view_of_pixels_that_are_not_square_are_refused(tmp_path: Path, keys: str, hint: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(hint)):
        by_field(tmp_path, keys)


def test_pixels_that_are_not_square_are_stated_by_focal_lengths(tmp_path: Path) -> None:
    camera = by_field(tmp_path, "fx_px = 700\nfy_px = 500\ncx_px = 351.5\ncy_px = 287.5", (704, 576))
    assert (camera.fx_px, camera.fy_px) == (700, 500)


@pytest.mark.parametrize("other", ["hfov_deg = 70", "vfov_deg = 50", "fx_px = 900"])
def test_a_diagonal_field_of_view_stands_alone(tmp_path: Path, other: str) -> None:
    with pytest.raises(ConfigError, match=r"beside dfov_deg|a field of view and fx_px"):
        by_field(tmp_path, f"dfov_deg = 84\n{other}")
