"""Banks as lines along the water's outline, wherever land is beyond it: also where the image shows one bank alone.

Transects tell widths; these lines tell the shape, headlands and bends included. Each point is located by the profile
across the outline, as a transect's ends are.
"""

import math
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from aerodft.model import BoolArray, FloatArray, ImageArray
from aerodft.vision.river.banks import locate_edges, widest_px, window_px
from aerodft.vision.river.centreline import Centreline, sample_mask
from aerodft.vision.river.water import SmallCopy, WaterPlane

_GAP_PX: Final = 9  # of the small copy: so short a piece at the image's border parts no bank
_STONE: Final = 0.08  # of the longest bank: a shorter one would be a stone at the image's border
_SMOOTH: Final = 3.0  # outline points
_EVERY: Final = 4  # of them
_JUMP: Final = 5  # neighbours that say whether a point's offset stands out
_BORDER_PX: Final = 3


def bank_lines(image: ImageArray, copy: SmallCopy, water: BoolArray, ground: BoolArray) -> list[FloatArray]:
    """The banks, the longest first: lines ``(n, 2)`` of pixels, water to their right; none where no land is beside it.

    Args:
        image: ``(height, width, 3)`` BGR.
        copy: The small copy.
        water: ``(height, width)`` of it, in one piece; what it surrounds is no bank.
        ground: What was looked at; its border is no bank.
    """
    outlines, _ = cv2.findContours(water.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return []
    outline = max(outlines, key=len)[:, 0].astype(np.float64)
    kernel = np.ones((3, 3), dtype=np.uint8)
    inner = cv2.erode(ground.astype(np.uint8), kernel, iterations=_BORDER_PX, borderValue=0) > 0
    is_bank = sample_mask(inner, outline)
    arcs = [arc for arc in _runs(outline, is_bank) if len(arc) > 2 * _EVERY]
    longest = max((len(arc) for arc in arcs), default=0)
    kept = [arc for arc in arcs if len(arc) >= _STONE * longest]
    return [_located(image, copy, arc) for arc in sorted(kept, key=len, reverse=True)]


def _runs(outline: FloatArray, is_bank: BoolArray) -> list[FloatArray]:
    """The pieces of a closed line along which ``is_bank`` is true, short gaps closed."""
    if not is_bank.any():
        return []
    start = int(np.argmin(is_bank))
    outline, is_bank = np.roll(outline, -start, axis=0), np.roll(is_bank, -start)
    closed = cv2.morphologyEx(is_bank.astype(np.uint8)[None], cv2.MORPH_CLOSE, np.ones((1, _GAP_PX)))[0]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], closed, [0]]).astype(np.int8)))
    return [outline[first:last] for first, last in zip(edges[::2], edges[1::2], strict=True)]


def _located(image: ImageArray, copy: SmallCopy, arc: FloatArray) -> FloatArray:
    """The points of a piece of outline, each moved to where its profile has the step."""
    smooth = np.asarray(gaussian_filter1d(arc, _SMOOTH, axis=0, mode="nearest"))
    along = np.gradient(smooth, axis=0)[::_EVERY]
    along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    near = copy.to_image(smooth[::_EVERY])
    across = np.stack([along[:, 1], -along[:, 0]], axis=-1)  # OpenCV's outer outlines have the region to their left
    size = np.array([image.shape[1], image.shape[0]]) - 1
    room = np.min(np.minimum(near, size - near), axis=-1)
    window = np.minimum(window_px(room / 2), widest_px(copy.scale))
    edges = locate_edges(image, near, across, along, window)
    moved = np.sum((edges.pixels_px - near) * across, axis=-1)
    steady = median_filter(moved, _JUMP, mode="nearest")
    return np.asarray(near + steady[:, None] * across)


def by_side(plane: WaterPlane, arcs: list[FloatArray], line: Centreline) -> tuple[FloatArray, FloatArray]:
    """The banks to the left and to the right of a centreline, lines ``(k, 2)`` of pixels in its direction."""
    places, along = line.at(line.stations_m())
    sides: tuple[list[tuple[float, FloatArray]], list[tuple[float, FloatArray]]] = ([], [])
    for arc in arcs:
        ground = plane.places_en_m(arc)
        known = np.isfinite(ground[:, 0])
        pixels, ground = arc[known], ground[known]
        if len(ground) < 2:  # noqa: PLR2004 - a line has two ends
            continue
        nearest = np.argmin(np.linalg.norm(ground[:, None] - places[None], axis=-1), axis=-1)
        away = ground - places[nearest]
        left = along[nearest, 0] * away[:, 1] - along[nearest, 1] * away[:, 0] > 0
        left = median_filter(left.astype(np.uint8), 2 * _JUMP + 1, mode="nearest") > 0
        breaks = np.flatnonzero(np.diff(left.astype(np.int8))) + 1
        for piece in np.split(np.arange(len(left)), breaks):
            order = piece if nearest[piece[-1]] >= nearest[piece[0]] else piece[::-1]
            sides[0 if left[piece[0]] else 1].append((float(nearest[piece].mean()), pixels[order]))
    return _joined(sides[0]), _joined(sides[1])


def _joined(pieces: list[tuple[float, FloatArray]]) -> FloatArray:
    return np.concatenate([np.empty((0, 2)), *(line for _, line in sorted(pieces, key=lambda each: each[0]))])


def by_direction(plane: WaterPlane, arcs: list[FloatArray], flow_rad: float | None) -> tuple[FloatArray, FloatArray]:
    """Lines with water to their right as left and right banks, as one looks downstream, else up or to the right."""
    sides: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    for arc in arcs:
        east, north = np.diff(plane.places_en_m(arc[[0, -1]]), axis=0)[0]
        if flow_rad is not None and math.isfinite(east + north):
            forwards = east * math.sin(flow_rad) + north * math.cos(flow_rad) >= 0
        else:
            right, up = arc[-1, 0] - arc[0, 0], arc[0, 1] - arc[-1, 1]
            forwards = (up if abs(up) >= abs(right) else right) >= 0
        sides[0 if forwards else 1].append(arc if forwards else arc[::-1])
    left, right_bank = (max(side, key=len, default=np.empty((0, 2))) for side in sides)
    return left, right_bank
