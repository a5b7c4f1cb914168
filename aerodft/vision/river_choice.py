"""Which of the regions around a seed is the river: the clearest that lies between two banks.

Another that is nearly as clear is a doubt: the river may be that one. How far its banks are from those of the first is
then part of the widths' uncertainty, one error that all of them share.
"""

from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from aerodft.geometry.robust import middle_and_std
from aerodft.model.arrays import BoolArray, FloatArray
from aerodft.vision.outline import outline_contrast
from aerodft.vision.river_checks import CLEAR, no_river
from aerodft.vision.transects import transects
from aerodft.vision.water import WaterMask, find_water, with_islands
from aerodft.vision.water_cut import opened, overlap
from aerodft.vision.water_features import BLUE_TO_GREEN, RED_TO_GREEN, TEXTURE, Float32Image, WaterFeatures
from aerodft.vision.water_outlines import Outline, outlines
from aerodft.vision.water_plane import WaterPlane, ground_of
from aerodft.vision.waterway import Centreline, centreline

_HALF_AS_CLEAR: Final = 0.55  # as the clearest: a region less clear is not preferred for having two banks
_NEARLY_AS_CLEAR: Final = 0.8  # as the river: it may be the river too
_LEAST_TRANSECTS: Final = 4  # between two banks, a tenth of the width apart
_APART: Final = 0.1
_SAME_PX: Final = 2.0  # of the copy of half the size: so near two outlines are one
_SAME: Final = 0.02  # of the width, likewise
_LIKE: Final = 3.0  # standard deviations of the water's looks


def likeliest_water(
    plane: WaterPlane, features: WaterFeatures, seed_px: tuple[float, float], ground: BoolArray
) -> WaterMask:
    """The water of the river around a seed, with what else may be it.

    Args:
        plane: The water's.
        features: The small copy.
        seed_px: A pixel of it, in the water.
        ground: ``(height, width)``: which pixels show the ground near enough to be measured; no others are water.
    """
    half = features.halved()
    seen = ground_of(plane, half)
    found = outlines(half.planes, (0.5 * seed_px[0] - 0.25, 0.5 * seed_px[1] - 0.25), seen)
    enough = _HALF_AS_CLEAR * found[0].clearness
    rivers = [each for each in found if each.clearness >= enough and _has_two_banks(plane, half, each, seen)]
    drawn = ((rank, find_water(features, seed_px, ground, each.water)) for rank, each in enumerate(rivers))
    told = next(((rank, water) for rank, water in drawn if no_river(features, water, ground) is None), None)
    if told is None:
        return find_water(features, seed_px, ground, _of_no_river(found).water)
    rank, water = told
    first = rivers[rank]
    water = replace(water, apart=_apart(half.planes, first.water, seen))
    others = [each.water for each in rivers[rank + 1 :] if each.clearness >= _NEARLY_AS_CLEAR * first.clearness]
    if not others:
        return water
    agreement = min(overlap(first.water, each) for each in others)
    return replace(water, regions=(first.water, *others), agreement=agreement)


def _of_no_river(found: list[Outline]) -> Outline:
    """What says best why there is none: the clearest, or the largest where none is clear."""
    return found[0] if found[0].clearness >= CLEAR else max(found, key=lambda each: np.count_nonzero(each.water))


def _apart(planes: Float32Image, water: BoolArray, ground: BoolArray) -> float:
    """How large the largest other piece of ground is that looks like the water, of the water's own area.

    Lightness is not looked at.
    """
    middle, std = middle_and_std(planes[water])
    far = np.abs(planes - middle) > _LIKE * (std + 1.0)
    like = ~np.any(far[..., [RED_TO_GREEN, BLUE_TO_GREEN, TEXTURE]], axis=-1) & ground
    beside = cv2.dilate(water.astype(np.uint8), np.ones((9, 9), dtype=np.uint8)) > 0
    _, _, facts, _ = cv2.connectedComponentsWithStats(opened(like & ~beside).astype(np.uint8), connectivity=4)
    return float(facts[1:, cv2.CC_STAT_AREA].max(initial=0)) / max(int(np.count_nonzero(water)), 1)


def _has_two_banks(plane: WaterPlane, half: WaterFeatures, found: Outline, ground: BoolArray) -> bool:
    outline, contrast = outline_contrast(half.planes, found.water, ground)
    if no_river(half, WaterMask(found.water, outline, contrast), ground) is not None:
        return False
    channel = with_islands(found.water, ground)
    line = centreline(plane, half, channel)
    if line is None:
        return False
    stations_m = np.arange(0.0, float(line.stations_m()[-1]), _APART * line.width_m)
    across = transects(plane, half, (channel, found.water, ground), line, stations_m)
    return int(np.count_nonzero(np.isfinite(across.left_m + across.right_m))) >= _LEAST_TRANSECTS


def otherwise_m(
    plane: WaterPlane, features: WaterFeatures, water: WaterMask, line: Centreline, stations_m: FloatArray
) -> FloatArray:
    """How much wider the river is if another region is it, at transects ``(n,)``; 0 where it is the same.

    Args:
        plane: The water's.
        features: The small copy; its planes are not looked at.
        water: What was found, with those regions.
        line: The line that is crossed.
        stations_m: ``(n,)`` where.
    """
    most = np.zeros(len(stations_m))
    doubts = [(water.regions[0], each) for each in water.regions[1:]]
    doubts += [(water.water, each) for each in (water.less, water.more) if each is not None]
    whole = features.without_planes()
    for region, other in doubts:
        copy = whole if region.shape == whole.shape else whole.halved()
        seen = ground_of(plane, copy)
        width, otherwise = (_widths_m(plane, copy, each, seen, line, stations_m) for each in (region, other))
        same_m = np.maximum(_SAME * line.width_m, _SAME_PX * _pixel_m(plane, copy, line, stations_m))
        wider = np.nan_to_num(otherwise - width)
        most = np.where(np.abs(wider) > np.maximum(np.abs(most), same_m), wider, most)
    return most


def _widths_m(
    plane: WaterPlane, copy: WaterFeatures, region: BoolArray, ground: BoolArray, line: Centreline, at_m: FloatArray
) -> FloatArray:
    """Widths ``(n,)`` of a region across a line; NaN where it has not both banks there."""
    across = transects(plane, copy, (with_islands(region, ground), region, ground), line, at_m)
    return np.asarray(across.left_m - across.right_m)


def _pixel_m(plane: WaterPlane, copy: WaterFeatures, line: Centreline, at_m: FloatArray) -> FloatArray:
    """How far apart two neighbouring pixels of the copy are across the river, ``(n,)``."""
    centres, along = line.at(at_m)
    step = 0.05 * line.width_m * np.stack([-along[:, 1], along[:, 0]], axis=-1)
    moved = np.linalg.norm(plane.pixels_px(centres + step) - plane.pixels_px(centres - step), axis=-1) * copy.scale
    return np.asarray(0.1 * line.width_m / np.maximum(np.nan_to_num(moved), 1e-6))
