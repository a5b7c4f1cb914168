"""Why an image shows no river: no light, no water plane, no water, nobody can tell, or a road."""

import math
from typing import Final

import cv2
import numpy as np

from aerodft.geometry import robust_std
from aerodft.model import BoolArray, FloatArray, ImageArray
from aerodft.vision.river.centreline import sample_mask
from aerodft.vision.river.status import NoRiver, RiverStatus
from aerodft.vision.river.water import RiverHints, SmallCopy, WaterMask, WaterPlane

_NIGHT: Final = 20.0  # grey levels: where all but the brightest twentieth is darker, colours are noise
_WHITE: Final = 250  # grey levels, of the darkest channel
_MOST_BURNT: Final = 0.4  # of an image; rivers that glare have up to 0.25
_EVERY: Final = 8  # of the pixels is looked at for that
_LEAST_WATER: Final = 0.004  # of what is looked at
_LEAST_LAND: Final = 0.01  # of what is looked at
_LEAST_SURE: Final = 0.4  # of what may be water; 26 rivers in pictures not trained on have 0.5 and more
_NO_ROAD: Final = 0.8  # red to green: what has so little red is blue or green, as no road is
_EVEN: Final = 0.035  # of the lightness, beside its trend over the water: waves are 6 % and more
_EDGE_PX: Final = 9  # of the small copy: so near an outline the two sides' colours mix
_LEAST_PIXELS: Final = 100
_STRAIGHT: Final = 0.006  # of the width: rms of bank points about a line
_ONE_WIDTH: Final = 0.015  # relative spread of the widths
_FEWEST: Final = 6  # bank points that tell whether a bank is straight


def unfit(
    image: ImageArray, plane: WaterPlane, copy: SmallCopy, ground: BoolArray, hints: RiverHints
) -> NoRiver | None:
    """Why no water is looked for at all."""
    few = np.ascontiguousarray(image[::_EVERY, ::_EVERY])
    if float(np.percentile(cv2.cvtColor(few, cv2.COLOR_BGR2GRAY), 95)) < _NIGHT:
        return NoRiver(RiverStatus.TOO_DARK, "the image is too dark: night, or a covered lens")
    if float(np.mean(np.min(few, axis=-1) >= _WHITE)) > _MOST_BURNT:
        return NoRiver(RiverStatus.TOO_BRIGHT, "the image is burnt out: glare, or the exposure is too long")
    if not ground.any():
        up = "the image shows no water plane near enough: it looks too far up, or `max_range_m` is too short"
        return NoRiver(RiverStatus.ABOVE_HORIZON, up if plane.height_m > 0 else "the water would be above the camera")
    for stroke in hints.water:
        if not np.all(sample_mask(ground, copy.to_small(np.asarray(stroke)))):
            where = "the water is pointed at where there is no ground near enough to be measured"
            return NoRiver(RiverStatus.SEED_OFF_GROUND, where)
    return None


def no_water(water: WaterMask, ground: BoolArray) -> NoRiver | None:
    """Why what the network sees has no bank."""
    looked_at, wet = np.count_nonzero(ground), np.count_nonzero(water.water)
    if wet < _LEAST_WATER * looked_at:
        return NoRiver(RiverStatus.NO_WATER, "no water is seen; if there is some, point at it")
    if np.count_nonzero(ground & ~water.water) < _LEAST_LAND * looked_at:
        return NoRiver(RiverStatus.ALL_WATER, "no bank is in view: all of the image looks like water")
    return None


def in_doubt(water: WaterMask) -> str:
    """Why the network cannot tell water from land, in a sentence; empty where it can."""
    if water.sure >= _LEAST_SURE:
        return ""
    share = f"two looks are both sure of {100 * water.sure:.0f} % of what either takes for water"
    return f"water and land cannot be told apart: {share}; point at either"


def like_a_road(copy: SmallCopy, water: BoolArray, banks_en_m: FloatArray) -> NoRiver | None:
    """Whether what was found is as even as no water is, between straight edges or of one width.

    Args:
        copy: The small copy.
        water: ``(height, width)``: what was found.
        banks_en_m: ``(n, 2, 2)``: left, then right bank of each transect, east and north.
    """
    _, green, red = copy.pixels[water].mean(axis=0)
    if red < _NO_ROAD * green or len(banks_en_m) < _FEWEST or _unevenness(copy, water) > _EVEN:
        return None
    widths_m = np.linalg.norm(banks_en_m[:, 0] - banks_en_m[:, 1], axis=-1)
    width_m = float(np.median(widths_m))
    straight = max(_bend_m(banks_en_m[:, side]) for side in range(2)) < _STRAIGHT * width_m
    if not straight and robust_std(widths_m - width_m) > _ONE_WIDTH * width_m:
        return None
    how = "between two straight edges" if straight else "and of one width"
    reason = f"where water is looked for it is even, {how}: a road? If it is water, point at it"
    return NoRiver(RiverStatus.NO_WATER, reason)


def _unevenness(copy: SmallCopy, water: BoolArray) -> float:
    """Spread of the lightness within the water, relative, beside what a smooth trend explains."""
    inside = cv2.erode(water.astype(np.uint8), np.ones((_EDGE_PX, _EDGE_PX), dtype=np.uint8)) > 0
    rows, columns = np.nonzero(inside)
    if len(rows) < _LEAST_PIXELS:
        return math.inf
    v, u = rows / copy.shape[0], columns / copy.shape[1]
    trend = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    light = np.log(copy.pixels[rows, columns].mean(axis=-1) + 4.0)
    return robust_std(light - trend @ np.linalg.lstsq(trend, light)[0])


def _bend_m(points_en_m: FloatArray) -> float:
    """How far points ``(n, 2)`` are from the line that fits them best, root mean square."""
    least = np.linalg.svd(points_en_m - points_en_m.mean(axis=0), compute_uv=False)[-1]
    return float(least) / math.sqrt(len(points_en_m))
