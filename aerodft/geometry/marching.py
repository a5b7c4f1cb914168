"""The hot loops over an elevation model: the height at a point, and where a ray first meets the ground.

All of them stand in this module: code that is kept on disk is renewed only when its own file changes.

Positions are in cells: the node of row ``j`` and column ``i`` lies at (i, j), and cell (i, j) has it as its south-west
corner. Heights and ranges are in metres. The ground of a cell is the bilinear patch through its four nodes. Along a
ray that is a parabola, and so is the earth's curvature, so that the meeting is one quadratic equation, solved exactly.
Blocks of cells that lie wholly below the ray are stepped over.
"""

import math

import numpy as np
import numpy.typing as npt

from aerodft.geometry.jit import njit
from aerodft.model.arrays import FloatArray

HIT, NEVER, OUTSIDE, HOLE, TOO_FAR, BURIED, NO_RAY, _ONWARD = 0, 1, 2, 3, 4, 5, 6, 7  # how a ray ends
SHIFT = 4
BLOCK = 1 << SHIFT  # cells on a block's side
RANGE, HEIGHT, SLOPE_X, SLOPE_Y, OUT = 0, 1, 2, 3, 4  # columns of what ``march`` writes; slopes in m per cell

_FAR = 1e12  # nothing is farther (conventions.LARGEST)

Ray = tuple[float, float, float, float, float, float, float]
"""Column, row and height of the camera; what they change by per metre of range; and the bend, in m per m^2 of range.

A ray bends upward in the axes of a flattened earth.
"""


@njit
def sample(heights_m: FloatArray, x: float, y: float) -> float:
    """Height at column ``x`` and row ``y``; NaN outside, and where one of the nodes that count has none."""
    rows, columns = heights_m.shape
    if not (0.0 <= x <= columns - 1 and 0.0 <= y <= rows - 1):
        return math.nan
    i, j = min(int(x), columns - 2), min(int(y), rows - 2)
    u, v = x - i, y - j
    height = 0.0
    for down, weight_y in ((0, 1.0 - v), (1, v)):
        for right, weight_x in ((0, 1.0 - u), (1, u)):
            weight = weight_x * weight_y
            if weight > 0.0:  # else a node without a height would spoil those beside it
                height += weight * heights_m[j + down, i + right]
    return height


@njit
def sample_all(heights_m: FloatArray, places: FloatArray, out_m: FloatArray) -> None:
    """``sample`` at ``places (n, 2)`` of column and row, into ``out_m (n,)``."""
    for k in range(len(places)):
        out_m[k] = sample(heights_m, places[k, 0], places[k, 1])


@njit
def march(
    rays: FloatArray,
    heights_m: FloatArray,
    peaks_m: FloatArray,
    summit_m: float,
    limit_m: float,
    out: FloatArray,
    ends: npt.NDArray[np.uint8],
) -> None:
    """Follow ``rays (n, 7)`` (see ``Ray``) to the ground.

    Args:
        rays: NaN where there is none.
        heights_m: ``(rows, columns)`` at the nodes, NaN where unknown.
        peaks_m: The highest node of each block, infinite where one is unknown.
        summit_m: The highest node of all.
        limit_m: Rays end here.
        out: ``(n, 4)``, written where a ray hits.
        ends: ``(n,)`` of ``HIT`` and the others.
    """
    limit = min(limit_m, _FAR)
    for k in range(len(rays)):
        ray = (rays[k, 0], rays[k, 1], rays[k, 2], rays[k, 3], rays[k, 4], rays[k, 5], rays[k, 6])
        ends[k] = _follow(ray, heights_m, peaks_m, summit_m, limit, out[k])


@njit
def _follow(
    ray: Ray, heights_m: FloatArray, peaks_m: FloatArray, summit_m: float, limit: float, out: FloatArray
) -> int:
    x, y, up, dx, dy, rise, bend = ray
    if math.isnan(rise):
        return NO_RAY
    rows, columns = heights_m.shape
    if not (0.0 <= x <= columns - 1 and 0.0 <= y <= rows - 1):
        return OUTSIDE
    at = 0.0
    if up > summit_m:
        at = _first_root(bend, rise, up - summit_m, _FAR)  # nothing to meet, and no hole that matters, before
        if at < 0.0:
            return NEVER
    elif up <= sample(heights_m, x, y):
        return BURIED
    edge = min(_border(x, dx, 0, columns - 1), _border(y, dy, 0, rows - 1))
    if at > min(edge, limit):
        return TOO_FAR if limit < edge else OUTSIDE
    return _cross_blocks(ray, heights_m, peaks_m, summit_m, at, limit, out)


@njit
def _cross_blocks(
    ray: Ray, heights_m: FloatArray, peaks_m: FloatArray, summit_m: float, at: float, limit: float, out: FloatArray
) -> int:
    x, y, up, dx, dy, rise, bend = ray
    last_i, last_j = heights_m.shape[1] - 2, heights_m.shape[0] - 2
    i, j = _within(x + at * dx, 0, last_i), _within(y + at * dy, 0, last_j)
    while True:
        left, low = (i >> SHIFT) << SHIFT, (j >> SHIFT) << SHIFT
        right, high = min(left + BLOCK, last_i + 1), min(low + BLOCK, last_j + 1)
        at_x, at_y = _border(x, dx, left, right), _border(y, dy, low, high)
        leave = max(at, min(at_x, at_y, limit))
        if _lowest(ray, at, leave) <= peaks_m[j >> SHIFT, i >> SHIFT]:
            end = _cross_cells(ray, heights_m, (left, right, low, high), (i, j), at, leave, out)
            if end != _ONWARD:
                return end
        at = leave
        if at >= limit:
            return TOO_FAR
        if rise + 2.0 * bend * at >= 0.0 and up + at * (rise + at * bend) > summit_m:
            return NEVER
        if at_x <= at_y:
            i, j = (right if dx > 0.0 else left - 1), _within(y + at * dy, low, high - 1)
        else:
            i, j = _within(x + at * dx, left, right - 1), (high if dy > 0.0 else low - 1)
        if not (0 <= i <= last_i and 0 <= j <= last_j):
            return OUTSIDE


@njit
def _cross_cells(
    ray: Ray,
    heights_m: FloatArray,
    block: tuple[int, int, int, int],
    cell: tuple[int, int],
    at: float,
    leave: float,
    out: FloatArray,
) -> int:
    x, y, _, dx, dy, _, _ = ray
    left, right, low, high = block
    i, j = cell
    while True:
        at_x, at_y = _border(x, dx, i, i + 1), _border(y, dy, j, j + 1)
        stop = max(at, min(at_x, at_y, leave))
        end = _meet_patch(ray, heights_m, i, j, at, stop, out)
        if end != _ONWARD or stop >= leave:
            return end
        at = stop
        if at_x <= at_y:
            i += 1 if dx > 0.0 else -1
        else:
            j += 1 if dy > 0.0 else -1
        if not (left <= i < right and low <= j < high):
            return _ONWARD


@njit
def _meet_patch(ray: Ray, heights_m: FloatArray, i: int, j: int, at: float, stop: float, out: FloatArray) -> int:
    x, y, up, dx, dy, rise, bend = ray
    corner, east = heights_m[j, i], heights_m[j, i + 1] - heights_m[j, i]
    north, twist = heights_m[j + 1, i] - corner, heights_m[j + 1, i + 1] - heights_m[j + 1, i] - east
    u, v = x + at * dx - i, y + at * dy - j
    above = up + at * (rise + at * bend) - (corner + u * east + v * (north + u * twist))
    if math.isnan(above):
        return HOLE
    step = 0.0  # the ground has no gaps: below it at a border is on it, within rounding
    if above > 0.0:
        falling = rise + 2.0 * bend * at - (dx * (east + v * twist) + dy * (north + u * twist))
        step = _first_root(bend - dx * dy * twist, falling, above, stop - at)
        if step < 0.0:
            return _ONWARD
    u, v = u + step * dx, v + step * dy
    out[RANGE] = at + step
    out[HEIGHT] = corner + u * east + v * (north + u * twist)
    out[SLOPE_X], out[SLOPE_Y] = east + v * twist, north + u * twist
    return HIT


@njit
def _first_root(a: float, b: float, c: float, end: float) -> float:
    """First zero of ``a t^2 + b t + c`` in (0, end], for ``c > 0``; -1 where there is none.

    ``c / m`` and ``m / a`` are its zeros without the cancellation of the common formula.
    """
    if b >= 0.0 and a >= 0.0:
        return -1.0
    inside = b * b - 4.0 * a * c
    if inside < 0.0:
        return -1.0
    m = -0.5 * (b + math.copysign(math.sqrt(inside), b))
    root = c / m if b < 0.0 else m / a
    return root if root <= end else -1.0


@njit
def _border(start: float, rate: float, low: int, high: int) -> float:
    """Range at which a coordinate leaves [low, high]."""
    if rate > 0.0:
        return (high - start) / rate
    if rate < 0.0:
        return (low - start) / rate
    return _FAR


@njit
def _lowest(ray: Ray, start: float, stop: float) -> float:
    """The ray's smallest height between two ranges."""
    _, _, up, _, _, rise, bend = ray
    lowest = min(up + start * (rise + start * bend), up + stop * (rise + stop * bend))
    if bend > 0.0 and start < -0.5 * rise / bend < stop:
        lowest = up - 0.25 * rise * rise / bend
    return lowest


@njit
def _within(place: float, low: int, high: int) -> int:
    """The cell of a coordinate, at least ``low`` and at most ``high``."""
    return min(max(int(place), low), high)
