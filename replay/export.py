"""Measurements as text: CSV for spreadsheets, GeoJSON (RFC 7946) for maps, JSON lines for programs."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from io import StringIO
from typing import Final

import orjson

from aerodft.model.probe import ProbeKind
from replay.table import COLUMNS, Item, Kind, in_pairs, parsed, positions, row_of

_LISTS: Final = tuple(name for name, kind in COLUMNS.items() if kind in {Kind.NUMBERS, Kind.VECTORS})
_IN_GEOMETRY: Final = frozenset({"lat_deg", "lon_deg", "alt_msl_m", "lat_2_deg", "lon_2_deg", "alt_2_msl_m", "geo_wkt"})


class ExportFormat(StrEnum):
    """What text a recording's measurements can be written as."""

    CSV = "csv"
    GEOJSON = "geojson"
    JSONL = "jsonl"


def export_text(payloads: Iterable[bytes], form: ExportFormat) -> Iterator[str]:
    """Measurements in an exchange format, piece by piece.

    Args:
        payloads: ``aerodft.measurement/1`` payloads.
        form: The format.

    Raises:
        InputError: A payload is no measurement.
    """
    if form is ExportFormat.JSONL:
        return _lines(payloads)
    return _csv(payloads) if form is ExportFormat.CSV else _geojson(payloads)


def _lines(payloads: Iterable[bytes]) -> Iterator[str]:
    for payload in payloads:
        item = parsed(payload)
        row_of(item)  # what is no measurement is refused in every format
        yield f"{orjson.dumps(item).decode()}\n"


def _csv(payloads: Iterable[bytes]) -> Iterator[str]:
    buffer = StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for payload in payloads:
        yield _taken(buffer)
        row = row_of(parsed(payload))
        for name in _LISTS:
            value = row[name]
            row[name] = None if value is None else orjson.dumps(value).decode()
        writer.writerow(row.values())
    yield _taken(buffer)


def _geojson(payloads: Iterable[bytes]) -> Iterator[str]:
    before = '{"type": "FeatureCollection", "features": ['
    for payload in payloads:
        item = parsed(payload)
        row = row_of(item)
        feature = {
            "type": "Feature",
            "geometry": _geometry(item["geo"], item["kind"]),
            "properties": {name: value for name, value in row.items() if name not in _IN_GEOMETRY},
        }
        yield f"{before}\n{orjson.dumps(feature).decode()}"
        before = ","
    yield "\n]}\n" if before == "," else f"{before}]}}\n"


def _geometry(geo: Sequence[Item] | None, kind: str) -> dict[str, object] | None:
    """All points: one as a point, an area as a polygon, others as a line; None where a point has no position."""
    places = positions(geo, kind)
    if places is None:
        return None
    if len(places) == 1:
        return {"type": "Point", "coordinates": places[0]}
    if kind == ProbeKind.AREA:
        return {"type": "Polygon", "coordinates": [places]}
    if kind == ProbeKind.RIVER:
        return {"type": "MultiLineString", "coordinates": in_pairs(places)}
    return {"type": "LineString", "coordinates": places}


def _taken(buffer: StringIO) -> str:
    text = buffer.getvalue()
    buffer.seek(0)
    buffer.truncate()
    return text
