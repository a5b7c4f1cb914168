"""``aerodft calibrate-lens`` from pictures of boards through a known lens, as files and as a video."""

import tomllib
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image as PillowImage

from aerodft.adapters.config.camera import load_camera
from calibration.lens import DEFAULT_CHARUCO, BoardFinder, distortion_px, intrinsics_of, parse_board

from ..calibration.board_pictures import (  # noqa: TID252 - test folders are no packages that could be named
    STOP,
    TrueCamera,
    picture,
    poses,
)

SIZE = (960, 540)
CAMERA = TrueCamera(*SIZE, (800.0, 795.0), (490.0, 262.0), (-0.25, 0.08, 0.001, -0.0008))
FISHEYE = TrueCamera(*SIZE, (400.0, 398.0), (490.0, 262.0), (0.05, -0.02, 0.01, -0.004), fisheye=True)
CHESS = "chessboard:9x6:25mm"


def write_pictures(folder, camera, board, found, *, suffix=".png", **way):
    folder.mkdir(exist_ok=True)
    for index, (rotvec, move) in enumerate(found):
        image = picture(camera, parse_board(board), rotvec, move, seed=index, **way)
        cv2.imwrite(str(folder / f"p{index:02}{suffix}"), image)
    return folder


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """14 pictures of a chessboard, and two blurred ones."""
    board = parse_board(CHESS)
    folder = tmp_path_factory.mktemp("photos")
    write_pictures(folder, CAMERA, CHESS, poses(CAMERA, board, 14))
    for index, (rotvec, move) in enumerate(poses(CAMERA, board, 2, seed=9)):
        image = picture(CAMERA, board, rotvec, move, seed=index, blur_px=3.5)
        cv2.imwrite(str(folder / f"blurred{index}.png"), image)
    return folder


@pytest.fixture(scope="module")
def calibrated(photos, tmp_path_factory, aerodft):
    folder = tmp_path_factory.mktemp("calibrated")
    found = aerodft(
        "calibrate-lens", photos, "--board", CHESS, "-o", folder / "cam.toml", "--report", folder / "report", "--json"
    )
    assert found.code == 0, found.err
    return folder, found


def check_truth(camera, path):
    """Focal length, principal point, and how far the lens moves pixels all over the image, against OpenCV's."""
    found = load_camera(path)
    off = intrinsics_of(found)[:4] - camera.parameters[:4]
    stds = np.sqrt(np.diag(found.covariance))[:4]
    assert np.all(np.abs(off) < 3 * stds), off / stds
    assert np.all(np.abs(off[:2] / camera.parameters[:2]) < 0.003)
    u, v = np.meshgrid(np.linspace(0, SIZE[0] - 1, 25), np.linspace(0, SIZE[1] - 1, 15))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    undistort = cv2.fisheye.undistortPoints if camera.fisheye else cv2.undistortPoints
    flat = undistort(pixels, camera.matrix, np.array(camera.distortion), criteria=STOP)[:, 0]
    if camera.fisheye:  # from one whose pixels are apart as angles are
        radius = np.linalg.norm(flat, axis=1, keepdims=True)
        flat = flat / radius * np.arctan(radius)
    moved = pixels[:, 0] - (flat * camera.focal + camera.centre)
    apart = distortion_px(found, pixels[:, 0]) - moved
    assert np.sqrt(np.mean(np.sum(apart**2, axis=1))) < 0.3
    return found


def test_photos_of_a_chessboard_give_the_true_lens(calibrated):
    folder, found = calibrated
    camera = check_truth(CAMERA, folder / "cam.toml")
    document = found.json
    assert (document["status"], document["lens"], document["board"]) == ("ok", "brown", CHESS)
    assert (document["images"], document["with_board"], len(document["views"])) == (16, 16, 14)
    assert document["dropped"]["blurred"] == ["blurred0.png", "blurred1.png"]
    assert document["rms_px"] < 0.06
    assert_allclose(document["std"]["fx_px"], np.sqrt(camera.covariance[0][0]))
    assert document["camera"] == tomllib.loads((folder / "cam.toml").read_text())


def test_the_camera_file_says_where_it_comes_from_and_which_mode_it_is_of(calibrated):
    text = (calibrated[0] / "cam.toml").read_text()
    comments = " ".join(line.lstrip("# ") for line in text.splitlines() if line.startswith("#"))
    for part in ("9 x 6 inner corners", "14 views of 16 images", "px rms", "960 x 540 px", "zoom", "UTC"):
        assert part in comments
    assert "fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2" in comments


def test_measurements_carry_the_lens_uncertainty(calibrated, aerodft, tmp_path):
    path = calibrated[0] / "cam.toml"
    text = path.read_text()
    sure = tmp_path / "sure.toml"
    sure.write_text(text[: text.index("covariance = [")])
    ask = (
        "--height",
        20,
        "--tilt",
        45,
        "--std",
        "height=0,attitude=0,px=0",
        "--probe",
        "distance 200,300 700,310",
        "--json",
    )
    found, exact = aerodft("measure", "--camera", path, *ask), aerodft("measure", "--camera", sure, *ask)
    assert found.code == exact.code == 0
    assert exact.json[0]["std"] == 0.0
    assert 0 < found.json[0]["std"] < 0.02
    words = aerodft("measure", "--camera", path, *ask[:-1], "--explain").out.decode()
    assert "focal" in words
    assert "distortion" in words


def test_the_report_is_one_page_with_its_pictures_in_it(calibrated):
    folder, found = calibrated
    page = (folder / "report" / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 5
    assert "http:" not in page
    assert "https:" not in page
    assert all(part in page for part in ("fx_px", "14 views of 16 images", "blurred0.png"))
    for name in ("coverage", "residuals", "views", "distortion", "known"):
        path = folder / "report" / f"{name}.png"
        assert str(path) in found.json["files"]
        with PillowImage.open(path) as drawn:
            assert min(drawn.size) > 300


@pytest.mark.nightly
def test_a_video_of_a_charuco_board_gives_the_true_lens(tmp_path, aerodft):
    """The board moves from pose to pose; half of the images between them are near-duplicates."""
    board = parse_board("charuco")
    path = tmp_path / "board.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(10), options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for index, (rotvec, move) in enumerate(poses(CAMERA, board, 12, seed=4, whole=False)):
            image = picture(CAMERA, board, rotvec, move, seed=index)
            for shift in range(2):
                shifted = np.roll(image, shift, axis=1)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(shifted, format="bgr24")))
        container.mux(stream.encode())
    found = aerodft("calibrate-lens", path, "-o", tmp_path / "cam.toml", "--name", "Mavic, 1080p", "--json")
    assert found.code == 0, found.err
    assert check_truth(CAMERA, tmp_path / "cam.toml").name == "Mavic, 1080p"
    assert found.json["images"] == 24
    assert len(found.json["dropped"]["near_duplicate"]) == 12
    assert all(name.startswith("board.mp4#") for name in found.json["dropped"]["near_duplicate"])


def test_a_fisheye_is_found_as_one(tmp_path, aerodft):
    board = parse_board("charuco")
    folder = write_pictures(tmp_path / "p", FISHEYE, "charuco", poses(FISHEYE, board, 13, seed=6, whole=False))
    found = aerodft("calibrate-lens", folder, "--lens", "fisheye", "-o", tmp_path / "cam.toml")
    assert found.code == 0, found.err
    assert str(check_truth(FISHEYE, tmp_path / "cam.toml").lens) == "fisheye"
    assert "fx_px" in found.out.decode()


def test_a_board_to_print_is_true_in_size_and_found_again(tmp_path, aerodft):
    found = aerodft("calibrate-lens", "--print-board", tmp_path / "board.png", "--json")
    assert found.code == 0
    with PillowImage.open(tmp_path / "board.png") as printed:
        dots = printed.info["dpi"][0]
        pixels = np.array(printed.convert("L"))
    view = BoardFinder(parse_board(found.json["board"])).find(pixels, "printed")
    step_px = np.linalg.norm(view.pixels_px[1] - view.pixels_px[0])
    assert_allclose(step_px / dots * 25.4, 25.0, atol=0.01)
    assert pixels.shape[1] / dots * 25.4 < 297


def test_images_of_two_sizes_are_refused_in_a_sentence(photos, tmp_path, aerodft):
    cv2.imwrite(str(tmp_path / "z.png"), np.full((1080, 1920, 3), 90, np.uint8))
    found = aerodft(
        "calibrate-lens", photos / "p00.png", tmp_path / "z.png", "--board", CHESS, "-o", tmp_path / "c.toml"
    )
    assert found.code == 3
    assert found.last == (
        "aerodft: z.png: the images are not of one camera mode: got 1920 x 1080 px, expected 960 x 540 px, as p00.png"
        " has; a camera file belongs to one size, crop and zoom: calibrate each mode by itself"
    )
    assert not (tmp_path / "c.toml").exists()


def test_too_few_views_are_no_answer_and_no_file(photos, tmp_path, aerodft):
    found = aerodft(
        "calibrate-lens", photos / "p00.png", photos / "p01.png", "--board", CHESS, "-o", tmp_path / "c.toml"
    )
    assert found.code == 4
    assert "got 2 usable views of the board, expected 4, better 15; hold the board tilted" in found.last
    assert found.out == b""
    assert not (tmp_path / "c.toml").exists()


def test_another_board_is_bad_input_and_a_better_one_is_suggested(photos, tmp_path, aerodft):
    found = aerodft(
        "calibrate-lens", photos / "p00.png", "--board", "chessboard:10x7:25mm", "-o", tmp_path / "c.toml", "--json"
    )
    assert found.code == 3
    assert "expected a chessboard of 10 x 7 inner corners, squares of 25 mm" in found.last
    assert "try --board chessboard:9x6:25mm" in found.last


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        ((), 2, "no images"),
        (("--print-board", "b.png", "-o", "c.toml"), 2, "--output beside --print-board"),
        (("none.mp4",), 3, "none.mp4: no such file"),
        (("empty",), 3, "empty: holds no stills"),
        (("text.png",), 3, "text.png: image cannot be decoded"),
        (("text.mp4",), 3, "text.mp4: not a readable video: got text"),
        (("p.png", "--board", "chess"), 2, "--board: got chess"),
        (("p.png", "--lens", "prism"), 2, "prism"),
        (("--print-board", "b.svg"), 2, "b.svg: the name says another format: got .svg, expected .png"),
        (("--print-board", "none/b.png"), 3, "none/b.png: the board cannot be written"),
    ],
)
def test_bad_input_is_one_sentence(arguments, code, said, tmp_path, monkeypatch, aerodft):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for name in ("text.png", "text.mp4"):
        (tmp_path / name).write_text("no picture\n" * 20)
    cv2.imwrite("p.png", np.full((40, 60, 3), 90, np.uint8))
    found = aerodft("calibrate-lens", *arguments)
    assert found.code == code
    assert said in found.err
    assert found.out == b""


def test_help_says_what_board_is_meant_by_charuco(aerodft):
    assert DEFAULT_CHARUCO in aerodft("calibrate-lens", "--help").out.decode()


def test_what_cannot_be_written_is_one_sentence(photos, tmp_path, aerodft):
    found = aerodft("calibrate-lens", photos, "--board", CHESS, "-o", tmp_path / "none" / "cam.toml")
    assert found.code == 3
    assert "none/cam.toml: --output: got a folder that is missing; make the folder first" in found.last
    assert found.out == b""
