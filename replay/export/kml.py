"""Maps as KML 2.2: a folder with typed columns and a style for each layer."""

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final
from xml.sax.saxutils import escape, quoteattr

from replay.export.maps import MapFeature, column_type
from replay.export.table import ColumnType
from replay.export.video import COLOURS

_TYPES: Final = {
    ColumnType.TEXT: "string",
    ColumnType.INTEGER: "int",
    ColumnType.NUMBER: "double",
    ColumnType.TIME: "string",
}


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
    types = {name: _TYPES[column_type(name, value)] for name, value in columns}
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
