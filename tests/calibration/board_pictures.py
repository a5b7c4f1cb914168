"""Pictures of boards through a known lens: OpenCV undistorts quarters of pixels, whose rays meet the board."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from calibration.lens import draw_board
from calibration.lens.board import BoardKind

SQUARE_TEXELS = 32
WHITE_SQUARES = 0.8  # of a square: the margin around the board
FINE = 2  # samples along each side of a pixel
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-12)


@dataclass(frozen=True)
class TrueCamera:
    """The lens that pictures are taken with, in OpenCV's terms."""

    width: int
    height: int
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, ...]
    fisheye: bool = False

    @property
    def matrix(self):
        return np.array([[self.focal[0], 0.0, self.centre[0]], [0.0, self.focal[1], self.centre[1]], [0.0, 0.0, 1.0]])

    @property
    def parameters(self):
        return np.array([*self.focal, *self.centre, *self.distortion])

    def project(self, points, rotvec, move):
        """Pixels ``(n, 2)`` of board points ``(n, 3)``, by OpenCV."""
        points, distortion = np.asarray(points, dtype=np.float64).reshape(-1, 1, 3), np.array(self.distortion)
        project = cv2.fisheye.projectPoints if self.fisheye else cv2.projectPoints
        return project(points, np.asarray(rotvec), np.asarray(move), self.matrix, distortion)[0].reshape(-1, 2)


@cache
def _rays(camera):
    """``(n, 1, 2)`` of all samples of all pixels, one ahead; the board is never behind."""
    u = (np.arange(camera.width * FINE) + 0.5) / FINE - 0.5
    v = (np.arange(camera.height * FINE) + 0.5) / FINE - 0.5
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
    distortion = np.array(camera.distortion)
    if camera.fisheye:
        flat = cv2.fisheye.undistortPoints(pixels, camera.matrix, distortion, criteria=STOP)
    else:
        flat = cv2.undistortPoints(pixels, camera.matrix, distortion, criteria=STOP)
    return flat.astype(np.float32)


def picture(camera, board, rotvec, move, *, blur_px=0.6, noise=2.0, seed=0):
    """``(h, w, 3)`` uint8 BGR of a board over grey ground.

    Args:
        camera: Who looks.
        board: What it looks at.
        rotvec: ``cam_SO3_board`` as a rotation vector.
        move: Of the board's first inner corner, in camera axes, m.
        blur_px: Standard deviation of what the lens blurs.
        noise: Standard deviation of grey values.
        seed: Of the noise.
    """
    texture = draw_board(board, SQUARE_TEXELS / board.square_m, WHITE_SQUARES * board.square_m)
    rotation = cv2.Rodrigues(np.asarray(rotvec, dtype=np.float64))[0]
    from_board = np.column_stack([rotation[:, :2], move])  # (x, y, 1) on the board to a ray
    scale = SQUARE_TEXELS / board.square_m
    offset = SQUARE_TEXELS + round(WHITE_SQUARES * SQUARE_TEXELS) - 0.5
    to_texels = np.array([[scale, 0.0, offset], [0.0, scale, offset], [0.0, 0.0, 1.0]]) @ np.linalg.inv(from_board)
    at = cv2.perspectiveTransform(_rays(camera), to_texels).reshape(camera.height * FINE, camera.width * FINE, 2)
    # OpenCV's coordinates end at 32767, and a picture of a board is smaller by far.
    at = np.clip(at, -100.0, 30_000.0)
    fine = cv2.remap(texture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=120).astype(np.float32)
    coarse = cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    grey = 25.0 + 0.8 * cv2.GaussianBlur(coarse, (0, 0), blur_px)
    grey += np.random.default_rng(seed).normal(0.0, noise, grey.shape)
    return cv2.cvtColor(np.clip(np.rint(grey), 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


def poses(camera, board, count, *, seed=0, turn_rad=0.6, whole=True):
    """Rotation vectors and places of boards that are seen as a whole, or by half, all over the image."""
    rng = np.random.default_rng(seed)
    points = board.points_m(np.arange(board.corners))
    middle, length = points.mean(axis=0), np.ptp(points[:, 0])
    found: list = []
    while len(found) < count:
        rotvec = rng.uniform(-turn_rad, turn_rad, 3)
        depth = camera.focal[0] * length / (camera.width * rng.uniform(0.3, 0.75))
        aim = rng.uniform([0.1, 0.1], [0.9, 0.9]) * [camera.width, camera.height]
        place = (aim - camera.centre) / camera.focal * depth
        move = np.array([*place, depth]) - cv2.Rodrigues(rotvec)[0] @ middle
        outline = _outline(board) if whole else points
        inside = camera.project(outline, rotvec, move)
        inside = np.all((inside > 2) & (inside < [camera.width - 3, camera.height - 3]), axis=1)
        if np.mean(inside) >= (1.0 if whole else 0.6):
            found.append((rotvec, move))
    return found


def _outline(board):
    """Corners of the white margin; a chessboard is only found as a whole."""
    reach = 1.0 + (WHITE_SQUARES if board.kind is BoardKind.CHESSBOARD else 0.0)
    columns, rows = board.columns - 1 + reach, board.rows - 1 + reach
    return np.array([[-reach, -reach, 0], [columns, -reach, 0], [-reach, rows, 0], [columns, rows, 0]]) * board.square_m
