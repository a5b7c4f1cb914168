"""Calm water along a bank, whose colour it mirrors: it fades into the rest of the water, and is the smoothest of all.

Colour and lightness put such a strip on the land's side, for they are the bank's. What tells it from ground, and from
what grows: there is no edge between it and the water, as there is where water ends; it has no more fine detail than
water, and less than land; and it is darker than the water beside it. A beach fades into shallow water as well, but is
brighter: what is brighter may be either.
"""

from typing import Final

import cv2
import numpy as np

from aerodft.geometry.robust import middle_and_std, robust_std
from aerodft.model.arrays import BoolArray
from aerodft.vision.water_cut import cut, opened
from aerodft.vision.water_features import BLUE_TO_GREEN, LIGHT, RED_TO_GREEN, TEXTURE, Float32Image, WaterFeatures

_LEAST: Final = 0.001  # of the water's area
_LEAST_SPREAD: Final = 3.0  # of twelve times the texture's logarithm: 28 %
_GAP_PX: Final = 4  # to the water's outline at most: what the fading strip itself loses to neither
_BESIDE_PX: Final = 12  # so far around it is the water that it is held against
_DARKER: Final = -3.0  # forty times the logarithm of the lightness: 7 %
_FADES_PX: Final = 5.0  # at the steepest: edges of banks are 1 to 4 px wide, mirrored banks fade over 6 to 8
_CALM: Final = 1.1  # of the fine detail of the water beside it: no rougher
_NO_LAND: Final = 0.85  # of the fine detail of the smoothest fifth of the land
_SMOOTHEST_PERCENT: Final = 20.0
_STEEPEST_PERCENT: Final = 90.0
_LIKE: Final = 1.5  # standard deviations of a strip's looks
_COLOURS: Final = (RED_TO_GREEN, BLUE_TO_GREEN)
_LOOKS: Final = (*_COLOURS, LIGHT)


def with_mirrored_banks(
    features: WaterFeatures, water: BoolArray, disc: BoolArray, ground: BoolArray
) -> tuple[BoolArray, BoolArray | None]:
    """The water, with the calm strips along it in which its banks are mirrored.

    Args:
        features: The small copy.
        water: ``(height, width)``.
        disc: Part of it that is water surely.
        ground: What is looked at.

    Returns:
        The water with darker strips; and with brighter ones too, which may be beaches: None where there are none.
    """
    found = [(each, _fades(features, water, each, ground)) for each in _smooth_pieces(features, water, ground)]
    strips = [(each, lighter) for each, lighter in found if lighter is not None]
    darker = [each for each, lighter in strips if lighter < _DARKER]
    surely = _joined(features, water, darker, disc, ground)
    if len(darker) == len(strips):
        return surely, None
    return surely, _joined(features, water, [each for each, _ in strips], disc, ground)


def _joined(
    features: WaterFeatures, water: BoolArray, strips: list[BoolArray], disc: BoolArray, ground: BoolArray
) -> BoolArray:
    if not strips:
        return water
    mirrored = _along(features.planes, np.logical_or.reduce(strips), water, ground)
    kernel = np.ones((2 * _GAP_PX + 1, 2 * _GAP_PX + 1), dtype=np.uint8)
    closed = cv2.morphologyEx((water | mirrored).astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0
    between = closed & _around(mirrored, _GAP_PX) & ground
    return cut(features.planes, water | between, disc | between, ground)


def _smooth_pieces(features: WaterFeatures, water: BoolArray, ground: BoolArray) -> list[BoolArray]:
    """Pieces of the land beside the water, ``(height, width)`` each, that have no more texture than water has."""
    texture = features.planes[..., TEXTURE]
    inside = texture[water]
    middle = float(np.median(inside))
    spread = max(robust_std(inside - middle), _LEAST_SPREAD)
    smooth = opened(ground & ~water & (texture <= middle + spread)).astype(np.uint8)
    near = _around(water, _GAP_PX)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(smooth, connectivity=4)
    large = facts[:, cv2.CC_STAT_AREA] >= _LEAST * np.count_nonzero(water)
    beside = np.bincount(labels[near & (smooth > 0)], minlength=count) > 0
    return [np.asarray(labels == number) for number in range(1, count) if large[number] and beside[number]]


def _fades(features: WaterFeatures, water: BoolArray, piece: BoolArray, ground: BoolArray) -> float | None:
    """How much lighter a piece is than the water that it fades into, being as smooth; None where it does not."""
    beside = water & _around(piece, _BESIDE_PX)
    land = ground & ~water & ~piece
    if not beside.any() or not land.any():
        return None
    apart = features.planes[piece].mean(axis=0) - features.planes[beside].mean(axis=0)
    detail = float(np.median(features.detail[piece]))
    is_water = (
        detail < _CALM * float(np.median(features.detail[beside]))
        and detail < _NO_LAND * float(np.percentile(features.detail[land], _SMOOTHEST_PERCENT))
        and _fading_px(features.planes, water, piece, apart) > _FADES_PX
    )
    return float(apart[LIGHT]) if is_water else None


def _along(planes: Float32Image, strip: BoolArray, water: BoolArray, ground: BoolArray) -> BoolArray:
    """A strip with what runs on along the water in its looks, where it is too narrow for its texture to be seen."""
    middle, std = middle_and_std(planes[strip][:, _LOOKS])
    like = np.all(np.abs(planes[..., _LOOKS] - middle) <= _LIKE * (std + 1.0), axis=-1)
    from_water = cv2.distanceTransform(1 - water.astype(np.uint8), cv2.DIST_L2, 5)
    near = from_water <= float(from_water[strip].max())
    _, labels = cv2.connectedComponents(
        (strip | opened(like & near & ground & ~water)).astype(np.uint8), connectivity=4
    )
    return np.asarray(np.isin(labels, np.unique(labels[strip])))


def _fading_px(planes: Float32Image, water: BoolArray, piece: BoolArray, apart: Float32Image) -> float:
    """Over how many pixels the water's colour becomes that of a piece beside it, where that goes fastest."""
    between = apart[list(_COLOURS)]
    whole = float(np.linalg.norm(between))
    if whole == 0:
        return 0.0
    towards = np.asarray(planes[..., _COLOURS] @ (between / whole), dtype=np.float32)
    slopes = [cv2.Sobel(towards, cv2.CV_32F, 1 - axis, axis, ksize=3, scale=1 / 8) for axis in (0, 1)]
    slope = cv2.magnitude(*slopes)
    border = _around(water, 2 * _GAP_PX) & _around(piece, 2 * _GAP_PX) & _around(~water, 2 * _GAP_PX)
    return whole / max(float(np.percentile(slope[border], _STEEPEST_PERCENT)), 1e-6) if border.any() else 0.0


def _around(region: BoolArray, reach_px: int) -> BoolArray:
    """A region with what is near it, itself included."""
    kernel = np.ones((2 * reach_px + 1, 2 * reach_px + 1), dtype=np.uint8)
    return np.asarray(cv2.dilate(region.astype(np.uint8), kernel) > 0)
