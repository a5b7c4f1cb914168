"""Images of which light and shade have been evened out: what the same surface looks like under another sky."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import ImageArray

_WINDOW_PX: Final = 31
_NOISE: Final = 4.0  # grey levels: what is flatter is not made to look structured
_GAIN: Final = 42.0  # grey levels for one standard deviation
_MIDDLE: Final = 128.5  # halves are rounded up


def evened(pixels: ImageArray) -> ImageArray:
    """Every pixel against mean and standard deviation of its neighbourhood.

    Args:
        pixels: ``(height, width, 3)`` BGR or ``(height, width)`` grey.

    Returns:
        ``(height, width)``; 128 where there is nothing but the mean.
    """
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)  # noqa: PLR2004 - grey has two axes
    size, depth = (_WINDOW_PX, _WINDOW_PX), cv2.CV_32F
    mean = cv2.boxFilter(grey, depth, size)
    variance = cv2.subtract(cv2.sqrBoxFilter(grey, depth, size), cv2.multiply(mean, mean))
    spread = cv2.sqrt(np.maximum(variance, 0.0)) + _NOISE
    detail = cv2.divide(cv2.subtract(grey, mean, dtype=depth), spread, scale=_GAIN)
    return np.asarray(np.clip(detail + _MIDDLE, 0.0, 255.0), dtype=np.uint8)
