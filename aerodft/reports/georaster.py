"""Top views as files that maps take: PNG with a world file, and GeoTIFF where the extra ``terrain`` is installed.

A view is laid out in the station's east and north; in a map projection it lies a little turned and scaled, which the
world file's six numbers say.
"""

import math
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import orjson
from pyproj import CRS, Transformer

from aerodft.dft.maps import TopView
from aerodft.errors import InputError
from aerodft.geometry import lat_lon
from aerodft.model import FloatArray, GeoOrigin

_SOUTHERNMOST_DEG, _NORTHERNMOST_DEG = -80.0, 84.0  # of UTM; the polar caps have a projection of their own
_UPS_SOUTH, _UPS_NORTH = 32761, 32661
_UTM_SOUTH, _UTM_NORTH = 32700, 32600
_FIT_POINTS: Final = 5  # on each side of the view


@dataclass(frozen=True, slots=True)
class Georeference:
    """Where a view lies.

    Attributes:
        crs: Its coordinate reference system; None for the station's own east and north in metres.
        affine: ``(2, 3)``: from column and row (integers at the pixels' *corners*) to x and y of it.
        misfit_m: The largest distance of a pixel from where the affine map has it.
    """

    crs: CRS | None
    affine: FloatArray
    misfit_m: float


def map_projection(origin: GeoOrigin) -> CRS:
    """The UTM zone of a place by its longitude (on WGS84); near the poles UPS."""
    lat_deg, lon_deg = math.degrees(origin.lat_rad), math.degrees(origin.lon_rad)
    if lat_deg > _NORTHERNMOST_DEG:
        return CRS.from_epsg(_UPS_NORTH)
    if lat_deg < _SOUTHERNMOST_DEG:
        return CRS.from_epsg(_UPS_SOUTH)
    zone = int((lon_deg + 180.0) // 6.0) % 60 + 1
    return CRS.from_epsg((_UTM_SOUTH if lat_deg < 0 else _UTM_NORTH) + zone)


def georeference(view: TopView, origin: GeoOrigin | None) -> Georeference:
    """Where a view lies on the map; without an origin in the station's own east and north."""
    local = np.array([[view.step_m, 0.0, view.west_m], [0.0, -view.step_m, view.north_m]])
    if origin is None:
        return Georeference(None, local, 0.0)
    crs = map_projection(origin)
    height, width = view.pixels.shape[:2]
    column, row = np.meshgrid(np.linspace(0, width, _FIT_POINTS), np.linspace(0, height, _FIT_POINTS))
    places = np.stack([column.ravel(), row.ravel(), np.ones(column.size)], axis=-1)
    lat, lon = np.degrees(lat_lon(origin, places @ local.T)).T
    xy = np.stack(Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(lon, lat), axis=-1)
    centre = xy.mean(axis=0)  # millions of metres beside centimetres
    affine = np.linalg.lstsq(places, xy - centre, rcond=None)[0].T
    misfit = np.linalg.norm(places @ affine.T - (xy - centre), axis=-1)
    affine[:, 2] += centre
    return Georeference(crs, affine, float(misfit.max()))


def write_top_view(view: TopView, origin: GeoOrigin | None, folder: Path, name: str = "topview") -> dict[str, Any]:
    """Write ``name.png`` with ``name.pgw`` and ``name.json``; with an origin also ``.prj`` and, if it can be, ``.tif``.

    Args:
        view: The view.
        origin: The station's ENU origin; None where its place is not known.
        folder: An existing folder.
        name: Of the files, without suffix.

    Returns:
        What ``name.json`` says, with ``files``: their names.

    Raises:
        InputError: They cannot be written.
    """
    place = georeference(view, origin)
    files = {f"{name}.png": _png(view, folder), f"{name}.pgw": _world_file(place.affine)}
    if place.crs is not None:
        files[f"{name}.prj"] = place.crs.to_wkt("WKT1_ESRI").encode()
    has_tif = place.crs is not None and find_spec("rasterio") is not None
    about: dict[str, Any] = {
        "crs": "local" if place.crs is None else place.crs.to_string(),
        "axes": "east and north of the station, m" if place.crs is None else "easting and northing, m",
        "step_m": view.step_m,
        "width_px": view.pixels.shape[1],
        "height_px": view.pixels.shape[0],
        "west_enu_m": view.west_m,
        "north_enu_m": view.north_m,
        "affine": place.affine.tolist(),
        "misfit_m": place.misfit_m,
        "files": [*files, f"{name}.json", *([f"{name}.tif"] if has_tif else [])],
    }
    files[f"{name}.json"] = orjson.dumps(about, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)
    try:
        for file, data in files.items():
            (folder / file).write_bytes(data)
    except OSError as error:
        raise InputError("the top view cannot be written", where=folder, got=error.strerror or error) from error
    if has_tif:
        _write_geotiff(view, place, folder / f"{name}.tif")
    return about


def _png(view: TopView, folder: Path) -> bytes:
    done, data = cv2.imencode(".png", view.pixels)
    if not done:
        height, width = view.pixels.shape[:2]
        raise InputError("the top view cannot be encoded", where=folder, got=f"{width} x {height} pixels")
    return data.tobytes()


def _world_file(affine: FloatArray) -> bytes:
    """Six lines, of which the last two are the *middle* of the top-left pixel."""
    (a, b, _), (d, e, _) = affine.tolist()
    c, f = (affine @ [0.5, 0.5, 1.0]).tolist()
    return "".join(f"{number:.10f}\n" for number in (a, d, b, e, c, f)).encode()


def _write_geotiff(view: TopView, place: Georeference, path: Path) -> None:
    import rasterio  # noqa: PLC0415 - an extra, and slow to load
    from rasterio.errors import RasterioError  # noqa: PLC0415

    if place.crs is None:
        raise ValueError("a GeoTIFF needs a coordinate reference system")
    height, width = view.pixels.shape[:2]
    profile = {"driver": "GTiff", "height": height, "width": width, "count": 4, "dtype": "uint8"}
    packing = {"compress": "deflate", "tiled": True, "photometric": "RGB", "alpha": "YES"}
    transform = rasterio.Affine(*place.affine.ravel().tolist())
    try:
        with rasterio.open(path, "w", **profile, **packing, crs=place.crs.to_wkt(), transform=transform) as dataset:
            dataset.write(np.moveaxis(view.pixels[..., [2, 1, 0, 3]], -1, 0))
    except (RasterioError, OSError) as error:
        path.unlink(missing_ok=True)
        raise InputError("the GeoTIFF cannot be written", where=path, got=error) from error
