"""Points of one image found again in another: local contrast of images, corners spread over them, tracked to and fro.

Images are made small and grey, and their pixels are where a lens without distortion would show them: there planes move
by homographies.
"""

from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from aerodft.geometry import pixels_from_rays, rays_from_pixels
from aerodft.model import BoolArray, Camera, FloatArray, ImageArray

SMALL_PX: Final = 640
"""Images are tracked at about this width."""

NODE_PX: Final = 16
"""Between these, a map from pixels to pixels is as good as straight."""

OUTSIDE_PX: Final = -1e4
"""Of what the lens does not show."""

_Float32Plane = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
_CONTRAST_WINDOW_PX: Final = 31
_NOISE: Final = 4.0  # grey levels: what is flatter is not made to look structured
_GAIN: Final = 42.0  # grey levels for one standard deviation
_MIDDLE: Final = 128.5  # halves are rounded up
_COLUMNS: Final = 12
_IN_A_CELL: Final = 2
_BLOCK_PX: Final = 7
_APART_PX: Final = 15
_LEAST_STRENGTH: Final = 5e-4  # grass seen from 10 m has 1e-3, plain walls and the sky less than 1e-4
_WINDOW_PX: Final = 21
_LEVELS: Final = 3
_STOP: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.005)
_MOST_ROUND_TRIP_PX: Final = 0.3  # how far from where it started a point may come back
_LEAST_CORRELATION: Final = 0.6  # correlation of the two templates: what covers a point is not taken for it
_PATCH: Final = np.stack(np.meshgrid(np.arange(-7, 8), np.arange(-7, 8)), axis=-1).reshape(1, -1, 2)


class UndistortedView:
    """A camera's images made small, and their pixels with and without distortion.

    Args:
        camera: The camera.
        about_px: Width that images are made as small as, about.
    """

    def __init__(self, camera: Camera, about_px: int = SMALL_PX) -> None:
        self._whole, self._about_px = camera, about_px
        self.shrink = max(round(camera.width_px / about_px), 1)
        shift = (self.shrink - 1) / 2  # the centre of a small pixel is that of the pixels it was made of
        self.camera = replace(
            camera,
            width_px=camera.width_px // self.shrink,
            height_px=camera.height_px // self.shrink,
            fx_px=camera.fx_px / self.shrink,
            fy_px=camera.fy_px / self.shrink,
            cx_px=(camera.cx_px - shift) / self.shrink,
            cy_px=(camera.cy_px - shift) / self.shrink,
        )
        self._is_distorted = any(camera.distortion)
        self._nodes = self.undistort(nodes_px(self.camera.width_px, self.camera.height_px))

    @property
    def intrinsics(self) -> FloatArray:
        """``(3, 3)`` of its straight pixels."""
        lens = self.camera
        return np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1.0]])

    def zoomed(self, magnification: float) -> "UndistortedView":
        """The view at another focal length, at which the lens bends other pixels by other amounts."""
        return UndistortedView(self._whole.zoomed(magnification, 0.0), self._about_px) if self._is_distorted else self

    def small(self, pixels: ImageArray) -> ImageArray:
        """An image ``(height, width, 3)`` BGR, grey and small."""
        return self.shrunk_image(grey_of(pixels))

    def shrunk_image(self, pixels: ImageArray) -> ImageArray:
        """An image ``(height, width)`` or ``(height, width, 3)``, small."""
        if self.shrink == 1:
            return pixels
        size = self.camera.width_px, self.camera.height_px
        whole = pixels[: size[1] * self.shrink, : size[0] * self.shrink]
        return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def to_small(self, pixels_px: FloatArray) -> FloatArray:
        """Pixels ``(..., 2)`` of the camera's image in the small one."""
        return (pixels_px - (self.shrink - 1) / 2) / self.shrink

    def to_full(self, small_px: FloatArray) -> FloatArray:
        """Pixels of the camera's image."""
        return small_px * self.shrink + (self.shrink - 1) / 2

    def undistort(self, small_px: FloatArray) -> FloatArray:
        """Small pixels ``(..., 2)`` where they were without distortion; NaN beyond the lens model."""
        if not self._is_distorted:
            return small_px
        rays, lens = rays_from_pixels(self.camera, small_px), self.camera
        return rays[..., :2] / rays[..., 2:] * [lens.fx_px, lens.fy_px] + [lens.cx_px, lens.cy_px]

    def distort(self, straight_px: FloatArray) -> FloatArray:
        """Undistorted pixels ``(..., 2)`` where the lens shows them; NaN where it shows nothing."""
        if not self._is_distorted:
            return straight_px
        lens = self.camera
        flat = (straight_px - [lens.cx_px, lens.cy_px]) / [lens.fx_px, lens.fy_px]
        return pixels_from_rays(lens, np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1))

    def map_from(self, homography: FloatArray, small_px: FloatArray, then: "UndistortedView") -> FloatArray:
        """Small pixels ``(..., 2)`` of another view, under a homography from its straight ones to those of this."""
        return self.distort(apply_homography(homography, then.undistort(small_px)))

    def warp(self, small: ImageArray, homography: FloatArray, then: "UndistortedView") -> ImageArray:
        """A small image ``(height, width)`` of another view as this one sees it; its border is repeated."""
        inverse: FloatArray = np.asarray(np.linalg.inv(homography), dtype=np.float64)
        nodes = then.distort(apply_homography(inverse, self._nodes))
        columns_px, rows_px = between_nodes(nodes, self.camera.width_px, self.camera.height_px)
        seen = cv2.remap(small, columns_px, rows_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen, dtype=np.uint8)


def grey_of(pixels: ImageArray) -> ImageArray:
    """An image ``(height, width, 3)`` BGR in grey ``(height, width)``; one that is grey as it is."""
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), dtype=np.uint8) if pixels.ndim > 2 else pixels  # noqa: PLR2004 - rows and columns


def nodes_px(width_px: int, height_px: int, apart_px: int = NODE_PX) -> FloatArray:
    """Pixels ``(down, across, 2)`` so far apart, at which a map of an image is made before it is filled in."""
    across, down = (-(-size // apart_px) for size in (width_px, height_px))
    centre_px = (apart_px - 1) / 2  # cv2.resize puts a node's value there
    u, v = np.meshgrid(np.arange(across) * apart_px + centre_px, np.arange(down) * apart_px + centre_px)
    return np.stack([u, v], axis=-1)


def between_nodes(
    at_px: FloatArray, width_px: int, height_px: int, apart_px: int = NODE_PX
) -> tuple[_Float32Plane, _Float32Plane]:
    """Columns and rows ``(height, width)`` for ``cv2.remap``, of a map ``(down, across, 2)`` that was made at nodes.

    NaN shows nothing.
    """
    nodes = np.nan_to_num(at_px, nan=OUTSIDE_PX).astype(np.float32)
    size = nodes.shape[1] * apart_px, nodes.shape[0] * apart_px
    whole = cv2.resize(nodes, size, interpolation=cv2.INTER_LINEAR)
    columns_px, rows_px = cv2.split(whole[:height_px, :width_px])
    return np.asarray(columns_px, dtype=np.float32), np.asarray(rows_px, dtype=np.float32)


def consensus_homography(
    start: FloatArray, end: FloatArray, stray: float, draws: int, confidence: float
) -> tuple[FloatArray, BoolArray] | None:
    """The homography ``(3, 3)``, its last element 1, that most points follow, and which those are ``(n,)``.

    Args:
        start: ``(n, 2)``, at least four.
        end: ``(n, 2)`` where they have gone.
        stray: Largest distance of a point that follows, in the unit of the points.
        draws: Most samples drawn.
        confidence: Probability that is aimed at of a sample without strays.

    Returns:
        None where OpenCV's MAGSAC finds none.
    """
    found, follows = cv2.findHomography(start, end, cv2.USAC_MAGSAC, stray, None, draws, confidence)
    if np.shape(found) != (3, 3) or not found[2, 2]:
        return None
    return np.asarray(found / found[2, 2], dtype=np.float64), np.asarray(follows[:, 0] > 0)


def apply_homography(homography: FloatArray, straight_px: FloatArray) -> FloatArray:
    """Points ``(..., 2)`` under a homography ``(3, 3)``; NaN behind the camera."""
    mapped = straight_px @ homography[:, :2].T + homography[:, 2]
    depth = mapped[..., 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(depth > 0, mapped[..., :2] / depth, np.nan)


def local_contrast(pixels: ImageArray) -> ImageArray:
    """Every pixel against mean and standard deviation of its neighbourhood.

    Args:
        pixels: ``(height, width, 3)`` BGR or ``(height, width)`` grey.

    Returns:
        ``(height, width)``; 128 where there is nothing but the mean.
    """
    grey, size, depth = grey_of(pixels), (_CONTRAST_WINDOW_PX, _CONTRAST_WINDOW_PX), cv2.CV_32F
    mean = cv2.boxFilter(grey, depth, size)
    variance = cv2.subtract(cv2.sqrBoxFilter(grey, depth, size), cv2.multiply(mean, mean))
    spread = cv2.sqrt(np.maximum(variance, 0.0)) + _NOISE
    detail = cv2.divide(cv2.subtract(grey, mean, dtype=depth), spread, scale=_GAIN)
    return np.asarray(np.clip(detail + _MIDDLE, 0.0, 255.0), dtype=np.uint8)


def spread_corners(local_contrast: ImageArray, allowed: BoolArray) -> FloatArray:
    """The strongest corners (Shi and Tomasi 1994) of each cell of a grid.

    Args:
        local_contrast: ``(height, width)``, see :func:`local_contrast`.
        allowed: ``(height, width)``: where points may lie.

    Returns:
        ``(n, 2)`` whole pixels; none where the image is too flat.
    """
    strength = cv2.cornerMinEigenVal(local_contrast, _BLOCK_PX)
    highest = cv2.dilate(strength, np.ones((_APART_PX, _APART_PX), dtype=np.uint8))
    peaks = (strength >= highest) & (strength > _LEAST_STRENGTH) & allowed
    rows, columns = np.nonzero(peaks)
    cell_px = local_contrast.shape[1] / _COLUMNS
    cells = (rows // cell_px).astype(np.int64) * _COLUMNS + (columns // cell_px).astype(np.int64)
    order = np.lexsort((-strength[rows, columns], cells))
    rank = np.arange(len(order)) - np.searchsorted(cells[order], cells[order])
    kept = order[rank < _IN_A_CELL]
    return np.stack([columns[kept], rows[kept]], axis=-1).astype(np.float64)


def track_lk(
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
    same = found & returned & np.all(np.abs(back - points_px) <= _MOST_ROUND_TRIP_PX, axis=-1)
    return there, same & (_patch_correlation(old, new, points_px, there) >= _LEAST_CORRELATION)


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


def _patch_correlation(old: ImageArray, new: ImageArray, old_px: FloatArray, new_px: FloatArray) -> FloatArray:
    """Correlation ``(n,)`` of the patches around points."""
    patches = []
    for image, points_px in ((old, old_px), (new, new_px)):
        at = (points_px[:, None, :] + _PATCH).astype(np.float32)
        patch = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        patch = patch.astype(np.float64)
        patches.append(patch - np.mean(patch, axis=-1, keepdims=True))
    norms = np.linalg.norm(patches[0], axis=-1) * np.linalg.norm(patches[1], axis=-1)
    return np.asarray(np.sum(patches[0] * patches[1], axis=-1) / np.maximum(norms, 1.0))
