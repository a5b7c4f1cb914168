"""Why an image shows no river whose banks could be told, as far as the image itself says so."""

import math
from typing import Final

import cv2
import numpy as np

from aerodft.geometry.robust import robust_std
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.vision.outline import outline_contrast
from aerodft.vision.river_status import NoRiver, RiverStatus
from aerodft.vision.water import WaterMask
from aerodft.vision.water_features import BLUE_TO_GREEN, LIGHT, LOGARITHM, RED_TO_GREEN, Float32Image, WaterFeatures

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
    reason = f"where water is looked for it is even, {how}: a road? If it is water, click it (--seed)"
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
