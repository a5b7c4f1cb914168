"""What of a river's image moves, what stays: a look at the same place about a second later, held still on the ground.

Water takes its waves, foam and mirrored sky along; mud, sand and roads stay as they are. Both images' detail is
compared by its local correlation, after the later one was laid on the earlier by what both show of the land.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from aerodft.model import BoolArray, FloatArray, ImageArray
from aerodft.vision.common import consensus_homography, local_contrast, spread_corners, track_lk
from aerodft.vision.river.water.mask import WaterMask, piece_with
from aerodft.vision.river.water.plane import Float32Image, SmallCopy, WaterPlane

STAYS: Final = 0.95
"""Median correlation of what stays; of water it was 0.8 at most half a second later, and less after a second."""
SOONEST_S: Final = 0.8
"""Before that slow water has hardly moved."""
LATEST_S: Final = 2.0
"""After that the light has changed, and a drone is elsewhere."""

_WIDTH_PX: Final = 960
_DETAIL_PX: Final = 6.0
_WINDOW_PX: Final = 2.5
_FLAT: Final = 2.0  # grey levels: what has less detail than that may as well be noise
_SAME: Final = 0.9  # correlation; of ground it was 0.97 and more
_LAND_SAME: Final = 0.9  # likewise of most of the land, or the images do not lie on each other
_FEWEST: Final = 12  # points of the land
_STRAY_PX: Final = 1.0
_DRAWS, _SURE = 500, 0.999
_AWAY: Final = np.ones((15, 15), dtype=np.uint8)  # of the copy: so far from the water land is surely land
_BLUR: Final = np.ones((13, 13), dtype=np.uint8)  # of the copy: half of it is how far land's correlation reaches
_SLOWEST_M_S: Final = 0.3  # of water that is told from land
_LEAST_PX: Final = 2.5  # that it has to move for that
_TOUCH: Final = np.ones((5, 5), dtype=np.uint8)
_LEAST: Final = 0.001  # of the small copy
_GLITTER: Final = 1.35  # times as bright as the water
_LEAST_DETAIL: Final = 0.2  # of the water must have detail, or nothing is said of it


def motion_copy(image: ImageArray) -> ImageArray:
    """A grey copy ``(height, width)`` of an image BGR, small enough to be kept."""
    scale = min(1.0, _WIDTH_PX / image.shape[1])
    size = round(image.shape[1] * scale), round(image.shape[0] * scale)
    grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    return np.asarray(grey, dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class LaterLook:
    """A second look at a place, ``SOONEST_S`` to ``LATEST_S`` later.

    Attributes:
        plane: The water's, as the camera sees it then.
        copy: Reads its ``motion_copy``.
        after_s: How much later.
    """

    plane: WaterPlane
    copy: Callable[[], ImageArray]
    after_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Stayed:
    """What two looks say.

    Attributes:
        still: ``(height, width)`` of the small copy: what surely stays as it is.
        in_water: Median correlation within the water; NaN where it is too smooth to tell.
    """

    still: BoolArray
    in_water: float


def what_stays(
    image: ImageArray, plane: WaterPlane, later: LaterLook, water: BoolArray, ground: BoolArray
) -> Stayed | None:
    """Hold a later look against an image.

    Args:
        image: ``(height, width, 3)`` BGR.
        plane: The water's.
        later: The later look.
        water: ``(height, width)`` of the small copy.
        ground: What was looked at.

    Returns:
        None where too little land is found again for the images to lie on each other, or nowhere water would have moved
        far enough to be seen moving.
    """
    now, then = motion_copy(image), later.copy()
    size = (now.shape[1], now.shape[0])
    wet, dry = (_resized(each, size) for each in (water, ground & ~water))
    land = dry & (cv2.dilate(wet.astype(np.uint8), _AWAY) == 0)
    homography = _laid(now, then, land, (plane, later.plane))
    if homography is None:
        return None
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    over = np.asarray(cv2.warpPerspective(then, homography, size, flags=flags), dtype=np.uint8)
    seen = cv2.warpPerspective(np.ones_like(then), homography, size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP) > 0
    alike, detail = _correlation(now, over)
    told = seen & (detail > _FLAT)
    near = _resized(_near(plane, water.shape, now.shape[1], later.after_s), size)
    if not np.any(told & land) or float(np.median(alike[told & land])) < _LAND_SAME:
        return None
    inside = near & wet & (cv2.dilate(dry.astype(np.uint8), _AWAY) == 0)
    if not np.any(inside):
        return None
    enough = np.count_nonzero(told & inside) > _LEAST_DETAIL * np.count_nonzero(inside)
    in_water = float(np.median(alike[told & inside])) if enough else math.nan
    still = ((told & near & (alike > _SAME)) | dry).astype(np.uint8)
    deep = (cv2.erode(still, _BLUR) > 0) & wet  # farther into the water than land's own correlation reaches
    stays = (cv2.dilate(deep.astype(np.uint8), _BLUR) > 0) & (still > 0) & wet
    return Stayed(_resized(stays, (water.shape[1], water.shape[0])), in_water)


def _near(plane: WaterPlane, shape: tuple[int, ...], copy_width_px: int, after_s: float) -> BoolArray:
    """Where slow water moves far enough in a copy so wide to be seen moving, ``shape`` of the small copy."""
    rows, columns = shape
    scale = columns / plane.camera.width_px
    pixels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
    places = plane.places_en_m(np.asarray((pixels + 0.5) / scale - 0.5, dtype=np.float64))
    with np.errstate(invalid="ignore"):
        steps_m = [np.linalg.norm(np.gradient(places, axis=axis), axis=-1) for axis in (0, 1)]
        sample_m = np.maximum(*steps_m) * columns / copy_width_px
        return np.asarray(sample_m * _LEAST_PX <= _SLOWEST_M_S * after_s)


def without_still(found: WaterMask, copy: SmallCopy, still: BoolArray) -> WaterMask:
    """The water without what lies along its outline and stays as it is, ``still (height, width)``."""
    land = cv2.dilate((found.ground & ~found.water).astype(np.uint8), _TOUCH) > 0
    count, candidates, facts, _ = cv2.connectedComponentsWithStats(
        (found.water & still).astype(np.uint8), connectivity=8
    )
    ashore = np.bincount(candidates[land], minlength=count) > 0
    light = cv2.cvtColor(copy.pixels, cv2.COLOR_BGR2GRAY).astype(np.float64)
    brightness = np.bincount(candidates.ravel(), light.ravel(), count) / np.maximum(facts[:count, cv2.CC_STAT_AREA], 1)
    glitter = brightness > _GLITTER * float(np.median(light[found.water]))  # stays where the sun is mirrored
    taken = ashore & ~glitter & (facts[:count, cv2.CC_STAT_AREA] >= _LEAST * still.size)
    taken[0] = False
    if not taken.any():
        return found
    stayed = taken[candidates]
    least, most = (piece_with(bound & ~stayed, bound) for bound in found.bounds)
    return replace(found, water=piece_with(found.water & ~stayed, found.water), bounds=(least, most), stayed=stayed)


def _resized(mask: BoolArray, size: tuple[int, int]) -> BoolArray:
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.5)  # noqa: PLR2004 - most of a pixel


def _laid(
    now: ImageArray, then: ImageArray, land: BoolArray, planes: tuple[WaterPlane, WaterPlane]
) -> FloatArray | None:
    """The homography ``(3, 3)`` from pixels of one copy to those of the other, by what is found again of the land."""
    old, new = local_contrast(now), local_contrast(then)
    points = spread_corners(old, land)
    scale = now.shape[1] / planes[0].camera.width_px
    at = planes[1].pixels_px(planes[0].places_en_m((points + 0.5) / scale - 0.5))
    guess = (at + 0.5) * scale - 0.5
    told = np.isfinite(guess[:, 0])
    there, again = track_lk(old, new, points[told], guess[told])
    if np.count_nonzero(again) < _FEWEST:
        return None
    start, end = points[told][again], there[again]
    consensus = consensus_homography(start, end, _STRAY_PX, _DRAWS, _SURE)
    return None if consensus is None or np.count_nonzero(consensus[1]) < _FEWEST else consensus[0]


def _correlation(one: ImageArray, other: ImageArray) -> tuple[Float32Image, Float32Image]:
    """Local correlation of two grey images' detail, and how much detail there is, grey levels; ``(height, width)``."""
    a, b = (_detail(each) for each in (one, other))
    mean_a, mean_b = _around(a), _around(b)
    variance_a, variance_b = _around(a * a) - mean_a**2, _around(b * b) - mean_b**2
    spread = np.sqrt(np.maximum(variance_a, 0.0) * np.maximum(variance_b, 0.0))
    alike = (_around(a * b) - mean_a * mean_b) / (spread + 1e-6)
    return np.asarray(alike, dtype=np.float32), np.asarray(np.sqrt(spread), dtype=np.float32)


def _detail(grey: ImageArray) -> Float32Image:
    values = grey.astype(np.float32)
    return np.asarray(values - cv2.GaussianBlur(values, (0, 0), _DETAIL_PX), dtype=np.float32)


def _around(values: Float32Image) -> Float32Image:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), _WINDOW_PX), dtype=np.float32)
