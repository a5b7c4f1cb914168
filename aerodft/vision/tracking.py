"""Points of one image found again in another: pyramidal Lucas-Kanade (Bouguet 2001), there and back again."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray

_WINDOW_PX: Final = 21
_LEVELS: Final = 3
_STOP: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.005)
_RETURNED_PX: Final = 0.3  # how far from where it started a point may come back
_ALIKE: Final = 0.6  # correlation of the two templates: what covers a point is not taken for it
_PATCH: Final = np.stack(np.meshgrid(np.arange(-7, 8), np.arange(-7, 8)), axis=-1).reshape(1, -1, 2)


def followed(
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
    same = found & returned & np.all(np.abs(back - points_px) <= _RETURNED_PX, axis=-1)
    return there, same & (_likeness(old, new, points_px, there) >= _ALIKE)


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


def _likeness(old: ImageArray, new: ImageArray, old_px: FloatArray, new_px: FloatArray) -> FloatArray:
    """Correlation ``(n,)`` of the patches around points."""
    patches = []
    for image, points_px in ((old, old_px), (new, new_px)):
        at = (points_px[:, None, :] + _PATCH).astype(np.float32)
        patch = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        patch = patch.astype(np.float64)
        patches.append(patch - np.mean(patch, axis=-1, keepdims=True))
    norms = np.linalg.norm(patches[0], axis=-1) * np.linalg.norm(patches[1], axis=-1)
    return np.asarray(np.sum(patches[0] * patches[1], axis=-1) / np.maximum(norms, 1.0))
