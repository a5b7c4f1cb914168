"""Cues of a drone's subtitles: found in a text, and read by the words of every known dialect.

A cue is read by its keys, wherever they stand: firmware moves them about, misspells them and puts blank lines between
them. A number counts where its end is there too, so that what a cut leaves of one is not taken for it.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from typing import Final

from aerodft.adapters.telemetry.tracks import MAX_HEIGHT_M
from aerodft.adapters.timestamps import datetime_to_unix_ns

_ARROW: Final = rb"[ \t]*\d{1,4}:\d{2}:\d{2}[,.]\d{1,3}[ \t]*-->"
_DATE: Final = rb"[ \t]*\d{4}[.-]\d{1,2}[.-]\d{1,2}[ T]\d"
_TIMED_START: Final = re.compile(rb"^(?:\xef\xbb\xbf)?[ \t]*\d{1,9}[ \t]*\r?\n(?=" + _ARROW + rb")", re.MULTILINE)
_DATED_START: Final = re.compile(rb"^(?:\xef\xbb\xbf)?[ \t]*\d{1,9}[ \t]*\r?\n(?=" + _DATE + rb")", re.MULTILINE)
_START_TIME: Final = re.compile(r"(\d{1,4}):(\d{2}):(\d{2})[,.](\d{1,3})[ \t]*-->")
_CLOCK: Final = re.compile(
    r"(?<!\d)(\d{4})[.-](\d{1,2})[.-](\d{1,2})[ T](\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d{3})(?:,(\d{3}))?)?(?!\d)"
)

_NUMBER: Final = r"[-+]?\d+(?:\.\d+)?"
_NAMES: Final = (
    *("latitude", "longitude", "longtitude", "rel_alt", "abs_alt", "altitude", "gb_yaw", "gb_pitch", "gb_roll"),
    *("drone_yaw", "focal_len", "dzoom_ratio", "dzoom", "FrameCnt", "SrtCnt"),
)
_KEY: Final = re.compile(
    rf"(?<![A-Za-z_])({'|'.join(_NAMES)})[ \t]*:(?:[ \t]*({_NUMBER})(?=[ \t]*\]|[ \t]*,(?!\d)|[ \t]+[A-Za-z_]))?"
)
_BRACKET: Final = r"[ \t]*\(([^()\n]*)\)"
_GPS: Final = re.compile(r"(?<![A-Za-z])GPS(?:" + _BRACKET + ")?")
_HOME: Final = re.compile(r"(?<![A-Za-z])HOME" + _BRACKET)
_GIMBAL: Final = re.compile(r"(?<![A-Za-z])G\.PRY(?:" + _BRACKET + ")?")
_HEIGHTS: Final = {
    "BAROMETER": re.compile(rf"(?<![A-Za-z])BAROMETER[ \t]*:(?:[ \t]*({_NUMBER})(?:M(?=\s|\Z)|(?=\s)))?"),
    "Hb": re.compile(rf"(?<![A-Za-z])Hb[ \t]*:(?:[ \t]*({_NUMBER})(?=\s))?"),
    "H": re.compile(rf"(?<![A-Za-z.])H[ \t]+(?:({_NUMBER})m(?=[,\s]))?"),
}
_DISTANCE: Final = re.compile(rf"(?<![A-Za-z.])D[ \t]+({_NUMBER})m(?=[,\s])")
_BODY_YAW: Final = re.compile(rf"\bDrone[ \t]*:[ \t]*Yaw[ \t]*:[ \t]*({_NUMBER})(?=[ \t]*[\],])")
_PART: Final = re.compile(rf"[^-+\d]*({_NUMBER})\s*([A-Za-z]*)[^\d]*")

AGAINST_WAY_HOME: Final = "GPS: the distance to HOME contradicts the order of latitude and longitude"

_NO_FIX: Final = re.compile(r"\bn/?a\b", re.IGNORECASE)

_MOST_SATELLITES: Final = 60  # of all systems at once; receivers of such drones track some 40
_MAX_LAT_DEG, _MAX_LON_DEG = 90.0, 180.0
_MAX_ANGLE_DEG: Final = 360.0
_MIN_PITCH_DEG, _MAX_PITCH_DEG = -180.0, 180.0
_M_PER_DEG: Final = 111_320.0
_NEAR_HOME_M: Final = 50.0  # closer, four decimals of a degree (11 m) do not tell the two orders apart
_SAME_SHARE, _SAME_M = 0.1, 20.0  # by which two distances of one place may differ: rounding, and the slant
_FOCAL_UNIT_MM, _ZOOM_UNIT = 0.1, 1e-4  # of the encodings as integers: 240 is 24 mm, 10000 is once


@dataclass(frozen=True, slots=True, kw_only=True)
class Cue:
    """What one cue says; None for what it does not.

    Attributes:
        start_s: Since the video's first image.
        clock_ns: The drone's local time, as if it were UTC.
        count: The cue's own number of the image.
        lat_lon_deg: WGS84.
        height_home_m: Above the take-off point.
        height_key: The word that the height stood behind.
        altitude_m: An absolute height, whose datum nobody states.
        gimbal_deg: Yaw from north, pitch (-90 straight down) and roll of the camera.
        body_yaw_deg: The drone's own.
        focal_mm: 35 mm-equivalent focal length.
        zoom: Digital zoom, from 1 on.
        faults: What could not be read, or was refused.
    """

    start_s: float | None = None
    clock_ns: int | None = None
    count: int | None = None
    lat_lon_deg: tuple[float, float] | None = None
    height_home_m: float | None = None
    height_key: str = ""
    altitude_m: float | None = None
    gimbal_deg: tuple[float, float, float] | None = None
    body_yaw_deg: float | None = None
    focal_mm: float | None = None
    zoom: float | None = None
    faults: tuple[str, ...] = ()


def find_cues(text: bytes) -> list[tuple[int, int]]:
    """Start and length of each cue in a file: from its number to the next cue's.

    A blank line or a number alone ends no cue: a time must follow it, or a date in a file without times.
    """
    starts = [match.start() for match in _TIMED_START.finditer(text)]
    if not starts:
        starts = [match.start() for match in _DATED_START.finditer(text)]
    return [(at, stop - at) for at, stop in pairwise([*starts, len(text)])]


@dataclass(slots=True)
class _Reader:
    """One cue's text and its numbers by key."""

    text: str
    gps_lon_first: bool | None
    numbers: dict[str, str] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    def read_keys(self) -> None:
        """Collect ``key: number``; a key without a whole number, or with two different ones, is a fault."""
        for key, number in _KEY.findall(self.text):
            name = "longitude" if key == "longtitude" else key
            if not number:
                self.faults.append(f"{key} is cut or no number")
                self.numbers[name] = ""
            elif self.numbers.setdefault(name, number) != number:
                self.faults.append(f"{key} stands there twice")
                self.numbers[name] = ""

    def value(self, name: str) -> float | None:
        """A number by key; None where it is not there or not whole."""
        text = self.numbers.get(name)
        return float(text) if text else None

    def fault(self, what: str) -> None:
        self.faults.append(what)


def read_cue(data: bytes, *, gps_lon_first: bool | None = None) -> Cue:
    """Read one cue.

    Args:
        data: From its number to the next one's.
        gps_lon_first: Whether ``GPS(a, b)`` has the longitude first; None to tell it by evidence.
    """
    reader = _Reader(data.decode("utf-8", "replace"), gps_lon_first)
    reader.read_keys()
    key, height_m = _height(reader)
    altitude_m = reader.value("altitude")
    count = reader.value("FrameCnt") if "FrameCnt" in reader.numbers else reader.value("SrtCnt")
    body_yaw = _BODY_YAW.search(reader.text)
    return Cue(
        start_s=_start_s(reader.text),
        clock_ns=_clock_ns(reader.text),
        count=None if count is None else int(count),
        lat_lon_deg=_place(reader),
        height_home_m=height_m,
        height_key=key,
        altitude_m=reader.value("abs_alt") if altitude_m is None else altitude_m,
        gimbal_deg=_gimbal(reader),
        body_yaw_deg=float(body_yaw[1]) if body_yaw else reader.value("drone_yaw"),
        focal_mm=_scaled(reader.numbers.get("focal_len"), _FOCAL_UNIT_MM),
        zoom=_scaled(reader.numbers.get("dzoom_ratio") or reader.numbers.get("dzoom"), _ZOOM_UNIT),
        faults=tuple(dict.fromkeys(reader.faults)),
    )


def _start_s(text: str) -> float | None:
    match = _START_TIME.search(text)
    if match is None:
        return None
    hours, minutes, seconds, fraction = match.groups()
    return int(hours) * 3600 + int(minutes) * 60 + int(seconds) + int(fraction.ljust(3, "0")) / 1000


def _clock_ns(text: str) -> int | None:
    match = _CLOCK.search(text)
    if match is None:
        return None
    *calendar, milliseconds, microseconds = match.groups()
    try:
        when = datetime(*map(int, calendar), tzinfo=UTC)  # type: ignore[misc,arg-type]
    except ValueError:
        return None
    return datetime_to_unix_ns(when) + int(milliseconds or 0) * 1_000_000 + int(microseconds or 0) * 1000


def _height(reader: _Reader) -> tuple[str, float | None]:
    """The word of the height above the take-off point, and its value; two words that differ are a fault."""
    found: dict[str, float] = {}
    relative = reader.value("rel_alt")
    if relative is not None:
        found["rel_alt"] = relative
    for key, pattern in _HEIGHTS.items():
        matches = pattern.findall(reader.text)
        if any(not each for each in matches):
            reader.fault(f"{key} is cut or no number")
        values = {float(each) for each in matches if each}
        if len(values) > 1:
            reader.fault(f"{key} stands there twice")
        elif values:
            found[key] = values.pop()
    if len(found) > 1:
        reader.fault(f"heights by {' and '.join(found)}: two cues in one")
        return "", None
    for key, value_m in found.items():
        if abs(value_m) <= MAX_HEIGHT_M:
            return key, value_m
        reader.fault(f"{key} is no height")
    return "", None


def _place(reader: _Reader) -> tuple[float, float] | None:
    """Latitude and longitude (degrees); None where there are none, or it is not known which is which."""
    lat, lon = reader.value("latitude"), reader.value("longitude")
    brackets = [each for each in _GPS.findall(reader.text) if each]
    if len(set(brackets)) > 1 or (brackets and lat is not None):
        reader.fault("two places: two cues in one")
        return None
    if brackets:
        both = _ordered(reader, brackets[0])
        if both is None:
            return None
        lat, lon = both
    elif lat is None or lon is None:
        if lat is not None or lon is not None or _GPS.search(reader.text):
            reader.fault("half of a place")
        return None
    if lat == 0 and lon == 0:
        reader.fault("no position yet")
        return None
    if abs(lat) > _MAX_LAT_DEG or abs(lon) > _MAX_LON_DEG:
        reader.fault("no place on Earth")
        return None
    return lat, lon


def _parts(text: str) -> list[tuple[float, str]] | None:
    """Numbers and units between commas; None where something is neither."""
    matches = [_PART.fullmatch(part) for part in text.split(",")]
    return None if None in matches else [(float(each[1]), each[2]) for each in matches if each is not None]


def _ordered(reader: _Reader, text: str) -> tuple[float, float] | None:
    """Latitude and longitude of ``GPS(a, b, c)``, by evidence: the range, the third number's kind, the way home.

    Drones whose third number counts satellites write the longitude first, those that write ``0.0M`` the latitude. A
    stated order stands above the third number. A number beyond 90 is a longitude.
    """
    parts = _parts(text)
    if _NO_FIX.search(text):
        reader.fault("no position yet")
        return None
    if parts is None or len(parts) < 2:  # noqa: PLR2004 - of two coordinates
        reader.fault("GPS is cut or no place")
        return None
    first, second = parts[0][0], parts[1][0]
    is_lon_first = _is_lon_first(parts) if reader.gps_lon_first is None else reader.gps_lon_first
    if is_lon_first is None:
        reader.fault("GPS: which number is the latitude is not known (telemetry.gps_order states it)")
        return None
    lat, lon = (second, first) if is_lon_first else (first, second)
    if reader.gps_lon_first is not None and abs(lat) > _MAX_LAT_DEG:
        reader.fault("GPS: in the stated order (telemetry.gps_order) the latitude is beyond 90 deg")
        return None
    if _contradicts_way_home(reader.text, lat, lon, is_swapped=is_lon_first):
        reader.fault(AGAINST_WAY_HOME)
        return None
    return lat, lon


def _is_lon_first(parts: Sequence[tuple[float, str]]) -> bool | None:
    """Order of coordinates by a number beyond 90, else by the kind of the third number; None where that is unknown."""
    first, second = abs(parts[0][0]), abs(parts[1][0])
    if max(first, second) > _MAX_LAT_DEG:
        return first > _MAX_LAT_DEG
    value, unit = parts[2] if len(parts) > 2 else (math.nan, "")  # noqa: PLR2004 - of three numbers
    if unit.upper() == "M":
        return False
    return True if not unit and value.is_integer() and 0 <= value <= _MOST_SATELLITES else None


def _contradicts_way_home(text: str, lat: float, lon: float, *, is_swapped: bool) -> bool:
    """Whether the stated distance to HOME fits the other order of the coordinates, and not this one."""
    home, stated = _HOME.search(text), _DISTANCE.search(text)
    parts = None if home is None else _parts(home[1])
    if parts is None or len(parts) < 2 or stated is None or float(stated[1]) < _NEAR_HOME_M:  # noqa: PLR2004
        return False
    home_lat, home_lon = (parts[1][0], parts[0][0]) if is_swapped else (parts[0][0], parts[1][0])
    stated_m = float(stated[1])
    own_m = _distance_m(lat - home_lat, lon - home_lon, lat)
    other_m = _distance_m(lon - home_lon, lat - home_lat, lon)
    slack_m = _SAME_SHARE * stated_m + _SAME_M
    return abs(own_m - stated_m) > slack_m >= abs(other_m - stated_m)


def _distance_m(north_deg: float, east_deg: float, lat_deg: float) -> float:
    return _M_PER_DEG * math.hypot(north_deg, east_deg * math.cos(math.radians(lat_deg)))


def _gimbal(reader: _Reader) -> tuple[float, float, float] | None:
    """Yaw, pitch and roll of the camera (degrees): ``gb_*``, or ``G.PRY``, whose order is pitch, roll, yaw."""
    found = [reader.value(key) for key in ("gb_yaw", "gb_pitch", "gb_roll")]
    brackets = _GIMBAL.findall(reader.text)
    if brackets and any(each is not None for each in found):
        reader.fault("two attitudes of the camera: two cues in one")
        return None
    if brackets:
        parts = _parts(brackets[0])
        if parts is None or len(parts) != 3 or len(set(brackets)) > 1:  # noqa: PLR2004 - of three angles
            reader.fault("G.PRY is cut or no angles")
            return None
        pitch, roll, yaw = (value for value, _ in parts)
    elif any(each is None for each in found):
        if any(each is not None for each in found):
            reader.fault("a part of the camera's angles")
        return None
    else:
        yaw, pitch, roll = (float(each or 0.0) for each in found)
    if not _MIN_PITCH_DEG <= pitch <= _MAX_PITCH_DEG or max(abs(yaw), abs(roll)) > _MAX_ANGLE_DEG:
        reader.fault("impossible angles of the camera")
        return None
    return yaw, pitch, roll


def _scaled(text: str | None, unit: float) -> float | None:
    """A number that is literal with a decimal point, and counted in units without one; None where it is none."""
    if not text:
        return None
    value = float(text) if "." in text else float(text) * unit
    return value if value > 0 else None
