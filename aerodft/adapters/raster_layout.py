"""Where the pixels of a georeferenced raster lie in the station's ENU, and what a raster has at a point of it.

Columns and rows are integers at the pixels' centres.
"""

from dataclasses import dataclass

import numpy as np
from pyproj import Transformer

from aerodft.geometry.geodesy import east_north, lat_lon
from aerodft.geometry.marching import sample_all
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import GeoOrigin

_AT_ONCE = 1_000_000  # nodes that are laid out together
_EDGE_POINTS = 65  # on each side of a rectangle whose outline is followed from one projection to another
_MARGIN = 2  # pixels around what is wanted, for the interpolation


@dataclass(frozen=True, slots=True)
class Window:
    """Columns and rows of a raster, half-open."""

    left: int
    top: int
    right: int
    bottom: int


@dataclass(frozen=True, slots=True)
class RasterLayout:
    """The map between a raster's pixels and the station's ENU.

    Attributes:
        origin: The station.
        crs_from_lon_lat: From WGS84 degrees to the raster's coordinate reference system, x before y.
        crs_from_pixels: GDAL's affine map ``a, b, c, d, e, f`` to it, in which a pixel's *corner* is an integer.
    """

    origin: GeoOrigin
    crs_from_lon_lat: Transformer
    crs_from_pixels: tuple[float, ...]

    def places(self, east_north_m: FloatArray) -> FloatArray:
        """Column and row ``(..., 2)`` of ``(..., 2)``; not finite where the raster's projection does not reach."""
        lat, lon = np.moveaxis(np.degrees(lat_lon(self.origin, east_north_m)), -1, 0)
        matrix, corner = self._affine()
        xy = np.stack(self.crs_from_lon_lat.transform(lon, lat), axis=-1)
        with np.errstate(invalid="ignore"):
            return np.asarray((xy - corner) @ np.linalg.inv(matrix).T - 0.5)

    def lon_lat_deg(self, places: FloatArray) -> FloatArray:
        """Longitude and latitude ``(..., 2)`` of columns and rows ``(..., 2)``."""
        matrix, corner = self._affine()
        xy = (np.asarray(places) + 0.5) @ matrix.T + corner
        return np.stack(self.crs_from_lon_lat.transform(xy[..., 0], xy[..., 1], direction="INVERSE"), axis=-1)

    def enu_m(self, places: FloatArray) -> FloatArray:
        """East and north ``(..., 2)`` of columns and rows ``(..., 2)``."""
        lon_lat = np.radians(self.lon_lat_deg(places))
        return east_north(self.origin, lon_lat[..., 1], lon_lat[..., 0])

    def pixel_m(self) -> float:
        """The shorter side of the pixel at the origin, on the ground."""
        corner, right, below = self.enu_m(self.places(np.zeros(2)) + np.array([[0, 0], [1, 0], [0, 1]]))
        return float(min(np.linalg.norm(right - corner), np.linalg.norm(below - corner)))

    def window(self, size_px: tuple[int, int], radius_m: float) -> Window:
        """The part of a raster that covers the square of ``radius_m`` around the origin, which must be inside.

        Args:
            size_px: The raster's columns and rows, two or more of each; so are the window's.
            radius_m: Half the square's side.
        """
        outline = np.vstack([np.zeros(2), _outline(np.full(2, -radius_m), np.full(2, radius_m))])
        places = self.places(outline)
        places = places[np.all(np.isfinite(places), axis=-1)]
        size = np.array(size_px)
        low = np.clip(np.floor(places.min(axis=0)) - _MARGIN, 0, size - 2)
        high = np.clip(np.ceil(places.max(axis=0)) + _MARGIN, low + 2, size)
        return Window(*low.astype(int).tolist(), *high.astype(int).tolist())

    def nodes_m(self, window: Window, radius_m: float, cell_m: float) -> tuple[FloatArray, FloatArray]:
        """East and north of the nodes that lie in the square and among the window's pixel centres, each ascending.

        They are multiples of ``cell_m``; there may be none.
        """
        first, last = np.array([window.left, window.top]), np.array([window.right - 1, window.bottom - 1])
        outline = self.enu_m(_outline(first, last))
        low = np.ceil(np.maximum(outline.min(axis=0), -radius_m) / cell_m)
        high = np.floor(np.minimum(outline.max(axis=0), radius_m) / cell_m)
        east, north = (np.arange(start, stop + 1) * cell_m for start, stop in zip(low, high, strict=True))
        return east, north

    def _affine(self) -> tuple[FloatArray, FloatArray]:
        a, b, c, d, e, f = self.crs_from_pixels
        return np.array([[a, b], [d, e]]), np.array([c, f])


def _outline(low: FloatArray, high: FloatArray) -> FloatArray:
    """Points along the sides of an axis-parallel rectangle, ``(n, 2)``."""
    along = np.linspace(0.0, 1.0, _EDGE_POINTS)
    sides = [np.stack([along, np.full_like(along, side)], axis=-1) for side in (0.0, 1.0)]
    unit = np.vstack([*sides, *(side[:, ::-1] for side in sides)])
    return np.asarray(low + unit * (high - low))


@dataclass(frozen=True, slots=True)
class RasterPart:
    """Values ``(rows, columns)`` of a window, perhaps averaged into fewer than it has pixels; NaN for none."""

    layout: RasterLayout
    window: Window
    values: FloatArray

    def at(self, east_north_m: FloatArray) -> FloatArray:
        """Values ``(n,)`` at ``(n, 2)``, interpolated bilinearly; NaN outside and in holes."""
        (rows, columns), window = self.values.shape, self.window
        step = np.array([(window.right - window.left) / columns, (window.bottom - window.top) / rows])
        places = (self.layout.places(east_north_m) - [window.left, window.top] + 0.5) / step - 0.5
        out = np.empty(len(places))
        sample_all(self.values, np.ascontiguousarray(places), out)
        return out

    def on_nodes(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Values ``(len(north_m), len(east_m))``."""
        out = np.empty((len(north_m), len(east_m)))
        rows = max(1, _AT_ONCE // len(east_m))
        for start in range(0, len(north_m), rows):
            nodes = np.stack(np.meshgrid(east_m, north_m[start : start + rows]), axis=-1)
            out[start : start + rows] = self.at(nodes.reshape(-1, 2)).reshape(nodes.shape[:2])
        return out
