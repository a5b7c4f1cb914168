"""Boards' names and places against OpenCV's, and their corners in pictures against where they are."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from aerodft.errors import UsageError
from calibration.lens import DEFAULT_CHARUCO, BoardFinder, draw_board, parse_board, suggestion
from calibration.lens.board import BoardKind

from .board_pictures import TrueCamera, picture, poses

CAMERA = TrueCamera(960, 540, (800.0, 795.0), (490.0, 262.0), (-0.25, 0.08, 0.001, -0.0008))
CHESS, CHARUCO = parse_board("chessboard:9x6:25mm"), parse_board("charuco")


def test_a_chessboards_inner_corners_are_counted_and_a_charucos_squares():
    assert (CHESS.kind, CHESS.columns, CHESS.rows, CHESS.square_m) == (BoardKind.CHESSBOARD, 9, 6, 0.025)
    assert (CHARUCO.columns, CHARUCO.rows, CHARUCO.marker_m, CHARUCO.dictionary) == (9, 6, 0.018, "4X4_50")
    assert "9 x 6 inner corners" in str(CHESS)
    assert "10 x 7 squares" in str(CHARUCO)


@pytest.mark.parametrize("text", ["chessboard:9x6:25mm", DEFAULT_CHARUCO, "charuco:5x7:40mm:30mm:APRILTAG_36h11"])
def test_a_boards_text_names_the_same_board(text):
    assert parse_board(text).text == text
    assert parse_board(parse_board(text).text) == parse_board(text)


@pytest.mark.parametrize("text", ["chessboard:9x6:2.5cm", "chessboard:9x6:0.025m", "chessboard:9x6:25mm"])
def test_lengths_have_their_unit(text):
    assert_allclose(parse_board(text).square_m, 0.025)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("chess", "expected chessboard:9x6:25mm"),
        ("chessboard:9x6", "expected chessboard:9x6:25mm"),
        ("chessboard:9x6:25", "a length with its unit"),
        ("chessboard:9x6:0mm", "a length with its unit"),
        ("chessboard:9by6:25mm", "COLSxROWS"),
        ("chessboard:2x6:25mm", "at least 3 each way"),
        ("charuco:10x7:25mm:25mm:4X4_50", "less than the squares' 25 mm"),
        ("charuco:30x30:25mm:18mm:4X4_50", "50 markers in 4X4_50, expected 450"),
        ("charuco:10x7:25mm:18mm:4X4", "expected one of 4X4_100"),
    ],
)
def test_what_is_no_board_is_refused_in_a_sentence(text, said):
    with pytest.raises(UsageError) as refused:
        parse_board(text)
    assert said in str(refused.value)


def test_places_on_the_board_are_opencvs():
    theirs = np.array(CHARUCO.charuco().getChessboardCorners())
    assert_allclose(CHARUCO.points_m(np.arange(54)), theirs - theirs[0], atol=1e-7)


@pytest.mark.parametrize("board", [CHESS, CHARUCO], ids=["chessboard", "charuco"])
def test_the_printed_board_is_found_where_its_squares_are(board):
    drawn = draw_board(board, 2000.0, 0.02)
    view = BoardFinder(board).find(drawn, "drawn")
    assert view is not None
    want = (board.points_m(view.ids)[:, :2] + board.square_m + 0.02) * 2000.0 - 0.5
    assert_array_equal(view.ids, np.arange(54))
    turned = board.kind is BoardKind.CHESSBOARD and view.pixels_px[0, 0] > view.pixels_px[-1, 0]
    assert_allclose(view.pixels_px[::-1] if turned else view.pixels_px, want, atol=0.05)


@pytest.mark.parametrize("board", [CHESS, CHARUCO], ids=["chessboard", "charuco"])
def test_corners_are_found_to_a_few_hundredths_of_a_pixel(board):
    finder, off = BoardFinder(board), []
    for seed, (rotvec, move) in enumerate(poses(CAMERA, board, 5, seed=3, whole=board is CHESS)):
        view = finder.find(picture(CAMERA, board, rotvec, move, seed=seed), f"{seed}")
        assert view is not None, seed
        assert 1.5 < view.edge_px < 3.0
        ways = [view.pixels_px, view.pixels_px[::-1]] if board is CHESS else [view.pixels_px]  # from either end
        true = CAMERA.project(view.points_m, rotvec, move)
        off.append(min((way - true for way in ways), key=lambda each: float(np.sum(each * each))))
    off_px = np.concatenate(off)
    assert np.quantile(np.linalg.norm(off_px, axis=1), 0.95) < 0.1
    assert np.all(np.abs(np.mean(off_px, axis=0)) < 0.01)


def test_a_large_image_is_searched_small_and_refined_whole():
    large = TrueCamera(1920, 1080, (1600.0, 1590.0), (960.0, 535.0), (0.0, 0.0, 0.0, 0.0))
    rotvec, move = poses(large, CHESS, 1, seed=5)[0]
    view = BoardFinder(CHESS).find(picture(large, CHESS, rotvec, move), "large")
    assert view is not None
    true = large.project(view.points_m, rotvec, move)
    off = min(np.abs(view.pixels_px - true).max(), np.abs(view.pixels_px[::-1] - true).max())
    assert off < 0.1


def test_blur_is_measured():
    """The width of an edge of Gaussian blur is sqrt(2 pi) of its standard deviation."""
    rotvec, move = np.array([0.1, -0.1, 0.2]), np.array([-0.1, -0.06, 0.4])
    widths = []
    for blur_px in (0.6, 2.0, 3.0):
        view = BoardFinder(CHESS).find(picture(CAMERA, CHESS, rotvec, move, blur_px=blur_px, noise=0.5), "blurred")
        assert view is not None
        widths.append(view.edge_px)
    assert_allclose(widths[1:], np.sqrt(2 * np.pi) * np.array([2.0, 3.0]), rtol=0.15)
    assert widths[0] < widths[1] / 2


def test_without_the_board_there_is_no_view():
    noise = np.random.default_rng(0).integers(0, 255, (270, 480, 3)).astype(np.uint8)
    assert BoardFinder(CHESS).find(noise, "noise") is None
    assert BoardFinder(CHARUCO).find(noise, "noise") is None


def test_another_board_is_named():
    drawn = cv2.cvtColor(draw_board(CHESS, 1500.0, 0.02), cv2.COLOR_GRAY2BGR)
    assert "chessboard:9x6:25mm" in suggestion(drawn, parse_board("chessboard:10x7:25mm"))
    marked = cv2.cvtColor(draw_board(parse_board("charuco:7x5:30mm:22mm:6X6_250"), 2000.0, 0.02), cv2.COLOR_GRAY2BGR)
    assert "markers of 6X6_" in suggestion(marked, CHARUCO)
    assert suggestion(np.full((200, 300, 3), 90, np.uint8), CHESS) == ""
