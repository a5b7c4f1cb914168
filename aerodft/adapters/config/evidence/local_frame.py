"""The frame that evidence is computed in: metres east, north and up around a place, from and to a file's coordinates.

Grid coordinates are no metres on the ground: a projection stretches (UTM by 4 in 10,000, web Mercator by six tenths at
52 degrees), and its lengths are those at sea level. So they are taken to the ellipsoid of their own datum and from
there to the level plane of the place, by PROJ; no datum is changed on that way, which would cost decimetres.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from aerodft.adapters.config.tables import GEO, LOCAL
from aerodft.errors import ConfigError
from aerodft.model import FloatArray, GeoOrigin

_WGS84 = "EPSG:4326"
_STEP_M = 10.0
_HINT = '"local" is metres from a zero of your own, "geo" WGS84, "EPSG:28992" a map\'s projection'


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """Metres east, north and up, which the evidence and what is found from it are in.

    North, and so every heading, is that of the file: true north at the origin for latitudes and longitudes, *grid*
    north at the origin for projected coordinates (``true_heading_rad`` adds the meridian's convergence), and what the
    file calls its second axis for local ones.

    Attributes:
        crs: As in the file: ``local``, ``geo``, ``EPSG:...`` or a PROJ string.
        origin: The frame's zero in the file's coordinates: easting, northing and height in metres, or latitude and
            longitude in degrees and height in metres.
    """

    crs: str
    origin: tuple[float, float, float]

    def local_m(self, coordinates: npt.ArrayLike) -> FloatArray:
        """East, north, up ``(..., 3)`` of points in the file's coordinates ``(..., 3)``; not finite off the map."""
        stated = np.asarray(coordinates, dtype=np.float64)
        if self.crs == LOCAL:
            return np.asarray(stated - self.origin)
        return _map_of(self.crs, self.origin).to_local(stated)

    def file_coordinates(self, points_m: npt.ArrayLike) -> FloatArray:
        """The file's coordinates ``(..., 3)`` of east, north, up ``(..., 3)``, in the order of ``origin``."""
        points_m = np.asarray(points_m, dtype=np.float64)
        if self.crs == LOCAL:
            return np.asarray(points_m + self.origin)
        return _map_of(self.crs, self.origin).from_local(points_m)

    def wgs84(self, points_m: npt.ArrayLike) -> FloatArray | None:
        """Latitude and longitude (rad) and the file's height (m), ``(..., 3)``, of east, north, up ``(..., 3)``.

        Between datums PROJ's best transformation is taken, which may be off by a metre where a grid of corrections is
        not installed. None for local coordinates, which nobody has placed on the map.
        """
        if self.crs == LOCAL:
            return None
        found = self.file_coordinates(points_m)
        if takes_degrees(self.crs):
            lon, lat = found[..., 1], found[..., 0]
        else:
            lon, lat = found[..., 0], found[..., 1]
        lon, lat = _to_wgs84(self.crs).transform(lon, lat)
        return np.stack([np.radians(lat), np.radians(lon), found[..., 2]], axis=-1)

    @property
    def geo_origin(self) -> GeoOrigin | None:
        """The frame's zero in WGS84; None for local coordinates."""
        found = self.wgs84(np.zeros(3))
        if found is None:
            return None
        lat_rad, lon_rad, alt_msl_m = (float(each) for each in found)
        return GeoOrigin(lat_rad=lat_rad, lon_rad=lon_rad, alt_msl_m=alt_msl_m)

    def true_heading_rad(self, heading_rad: float) -> float | None:
        """A heading from true north, in 0 to 2 pi; None for local coordinates."""
        if self.crs == LOCAL:
            return None
        return (heading_rad + _map_of(self.crs, self.origin).convergence_rad) % (2 * math.pi)


@dataclass(frozen=True, slots=True)
class _Map:
    """From a file's coordinates to the level plane at the origin.

    Attributes:
        flat: From the file's x and y to longitude and latitude on its own datum; None where they are these already.
        unit_rad: Of those longitudes and latitudes.
        upright: From longitude, latitude (rad) and height to true east, north, up.
        convergence_rad: Of the frame's north, clockwise from true north.
    """

    flat: Transformer | None
    unit_rad: float
    upright: Transformer
    convergence_rad: float

    def to_local(self, stated: FloatArray) -> FloatArray:
        x, y, height = np.moveaxis(stated, -1, 0)
        lon, lat = (y, x) if self.flat is None else self.flat.transform(x, y)
        found = self.upright.transform(lon * self.unit_rad, lat * self.unit_rad, height, radians=True)
        return np.stack(found, axis=-1) @ _turn(self.convergence_rad).T

    def from_local(self, points_m: FloatArray) -> FloatArray:
        east, north, up = np.moveaxis(points_m @ _turn(self.convergence_rad), -1, 0)
        lon, lat, height = self.upright.transform(east, north, up, radians=True, direction="INVERSE")
        lon, lat = np.asarray(lon) / self.unit_rad, np.asarray(lat) / self.unit_rad
        if self.flat is None:
            return np.stack([lat, lon, height], axis=-1)
        return np.stack([*self.flat.transform(lon, lat, direction="INVERSE"), height], axis=-1)


def _turn(convergence_rad: float) -> FloatArray:
    """True east, north, up to axes whose north is ``convergence_rad`` clockwise of it."""
    cos, sin = math.cos(convergence_rad), math.sin(convergence_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@lru_cache(maxsize=32)
def _map_of(crs: str, origin: tuple[float, float, float]) -> _Map:
    horizontal = _horizontal(crs)
    datum = horizontal.geodetic_crs
    assert datum is not None and datum.ellipsoid is not None  # noqa: S101, PT018 - geographic and projected ones have
    flat = None if horizontal.is_geographic else Transformer.from_crs(horizontal, datum.to_2d(), always_xy=True)
    unit_rad = datum.axis_info[0].unit_conversion_factor
    x, y, height = origin
    lon, lat = (y, x) if flat is None else flat.transform(x, y)
    shape = f"+a={datum.ellipsoid.semi_major_metre!r} +b={datum.ellipsoid.semi_minor_metre!r}"
    place = " ".join(
        f"+{key}={value!r}"
        for key, value in (
            ("lat_0", math.degrees(lat * unit_rad)),
            ("lon_0", math.degrees(lon * unit_rad)),
            ("h_0", height),
        )
    )
    upright = Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=cart {shape} +step +proj=topocentric {shape} {place}"
    )
    true = _Map(flat, unit_rad, upright, 0.0)
    if flat is None:
        return true
    south, north = true.to_local(np.array(origin) + [[0.0, -_STEP_M, 0.0], [0.0, _STEP_M, 0.0]])
    east_m, north_m, _ = north - south
    return _Map(flat, unit_rad, upright, math.atan2(east_m, north_m))


@lru_cache(maxsize=32)
def _horizontal(crs: str) -> CRS:
    found = CRS.from_user_input(_WGS84 if crs == GEO else crs)
    return found.sub_crs_list[0] if found.is_compound else found.to_2d()


@lru_cache(maxsize=32)
def _to_wgs84(crs: str) -> Transformer:
    return Transformer.from_crs(_horizontal(crs), _WGS84, always_xy=True)


def takes_degrees(crs: str) -> bool:
    """Whether places are latitudes and longitudes in a coordinate reference system that is sound."""
    return crs == GEO or (crs != LOCAL and bool(_horizontal(crs).is_geographic))


def checked_crs(crs: str) -> str:
    """``crs`` as a :class:`LocalFrame` has it.

    Args:
        crs: ``local``, ``geo``, an EPSG code or a PROJ string.

    Raises:
        ConfigError: No such code, or one of another kind than metres east and north, or degrees.
    """
    stated, found = f'"{crs}"', crs.strip()
    if found.lower() in (LOCAL, GEO):
        return found.lower()
    authority, _, code = found.partition(":")
    is_epsg = authority.upper() == "EPSG" and code.isascii() and code.isdigit()
    if not is_epsg and not found.startswith("+proj="):
        raise ConfigError("crs", got=stated, expected='"local", "geo" or an EPSG code', hint=_HINT)
    name = f"EPSG:{code}" if is_epsg else found
    try:
        horizontal = _horizontal(name)
        _to_wgs84(name)  # which UTM's grid system of all zones, EPSG:32600, has not
    except ProjError:
        why = "which is not in the EPSG register" if is_epsg else "which PROJ does not take"
        raise ConfigError("crs", got=f"{stated}, {why}", hint=_HINT) from None
    if not horizontal.is_geographic:
        _check_metric(horizontal, stated)
    return name


def _check_metric(horizontal: CRS, stated: str) -> None:
    got = f"{stated} ({horizontal.name})"
    if not horizontal.is_projected:
        expected = "a projected or geographic coordinate reference system"
        raise ConfigError("crs", got=f"{got}, {horizontal.type_name}", expected=expected, hint=_HINT)
    unit = next((axis.unit_name for axis in horizontal.axis_info if axis.unit_conversion_factor != 1.0), None)
    if unit is not None:
        hint = "convert the coordinates to the same projection in metres"
        raise ConfigError("crs", got=f"{got}, which counts in {unit}", expected="metres", hint=hint)
    if {axis.direction.lower() for axis in horizontal.axis_info} != {"east", "north"}:
        expected = "axes to the east and to the north"
        raise ConfigError("crs", got=got, expected=expected, hint="use another projection")


def check_on_map(crs: str, coordinates: tuple[float, float], label: str, own_metres: str) -> None:
    """Refuse projected coordinates that are far from where their projection is used.

    Args:
        crs: A sound coordinate reference system.
        coordinates: Easting and northing, metres.
        label: Which key has them.
        own_metres: What to do where all coordinates of the file look like somebody's own; empty where they do not.

    Raises:
        ConfigError: The coordinates are elsewhere on the earth, or nowhere.
    """
    if crs == LOCAL or takes_degrees(crs) or is_used_at(crs, coordinates):
        return
    x, y = coordinates
    is_swapped = is_used_at(crs, (y, x))
    horizontal = _horizontal(crs)
    margin_deg = _ZONE_MARGIN_DEG if "zone" in horizontal.name.lower() else _MARGIN_DEG
    if is_used_at(crs, coordinates, margin_deg) and not is_swapped and not own_metres:
        return
    area = horizontal.area_of_use
    expected = f"a place where {crs} ({horizontal.name}) is used"
    if area is not None:
        expected += f", latitudes {area.south:g} to {area.north:g} and longitudes {area.west:g} to {area.east:g}"
    hint = "check crs, and that no digits are missing"
    if is_swapped:
        hint = "swap them: easting comes first, or check crs"
    elif own_metres:
        hint = own_metres
    elif max(abs(x), abs(y)) <= _TURN_DEG:
        hint = 'they look like degrees: write lat_deg, lon_deg and alt_m, with crs = "geo"'
    got = f"easting {x:.10g} and northing {y:.10g}"
    raise ConfigError(label, got=got, expected=expected, hint=hint)


_ZONE_MARGIN_DEG = 3.0  # people stay in their zone a little beyond its edge
_MARGIN_DEG = 0.5
_TURN_DEG = 360.0


def is_used_at(crs: str, coordinates: tuple[float, float], margin_deg: float = 0.0) -> bool:
    """Whether a projection is used at an easting and northing, and up to so many degrees beyond."""
    lon, lat = _to_wgs84(crs).transform(*coordinates)
    if not (math.isfinite(lon) and math.isfinite(lat)):
        return False
    area = _horizontal(crs).area_of_use
    if area is None:
        return True
    width = (area.east - area.west) % 360 or 360.0
    from_west = (lon - area.west + margin_deg) % 360
    is_between = area.south - margin_deg <= lat <= area.north + margin_deg
    return bool(is_between and from_west <= width + 2 * margin_deg)
