"""WGS84 points to the station's ENU frame and back, by PROJ."""

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from aerodft.model import FloatArray, GeoOrigin

if TYPE_CHECKING:
    from pyproj import Transformer


@lru_cache(maxsize=32)
def _transformer(origin: GeoOrigin) -> "Transformer":
    """PROJ's transformer from WGS84 longitude, latitude and height to ENU about the origin."""
    from pyproj import Transformer  # noqa: PLC0415 - 12 MB, and what has no place on earth does without

    lat_deg, lon_deg, height_m = math.degrees(origin.lat_rad), math.degrees(origin.lon_rad), origin.alt_msl_m or 0.0
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat_deg!r} +lon_0={lon_deg!r} +h_0={float(height_m)!r}"
    )


def east_north(origin: GeoOrigin, lat_rad: npt.ArrayLike, lon_rad: npt.ArrayLike) -> FloatArray:
    """East and north (m) of WGS84 points on the measured plane, ``(..., 2)``.

    The plane's own altitude is used for all of them, so that a camera and its foot share one east and north.
    """
    lat_rad, lon_rad = np.asarray(lat_rad, dtype=np.float64), np.asarray(lon_rad, dtype=np.float64)
    height = np.full_like(lat_rad, origin.alt_msl_m or 0.0)
    east, north, _ = _transformer(origin).transform(lon_rad, lat_rad, height, radians=True)
    return np.stack([np.asarray(east), np.asarray(north)], axis=-1)


def lat_lon(origin: GeoOrigin, east_north_m: FloatArray) -> FloatArray:
    """WGS84 latitude and longitude (rad) of points of the measured plane, ``(..., 2)`` to ``(..., 2)``.

    The plane is flat in ENU; over 1 km this differs from the curved earth by 8 cm in height, not in position.
    """
    east_north_m = np.asarray(east_north_m, dtype=np.float64)
    east, north = east_north_m[..., 0], east_north_m[..., 1]
    lon, lat, _ = _transformer(origin).transform(east, north, np.zeros_like(east), radians=True, direction="INVERSE")
    return np.stack([np.asarray(lat), np.asarray(lon)], axis=-1)
