"""Points of an image that can be found again, spread over all of it."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray

_COLUMNS: Final = 12
_IN_A_CELL: Final = 2
_BLOCK_PX: Final = 7
_APART_PX: Final = 15
_LEAST_STRENGTH: Final = 5e-4  # of evened images: grass seen from 10 m has 1e-3, plain walls and the sky less than 1e-4


def spread_corners(evened: ImageArray, allowed: BoolArray) -> FloatArray:
    """The strongest corners (Shi and Tomasi 1994) of each cell of a grid.

    Args:
        evened: ``(height, width)``, see :func:`aerodft.vision.evened.evened`.
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
