"""Regions of a small copy: around a seed, without specks, and with their outlines drawn by a graph cut (GrabCut)."""

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.model.arrays import BoolArray
from aerodft.vision.water_features import BLUE_TO_GREEN, RED_TO_GREEN, TEXTURE, Float32Image

_SPECK: Final = 3e-4  # of the image: what is drier and smaller is a wave, or a boat
_DISC: Final = 0.025  # radius of the seed's disc, of the copy's width
_ITERATIONS: Final = 3
_DEEP: Final = 1 / 60  # of the copy's width: so far inside a region is water surely
_SCALE: Final = 3.0  # to bytes, of the two colours and the texture
_MIDDLE: Final = 128.0
_SEED: Final = 1

Bytes = npt.NDArray[np.uint8]


def disc_around(shape: tuple[int, int], seed_px: tuple[float, float]) -> BoolArray:
    """What a seed says to be water, ``(height, width)``."""
    disc = np.zeros(shape, dtype=np.uint8)
    cv2.circle(disc, (round(seed_px[0]), round(seed_px[1])), max(2, round(_DISC * max(shape))), 1, -1)
    return disc > 0


def opened(region: BoolArray) -> BoolArray:
    """A region without what is thinner than five pixels."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    return np.asarray(cv2.morphologyEx(region.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0)


def piece_around(region: BoolArray, disc: BoolArray) -> BoolArray:
    """The piece of the region that shares most with the disc; the disc itself where none does."""
    _, labels = cv2.connectedComponents(region.astype(np.uint8), connectivity=4)
    shares = np.bincount(labels[disc & region])
    if not shares[1:].any():
        return disc
    return np.asarray(labels == 1 + int(np.argmax(shares[1:])))


def without_specks(water: BoolArray) -> BoolArray:
    """A region with its smallest holes filled."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats((~water).astype(np.uint8), connectivity=4)
    speck = facts[:count, cv2.CC_STAT_AREA] < _SPECK * water.size
    speck[0] = False
    return np.asarray(water | speck[labels])


def overlap(one: BoolArray, other: BoolArray) -> float:
    """Intersection over union of two regions."""
    return float(np.count_nonzero(one & other)) / max(int(np.count_nonzero(one | other)), 1)


def cut(planes: Float32Image, region: BoolArray, disc: BoolArray, ground: BoolArray) -> BoolArray:
    """The region with its outline drawn by a graph cut; what is deep inside stays water.

    What is not looked at is land to the cut, whatever it shows: it is given the colours of what land there is.

    Args:
        planes: ``(height, width, 4)`` of ``WaterFeatures``.
        region: ``(height, width)``.
        disc: Part of it that is water surely.
        ground: What is looked at.
    """
    land = ground & ~region
    if not land.any():
        return region
    seen = _colours(planes)
    seen[~ground] = np.random.default_rng(_SEED).choice(seen[land], np.count_nonzero(~ground))
    deep_px = max(1, round(_DEEP * float(max(region.shape))))
    deep = cv2.erode(region.astype(np.uint8), np.ones((3, 3), dtype=np.uint8), iterations=deep_px)
    labels = np.where(region, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[(deep > 0) | disc] = cv2.GC_FGD
    labels[~ground] = cv2.GC_BGD
    cv2.setRNGSeed(_SEED)
    water_model, land_model = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(seen, labels, (0, 0, 0, 0), land_model, water_model, _ITERATIONS, cv2.GC_INIT_WITH_MASK)
    water = ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)) & ground
    return without_specks(piece_around(opened(np.asarray(water)) | disc, disc))


def _colours(planes: Float32Image) -> Bytes:
    texture = planes[..., TEXTURE] - np.median(planes[..., TEXTURE])
    colours = np.dstack([planes[..., RED_TO_GREEN], planes[..., BLUE_TO_GREEN], texture])
    return np.clip(_SCALE * colours + _MIDDLE, 0, 255).astype(np.uint8)
