"""How much a marker in an image looks like the one that it was taken for.

Detectors decide module by module whether it is black or white, and so read a marker into textures now and then, the
more so the larger the dictionary is. In a true marker black is black and white is white all over.
"""

from functools import lru_cache
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import FloatArray, ImageArray, IntArray
from calibration.lens.board import dictionary

_WITHIN: Final = np.array([0.3, 0.5, 0.7])  # of a module: clear of its neighbours


def modules(name: str) -> int:
    """Along a side of a dictionary's markers, with the black border."""
    return int(dictionary(name).markerSize) + 2


def likeness(grey: ImageArray, corners_px: FloatArray, ids: IntArray, name: str) -> FloatArray:
    """Correlation ``(m,)`` of what is there with what markers look like: 1 for the same, about 0 for anything else.

    Args:
        grey: ``(h, w)``.
        corners_px: ``(m, 4, 2)``, at least one.
        ids: ``(m,)``.
        name: Of the dictionary.
    """
    along = (np.arange(modules(name))[:, None] + _WITHIN).ravel()
    at = np.stack(np.meshgrid(along, along), axis=-1).reshape(1, -1, 2).astype(np.float32)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32) * modules(name)
    quads = corners_px.astype(np.float32)
    seen_at = np.concatenate(
        [cv2.perspectiveTransform(at, cv2.getPerspectiveTransform(square, quad)) for quad in quads]
    )
    seen = cv2.remap(grey, seen_at[..., 0], seen_at[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    wanted = np.stack([_pattern(name, int(each)) for each in ids])
    seen -= seen.mean(axis=1, keepdims=True)
    size = np.linalg.norm(seen, axis=1) * np.linalg.norm(wanted, axis=1)
    return np.asarray(np.sum(seen * wanted, axis=1) / np.maximum(size, 1e-9))


@lru_cache(maxsize=256)
def _pattern(name: str, marker: int) -> FloatArray:
    """A marker's samples less their mean; below 0 for black."""
    known = dictionary(name)
    bits = cv2.aruco.Dictionary.getBitsFromByteList(known.bytesList[marker : marker + 1], known.markerSize)
    samples = np.kron(np.pad(bits, 1), np.ones((len(_WITHIN), len(_WITHIN)))).ravel()
    return np.asarray(samples - samples.mean())
