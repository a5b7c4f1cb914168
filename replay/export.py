"""Measurements as tables and maps: CSV for spreadsheets, GeoJSON (RFC 7946) for maps."""

import csv
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from enum import StrEnum
from io import StringIO
from typing import Any, Final

import orjson

from aerodft.errors import InputError

_COLUMNS: Final[dict[str, Callable[[dict[str, Any]], object]]] = {
    "time_utc": lambda item: _time_utc(item["stamp_ns"]),
    "stamp_ns": lambda item: item["stamp_ns"],
    "name": lambda item: item["name"],
    "kind": lambda item: item["kind"],
    "status": lambda item: item["status"],
    "value": lambda item: item["value"],
    "unit": lambda item: item["unit"],
    "std": lambda item: item["std"],
    "ci95_low": lambda item: item["ci95"] and item["ci95"][0],
    "ci95_high": lambda item: item["ci95"] and item["ci95"][1],
    "ellipse95_major_m": lambda item: item["ellipse95"] and item["ellipse95"]["semi_major_m"],
    "ellipse95_minor_m": lambda item: item["ellipse95"] and item["ellipse95"]["semi_minor_m"],
    "ellipse95_azimuth_deg": lambda item: item["ellipse95"] and item["ellipse95"]["azimuth_deg"],
    "reasons": lambda item: "; ".join(item["reasons"]),
    "image": lambda item: item["image"],
    "lat": lambda item: item["geo"] and item["geo"][0]["lat"],
    "lon": lambda item: item["geo"] and item["geo"][0]["lon"],
    "alt_msl_m": lambda item: item["geo"] and item["geo"][0]["alt_msl_m"],
    "range_m": lambda item: item["range_m"] and item["range_m"][0],
    "height_agl_m": lambda item: item["pose"]["height_agl_m"],
    "height_source": lambda item: item["pose"]["height_source"],
    "tilt_deg": lambda item: item["pose"]["tilt_deg"],
    "roll_deg": lambda item: item["pose"]["roll_deg"],
    "heading_deg": lambda item: item["pose"]["heading_deg"],
    "camera_lat": lambda item: item["pose"]["lat"],
    "camera_lon": lambda item: item["pose"]["lon"],
    "telemetry_age_s": lambda item: item["pose"]["telemetry_age_s"],
    "camera": lambda item: item["camera"],
    "model": lambda item: item["model"],
    "calibration": lambda item: item["calibration"],
    "config": lambda item: item["config"],
}
"""Columns of the CSV, and properties of a GeoJSON feature; ``lat`` ... ``range_m`` are of the first point."""

_IN_GEOMETRY = frozenset({"lat", "lon", "alt_msl_m"})


class ExportFormat(StrEnum):
    """What a recording's measurements can be written as."""

    CSV = "csv"
    GEOJSON = "geojson"


def export_text(payloads: Iterable[bytes], form: ExportFormat) -> Iterator[str]:
    """Measurements in an exchange format, piece by piece.

    Args:
        payloads: ``aerodft.measurement/1`` payloads.
        form: The format.

    Raises:
        InputError: A payload is no measurement.
    """
    return _csv(payloads) if form is ExportFormat.CSV else _geojson(payloads)


def _csv(payloads: Iterable[bytes]) -> Iterator[str]:
    buffer = StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for payload in payloads:
        yield _taken(buffer)
        writer.writerow(_row(payload)[1].values())
    yield _taken(buffer)


def _geojson(payloads: Iterable[bytes]) -> Iterator[str]:
    before = '{"type": "FeatureCollection", "features": ['
    for payload in payloads:
        item, row = _row(payload)
        feature = {
            "type": "Feature",
            "geometry": _geometry(item["geo"]),
            "properties": {name: value for name, value in row.items() if name not in _IN_GEOMETRY},
        }
        yield f"{before}\n{orjson.dumps(feature).decode()}"
        before = ","
    yield "\n]}\n" if before == "," else f"{before}]}}\n"


def _geometry(points: list[dict[str, float | None]] | None) -> dict[str, object] | None:
    """A point, a line, or a closed ring of three and more points; None where a point has no position."""
    positions = [
        [point["lon"], point["lat"], *([] if point["alt_msl_m"] is None else [point["alt_msl_m"]])]
        for point in points or []
    ]
    if not positions or any(part is None for position in positions for part in position):
        return None
    if len(positions) == 1:
        return {"type": "Point", "coordinates": positions[0]}
    return {"type": "LineString", "coordinates": positions}


def _row(payload: bytes) -> tuple[dict[str, Any], dict[str, object]]:
    try:
        item = orjson.loads(payload)
        return item, {name: column(item) for name, column in _COLUMNS.items()}
    except (orjson.JSONDecodeError, KeyError, TypeError, IndexError, ValueError) as error:
        raise InputError("a recorded measurement is none", got=repr(payload[:60])) from error


def _time_utc(stamp_ns: str) -> str:
    """ISO 8601 with microseconds."""
    seconds, rest_ns = divmod(int(stamp_ns), 1_000_000_000)
    return datetime.fromtimestamp(seconds, UTC).replace(microsecond=rest_ns // 1000).isoformat(timespec="microseconds")


def _taken(buffer: StringIO) -> str:
    text = buffer.getvalue()
    buffer.seek(0)
    buffer.truncate()
    return text
