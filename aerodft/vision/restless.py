"""Places where something changes all the time and nobody walks: water that glitters, leaves in the wind."""

import math
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray

MOST_OUTLINES: Final = 30
"""Where more than these seem to move in one image, nothing can be told from water or leaves."""

TOO_MANY: Final = "more seems to move than persons or vehicles do: water, leaves, another light? ignore says where"
_REMEMBERED_S: Final = 10.0
_RESTLESS: Final = 0.1  # changes an image: two persons in a second that walk past change a place as often
_CALM_LOOKS: Final = 25.0  # that are taken for granted
_AROUND_PX: Final = 17

Planes = np.ndarray[tuple[int, ...], np.dtype[np.float32]]


def remember_changes(
    share: Planes, last: Planes, new: Planes, seen: Planes, looks: Planes | float, elapsed_s: float
) -> None:
    """Add an image's changes to how often each place changes; all ``(height, width)``, 0 to 1.

    Args:
        share: Of the images, in which it changed; changed in place.
        last: What was new in the image before; likewise.
        new: What is new in this one.
        seen: What this one shows.
        looks: How often each place was seen.
        elapsed_s: Since the last one.
    """
    later = min(1 - math.exp(-elapsed_s / _REMEMBERED_S), 0.1)
    rate = np.maximum(np.float32(1) / (looks + np.float32(_CALM_LOOKS)), np.float32(later))
    share += (cv2.absdiff(new, last) - share) * (seen * rate)
    last += (new - last) * seen


def calm(share: Planes) -> BoolArray:
    """Where who moves can be told ``(height, width)``."""
    return np.asarray(cv2.blur(share, (_AROUND_PX, _AROUND_PX)) < _RESTLESS)
