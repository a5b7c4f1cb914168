"""What a recording can be written as; and measurements as CSV for spreadsheets, JSON lines for programs, GeoJSON."""

import csv
from collections.abc import Iterable, Iterator
from enum import StrEnum
from typing import Final

import orjson

from aerodft.adapters.files import csv_cell
from replay.export.maps import MapCrs, geojson_text, map_features
from replay.export.table import COLUMNS, LISTS, parsed, row_of


class ExportFormat(StrEnum):
    """What a recording can be written as."""

    CSV = "csv"
    GEOJSON = "geojson"
    GPKG = "gpkg"
    KML = "kml"
    JSONL = "jsonl"
    PARQUET = "parquet"
    MCAP = "mcap"
    MP4 = "mp4"


TEXT_FORMATS: Final = frozenset({ExportFormat.CSV, ExportFormat.GEOJSON, ExportFormat.JSONL})
"""What ``export_text`` writes."""

MAP_FORMATS: Final = frozenset({ExportFormat.GEOJSON, ExportFormat.GPKG, ExportFormat.KML})


def export_text(payloads: Iterable[bytes], form: ExportFormat, crs: MapCrs | None = None) -> Iterator[str]:
    """Measurements in an exchange format, piece by piece.

    Args:
        payloads: ``aerodft.measurement/1`` payloads.
        form: One of ``TEXT_FORMATS``.
        crs: Of a map; None for WGS84.

    Raises:
        InputError: A payload is no measurement.
    """
    if form is ExportFormat.JSONL:
        return _lines(payloads)
    return _csv(payloads) if form is ExportFormat.CSV else geojson_text(map_features(payloads), crs or MapCrs.wgs84())


def _lines(payloads: Iterable[bytes]) -> Iterator[str]:
    for payload in payloads:
        item = parsed(payload)
        row_of(item)  # what is no measurement is refused in every format
        yield f"{orjson.dumps(item).decode()}\n"


class _Echo:
    """Makes ``csv.writer`` return its lines."""

    def write(self, text: str) -> str:
        return text


def _csv(payloads: Iterable[bytes]) -> Iterator[str]:
    writer = csv.writer(_Echo(), lineterminator="\n")
    yield writer.writerow(COLUMNS)
    for payload in payloads:
        row = row_of(parsed(payload))
        for name in LISTS:
            value = row[name]
            row[name] = None if value is None else orjson.dumps(value).decode()
        yield writer.writerow([value if name in LISTS else csv_cell(value) for name, value in row.items()])
