"""Maps of what was measured: GeoPackage with a QGIS style inside, KML, GeoJSON; in WGS84, another CRS, or local metres.

A feature's properties are scalars with the names and units of the tables. In a GeoPackage or a KML file each kind of
thing has a layer of its own. What has no place on Earth lies in a plane of its own (srs_id -1 of OGC GeoPackage 1.3).
"""

import errno
import math
import sqlite3
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final, NamedTuple, Self
from xml.sax.saxutils import escape, quoteattr

import orjson
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from aerodft.dft import PROBE_KINDS
from aerodft.errors import InputError, UsageError
from aerodft.model import ProbeKind, Status
from replay.export.table import COLUMNS, LISTS, ColumnType, geometry_of, parse_measurement, row_of, written_unit
from replay.export.video import COLOURS

_WGS84_ID: Final = 4326
_LOCAL_ID: Final = -1
_PLANE_AXES: Final = 2

_IN_GEOMETRY: Final = frozenset({"lat_deg", "lon_deg", "alt_msl_m", "lat_2_deg", "lon_2_deg", "alt_2_msl_m", "geo_wkt"})
_WITH_UNIT: Final = ("std", "ci95_low", "ci95_high")
_NO_SCALAR: Final = frozenset({"value", "unit", *_WITH_UNIT})
_OTHER: Final = "other"

_SQL_TYPES: Final = {
    ColumnType.TEXT: "TEXT",
    ColumnType.INTEGER: "INTEGER",
    ColumnType.NUMBER: "REAL",
    ColumnType.TIME: "DATETIME",
}
_TYPES: Final = {name: _SQL_TYPES[kind] for name, kind in COLUMNS.items() if kind in _SQL_TYPES} | {
    "bound": "TEXT", "channels": "INTEGER", "images": "INTEGER", "transects": "INTEGER",
}  # fmt: skip
_KML_TYPES: Final = {"TEXT": "string", "INTEGER": "int", "REAL": "double", "DATETIME": "string"}
_WKB_CODES: Final = {"Point": 1, "LineString": 2, "Polygon": 3, "MultiLineString": 5}
_WKB_Z: Final = 1000

Geometry = Mapping[str, Any]
"""A GeoJSON geometry."""

Box = tuple[float, float, float, float]
"""Least x and y, largest x and y."""


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


def map_features(payloads: Iterable[bytes], *, is_local: bool = False) -> Iterator[MapFeature]:
    """Measurements as features, a layer for each kind of probe.

    The value, its std and its interval carry kind and unit in their names (``width_m``, ``std_m``, ``ci95_low_m``,
    ``ci95_high_m``), also where there is no number.

    Args:
        payloads: ``aerodft.measurement/1`` payloads.
        is_local: Whether they are to be drawn in metres of the station's origin.

    Raises:
        InputError: A payload is no measurement.
    """
    for payload in payloads:
        item = parse_measurement(payload)
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
    quantity = {ProbeKind.RIVER: "width"}.get(ProbeKind(row["kind"]), row["kind"] if kind is not None else "value")
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


def write_geopackage(path: Path, features: Iterable[MapFeature], crs: MapCrs) -> dict[str, int]:
    """Write features as an OGC GeoPackage: a layer for each kind, each with a default style that QGIS takes up.

    Returns:
        How many features are in each layer.

    Raises:
        InputError: A feature lies where the system has no coordinates.
        OSError: The file cannot be written.
    """
    try:
        with closing(sqlite3.connect(path, isolation_level=None)) as connection:
            connection.executescript(_GEOPACKAGE)
            connection.execute("BEGIN")
            layers: dict[str, _Layer] = {}
            for each in {_WGS84_ID, crs.code} - {_LOCAL_ID}:  # WGS84 is in every GeoPackage
                system = CRS.from_epsg(each)
                row = (system.name, each, "EPSG", each, system.to_wkt("WKT1_GDAL"), None)
                connection.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", row)
            for feature in features:
                if feature.layer not in layers:
                    layers[feature.layer] = _Layer(connection, feature, crs.code)
                layers[feature.layer].add(feature.properties, crs.projected(feature.geometry))
            for number, layer in enumerate(layers.values()):
                layer.finish(number)
            connection.execute("COMMIT")
    except sqlite3.Error as error:
        raise OSError(errno.EIO, str(error)) from error
    return {name: layer.count for name, layer in layers.items()}


_GEOPACKAGE: Final = """
PRAGMA journal_mode = OFF;
PRAGMA synchronous = OFF;
PRAGMA application_id = 0x47504B47;
PRAGMA user_version = 10300;
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
INSERT INTO gpkg_spatial_ref_sys VALUES
  ('Undefined Cartesian SRS', -1, 'NONE', -1, 'undefined', 'metres east and north of an origin without a known place'),
  ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL UNIQUE, column_name TEXT NOT NULL,
  geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  PRIMARY KEY (table_name, column_name));
CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT, f_table_catalog TEXT, f_table_schema TEXT,
  f_table_name TEXT, f_geometry_column TEXT, styleName TEXT, styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN,
  description TEXT, owner TEXT, ui TEXT,
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')));
INSERT INTO gpkg_contents (table_name, data_type, identifier) VALUES ('layer_styles', 'attributes', 'layer_styles');
"""


class _Layer:
    """A table of features that share their columns.

    Attributes:
        count: Features.
    """

    def __init__(self, connection: sqlite3.Connection, first: MapFeature, srs_id: int) -> None:
        self.count = 0
        self._connection, self._name, self._srs_id = connection, first.layer, srs_id
        self._columns = tuple(first.properties)
        self._shapes: set[str] = set()
        self._box: Box = (math.inf, math.inf, -math.inf, -math.inf)
        columns = "".join(f", {_quoted(name)} {_sql_type(name, value)}" for name, value in first.properties.items())
        fid = "fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom GEOMETRY"
        connection.execute(f"CREATE TABLE {_quoted(self._name)} ({fid}{columns})")
        marks = ", ".join("?" * (2 + len(self._columns)))
        self._insert = f"INSERT INTO {_quoted(self._name)} VALUES ({marks})"  # noqa: S608 - quoted

    def add(self, properties: Mapping[str, object], geometry: Geometry | None) -> None:
        """Write a feature; geometry in the map's system."""
        blob = None
        if geometry is not None:
            box = _box(geometry["coordinates"])
            flags = 1 | 1 << 1  # little endian; the box is of x and y
            blob = struct.pack("<2sBBi4d", b"GP", 0, flags, self._srs_id, box[0], box[2], box[1], box[3])
            blob += _wkb(geometry["type"], geometry["coordinates"])
            self._box = _joined([self._box, box])
            self._shapes.add(geometry["type"])
        values = [_as_sql(name, properties.get(name)) for name in self._columns]
        self._connection.execute(self._insert, [None, blob, *values])
        self.count += 1

    def finish(self, number: int) -> None:
        """Enter the table, its box and its style into the GeoPackage's own tables."""
        shape = next(iter(self._shapes)) if len(self._shapes) == 1 else "Geometry"
        box = self._box if self._shapes else (None,) * 4
        contents = "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y, srs_id)"
        self._connection.execute(
            f"{contents} VALUES (?, 'features', ?, ?, ?, ?, ?, ?)", (self._name, self._name, *box, self._srs_id)
        )
        self._connection.execute(
            "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, 2, 0)",
            (self._name, shape.upper(), self._srs_id),
        )
        style = _qml(shape, self._columns, COLOURS[number % len(COLOURS)])
        self._connection.execute(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName,"
            " styleQML, styleSLD, useAsDefault, description, owner) VALUES ('', '', ?, 'geom', ?, ?, '', 1, ?, '')",
            (self._name, self._name, style, "values with their 95 % interval; grey: no number"),
        )


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _sql_type(name: str, value: object) -> str:
    return _TYPES.get(name) or ("TEXT" if isinstance(value, str) else "REAL")


def _as_sql(name: str, value: object) -> object:
    """A time of ISO 8601 to the millisecond, as GeoPackages have them; everything else as it is."""
    return f"{value[:23]}Z" if _TYPES.get(name) == "DATETIME" and isinstance(value, str) else value


def _box(coordinates: list[Any]) -> Box:
    """Least x and y, largest x and y."""
    if not isinstance(coordinates[0], list):
        x, y = coordinates[:2]
        return x, y, x, y
    return _joined([_box(each) for each in coordinates])


def _joined(boxes: list[Box]) -> Box:
    west, south, east, north = zip(*boxes, strict=True)
    return min(west), min(south), max(east), max(north)


def _wkb(shape: str, coordinates: list[Any]) -> bytes:
    """Well-known binary, ISO, little endian."""
    inner = coordinates
    while isinstance(inner[0], list):
        inner = inner[0]
    head = struct.pack("<BI", 1, _WKB_CODES[shape] + (_WKB_Z if len(inner) > _PLANE_AXES else 0))
    if shape == "Point":
        return head + struct.pack(f"<{len(coordinates)}d", *coordinates)
    count = struct.pack("<I", len(coordinates))
    if shape == "LineString":
        return head + count + _packed(coordinates)
    if shape == "Polygon":
        return head + count + b"".join(struct.pack("<I", len(ring)) + _packed(ring) for ring in coordinates)
    return head + count + b"".join(_wkb("LineString", line) for line in coordinates)


def _packed(points: list[list[float]]) -> bytes:
    return b"".join(struct.pack(f"<{len(point)}d", *point) for point in points)


_MARK: Final = {"Point": ("marker", "SimpleMarker"), "Polygon": ("fill", "SimpleFill")}
_LINE: Final = ("line", "SimpleLine")
_GREY: Final = (150, 150, 150)


def _qml(shape: str, columns: tuple[str, ...], colour: tuple[int, int, int]) -> str:
    """A layer's look in QGIS: what has a number in its colour, what has none in grey, labelled with value and 95 %."""
    symbols = "".join(_symbol(shape, row, each) for row, each in enumerate((colour, _GREY)))
    if "status" in columns:
        categories = (
            f'<category symbol="0" value="{Status.OK}" label="{Status.OK}" render="true"/>'
            '<category symbol="1" value="" label="no number" render="true"/>'
        )
        renderer = f'type="categorizedSymbol" attr="status"><categories>{categories}</categories>'
    else:
        renderer = 'type="singleSymbol">'
    value = next((name for name, std in pairwise(columns) if std == f"std_{name.rpartition('_')[2]}"), None)
    label = "" if value is None else _label(value)
    return (
        "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>"
        f'<qgis version="3.16" styleCategories="Symbology|Labeling" labelsEnabled="{int(bool(label))}">'
        f"<renderer-v2 {renderer}<symbols>{symbols}</symbols></renderer-v2>{label}</qgis>"
    )


def _symbol(shape: str, row: int, colour: tuple[int, int, int]) -> str:
    kind, layer = _MARK.get(shape, _LINE)
    red, green, blue = colour
    looks = {
        "color": f"{red},{green},{blue},{70 if kind == 'fill' else 255}",
        "line_color": f"{red},{green},{blue},255",
        "line_width": "0.5",
        "outline_color": f"{red},{green},{blue},255",
        "size": "2.4",
    }
    marks = "".join(f'<prop k="{name}" v="{value}"/>' for name, value in looks.items())
    return f'<symbol type="{kind}" name="{row}" alpha="1"><layer class="{layer}" enabled="1">{marks}</layer></symbol>'


def _label(value: str) -> str:
    unit = value.rpartition("_")[2]
    half = f'format_number(("ci95_high_{unit}" - "ci95_low_{unit}") / 2, 2)'
    expression = f"""format_number("{value}", 2) || ' ± ' || {half} || ' {written_unit(unit)} (95 %)'"""
    style = f'<text-style isExpression="1" fontSize="8" fieldName={quoteattr(expression)}/>'
    return f'<labeling type="simple"><settings calloutType="simple">{style}</settings></labeling>'


def write_kml(path: Path, features: Iterable[MapFeature]) -> dict[str, int]:
    """Write features in WGS84 as KML 2.2: a folder for each layer, typed properties, times where there are some.

    Returns:
        How many features are in each layer.

    Raises:
        OSError: The file cannot be written.
    """
    counts: dict[str, int] = {}
    with ExitStack() as stack:
        parts: dict[str, Any] = {}
        for feature in features:
            if feature.layer not in parts:
                parts[feature.layer] = stack.enter_context(TemporaryFile("w+", encoding="utf-8"))
                parts[feature.layer].write(_kml_head(feature, COLOURS[len(counts) % len(COLOURS)]))
                counts[feature.layer] = 0
            parts[feature.layer].write(_placemark(feature))
            counts[feature.layer] += 1
        with path.open("w", encoding="utf-8") as file:
            file.write(
                '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
            )
            for part in parts.values():
                part.seek(0)
                file.writelines(part)
                file.write("</Folder>\n")
            file.write("</Document></kml>\n")
    return counts


def _kml_head(feature: MapFeature, colour: tuple[int, int, int]) -> str:
    red, green, blue = colour
    layer, full = escape(feature.layer), f"ff{blue:02x}{green:02x}{red:02x}"
    columns = [(name, value) for name, value in feature.properties.items() if name != "name"]
    types = {name: _KML_TYPES[_sql_type(name, value)] for name, value in columns}
    types |= {"stamp_ns": "string"} if "stamp_ns" in types else {}  # KML has no whole numbers of 64 bits
    fields = "".join(f'<SimpleField name={quoteattr(name)} type="{kind}"/>' for name, kind in types.items())
    looks = f"<LineStyle><color>{full}</color><width>3</width></LineStyle><IconStyle><color>{full}</color></IconStyle>"
    fill = f"<PolyStyle><color>46{full[2:]}</color></PolyStyle>"
    schema = f'<Schema name="{layer}" id="{layer}-columns">{fields}</Schema>'
    return f'{schema}<Style id="{layer}-style">{looks}{fill}</Style>\n<Folder><name>{layer}</name>\n'


def _placemark(feature: MapFeature) -> str:
    layer = escape(feature.layer)
    data = "".join(
        f"<SimpleData name={quoteattr(name)}>{_xml(value)}</SimpleData>"
        for name, value in feature.properties.items()
        if value is not None and name != "name"  # it is the placemark's
    )
    name, time = feature.properties.get("name", feature.layer), feature.properties.get("time_utc")
    when = "" if time is None else f"<TimeStamp><when>{_xml(time)}</when></TimeStamp>"
    shape = "" if feature.geometry is None else _kml_shape(feature.geometry["type"], feature.geometry["coordinates"])
    extended = f'<ExtendedData><SchemaData schemaUrl="#{layer}-columns">{data}</SchemaData></ExtendedData>'
    style = f"<styleUrl>#{layer}-style</styleUrl>"
    return f"<Placemark><name>{_xml(name)}</name>{when}{style}{extended}{shape}</Placemark>\n"


def _kml_shape(shape: str, coordinates: list[Any]) -> str:
    """Longitude and latitude: without heights, as these are above the sea, everything is drawn on the ground."""
    if shape == "MultiLineString":
        return f"<MultiGeometry>{''.join(_kml_shape('LineString', line) for line in coordinates)}</MultiGeometry>"
    if shape == "Polygon":
        outer, *inner = [f"<LinearRing>{_kml_points(ring)}</LinearRing>" for ring in coordinates]
        holes = "".join(f"<innerBoundaryIs>{each}</innerBoundaryIs>" for each in inner)
        return f"<Polygon><outerBoundaryIs>{outer}</outerBoundaryIs>{holes}</Polygon>"
    return f"<{shape}>{_kml_points([coordinates] if shape == 'Point' else coordinates)}</{shape}>"


def _kml_points(points: list[list[float]]) -> str:
    return f"<coordinates>{' '.join(f'{lon!r},{lat!r}' for lon, lat, *_ in points)}</coordinates>"


def _xml(value: object) -> str:
    """Text that XML 1.0 can hold."""
    return escape("".join(each if each.isprintable() else " " for each in str(value)))
