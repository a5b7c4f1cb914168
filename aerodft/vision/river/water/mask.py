"""Which part of an image is the river's water: where the network sees water, in one piece, as a person corrects it."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.model import BoolArray
from aerodft.vision.river.water.hints import RiverHints, hinted, with_hints
from aerodft.vision.river.water.network import WaterNetwork
from aerodft.vision.river.water.plane import Float32Image, SmallCopy

_MARGIN: Final = 1.0  # of a logit: 73 %, and 27 %
_SURE: Final = 2.0  # of a logit: 88 %
_LARGEST_ISLAND: Final = 0.3  # of the water, where the image cuts it
_CUT_ISLAND: Final = 0.6  # of its shore's length: so short is where the image cuts it; a bank's corner has more


@dataclass(frozen=True, slots=True, eq=False)
class WaterMask:
    """Where the water is in a small copy.

    Attributes:
        water: ``(height, width)``, in one piece; empty where there is none.
        ground: ``(height, width)``: what was looked at; its border is the image's, or the horizon's.
        logit: ``(height, width)`` of water, in the mean of the network's looks.
        bounds: ``(height, width)`` each: where every look is sure of water, and where one at least may see some.
        agreement: The overlap of the looks, intersection over union.
        sure: Of what either look takes for water, the share that both are sure of.
        apart: How large the largest other piece of water is, of its own area: another arm?
        stayed: ``(height, width)``: what was taken off because it did not move; None where nothing was.
    """

    water: BoolArray
    ground: BoolArray
    logit: Float32Image
    bounds: tuple[BoolArray, BoolArray]
    agreement: float
    sure: float = 1.0
    apart: float = 0.0
    stayed: BoolArray | None = None

    @property
    def probability(self) -> Float32Image:
        """Of water, ``(height, width)``."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.logit)), dtype=np.float32)


def find_water(copy: SmallCopy, network: WaterNetwork, hints: RiverHints, ground: BoolArray) -> WaterMask:
    """The river's water: the piece that a person points at, else the largest.

    Args:
        copy: The small copy.
        network: Says where water is.
        hints: What a person says.
        ground: ``(height, width)``: which pixels show the ground near enough to be measured; no others are water.

    Raises:
        InputError: The network does not take such an image.
    """
    logits = with_hints(copy, network.looks(copy.pixels), hints)
    mean = np.asarray(np.mean(logits, axis=0), dtype=np.float32)
    wet, _ = hinted(copy, hints)
    water, apart = _piece((mean > 0) & ground, wet & ground)
    first, second = (piece_with((each > 0) & ground, water) for each in logits)
    low, high = np.min(logits, axis=0), np.max(logits, axis=0)
    bounds = piece_with((low > _MARGIN) & ground, water), piece_with((high > -_MARGIN) & ground, water)
    sure = np.count_nonzero(water & (low > _SURE)) / max(int(np.count_nonzero(first | second)), 1)
    return WaterMask(water, ground, mean, bounds, overlap(first, second), sure, apart)


def _piece(wet: BoolArray, hint: BoolArray) -> tuple[BoolArray, float]:
    """The piece with most of the hint, else the largest; and the next one's size, of its own."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats(opened(wet).astype(np.uint8), connectivity=4)
    if count == 1:
        return np.zeros(wet.shape, dtype=bool), 0.0
    areas = facts[1:, cv2.CC_STAT_AREA]
    shares = np.bincount(labels[hint], minlength=count)[1:]
    chosen = int(np.argmax(shares if shares.any() else areas))
    others = np.delete(areas, chosen)
    return np.asarray(labels == chosen + 1), float(others.max(initial=0) / areas[chosen])


def piece_with(wet: BoolArray, hint: BoolArray) -> BoolArray:
    """The piece of a region that has most of ``hint (height, width)``, else the largest."""
    return _piece(wet, hint)[0]


def opened(region: BoolArray) -> BoolArray:
    """A region without what is thinner than five pixels."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    return np.asarray(cv2.morphologyEx(region.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0)


def overlap(one: BoolArray, other: BoolArray) -> float:
    """Intersection over union of two regions."""
    return float(np.count_nonzero(one & other)) / max(int(np.count_nonzero(one | other)), 1)


def with_islands(water: BoolArray, ground: BoolArray) -> BoolArray:
    """The water with what it surrounds; land that the image's border cuts is an island where it has more shore.

    Args:
        water: ``(height, width)``.
        ground: What was looked at: its border is the image's, or the horizon's.
    """
    count, labels, facts, _ = cv2.connectedComponentsWithStats((ground & ~water).astype(np.uint8), connectivity=4)
    kernel = np.ones((3, 3), dtype=np.uint8)
    shore = cv2.dilate(water.astype(np.uint8), kernel) > 0
    border = cv2.erode(ground.astype(np.uint8), kernel, borderValue=0) == 0
    on_shore = np.bincount(labels[shore], minlength=count)
    on_border = np.bincount(labels[border], minlength=count)
    small = facts[:, cv2.CC_STAT_AREA] < _LARGEST_ISLAND * np.count_nonzero(water)
    island = (on_border == 0) | (small & (on_border < _CUT_ISLAND * on_shore))
    island[0] = False
    return np.asarray(water | island[labels])
