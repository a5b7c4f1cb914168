"""Bare or grown ground along the water that the water's outline may have taken in: seen by an edge inside.

The middle of the water says what water looks like, and the band along its outline is cut anew. What that takes away
is ground where it has more texture than the water beside it, or is greener. Where it is neither it may be ground, if
its edge is clear, and it is no shade or mirrored bank: those are darker than the water beside them. Glitter is far
brighter, and foam is rough because of what is far brighter in it.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray
from aerodft.vision.outline import outline_contrast
from aerodft.vision.water_features import BLUE_TO_GREEN, LIGHT, RED_TO_GREEN, TEXTURE, Float32Image

_BAND: Final = 0.35  # of half the water's width: so far from the outline it may be ground
_SCALES: Final = np.array([4.0, 4.0, 2.0, 3.0], dtype=np.float32)  # to bytes, around the water's own middle
_MIDDLE: Final = 128.0
_ITERATIONS: Final = 3
_SEED: Final = 1
_LEAST: Final = 0.001  # of the copy: a smaller piece is foam, or a stone
_THICK_PX: Final = 5  # a thinner piece is the outline's own blur
_CLEAR: Final = 1.45  # standard deviations across the inner edge, lightness left out
_ROUGHER: Final = 2.0  # of twelve times the texture's logarithm: about a sixth more than the water's beside it
_NO_LIGHT: Final = np.array([1.0, 1.0, 0.0, 1.0], dtype=np.float32)
_STRIP: Final = np.ones((11, 11), dtype=np.uint8)  # around a piece: the water next to it
_DARKER: Final = -0.5  # forty times the logarithm of the lightness: about 1 %
GLITTER: Final = 12.0  # about 35 % brighter than the water beside it
_BRIGHTEST: Final = 97.0  # percent of a piece
_FOAM: Final = 15.0  # likewise: its brightest, about 45 %
_UNEVEN: Final = 2.2  # of the standard deviation of the water's lightness beside it; real banks here have up to 2.0
_GREENER: Final = -1.5  # likewise of red to green: the colour of what grows there
_NOT_BLUER: Final = 1.0  # likewise of blue to green: where the sky is mirrored it is more


@dataclass(frozen=True, slots=True, eq=False)
class Margin:
    """Ground along the water's outline, and what may be ground there, ``(height, width)`` each."""

    bare: BoolArray
    doubtful: BoolArray


def margin(planes: Float32Image, water: BoolArray, sure: BoolArray, ground: BoolArray) -> Margin:
    """The ground along the outline that was taken for water.

    Args:
        planes: ``(height, width, 4)`` of ``WaterFeatures``.
        water: ``(height, width)``, with that ground.
        sure: Part of it that is water.
        ground: What is looked at.
    """
    found = Margin(np.zeros(water.shape, dtype=bool), np.zeros(water.shape, dtype=bool))
    if not np.any(ground & ~water):
        return found
    inner = _cut(planes, water, sure, ground)
    kernel = np.ones((_THICK_PX, _THICK_PX), dtype=np.uint8)
    taken = cv2.morphologyEx((water & ~inner).astype(np.uint8), cv2.MORPH_OPEN, kernel)
    count, pieces, facts, _ = cv2.connectedComponentsWithStats(taken, connectivity=8)
    share = facts[:count, cv2.CC_STAT_AREA] / water.size
    outline, contrast = outline_contrast(planes * _NO_LIGHT, inner, ground)
    clearness = np.zeros(water.shape)
    clearness[outline] = contrast
    for number in range(1, count):
        piece = np.asarray(pieces == number)
        near = cv2.dilate(piece.astype(np.uint8), kernel) > 0
        edge = clearness[near & outline]
        beside = cv2.dilate(piece.astype(np.uint8), _STRIP) > 0
        beside &= inner
        if share[number] < _LEAST or len(edge) == 0 or not beside.any():
            continue
        apart, clear = planes[piece].mean(axis=0) - planes[beside].mean(axis=0), float(np.median(edge))
        is_rough = _is_rougher(apart) and not _is_foam(planes[piece][:, LIGHT], planes[beside][:, LIGHT])
        if clear > _CLEAR and (is_rough or _is_greener(apart)):
            found.bare[near & water & ~inner] = True
        elif clear > _CLEAR and _may_be_ground(apart):
            found.doubtful[near & water & ~inner] = True
    return found


def _cut(planes: Float32Image, water: BoolArray, sure: BoolArray, ground: BoolArray) -> BoolArray:
    to_land = cv2.distanceTransform(1 - (ground & ~water).astype(np.uint8), cv2.DIST_L2, 5)
    core = water & (to_land >= _BAND * float(np.percentile(to_land[water], 95)))
    middle = np.median(planes[core | sure], axis=0)
    scaled = (planes - middle) * _SCALES
    colours = np.dstack([scaled[..., 0], scaled[..., 1], scaled[..., 2] + scaled[..., 3]]) + _MIDDLE
    labels = np.full(water.shape, cv2.GC_BGD, dtype=np.uint8)
    labels[water] = cv2.GC_PR_BGD
    labels[core | sure] = cv2.GC_FGD
    cv2.setRNGSeed(_SEED)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    seen = np.clip(colours, 0, 255).astype(np.uint8)
    cv2.grabCut(seen, labels, (0, 0, 0, 0), *models, _ITERATIONS, cv2.GC_INIT_WITH_MASK)
    return np.asarray((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))


def _is_rougher(apart: Float32Image) -> bool:
    """Whether a piece has more texture than the water next to it, ``apart (4,)`` of the planes; glitter has it too."""
    return bool(apart[TEXTURE] > _ROUGHER and apart[LIGHT] < GLITTER)


def _is_foam(piece: Float32Image, beside: Float32Image) -> bool:
    """Whether a piece's lightness ``(n,)`` is that of bright spots, far more uneven than the water's next to it."""
    brightest = float(np.percentile(piece, _BRIGHTEST)) - float(beside.mean())
    return brightest > _FOAM and float(piece.std()) > _UNEVEN * float(beside.std())


def _is_greener(apart: Float32Image) -> bool:
    """Whether a piece is greener than the water next to it, and neither darker nor bluer: no shade, and no sky."""
    return bool(apart[RED_TO_GREEN] < _GREENER and apart[BLUE_TO_GREEN] < _NOT_BLUER and _may_be_ground(apart))


def _may_be_ground(apart: Float32Image) -> bool:
    """Whether a piece is neither shade nor glitter: not darker than the water next to it, and not glaring."""
    return bool(_DARKER < apart[LIGHT] < GLITTER)
