"""How much each pixel looks like the water that was found, and not like the land: a confidence for every pixel."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray
from aerodft.vision.water_features import Float32Image

_CLUSTERS: Final = 12
_WEIGHTS: Final = np.array([1.0, 1.0, 0.5, 0.7], dtype=np.float32)  # of the planes, as for the clusters of the mask
_EVERY: Final = 5
_SMOOTH_PX: Final = 1.5
_SEED: Final = 1


def water_likeness(planes: Float32Image, water: BoolArray, ground: BoolArray) -> Float32Image:
    """Share of water among the pixels of the same colour, texture and lightness, ``(height, width)``, 0 to 1.

    A half says that the pixel's looks do not tell it; 0 also where nothing was looked at.

    Args:
        planes: ``(height, width, 4)`` of ``WaterFeatures``.
        water: ``(height, width)``: what was found.
        ground: What was looked at.
    """
    values = np.asarray(cv2.GaussianBlur(planes * _WEIGHTS, (0, 0), _SMOOTH_PX), dtype=np.float32)
    sample = np.ascontiguousarray(values[ground][::_EVERY])
    if len(sample) <= _CLUSTERS:
        return (water & ground).astype(np.float32)
    cv2.setRNGSeed(_SEED)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 15, 0.2)
    _, _, centres = cv2.kmeans(sample, _CLUSTERS, np.empty(0, dtype=np.int32), criteria, 1, cv2.KMEANS_PP_CENTERS)
    away = [np.sum(np.square(values - centre), axis=-1) for centre in centres]
    labels = np.argmin(np.stack(away), axis=0)
    wet = np.bincount(labels[ground & water], minlength=_CLUSTERS)
    total = np.maximum(np.bincount(labels[ground], minlength=_CLUSTERS), 1)
    return np.where(ground, (wet / total)[labels], 0.0).astype(np.float32)
