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
import numpy.typing as npt

from aerodft.model.arrays import BoolArray, IntArray
from aerodft.vision.water_features import BLUE_TO_GREEN, RED_TO_GREEN, TEXTURE, Float32Image, outline_contrast

_SPECK: Final = 3e-4  # of the image: what is drier and smaller is a wave, or a boat
_DISC: Final = 0.025  # radius of the seed's disc, of the copy's width
_ITERATIONS: Final = 3
_DEEP: Final = 1 / 60  # of the copy's width: so far inside a region is water surely
_SCALE: Final = 3.0  # to bytes, of the two colours and the texture
_MIDDLE: Final = 128.0
_SEED: Final = 1

Bytes = npt.NDArray[np.uint8]
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


def disc_around(shape: tuple[int, int], seed_px: tuple[float, float]) -> BoolArray:
    """What a seed says to be water, ``(height, width)``."""
    disc = np.zeros(shape, dtype=np.uint8)
    cv2.circle(disc, (round(seed_px[0]), round(seed_px[1])), max(2, round(_DISC * max(shape))), 1, -1)
    return disc > 0


def opened(region: BoolArray) -> BoolArray:
    """A region without what is thinner than five pixels."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    return np.asarray(cv2.morphologyEx(region.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0)


def piece_around(region: BoolArray, disc: BoolArray) -> BoolArray:
    """The piece of the region that shares most with the disc; the disc itself where none does."""
    _, labels = cv2.connectedComponents(region.astype(np.uint8), connectivity=4)
    shares = np.bincount(labels[disc & region])
    if not shares[1:].any():
        return disc
    return np.asarray(labels == 1 + int(np.argmax(shares[1:])))


def without_specks(water: BoolArray) -> BoolArray:
    """A region with its smallest holes filled."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats((~water).astype(np.uint8), connectivity=4)
    speck = facts[:count, cv2.CC_STAT_AREA] < _SPECK * water.size
    speck[0] = False
    return np.asarray(water | speck[labels])


def overlap(one: BoolArray, other: BoolArray) -> float:
    """Intersection over union of two regions."""
    return float(np.count_nonzero(one & other)) / max(int(np.count_nonzero(one | other)), 1)


def cut(planes: Float32Image, region: BoolArray, disc: BoolArray, ground: BoolArray) -> BoolArray:
    """The region with its outline drawn by a graph cut; what is deep inside stays water.

    What is not looked at is land to the cut, whatever it shows: it is given the colours of what land there is.

    Args:
        planes: ``(height, width, 4)`` of ``WaterFeatures``.
        region: ``(height, width)``.
        disc: Part of it that is water surely.
        ground: What is looked at.
    """
    land = ground & ~region
    if not land.any():
        return region
    seen = _colours(planes)
    seen[~ground] = np.random.default_rng(_SEED).choice(seen[land], np.count_nonzero(~ground))
    deep_px = max(1, round(_DEEP * float(max(region.shape))))
    deep = cv2.erode(region.astype(np.uint8), np.ones((3, 3), dtype=np.uint8), iterations=deep_px)
    labels = np.where(region, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[(deep > 0) | disc] = cv2.GC_FGD
    labels[~ground] = cv2.GC_BGD
    cv2.setRNGSeed(_SEED)
    water_model, land_model = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(seen, labels, (0, 0, 0, 0), land_model, water_model, _ITERATIONS, cv2.GC_INIT_WITH_MASK)
    water = ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)) & ground
    return without_specks(piece_around(opened(np.asarray(water)) | disc, disc))


def _colours(planes: Float32Image) -> Bytes:
    texture = planes[..., TEXTURE] - np.median(planes[..., TEXTURE])
    colours = np.dstack([planes[..., RED_TO_GREEN], planes[..., BLUE_TO_GREEN], texture])
    return np.clip(_SCALE * colours + _MIDDLE, 0, 255).astype(np.uint8)


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
