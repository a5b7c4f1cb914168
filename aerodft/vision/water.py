"""Which part of an image is water: classical segmentation from one seed, with how far it can be trusted.

A region that is about the water gets its outline from a graph cut, and bare ground along it is taken off. Reflections
and shade change water's lightness, seldom its colour against the banks': lightness weighs least.
"""

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.vision.outline import outline_contrast
from aerodft.vision.water_cut import cut, disc_around, opened, piece_around, without_specks
from aerodft.vision.water_features import WaterFeatures
from aerodft.vision.water_margin import margin
from aerodft.vision.water_mirror import with_mirrored_banks

_LARGEST_ISLAND: Final = 0.3  # of the water, where the image cuts it
_CUT_ISLAND: Final = 0.6  # of its shore's length: so short is where the image cuts it; a bank's corner has more
_SEVERED: Final = 0.03  # of the water
_LOOKS: Final = 2  # at bare ground along the water: what hid behind the first


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
        trimmed: Whether bare ground along it was taken off.
        less: ``(height, width)``: the same without what may be bare ground; None where nothing may.
        more: ``(height, width)``: the same with what may be water that mirrors a bank, or a beach; None likewise.
        regions: ``(height, width)`` each, of half the size: about the water, and what else nearly as clear may be it;
            empty where nothing else may.
        apart: How large the largest other piece is that looks like it, of its own area: another arm?
        agreement: The least share (overlap) that the first has with another of them.
    """

    water: BoolArray
    outline: BoolArray
    contrast: FloatArray
    doubtful: float = 0.0
    stayed: BoolArray | None = None
    trimmed: bool = False
    less: BoolArray | None = None
    more: BoolArray | None = None
    regions: tuple[BoolArray, ...] = ()
    apart: float = 0.0
    agreement: float = 1.0


def find_water(
    features: WaterFeatures, seed_px: tuple[float, float], ground: BoolArray, region: BoolArray
) -> WaterMask:
    """The water around a seed.

    Args:
        features: The small copy.
        seed_px: A pixel of it, in the water.
        ground: ``(height, width)``: which pixels show the ground near enough to be measured; no others are water.
        region: About the water, of any size.
    """
    disc = disc_around(features.shape, seed_px) & ground
    about = cv2.resize(region.astype(np.uint8), features.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    drawn = cut(features.planes, about & ground, disc, ground)
    whole, brighter = with_mirrored_banks(features, drawn, disc, ground)
    water = whole
    along = margin(features.planes, water, disc, ground)
    for _ in range(_LOOKS):
        if not along.bare.any():
            break
        shrunk = _without(water, along.bare, disc)
        if shrunk is None:
            break
        water = shrunk
        along = margin(features.planes, water, disc, ground)
    outline, contrast = outline_contrast(features.planes, water, ground)
    more = None if brighter is None else water | (brighter & ~whole)
    found = WaterMask(water, outline, contrast, trimmed=water is not whole, more=more)
    if not along.doubtful.any():
        return found
    doubtful = float(np.mean(along.doubtful[outline])) if outline.any() else 0.0
    return replace(found, doubtful=doubtful, less=_without(water, along.doubtful, disc))


def _without(water: BoolArray, taken: BoolArray, disc: BoolArray) -> BoolArray | None:
    """The water without a margin; None where that severs it: what spans a river is not along it."""
    left = piece_around(opened(water & ~taken) | disc, disc)
    severed = np.count_nonzero(water & ~taken & ~left)
    return left if severed <= _SEVERED * np.count_nonzero(water) else None


def around_seed(wet: BoolArray, shape: tuple[int, int], seed_px: tuple[float, float], ground: BoolArray) -> BoolArray:
    """The piece of ``wet (height, width)`` around a seed, smoothed, without specks."""
    disc = disc_around(shape, seed_px) & ground
    return without_specks(piece_around(opened(wet) | disc, disc))


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
