"""Boards that a lens is calibrated with: chessboards and ChArUco boards, their names, and their corners in images.

Corners are found to a few hundredths of a pixel, with how sharp they are.
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import cv2
import numpy as np

from aerodft.errors import UsageError
from aerodft.model import BoolArray, FloatArray, ImageArray, IntArray
from aerodft.vision.common import grey_of
from calibration.lens.adjustment import BoardView

DEFAULT_CHARUCO: Final = "charuco:10x7:25mm:18mm:4X4_50"
"""What ``charuco`` alone means: 250 x 175 mm, on one sheet of A4."""

_PER_M: Final = {"mm": 1000.0, "cm": 100.0, "m": 1.0}
_LENGTH = re.compile(r"(\d+(?:\.\d+)?|\.\d+)(mm|cm|m)")
_GRID = re.compile(r"(\d{1,3})x(\d{1,3})")
_MIN_ALONG, _MAX_ALONG = 3, 100
_EXPECTED = "chessboard:9x6:25mm (inner corners), charuco, or charuco:10x7:25mm:18mm:4X4_50 (squares)"
_PREFIX = "DICT_"
_SEARCHED_PX = 1600  # longer side of the picture that a board is looked for in; corners are refined in the whole one
_MIN_CORNERS = 8  # corners that are worth a pose of six unknowns
_CHESSBOARD_REACH = 0.3  # of a square: window of the refinement, clear of the next corners
_MIN_REACH_PX, _MAX_REACH_PX = 2, 15
_STRAYED_PX = 2.0  # a refinement that goes farther has found something else
_PROFILE = 0.4  # of a square, to either side of an edge
_STEP_PX = 0.5
_EVEN: Final = 5.0  # grey values: less contrast is no edge
_STOP: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
_OTHER_COUNTS: Final = ((-1, -1), (1, 1), (-2, -2), (0, -1), (-1, 0))


class BoardKind(StrEnum):
    """Pattern of a board."""

    CHESSBOARD = "chessboard"
    CHARUCO = "charuco"


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A flat board.

    Attributes:
        kind: What is printed on it.
        columns: Inner corners along its length, where four squares meet; for ChArUco, too.
        rows: Inner corners along its other side.
        square_m: Side of a square.
        marker_m: Side of a marker; 0 on a chessboard.
        dictionary: Of the markers, as OpenCV names it without ``DICT_``; empty on a chessboard.
    """

    kind: BoardKind
    columns: int
    rows: int
    square_m: float
    marker_m: float = 0.0
    dictionary: str = ""

    def points_m(self, ids: IntArray) -> FloatArray:
        """Places ``(n, 3)`` of corners ``(n,)`` on the board, which is the plane z = 0; row by row, from 0."""
        points = np.zeros((len(ids), 3))
        points[:, 0], points[:, 1] = ids % self.columns, ids // self.columns
        return points * self.square_m

    @property
    def corners(self) -> int:
        """Number of inner corners."""
        return self.columns * self.rows

    @property
    def text(self) -> str:
        """The board's name on the command line."""
        square = f"{self.square_m * 1e3:g}mm"
        if self.kind is BoardKind.CHESSBOARD:
            return f"chessboard:{self.columns}x{self.rows}:{square}"
        return f"charuco:{self.columns + 1}x{self.rows + 1}:{square}:{self.marker_m * 1e3:g}mm:{self.dictionary}"

    def __str__(self) -> str:
        square = f"{self.square_m * 1e3:g} mm"
        if self.kind is BoardKind.CHESSBOARD:
            return f"a chessboard of {self.columns} x {self.rows} inner corners, squares of {square}"
        return (
            f"a ChArUco board of {self.columns + 1} x {self.rows + 1} squares of {square}"
            f" with {self.dictionary} markers of {self.marker_m * 1e3:g} mm"
        )

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """The board as OpenCV knows it; ``ValueError`` for a chessboard."""
        if self.kind is not BoardKind.CHARUCO:
            raise ValueError("a chessboard has no markers")
        size = (self.columns + 1, self.rows + 1)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, dictionary(self.dictionary))


def dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of markers; ``name`` as in ``dictionary_names``."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, _PREFIX + name))


def dictionary_names() -> tuple[str, ...]:
    """The names of OpenCV's dictionaries of markers, without ``DICT_``, each once."""
    found = {getattr(cv2.aruco, name): name.removeprefix(_PREFIX) for name in dir(cv2.aruco) if _PREFIX in name}
    return tuple(sorted(found.values()))


def parse_board(text: str) -> Board:
    """A board from its name.

    Args:
        text: ``chessboard:COLSxROWS:SQUARE`` with inner corners as OpenCV counts them;
            ``charuco:COLSxROWS:SQUARE:MARKER:DICT`` with squares; or ``charuco``. Lengths as ``25mm``.

    Raises:
        UsageError: It is none of these, or no such board can be made.
    """
    kind, *parts = (DEFAULT_CHARUCO if text == BoardKind.CHARUCO else text).split(":")
    if kind == BoardKind.CHESSBOARD and len(parts) == len(("grid", "square")):
        columns, rows = _grid(parts[0], text)
        board = Board(kind=BoardKind.CHESSBOARD, columns=columns, rows=rows, square_m=_length_m(parts[1], text))
    elif kind == BoardKind.CHARUCO and len(parts) == len(("grid", "square", "marker", "dictionary")):
        columns, rows = _grid(parts[0], text)
        board = Board(
            kind=BoardKind.CHARUCO,
            columns=columns - 1,
            rows=rows - 1,
            square_m=_length_m(parts[1], text),
            marker_m=_length_m(parts[2], text),
            dictionary=_dictionary(parts[3], text),
        )
        _check_markers(board, text)
    else:
        raise UsageError("`board`", got=text, expected=_EXPECTED)
    if min(board.columns, board.rows) < _MIN_ALONG:
        got = f"{board.columns} x {board.rows} inner corners"
        raise UsageError(f"`board` {text}", got=got, expected=f"at least {_MIN_ALONG} each way")
    return board


def _grid(text: str, board: str) -> tuple[int, int]:
    match = _GRID.fullmatch(text)
    if match is None or not 1 <= max(int(match[1]), int(match[2])) <= _MAX_ALONG:
        raise UsageError(f"`board` {board}", got=text, expected=f"COLSxROWS, e.g. 9x6, at most {_MAX_ALONG} each way")
    return int(match[1]), int(match[2])


def _length_m(text: str, board: str) -> float:
    match = _LENGTH.fullmatch(text)
    if match is None or not float(match[1]) > 0:
        raise UsageError(f"`board` {board}", got=text, expected="a length with its unit, e.g. 25mm")
    return float(match[1]) / _PER_M[match[2]]


def _dictionary(text: str, board: str) -> str:
    name = text.upper().removeprefix(_PREFIX)
    same = [known for known in dictionary_names() if known.upper() == name]
    if not same:
        raise UsageError(f"`board` {board}", got=text, expected=f"one of {', '.join(dictionary_names())}")
    return same[0]


def _check_markers(board: Board, text: str) -> None:
    if not board.marker_m < board.square_m:
        got = f"markers of {board.marker_m * 1e3:g} mm"
        raise UsageError(f"`board` {text}", got=got, expected=f"less than the squares' {board.square_m * 1e3:g} mm")
    needed = (board.columns + 1) * (board.rows + 1) // 2
    there = len(dictionary(board.dictionary).bytesList)
    if there < needed:
        got = f"{there} markers in {board.dictionary}"
        raise UsageError(f"`board` {text}", got=got, expected=f"{needed}, one in every white square")


def draw_board(board: Board, px_per_m: float, margin_m: float) -> ImageArray:
    """A picture of a board to print, ``(h, w)`` uint8, with a white margin around it.

    Args:
        board: The board.
        px_per_m: Resolution; squares are as near to it as whole pixels are.
        margin_m: White around the squares.
    """
    square, margin = max(round(board.square_m * px_per_m), 8), round(margin_m * px_per_m)
    columns, rows = board.columns + 1, board.rows + 1
    if board.kind is BoardKind.CHARUCO:
        squares = np.asarray(board.charuco().generateImage((columns * square, rows * square)), dtype=np.uint8)
    else:
        odd = (np.arange(rows)[:, None] + np.arange(columns)) % 2
        squares = np.kron(odd.astype(np.uint8) * 255, np.ones((square, square), dtype=np.uint8))
    return np.pad(squares, margin, constant_values=255)


class BoardFinder:
    """Finds one board in images."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._charuco = cv2.aruco.CharucoDetector(board.charuco()) if board.kind is BoardKind.CHARUCO else None

    def find(self, image: ImageArray, name: str) -> BoardView | None:
        """The board's corners; None where it is not seen.

        Args:
            image: ``(h, w)`` grey or ``(h, w, 3)`` BGR, uint8.
            name: Of the image.
        """
        grey = grey_of(image)
        found = _chessboard(grey, self._board) if self._charuco is None else self._markers(grey)
        if found is None:
            return None
        ids, rough = found
        spans = _spans(self._board, ids)
        if not len(spans):
            return None
        reach_px = self._reach_px(rough, spans)
        whole = _inside(grey, rough, reach_px)
        if np.count_nonzero(whole) < _MIN_CORNERS:
            return None
        ids, pixels = ids[whole], _refined(grey, rough[whole], reach_px)
        spans = _spans(self._board, ids)
        return BoardView(
            name=name,
            ids=ids,
            pixels_px=pixels,
            points_m=self._board.points_m(ids),
            edge_px=_edge_width(grey, pixels, spans),
        )

    def _markers(self, grey: ImageArray) -> tuple[IntArray, FloatArray] | None:
        if self._charuco is None:
            return None
        small, scale = _shrunk(grey)
        found: tuple[np.ndarray | None, ...] = self._charuco.detectBoard(small)[:2]  # None where there are none
        corners, ids = found
        if corners is None or ids is None:
            return None
        return np.asarray(ids, dtype=np.int64).ravel(), _enlarged(np.asarray(corners), scale)

    def _reach_px(self, pixels: FloatArray, spans: IntArray) -> int:
        """Half the window of the refinement: nothing but the corner's own four squares may lie in it."""
        shortest = float(np.min(np.linalg.norm(pixels[spans[:, 1]] - pixels[spans[:, 0]], axis=-1)))
        share = _CHESSBOARD_REACH
        if self._board.kind is BoardKind.CHARUCO:
            share = min(share, (1 - self._board.marker_m / self._board.square_m) / 2)
        return int(np.clip(share * shortest, _MIN_REACH_PX, _MAX_REACH_PX))


def suggestion(image: ImageArray, board: Board) -> str:
    """Hint at the board that an image shows instead; empty where there is none that could be meant."""
    grey = _shrunk(grey_of(image))[0]
    if board.kind is BoardKind.CHARUCO:
        return _other_markers(grey, board)
    square = f"{board.square_m * 1e3:g}mm"
    for more_columns, more_rows in _OTHER_COUNTS:
        columns, rows = board.columns + more_columns, board.rows + more_rows
        if min(columns, rows) > 2 and _chessboard_corners(grey, columns, rows) is not None:  # noqa: PLR2004 - OpenCV's own least
            return f"one of {columns} x {rows} inner corners is there: try `board` chessboard:{columns}x{rows}:{square}"
    return ""


def _other_markers(grey: ImageArray, board: Board) -> str:
    counts = {}
    for name in dictionary_names():
        ids: np.ndarray | None = cv2.aruco.ArucoDetector(dictionary(name)).detectMarkers(grey)[1]
        counts[name] = 0 if ids is None else len(ids)
    best = max(counts, key=lambda name: (counts[name], name == board.dictionary))
    if counts[board.dictionary] > 1 and counts[board.dictionary] >= counts[best]:
        return f"{counts[board.dictionary]} {board.dictionary} markers are there: is COLSxROWS right?"
    return f"{counts[best]} markers of {best} are there: is that its dictionary?" if counts[best] > 1 else ""


def _shrunk(grey: ImageArray) -> tuple[ImageArray, float]:
    scale = min(1.0, _SEARCHED_PX / max(grey.shape))
    if scale == 1.0:
        return grey, 1.0
    size = (round(grey.shape[1] * scale), round(grey.shape[0] * scale))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8), scale


def _enlarged(pixels: np.ndarray, scale: float) -> FloatArray:
    return (pixels.reshape(-1, 2).astype(np.float64) + 0.5) / scale - 0.5


def _chessboard(grey: ImageArray, board: Board) -> tuple[IntArray, FloatArray] | None:
    small, scale = _shrunk(grey)
    corners = _chessboard_corners(small, board.columns, board.rows)
    return None if corners is None else (np.arange(board.corners), _enlarged(corners, scale))


def _chessboard_corners(grey: ImageArray, columns: int, rows: int) -> np.ndarray | None:
    found, corners = cv2.findChessboardCornersSB(grey, (columns, rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    return corners if found else None


def _spans(board: Board, ids: IntArray) -> IntArray:
    """``(m, 2)``: which of the corners are next to each other."""
    place = {int(corner): index for index, corner in enumerate(ids)}
    pairs = [
        (index, place[corner + step])
        for corner, index in place.items()
        for step in (1, board.columns)
        if corner + step in place and not (step == 1 and (corner + 1) % board.columns == 0)
    ]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _inside(grey: ImageArray, pixels: FloatArray, reach_px: int) -> BoolArray:
    """Which corners' windows lie within the image: one that is cut off draws its corner inwards."""
    height, width = grey.shape
    return np.asarray(np.all((pixels >= reach_px) & (pixels <= np.array([width, height]) - 1 - reach_px), axis=-1))


def _refined(grey: ImageArray, rough: FloatArray, reach_px: int) -> FloatArray:
    start = np.ascontiguousarray(rough[:, None], dtype=np.float32)
    fine = cv2.cornerSubPix(grey, start.copy(), (reach_px, reach_px), (-1, -1), _STOP)[:, 0].astype(np.float64)
    strayed = np.linalg.norm(fine - rough, axis=-1) > _STRAYED_PX
    return np.asarray(np.where(strayed[:, None], rough, fine))


def _edge_width(grey: ImageArray, pixels: FloatArray, spans: IntArray) -> float:
    """Median over the edges between neighbouring corners of contrast over steepest slope, in px."""
    along = pixels[spans[:, 1]] - pixels[spans[:, 0]]
    length = np.linalg.norm(along, axis=-1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1) / length[:, None]
    reach = max(_PROFILE * float(np.median(length)), 2.0)
    steps = np.arange(-reach, reach + _STEP_PX, _STEP_PX)
    middle = (pixels[spans[:, 0]] + pixels[spans[:, 1]]) / 2
    at = (middle[:, None] + steps[:, None] * across[:, None]).astype(np.float32)
    profile = cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    central = np.abs(steps) <= max(reach / 2, 2.0)
    slope = np.max(np.abs(np.diff(profile[:, central], axis=-1)), axis=-1) / _STEP_PX
    contrast = np.ptp(profile, axis=-1)
    clear = (contrast > _EVEN) & (slope > 0)
    return float(np.median(contrast[clear] / slope[clear])) if np.any(clear) else float("inf")
