"""Maps as OGC GeoPackage, written by GDAL, with a QGIS style for each layer."""

import errno
import sqlite3
import warnings
from collections.abc import Iterable, Mapping
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt
import orjson
import shapely
from pyogrio.errors import DataLayerError, DataSourceError, FeatureError, FieldError, GeometryError
from pyogrio.raw import write

from aerodft.model import Status
from replay.export.maps import MapCrs, MapFeature, column_type
from replay.export.table import ColumnType, written_unit
from replay.export.video import COLOURS

_FEATURES_AT_ONCE: Final = 4096
"""Features of a layer that are held before they are written; chosen: some 10 MB."""

_UTC: Final = 100
"""OGR's code for UTC in a time (``OGR_TZFLAG_UTC``)."""

_LOCAL_SRS_ID: Final = -1
"""Cartesian system without a place on Earth (OGC GeoPackage 1.3, requirement 11)."""

_ERRORS: Final = (DataLayerError, DataSourceError, FeatureError, FieldError, GeometryError, RuntimeError, sqlite3.Error)
_MARK: Final = {"Point": ("marker", "SimpleMarker"), "Polygon": ("fill", "SimpleFill")}
_LINE: Final = ("line", "SimpleLine")
_GREY: Final = (150, 150, 150)


def write_geopackage(path: Path, features: Iterable[MapFeature], crs: MapCrs) -> dict[str, int]:
    """Write features as an OGC GeoPackage: a layer with a spatial index and a QGIS style for each kind.

    Returns:
        The number of features in each layer.

    Raises:
        InputError: A feature lies where the system has no coordinates.
        OSError: The file cannot be written.
    """
    package = path.with_name(f"{path.name}.gpkg")  # GDAL warns of any other ending
    layers: dict[str, _Layer] = {}
    try:
        for feature in features:
            layer = layers.setdefault(feature.layer, _Layer(package, feature, crs))
            layer.add(feature)
        for layer in layers.values():
            layer.flush()
        with closing(sqlite3.connect(package)) as connection:
            _write_styles(connection, list(layers.values()))
        package.replace(path)
    except _ERRORS as error:
        raise OSError(errno.EIO, str(error)) from error
    finally:
        package.unlink(missing_ok=True)
    return {name: layer.count for name, layer in layers.items()}


class _Layer:
    """Features that share their columns.

    Attributes:
        name: Name of the layer.
        columns: Names of its columns.
        count: Number of features.
        shapes: Types of the geometries, without ``Z``.
    """

    def __init__(self, package: Path, first: MapFeature, crs: MapCrs) -> None:
        self.name, self.columns, self.count = first.layer, tuple(first.properties), 0
        self.shapes: set[str] = set()
        self._package, self._crs = package, crs
        self._types = {name: column_type(name, value) for name, value in first.properties.items()}
        self._geometries: list[bytes | None] = []
        self._rows: list[Mapping[str, object]] = []
        self._layer_type: str | None = None

    def add(self, feature: MapFeature) -> None:
        """Add a feature, whose geometry is projected into the map's system."""
        geometry = self._crs.projected(feature.geometry)
        self._geometries.append(None if geometry is None else orjson.dumps(dict(geometry)))
        self._rows.append(feature.properties)
        self.count += 1
        if len(self._rows) >= _FEATURES_AT_ONCE:
            self.flush()

    def flush(self) -> None:
        """Write the features that are held."""
        if not self._rows:
            return
        shapes = shapely.from_geojson(np.array(self._geometries, dtype=object))
        self.shapes |= {shape.geom_type for shape in shapes if shape is not None}
        is_first, self._layer_type = self._layer_type is None, self._layer_type or _layer_type(shapes)
        columns = [_column(self._types[name], [row.get(name) for row in self._rows]) for name in self.columns]
        times = [name for name, kind in self._types.items() if kind is ColumnType.TIME]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a missing system, which local metres have not
            write(
                self._package,
                shapely.to_wkb(shapes, flavor="iso"),
                [values for values, _ in columns],
                list(self.columns),
                field_mask=[mask for _, mask in columns],
                layer=self.name,
                driver="GPKG",
                geometry_type=self._layer_type,
                crs=None if self._crs.crs is None else f"EPSG:{self._crs.code}",
                append=self._package.exists(),
                layer_options={"SRID": _LOCAL_SRS_ID} if is_first and self._crs.is_local else {},
                gdal_tz_offsets={name: np.full(len(self._rows), _UTC) for name in times},
            )
        self._geometries.clear()
        self._rows.clear()


def _layer_type(shapes: npt.NDArray[np.object_]) -> str:
    """Type of a layer for geometries ``(n,)``; ``Unknown`` where they differ or there is none."""
    types = {f"{shape.geom_type}{' Z' if shape.has_z else ''}" for shape in shapes if shape is not None}
    return types.pop() if len(types) == 1 else "Unknown"


def _column(kind: ColumnType, values: list[Any]) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_] | None]:
    """Values ``(n,)`` of a column for GDAL, with a mask ``(n,)`` of the missing ones where the type has no gap."""
    if kind is ColumnType.INTEGER:
        is_missing = np.array([value is None for value in values])
        return np.array([0 if value is None else value for value in values], dtype=np.int64), is_missing
    if kind is ColumnType.NUMBER:
        return np.array(values, dtype=np.float64), None
    if kind is ColumnType.TIME:  # to the millisecond, as GeoPackages have it
        texts = ["NaT" if value is None else str(value)[:23] for value in values]
        return np.array(texts, dtype="datetime64[ms]"), None
    return np.array(values, dtype=object), None


_STYLES: Final = """
CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT, f_table_catalog TEXT, f_table_schema TEXT,
  f_table_name TEXT, f_geometry_column TEXT, styleName TEXT, styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN,
  description TEXT, owner TEXT, ui TEXT,
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')));
INSERT INTO gpkg_contents (table_name, data_type, identifier) VALUES ('layer_styles', 'attributes', 'layer_styles');
"""
"""The table in which QGIS looks for default styles."""


def _write_styles(connection: sqlite3.Connection, layers: list[_Layer]) -> None:
    connection.executescript(_STYLES)
    for number, layer in enumerate(layers):
        shape = next(iter(layer.shapes)) if len(layer.shapes) == 1 else "Geometry"
        style = _qml(shape, layer.columns, COLOURS[number % len(COLOURS)])
        connection.execute(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName,"
            " styleQML, styleSLD, useAsDefault, description, owner) VALUES ('', '', ?, 'geom', ?, ?, '', 1, ?, '')",
            (layer.name, layer.name, style, "values with their 95 % interval; grey: no number"),
        )
    connection.commit()


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
