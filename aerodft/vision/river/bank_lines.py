"""Banks as lines along the water's outline, wherever land is beyond it: also where the image shows one bank alone.

Transects tell widths; these lines tell the shape, headlands and bends included. Each point is located by the profile
across the outline, as a transect's ends are.
"""

import math
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from aerodft.model import BoolArray, FloatArray, ImageArray, IntArray
from aerodft.vision.river.banks import Edges, locate_edges, widest_px, window_px
from aerodft.vision.river.centreline import Centreline, sample_mask
from aerodft.vision.river.water import SmallCopy, WaterMask, WaterPlane, opened, piece_with

_GAP_PX: Final = 9  # of the small copy: so short a piece at the image's border parts no bank
_STONE: Final = 0.08  # of the longest bank: a shorter one would be a stone at the image's border
_SMOOTH: Final = 3.0  # outline points
_EVERY: Final = 4  # of them
_SIDE: Final = 11  # neighbours that say on which side of a centreline a point is
_BORDER_PX: Final = 3
_BESIDE: Final = np.ones((7, 7), dtype=np.uint8)  # of the small copy: so near an outline is beside a piece
_FEWEST: Final = 3  # points that tell how clear an outline is


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
    return _steps(image, copy, arc, np.arange(0, len(arc), _EVERY)).pixels_px


def _steps(image: ImageArray, copy: SmallCopy, outline: FloatArray, rows: IntArray) -> Edges:
    """The steps across an outline, smoothed, at some of its points ``(k,)``."""
    smooth = np.asarray(gaussian_filter1d(outline, _SMOOTH, axis=0, mode="nearest"))
    along = np.gradient(smooth, axis=0)[rows]
    along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    near = copy.to_image(smooth[rows])
    across = np.stack([along[:, 1], -along[:, 0]], axis=-1)  # OpenCV's outer outlines have the region to their left
    size = np.array([image.shape[1], image.shape[0]]) - 1
    room = np.min(np.minimum(near, size - near), axis=-1)
    window = np.minimum(window_px(room / 2), widest_px(copy.scale))
    return locate_edges(image, near, across, along, window)


def with_clearer_banks(image: ImageArray, copy: SmallCopy, water: WaterMask, wet: BoolArray) -> WaterMask:
    """The water, where the network is in doubt as far as the clearer one of its two outlines.

    What is in doubt lies between two outlines, of the water with it and of the water without. The bank is at one of
    them by the network's odds, and by how closely the image tells the place of either: foam, shade and a bank that is
    mirrored fade into the water, a bank does not.

    Args:
        image: ``(height, width, 3)`` BGR.
        copy: The small copy.
        water: The water as the network has it.
        wet: ``(height, width)``: what a person says is water.
    """
    least, most = water.bounds
    clearer = water.water.copy()
    for within, beyond in ((least, water.water), (water.water, most)):
        doubtful = opened(beyond & ~within)
        count, labels, sizes, _ = cv2.connectedComponentsWithStats(doubtful.astype(np.uint8), connectivity=4)
        pieces = np.asarray(labels, dtype=np.int64)
        logit = np.bincount(pieces.ravel(), water.logit.ravel(), count) / sizes[:, cv2.CC_STAT_AREA]
        inner, outer = (_spread_at(image, copy, outline, pieces, count) for outline in (within, beyond))
        told = np.isfinite(inner) & np.isfinite(outer)
        belongs = told & (logit + np.log(inner) - np.log(outer) > 0)
        clearer = np.where((told & (np.arange(count) > 0))[pieces], belongs[pieces], clearer)
    return replace(water, water=piece_with(clearer, wet if wet.any() else water.water))


def _spread_at(image: ImageArray, copy: SmallCopy, region: BoolArray, pieces: IntArray, count: int) -> FloatArray:
    """How well a region's outline is told beside each of ``count`` pieces, ``(count,)``: median std, px; NaN of few."""
    spread = np.full(count, np.nan)
    outlines, _ = cv2.findContours(region.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if count == 1 or not outlines:
        return spread
    outline = max(outlines, key=len)[:, 0]
    beside = cv2.dilate(pieces.astype(np.float32), _BESIDE)[outline[:, 1], outline[:, 0]].astype(np.int64)
    rows = np.flatnonzero(beside)[::_EVERY]
    if len(rows) == 0 or len(outline) < 2 * _EVERY:
        return spread
    edges = _steps(image, copy, outline.astype(np.float64), rows)
    seen = edges.contrast > 0
    for piece in np.unique(beside[rows]).tolist():
        stds = edges.std_px[seen & (beside[rows] == piece)]
        spread[piece] = np.median(stds) if len(stds) >= _FEWEST else np.nan
    return spread


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
        left = median_filter(left.astype(np.uint8), _SIDE, mode="nearest") > 0
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
