"""Points of one image found again in another: images evened out, corners spread over them, followed there and back."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.vision.straight import grey_of

_EVENED_PX: Final = 31
_NOISE: Final = 4.0  # grey levels: what is flatter is not made to look structured
_GAIN: Final = 42.0  # grey levels for one standard deviation
_MIDDLE: Final = 128.5  # halves are rounded up
_COLUMNS: Final = 12
_IN_A_CELL: Final = 2
_BLOCK_PX: Final = 7
_APART_PX: Final = 15
_LEAST_STRENGTH: Final = 5e-4  # of evened images: grass seen from 10 m has 1e-3, plain walls and the sky less than 1e-4
_WINDOW_PX: Final = 21
_LEVELS: Final = 3
_STOP: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.005)
_RETURNED_PX: Final = 0.3  # how far from where it started a point may come back
_ALIKE: Final = 0.6  # correlation of the two templates: what covers a point is not taken for it
_PATCH: Final = np.stack(np.meshgrid(np.arange(-7, 8), np.arange(-7, 8)), axis=-1).reshape(1, -1, 2)


def evened(pixels: ImageArray) -> ImageArray:
    """Every pixel against mean and standard deviation of its neighbourhood.

    Args:
        pixels: ``(height, width, 3)`` BGR or ``(height, width)`` grey.

    Returns:
        ``(height, width)``; 128 where there is nothing but the mean.
    """
    grey, size, depth = grey_of(pixels), (_EVENED_PX, _EVENED_PX), cv2.CV_32F
    mean = cv2.boxFilter(grey, depth, size)
    variance = cv2.subtract(cv2.sqrBoxFilter(grey, depth, size), cv2.multiply(mean, mean))
    spread = cv2.sqrt(np.maximum(variance, 0.0)) + _NOISE
    detail = cv2.divide(cv2.subtract(grey, mean, dtype=depth), spread, scale=_GAIN)
    return np.asarray(np.clip(detail + _MIDDLE, 0.0, 255.0), dtype=np.uint8)


def spread_corners(evened: ImageArray, allowed: BoolArray) -> FloatArray:
    """The strongest corners (Shi and Tomasi 1994) of each cell of a grid.

    Args:
        evened: ``(height, width)``, see :func:`aerodft.vision.tracking.evened`.
        allowed: ``(height, width)``: where points may lie.

    Returns:
        ``(n, 2)`` whole pixels; none where the image is too flat.
    """
    strength = cv2.cornerMinEigenVal(evened, _BLOCK_PX)
    highest = cv2.dilate(strength, np.ones((_APART_PX, _APART_PX), dtype=np.uint8))
    peaks = (strength >= highest) & (strength > _LEAST_STRENGTH) & allowed
    rows, columns = np.nonzero(peaks)
    cell_px = evened.shape[1] / _COLUMNS
    cells = (rows // cell_px).astype(np.int64) * _COLUMNS + (columns // cell_px).astype(np.int64)
    order = np.lexsort((-strength[rows, columns], cells))
    rank = np.arange(len(order)) - np.searchsorted(cells[order], cells[order])
    kept = order[rank < _IN_A_CELL]
    return np.stack([columns[kept], rows[kept]], axis=-1).astype(np.float64)


def well_inside(camera: Camera, points_px: FloatArray, margin_px: float) -> BoolArray:
    """Which of the points ``(n, 2)`` are so far from the image's edges; NaN is outside."""
    farthest = np.array([camera.width_px, camera.height_px]) - 1 - margin_px
    return np.asarray(np.all((points_px >= margin_px) & (points_px <= farthest), axis=-1))


def followed(
    old: ImageArray, new: ImageArray, points_px: FloatArray, guess_px: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Find points again.

    Args:
        old: ``(height, width)``.
        new: ``(height, width)``.
        points_px: ``(n, 2)`` in ``old``.
        guess_px: ``(n, 2)``: where they are about in ``new``; a tenth of the image off is too far.

    Returns:
        Where they are ``(n, 2)``, and which were found ``(n,)``.
    """
    if not len(points_px):
        return points_px, np.zeros(0, dtype=np.bool_)
    there, found = _flow(old, new, points_px, guess_px)
    back, returned = _flow(new, old, there, points_px)
    same = found & returned & np.all(np.abs(back - points_px) <= _RETURNED_PX, axis=-1)
    return there, same & (_likeness(old, new, points_px, there) >= _ALIKE)


def _flow(
    old: ImageArray, new: ImageArray, points_px: FloatArray, guess_px: FloatArray
) -> tuple[FloatArray, BoolArray]:
    start, end = points_px.astype(np.float32), guess_px.astype(np.float32)
    there, status, _ = cv2.calcOpticalFlowPyrLK(
        old,
        new,
        start,
        end,
        winSize=(_WINDOW_PX, _WINDOW_PX),
        maxLevel=_LEVELS,
        criteria=_STOP,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return there.astype(np.float64), np.asarray(status[:, 0] > 0)


def _likeness(old: ImageArray, new: ImageArray, old_px: FloatArray, new_px: FloatArray) -> FloatArray:
    """Correlation ``(n,)`` of the patches around points."""
    patches = []
    for image, points_px in ((old, old_px), (new, new_px)):
        at = (points_px[:, None, :] + _PATCH).astype(np.float32)
        patch = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        patch = patch.astype(np.float64)
        patches.append(patch - np.mean(patch, axis=-1, keepdims=True))
    norms = np.linalg.norm(patches[0], axis=-1) * np.linalg.norm(patches[1], axis=-1)
    return np.asarray(np.sum(patches[0] * patches[1], axis=-1) / np.maximum(norms, 1.0))
