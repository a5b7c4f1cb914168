"""Features of maps: geometries in WGS84, another system or local metres, and scalars named as in the tables.

GeoJSON is written here; ``geopackage`` and ``kml`` write files with a layer for each kind of feature.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Self

import orjson
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from aerodft.dft import PROBE_KINDS
from aerodft.errors import InputError, UsageError
from aerodft.model import ProbeKind
from replay.export.table import COLUMNS, LISTS, ColumnType, Item, geometry_of, row_of

_WGS84_ID: Final = 4326
_LOCAL_ID: Final = -1
_PLANE_AXES: Final = 2

_IN_GEOMETRY: Final = frozenset({"lat_deg", "lon_deg", "alt_msl_m", "lat_2_deg", "lon_2_deg", "alt_2_msl_m", "geo_wkt"})
_WITH_UNIT: Final = ("std", "ci95_low", "ci95_high")
_NO_SCALAR: Final = frozenset({"value", "unit", *_WITH_UNIT})
_OTHER: Final = "other"

_OF_RIVERS: Final = {
    "bound": ColumnType.TEXT,
    "channels": ColumnType.INTEGER,
    "images": ColumnType.INTEGER,
    "transects": ColumnType.INTEGER,
}
"""Columns of a river's map that no table of measurements has."""

Geometry = Mapping[str, Any]
"""A GeoJSON geometry."""


class MapFeature(NamedTuple):
    """One thing on a map.

    Attributes:
        layer: Of its kind.
        geometry: In WGS84, longitude first, or in local metres; None where it has no place.
        properties: Scalars by name; all features of a layer have the same names.
    """

    layer: str
    geometry: Geometry | None
    properties: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class MapCrs:
    """Coordinate system of a map, and the projection into it.

    Attributes:
        crs: The coordinate reference system; None for local metres.
        code: Of EPSG; -1 for local metres.
        transform: From longitude and latitude; None where they, or local metres, stay what they are.
    """

    crs: CRS | None
    code: int
    transform: Callable[[float, float], tuple[float, float]] | None

    @classmethod
    def wgs84(cls) -> Self:
        """Longitude and latitude on WGS84."""
        return cls(CRS.from_epsg(_WGS84_ID), _WGS84_ID, None)

    @classmethod
    def local(cls) -> Self:
        """Metres east and north of an origin whose place nobody said."""
        return cls(None, _LOCAL_ID, None)

    @classmethod
    def from_epsg(cls, text: str) -> Self:
        """A system of EPSG by its number: ``EPSG:25832`` or ``25832``.

        Raises:
            UsageError: There is none, or none of places in the plane or on the ellipsoid.
        """
        number = text.upper().removeprefix("EPSG:")
        expected = "the number of a projected or geographic system, such as EPSG:25832"
        try:
            crs = CRS.from_epsg(int(number))
            transformer = Transformer.from_crs(_WGS84_ID, crs, always_xy=True)
        except (ProjError, ValueError) as error:
            raise UsageError("`crs`", got=text, expected=expected) from error
        if len(crs.axis_info) != _PLANE_AXES or not (crs.is_projected or crs.is_geographic):
            raise UsageError("`crs`", got=f"{text} ({crs.name})", expected=expected)
        if int(number) == _WGS84_ID:
            return cls.wgs84()
        return cls(crs, int(number), lambda lon, lat: transformer.transform(lon, lat, errcheck=True))

    @property
    def is_local(self) -> bool:
        """Whether it is local metres."""
        return self.crs is None

    def projected(self, geometry: Geometry | None) -> Geometry | None:
        """A geometry in this system.

        Raises:
            InputError: It lies where the system has no coordinates.
        """
        if geometry is None or self.transform is None:
            return geometry
        try:
            return {"type": geometry["type"], "coordinates": _moved(geometry["coordinates"], self.transform)}
        except ProjError as error:
            expected = "a system that covers the measurements' places"
            raise InputError("`crs` has no coordinates there", got=f"EPSG:{self.code}", expected=expected) from error


def _moved(coordinates: list[Any], transform: Callable[[float, float], tuple[float, float]]) -> list[Any]:
    """Coordinates of a geometry, lists of any depth, in another system."""
    if isinstance(coordinates[0], list):
        return [_moved(each, transform) for each in coordinates]
    x, y = transform(coordinates[0], coordinates[1])
    if not math.isfinite(x + y):
        raise ProjError("no coordinates")
    return [x, y, *coordinates[2:]]


def column_type(name: str, value: object) -> ColumnType:
    """Type of a column of features, by its name; else by a value."""
    return {**COLUMNS, **_OF_RIVERS}.get(name) or (ColumnType.TEXT if isinstance(value, str) else ColumnType.NUMBER)


def map_features(items: Iterable[Item], *, is_local: bool = False) -> Iterator[MapFeature]:
    """Measurements as features, a layer for each kind of probe.

    The value, its std and its interval carry kind and unit in their names (``width_m``, ``std_m``, ``ci95_low_m``,
    ``ci95_high_m``), also where there is no number.

    Args:
        items: Measurements, as ``parse_measurement`` gives them.
        is_local: Whether they are to be drawn in metres of the station's origin.

    Raises:
        InputError: An item is no measurement.
    """
    for item in items:
        properties = _properties(row_of(item))
        kind = properties["kind"]
        is_known = kind in PROBE_KINDS or kind == ProbeKind.TRACK
        yield MapFeature(str(kind) if is_known else _OTHER, geometry_of(item, is_local=is_local), properties)


def _properties(row: Mapping[str, object]) -> dict[str, object]:
    left_out = {*_IN_GEOMETRY, *LISTS}
    if row["kind"] == ProbeKind.POSITION:  # it is the geometry; its uncertainty is the ellipse
        return {name: value for name, value in row.items() if name not in left_out | _NO_SCALAR}
    kind = PROBE_KINDS.get(ProbeKind(row["kind"]))
    unit = row["unit"] if kind is None else kind.unit
    quantity = "value" if kind is None else kind.quantity or kind.name
    names = {"value": f"{quantity}_{unit}"} | {name: f"{name}_{unit}" for name in _WITH_UNIT}
    named = {names.get(name, name): value for name, value in row.items() if name not in left_out | {"unit"}}
    return named | {names["value"]: row["value"]}  # of a range the column of that name is the same distance


def geojson_text(features: Iterable[MapFeature], crs: MapCrs) -> Iterator[str]:
    """Features as GeoJSON (RFC 7946), piece by piece.

    In another system than WGS84 the collection names it as the specification of 2008 did, which GDAL and QGIS read.

    Raises:
        InputError: A feature lies where the system has no coordinates.
    """
    name = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:EPSG::{crs.code}"}}
    named = "" if crs.transform is None else f' "crs": {orjson.dumps(name).decode()},'
    before = f'{{"type": "FeatureCollection",{named} "features": ['
    for layer, geometry, properties in features:
        feature = {"type": "Feature", "geometry": crs.projected(geometry), "properties": {"layer": layer, **properties}}
        yield f"{before}\n{orjson.dumps(feature).decode()}"
        before = ","
    yield "\n]}\n" if before == "," else f"{before}]}}\n"
