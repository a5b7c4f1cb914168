"""Which part of an image is water: classical segmentation from one seed, with how far it can be trusted.

Clusters of colour and texture propose regions around the seed; that one is taken whose outline separates best what
lies on its two sides, and a graph cut (GrabCut) draws the outline. Reflections and shade change water's lightness,
seldom its colour against the banks': lightness weighs least.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.vision.outline import outline_contrast
from aerodft.vision.water_features import Float32Image, WaterFeatures
from aerodft.vision.water_margin import margin

_FEW: Final = (2, 3)
_MANY: Final = 5
_PLAIN_WEIGHTS: Final = np.array([1.0, 1.0, 0.0, 1.5], dtype=np.float32)  # of the planes: shade is lightness alone
_WEIGHTS: Final = np.array([1.0, 1.0, 0.3, 1.5], dtype=np.float32)
_CLEAR_PERCENT: Final = 25.0  # of an outline's contrasts: most of it has to be clear
_LEAST_OUTLINE: Final = 20  # pixels
_LARGEST_ISLAND: Final = 0.3  # of the water, where the image cuts it
_CUT_ISLAND: Final = 0.6  # of its shore's length: so short is where the image cuts it; a bank's corner has more
_SPECK: Final = 3e-4  # of the image: what is drier and smaller is a wave, or a boat
_EVERY: Final = 5  # of the pixels is looked at for clusters
_SHARE: Final = 0.2  # of the seed's disc: a cluster with more belongs to the water
_DISC: Final = 0.025  # radius of the seed's disc, of the copy's width
_CLUSTER_SMOOTH_PX: Final = 2.0
_CUT_ITERATIONS: Final = 3
_SURE_PX: Final = 8
_CUT_SCALE: Final = 3.0  # to bytes, of the two colours and the texture
_CUT_MIDDLE: Final = 128.0
_LOOKS: Final = 2  # at bare ground along the water: what hid behind the first
_MASK_SEED: Final = 1

Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class WaterMask:
    """Where the water is in the small copy.

    Attributes:
        water: ``(height, width)``, in one piece.
        outline: ``(height, width)``: its pixels beside what is not water, away from the border of what was looked at.
        contrast: ``(k,)``, of the outline's pixels in the order of ``np.nonzero``: how many standard deviations lie
            between the two sides of it.
        doubtful: Share of the outline along which another clear edge lies inside: what is between may be bare ground.
        stayed: ``(height, width)``: what was taken off because it did not move; None where nothing was.
    """

    water: BoolArray
    outline: BoolArray
    contrast: FloatArray
    doubtful: float = 0.0
    stayed: BoolArray | None = None


def find_water(features: WaterFeatures, seed_px: tuple[float, float], ground: BoolArray) -> WaterMask:
    """The water around a seed.

    Args:
        features: The small copy.
        seed_px: A pixel of it, in the water.
        ground: ``(height, width)``: which pixels show the ground near enough to be measured; no others are water.
    """
    disc = _disc(features.shape, seed_px) & ground
    found = [_cut(features.planes, region, disc, ground) for region in _proposals(features.planes, disc, ground)]
    clearness = [_clearness(features.planes, water, ground) for water in found]
    water = found[int(np.argmax(clearness))]
    along = margin(features.planes, water, disc, ground)
    for _ in range(_LOOKS):
        if not along.bare.any():
            break
        water = _around(_opened(water & ~along.bare) | disc, disc)
        along = margin(features.planes, water, disc, ground)
    outline, contrast = outline_contrast(features.planes, water, ground)
    doubtful = float(np.mean(along.doubtful[outline])) if outline.any() else 0.0
    return WaterMask(water, outline, contrast, doubtful)


def around_seed(wet: BoolArray, shape: tuple[int, int], seed_px: tuple[float, float], ground: BoolArray) -> BoolArray:
    """The piece of ``wet (height, width)`` around a seed, smoothed, without specks."""
    disc = _disc(shape, seed_px) & ground
    return _without_specks(_around(_opened(wet) | disc, disc))


def _proposals(planes: Float32Image, disc: BoolArray, ground: BoolArray) -> list[BoolArray]:
    """Regions around the disc: of few clusters, the clearest of them; and of many, joined.

    Few clusters tell water from land at once where the two are of a kind each; many are needed where water is brown
    here and mirrors the sky there. Joined clusters begin with the disc's own; others join as long as that makes the
    outline clearer.
    """
    few = [_region(_labels(planes, count, ground), disc, ground) for count in _FEW]
    best = few[int(np.argmax([_clearness(planes, region, ground) for region in few]))]
    return [best, _joined(planes, _labels(planes, _MANY, ground), disc, ground)]


def _region(labels: IntArray, disc: BoolArray, ground: BoolArray, joined: tuple[int, ...] = ()) -> BoolArray:
    """The region around the disc that consists of the disc's clusters and of more."""
    return _around(_opened(np.isin(labels, [*_own(labels, disc), *joined]) & ground) | disc, disc)


def _own(labels: IntArray, disc: BoolArray) -> list[int]:
    """The clusters that have a good share of the disc."""
    share = np.bincount(labels[disc]) / max(int(disc.sum()), 1)
    return [int(each) for each in np.flatnonzero(share > _SHARE)]


def _joined(planes: Float32Image, labels: IntArray, disc: BoolArray, ground: BoolArray) -> BoolArray:
    others = [each for each in range(_MANY) if each not in _own(labels, disc)]
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
    values = np.asarray(cv2.GaussianBlur(weighted, (0, 0), _CLUSTER_SMOOTH_PX), dtype=np.float32)
    sample = np.ascontiguousarray(values[ground][::_EVERY])
    if len(sample) <= count:
        return np.zeros(ground.shape, dtype=np.int64)
    cv2.setRNGSeed(_MASK_SEED)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 15, 0.2)
    _, _, centres = cv2.kmeans(sample, count, np.empty(0, dtype=np.int32), criteria, 2, cv2.KMEANS_PP_CENTERS)
    away = [np.sum(np.square(values - centre), axis=-1) for centre in centres]
    return np.asarray(np.argmin(np.stack(away), axis=0), dtype=np.int64)


def _disc(shape: tuple[int, int], seed_px: tuple[float, float]) -> BoolArray:
    disc = np.zeros(shape, dtype=np.uint8)
    cv2.circle(disc, (round(seed_px[0]), round(seed_px[1])), max(2, round(_DISC * max(shape))), 1, -1)
    return disc > 0


def _opened(region: BoolArray) -> BoolArray:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    return np.asarray(cv2.morphologyEx(region.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0)


def _around(region: BoolArray, disc: BoolArray) -> BoolArray:
    """The piece of the region that shares most with the disc; the disc itself where none does."""
    _, labels = cv2.connectedComponents(region.astype(np.uint8), connectivity=4)
    shares = np.bincount(labels[disc & region])
    if not shares[1:].any():
        return disc
    return np.asarray(labels == 1 + int(np.argmax(shares[1:])))


def with_islands(water: BoolArray, ground: BoolArray) -> BoolArray:
    """The water with what it surrounds; land that the image's border cuts is an island where it has more shore.

    Args:
        water: ``(height, width)``.
        ground: What was looked at: its border is the image's, or the horizon's.
    """
    count, labels, facts, _ = cv2.connectedComponentsWithStats((ground & ~water).astype(np.uint8), connectivity=4)
    kernel = np.ones((3, 3), dtype=np.uint8)
    shore = cv2.dilate(water.astype(np.uint8), kernel) > 0
    border = cv2.erode(ground.astype(np.uint8), kernel, borderValue=0) == 0
    on_shore = np.bincount(labels[shore], minlength=count)
    on_border = np.bincount(labels[border], minlength=count)
    small = facts[:, cv2.CC_STAT_AREA] < _LARGEST_ISLAND * np.count_nonzero(water)
    island = (on_border == 0) | (small & (on_border < _CUT_ISLAND * on_shore))
    island[0] = False
    return np.asarray(water | island[labels])


def _cut(planes: Float32Image, region: BoolArray, disc: BoolArray, ground: BoolArray) -> BoolArray:
    """The region with its outline drawn by a graph cut; what is deep inside stays water.

    What is not looked at is land to the cut, whatever it shows: it is given the colours of what land there is.
    """
    land = ground & ~region
    if not land.any():
        return region
    texture = planes[..., 3] - np.median(planes[..., 3])
    colours = _CUT_SCALE * np.dstack([planes[..., 0], planes[..., 1], texture]) + _CUT_MIDDLE
    seen = np.clip(colours, 0, 255).astype(np.uint8)
    seen[~ground] = np.random.default_rng(_MASK_SEED).choice(seen[land], np.count_nonzero(~ground))
    kernel = np.ones((3, 3), dtype=np.uint8)
    deep = cv2.erode(region.astype(np.uint8), kernel, iterations=_SURE_PX) > 0
    labels = np.where(region, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[deep | disc] = cv2.GC_FGD
    labels[~ground] = cv2.GC_BGD
    cv2.setRNGSeed(_MASK_SEED)
    water_model, land_model = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(seen, labels, (0, 0, 0, 0), land_model, water_model, _CUT_ITERATIONS, cv2.GC_INIT_WITH_MASK)
    water = ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)) & ground
    return _without_specks(_around(_opened(np.asarray(water)) | disc, disc))


def _without_specks(water: BoolArray) -> BoolArray:
    count, labels, facts, _ = cv2.connectedComponentsWithStats((~water).astype(np.uint8), connectivity=4)
    speck = facts[:count, cv2.CC_STAT_AREA] < _SPECK * water.size
    speck[0] = False
    return np.asarray(water | speck[labels])
