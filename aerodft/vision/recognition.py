"""An image recognised in another, wherever the camera looks by now: ORB descriptors (Rublee et al. 2011)."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray

_FEATURES: Final = 2500
_HALF: Final = 0.5  # of the image's size: descriptors need no more, and noise less
_DISTINCT: Final = 0.85  # the best match against the second best (Lowe 2004)


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
