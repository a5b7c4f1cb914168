"""Lines across a river, perpendicular to its centreline, and where they meet its banks and its islands' shores."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy import ndimage

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.vision.water_features import WaterFeatures
from aerodft.vision.water_plane import WaterPlane
from aerodft.vision.waterway import Centreline, looked_up

_REACH_WIDTHS: Final = 1.2  # to either side of the centreline
_SAMPLES: Final = 240  # of a transect: half a percent of the width apart, at the least
_OFF_CENTRE: Final = 0.35  # of the width: so far from the centreline there must be water
_STEP: Final = np.ones(2, dtype=bool)  # samples
_BORDER_PX: Final = 4  # of the small copy
MOST_TRANSECTS: Final = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Transects:
    """Lines across a river.

    Attributes:
        stations_m: ``(n,)`` along the centreline.
        centres_en_m: ``(n, 2)`` where they cross it.
        to_left: ``(n, 2)`` unit vectors towards the left bank, east and north.
        left_m: ``(n,)`` from the centre to the left bank, along ``to_left``; NaN where the image ends first.
        right_m: ``(n,)`` to the right bank, mostly negative.
        shores: ``(k,)`` of which transect each island's stretch is.
        shores_m: ``(k, 2)`` from the centre to its right and its left shore.
    """

    stations_m: FloatArray
    centres_en_m: FloatArray
    to_left: FloatArray
    left_m: FloatArray
    right_m: FloatArray
    shores: IntArray
    shores_m: FloatArray

    def places_en_m(self, offsets_m: FloatArray) -> FloatArray:
        """Places ``(n, 2)`` at offsets ``(n,)`` along ``to_left``."""
        return self.centres_en_m + offsets_m[:, None] * self.to_left


def transects(
    plane: WaterPlane,
    features: WaterFeatures,
    masks: tuple[BoolArray, BoolArray, BoolArray],
    line: Centreline,
    stations_m: FloatArray,
) -> Transects:
    """Lay transects across a river.

    Args:
        plane: The water's.
        features: The small copy that the masks are of.
        masks: The channel with its islands, the water without them, and what was looked at, ``(height, width)`` each.
        line: The centreline, in the direction in which left and right are meant.
        stations_m: ``(n,)`` along it.
    """
    centres, along = line.at(stations_m)
    to_left = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    reach = _REACH_WIDTHS * line.width_m
    offsets = np.linspace(-reach, reach, 2 * _SAMPLES + 1)
    places = centres[:, None] + offsets[None, :, None] * to_left[:, None]
    pixels = plane.pixels_px(places)
    seen = plane.in_view(places, pixels)
    small = features.to_small(pixels)
    channel = looked_up(masks[0], small) & seen
    water = looked_up(masks[1], small)
    told = looked_up(_well_inside(masks[2]), small)
    left, right = np.full(len(centres), np.nan), np.full(len(centres), np.nan)
    owners, stretches = [], []
    for row in range(len(centres)):
        span = _span(channel[row], offsets, _OFF_CENTRE * line.width_m)
        if span is None:
            continue
        first, last = span
        if first > 0 and told[row, first - 1]:
            right[row] = (offsets[first] + offsets[first - 1]) / 2
        if last < len(offsets) - 1 and told[row, last + 1]:
            left[row] = (offsets[last] + offsets[last + 1]) / 2
        for low, high in _runs(~water[row, first : last + 1]):
            owners.append(row)
            stretches.append(
                (
                    (offsets[first + low - 1] + offsets[first + low]) / 2,
                    (offsets[first + high] + offsets[first + high + 1]) / 2,
                )
            )
    return Transects(
        stations_m=stations_m,
        centres_en_m=centres,
        to_left=to_left,
        left_m=left,
        right_m=right,
        shores=np.array(owners, dtype=np.int64),
        shores_m=np.array(stretches, dtype=np.float64).reshape(-1, 2),
    )


def _well_inside(ground: BoolArray) -> BoolArray:
    """Without the border, where a mask may end for want of anything beyond."""
    kernel = np.ones((3, 3), dtype=np.uint8)
    return np.asarray(cv2.erode(ground.astype(np.uint8), kernel, iterations=_BORDER_PX, borderValue=0) > 0)


def _span(channel: BoolArray, offsets_m: FloatArray, off_centre_m: float) -> tuple[int, int] | None:
    """First and last sample of the piece of channel nearest to the centre; None where it is too far off."""
    inside = np.flatnonzero(channel)
    if len(inside) == 0:
        return None
    start = int(inside[np.argmin(np.abs(offsets_m[inside]))])
    if abs(offsets_m[start]) > off_centre_m:
        return None
    breaks = np.flatnonzero(~channel)
    below, above = breaks[breaks < start], breaks[breaks > start]
    first = int(below[-1]) + 1 if len(below) else 0
    last = int(above[0]) - 1 if len(above) else len(channel) - 1
    return first, last


def _runs(dry: BoolArray) -> list[tuple[int, int]]:
    """First and last index of the runs that touch neither end; a mask's steps part none and are none."""
    whole = ndimage.binary_opening(ndimage.binary_closing(dry, _STEP), _STEP)
    edges = np.diff(np.concatenate([[0], whole.astype(np.int8), [0]]))
    found = zip(np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True)
    return [(low, high) for low, high in found if low > 0 and high < len(dry) - 1]
