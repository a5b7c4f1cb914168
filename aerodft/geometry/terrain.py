"""Ground given by an elevation model, and the first point of it that each ray meets."""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.geometry import marching
from aerodft.geometry.ground import GroundHits, finite
from aerodft.model.arrays import FloatArray, read_only
from aerodft.model.status import CODE_OF, Status

EARTH_RADIUS_M: Final = 6_371_009.0
"""The earth's mean radius (IUGG); its radii of curvature differ from it by half a percent."""

STANDARD_REFRACTION: Final = 0.13
"""Gauss's coefficient for daylight: sight lines bend with 0.13 of the earth's curvature."""

_SMALLEST = 2  # nodes on a grid's side
_STATUS_OF = {
    marching.HIT: Status.OK,
    marching.NEVER: Status.ABOVE_HORIZON,
    marching.OUTSIDE: Status.BEYOND_TERRAIN,
    marching.HOLE: Status.NO_ELEVATION,
    marching.TOO_FAR: Status.BEYOND_RANGE,
    marching.BURIED: Status.BELOW_SURFACE,
    marching.NO_RAY: Status.BEYOND_LENS_MODEL,
}
_CODES = np.array([CODE_OF[_STATUS_OF[end]] for end in range(len(_STATUS_OF))], dtype=np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElevationGrid:
    """Heights of the ground on square cells; between four nodes the ground is the bilinear patch through them.

    The patch is chosen over two triangles because it is what reading a height between nodes gives everywhere else
    (``elevation_at``, other people's tools), and has no diagonal that somebody must choose. It joins without gaps.

    Attributes:
        east_m: East of the south-westernmost node, in the station's ENU or in any metric map projection.
        north_m: North of it.
        cell_m: Distance of the nodes in both directions.
        heights_m: ``(rows, columns)``, rows to the north, columns to the east; NaN where no height is known. Over the
            same zero as the cameras' heights.
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
        if not (heights.ndim == 2 and min(heights.shape) >= _SMALLEST):  # noqa: PLR2004 - rows and columns
            raise ValueError(f"got heights of shape {heights.shape}, expected rows and columns, two or more of each")
        if not (self.cell_m > 0.0 and math.isfinite(self.cell_m + self.east_m + self.north_m)):
            raise ValueError(f"got cells of {self.cell_m} m at {self.east_m}, {self.north_m}, expected finite ones")
        if np.any(np.isinf(heights)) or np.all(np.isnan(heights)):
            raise ValueError("got infinite heights or none at all, expected heights, and NaN where one is unknown")
        object.__setattr__(self, "heights_m", heights)
        object.__setattr__(self, "peaks_m", read_only(_peaks(heights)))
        object.__setattr__(self, "summit_m", float(np.nanmax(heights)))


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """The ground of an elevation model, on the curved earth, as ``ground.Ground``.

    Attributes:
        grid: Its heights.
        refraction: Refraction coefficient.
    """

    grid: ElevationGrid
    refraction: float = STANDARD_REFRACTION

    @property
    def has_edges(self) -> bool:
        """Ridges hide what is behind them."""
        return True

    def meet(self, camera_enu_m: FloatArray, directions_enu: FloatArray, elevation_m: npt.ArrayLike) -> GroundHits:
        """As ``meet_terrain``."""
        grid, refraction = self.grid, self.refraction
        return meet_terrain(camera_enu_m, directions_enu, grid, elevation_m=elevation_m, refraction=refraction)

    def height_at(self, east_north_m: FloatArray) -> FloatArray:
        """As ``elevation_at``."""
        return elevation_at(self.grid, east_north_m)


def _peaks(heights_m: FloatArray) -> FloatArray:
    highest = np.maximum(heights_m[:-1], heights_m[1:])
    highest = np.maximum(highest[:, :-1], highest[:, 1:])
    for axis in (0, 1):
        highest = np.maximum.reduceat(highest, np.arange(0, highest.shape[axis], marching.BLOCK), axis=axis)
    return np.where(np.isnan(highest), np.inf, highest)


def elevation_at(grid: ElevationGrid, east_north_m: npt.ArrayLike) -> FloatArray:
    """Height of the ground ``(...)`` at ``east_north_m (..., 2)``; NaN outside the grid and in its holes."""
    east_north = np.asarray(east_north_m, dtype=np.float64)
    places = (east_north - [grid.east_m, grid.north_m]) / grid.cell_m
    out = np.empty(places.shape[:-1])
    marching.sample_all(grid.heights_m, np.ascontiguousarray(places.reshape(-1, 2)), out.reshape(-1))
    return out


def meet_terrain(
    camera_enu_m: FloatArray,
    directions_enu: FloatArray,
    grid: ElevationGrid,
    *,
    elevation_m: npt.ArrayLike = 0.0,
    max_range_m: float = math.inf,
    earth_radius_m: float = EARTH_RADIUS_M,
    refraction: float = 0.0,
) -> GroundHits:
    """The first point of the ground that each ray meets: what lies behind a ridge is hidden.

    The camera's heights and the grid's count along the vertical from the same curved level surface, and its directions
    are against its own horizontal. Seen from there the ground at the distance ``d`` lies lower by
    ``(1 - refraction) d^2 / (2 earth_radius_m)``: 8 cm at 1 km.

    Args:
        camera_enu_m: Where the rays start, ``(..., 3)``, in the grid's axes.
        directions_enu: Where they go, ``(..., 3)``, of any length; NaN where there is no ray.
        grid: The ground.
        elevation_m: Height of the measured surface above the ground, ``(...)``. The three arrays broadcast.
        max_range_m: Limit of the slant range.
        earth_radius_m: ``math.inf`` for a flat earth.
        refraction: Refraction coefficient, see ``STANDARD_REFRACTION``.

    Returns:
        The points, on the grid's surface. Misses: ``ABOVE_HORIZON`` where the ray stays above all that the grid has,
        ``BEYOND_TERRAIN`` where it leaves the grid before (or starts outside), ``NO_ELEVATION`` where it comes over a
        hole no higher than the highest node (something in the hole could stand in its way), ``BEYOND_RANGE``,
        ``BELOW_SURFACE`` for a camera on or in the ground, and ``BEYOND_LENS_MODEL`` without a ray.

    Raises:
        ValueError: A position or elevation is not finite; the range, the radius or the refraction makes no sense.
    """
    if not (max_range_m > 0.0 and earth_radius_m > 0.0 and 0.0 <= refraction < 1.0):
        raise ValueError(
            f"got a limit of {max_range_m} m, an earth of {earth_radius_m} m, a refraction of {refraction}, "
            "expected positive lengths, and a refraction from 0 to below 1"
        )
    curvature_per_m = (1.0 - refraction) / (2.0 * earth_radius_m)
    camera = finite(camera_enu_m, "camera position")
    elevation = finite(elevation_m, "elevation")
    directions = np.asarray(directions_enu, dtype=np.float64)
    shape = np.broadcast_shapes(camera.shape[:-1], directions.shape[:-1], elevation.shape)
    rays = np.empty((*shape, 7))
    rays[..., :3] = camera
    rays[..., 2] -= elevation
    with np.errstate(invalid="ignore", divide="ignore"):
        rays[..., 3:6] = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    rays[..., 6] = curvature_per_m * (rays[..., 3] ** 2 + rays[..., 4] ** 2)
    met = np.full((*shape, marching.OUT), np.nan)
    ends = np.empty(shape, dtype=np.uint8)
    marching.march(
        _in_cells(rays.reshape(-1, 7), grid),
        grid.heights_m,
        grid.peaks_m,
        grid.summit_m,
        max_range_m,
        met.reshape(-1, marching.OUT),
        ends.reshape(-1),
    )
    return _hits(rays, met, ends, elevation, grid.cell_m, curvature_per_m)


def _in_cells(rays: FloatArray, grid: ElevationGrid) -> FloatArray:
    """Positions and directions in metres ``(n, 7)`` as the kernel wants them."""
    columns = np.array([0, 1, 3, 4])
    shifted = rays - [grid.east_m, grid.north_m, 0, 0, 0, 0, 0]
    shifted[:, columns] /= grid.cell_m
    return shifted


def _hits(
    rays: FloatArray,
    met: FloatArray,
    ends: npt.NDArray[np.uint8],
    elevation: FloatArray,
    cell_m: float,
    curvature_per_m: float,
) -> GroundHits:
    range_m = met[..., marching.RANGE]
    points = rays[..., :3] + range_m[..., None] * rays[..., 3:6]
    points[..., 2] = met[..., marching.HEIGHT] + elevation
    normal = np.ones_like(points)
    normal[..., :2] = -met[..., marching.SLOPE_X : marching.SLOPE_Y + 1] / cell_m
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return GroundHits(points, range_m, normal, _CODES[ends], curvature_per_m)
