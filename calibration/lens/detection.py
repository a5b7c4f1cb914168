"""A board's corners in one image, to a few hundredths of a pixel, and how sharp they are."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray, IntArray
from aerodft.vision.straight import grey_of
from calibration.lens.adjustment import View
from calibration.lens.board import Board, BoardKind, dictionary, dictionary_names

_SEARCHED_PX = 1600  # longer side of the picture that a board is looked for in; corners are refined in the whole one
_FEWEST = 8  # corners that are worth a pose of six unknowns
_CHESSBOARD_REACH = 0.3  # of a square: window of the refinement, clear of the next corners
_LEAST_REACH_PX, _MOST_REACH_PX = 2, 15
_STRAYED_PX = 2.0  # a refinement that goes farther has found something else
_PROFILE = 0.4  # of a square, to either side of an edge
_STEP_PX = 0.5
_EVEN: Final = 5.0  # grey values: less contrast is no edge
_STOP: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
_OTHER_COUNTS: Final = ((-1, -1), (1, 1), (-2, -2), (0, -1), (-1, 0))


class BoardFinder:
    """Finds one board in images."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._charuco = cv2.aruco.CharucoDetector(board.charuco()) if board.kind is BoardKind.CHARUCO else None

    def find(self, image: ImageArray, name: str) -> View | None:
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
        if np.count_nonzero(whole) < _FEWEST:
            return None
        ids, pixels = ids[whole], _refined(grey, rough[whole], reach_px)
        spans = _spans(self._board, ids)
        return View(
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
        return int(np.clip(share * shortest, _LEAST_REACH_PX, _MOST_REACH_PX))


def suggestion(image: ImageArray, board: Board) -> str:
    """What board an image shows instead, as a hint; empty where there is none that could be meant."""
    grey = _shrunk(grey_of(image))[0]
    if board.kind is BoardKind.CHARUCO:
        return _other_markers(grey, board)
    square = f"{board.square_m * 1e3:g}mm"
    for more_columns, more_rows in _OTHER_COUNTS:
        columns, rows = board.columns + more_columns, board.rows + more_rows
        if min(columns, rows) > 2 and _chessboard_corners(grey, columns, rows) is not None:  # noqa: PLR2004 - OpenCV's own least
            return f"one of {columns} x {rows} inner corners is there: try --board chessboard:{columns}x{rows}:{square}"
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
