"""What may be the water of an image: several regions around the seed, each with how clear its outline is.

Few clusters of colour and texture tell water from land at once where the two are of a kind each; many are needed where
water is brown here and mirrors the sky there, or where bushes differ from all the rest by more than water does from
sand. All of it happens on a copy of half the size: which region it is does not need more, and its outline is drawn
again afterwards.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, IntArray
from aerodft.vision.outline import outline_contrast
from aerodft.vision.water_cut import cut, disc_around, opened, overlap, piece_around
from aerodft.vision.water_features import Float32Image

_FEW: Final = (2, 3)
_MANY: Final = (4, 6, 8)
_JOINED: Final = 5
_PLAIN_WEIGHTS: Final = np.array([1.0, 1.0, 0.0, 1.5], dtype=np.float32)  # of the planes: shade is lightness alone
_WEIGHTS: Final = np.array([1.0, 1.0, 0.3, 1.5], dtype=np.float32)
_CLEAR_PERCENT: Final = 25.0  # of an outline's contrasts: most of it has to be clear
_LEAST_OUTLINE: Final = 20  # pixels
_ALIKE: Final = 0.97  # overlap: two such regions are one
_EVERY: Final = 5  # of the pixels is looked at for clusters
_SHARE: Final = 0.2  # of the seed's disc: a cluster with more belongs to the water
_SMOOTH_PX: Final = 1.0
_SEED: Final = 1


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A region that may be the water.

    Attributes:
        water: ``(height, width)`` of the copy of half the size, in one piece.
        clearness: Standard deviations between its outline's two sides, along most of it.
    """

    water: BoolArray
    clearness: float


def outlines(planes: Float32Image, seed_px: tuple[float, float], ground: BoolArray) -> list[Outline]:
    """What may be the water around a seed, the clearest first; at least one.

    Args:
        planes: ``(height, width, 4)`` of a copy of half the size.
        seed_px: A pixel of it, in the water.
        ground: ``(height, width)``: what is looked at.
    """
    disc = disc_around(ground.shape, seed_px) & ground
    regions = [_region(_labels(planes, count, ground), disc, ground) for count in (*_FEW, *_MANY)]
    regions.append(_joined(planes, _labels(planes, _JOINED, ground), disc, ground))
    found = _unlike([cut(planes, region, disc, ground) for region in _unlike(regions)])
    clear = [Outline(water, _clearness(planes, water, ground)) for water in found]
    return sorted(clear, key=lambda each: -each.clearness)


def _unlike(regions: list[BoolArray]) -> list[BoolArray]:
    kept: list[BoolArray] = []
    for region in regions:
        if all(overlap(region, other) <= _ALIKE for other in kept):
            kept.append(region)
    return kept


def _region(labels: IntArray, disc: BoolArray, ground: BoolArray, joined: tuple[int, ...] = ()) -> BoolArray:
    """The region around the disc that consists of the disc's clusters and of more."""
    return piece_around(opened(np.isin(labels, [*_own(labels, disc), *joined]) & ground) | disc, disc)


def _own(labels: IntArray, disc: BoolArray) -> list[int]:
    """The clusters that have a good share of the disc."""
    share = np.bincount(labels[disc]) / max(int(disc.sum()), 1)
    return [int(each) for each in np.flatnonzero(share > _SHARE)]


def _joined(planes: Float32Image, labels: IntArray, disc: BoolArray, ground: BoolArray) -> BoolArray:
    """The disc's clusters, with others as long as they make the outline clearer."""
    others = [each for each in range(_JOINED) if each not in _own(labels, disc)]
    best = _region(labels, disc, ground)
    joined: tuple[int, ...] = ()
    clearest = _clearness(planes, best, ground)
    while others:
        found = [_region(labels, disc, ground, (*joined, each)) for each in others]
        scores = [_clearness(planes, region, ground) for region in found]
        top = int(np.argmax(scores))
        if scores[top] <= clearest:
            break
        clearest, best, joined = scores[top], found[top], (*joined, others.pop(top))
    return best


def _clearness(planes: Float32Image, region: BoolArray, ground: BoolArray) -> float:
    """How well a region's outline separates its sides, along most of it."""
    _, contrast = outline_contrast(planes, region, ground)
    return float(np.percentile(contrast, _CLEAR_PERCENT)) if len(contrast) >= _LEAST_OUTLINE else 0.0


def _labels(planes: Float32Image, count: int, ground: BoolArray) -> IntArray:
    """The cluster of every pixel, ``(height, width)``."""
    weighted = planes * (_PLAIN_WEIGHTS if count in _FEW else _WEIGHTS)
    values = np.asarray(cv2.GaussianBlur(weighted, (0, 0), _SMOOTH_PX), dtype=np.float32)
    sample = np.ascontiguousarray(values[ground][::_EVERY])
    if len(sample) <= count:
        return np.zeros(ground.shape, dtype=np.int64)
    cv2.setRNGSeed(_SEED)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 15, 0.2)
    _, _, centres = cv2.kmeans(sample, count, np.empty(0, dtype=np.int32), criteria, 2, cv2.KMEANS_PP_CENTERS)
    away = [np.sum(np.square(values - centre), axis=-1) for centre in centres]
    return np.asarray(np.argmin(np.stack(away), axis=0), dtype=np.int64)
