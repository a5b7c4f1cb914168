"""The image that a fixed camera is held against: a given one, or the first of a run that shows what the next shows."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.vision.corners import spread_corners
from aerodft.vision.evened import evened
from aerodft.vision.recognition import Features, features_of
from aerodft.vision.tracking import followed

LEAST_CORNERS: Final = 12

_FOUND_AGAIN: Final = 0.3  # of its points, so that an image is no broken one; most of it may be water

Polygon = tuple[tuple[float, float], ...]


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
        """``(height, width)``, see :func:`aerodft.vision.evened.evened`."""
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
    return Reference(np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), dtype=np.uint8), allowed)


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
