"""Layouts of flight tables: which column of which tool is what, in which unit."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import Final

from aerodft.adapters.timestamps import iso_to_unix_ns

_FOOT_M: Final = 0.3048
_RAD_DEG: Final = math.degrees(1)

UNITS: Final[dict[str, tuple[str, float]]] = {
    "elapsed_s": ("elapsed_s", 1.0),
    "elapsed_ms": ("elapsed_s", 1e-3),
    "unix_s": ("unix_s", 1.0),
    "unix_ms": ("unix_s", 1e-3),
    "unix_us": ("unix_s", 1e-6),
    "lat_deg": ("lat_deg", 1.0),
    "lat_e7": ("lat_deg", 1e-7),
    "lon_deg": ("lon_deg", 1.0),
    "lon_e7": ("lon_deg", 1e-7),
    "height_home_m": ("height_home_m", 1.0),
    "height_home_mm": ("height_home_m", 1e-3),
    "height_home_ft": ("height_home_m", _FOOT_M),
    "height_ground_m": ("height_ground_m", 1.0),
    "height_ground_ft": ("height_ground_m", _FOOT_M),
    "yaw_deg": ("yaw_deg", 1.0),
    "pitch_deg": ("pitch_deg", 1.0),
    "roll_deg": ("roll_deg", 1.0),
    "yaw_rad": ("yaw_deg", _RAD_DEG),
    "pitch_rad": ("pitch_deg", _RAD_DEG),
    "roll_rad": ("roll_deg", _RAD_DEG),
    "gimbal_yaw_deg": ("gimbal_yaw_deg", 1.0),
    "gimbal_pitch_deg": ("gimbal_pitch_deg", 1.0),
    "gimbal_roll_deg": ("gimbal_roll_deg", 1.0),
    "gimbal_yaw_decideg": ("gimbal_yaw_deg", 0.1),
    "gimbal_pitch_decideg": ("gimbal_pitch_deg", 0.1),
    "gimbal_roll_decideg": ("gimbal_roll_deg", 0.1),
}
"""What a column may be, by its name with its unit: the quantity, and what makes its unit of a number."""

UTC, LOCAL = "utc", "local_time"
"""Columns of date and time as text: UTC unless they state an offset, or of an unknown zone."""

COLUMN_KEYS: Final = (UTC, LOCAL, *UNITS)

_AIRDATA: Final = {
    "time(millisecond)": "elapsed_ms",
    "datetime(utc)": UTC,
    "latitude": "lat_deg",
    "longitude": "lon_deg",
    "height_above_takeoff(feet)": "height_home_ft",
    "height_above_takeoff(meters)": "height_home_m",
    "height_above_takeoff(m)": "height_home_m",
    "compass_heading(degrees)": "yaw_deg",
    "pitch(degrees)": "pitch_deg",
    "roll(degrees)": "roll_deg",
    "gimbal_heading(degrees)": "gimbal_yaw_deg",
    "gimbal_pitch(degrees)": "gimbal_pitch_deg",
    "gimbal_roll(degrees)": "gimbal_roll_deg",
}
_LITCHI: Final = {
    "time(millisecond)": "elapsed_ms",
    "datetime(utc)": UTC,
    "latitude": "lat_deg",
    "longitude": "lon_deg",
    "altitude(m)": "height_home_m",  # Litchi's altitude is above take-off
    "altitude(feet)": "height_home_ft",
    "pitch(deg)": "pitch_deg",
    "roll(deg)": "roll_deg",
    "yaw(deg)": "yaw_deg",
    "gimbalpitchraw": "gimbal_pitch_decideg",
    "gimbalrollraw": "gimbal_roll_decideg",
    "gimbalyawraw": "gimbal_yaw_decideg",
}
_DJI_LOG: Final = {
    "custom.updatetime": LOCAL,
    "custom.updatetime [local]": LOCAL,
    "custom.updatetime [utc]": UTC,
    "osd.latitude": "lat_deg",
    "osd.longitude": "lon_deg",
    "osd.height [m]": "height_home_m",  # above take-off; OSD.altitude is rounded, and of no stated datum
    "osd.height [ft]": "height_home_ft",
    "osd.pitch": "pitch_deg",
    "osd.roll": "roll_deg",
    "osd.yaw": "yaw_deg",
    "gimbal.pitch": "gimbal_pitch_deg",
    "gimbal.roll": "gimbal_roll_deg",
    "gimbal.yaw": "gimbal_yaw_deg",
}
_MESSAGES: Final[dict[str, dict[str, str]]] = {
    "mavlink_attitude_t": {"roll": "roll_rad", "pitch": "pitch_rad", "yaw": "yaw_rad"},
    "mavlink_global_position_int_t": {"lat": "lat_e7", "lon": "lon_e7", "relative_alt": "height_home_mm"},
    "mavlink_system_time_t": {"time_unix_usec": "unix_us"},
}
"""Fields of Mission Planner's rows, each of which names its message and its fields."""

_DELIMITERS: Final = (",", ";", "\t")
_MISSION_PLANNER: Final = re.compile(r"^\d{4}-\d{2}-\d{2}T[\d:.]+,F[DE],.*,mavlink_\w+_t,", re.IGNORECASE)
MISSION_PLANNER: Final = "Mission Planner"


@dataclass(frozen=True, slots=True)
class Layout:
    """Where a table's values stand.

    Attributes:
        tool: Who wrote it.
        delimiter: Between columns.
        columns: Place of each column by its key of ``COLUMN_KEYS``; empty where rows name their own fields.
    """

    tool: str
    delimiter: str
    columns: Mapping[str, int]

    def cells(self, row: bytes) -> list[str]:
        """The texts of a row's columns."""
        text = row.decode("utf-8-sig", "replace").strip("\r\n\0")
        try:
            return next(csv.reader([text.replace("\n", " ")], delimiter=self.delimiter), [])
        except csv.Error:
            return []

    def values(self, cells: Sequence[str]) -> dict[str, float]:
        """Quantities of a row by name, those that are numbers."""
        found: dict[str, float] = {}
        for key, text in self._stated(cells).items():
            value = self._number(text)
            if key in UNITS and value is not None:
                name, unit = UNITS[key]
                found[name] = value * unit
        return found

    def time_ns(self, cells: Sequence[str]) -> int | None:
        """The date and time that a row states, as if it were UTC; None where it states none."""
        if not self.columns:
            return _time_ns(cells[0]) if cells else None
        place = self.columns.get(UTC, self.columns.get(LOCAL))
        return None if place is None or place >= len(cells) else _time_ns(cells[place])

    def _stated(self, cells: Sequence[str]) -> dict[str, str]:
        if self.columns:
            return {key: cells[place] for key, place in self.columns.items() if place < len(cells)}
        at = next((k for k, cell in enumerate(cells) if cell.strip() in _MESSAGES), None)
        if at is None:
            return {}
        fields = _MESSAGES[cells[at].strip()]
        pairs = zip(cells[at + 1 :: 2], cells[at + 2 :: 2], strict=False)
        return {fields[name.strip()]: text for name, text in pairs if name.strip() in fields}

    def _number(self, text: str) -> float | None:
        text = text.strip()
        if self.delimiter != ",":
            text = text.replace(",", ".")
        try:
            value = float(text)
        except ValueError:
            return None
        return value if math.isfinite(value) and "_" not in text else None


def layout_of(head: str) -> Layout | None:
    """The layout of a known tool's table by its first line; None of any other text."""
    if _MISSION_PLANNER.match(head):
        return Layout(MISSION_PLANNER, ",", {})
    names, delimiter = _names(head)
    for tool, columns, marks in (
        ("AirData", _AIRDATA, "height_above_takeoff"),
        ("a DJI flight log", _DJI_LOG, "osd.latitude"),
        ("Litchi", _LITCHI, "ishomesafe|gimbalpitchraw|datetime\\(local\\)"),
    ):
        if any(re.match(marks, name) for name in names):
            found = {key: k for k, name in enumerate(names) if (key := columns.get(name))}
            return Layout(tool, delimiter, found)
    return None


def mapped_layout(head: str, columns: Mapping[str, str]) -> tuple[Layout, list[str]]:
    """A layout by a station's own names of columns, and those that are not there."""
    names, delimiter = _names(head)
    missing = [name for name in columns.values() if name.strip().lower() not in names]
    places = {key: names.index(name.strip().lower()) for key, name in columns.items() if name not in missing}
    return Layout("a table", delimiter, places), missing


def _names(head: str) -> tuple[list[str], str]:
    delimiter = max(_DELIMITERS, key=head.count)
    cells = next(csv.reader([head], delimiter=delimiter), [])
    return [cell.strip().lower() for cell in cells], delimiter


def _time_ns(text: str) -> int | None:
    """A date and time, also with slashes."""
    try:
        return iso_to_unix_ns(text.replace("/", "-"), default_offset=timedelta())
    except ValueError:
        return None
