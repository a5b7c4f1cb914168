"""Boards that a lens is calibrated with: chessboards and ChArUco boards, and how they are named."""

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import cv2
import numpy as np

from aerodft.errors import UsageError
from aerodft.model.arrays import FloatArray, ImageArray, IntArray

DEFAULT_CHARUCO: Final = "charuco:10x7:25mm:18mm:4X4_50"
"""What ``charuco`` alone means: 250 x 175 mm, on one sheet of A4."""

_PER_M: Final = {"mm": 1000.0, "cm": 100.0, "m": 1.0}
_LENGTH = re.compile(r"(\d+(?:\.\d+)?|\.\d+)(mm|cm|m)")
_GRID = re.compile(r"(\d{1,3})x(\d{1,3})")
_FEWEST_CORNERS, _MOST_ALONG = 3, 100
_EXPECTED = "chessboard:9x6:25mm (inner corners), charuco, or charuco:10x7:25mm:18mm:4X4_50 (squares)"
_PREFIX = "DICT_"


class BoardKind(StrEnum):
    """What is printed on a board."""

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
        """How many inner corners it has."""
        return self.columns * self.rows

    @property
    def text(self) -> str:
        """As the command line names it."""
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
            ``charuco:COLSxROWS:SQUARE:MARKER:DICT`` with squares, likewise; or ``charuco``. Lengths as ``25mm``.

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
        raise UsageError("--board", got=text, expected=_EXPECTED)
    if min(board.columns, board.rows) < _FEWEST_CORNERS:
        got = f"{board.columns} x {board.rows} inner corners"
        raise UsageError(f"--board {text}", got=got, expected=f"at least {_FEWEST_CORNERS} each way")
    return board


def _grid(text: str, board: str) -> tuple[int, int]:
    match = _GRID.fullmatch(text)
    if match is None or not 1 <= max(int(match[1]), int(match[2])) <= _MOST_ALONG:
        raise UsageError(f"--board {board}", got=text, expected=f"COLSxROWS, e.g. 9x6, at most {_MOST_ALONG} each way")
    return int(match[1]), int(match[2])


def _length_m(text: str, board: str) -> float:
    match = _LENGTH.fullmatch(text)
    if match is None or not float(match[1]) > 0:
        raise UsageError(f"--board {board}", got=text, expected="a length with its unit, e.g. 25mm")
    return float(match[1]) / _PER_M[match[2]]


def _dictionary(text: str, board: str) -> str:
    name = text.upper().removeprefix(_PREFIX)
    same = [known for known in dictionary_names() if known.upper() == name]
    if not same:
        raise UsageError(f"--board {board}", got=text, expected=f"one of {', '.join(dictionary_names())}")
    return same[0]


def _check_markers(board: Board, text: str) -> None:
    if not board.marker_m < board.square_m:
        got = f"markers of {board.marker_m * 1e3:g} mm"
        raise UsageError(f"--board {text}", got=got, expected=f"less than the squares' {board.square_m * 1e3:g} mm")
    needed = (board.columns + 1) * (board.rows + 1) // 2
    there = len(dictionary(board.dictionary).bytesList)
    if there < needed:
        got = f"{there} markers in {board.dictionary}"
        raise UsageError(f"--board {text}", got=got, expected=f"{needed}, one in every white square")


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
