"""Measurements as rows of a table: the columns of CSV, Parquet and of a GeoJSON feature's properties, in order."""

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

import orjson

from aerodft.adapters import bounded_json
from aerodft.errors import InputError
from aerodft.model.probe import ProbeKind
from replay.columns import check_row

Item = Mapping[str, Any]
"""A measurement as on the wire (``aerodft.measurement/1``)."""

_ANGLE_DIGITS: Final = 9
_RING = 3  # points that make an outline
_NO_POINT: Final[Item] = {"lat": None, "lon": None, "alt_msl_m": None}
_NO_ELLIPSE: Final[Item] = {"semi_major_m": None, "semi_minor_m": None, "azimuth_deg": None}


def parsed(payload: bytes) -> Item:
    """A measurement's payload as an object.

    Raises:
        InputError: It is no JSON object.
    """
    try:
        item = bounded_json.loads(payload)
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
    return {
        "time_utc": time_utc(stamp_ns),
        "stamp_ns": stamp_ns,
        "name": item["name"],
        "kind": item["kind"],
        "status": item["status"],
        "value": item["value"],
        "unit": item["unit"],
        "std": item["std"],
        "ci95_low": low,
        "ci95_high": high,
        "ellipse95_major_m": ellipse["semi_major_m"],
        "ellipse95_minor_m": ellipse["semi_minor_m"],
        "ellipse95_azimuth_deg": ellipse["azimuth_deg"],
        "reasons": "; ".join(item["reasons"]),
        "image": item["image"],
        "pixels_px": item["pixels"],
        "std_px": item["std_px"],
        "lat_deg": first["lat"],
        "lon_deg": first["lon"],
        "alt_msl_m": first["alt_msl_m"],
        "range_m": _at(ranges, 0, None),
        "lat_2_deg": second["lat"],
        "lon_2_deg": second["lon"],
        "alt_2_msl_m": second["alt_msl_m"],
        "range_2_m": _at(ranges, 1, None),
        "geo_wkt": _wkt(geo, item["kind"]),
        "enu_m": item["enu_m"],
        "ranges_m": item["range_m"],
        "cov_east_m2": cov[0][0],
        "cov_east_north_m2": cov[0][1],
        "cov_north_m2": cov[1][1],
        **_pose_columns(item["pose"]),
        "camera": item["camera"],
        "model": item["model"],
        "calibration": item["calibration"],
        "config": item["config"],
        "software": item["software"],
    }


def _pose_columns(pose: Item) -> dict[str, object]:
    std = pose["std"] if pose["tilt_deg"] is not None else {}  # without a pose there is nothing that they are of
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
        "camera_lat_deg": pose["lat"],
        "camera_lon_deg": pose["lon"],
        "height_age_s": pose.get("height_age_s"),
        "telemetry_age_s": pose["telemetry_age_s"],
    }


def _angle(angle_deg: float | None) -> float | None:
    """Without the rounding errors of what is 0, and without its sign."""
    return None if angle_deg is None else round(angle_deg, _ANGLE_DIGITS) + 0.0


def positions(geo: Sequence[Item] | None, kind: str) -> list[list[float]] | None:
    """Longitude, latitude and, where all points have one, altitude of all points; None where one has no place.

    An area's outline is closed and runs counterclockwise, as maps want it.
    """
    points = geo or ()
    parts = ("lon", "lat", "alt_msl_m") if all(point["alt_msl_m"] is not None for point in points) else ("lon", "lat")
    found = [[point[part] for part in parts] for point in points]
    if not found or any(value is None or not math.isfinite(value) for place in found for value in place):
        return None
    if kind != ProbeKind.AREA or len(found) < _RING:
        return found
    following = found[1:] + found[:1]
    doubled = math.fsum(a[0] * b[1] - b[0] * a[1] for a, b in zip(found, following, strict=True))
    ring = found if doubled >= 0 else found[::-1]
    return [*ring, ring[0]]


def in_pairs(places: list[list[float]]) -> list[list[list[float]]]:
    """The first and the second, the third and the fourth, ...: what lies across a river."""
    return [places[row : row + 2] for row in range(0, len(places) - 1, 2)]


def time_utc(stamp_ns: int) -> str:
    """ISO 8601 with microseconds."""
    seconds, rest_ns = divmod(stamp_ns, 1_000_000_000)
    return datetime.fromtimestamp(seconds, UTC).replace(microsecond=rest_ns // 1000).isoformat(timespec="microseconds")


def _wkt(geo: Sequence[Item], kind: str) -> str | None:
    """Well-known text, as geographic information systems read it from a table's column."""
    places = positions(geo, kind)
    if places is None:
        return None
    text = _wkt_points(places)
    z = " Z" if len(places[0]) > 2 else ""  # noqa: PLR2004 - longitude and latitude
    if len(places) == 1:
        return f"POINT{z} ({text})"
    if kind == ProbeKind.RIVER:
        return f"MULTILINESTRING{z} ({', '.join(f'({_wkt_points(pair)})' for pair in in_pairs(places))})"
    return f"POLYGON{z} (({text}))" if kind == ProbeKind.AREA else f"LINESTRING{z} ({text})"


def _wkt_points(places: list[list[float]]) -> str:
    return ", ".join(" ".join(map(repr, place)) for place in places)


def _at(values: Sequence[Any], index: int, otherwise: object) -> Any:  # noqa: ANN401 - what JSON holds
    return values[index] if index < len(values) else otherwise


def _not_a_measurement(payload: bytes) -> InputError:
    return InputError("a recorded measurement is none", got=repr(payload[:60]))
