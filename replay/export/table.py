"""Measurements as rows of a table, whose columns are those of CSV and Parquet in their order; and as geometries."""

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from enum import Enum, auto
from typing import Any, Final

import orjson

from aerodft.adapters.wire.payload import LATEST_NS, JsonValue, load_bounded_json
from aerodft.dft import recorded_kind
from aerodft.errors import InputError

LARGEST_NUMBER: Final = 1e100
"""In a table: its square is finite."""
_COUNTS: Final = {"pixels_px": 2, "enu_m": 3}  # of a vector
_MOST_DEG: Final = {"lat_deg": 90, "lon_deg": 360, "lat_2_deg": 90, "lon_2_deg": 360}
_NEEDED: Final = ("name", "kind", "status", "unit")
_AS_ON_THE_WIRE: Final = (
    *_NEEDED, "value", "std", "image", "std_px", "enu_m", "camera", "model", "calibration", "config", "software",
)  # fmt: skip


class ColumnType(Enum):
    """Types of columns."""

    TEXT = auto()
    INTEGER = auto()
    NUMBER = auto()
    TIME = auto()  # ISO 8601, UTC
    NUMBERS = auto()  # a list, one for each point
    VECTORS = auto()  # a list of lists, one for each point


COLUMNS: Final[Mapping[str, ColumnType]] = {
    "time_utc": ColumnType.TIME,
    "stamp_ns": ColumnType.INTEGER,
    "name": ColumnType.TEXT,
    "kind": ColumnType.TEXT,
    "status": ColumnType.TEXT,
    "value": ColumnType.NUMBER,
    "unit": ColumnType.TEXT,
    "std": ColumnType.NUMBER,
    "ci95_low": ColumnType.NUMBER,
    "ci95_high": ColumnType.NUMBER,
    "ellipse95_major_m": ColumnType.NUMBER,
    "ellipse95_minor_m": ColumnType.NUMBER,
    "ellipse95_azimuth_deg": ColumnType.NUMBER,
    "reasons": ColumnType.TEXT,
    "image": ColumnType.INTEGER,
    "pixels_px": ColumnType.VECTORS,
    "std_px": ColumnType.NUMBER,
    "lat_deg": ColumnType.NUMBER,
    "lon_deg": ColumnType.NUMBER,
    "alt_msl_m": ColumnType.NUMBER,
    "range_m": ColumnType.NUMBER,
    "lat_2_deg": ColumnType.NUMBER,
    "lon_2_deg": ColumnType.NUMBER,
    "alt_2_msl_m": ColumnType.NUMBER,
    "range_2_m": ColumnType.NUMBER,
    "geo_wkt": ColumnType.TEXT,
    "enu_m": ColumnType.VECTORS,
    "ranges_m": ColumnType.NUMBERS,
    "cov_east_m2": ColumnType.NUMBER,
    "cov_east_north_m2": ColumnType.NUMBER,
    "cov_north_m2": ColumnType.NUMBER,
    "height_agl_m": ColumnType.NUMBER,
    "height_source": ColumnType.TEXT,
    "height_datum": ColumnType.TEXT,
    "tilt_deg": ColumnType.NUMBER,
    "roll_deg": ColumnType.NUMBER,
    "heading_deg": ColumnType.NUMBER,
    "height_agl_std_m": ColumnType.NUMBER,
    "tilt_std_deg": ColumnType.NUMBER,
    "pan_std_deg": ColumnType.NUMBER,
    "roll_std_deg": ColumnType.NUMBER,
    "heading_std_deg": ColumnType.NUMBER,
    "camera_lat_deg": ColumnType.NUMBER,
    "camera_lon_deg": ColumnType.NUMBER,
    "height_age_s": ColumnType.NUMBER,
    "telemetry_age_s": ColumnType.NUMBER,
    "level_m": ColumnType.NUMBER,
    "level_std_m": ColumnType.NUMBER,
    "level_datum": ColumnType.TEXT,
    "camera": ColumnType.TEXT,
    "model": ColumnType.TEXT,
    "calibration": ColumnType.TEXT,
    "config": ColumnType.TEXT,
    "software": ColumnType.TEXT,
}
"""``docs/tables.md`` says what each is."""

LISTS: Final = tuple(name for name, kind in COLUMNS.items() if kind in {ColumnType.NUMBERS, ColumnType.VECTORS})
"""Columns that hold lists."""


def check_row(row: dict[str, object]) -> None:
    """Refuse what a column cannot hold.

    Raises:
        TypeError, ValueError: It is no number, text or list, as ``COLUMNS`` has it; or one that cannot be.
    """
    for name, kind in COLUMNS.items():
        if row[name] is not None and not _is_held(row[name], kind, _COUNTS.get(name)):
            raise TypeError(f"{name} is none")
    if any(row[name] is None for name in _NEEDED):
        raise ValueError("without a name, kind, status or unit")
    check_on_earth(row)


def check_on_earth(row: Mapping[str, object]) -> None:
    """Refuse latitudes and longitudes that are none, as far as a row has them.

    Raises:
        ValueError: One is none.
    """
    for name, most_deg in _MOST_DEG.items():
        angle_deg = row.get(name)
        if isinstance(angle_deg, float | int) and abs(angle_deg) > most_deg:
            raise ValueError("no place on Earth")


def _is_held(value: JsonValue, kind: ColumnType, count: int | None) -> bool:
    """Whether a column of this kind can hold a value; a list of ``count``, or where that is None of any length."""
    if kind is ColumnType.VECTORS:
        return isinstance(value, list) and all(_is_held(each, ColumnType.NUMBERS, count) for each in value)
    if kind is ColumnType.NUMBERS:
        is_long = isinstance(value, list) and len(value) == (count or len(value))
        return is_long and all(each is None or _is_held(each, ColumnType.NUMBER, None) for each in value)
    if kind is ColumnType.NUMBER:
        return type(value) in {float, int} and abs(value) <= LARGEST_NUMBER
    if kind is ColumnType.INTEGER:
        return type(value) is int and abs(value) <= LATEST_NS
    return isinstance(value, str)


Item = Mapping[str, Any]
"""A measurement as on the wire (``aerodft.measurement/1``)."""

_ANGLE_DIGITS: Final = 9
_NO_POINT: Final[Item] = {"lat_deg": None, "lon_deg": None, "alt_msl_m": None}
_NO_ELLIPSE: Final[Item] = {"semi_major_m": None, "semi_minor_m": None, "azimuth_deg": None}


def parse_measurement(payload: bytes) -> Item:
    """A measurement's payload as an object.

    Raises:
        InputError: It is no JSON object.
    """
    try:
        item = load_bounded_json(payload)
    except orjson.JSONDecodeError as error:
        raise _not_a_measurement(payload) from error
    if not isinstance(item, dict):
        raise _not_a_measurement(payload)
    return item


def row_of(item: Item) -> dict[str, object]:
    """A measurement's row, with the keys of ``COLUMNS`` in their order; None where nothing is known.

    Raises:
        InputError: It is no measurement.
    """
    try:
        row = _row(item)
        check_row(row)
    except (KeyError, TypeError, IndexError, ValueError, AttributeError, OverflowError, OSError) as error:
        raise _not_a_measurement(orjson.dumps(dict(item), default=str)) from error
    return row


def _row(item: Item) -> dict[str, object]:
    stamp_ns, geo, ranges = int(item["stamp_ns"]), item["geo"] or (), item["range_m"] or ()
    first, second = _at(geo, 0, _NO_POINT), _at(geo, 1, _NO_POINT)
    low, high = item["ci95"] or (None, None)
    ellipse, cov = item["ellipse95"] or _NO_ELLIPSE, item["cov_enu_m2"] or ((None, None), (None, None))
    row = {
        **{name: item[name] for name in _AS_ON_THE_WIRE},
        "time_utc": time_utc(stamp_ns),
        "stamp_ns": stamp_ns,
        "ci95_low": low,
        "ci95_high": high,
        "ellipse95_major_m": ellipse["semi_major_m"],
        "ellipse95_minor_m": ellipse["semi_minor_m"],
        "ellipse95_azimuth_deg": ellipse["azimuth_deg"],
        "reasons": "; ".join(item["reasons"]),
        "pixels_px": item["pixels"],
        "lat_deg": first["lat_deg"],
        "lon_deg": first["lon_deg"],
        "alt_msl_m": first["alt_msl_m"],
        "range_m": _at(ranges, 0, None),
        "lat_2_deg": second["lat_deg"],
        "lon_2_deg": second["lon_deg"],
        "alt_2_msl_m": second["alt_msl_m"],
        "range_2_m": _at(ranges, 1, None),
        "geo_wkt": _wkt(geometry_of(item)),
        "ranges_m": item["range_m"],
        "cov_east_m2": cov[0][0],
        "cov_east_north_m2": cov[0][1],
        "cov_north_m2": cov[1][1],
        **_pose_columns(item["pose"]),
    }
    return {name: row[name] for name in COLUMNS}


def _pose_columns(pose: Item) -> dict[str, object]:
    std = pose["std"] if pose["tilt_deg"] is not None else {}  # without a pose there is nothing that they are of
    level = pose.get("level") or {}  # early recordings have none
    return {
        "height_agl_m": pose["height_agl_m"],
        "height_source": pose["height_source"],
        "height_datum": pose.get("height_datum"),  # early recordings have none
        **{name: _angle(pose[name]) for name in ("tilt_deg", "roll_deg", "heading_deg")},
        "height_agl_std_m": std.get("height_agl_m"),
        "tilt_std_deg": std.get("tilt_deg"),
        "pan_std_deg": std.get("pan_deg"),
        "roll_std_deg": std.get("roll_deg"),
        "heading_std_deg": std.get("heading_deg"),
        "camera_lat_deg": pose["lat_deg"],
        "camera_lon_deg": pose["lon_deg"],
        "height_age_s": pose.get("height_age_s"),
        "telemetry_age_s": pose["telemetry_age_s"],
        "level_m": level.get("level_m"),
        "level_std_m": level.get("std_m"),
        "level_datum": level.get("datum"),
    }


def _angle(angle_deg: float | None) -> float | None:
    """Without the rounding errors of what is 0, and without its sign."""
    return None if angle_deg is None else round(angle_deg, _ANGLE_DIGITS) + 0.0


def geometry_of(item: Item, *, is_local: bool = False) -> dict[str, Any] | None:
    """All points of a measurement as a GeoJSON geometry: one is a point, an area a polygon, others are lines.

    Args:
        item: The measurement.
        is_local: Whether they are in metres east, north and up of the station's origin, in place of longitude,
            latitude and, where all have one, altitude.

    Returns:
        None where a point has no place. An area's outline is closed and runs counterclockwise, as maps want it.
    """
    places = item["enu_m"] or [] if is_local else _lon_lat(item["geo"] or ())
    if not places or any(value is None or not math.isfinite(value) for place in places for value in place):
        return None
    if len(places) == 1:
        return {"type": "Point", "coordinates": places[0]}
    kind = recorded_kind(item["kind"])
    if kind.is_closed and len(places) > 2:  # noqa: PLR2004 - corners of a triangle
        return {"type": "Polygon", "coordinates": [_ring(places)]}
    if kind.in_pairs:
        return {"type": "MultiLineString", "coordinates": [places[line] for line in kind.lines(len(places))]}
    return {"type": "LineString", "coordinates": places}


def _lon_lat(points: Sequence[Item]) -> list[list[Any]]:
    has_altitudes = all(point["alt_msl_m"] is not None for point in points)
    parts = ("lon_deg", "lat_deg", *(["alt_msl_m"] if has_altitudes else []))
    return [[point[part] for part in parts] for point in points]


def _ring(places: list[list[float]]) -> list[list[float]]:
    following = places[1:] + places[:1]
    doubled = math.fsum(a[0] * b[1] - b[0] * a[1] for a, b in zip(places, following, strict=True))
    ring = places if doubled >= 0 else places[::-1]
    return [*ring, ring[0]]


def written_unit(unit: str) -> str:
    """A unit as people write it."""
    return {"m2": "m²", "deg": "°"}.get(unit, unit)


def digits_of(spread: float) -> int:
    """Decimals that a number deserves whose interval, or half of it, is so wide."""
    return 2 if not 0 < spread < math.inf else min(max(1 - math.floor(math.log10(spread)), 0), 4)


def time_utc(stamp_ns: int) -> str:
    """ISO 8601 with microseconds."""
    seconds, rest_ns = divmod(stamp_ns, 1_000_000_000)
    return datetime.fromtimestamp(seconds, UTC).replace(microsecond=rest_ns // 1000).isoformat(timespec="microseconds")


def _wkt(geometry: Item | None) -> str | None:
    """A GeoJSON geometry as well-known text, as geographic information systems read it from a table's column."""
    if geometry is None:
        return None
    kind, coordinates = geometry["type"], geometry["coordinates"]
    lines: list[Any] = {"Point": [[coordinates]], "LineString": [coordinates]}.get(kind) or coordinates
    texts = [f"({', '.join(' '.join(map(repr, place)) for place in line)})" for line in lines]
    z = " Z" if len(lines[0][0]) > 2 else ""  # noqa: PLR2004 - longitude and latitude
    return f"{kind.upper()}{z} " + (texts[0] if lines is not coordinates else f"({', '.join(texts)})")


def _at(values: Sequence[JsonValue], index: int, otherwise: object) -> JsonValue:
    return values[index] if index < len(values) else otherwise


def _not_a_measurement(payload: bytes) -> InputError:
    return InputError("a recorded measurement is none", got=repr(payload[:60]))
