"""Elevation models from GeoTIFF files, laid out around the station; extra ``terrain``.

Columns and rows of a raster are integers at the pixels' centres.
"""

import logging
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from pyproj import CRS, Transformer

from aerodft.adapters.files import looks_like
from aerodft.errors import InputError
from aerodft.geometry import ElevationGrid, east_north, lat_lon, sample_all
from aerodft.model import FloatArray, GeoOrigin

if TYPE_CHECKING:
    from rasterio.io import DatasetReader


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

        Nodes are multiples of ``cell_m``; there may be none.
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


RADIUS_M: Final = 2000.0
"""How far around the station the ground is read, by default."""

MAX_NODES: Final = 20_000_000
"""A grid of more nodes is refused: 160 MB of heights, and some seconds to lay them out."""

_LOWEST_M, _HIGHEST_M = -500.0, 9000.0  # of the earth's dry land, with a margin
_SMALLEST = 2  # pixels and nodes on a side
_METRE, _FOOT, _SURVEY_FOOT = 1.0, 0.3048, 1200 / 3937
_UNITS: Final = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), _METRE),
    **dict.fromkeys(("ft", "foot", "feet"), _FOOT),
    **dict.fromkeys(("us-ft", "ftus", "us survey foot", "us survey feet"), _SURVEY_FOOT),
}
_COLOURS: Final = frozenset({"red", "green", "blue", "alpha", "palette", "cyan", "magenta", "yellow", "black"})
_NO_CRS = "no usable coordinate reference system"
_GEOTIFF: Final = "a GeoTIFF elevation model"


def load_elevation(
    path: Path,
    origin: GeoOrigin,
    *,
    radius_m: float = RADIUS_M,
    cell_m: float | None = None,
    band: int = 1,
    fill_msl_m: float | None = None,
) -> ElevationGrid:
    """Read the ground around the station, on square cells in the station's ENU.

    Between the centres of the file's pixels heights are interpolated bilinearly; where the cells are larger than the
    pixels, these are averaged first. The file's heights count as above mean sea level, the grid's are above the
    origin's altitude, or where that is not known above the ground there.

    Args:
        path: A raster of heights, in any geographic or projected coordinate reference system.
        origin: The station, which the file must cover.
        radius_m: Half the side of the square that is read. Beyond the file there is no ground.
        cell_m: Distance of the nodes; None for that of the file's pixels at the origin.
        band: The raster's band of heights, from 1.
        fill_msl_m: Height of what has no data in the file, a water surface for instance; None to leave holes.

    Raises:
        InputError: The extra is not installed; the file cannot be read, does not cover the origin, or has no
            coordinate reference system, no such band, no heights or impossible ones; or the grid would be too large.
        ValueError: A length makes no sense.
    """
    if not (0.0 < radius_m < math.inf and (cell_m is None or 0.0 < cell_m <= radius_m)):
        raise ValueError(f"got a radius of {radius_m} m and cells of {cell_m} m, expected both above 0, cells smaller")
    with _opened(path) as dataset:
        crs = _crs(dataset, path, relative=origin.alt_msl_m is None)
        layout = _layout(dataset, path, crs, origin)
        window, pixel_m = layout.window((dataset.width, dataset.height), radius_m), layout.pixel_m()
        cell_m = cell_m or pixel_m
        east_m, north_m = _nodes(layout, window, radius_m, cell_m, path)
        unit_m = _unit_m(dataset, path, band, crs)
        heights_m = _possible(_values(dataset, band, window, max(1, int(cell_m / pixel_m))) * unit_m, path)
    if fill_msl_m is not None:
        heights_m = np.where(np.isnan(heights_m), fill_msl_m, heights_m)
    part = RasterPart(layout, window, heights_m)
    on_nodes = part.on_nodes(east_m, north_m)
    if np.all(np.isnan(on_nodes)):
        raise InputError("no heights around the station", where=path, got="nodata only", expected=_GEOTIFF)
    zero_m = _ground_at_origin(part, path) if origin.alt_msl_m is None else origin.alt_msl_m
    return ElevationGrid(east_m=float(east_m[0]), north_m=float(north_m[0]), cell_m=cell_m, heights_m=on_nodes - zero_m)


@contextmanager
def _opened(path: Path) -> Iterator["DatasetReader"]:
    try:
        import rasterio  # noqa: PLC0415 - an extra, which only stations on uneven ground need
        from rasterio.errors import NotGeoreferencedWarning, RasterioError  # noqa: PLC0415 - as above
    except ImportError as error:
        hint = "install the extra: pip install 'aerodft[terrain]'"
        raise InputError("elevation models need rasterio", where=path, got="no rasterio", hint=hint) from error
    if not path.is_file():
        got = looks_like(path)
        raise InputError("no elevation model", where=path, got=got, expected=_GEOTIFF, hint="check the path")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)  # a sentence of its own says so
            logging.getLogger(rasterio.__name__).setLevel(logging.CRITICAL)  # what is wrong is raised too
            # One format, and nothing beside the file: others, and sidecar files, name addresses that GDAL would fetch.
            limits = rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR", GDAL_PAM_ENABLED="NO")
            with limits, rasterio.open(path.absolute(), driver="GTiff") as dataset:
                if other := "".join(dataset.tags(ns="OVERVIEWS").values()):  # read with the first coarser look
                    hint = "take its metadata out, for instance with gdal_translate -nomd"
                    raise InputError("names another file", where=path, got=other, expected=_GEOTIFF, hint=hint)
                yield dataset
    except RasterioError as error:
        got = looks_like(path)
        hint = "it may be damaged or cut short"
        raise InputError("not a readable elevation model", where=path, got=got, expected=_GEOTIFF, hint=hint) from error


def _crs(dataset: "DatasetReader", path: Path, *, relative: bool) -> CRS:
    expected = "a geographic or projected one"
    if dataset.crs is None or dataset.transform.is_identity:
        got = "none" if dataset.crs is None else "no place for its pixels"
        hint = "say what it is, for instance with gdal_edit.py -a_srs EPSG:..." if dataset.crs is None else ""
        raise InputError(_NO_CRS, where=path, got=got, expected=expected, hint=hint)
    crs = CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
    if not (crs.is_geographic or crs.is_projected) or dataset.transform.is_degenerate:
        raise InputError(_NO_CRS, where=path, got=f"{crs.name} ({crs.type_name})", expected=expected)
    if not relative and not crs.is_compound and len(crs.axis_info) == 3:  # noqa: PLR2004 - axes in space
        hint = "convert it, or take heights above the ground at the station"
        raise InputError(
            "heights of another kind", where=path, got=crs.name, expected="above mean sea level", hint=hint
        )
    return crs


def _layout(dataset: "DatasetReader", path: Path, crs: CRS, origin: GeoOrigin) -> RasterLayout:
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()
    from_lon_lat = Transformer.from_crs("EPSG:4326", horizontal, always_xy=True)
    layout = RasterLayout(origin, from_lon_lat, tuple(dataset.transform)[:6])
    size = np.array([dataset.width, dataset.height])
    if size.min() < _SMALLEST:
        raise InputError("too small", where=path, got=f"{size[0]} x {size[1]} pixels", expected="2 x 2 or more")
    at = layout.places(np.zeros(2))
    if not np.all((at >= 0) & (at <= size - 1)):
        corners = layout.lon_lat_deg(np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * (size - 1))
        (west, south), (east, north) = corners.min(axis=0), corners.max(axis=0)
        lat, lon = math.degrees(origin.lat_rad), math.degrees(origin.lon_rad)
        raise InputError(
            "does not cover the station",
            where=path,
            got=f"latitudes {south:.5f} to {north:.5f} and longitudes {west:.5f} to {east:.5f}",
            expected=f"{lat:.5f}, {lon:.5f} inside",
        )
    return layout


def _nodes(
    layout: RasterLayout, window: Window, radius_m: float, cell_m: float, path: Path
) -> tuple[FloatArray, FloatArray]:
    east, north = layout.nodes_m(window, radius_m, cell_m)
    got = f"{len(east)} x {len(north)} nodes {cell_m:.4g} m apart"
    if min(len(east), len(north)) < _SMALLEST:
        raise InputError("too little ground", where=path, got=got, expected="2 x 2 or more", hint="use smaller cells")
    if len(east) * len(north) > MAX_NODES:
        hint = "take a smaller radius or larger cells"
        raise InputError("too much ground", where=path, got=got, expected=f"{MAX_NODES} at most", hint=hint)
    return east, north


def _unit_m(dataset: "DatasetReader", path: Path, band: int, crs: CRS) -> float:
    """Metres in the unit of the heights, as the band or else the vertical coordinate system has it."""
    if not 1 <= band <= dataset.count:
        raise InputError("no such band", where=path, got=band, expected=f"1 to {dataset.count}")
    colour = dataset.colorinterp[band - 1].name
    if colour in _COLOURS or "complex" in dataset.dtypes[band - 1]:
        got = f"band {band} of {dataset.count}: {colour}, {dataset.dtypes[band - 1]}"
        raise InputError("a band that holds no heights", where=path, got=got, expected=_GEOTIFF)
    unit = (dataset.units[band - 1] or "").strip().lower()
    if not unit:
        return float(crs.axis_info[-1].unit_conversion_factor) if crs.is_compound else _METRE
    if unit not in _UNITS:
        raise InputError("heights in an unknown unit", where=path, got=repr(unit), expected="metres or feet")
    return _UNITS[unit]


def _values(dataset: "DatasetReader", band: int, window: Window, step: int) -> FloatArray:
    """The window's heights, ``step`` by ``step`` pixels averaged into one; NaN where there is no data."""
    from rasterio.enums import Resampling  # noqa: PLC0415 - as in _opened

    size = window.bottom - window.top, window.right - window.left
    values = dataset.read(
        band,
        window=((window.top, window.bottom), (window.left, window.right)),
        out_shape=tuple(max(_SMALLEST, math.ceil(each / step)) for each in size),
        resampling=Resampling.average if step > 1 else Resampling.nearest,
        masked=True,
    )
    heights = np.ma.filled(values.astype(np.float64), np.nan) * dataset.scales[band - 1] + dataset.offsets[band - 1]
    return np.where(np.isinf(heights), np.nan, heights)


def _possible(heights_m: FloatArray, path: Path) -> FloatArray:
    wrong = heights_m[(heights_m < _LOWEST_M) | (heights_m > _HIGHEST_M)]
    if wrong.size:
        expected = f"{_LOWEST_M:.0f} to {_HIGHEST_M:.0f} m"
        hint = "if it stands for no data, say so in the file, for instance with gdal_edit.py -a_nodata"
        raise InputError("an impossible height", where=path, got=f"{wrong[0]:g} m", expected=expected, hint=hint)
    return heights_m


def _ground_at_origin(part: RasterPart, path: Path) -> float:
    zero_m = float(part.at(np.zeros((1, 2)))[0])
    if math.isnan(zero_m):
        hint = "give the station's altitude, or a height for what has no data"
        raise InputError("no height at the station", where=path, got="nodata", expected="the ground's", hint=hint)
    return zero_m
