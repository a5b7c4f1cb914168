"""A river's centreline on the map: the line between its two banks, thinned, its spurs pruned, smoothed.

A place is on the line where the nearest points of the banks on its two sides are far from each other along the shore.
Where the image ends is no shore: the line runs on to there, as it would not if the visible water were simply thinned.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy import ndimage
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from aerodft.model import BoolArray, FloatArray, IntArray
from aerodft.vision.river.water import SmallCopy, WaterMask, WaterPlane, with_islands

_LONGEST_CELLS: Final = 240
_FEWEST_CELLS: Final = 8.0  # across half of the channel: a narrower one gets a finer grid
_FINEST: Final = 4.0  # times as fine at most
_PAD_CELLS: Final = 3
_GAP_CELLS: Final = 5  # of an outline: so short a piece at the image's border parts no bank
_STONE: Final = 0.08  # of the longest bank
_FLANKS: Final = 4.0  # times the distance from the bank: so far apart along it are two flanks, a headland is not
_FLANK_CELLS: Final = 4.0
_BAY: Final = 0.5  # widths: a line between two flanks of one bank that is shorter ends in a bay, of a lake or the sea
_COVE: Final = 0.4  # of the water, within reach of the line: where there is less, the rest is open
_SMOOTH_WIDTHS: Final = 0.35
_EXTEND_WIDTHS: Final = 1.0
_LEAST_CELLS: Final = 4
_REACH_WIDTHS: Final = 1.2  # to either side of the centreline
_SAMPLES: Final = 240  # of a transect: half a percent of the width apart, at the least
_OFF_CENTRE: Final = 0.35  # of the width: so far from the centreline there must be water
_STEP: Final = np.ones(2, dtype=bool)  # samples
_BORDER_PX: Final = 4  # of the small copy
MOST_TRANSECTS: Final = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Centreline:
    """Points of a smooth line along the middle of a river.

    Attributes:
        places_en_m: ``(n, 2)``, evenly spaced.
        width_m: Rough width of the channel.
        is_downstream: Whether it is known to run as the river flows; else its direction is a guess.
    """

    places_en_m: FloatArray
    width_m: float
    is_downstream: bool = False

    def stations_m(self) -> FloatArray:
        """``(n,)`` along the line, 0 at its start."""
        steps = np.linalg.norm(np.diff(self.places_en_m, axis=0), axis=-1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def at(self, stations_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places ``(k, 2)`` and unit directions ``(k, 2)`` at stations ``(k,)``."""
        own = self.stations_m()
        along = np.gradient(self.places_en_m, own, axis=0)
        places = np.stack([np.interp(stations_m, own, self.places_en_m[:, axis]) for axis in range(2)], axis=-1)
        directions = np.stack([np.interp(stations_m, own, along[:, axis]) for axis in range(2)], axis=-1)
        return places, directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def reversed(self) -> "Centreline":
        """The centreline from its other end."""
        return Centreline(self.places_en_m[::-1].copy(), self.width_m)


@dataclass(frozen=True, slots=True, eq=False)
class WaterMap:
    """The map of the water: cells of ``step_m``, rows from north to south."""

    west_m: float
    north_m: float
    step_m: float
    water: BoolArray
    seen: BoolArray

    def places(self, rows_columns: IntArray | FloatArray) -> FloatArray:
        """East and north ``(n, 2)`` of cells ``(n, 2)``."""
        return np.stack(
            [self.west_m + self.step_m * rows_columns[:, 1], self.north_m - self.step_m * rows_columns[:, 0]], axis=-1
        )


def centreline(plane: WaterPlane, copy: SmallCopy, water: WaterMask) -> Centreline | None:
    """The line along the middle of the water with its islands.

    Args:
        plane: The water's.
        copy: The small copy that the water was found in.
        water: What was found.

    Returns:
        The line, extended at both ends to where the image ends; None where the water has no two banks.
    """
    channel = with_islands(water.water, water.ground)
    factor = 1.0
    while True:
        grid = _grid(plane, copy, (channel, water.ground), factor)
        line = None if grid is None else middle_line(grid)
        if grid is None or line is None:
            return None
        if line.width_m >= 2 * _FEWEST_CELLS * grid.step_m or factor >= _FINEST:
            return line
        factor *= 2.0


def middle_line(grid: WaterMap) -> Centreline | None:
    """The centreline between the two banks, on a map of the water with its islands; None where there is none.

    The shore of a lake or the sea has none: a line in a bay is shorter than the bay is wide, and one in a cove behind a
    headland leaves most of the water aside.
    """
    outlines, _ = cv2.findContours(grid.water.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return None
    outline = max(outlines, key=len)
    piece = cv2.drawContours(np.zeros(grid.water.shape, dtype=np.uint8), [outline], 0, 1, cv2.FILLED)
    grid = replace(grid, water=piece > 0)
    shores = _shores(grid, outline[:, 0, ::-1].astype(np.int64))
    if shores is None:
        return None
    to_bank, apart = _between(grid, shores)
    middle = cv2.ximgproc.thinning(apart.astype(np.uint8) * 255) > 0
    if not middle.any():
        return None
    path = _longest(middle, to_bank)
    if len(path) < _LEAST_CELLS:
        return None
    radii = to_bank[path[:, 0], path[:, 1]]
    length = float(np.sum(np.linalg.norm(np.diff(path, axis=0), axis=-1)))
    is_bay = length < _BAY * 2.0 * float(np.median(radii)) and len(np.unique(shores[1])) == 1
    if is_bay or _share_beside(grid, path, radii) < _COVE:
        return None
    width_m = 2.0 * grid.step_m * float(np.median(radii))
    return Centreline(smoothed(grid.places(path), grid.step_m, width_m), width_m)


def _share_beside(grid: WaterMap, path: IntArray, radii: FloatArray) -> float:
    """Which part of the water is no farther from cells ``(k, 2)`` than the bank is, ``radii (k,)``."""
    beside = np.zeros(grid.water.shape, dtype=np.uint8)
    for (row, column), radius in zip(path.tolist(), np.rint(radii).astype(int).tolist(), strict=True):
        cv2.circle(beside, (column, row), radius, 1, -1)
    return np.count_nonzero(grid.water & (beside > 0)) / np.count_nonzero(grid.water)


def _grid(plane: WaterPlane, copy: SmallCopy, masks: tuple[BoolArray, BoolArray], finer: float) -> WaterMap | None:
    """The map of masks of the small copy: the water with its islands, and what was looked at."""
    channel, ground = masks
    rows, columns = np.nonzero(channel)
    places = plane.places_en_m(copy.to_image(np.stack([columns, rows], axis=-1)))
    places = places[np.isfinite(places[:, 0])]
    if len(places) < 2:  # noqa: PLR2004 - a box has two corners
        return None
    low, high = places.min(axis=0), places.max(axis=0)
    step = float(np.max(high - low)) / (_LONGEST_CELLS * finer)
    if not step > 0:
        return None
    west, north = low[0] - _PAD_CELLS * step, high[1] + _PAD_CELLS * step
    width, height = (math.ceil(extent / step) + 2 * _PAD_CELLS for extent in high - low)
    east = west + step * np.arange(width)
    cells = np.stack(np.broadcast_arrays(east[None], (north - step * np.arange(height))[:, None]), axis=-1)
    pixels = plane.pixels_px(cells)
    small = copy.to_small(pixels)
    seen = plane.in_view(cells, pixels) & sample_mask(ground, small)
    return WaterMap(west, north, step, sample_mask(channel, small) & seen, seen)


def sample_mask(mask: BoolArray, at_px: FloatArray) -> BoolArray:
    """A mask ``(height, width)`` at the pixels nearest to ``(..., 2)``; False beside it and at NaN."""
    nearest = np.rint(np.clip(np.nan_to_num(at_px, nan=-1e6), -1e6, 1e6)).astype(np.int64)
    inside = np.all((nearest >= 0) & (nearest < [mask.shape[1], mask.shape[0]]), axis=-1)
    u, v = np.where(inside, nearest[..., 0], 0), np.where(inside, nearest[..., 1], 0)
    return np.asarray(mask[v, u] & inside)


def _shores(grid: WaterMap, outline: IntArray) -> tuple[IntArray, IntArray, FloatArray] | None:
    """Cells of the shores, rows and columns ``(k, 2)``, with the number of their bank and how far along it they are.

    A bank is a piece of the water's outline with land on its other side; one that is much shorter than the longest, and
    would be a stone at the image's border, is left out. None where there is no bank.
    """
    land = (grid.seen & ~grid.water).astype(np.uint8)
    beside = cv2.dilate(land, np.ones((3, 3), dtype=np.uint8)) > 0
    is_bank = beside[outline[:, 0], outline[:, 1]]
    if not is_bank.any():
        return None
    start = int(np.argmin(is_bank))  # in a gap, where there is one
    outline, is_bank = np.roll(outline, -start, axis=0), np.roll(is_bank, -start)
    is_bank = cv2.morphologyEx(is_bank.astype(np.uint8)[None], cv2.MORPH_CLOSE, np.ones((1, _GAP_CELLS)))[0] > 0
    number = np.cumsum(np.diff(is_bank.astype(np.int8), prepend=0) == 1)
    lengths = np.bincount(number[is_bank])
    kept = is_bank & (lengths[np.where(is_bank, number, 0)] > _STONE * lengths.max())
    steps = np.linalg.norm(np.diff(outline, axis=0, prepend=outline[:1]), axis=-1)
    return outline[kept], number[kept].astype(np.int64), np.cumsum(steps)[kept]


def _between(grid: WaterMap, shores: tuple[IntArray, IntArray, FloatArray]) -> tuple[FloatArray, BoolArray]:
    """How far each cell is from a bank, in cells; and which cells lie between banks, or between a bank's two flanks."""
    cells, bank, along = shores
    clear = np.ones(grid.water.shape, dtype=np.uint8)
    clear[cells[:, 0], cells[:, 1]] = 0
    to_bank, label = cv2.distanceTransformWithLabels(clear, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    nearest = np.zeros(int(label.max()) + 1, dtype=np.int64)
    nearest[label[cells[:, 0], cells[:, 1]]] = np.arange(len(cells))
    of = nearest[label]
    whole = float(along[-1] - along[0]) if len(np.unique(bank)) == 1 else math.inf
    apart = np.zeros(grid.water.shape, dtype=bool)
    for axis in range(2):
        here, there = (slice(None, -1), slice(1, None)) if axis == 0 else (slice(None), slice(None))
        left, right = (slice(None), slice(None)) if axis == 0 else (slice(None, -1), slice(1, None))
        one, other = of[here, left], of[there, right]
        far = np.abs(along[one] - along[other])
        far = np.minimum(far, np.maximum(whole - far, 0.0)) if _is_ring(grid, cells) else far
        flanks = far > _FLANKS * (to_bank[here, left] + _FLANK_CELLS)
        apart[here, left] |= (bank[one] != bank[other]) | flanks
    return np.asarray(to_bank, dtype=np.float64), apart & grid.water


def _is_ring(grid: WaterMap, cells: IntArray) -> bool:
    """Whether one bank goes all round: a pond."""
    return bool(np.max(np.abs(cells[0] - cells[-1])) <= _GAP_CELLS) and bool(grid.water.any())


def _longest(line: BoolArray, to_bank: FloatArray) -> IntArray:
    """Rows and columns ``(k, 2)`` of the longest way along a thin line, shorter spurs left out."""
    cells = np.argwhere(line)
    graph = _linked(line, cells)
    first = int(np.argmax(to_bank[cells[:, 0], cells[:, 1]]))
    one = _farthest(_ways(graph, first)[0])
    away, before = _ways(graph, one)
    way = [_farthest(away)]
    while way[-1] != one:
        way.append(int(before[way[-1]]))
    return np.asarray(cells[way])


def _linked(line: BoolArray, cells: IntArray) -> csr_array:
    """Distances between neighbouring cells."""
    number = np.full(line.shape, -1)
    number[cells[:, 0], cells[:, 1]] = np.arange(len(cells))
    starts, ends, lengths = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        rows, columns = cells[:, 0] + down, cells[:, 1] + right
        inside = (rows < line.shape[0]) & (columns >= 0) & (columns < line.shape[1])
        to = np.full(len(cells), -1)
        to[inside] = number[rows[inside], columns[inside]]
        starts.append(np.flatnonzero(to >= 0))
        ends.append(to[to >= 0])
        lengths.append(np.full(len(ends[-1]), math.hypot(down, right)))
    links = np.concatenate(starts), np.concatenate(ends)
    return csr_array((np.concatenate(lengths), links), shape=(len(cells), len(cells)))


def _ways(graph: csr_array, start: int) -> tuple[FloatArray, IntArray]:
    """Distance of every node from one, infinite where it cannot be reached, and the node before it on the way."""
    away, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)  # type: ignore[call-overload] # its stubs know no sparse arrays of two axes
    return np.asarray(away, dtype=np.float64), np.asarray(before, dtype=np.int64)


def _farthest(away: FloatArray) -> int:
    return int(np.argmax(np.where(np.isfinite(away), away, -1.0)))


def smoothed(places_en_m: FloatArray, step_m: float, width_m: float) -> FloatArray:
    """A line ``(n, 2)`` smoothed over a part of the river's width, evenly spaced, longer by one width at either end."""
    own = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places_en_m, axis=0), axis=-1))])
    count = max(8, math.ceil(own[-1] / step_m))
    even = np.linspace(0.0, own[-1], count)
    line = np.stack([np.interp(even, own, places_en_m[:, axis]) for axis in range(2)], axis=-1)
    spacing = own[-1] / (count - 1)
    pad = max(1, round(_EXTEND_WIDTHS * width_m / spacing))
    tail = min(count - 1, max(2, round(0.5 * width_m / spacing)))
    ahead = (line[-1] - line[-1 - tail]) / tail
    back = (line[0] - line[tail]) / tail
    steps = np.arange(1, pad + 1)[:, None]
    line = np.concatenate([line[0] + steps[::-1] * back, line, line[-1] + steps * ahead])
    sigma = _SMOOTH_WIDTHS * width_m / spacing
    line = np.asarray(gaussian_filter1d(line, min(sigma, pad / 2), axis=0, mode="nearest"))
    keep = pad // 4  # the outermost are drawn inwards by the smoothing
    return line[keep : len(line) - keep]


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
    copy: SmallCopy,
    water: BoolArray,
    ground: BoolArray,
    line: Centreline,
    stations_m: FloatArray,
) -> Transects:
    """Lay transects across a river.

    Args:
        plane: The water's.
        copy: The small copy that was looked at.
        water: ``(height, width)`` of it: the water.
        ground: ``(height, width)``: what was looked at.
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
    small = copy.to_small(pixels)
    channel = sample_mask(with_islands(water, ground), small) & seen
    wet = sample_mask(water, small)
    told = sample_mask(_well_inside(ground), small)
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
        for low, high in _runs(~wet[row, first : last + 1]):
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
