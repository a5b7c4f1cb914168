"""Lists of landmarks in one image: CSV files with a header, and ground control points as OpenDroneMap takes them.

The first line of the latter (``gcp_list.txt``) is the projection; each of the others ``geo_x geo_y geo_z im_x im_y
image_name [gcp_name] [extras]`` (https://docs.opendronemap.org/gcp/). Pixel (0, 0) is the centre of the top-left one.
"""

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PureWindowsPath
from typing import Any, Final, TypeAlias

from pyproj import CRS
from pyproj.exceptions import CRSError

from aerodft.adapters.config.evidence.evidence_tables import GEO_KEYS, UNKNOWN
from aerodft.adapters.config.evidence.local_frame import checked_crs, takes_degrees
from aerodft.adapters.config.tables import GEO, LOCAL
from aerodft.adapters.files import content_looks_like
from aerodft.errors import ConfigError, counted

_Rows: TypeAlias = list[tuple[str, dict[str, Any]]]

_PROJECTION = re.compile(r"['\"]?(epsg:|\+|wgs84\b)", re.IGNORECASE)
_EPSG = re.compile(r"(?:\+init=)?epsg:\s*(\d+)", re.IGNORECASE)
_UTM = re.compile(r"wgs84\s+utm\s+(\d{1,2})\s*([ns])", re.IGNORECASE)
_NUMBERS = 5  # at a line's begin
_IMAGE_AND_NAME = re.compile(r"\"?(.+?\.\w{2,4}|\S+)\"?(?:\s+(\S+).*)?")  # the image's may have spaces
_MOST_NAMES = 6

_SEPARATORS = ",;\t"
_PIXEL = (("u", "v"), ("u_px", "v_px"), ("x", "y"), ("x_px", "y_px"), ("pixel_x", "pixel_y"), ("px", "py"))
_METRES = (
    ("X", "Y", "Z"),
    ("X_m", "Y_m", "Z_m"),
    ("x", "y", "z"),
    ("x_m", "y_m", "z_m"),
    ("east", "north", "up"),
    ("east_m", "north_m", "up_m"),
    ("easting", "northing", "height"),
    ("easting_m", "northing_m", "height_m"),
)
_DEGREES = (("lat", "lon", "alt"), GEO_KEYS, ("latitude", "longitude", "altitude"))
_NAME = ("name", "id", "label", "point")
_STDS = ("std_px", "std_m")
_WANTED = "columns u, v (pixels) and X, Y, Z (metres) or lat, lon, alt; name, std_px and std_m if known"
_MOST_ROWS = 10_000  # a camera needs some dozens
_MOST_SHOWN: Final = 60  # letters of a header: one line of a terminal
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")


@dataclass(frozen=True, slots=True)
class LandmarkList:
    """Landmarks in one image.

    Attributes:
        crs: Their coordinate reference system.
        image: The image's name, where the list says it.
        rows: Of each landmark its line in words, and it as its table in a TOML file.
    """

    crs: str
    image: str | None
    rows: _Rows


def is_gcp_list(text: str) -> bool:
    """Whether a text begins with a projection, or with a line of one column above a point, as no CSV file does."""
    head, point, *_ = [*(line for _, line in _stated_lines(text)), "", ""]
    cells = point.split()
    is_point = len(cells) > _NUMBERS and all(map(_is_number, cells[:_NUMBERS]))
    return _PROJECTION.match(head) is not None or (is_point and not any(each in head for each in _SEPARATORS))


def read_landmarks(text: str, image: str | None = None) -> LandmarkList:
    """The landmarks of a list.

    Args:
        text: A list of ground control points; or CSV: columns apart by commas, semicolons or tabs, decimal points,
            ``?`` for a component of a place that is not known, comments after ``#`` at a line's start.
        image: Of ground control points: name of the image whose points are wanted; None where they are in one only.

    Raises:
        ConfigError: A projection without an EPSG code, several images and none of them named, no or a wrong header, a
            row of another length, or a cell that is no number.
    """
    return _gcp_list(text, image) if is_gcp_list(text) else _csv(text)


def _stated_lines(text: str) -> list[tuple[int, str]]:
    """Lines of a list of ground control points that are no comment, with their numbers from 1."""
    lines = ((number, line.strip()) for number, line in enumerate(text.splitlines(), start=1))
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def _gcp_list(text: str, image: str | None) -> LandmarkList:
    (number, head), *lines = _stated_lines(text)
    crs = _crs(head.partition(" #")[0].strip(" '\""), number)
    in_degrees = takes_degrees(crs)
    by_image: dict[str, _Rows] = {}
    for number, line in lines:
        cells = line.partition(" #")[0].split(maxsplit=_NUMBERS)
        if len(cells) <= _NUMBERS:
            got, expected = counted(len(cells), "column"), "geo_x geo_y geo_z im_x im_y image_name, apart by spaces"
            raise ConfigError(f"line {number}", got=got, expected=expected)
        x, y, height, u, v = (_gcp_number(cell, number) for cell in cells[:_NUMBERS])
        place = dict(zip(GEO_KEYS, (y, x, height), strict=True)) if in_degrees else {"position_m": [x, y, height]}
        found = _IMAGE_AND_NAME.fullmatch(cells[_NUMBERS])
        picture, name = ("", None) if found is None else found.groups()
        row = {**({} if name is None else {"name": name}), "pixel": [u, v], **place}
        by_image.setdefault(PureWindowsPath(picture).name, []).append((f"line {number}", row))
    chosen = _chosen(by_image, image)
    return LandmarkList(crs, chosen, by_image[chosen])


def _crs(head: str, number: int) -> str:
    utm, epsg = _UTM.fullmatch(head), _EPSG.match(head)
    if utm is not None:
        return checked_crs(f"EPSG:{32600 + 100 * (utm[2].lower() == 's') + int(utm[1])}")
    if epsg is not None:
        return checked_crs(f"EPSG:{epsg[1]}")
    try:
        projection = CRS.from_user_input(head)
    except CRSError:
        raise ConfigError(f"line {number}", got=f'"{head}"', expected="a projection like EPSG:32633") from None
    # An ellipsoid alone is that of many datums: GRS80 in UTM zone 16 would be Costa Rica's.
    code = projection.to_epsg() if "+datum=" in head or not head.startswith("+") else None
    return checked_crs(head if code is None else f"EPSG:{code}")


def _gcp_number(cell: str, number: int) -> float | str:
    if cell.lower() == "nan":
        return UNKNOWN
    try:
        return float(cell)
    except ValueError:
        raise ConfigError(f"line {number}", got=f'"{cell}"', expected="a number") from None


def _chosen(by_image: dict[str, _Rows], image: str | None) -> str:
    if not by_image:
        raise ConfigError("holds no points", got="a projection only", expected="a line for each point")
    counts = sorted(((name, len(rows)) for name, rows in by_image.items()), key=lambda each: -each[1])
    listed = ", ".join(f"{name} ({count})" for name, count in counts[:_MOST_NAMES])
    listed += ", ..." if len(counts) > _MOST_NAMES else ""
    if image is None and len(counts) > 1:
        hint = "name the one whose camera is meant by `image`"
        raise ConfigError("points of several images", got=listed, expected="one image", hint=hint)
    chosen = counts[0][0] if image is None else PureWindowsPath(image).name
    if chosen not in by_image:
        raise ConfigError("image", got=f'"{chosen}"', expected=f"one of {listed}")
    return chosen


def _csv(text: str) -> LandmarkList:
    lines = _lines(text)
    first = next(lines, None)
    if first is None:
        raise ConfigError("no header", got=content_looks_like(text.encode()), expected=_WANTED)
    header = [cell.strip() for cell in first[1]]
    columns = _columns(header)
    rows: _Rows = []
    for number, cells in lines:
        if len(rows) == _MOST_ROWS:
            expected = f"{_MOST_ROWS} landmarks at most"
            raise ConfigError("too many rows", got="more", expected=expected, hint="take some of its rows")
        rows.append((f"line {number}", _landmark(header, columns, cells, number)))
    if not rows:
        raise ConfigError("holds no points", got="a header only", expected="a row for each landmark")
    return LandmarkList(LOCAL if "position_m" in columns else GEO, None, rows)


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Lines that say something, with their numbers from 1."""
    head = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=max(_SEPARATORS, key=head.count), strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells) and not cells[0].startswith("#"):
                yield reader.line_num, cells
    except csv.Error as error:
        raise ConfigError(f"line {reader.line_num}: not CSV: {error}", hint="correct that line") from None


def _columns(header: list[str]) -> dict[str, tuple[int, ...]]:
    """Which columns say what, by the keys of a landmark's table; those of a place in degrees as ``GEO_KEYS``."""
    twice = next((name for name in header if name and header.count(name) > 1), None)
    if twice is not None:
        raise ConfigError("the header", got=f'"{twice}" twice', expected="each column once")
    # Upper and lower case tell pixels from metres in "x, y, X, Y, Z"; else it means nothing.
    is_cased = {"x", "y", "X", "Y"} <= set(header)
    names = header if is_cased else [name.lower() for name in header]

    def find(ways: Sequence[tuple[str, ...]], taken: tuple[int, ...] = ()) -> tuple[int, ...]:
        wanted = (way if is_cased else tuple(name.lower() for name in way) for way in ways)
        found = (tuple(names.index(name) for name in way) for way in wanted if set(way) <= set(names))
        return next((each for each in found if not set(each) & set(taken)), ())

    metres, degrees = find(_METRES), find(_DEGREES)
    place = metres or degrees
    pixel = find(_PIXEL, place)
    if not (pixel and place):
        missing = "places" if pixel else "pixels" if place else "pixels and places"
        got = ", ".join(header)
        got = f'"{got if len(got) <= _MOST_SHOWN else got[: _MOST_SHOWN - 3] + "..."}"'
        is_data = sum(_is_number(cell) for cell in header) > 1
        hint = "its first line is a row of data: write the columns' names above it" if is_data else ""
        raise ConfigError(f"the header names no columns with {missing}", got=got, expected=_WANTED, hint=hint)
    columns = {"name": find([(name,) for name in _NAME]), "pixel": pixel}
    columns |= {"position_m": metres} if metres else dict(zip(GEO_KEYS, ((each,) for each in degrees), strict=True))
    columns |= {key: find([(key,)]) for key in _STDS}
    used = {index for each in columns.values() for index in each}
    left = next((each for index, each in enumerate(header) if index not in used), None)
    if left is not None:
        hint = f'remove the column "{left}"' if left else "remove it"
        raise ConfigError("the header", got=f'a column "{left}"', expected=_WANTED, hint=hint)
    return columns


def _landmark(
    header: list[str], columns: dict[str, tuple[int, ...]], cells: list[str], number: int
) -> dict[str, object]:
    if len(cells) != len(header):
        is_comma = len(cells) > len(header)
        hint = "decimals take a point, and a name with a separator in it stands in quotes" if is_comma else ""
        got, expected = counted(len(cells), "cell"), f"{len(header)} as the header"
        raise ConfigError(f"line {number}", got=got, expected=expected, hint=hint)
    row: dict[str, object] = {}
    for key, places in columns.items():
        texts = [cells[index].strip() for index in places]
        if key == "name":
            row |= {"name": texts[0]} if any(texts) else {}
        elif places:
            may_be_unknown = key in {"position_m", *GEO_KEYS}
            values = [
                _number(text, f'line {number}, column "{header[index]}"', may_be_unknown=may_be_unknown)
                for index, text in zip(places, texts, strict=True)
            ]
            row[key] = values if key in {"pixel", "position_m"} else values[0]
    return row


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(text: str, label: str, *, may_be_unknown: bool) -> float | str:
    if may_be_unknown and text == UNKNOWN:
        return UNKNOWN
    or_unknown = f', or "{UNKNOWN}" where it is not known' if may_be_unknown else ""
    got = f'"{text}"' if text else "nothing"
    if _DECIMAL_COMMA.fullmatch(text):
        hint = "write decimals with a point, as it might stand for thousands too"
        raise ConfigError(label, got=got, expected=f"a number{or_unknown}", hint=hint)
    if not _is_number(text):
        raise ConfigError(label, got=got, expected=f"a number{or_unknown}")
    if not math.isfinite(float(text)) or "_" in text:
        raise ConfigError(label, got=got, expected=f"a finite number{or_unknown}")
    return float(text)
