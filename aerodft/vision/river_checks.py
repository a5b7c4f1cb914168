"""Why an image shows no river whose banks could be told, as far as the image itself says so."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, ImageArray
from aerodft.vision.river_status import NoRiver, RiverStatus
from aerodft.vision.water import WaterMask
from aerodft.vision.water_features import WaterFeatures

_NIGHT: Final = 20.0  # grey levels: where all but the brightest twentieth is darker, colours are noise
_EVERY: Final = 8  # of the pixels is looked at for that
_LEAST_LAND: Final = 0.01  # of what is looked at
_RED_TO_GREEN, _BLUE_TO_GREEN = 0, 1  # planes of the features
_GREEN: Final = (2.0, -14.0)  # where both are lower than these, something grows
_MANY_COLOURS: Final = 0.03  # ratios of red to green vary by 1 to 2 % nearby in water, by 3 to 10 % on natural ground
_CLEAR: Final = 2.3  # standard deviations between an outline's sides along three quarters of it; meadows reach 2.0


def no_light(image: ImageArray) -> NoRiver | None:
    """Whether an image ``(height, width, 3)`` BGR is too dark."""
    grey = cv2.cvtColor(np.ascontiguousarray(image[::_EVERY, ::_EVERY]), cv2.COLOR_BGR2GRAY)
    if float(np.percentile(grey, 95)) < _NIGHT:
        return NoRiver(RiverStatus.TOO_DARK, "the image is too dark: night, or a covered lens")
    return None


def no_river(features: WaterFeatures, found: WaterMask, ground: BoolArray) -> NoRiver | None:
    """Whether what was found around the seed is no river between banks.

    Args:
        features: The small copy.
        found: What was found.
        ground: What was looked at.
    """
    red, blue = (float(np.median(features.planes[found.water][:, plane])) for plane in (_RED_TO_GREEN, _BLUE_TO_GREEN))
    if red < _GREEN[0] and blue < _GREEN[1]:
        return NoRiver(RiverStatus.NO_WATER, "where water is looked for something grows: is the seed on a bank?")
    variety = features.variety(found.water)
    if variety > _MANY_COLOURS:
        reason = (
            f"where water is looked for colours vary by {100 * variety:.0f} % from place to place, as on dry ground"
        )
        return NoRiver(RiverStatus.NO_WATER, f"{reason}; {100 * _MANY_COLOURS:g} % is the most for water")
    if np.count_nonzero(ground & ~found.water) < _LEAST_LAND * np.count_nonzero(ground):
        return NoRiver(RiverStatus.ALL_WATER, "no bank is in view: all of the image looks alike")
    if len(found.contrast) == 0:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "no bank is in view: the water ends where the image does")
    clear = float(np.percentile(found.contrast, 25))
    if clear < _CLEAR:
        reason = f"water and bank cannot be told apart: {clear:.1f} standard deviations between them, {_CLEAR:g} needed"
        return NoRiver(RiverStatus.NO_CONTRAST, reason)
    return None
