"""Plain points in a CSV file: one landmark per row, columns by their names in the header."""

import codecs
import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from aerodft.adapters.config.evidence_tables import GEO_KEYS, UNKNOWN
from aerodft.adapters.filetype import content_looks_like
from aerodft.errors import ConfigError

_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
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
_FIRST_PRINTED = 0x20
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")


@dataclass(frozen=True, slots=True)
class Columns:
    """Which columns of a row say what, by their place in it."""

    pixel: tuple[int, ...]
    place: tuple[int, ...]
    is_geo: bool
    name: int | None
    stds: dict[str, int]


def landmark_rows(data: bytes, where: str) -> tuple[bool, list[tuple[str, dict[str, object]]]]:
    """The landmarks of a CSV file.

    Args:
        data: The file's bytes; UTF-8 or UTF-16, columns apart by commas, semicolons or tabs, decimal points, ``?`` for
            a component of a place that is not known, comments after ``#`` at a line's start.
        where: The file's name in messages.

    Returns:
        Whether places are latitudes and longitudes; and of each row its line in words, and it as a landmark's table.

    Raises:
        ConfigError: Not text, no or a wrong header, a row of another length, or a cell that is no number.
    """
    text = _text(data, where)
    lines = _lines(text, where)
    first = next(lines, None)
    if first is None:
        raise ConfigError("no header", where=where, got=content_looks_like(data), expected=_WANTED)
    header = [cell.strip() for cell in first[1]]
    columns = _columns(header, where)
    rows: list[tuple[str, dict[str, object]]] = []
    for number, cells in lines:
        if len(rows) == _MOST_ROWS:
            expected = f"{_MOST_ROWS} landmarks at most"
            raise ConfigError("too long", where=where, got="more", expected=expected, hint="take some of its rows")
        rows.append((f"line {number}", _landmark(header, columns, cells, number, where)))
    if not rows:
        raise ConfigError("holds no points", where=where, got="a header only", expected="a row for each landmark")
    return columns.is_geo, rows


def _text(data: bytes, where: str) -> str:
    encoding = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        is_text = not any(byte < _FIRST_PRINTED and byte not in b"\t\r\n" for byte in data)
        line = data.count(b"\n", 0, error.start) + 1
        what, got = "not a text file", content_looks_like(data)
        if is_text:
            what, got = f"line {line}", "letters in another encoding than UTF-8"
        raise ConfigError(what, where=where, got=got, expected="CSV", hint="save it as UTF-8") from None


def _lines(text: str, where: str) -> Iterator[tuple[int, list[str]]]:
    """Lines that say something, with their numbers from 1."""
    kept = io.StringIO(text, newline="")
    head = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    reader = csv.reader(kept, delimiter=max(_SEPARATORS, key=head.count), strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells) and not cells[0].startswith("#"):
                yield reader.line_num, cells
    except csv.Error as error:
        raise ConfigError(f"line {reader.line_num}: not CSV: {error}", where=where, hint="correct that line") from None


def _columns(header: list[str], where: str) -> Columns:
    twice = next((name for name in header if name and header.count(name) > 1), None)
    if twice is not None:
        raise ConfigError("the header", where=where, got=f'"{twice}" twice', expected="each column once")
    # Upper and lower case tell pixels from metres in "x, y, X, Y, Z"; else it means nothing.
    is_cased = {"x", "y", "X", "Y"} <= set(header)
    names = header if is_cased else [name.lower() for name in header]
    place, is_geo = next(
        (
            (found, is_geo)
            for ways, is_geo in ((_METRES, False), (_DEGREES, True))
            for way in ways
            if (found := _find(names, way if is_cased else tuple(each.lower() for each in way)))
        ),
        ((), False),
    )
    pixel = next((found for way in _PIXEL if (found := _find(names, way)) and not set(found) & set(place)), ())
    if not (pixel and place):
        missing = "places" if pixel else "pixels" if place else "pixels and places"
        got = ", ".join(header)
        got = f'"{got if len(got) <= 60 else got[:57] + "..."}"'  # noqa: PLR2004 - one line of a terminal
        is_data = sum(_is_number(cell) for cell in header) > 1
        hint = "its first line is a row of data: write the columns' names above it" if is_data else ""
        what = f"the header names no columns with {missing}"
        raise ConfigError(what, where=where, got=got, expected=_WANTED, hint=hint)
    name = next((names.index(each) for each in _NAME if each in names), None)
    stds = {key: names.index(key) for key in _STDS if key in names}
    used = {*pixel, *place, *stds.values(), *([] if name is None else [name])}
    left = next((each for index, each in enumerate(header) if index not in used), None)
    if left is not None:
        hint = f'remove the column "{left}"' if left else "remove it"
        raise ConfigError("the header", where=where, got=f'a column "{left}"', expected=_WANTED, hint=hint)
    return Columns(pixel, place, is_geo, name, stds)


def _find(names: list[str], way: tuple[str, ...]) -> tuple[int, ...]:
    return tuple(names.index(each) for each in way) if set(way) <= set(names) else ()


def _landmark(header: list[str], columns: Columns, cells: list[str], number: int, where: str) -> dict[str, object]:
    if len(cells) != len(header):
        is_comma = len(cells) > len(header)
        hint = "decimals take a point, and a name with a separator in it stands in quotes" if is_comma else ""
        raise ConfigError(
            f"line {number}", where=where, got=f"{len(cells)} cells", expected=f"{len(header)} as the header", hint=hint
        )

    def cell(index: int, *, may_be_unknown: bool = False) -> float | str:
        text = cells[index].strip()
        if may_be_unknown and text == UNKNOWN:
            return UNKNOWN
        return _number(text, f'line {number}, column "{header[index]}"', where, may_be_unknown=may_be_unknown)

    place = [cell(index, may_be_unknown=True) for index in columns.place]
    return {
        **({} if columns.name is None or not cells[columns.name].strip() else {"name": cells[columns.name].strip()}),
        "pixel": [cell(index) for index in columns.pixel],
        **(dict(zip(GEO_KEYS, place, strict=True)) if columns.is_geo else {"position_m": place}),
        **{key: cell(index) for key, index in columns.stds.items()},
    }


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(text: str, label: str, where: str, *, may_be_unknown: bool) -> float:
    expected = f'a number, or "{UNKNOWN}" where it is not known' if may_be_unknown else "a number"
    got = f'"{text}"' if text else "nothing"
    if _DECIMAL_COMMA.fullmatch(text):
        hint = "write decimals with a point, as it might stand for thousands too"
        raise ConfigError(label, where=where, got=got, expected=expected, hint=hint)
    try:
        value = float(text)
    except ValueError:
        raise ConfigError(label, where=where, got=got, expected=expected) from None
    if not math.isfinite(value) or "_" in text:
        raise ConfigError(label, where=where, got=got, expected=expected.replace("a number", "a finite number"))
    return value
