"""From images to matches: points are spread over an image and followed to the next one, as rays without distortion."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise, product

import cv2
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.vision.straight import StraightView
from aerodft.vision.tracking import followed

_WIDEST_TANGENT = 2.0  # farther from the axis a pixel says little about a plane ahead
_CELLS = (6, 8)  # rows and columns of the grid over which points are spread
_PER_CELL = 8
_QUALITY, _APART_PX = 0.005, 7
_PAUSE_NS = 19 * SECOND_NS // 100  # between images, long enough for what moves by itself to show
_MOVED = 0.06  # of the width: a view that moves by more in this time is looked at more often


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matches:
    """What two images have in common.

    Attributes:
        earlier: ``(n, 2)`` rays at unit depth in the earlier camera's axes.
        later: ``(n, 2)`` the same points' in the later one's.
        px: ``(n,)`` size of a tracked pixel in the later one, in the same unit.
    """

    earlier: FloatArray
    later: FloatArray
    px: FloatArray

    def __len__(self) -> int:
        return len(self.px)

    def where(self, keep: BoolArray) -> "Matches":
        """Some of them."""
        return Matches(earlier=self.earlier[keep], later=self.later[keep], px=self.px[keep])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImagePair:
    """Two images by their stamps, and the points that were followed from one to the other."""

    start_ns: int
    end_ns: int
    matches: Matches


def matches_of(camera: Camera, earlier_px: FloatArray, later_px: FloatArray, shrink: float = 1.0) -> Matches:
    """Pixels ``(n, 2)`` of both images as matches; those far from the axis are left out.

    Args:
        camera: The camera.
        earlier_px: In the earlier image.
        later_px: In the later one.
        shrink: How many pixels make one of the images in which they were tracked.
    """
    rays = rays_with_jacobian(camera, np.stack([earlier_px, later_px]))
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = rays.rays_cam[..., 2]
        flat = rays.rays_cam[..., :2] / depth[..., None]
        by_px = (rays.jac_px[..., :2, :] - flat[..., None] * rays.jac_px[..., 2:, :]) / depth[..., None, None]
        usable = np.all((depth > 0) & (np.linalg.norm(flat, axis=-1) < _WIDEST_TANGENT), axis=0)
    px = np.sqrt(np.abs(np.linalg.det(by_px[1][usable]))) * shrink
    return Matches(earlier=flat[0][usable], later=flat[1][usable], px=px)


class PlaneTracker:
    """Matches between successive images.

    Args:
        camera: The camera whose images come.
    """

    def __init__(self, camera: Camera) -> None:
        self.pairs: list[ImagePair] = []
        self._camera = camera
        self._view = StraightView(camera)
        self._last: tuple[int, ImageArray] | None = None
        self._pause_ns = _PAUSE_NS

    def add(self, stamp_ns: int, pixels: Callable[[], ImageArray]) -> None:
        """Follow points into this image, if it is time for one.

        Args:
            stamp_ns: Its stamp, after that of the one before.
            pixels: Gives ``(h, w, 3)`` uint8 BGR.
        """
        if self._last is not None and stamp_ns - self._last[0] < self._pause_ns:
            return
        grey = self._view.small(pixels())
        if self._last is not None:
            self._follow(*self._last, stamp_ns, grey)
        self._last = (stamp_ns, grey)

    def _follow(self, start_ns: int, before: ImageArray, end_ns: int, after: ImageArray) -> None:
        corners = _corners(before)
        there, found = followed(before, after, corners, corners)
        earlier, later = corners[found], there[found]
        moved_px = float(np.median(np.linalg.norm(later - earlier, axis=-1))) if len(later) else np.inf
        share = moved_px / (_MOVED * before.shape[1]) * (_PAUSE_NS / (end_ns - start_ns))
        self._pause_ns = round(_PAUSE_NS / max(share, 1.0))
        earlier_px, later_px = self._view.to_full(earlier), self._view.to_full(later)
        matches = matches_of(self._camera, earlier_px, later_px, self._view.shrink)
        self.pairs.append(ImagePair(start_ns=start_ns, end_ns=end_ns, matches=matches))


def _corners(grey: ImageArray) -> FloatArray:
    """Corners ``(n, 2)``, the best of each cell of a grid."""
    rows, columns = (
        np.linspace(0, side, n + 1).astype(int).tolist() for side, n in zip(grey.shape, _CELLS, strict=True)
    )
    found = [np.empty((0, 2))]
    for (top, bottom), (left, right) in product(pairwise(rows), pairwise(columns)):
        corners = cv2.goodFeaturesToTrack(grey[top:bottom, left:right], _PER_CELL, _QUALITY, _APART_PX)
        if corners is not None:
            found.append(np.asarray(corners[:, 0], dtype=np.float64) + [left, top])
    return np.concatenate(found)
