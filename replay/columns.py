"""The columns of a table of measurements, and what each can hold."""

from collections.abc import Mapping
from enum import Enum, auto
from typing import Any, Final

from aerodft.adapters.codec.wire import LATEST_NS

LARGEST_NUMBER: Final = 1e100
"""In a table: its square is finite."""
_COUNTS: Final = {"pixels_px": 2, "enu_m": 3}  # of a vector
_MOST_DEG: Final = {"lat_deg": 90, "lon_deg": 360, "lat_2_deg": 90, "lon_2_deg": 360}
_NEEDED: Final = ("name", "kind", "status", "unit")


class Kind(Enum):
    """What a column holds."""

    TEXT = auto()
    INTEGER = auto()
    NUMBER = auto()
    TIME = auto()  # ISO 8601, UTC
    NUMBERS = auto()  # a list, one for each point
    VECTORS = auto()  # a list of lists, one for each point


COLUMNS: Final[Mapping[str, Kind]] = {
    "time_utc": Kind.TIME,
    "stamp_ns": Kind.INTEGER,
    "name": Kind.TEXT,
    "kind": Kind.TEXT,
    "status": Kind.TEXT,
    "value": Kind.NUMBER,
    "unit": Kind.TEXT,
    "std": Kind.NUMBER,
    "ci95_low": Kind.NUMBER,
    "ci95_high": Kind.NUMBER,
    "ellipse95_major_m": Kind.NUMBER,
    "ellipse95_minor_m": Kind.NUMBER,
    "ellipse95_azimuth_deg": Kind.NUMBER,
    "reasons": Kind.TEXT,
    "image": Kind.INTEGER,
    "pixels_px": Kind.VECTORS,
    "std_px": Kind.NUMBER,
    "lat_deg": Kind.NUMBER,
    "lon_deg": Kind.NUMBER,
    "alt_msl_m": Kind.NUMBER,
    "range_m": Kind.NUMBER,
    "lat_2_deg": Kind.NUMBER,
    "lon_2_deg": Kind.NUMBER,
    "alt_2_msl_m": Kind.NUMBER,
    "range_2_m": Kind.NUMBER,
    "geo_wkt": Kind.TEXT,
    "enu_m": Kind.VECTORS,
    "ranges_m": Kind.NUMBERS,
    "cov_east_m2": Kind.NUMBER,
    "cov_east_north_m2": Kind.NUMBER,
    "cov_north_m2": Kind.NUMBER,
    "height_agl_m": Kind.NUMBER,
    "height_source": Kind.TEXT,
    "height_datum": Kind.TEXT,
    "tilt_deg": Kind.NUMBER,
    "roll_deg": Kind.NUMBER,
    "heading_deg": Kind.NUMBER,
    "height_agl_std_m": Kind.NUMBER,
    "tilt_std_deg": Kind.NUMBER,
    "pan_std_deg": Kind.NUMBER,
    "roll_std_deg": Kind.NUMBER,
    "heading_std_deg": Kind.NUMBER,
    "camera_lat_deg": Kind.NUMBER,
    "camera_lon_deg": Kind.NUMBER,
    "height_age_s": Kind.NUMBER,
    "telemetry_age_s": Kind.NUMBER,
    "camera": Kind.TEXT,
    "model": Kind.TEXT,
    "calibration": Kind.TEXT,
    "config": Kind.TEXT,
    "software": Kind.TEXT,
}
"""``docs/tables.md`` says what each is."""


def check_row(row: dict[str, object]) -> None:
    """Refuse what a column cannot hold.

    Raises:
        TypeError, ValueError: It is no number, text or list, as ``COLUMNS`` has it; or one that cannot be.
    """
    for name, kind in COLUMNS.items():
        value = row[name]
        if value is not None:
            _CHECKS[kind](value, _COUNTS.get(name))
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


def _text(value: Any, _: int | None) -> None:  # noqa: ANN401 - what JSON holds
    if not isinstance(value, str):
        raise TypeError("no text")


def _integer(value: Any, _: int | None) -> None:  # noqa: ANN401 - what JSON holds
    if type(value) is not int or abs(value) > LATEST_NS:
        raise TypeError("no integer")


def _number(value: Any, _: int | None) -> None:  # noqa: ANN401 - what JSON holds
    if type(value) not in {float, int} or not abs(value) <= LARGEST_NUMBER:
        raise TypeError("no number")


def _numbers(value: Any, count: int | None) -> None:  # noqa: ANN401 - what JSON holds
    if not isinstance(value, list) or len(value) != (count or len(value)):
        raise TypeError("no list of so many")
    for each in value:
        if each is not None:
            _number(each, None)


def _vectors(value: Any, count: int | None) -> None:  # noqa: ANN401 - what JSON holds
    if not isinstance(value, list):
        raise TypeError("no list")
    for each in value:
        _numbers(each, count)


_CHECKS: Final = {
    Kind.TEXT: _text,
    Kind.TIME: _text,
    Kind.INTEGER: _integer,
    Kind.NUMBER: _number,
    Kind.NUMBERS: _numbers,
    Kind.VECTORS: _vectors,
}
