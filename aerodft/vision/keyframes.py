"""Images that others are held against: their corners, and whether a later view still shows them."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray, IntArray
from aerodft.vision.plane_errors import Standpoint
from aerodft.vision.stillness import Gone, Stillness
from aerodft.vision.straight import StraightView

FEWEST: Final = 12
"""Points that an image is held by, at least."""

MOST_CORNERS: Final = 160
_CELLS: Final = 8  # of the grid over which they are spread, along each side
_QUALITY: Final = 0.01
_APART_PX: Final = 6
_NEAR_PX: Final = 48.0  # of a probe ...
_MOST_NEAR: Final = 12  # ... that many in a cell
_MARGIN_PX: Final = 12.0
_SCALES: Final = (0.7, 1.45)  # a template that is seen larger or smaller than that looks different


@dataclass(frozen=True, slots=True, eq=False)
class PlaneImage:
    """An image of the plane.

    Attributes:
        small: ``(height, width)`` grey.
        view: Of the camera as it was zoomed.
        time_s: When it was taken.
        standpoint: Where from, by telemetry; None where that does not tell.
    """

    small: ImageArray
    view: StraightView
    time_s: float
    standpoint: Standpoint | None


@dataclass(slots=True, eq=False)
class Keyframe:
    """An image that others are held against.

    Attributes:
        taken: The image.
        corners_px: ``(n, 2)`` small pixels of what can be found again.
        since_first: ``(3, 3)`` its homography since the first image.
        cov: ``(8, 8)`` of that, see ``plane_errors``.
        std_px: What that makes of the probes' places in the first image.
        stillness: Of those of its points that were taken for land so far: of all, before any were.
        are_known: ``(n,)``: which these are.
        strangeness: Of the others.
    """

    taken: PlaneImage
    corners_px: FloatArray
    since_first: FloatArray
    cov: FloatArray
    std_px: float
    stillness: Stillness
    are_known: BoolArray
    strangeness: Stillness

    def stillness_of(self, rows: IntArray) -> Stillness:
        """That of some points: what was found of one group says nothing of another."""
        return self.stillness if 2 * np.count_nonzero(self.are_known[rows]) >= len(rows) else self.strangeness

    def remember(self, rows: IntArray, gone: Gone) -> None:
        """These points were taken for land again."""
        if self.stillness_of(rows) is self.strangeness:
            self.stillness, self.strangeness = self.strangeness, self.strangeness.again()
            self.are_known = np.zeros_like(self.are_known)
            self.are_known[rows] = True
        if self.stillness.remember(gone):
            self.are_known = np.zeros_like(self.are_known)
            self.are_known[rows] = True

    def forget(self, rows: IntArray) -> None:
        """Leave points out."""
        self.corners_px = np.delete(self.corners_px, rows, axis=0)
        self.are_known = np.delete(self.are_known, rows)

    def seen_px(self, view: StraightView, onto: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Small pixels ``(n, 2)`` of its corners in a view that a homography leads to, and which are well inside."""
        there_px = view.moved(onto, self.corners_px, self.taken.view)
        farthest = np.array([view.camera.width_px, view.camera.height_px]) - 1 - _MARGIN_PX
        return there_px, np.asarray(np.all((there_px >= _MARGIN_PX) & (there_px <= farthest), axis=-1))

    def is_shown(self, view: StraightView, onto: FloatArray, least_share: float) -> bool:
        """Whether at least that share of its corners is in a view that a homography leads to, in about its size."""
        if len(self.corners_px) < 2 * FEWEST:
            return False
        _, inside = self.seen_px(view, onto)
        middle = np.mean(self.corners_px, axis=0) + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        ends = view.moved(onto, middle, self.taken.view)
        if np.mean(inside) < least_share or np.count_nonzero(inside) < FEWEST or not np.all(np.isfinite(ends)):
            return False
        scale = math.sqrt(abs(float(np.linalg.det(ends[1:] - ends[0]))))
        return bool(_SCALES[0] <= scale <= _SCALES[1])


def corners_of(small: ImageArray, near_px: FloatArray) -> FloatArray:
    """Corners ``(n, 2)`` of a grey image ``(height, width)``, the best of each cell of a grid; more near ``(m, 2)``."""
    strength = cv2.cornerMinEigenVal(small, 5)
    peaks = strength >= cv2.dilate(strength, np.ones((2 * _APART_PX + 1, 2 * _APART_PX + 1), dtype=np.uint8))
    rows, columns = np.nonzero(peaks & (strength > _QUALITY * float(np.quantile(strength, 0.99))))
    cells = (rows * _CELLS // small.shape[0]) * _CELLS + columns * _CELLS // small.shape[1]
    order = np.lexsort((-strength[rows, columns], cells))
    rank = np.arange(len(order)) - np.searchsorted(cells[order], cells[order])
    corners = np.stack([columns[order], rows[order]], axis=-1).astype(np.float64)
    is_near = nearest_px(corners, near_px) < _NEAR_PX
    return np.asarray(corners[rank < np.where(is_near, _MOST_NEAR, MOST_CORNERS // _CELLS**2 + 3)])


def nearest_px(points_px: FloatArray, others_px: FloatArray) -> FloatArray:
    """How far each of ``(n, 2)`` is from the nearest of ``(m, 2)``; NaN is far."""
    apart = np.linalg.norm(points_px[:, None] - others_px, axis=-1)
    return np.asarray(np.min(np.where(np.isnan(apart), np.inf, apart), axis=1, initial=np.inf))
