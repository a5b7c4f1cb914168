"""A fixed camera's steady points: where they were in its reference, and where they are now.

The reference is the image that the camera is held against: which one, what is found again of it, and how it looks after
a turn.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from aerodft.geometry import (
    MIN_POINTS,
    RelativeRotation,
    find_rotation,
    in_image,
    inverse,
    matrix,
    multiply,
    pixels_from_rays,
    rays_from_pixels,
    rotated_pixels,
    to_rotation_vector,
)
from aerodft.model import FIXED_POINTS, BoolArray, Camera, FloatArray, Image, ImageArray, IntArray, Observation
from aerodft.vision.common import (
    between_nodes,
    grey_of,
    local_contrast,
    nodes_px,
    spread_corners,
    track_lk,
)

_FEATURES: Final = 2500
_HALF: Final = 0.5  # of the image's size: descriptors need no more, and noise less
_DISTINCT: Final = 0.85  # the best match against the second best (Lowe 2004)
LEAST_CORNERS: Final = 12

_FOUND_AGAIN: Final = 0.3  # of its points, so that an image is no broken one; most of it may be water

Polygon = tuple[tuple[float, float], ...]
_NODE_PX: Final = 8  # between these, a map from pixels to pixels is as good as straight
_SAME_RAD: Final = 1e-6
_MARGIN_PX: Final = 24.5
_NO_TURN: Final = np.array([1.0, 0.0, 0.0, 0.0])
_ANOTHER_VIEW_RAD: Final = 0.009  # half a degree: templates look different from there on
_RECOGNISED_PX: Final = 4.0  # descriptors are no more precise
_LEAST_RECOGNISED: Final = 12
_LOST: Final = 0.2  # of the points in view: where fewer than these agree, the camera may look elsewhere
_MOST_MATCHES: Final = 200
_FLICKER_PX: Final = 1.0  # between two looks, beside what the camera's turn explains
_FADING: Final = 0.2
_MOST_FLICKER: Final = 0.5
_DECIMALS: Final = 3  # of a pixel; trackers have not two

_Pairs = tuple[FloatArray, FloatArray]

Features = tuple[FloatArray, ImageArray]
"""Pixels ``(n, 2)`` and their descriptors ``(n, 32)``."""


def features_of(local_contrast: ImageArray, allowed: BoolArray | None = None) -> Features:
    """Features of an image's local contrast, where ``allowed (height, width)`` lets them lie."""
    small = cv2.resize(local_contrast, None, fx=_HALF, fy=_HALF, interpolation=cv2.INTER_AREA)
    mask = None
    if allowed is not None:
        mask = cv2.resize(allowed.astype(np.uint8), small.shape[::-1], interpolation=cv2.INTER_NEAREST)
    found, descriptors = cv2.ORB.create(nfeatures=_FEATURES, fastThreshold=10).detectAndCompute(small, mask)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 32), dtype=np.uint8)
    pixels = np.array([point.pt for point in found])
    return (pixels + 0.5) / _HALF - 0.5, np.asarray(descriptors, dtype=np.uint8)


def match_features(old: Features, new: Features) -> tuple[FloatArray, FloatArray]:
    """Pixels ``(n, 2)`` of what is likely the same in both, old and new."""
    (old_px, old_descriptors), (new_px, new_descriptors) = old, new
    if min(len(old_px), len(new_px)) < 2:  # noqa: PLR2004 - a best and a second best
        return np.zeros((0, 2)), np.zeros((0, 2))
    nearest = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(old_descriptors, new_descriptors, k=2)
    pairs = [(best.queryIdx, best.trainIdx) for best, second in nearest if best.distance < _DISTINCT * second.distance]
    indices = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return old_px[indices[:, 0]], new_px[indices[:, 1]]


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
    def local_contrast(self) -> ImageArray:
        """``(height, width)``, see :func:`aerodft.vision.common.tracking.local_contrast`."""
        return local_contrast(self.grey)

    @cached_property
    def points_px(self) -> FloatArray:
        """``(n, 2)`` corners."""
        return spread_corners(self.local_contrast, self.allowed)

    @cached_property
    def features(self) -> Features:
        """For recognition after a large turn."""
        return features_of(self.local_contrast, self.allowed)

    def shows(self, other: "Reference") -> bool:
        """Whether two images show the same: neither of them is broken, dark or blurred then."""
        found = track_lk(self.local_contrast, other.local_contrast, self.points_px, self.points_px)[1]
        return bool(np.count_nonzero(found) >= _FOUND_AGAIN * len(found))


def allowed_outside(polygons: tuple[Polygon, ...], width_px: int, height_px: int) -> BoolArray:
    """``(height, width)``: all pixels but those in the polygons, which are of pixels (u, v)."""
    mask = np.ones((height_px, width_px), dtype=np.uint8)
    corners = [np.round(np.array(polygon)).astype(np.int32) for polygon in polygons]
    return np.asarray(cv2.fillPoly(mask, corners, 0) > 0)


class SteadyPoints:
    """Implements ``service.ports.ImageObserver``: one observation an image, of pairs of pixels.

    Points are always held against the reference, never against the image before, so nothing drifts. An observation
    without pairs says that nothing was found. Where the view is not the reference turned, it has what looks alike.

    Args:
        camera: The camera.
        ignore: Polygons of reference pixels with water, trees, roads, whatever moves by itself.
        reference: ``(height, width, 3)`` BGR; None to take the first good image.
    """

    def __init__(self, camera: Camera, ignore: tuple[Polygon, ...] = (), reference: ImageArray | None = None) -> None:
        self._camera = camera
        self._allowed = allowed_outside(ignore, camera.width_px, camera.height_px)
        self._candidate: Reference | None = None
        self._held: _HeldReference | None = None
        if reference is not None:
            self._held = _HeldReference(camera, Reference(grey_of(reference), self._allowed))

    @property
    def corners(self) -> int | None:
        """Number of the reference's points; None before there is one."""
        return None if self._held is None else len(self._held.reference.points_px)

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """Pairs of pixels: where a point is in the reference, and where it is in this image.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        pixels = image.pixels()
        if self._held is None:
            self._offer(Reference(grey_of(pixels), self._allowed))
        then_px, now_px = self._held.look(local_contrast(pixels)) if self._held is not None else [np.zeros((0, 2))] * 2
        flat = np.round(np.stack([then_px, now_px], axis=1).reshape(-1, 2), _DECIMALS).tolist()
        return (Observation.in_image(image, FIXED_POINTS, tuple((u, v) for u, v in flat)),)

    def _offer(self, new: Reference) -> None:
        """Hold on to the first of two images in a row that show the same; others are passed over."""
        old, self._candidate = self._candidate, new if len(new.points_px) >= LEAST_CORNERS else None
        if old is not None and self._candidate is not None and old.shows(new):
            self._held = _HeldReference(self._camera, old)


class _HeldReference:
    """A reference, how the camera has turned since, and the view of it after about that turn.

    Of that view ``_view_wxyz`` is ``now_SO3_reference (4,)``, ``_view`` the local contrast ``(height, width)``,
    ``_view_px (n, 2)`` where the reference's points are in it, ``_inside (n,)`` which of them are far enough from its
    edges.
    """

    def __init__(self, camera: Camera, reference: Reference) -> None:
        self._camera = camera
        self.reference = reference
        self._points_px = reference.points_px
        self._turn_to(_NO_TURN)
        self._last_off_px = np.full_like(self._points_px, np.nan)
        self._flicker = np.zeros(len(self._points_px))

    def _turn_to(self, wxyz: FloatArray) -> None:
        """Have the view of a camera that has turned so since it took the reference."""
        camera, grey = self._camera, self.reference.grey
        self._wxyz = self._view_wxyz = wxyz
        self._view_px = self._points_px
        if np.linalg.norm(to_rotation_vector(wxyz)) >= _SAME_RAD:
            size = camera.width_px, camera.height_px
            rays = rays_from_pixels(camera, nodes_px(*size, _NODE_PX)) @ matrix(inverse(wxyz)).T
            columns_px, rows_px = between_nodes(pixels_from_rays(camera, rays), *size, _NODE_PX)
            seen = cv2.remap(grey, columns_px, rows_px, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
            grey, self._view_px = np.asarray(seen, dtype=np.uint8), rotated_pixels(camera, wxyz, self._points_px)
        self._view = local_contrast(grey)
        self._inside = in_image(camera, self._view_px, _MARGIN_PX)

    def look(self, now: ImageArray) -> _Pairs:
        """Pixels ``(n, 2)`` then and now of what is found of the reference in an image's local contrast."""
        found, now_px, turn = self._follow(now)
        if turn is None or np.count_nonzero(turn.inliers) < self._least_agreeing():
            then_px, new_px = match_features(self.reference.features, features_of(now))
            known = find_rotation(self._camera, then_px, new_px, tolerance_px=_RECOGNISED_PX)
            if known is None or np.count_nonzero(known.inliers) < _LEAST_RECOGNISED:
                return then_px[:_MOST_MATCHES], new_px[:_MOST_MATCHES]
            self._turn_to(known.wxyz)
            found, now_px, turn = self._follow(now)
        elif self._is_another_view(turn):
            self._turn_to(turn.wxyz)
            found, now_px, turn = self._follow(now)
        if turn is not None:
            self._learn(found, turn)
        is_stable = self._flicker[found] < _MOST_FLICKER
        return self._points_px[found][is_stable], now_px[is_stable]

    def _least_agreeing(self) -> float:
        in_view = np.count_nonzero(self._inside & (self._flicker < _MOST_FLICKER))
        return max(_LOST * in_view, MIN_POINTS)

    def _follow(self, now: ImageArray) -> tuple[IntArray, FloatArray, RelativeRotation | None]:
        """Indices ``(k,)`` of the points that were found, where, and the turn that most of them agree on."""
        guess_px = rotated_pixels(self._camera, self._wxyz, self._points_px)
        tried = np.flatnonzero(self._inside & np.isfinite(guess_px[:, 0]))
        there_px, ok = track_lk(self._view, now, self._view_px[tried], guess_px[tried])
        found, now_px = tried[ok], there_px[ok]
        return found, now_px, find_rotation(self._camera, self._points_px[found], now_px)

    def _learn(self, found: IntArray, turn: RelativeRotation) -> None:
        """Go on from where the camera looks now, and remember which points move by themselves."""
        self._wxyz = turn.wxyz
        moved = np.max(np.abs(turn.residual_px - self._last_off_px[found]), axis=-1) > _FLICKER_PX
        self._flicker[found] += _FADING * (moved - self._flicker[found])
        self._last_off_px[found] = turn.residual_px

    def _is_another_view(self, turn: RelativeRotation) -> bool:
        step = to_rotation_vector(multiply(inverse(self._view_wxyz), turn.wxyz))
        return bool(np.linalg.norm(step) > _ANOTHER_VIEW_RAD)
