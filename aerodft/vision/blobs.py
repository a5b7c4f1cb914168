"""What is new in an image, cleaned: without shadows, grains and fringes, as the outlines of objects."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.vision.footing import outlines_of
from aerodft.vision.shadows import shadows

_MARGIN_PX: Final = 4
_GRAIN: Final = np.ones((3, 3), dtype=np.uint8)
_GAPS: Final = np.ones((9, 5), dtype=np.uint8)  # what a belt or a shadow leaves between two parts of one object
_FRINGE: Final = 0.05  # of an object's height: what is thinner hangs on to it, the border of its shadow for one
_SCRAP: Final = 0.15  # of what casts a shadow: what is left of the shadow has less
_GHOST: Final = 0.6  # of how much the background differs from what is around, where the image does
_RING_PX: Final = 8
_AROUND: Final = np.ones((5, 5), dtype=np.uint8)
_ONE: Final = 2  # connected component, beside what is none

Background = ImageArray | np.ndarray[tuple[int, ...], np.dtype[np.float32]]


def without_shadows(
    pixels: ImageArray, background: ImageArray, new: BoolArray, labelled: BoolArray, least_px: int
) -> BoolArray:
    """What is new and in no shadow; looked at only where there is something.

    Args:
        pixels: ``(height, width, 3)`` BGR.
        background: The same place without objects, likewise.
        new: ``(height, width)``.
        labelled: ``(height, width)``: where somebody else sees a shadow.
        least_px: What covers fewer pixels is noise.
    """
    mask = cv2.morphologyEx(new.astype(np.uint8), cv2.MORPH_OPEN, _GRAIN)
    _, parts, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    for number, (left, top, width, height, area) in enumerate(stats.tolist()):
        if number and area >= least_px:
            rows = slice(max(top - _MARGIN_PX, 0), top + height + _MARGIN_PX)
            part = rows, slice(max(left - _MARGIN_PX, 0), left + width + _MARGIN_PX)
            shade = shadows(pixels[part], background[part], labelled[part])
            mine = parts[part] == number
            mask[part][mine & (shade | _scraps(mine & ~shade))] = 0
    return np.asarray(mask > 0)


def _scraps(mask: BoolArray) -> BoolArray:
    """What is small beside the largest part of a mask ``(height, width)``: rests of a shadow."""
    _, parts, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA]
    small = areas < _SCRAP * np.max(areas[1:], initial=0)
    small[0] = False
    return np.asarray(small[parts])


def objects_in(mask: BoolArray, least_px: int) -> list[FloatArray]:
    """Outlines ``(n, 2)`` of a mask ``(height, width)`` without grains, its gaps closed, the largest first."""
    found = outlines_of(_whole(mask, least_px))
    return [outline for outline in found if len(outline) >= 3]  # noqa: PLR2004 - a triangle's corners


def is_ghost(pixels: ImageArray, background: Background, new: BoolArray, outline: FloatArray) -> bool:
    """Whether somebody has left there since it was learned: the image is there as around it, the background is not.

    Args:
        pixels: ``(height, width, 3)`` BGR.
        background: What was learned, likewise.
        new: ``(height, width)`` where the two differ.
        outline: ``(n, 2)`` of what may be one.
    """
    low = np.maximum(np.floor(outline.min(axis=0)).astype(int) - _RING_PX, 0)
    high = np.ceil(outline.max(axis=0)).astype(int) + _RING_PX + 1
    part = slice(low[1], high[1]), slice(low[0], high[0])
    mask = np.zeros(new[part].shape, dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(outline - low).astype(np.int32)], 1)
    ring = (cv2.dilate(mask, _AROUND, iterations=_RING_PX // 2) > mask) & ~new[part]
    if not ring.any() or not mask.any():
        return False
    around = np.mean(pixels[part][ring], axis=0)
    now, then = (np.mean(each[part][mask > 0], axis=0) for each in (pixels, background))
    return bool(np.linalg.norm(now - around) < _GHOST * np.linalg.norm(then - around))


def _without_fringe(mask: ImageArray) -> BoolArray:
    """One object ``(height, width)`` without what hangs on to it; with it, where it would fall apart."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, [max(3, round(_FRINGE * len(mask)) | 1)] * 2)
    smooth = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
    parts, _ = cv2.connectedComponents(smooth, connectivity=8)
    return np.asarray((smooth if parts == _ONE else mask) > 0)


def _whole(mask: BoolArray, least_px: int) -> BoolArray:
    """A mask without grains, its gaps closed, of parts of at least so many pixels."""
    clean = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _GRAIN)  # first, or borders of shadows grow
    clean = cv2.morphologyEx(clean, cv2.MORPH_CLOSE, _GAPS)
    _, parts, stats, _ = cv2.connectedComponentsWithStats(clean, connectivity=8)
    whole = np.zeros_like(clean)
    for number, (left, top, width, height, area) in enumerate(stats.tolist()):
        if number == 0 or area < least_px:
            continue
        part = slice(top, top + height), slice(left, left + width)
        whole[part][_without_fringe((parts[part] == number).astype(np.uint8))] = 1
    return np.asarray(whole > 0)
