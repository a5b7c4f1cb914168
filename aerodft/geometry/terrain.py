"""Intersection of rays with the ground of an elevation model.

In the compiled loops positions are in cells: the node of row ``j`` and column ``i`` is at (i, j), the south-west corner
of cell (i, j). Heights and ranges are in metres. The ground of a cell is the bilinear patch through its four nodes.
Along a ray the patch is a parabola, and so is the earth's curvature: the intersection is one quadratic equation, solved
exactly. Blocks of cells that lie wholly below the ray are skipped.
"""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.geometry.ground import GroundHits, require_finite
from aerodft.jit import njit
from aerodft.model import CODE_OF, FloatArray, Status, read_only

EARTH_RADIUS_M: Final = 6_371_009.0
"""The earth's mean radius (IUGG); its radii of curvature differ from it by half a percent."""

STANDARD_REFRACTION: Final = 0.13
"""Gauss's coefficient for daylight: sight lines bend with 0.13 of the earth's curvature."""

_MIN_NODES = 2  # on a grid's side
_HIT, _ABOVE, _OUTSIDE, _HOLE, _TOO_FAR, _BELOW, _NO_RAY, _NO_HIT_YET = range(8)  # how a ray ends
_STATUS_OF_END = (
    Status.OK,
    Status.ABOVE_HORIZON,
    Status.BEYOND_TERRAIN,
    Status.NO_ELEVATION,
    Status.BEYOND_RANGE,
    Status.BELOW_SURFACE,
    Status.BEYOND_LENS_MODEL,
)
# Compiled code returns ends, not status codes: numba's disk cache does not see changes of another file.
_CODES = np.array([CODE_OF[end] for end in _STATUS_OF_END], dtype=np.uint8)
_BLOCK_SHIFT = 4
_BLOCK_CELLS = 1 << _BLOCK_SHIFT  # on a block's side
_RANGE, _HEIGHT, _SLOPE_X, _SLOPE_Y, _COLUMNS = 0, 1, 2, 3, 4  # columns of hits; slopes in m per cell

_MAX_RANGE_M = 1e12  # nothing is farther (conventions.LARGEST)

Ray = tuple[float, float, float, float, float, float, float]
"""Column, row and height of the camera; their change per metre of range; and the curvature, in m per m^2 of range.

A ray curves upward in the axes of a flattened earth.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElevationGrid:
    """Ground heights at the nodes of square cells; within a cell the ground is the bilinear patch of its nodes.

    A bilinear patch agrees with interpolated heights (``elevation_at``, other tools), which two triangles do not, and
    needs no choice of a diagonal. Patches join without gaps.

    Attributes:
        east_m: East of the south-westernmost node, in the station's ENU or in any metric map projection.
        north_m: North of it.
        cell_m: Distance of the nodes in both directions.
        heights_m: ``(rows, columns)``, rows to the north, columns to the east; NaN where no height is known. Same
            datum as the cameras' heights.
        peaks_m: The highest node of each block of cells, infinite where one is unknown.
        summit_m: The highest node.
    """

    east_m: float
    north_m: float
    cell_m: float
    heights_m: FloatArray
    peaks_m: FloatArray = field(init=False, repr=False)
    summit_m: float = field(init=False)

    def __post_init__(self) -> None:
        heights = read_only(self.heights_m)
        if not (heights.ndim == 2 and min(heights.shape) >= _MIN_NODES):  # noqa: PLR2004 - rows and columns
            raise ValueError(f"got heights of shape {heights.shape}, expected rows and columns, two or more of each")
        if not (self.cell_m > 0.0 and math.isfinite(self.cell_m + self.east_m + self.north_m)):
            raise ValueError(f"got cells of {self.cell_m} m at {self.east_m}, {self.north_m}, expected finite ones")
        if np.any(np.isinf(heights)) or np.all(np.isnan(heights)):
            raise ValueError("got infinite heights or none at all, expected heights, and NaN where one is unknown")
        object.__setattr__(self, "heights_m", heights)
        object.__setattr__(self, "peaks_m", read_only(_block_maxima(heights)))
        object.__setattr__(self, "summit_m", float(np.nanmax(heights)))


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """Ground of an elevation model on the curved earth, as a ``ground.Ground``.

    Heights of the camera and of the grid are above the same curved level surface; the camera's directions refer to its
    own horizontal, below which ground at the distance ``d`` drops by ``(1 - refraction) d^2 / (2 earth_radius_m)``:
    7 cm at 1 km.

    Attributes:
        grid: The heights.
        refraction: Refraction coefficient.
        earth_radius_m: ``math.inf`` for a flat earth.
    """

    grid: ElevationGrid
    refraction: float = STANDARD_REFRACTION
    earth_radius_m: float = EARTH_RADIUS_M

    def __post_init__(self) -> None:
        if not (self.earth_radius_m > 0.0 and 0.0 <= self.refraction < 1.0):
            raise ValueError(
                f"got an earth of {self.earth_radius_m} m, a refraction of {self.refraction}, "
                "expected a positive radius, and a refraction from 0 to below 1"
            )

    @property
    def has_edges(self) -> bool:
        """True: ridges occlude the ground behind them."""
        return True

    def meet(self, camera_enu_m: FloatArray, directions_enu: FloatArray, elevation_m: npt.ArrayLike) -> GroundHits:
        """Intersect rays with the ground: the first point of each, what a ridge hides is not hit; as ``Ground.meet``.

        Returns:
            The points, on the grid's surface. Misses: ``ABOVE_HORIZON`` where the ray stays above all that the grid
            has, ``BEYOND_TERRAIN`` where it leaves the grid before (or starts outside), ``NO_ELEVATION`` where it is
            over a hole no higher than the highest node (ground in the hole could be in its way),
            ``BELOW_SURFACE`` for a camera on or in the ground, and ``BEYOND_LENS_MODEL`` without a ray.

        Raises:
            ValueError: A position or elevation is not finite.
        """
        curvature_per_m = (1.0 - self.refraction) / (2.0 * self.earth_radius_m)
        camera, elevation = require_finite(camera_enu_m, "camera position"), require_finite(elevation_m, "elevation")
        directions = np.asarray(directions_enu, dtype=np.float64)
        shape = np.broadcast_shapes(camera.shape[:-1], directions.shape[:-1], elevation.shape)
        rays = np.empty((*shape, 7))
        rays[..., :3] = camera
        rays[..., 2] -= elevation
        with np.errstate(invalid="ignore", divide="ignore"):
            rays[..., 3:6] = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        rays[..., 6] = curvature_per_m * (rays[..., 3] ** 2 + rays[..., 4] ** 2)
        hits, ends = np.full((*shape, _COLUMNS), np.nan), np.empty(shape, dtype=np.uint8)
        grid, in_cells = self.grid, _to_cell_units(rays.reshape(-1, 7), self.grid)
        _trace_rays(in_cells, grid.heights_m, grid.peaks_m, grid.summit_m, hits.reshape(-1, _COLUMNS), ends.reshape(-1))
        return _hits(rays, hits, ends, elevation, grid.cell_m, curvature_per_m)

    def height_at(self, east_north_m: FloatArray) -> FloatArray:
        """Height of the ground ``(...)`` at east and north ``(..., 2)``; NaN outside the grid and in its holes."""
        return elevation_at(self.grid, east_north_m)


def _block_maxima(heights_m: FloatArray) -> FloatArray:
    highest = np.maximum(heights_m[:-1], heights_m[1:])
    highest = np.maximum(highest[:, :-1], highest[:, 1:])
    for axis in (0, 1):
        highest = np.maximum.reduceat(highest, np.arange(0, highest.shape[axis], _BLOCK_CELLS), axis=axis)
    return np.where(np.isnan(highest), np.inf, highest)


def elevation_at(grid: ElevationGrid, east_north_m: npt.ArrayLike) -> FloatArray:
    """Height of the ground ``(...)`` at ``east_north_m (..., 2)``; NaN outside the grid and in its holes."""
    east_north = np.asarray(east_north_m, dtype=np.float64)
    places = (east_north - [grid.east_m, grid.north_m]) / grid.cell_m
    out = np.empty(places.shape[:-1])
    sample_all(grid.heights_m, np.ascontiguousarray(places.reshape(-1, 2)), out.reshape(-1))
    return out


def _to_cell_units(rays: FloatArray, grid: ElevationGrid) -> FloatArray:
    """Rays ``(n, 7)`` from metres to cell units, see ``Ray``."""
    columns = np.array([0, 1, 3, 4])
    shifted = rays - [grid.east_m, grid.north_m, 0, 0, 0, 0, 0]
    shifted[:, columns] /= grid.cell_m
    return shifted


def _hits(
    rays: FloatArray,
    hits: FloatArray,
    ends: npt.NDArray[np.uint8],
    elevation: FloatArray,
    cell_m: float,
    curvature_per_m: float,
) -> GroundHits:
    range_m = hits[..., _RANGE]
    points = rays[..., :3] + range_m[..., None] * rays[..., 3:6]
    points[..., 2] = hits[..., _HEIGHT] + elevation
    normal = np.ones_like(points)
    normal[..., :2] = -hits[..., _SLOPE_X : _SLOPE_Y + 1] / cell_m
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return GroundHits(points, range_m, normal, _CODES[ends], curvature_per_m)


@njit
def sample(heights_m: FloatArray, x: float, y: float) -> float:
    """Bilinear height at column ``x`` and row ``y``; NaN outside, and where a node with weight has none."""
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
    """Heights by ``sample`` at ``places (n, 2)`` of column and row, into ``out_m (n,)``."""
    for k in range(len(places)):
        out_m[k] = sample(heights_m, places[k, 0], places[k, 1])


@njit
def _trace_rays(
    rays: FloatArray,
    heights_m: FloatArray,
    peaks_m: FloatArray,
    summit_m: float,
    out: FloatArray,
    ends: npt.NDArray[np.uint8],
) -> None:
    """Trace ``rays (n, 7)`` (see ``Ray``) to the ground.

    Args:
        rays: NaN where there is none.
        heights_m: ``(rows, columns)`` at the nodes, NaN where unknown.
        peaks_m: The highest node of each block, infinite where one is unknown.
        summit_m: The highest node of all.
        out: ``(n, 4)``, written where a ray hits.
        ends: ``(n,)`` of ``_HIT`` and the others.
    """
    for k in range(len(rays)):
        ray = (rays[k, 0], rays[k, 1], rays[k, 2], rays[k, 3], rays[k, 4], rays[k, 5], rays[k, 6])
        ends[k] = _trace_ray(ray, heights_m, peaks_m, summit_m, out[k])


@njit
def _trace_ray(ray: Ray, heights_m: FloatArray, peaks_m: FloatArray, summit_m: float, out: FloatArray) -> int:
    x, y, up, dx, dy, rise, bend = ray
    if math.isnan(rise):
        return _NO_RAY
    rows, columns = heights_m.shape
    if not (0.0 <= x <= columns - 1 and 0.0 <= y <= rows - 1):
        return _OUTSIDE
    at = 0.0
    if up > summit_m:
        at = _first_root(bend, rise, up - summit_m, _MAX_RANGE_M)  # nothing to meet, and no hole that matters, before
        if at < 0.0:
            return _ABOVE
    elif up <= sample(heights_m, x, y):
        return _BELOW
    edge = min(_range_to_border(x, dx, 0, columns - 1), _range_to_border(y, dy, 0, rows - 1))
    if at > edge:
        return _OUTSIDE
    return _trace_blocks(ray, heights_m, peaks_m, summit_m, at, out)


@njit
def _trace_blocks(
    ray: Ray, heights_m: FloatArray, peaks_m: FloatArray, summit_m: float, at: float, out: FloatArray
) -> int:
    x, y, up, dx, dy, rise, bend = ray
    last_i, last_j = heights_m.shape[1] - 2, heights_m.shape[0] - 2
    i, j = _clamped_cell(x + at * dx, 0, last_i), _clamped_cell(y + at * dy, 0, last_j)
    while True:
        left, low = (i >> _BLOCK_SHIFT) << _BLOCK_SHIFT, (j >> _BLOCK_SHIFT) << _BLOCK_SHIFT
        right, high = min(left + _BLOCK_CELLS, last_i + 1), min(low + _BLOCK_CELLS, last_j + 1)
        at_x, at_y = _range_to_border(x, dx, left, right), _range_to_border(y, dy, low, high)
        leave = max(at, min(at_x, at_y, _MAX_RANGE_M))
        if _lowest_height(ray, at, leave) <= peaks_m[j >> _BLOCK_SHIFT, i >> _BLOCK_SHIFT]:
            end = _trace_cells(ray, heights_m, (left, right, low, high), (i, j), at, leave, out)
            if end != _NO_HIT_YET:
                return end
        at = leave
        if at >= _MAX_RANGE_M:
            return _TOO_FAR
        if rise + 2.0 * bend * at >= 0.0 and up + at * (rise + at * bend) > summit_m:
            return _ABOVE
        if at_x <= at_y:
            i, j = (right if dx > 0.0 else left - 1), _clamped_cell(y + at * dy, low, high - 1)
        else:
            i, j = _clamped_cell(x + at * dx, left, right - 1), (high if dy > 0.0 else low - 1)
        if not (0 <= i <= last_i and 0 <= j <= last_j):
            return _OUTSIDE


@njit
def _trace_cells(
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
        at_x, at_y = _range_to_border(x, dx, i, i + 1), _range_to_border(y, dy, j, j + 1)
        stop = max(at, min(at_x, at_y, leave))
        end = _intersect_patch(ray, heights_m, i, j, at, stop, out)
        if end != _NO_HIT_YET or stop >= leave:
            return end
        at = stop
        if at_x <= at_y:
            i += 1 if dx > 0.0 else -1
        else:
            j += 1 if dy > 0.0 else -1
        if not (left <= i < right and low <= j < high):
            return _NO_HIT_YET


@njit
def _intersect_patch(ray: Ray, heights_m: FloatArray, i: int, j: int, at: float, stop: float, out: FloatArray) -> int:
    x, y, up, dx, dy, rise, bend = ray
    corner, east = heights_m[j, i], heights_m[j, i + 1] - heights_m[j, i]
    north, twist = heights_m[j + 1, i] - corner, heights_m[j + 1, i + 1] - heights_m[j + 1, i] - east
    u, v = x + at * dx - i, y + at * dy - j
    above = up + at * (rise + at * bend) - (corner + u * east + v * (north + u * twist))
    if math.isnan(above):
        return _HOLE
    step = 0.0  # the ground has no gaps: below it at a border is on it, within rounding
    if above > 0.0:
        falling = rise + 2.0 * bend * at - (dx * (east + v * twist) + dy * (north + u * twist))
        step = _first_root(bend - dx * dy * twist, falling, above, stop - at)
        if step < 0.0:
            return _NO_HIT_YET
    u, v = u + step * dx, v + step * dy
    out[_RANGE] = at + step
    out[_HEIGHT] = corner + u * east + v * (north + u * twist)
    out[_SLOPE_X], out[_SLOPE_Y] = east + v * twist, north + u * twist
    return _HIT


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
def _range_to_border(start: float, rate: float, low: int, high: int) -> float:
    """Range at which a coordinate leaves [low, high]."""
    if rate > 0.0:
        return (high - start) / rate
    if rate < 0.0:
        return (low - start) / rate
    return _MAX_RANGE_M


@njit
def _lowest_height(ray: Ray, start: float, stop: float) -> float:
    """Lowest height of the ray between two ranges."""
    _, _, up, _, _, rise, bend = ray
    lowest = min(up + start * (rise + start * bend), up + stop * (rise + stop * bend))
    if bend > 0.0 and start < -0.5 * rise / bend < stop:
        lowest = up - 0.25 * rise * rise / bend
    return lowest


@njit
def _clamped_cell(place: float, low: int, high: int) -> int:
    """Cell of a coordinate, clamped to ``low`` and ``high``."""
    return min(max(int(place), low), high)
