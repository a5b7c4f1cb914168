"""Which of the regions around a seed is the river, and why an image shows none, as far as the image itself says so.

The river is the clearest region that lies between two banks. Another that is nearly as clear is a doubt: the river may
be that one. How far its banks are from those of the first is then part of the widths' uncertainty, one error that all
of them share.
"""

import math
from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from aerodft.geometry import middle_and_std, robust_std
from aerodft.model import BoolArray, FloatArray, ImageArray
from aerodft.vision.river.centreline import Centreline, centreline, transects
from aerodft.vision.river.status import NoRiver, RiverStatus
from aerodft.vision.river.water import Outline, WaterMask, find_water, opened, outlines, overlap, with_islands
from aerodft.vision.river.water_features import (
    BLUE_TO_GREEN,
    LIGHT,
    LOGARITHM,
    RED_TO_GREEN,
    TEXTURE,
    Float32Image,
    WaterFeatures,
    WaterPlane,
    ground_of,
    outline_contrast,
)

_NIGHT: Final = 20.0  # grey levels: where all but the brightest twentieth is darker, colours are noise
_WHITE: Final = 250  # grey levels, of the darkest channel
_BURNT_BESIDE: Final = np.ones((7, 7), dtype=np.uint8)  # of the small copy
_MOST_BURNT: Final = 0.4  # of an image, or of an outline; rivers that glare have up to 0.25
_EVERY: Final = 8  # of the pixels is looked at for that
_LEAST_PIXELS: Final = 100
_LEAST_LAND: Final = 0.01  # of what is looked at
_COLOURS: Final = np.array([1.0, 1.0, 0.0, 0.0], dtype=np.float32)
_GREEN: Final = (2.0, -14.0)  # where both are lower than these, something grows
_MANY_COLOURS: Final = 0.03  # ratios of red to green vary by 1 to 2 % nearby in water, by 3 to 10 % on natural ground
CLEAR: Final = 2.3
"""Standard deviations between an outline's sides, along three quarters of it, at the least; meadows reach 2.0."""
_CLEAR_IN_COLOUR: Final = 1.0  # likewise by colour alone; rivers have 1.4 and more, shadows 0.8 at most
_BESIDE: Final = np.ones((13, 13), dtype=np.uint8)  # of the small copy, around what was found
_NO_ROAD: Final = math.log(0.8) * LOGARITHM  # red to green: what has so little red is blue or green, as no road is
_EVEN: Final = 0.035  # of the lightness, beside its trend over the water: waves are 6 % and more
_EDGE_PX: Final = 9  # of the small copy: so near an outline the two sides' colours mix
_STRAIGHT: Final = 0.006  # of the width: rms of bank points about a line
_ONE_WIDTH: Final = 0.015  # relative spread of the widths
_FEWEST: Final = 6  # bank points that tell whether a bank is straight
_HALF_AS_CLEAR: Final = 0.55  # as the clearest: a region less clear is not preferred for having two banks
_NEARLY_AS_CLEAR: Final = 0.8  # as the river: it may be the river too
_LEAST_TRANSECTS: Final = 4  # between two banks, a tenth of the width apart
_APART: Final = 0.1
_SAME_PX: Final = 2.0  # of the copy of half the size: so near two outlines are one
_SAME: Final = 0.02  # of the width, likewise
_LIKE: Final = 3.0  # standard deviations of the water's looks


def no_light(image: ImageArray) -> NoRiver | None:
    """Whether an image ``(height, width, 3)`` BGR is too dark, or burnt out."""
    few = np.ascontiguousarray(image[::_EVERY, ::_EVERY])
    if float(np.percentile(cv2.cvtColor(few, cv2.COLOR_BGR2GRAY), 95)) < _NIGHT:
        return NoRiver(RiverStatus.TOO_DARK, "the image is too dark: night, or a covered lens")
    if float(np.mean(np.min(few, axis=-1) >= _WHITE)) > _MOST_BURNT:
        return NoRiver(RiverStatus.TOO_BRIGHT, "the image is burnt out: glare, or the exposure is too long")
    return None


def no_river(features: WaterFeatures, found: WaterMask, ground: BoolArray) -> NoRiver | None:
    """Whether what was found around the seed is no river between banks.

    Args:
        features: The small copy.
        found: What was found.
        ground: What was looked at.
    """
    if (dry := _dry_ground(features, found.water)) is not None:
        return dry
    if np.count_nonzero(ground & ~found.water) < _LEAST_LAND * np.count_nonzero(ground):
        return NoRiver(RiverStatus.ALL_WATER, "no bank is in view: all of the image looks alike")
    if len(found.contrast) == 0:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "no bank is in view: the water ends where the image does")
    if float(np.mean(_burnt_out(features)[found.outline])) > _MOST_BURNT:
        reason = "most of what may be a bank is burnt out: glare, or the exposure is too long"
        return NoRiver(RiverStatus.TOO_BRIGHT, reason)
    clear = float(np.percentile(found.contrast, 25))
    if clear < CLEAR:
        reason = f"water and bank cannot be told apart: {clear:.1f} standard deviations between them, {CLEAR:g} needed"
        return NoRiver(RiverStatus.NO_CONTRAST, reason)
    # Bare ground beside water is of its colours often enough, and has been told from it already.
    return None if found.trimmed else _shadow(features.planes, found.water, ground)


def _burnt_out(features: WaterFeatures) -> BoolArray:
    """Which pixels ``(height, width)`` are white, or lie beside such: there are no colours to tell anything by."""
    white = np.min(features.pixels, axis=-1) >= _WHITE
    return np.asarray(cv2.dilate(white.astype(np.uint8), _BURNT_BESIDE) > 0)


def _shadow(planes: Float32Image, water: BoolArray, ground: BoolArray) -> NoRiver | None:
    _, in_colour = outline_contrast(planes * _COLOURS, water, ground)
    if float(np.percentile(in_colour, 25)) >= _CLEAR_IN_COLOUR:
        return None
    beside = (cv2.dilate(water.astype(np.uint8), _BESIDE) > 0) & ground & ~water
    if float(np.median(planes[water][:, LIGHT])) >= float(np.median(planes[beside][:, LIGHT])):
        return None
    return NoRiver(RiverStatus.NO_WATER, "what was found has the colours of what lies beside it, but darker: a shadow?")


def _dry_ground(features: WaterFeatures, water: BoolArray) -> NoRiver | None:
    red, blue = (float(np.median(features.planes[water][:, plane])) for plane in (RED_TO_GREEN, BLUE_TO_GREEN))
    if red < _GREEN[0] and blue < _GREEN[1]:
        return NoRiver(RiverStatus.NO_WATER, "where water is looked for something grows: is the seed on a bank?")
    variety = features.variety(water)
    if variety <= _MANY_COLOURS:
        return None
    reason = f"where water is looked for colours vary by {100 * variety:.0f} % from place to place, as on dry ground"
    return NoRiver(RiverStatus.NO_WATER, f"{reason}; {100 * _MANY_COLOURS:g} % is the most for water")


def like_a_road(features: WaterFeatures, water: BoolArray, banks_en_m: FloatArray) -> NoRiver | None:
    """Whether what was found is as even as no water is, between two straight edges.

    Args:
        features: The small copy.
        water: ``(height, width)``: what was found.
        banks_en_m: ``(n, 2, 2)``: left, then right bank of each transect, east and north.
    """
    if float(np.median(features.planes[water][:, RED_TO_GREEN])) < _NO_ROAD:
        return None
    if len(banks_en_m) < _FEWEST or _unevenness(features, water) > _EVEN:
        return None
    widths_m = np.linalg.norm(banks_en_m[:, 0] - banks_en_m[:, 1], axis=-1)
    width_m = float(np.median(widths_m))
    straight = max(_bend_m(banks_en_m[:, side]) for side in range(2)) < _STRAIGHT * width_m
    if not straight and robust_std(widths_m - width_m) > _ONE_WIDTH * width_m:
        return None
    how = "between two straight edges" if straight else "and of one width"
    reason = f"where water is looked for it is even, {how}: a road? If it is water, click it (`seed`)"
    return NoRiver(RiverStatus.NO_WATER, reason)


def _unevenness(features: WaterFeatures, water: BoolArray) -> float:
    """Spread of the lightness within the water, relative, beside what a smooth trend explains."""
    inside = cv2.erode(water.astype(np.uint8), np.ones((_EDGE_PX, _EDGE_PX), dtype=np.uint8)) > 0
    rows, columns = np.nonzero(inside)
    if len(rows) < _LEAST_PIXELS:
        return math.inf
    v, u = rows / features.shape[0], columns / features.shape[1]
    trend = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    light = features.planes[rows, columns, LIGHT].astype(np.float64)
    rest = light - trend @ np.linalg.lstsq(trend, light)[0]
    return robust_std(rest) / LOGARITHM


def _bend_m(points_en_m: FloatArray) -> float:
    """How far points ``(n, 2)`` are from the line that fits them best, root mean square."""
    return float(np.linalg.svd(points_en_m - points_en_m.mean(axis=0), compute_uv=False)[-1]) / math.sqrt(
        len(points_en_m)
    )


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


def alternative_width_delta_m(
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
