"""How different the two sides of a region's outline are."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.vision.water_features import Float32Image

_STRIP_PX: Final = 6  # on either side of an outline
_NOISE: Final = np.array([1.5, 1.5, 4.0, 1.0])  # least variances of the planes: flat colours differ by no more


def outline_contrast(planes: Float32Image, region: BoolArray, ground: BoolArray) -> tuple[BoolArray, FloatArray]:
    """The outline of a region, and how different its two sides are along it.

    Args:
        planes: ``(height, width, k)`` features.
        region: ``(height, width)``.
        ground: ``(height, width)``: what was looked at; its border is no outline.

    Returns:
        The region's own pixels at its outline ``(height, width)``; for each of them the distance of the two sides'
        means in standard deviations ``(n,)``.
    """
    kernel, inside = np.ones((3, 3), dtype=np.uint8), region.astype(np.uint8)
    within = cv2.erode(inside, kernel)
    near = cv2.erode(inside, kernel, iterations=_STRIP_PX)
    beyond = cv2.dilate(inside, kernel, iterations=_STRIP_PX)
    border = cv2.erode(ground.astype(np.uint8), kernel, iterations=2, borderValue=0)
    outline = (inside > within) & (border > 0)
    if not outline.any():
        return outline, np.empty(0)
    mean_in, variance_in = _local(planes, (within > near).astype(np.float32), outline)
    mean_out, variance_out = _local(planes, ((beyond > inside) & ground).astype(np.float32), outline)
    spread = 0.5 * (variance_in + variance_out) + _NOISE
    return outline, np.asarray(np.sqrt(np.sum(np.square(mean_in - mean_out) / spread, axis=-1)), dtype=np.float64)


def _local(planes: Float32Image, weight: Float32Image, at: BoolArray) -> tuple[Float32Image, Float32Image]:
    """Mean and variance ``(n, k)`` of the planes around each pixel of ``at``, weighted."""
    size = (2 * _STRIP_PX + 1, 2 * _STRIP_PX + 1)
    total = cv2.boxFilter(weight, -1, size)[at][:, None] + 1e-6
    mean = cv2.boxFilter(planes * weight[..., None], -1, size)[at] / total
    square = cv2.boxFilter(np.square(planes) * weight[..., None], -1, size)[at] / total
    return mean, np.maximum(square - mean * mean, 0.0)
