"""The image that a fixed camera is held against: which one, what is found again of it, how it looks after a turn."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from aerodft.geometry.lens import pixels_from_rays, rays_from_pixels
from aerodft.geometry.rotation import inverse, matrix, to_rotation_vector
from aerodft.geometry.turning import turned
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.vision.straight import between_nodes, grey_of, nodes_px
from aerodft.vision.tracking import evened, followed, spread_corners, well_inside

_FEATURES: Final = 2500
_HALF: Final = 0.5  # of the image's size: descriptors need no more, and noise less
_DISTINCT: Final = 0.85  # the best match against the second best (Lowe 2004)
LEAST_CORNERS: Final = 12

_FOUND_AGAIN: Final = 0.3  # of its points, so that an image is no broken one; most of it may be water

Polygon = tuple[tuple[float, float], ...]
_NODE_PX: Final = 8  # between these, a map from pixels to pixels is as good as straight
_SAME_RAD: Final = 1e-6
_MARGIN_PX: Final = 24.0


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Points with descriptors.

    Attributes:
        pixels_px: ``(n, 2)``.
        descriptors: ``(n, 32)``.
    """

    pixels_px: FloatArray
    descriptors: ImageArray


def features_of(evened: ImageArray, allowed: BoolArray | None = None) -> Features:
    """Features of an evened image, where ``allowed (height, width)`` lets them lie."""
    small = cv2.resize(evened, None, fx=_HALF, fy=_HALF, interpolation=cv2.INTER_AREA)
    mask = None
    if allowed is not None:
        mask = cv2.resize(allowed.astype(np.uint8), small.shape[::-1], interpolation=cv2.INTER_NEAREST)
    found, descriptors = cv2.ORB.create(nfeatures=_FEATURES, fastThreshold=10).detectAndCompute(small, mask)
    if descriptors is None:
        return Features(np.zeros((0, 2)), np.zeros((0, 32), dtype=np.uint8))
    pixels = np.array([point.pt for point in found])
    return Features((pixels + 0.5) / _HALF - 0.5, np.asarray(descriptors, dtype=np.uint8))


def matched(old: Features, new: Features) -> tuple[FloatArray, FloatArray]:
    """Pixels ``(n, 2)`` of what is likely the same in both, old and new."""
    if min(len(old.descriptors), len(new.descriptors)) < 2:  # noqa: PLR2004 - a best and a second best
        return np.zeros((0, 2)), np.zeros((0, 2))
    nearest = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(old.descriptors, new.descriptors, k=2)
    pairs = [(best.queryIdx, best.trainIdx) for best, second in nearest if best.distance < _DISTINCT * second.distance]
    indices = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return old.pixels_px[indices[:, 0]], new.pixels_px[indices[:, 1]]


@dataclass(frozen=True, eq=False)
class Reference:
    """An image with what can be found again of it.

    Attributes:
        grey: ``(height, width)``.
        allowed: ``(height, width)``: where points may lie.
    """

    grey: ImageArray
    allowed: BoolArray

    @cached_property
    def evened(self) -> ImageArray:
        """``(height, width)``, see :func:`aerodft.vision.tracking.evened`."""
        return evened(self.grey)

    @cached_property
    def points_px(self) -> FloatArray:
        """``(n, 2)`` corners."""
        return spread_corners(self.evened, self.allowed)

    @cached_property
    def features(self) -> Features:
        """For recognition after a large turn."""
        return features_of(self.evened, self.allowed)

    @property
    def is_rich(self) -> bool:
        """Whether there is enough to be found again."""
        return len(self.points_px) >= LEAST_CORNERS


def reference_of(pixels: ImageArray, allowed: BoolArray) -> Reference:
    """An image ``(height, width, 3)`` BGR as a reference."""
    return Reference(grey_of(pixels), allowed)


def allowed_outside(polygons: tuple[Polygon, ...], width_px: int, height_px: int) -> BoolArray:
    """``(height, width)``: all pixels but those in the polygons, which are of pixels (u, v)."""
    mask = np.ones((height_px, width_px), dtype=np.uint8)
    corners = [np.round(np.array(polygon)).astype(np.int32) for polygon in polygons]
    return np.asarray(cv2.fillPoly(mask, corners, 0) > 0)


class FirstGoodImage:
    """Waits for two images in a row that show the same; broken, dark and blurred ones are passed over."""

    def __init__(self, allowed: BoolArray) -> None:
        self._allowed = allowed
        self._candidate: Reference | None = None

    def offer(self, pixels: ImageArray) -> Reference | None:
        """The reference, once there is one; images ``(height, width, 3)`` BGR in their order."""
        new = reference_of(pixels, self._allowed)
        old, self._candidate = self._candidate, new if new.is_rich else None
        if old is None or self._candidate is None:
            return None
        found = followed(old.evened, new.evened, old.points_px, old.points_px)[1]
        return old if np.count_nonzero(found) >= _FOUND_AGAIN * len(found) else None


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A reference as it is seen after a turn.

    Attributes:
        wxyz: ``(4,)`` ``now_SO3_reference``.
        evened: ``(height, width)``.
        points_px: ``(n, 2)``: where the reference's points are in it.
        inside: ``(n,)``: which of them are far enough from its edges.
    """

    wxyz: FloatArray
    evened: ImageArray
    points_px: FloatArray
    inside: BoolArray


def view_after(camera: Camera, reference: ImageArray, points_px: FloatArray, wxyz: FloatArray) -> View:
    """The view of a camera that has turned since it took the reference.

    Args:
        camera: The camera.
        reference: ``(height, width)`` grey.
        points_px: ``(n, 2)`` points of the reference.
        wxyz: ``(4,)`` ``now_SO3_reference``.
    """
    if np.linalg.norm(to_rotation_vector(wxyz)) < _SAME_RAD:
        return View(wxyz, evened(reference), points_px, well_inside(camera, points_px, _MARGIN_PX))
    size = camera.width_px, camera.height_px
    rays = rays_from_pixels(camera, nodes_px(*size, _NODE_PX)) @ matrix(inverse(wxyz)).T
    columns_px, rows_px = between_nodes(pixels_from_rays(camera, rays), *size, _NODE_PX)
    seen = cv2.remap(reference, columns_px, rows_px, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
    points_now_px = turned(camera, wxyz, points_px)
    inside = well_inside(camera, points_now_px, _MARGIN_PX)
    return View(wxyz, evened(np.asarray(seen, dtype=np.uint8)), points_now_px, inside)
