"""What is new in an image, cleaned: without shadows, grains and fringes, as the outlines of objects."""

import math
from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray

_SLACK_PX: Final = 0.3  # staircases of a mask are no corners
_HALVES: Final = np.ones((3, 3), dtype=np.uint8)
_MOST_GAIN: Final = 0.9  # what is brighter than this share of the background is in no shadow
_LEAST_GAIN: Final = 0.25  # the sky still lights what the sun does not
_WINDOW_PX: Final = 5
_SAME_COLOUR: Final = 0.025  # of red and green over the sum of all three ...
_COLOUR_NOISE: Final = 3.0  # ... and of that sum, in grey levels
_SAME_TEXTURE: Final = 0.07  # of the brightness: what is left when the background times the gain is taken away
_TEXTURE_NOISE: Final = 3.0  # grey levels
_MARGIN_PX: Final = 4
_GRAIN: Final = np.ones((3, 3), dtype=np.uint8)
_GAPS: Final = np.ones((9, 5), dtype=np.uint8)  # what a belt or a shadow leaves between two parts of one object
_FRINGE: Final = 0.05  # of an object's height: what is thinner hangs on to it, the border of its shadow for one
_SCRAP: Final = 0.15  # of what casts a shadow: what is left of the shadow has less
_GHOST: Final = 0.6  # of how much the background differs from what is around, where the image does
_RING_PX: Final = 8
_AROUND: Final = np.ones((5, 5), dtype=np.uint8)
_ONE: Final = 2  # connected component, beside what is none

MOST_OUTLINES: Final = 30
"""Where more than these seem to move in one image, nothing can be told from water or leaves."""

TOO_MANY: Final = "more seems to move than persons or vehicles do: water, leaves, another light? ignore says where"
_REMEMBERED_S: Final = 10.0
_RESTLESS: Final = 0.1  # changes an image: two persons in a second that walk past change a place as often
_CALM_LOOKS: Final = 25.0  # that are taken for granted
_AROUND_PX: Final = 17

Planes = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Background = ImageArray | Planes


def outlines_of(mask: BoolArray, slack_px: float = _SLACK_PX) -> list[FloatArray]:
    """The outer borders of what is connected in a mask ``(height, width)``.

    A pixel is a square of side 1 around its centre, so a mask of one pixel has an outline of area 1.

    Args:
        mask: What belongs to objects.
        slack_px: How far a border may be off where it is made of fewer corners; 0 for every corner.

    Returns:
        ``(n, 2)`` each, the largest first.
    """
    if not np.any(mask):
        return []
    rows, columns = np.flatnonzero(np.any(mask, axis=1)), np.flatnonzero(np.any(mask, axis=0))
    top, left = int(rows[0]), int(columns[0])
    part = mask[top : rows[-1] + 1, left : columns[-1] + 1].astype(np.uint8)
    # On a grid of half pixels, borders between pixels have points of their own.
    halves = np.zeros((2 * part.shape[0] + 1, 2 * part.shape[1] + 1), dtype=np.uint8)
    halves[1::2, 1::2] = part
    found, _ = cv2.findContours(cv2.dilate(halves, _HALVES), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    found = sorted(found, key=cv2.contourArea, reverse=True)
    if slack_px > 0:
        found = [cv2.approxPolyDP(border, 2 * slack_px, closed=True) for border in found]
    return [border[:, 0].astype(np.float64) / 2 + [left - 0.5, top - 0.5] for border in found]


def shadows(image: ImageArray, background: ImageArray, labelled: BoolArray) -> BoolArray:
    """Where there is shadow, of what is not background.

    Args:
        image: ``(height, width, 3)`` BGR.
        background: The same place without objects, likewise.
        labelled: ``(height, width)``: where somebody else sees a shadow.

    Returns:
        ``(height, width)``.
    """
    now, then = _smooth(image), _smooth(background)
    now_sum, then_sum = _total(now) + 1.0, _total(then) + 1.0
    gain = now_sum / then_sum
    darker = (gain > _LEAST_GAIN) & (gain < _MOST_GAIN)
    green, red = (np.abs(now[..., k] / now_sum - then[..., k] / then_sum) for k in (1, 2))
    same_colour = np.maximum(green, red) < _SAME_COLOUR + _COLOUR_NOISE / now_sum
    same_texture = _roughness(image, background, gain) < _TEXTURE_NOISE + _SAME_TEXTURE * now_sum / 3
    seen = (same_colour & same_texture) | (labelled & (same_colour | same_texture))
    return np.asarray(darker & seen)


def _smooth(image: ImageArray) -> Planes:
    return np.asarray(cv2.blur(image.astype(np.float32), (_WINDOW_PX, _WINDOW_PX)))


def _total(image: Planes) -> Planes:
    return image[..., 0] + image[..., 1] + image[..., 2]


def _roughness(image: ImageArray, background: ImageArray, gain: Planes) -> Planes:
    """Root mean square of what the gain does not explain, grey levels ``(height, width)``."""
    now, then = (_total(each.astype(np.float32)) / 3 for each in (image, background))
    rest = now - gain * then
    return np.asarray(np.sqrt(cv2.blur(rest * rest, (_WINDOW_PX, _WINDOW_PX))))


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


def remember_changes(
    share: Planes, last: Planes, new: Planes, seen: Planes, looks: Planes | float, elapsed_s: float
) -> None:
    """Add an image's changes to how often each place changes; all ``(height, width)``, 0 to 1.

    Args:
        share: Of the images, in which it changed; changed in place.
        last: What was new in the image before; likewise.
        new: What is new in this one.
        seen: What this one shows.
        looks: How often each place was seen.
        elapsed_s: Since the last one.
    """
    later = min(1 - math.exp(-elapsed_s / _REMEMBERED_S), 0.1)
    rate = np.maximum(np.float32(1) / (looks + np.float32(_CALM_LOOKS)), np.float32(later))
    share += (cv2.absdiff(new, last) - share) * (seen * rate)
    last += (new - last) * seen


def calm(share: Planes) -> BoolArray:
    """Where who moves can be told ``(height, width)``."""
    return np.asarray(cv2.blur(share, (_AROUND_PX, _AROUND_PX)) < _RESTLESS)
