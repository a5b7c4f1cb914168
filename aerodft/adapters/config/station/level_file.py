"""Readings of a gauge from a table of text (CSV): of people's own, and as agencies export them."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Final, NamedTuple

from aerodft.adapters.files import content_looks_like, looks_like, read_whole
from aerodft.adapters.timestamps import iso_to_unix_ns, parse_offset
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, counted
from aerodft.model import MIN_READINGS

UNITS_M: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
"""Metres in the units of gauges; the foot is the international one (0.3048 m exactly)."""

READING_STD_M: Final = 0.02
"""Std of a reading where neither a key nor a column states one: waves and the gauge's rounding. Chosen; agencies state
0.3 to 1 cm of their sensors, a staff is read to 2 cm."""

MAX_READINGS: Final = 60_000
"""A year of readings every nine minutes; all of them travel with each recording, in some megabytes of text."""

_MOST_BYTES: Final = 64 << 20  # of a file: the widest exports take 200 bytes for a reading
_MOST_M: Final = 10_000.0  # no water is higher, or lower
_MOST_STD_M: Final = 100.0
_FIRST_NS, _LAST_NS = 0, 7_258_118_400 * SECOND_NS  # 1970 and 2200: what is outside has another unit
_DELIMITERS: Final = (";", "\t", ",", "|")  # a comma may be a decimal one, so it comes late
_COMMENT: Final = "#"
_SHOWN: Final = 60  # letters of a cell in a sentence

_UNIT_NAMES: Final = {
    "m": "m",
    "metre": "m",
    "metres": "m",
    "meter": "m",
    "meters": "m",
    "cm": "cm",
    "mm": "mm",
    "ft": "ft",
    "feet": "ft",
    "foot": "ft",
    "in": "in",
    "inch": "in",
    "inches": "in",
}
_TIME_NAMES: Final = re.compile(
    r"((utc_|iso_)?(time|stamp|timestamp|date_?time|zeit|zeitpunkt|zeitstempel|datum_?zeit|date_?heure)(_utc|_gmt|_s|_iso)?|utc)"
)
_UNIX_NAMES: Final = re.compile(
    r"(time_|timestamp_)?(unix|epoch)(_?time|_?timestamp)?(_(s|ms|us|ns|seconds))?|(stamp)_(ns)"
)
_UNIX_DIGITS: Final = {"s": 9, "seconds": 9, "ms": 6, "us": 3, "ns": 0}  # of a count of nanoseconds, below the unit
_UTC_NAMES: Final = re.compile(r"(^|_)(utc|gmt)($|_)")
_LEVEL_NAMES: Final = re.compile(
    r"(level|stage|water_?level|water_?stage|river_?level|gau?ge_?height|water_?surface_?elevation|wasserstand|pegel"
    r"|pegelstand|value|wert|hauteur|waterstand|water_?height|height|elevation|wse|\d+_00065|w|h)"
)
_STD_NAMES: Final = re.compile(r"(std|sigma|level_std|std_dev|uncertainty)")
_USGS_FEET: Final = re.compile(r"\d+_00065")  # parameter 00065: gage height, feet
_USGS_WIDTHS: Final = re.compile(r"\d+[sdn]")  # of its second line, under the header
_ZONE_NAMES: Final = frozenset({"tz_cd", "tz", "timezone", "time_zone"})
_ZONES_H: Final = {
    "UTC": 0, "GMT": 0, "Z": 0, "EST": -5, "EDT": -4, "CST": -6, "CDT": -5, "MST": -7, "MDT": -6, "PST": -8,
    "PDT": -7, "AKST": -9, "AKDT": -8, "HST": -10, "AST": -4, "ADT": -3, "MEZ": 1, "MESZ": 2, "CET": 1, "CEST": 2,
    "BST": 1, "WET": 0, "WEST": 1, "EET": 2, "EEST": 3,
}  # fmt: skip
"""Hours ahead of UTC of the abbreviations in exports of the USGS, the WSV and their neighbours."""

_NOTHING: Final = frozenset({"", "-", "--", "---", "nan", "null", "none", "na", "n/a", "m", "*", "ice", "eqp", "bkw"})
"""What stands for no reading; the last are the USGS's remarks on ice, equipment and backwater."""
_NO_LEVELS: Final = re.compile(r"-(777|888|999|9999|99999|999999)([.,]0+)?")  # sentinels of agencies for no reading
_NUMBER: Final = re.compile(r"[+-]?(\d+([.]\d*)?|[.]\d+)([eE][+-]?\d{1,2})?")
_COMMA: Final = re.compile(r"[+-]?\d*,\d+")
_THOUSANDS: Final = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")  # may be a decimal comma, or thousands
_GERMAN: Final = re.compile(r"(\d{2})\.(\d{2})\.(\d{4})[ T]+(\d{1,2}:\d{2}(?::\d{2})?.*)")
_NO_SECONDS: Final = re.compile(r"(\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2})(?![:\d])(.*)")
_SHORT_OFFSET: Final = re.compile(r"([+-]\d{2})$")
_UNIX: Final = re.compile(r"(\d{9}|1\d{9})(\.\d{1,9})?")  # 1973 to 2033; a number that begins with 20 may be a date
_COUNT: Final = re.compile(r"(\d{1,20})(?:\.(\d*))?")
_LINE_END: Final = re.compile(r"\r\n|\n|\r")

_NUMBERS: Final = frozenset({"level", "std"})  # columns that hold numbers

COLUMN_KEYS: Final = ("time", "date", "zone", "level", "std")
"""What a station may say of a table's columns."""


class Reading(NamedTuple):
    """One reading: its UTC (ns), its level in its datum and its std (m)."""

    stamp_ns: int
    level_m: float
    std_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelTerms:
    """What a station says of a table of readings.

    Attributes:
        std_m: Standard deviation of readings without one of their own; None for ``READING_STD_M``.
        unit: Unit of the levels, of ``UNITS_M``; None where the column's name has it.
        columns: Names of columns by ``COLUMN_KEYS``, where they are not the usual ones.
        utc_offset: Offset from UTC of times that state none; None to refuse these.
    """

    std_m: float | None = None
    unit: str | None = None
    columns: Mapping[str, str] | None = None
    utc_offset: str | None = None


def read_levels(path: Path, terms: LevelTerms) -> tuple[Reading, ...]:
    """Readings of a file, in the order of their times.

    Args:
        path: A table of text with a header; lines that begin with ``#`` are comments.
        terms: What is not in the table.

    Raises:
        ConfigError: The file cannot be read, or a line of it: which, what it says, and what should be there.
    """
    table = _Table.read(path, terms)
    if len(table.rows) > MAX_READINGS:
        hint = "cut it to the days of the flight"
        raise table.error("too many readings", got=f"{len(table.rows)}", expected=f"at most {MAX_READINGS}", hint=hint)
    found: dict[int, tuple[Reading, int]] = {}
    for line, cells in table.rows:
        level = table.level_m(line, cells)
        if level is None:
            continue
        reading = Reading(table.stamp_ns(line, cells), level, table.std_m(line, cells))
        before, at = found.setdefault(reading.stamp_ns, (reading, line))
        if before.level_m != reading.level_m:
            got = f"{reading.level_m:.10g} m, and {before.level_m:.10g} m in line {at}"
            hint = "a clock put back in autumn says an hour twice: state offsets from UTC"
            raise table.error("two levels at one time", line, got=got, expected="one level", hint=hint)
    if len(found) < MIN_READINGS:
        hint = "state ground.level_m for a level that does not change"
        raise table.error(
            "too few readings", got=counted(len(found), "reading"), expected=f"at least {MIN_READINGS}", hint=hint
        )
    return tuple(found[stamp_ns][0] for stamp_ns in sorted(found))


_Line = tuple[int, list[str]]
"""Number of a line in its file, from 1, and its cells."""


class _Table:
    """The cells of a table of readings, and what its columns are.

    Attributes:
        rows: Number of its line in the file, and cells, of each row under the header.
    """

    def __init__(self, path: Path, terms: LevelTerms, header: _Line, rows: list[_Line]) -> None:
        self._path, self._terms = path, terms
        self._line, self._header = header
        self._names = [_plain(each) for each in self._header]
        self.rows = rows
        self._at = self._columns()
        unit = self._level_unit()
        own = _unit_of(self._names[self._at["std"]])[1] if "std" in self._at else None
        self._unit_m, self._std_unit_m = UNITS_M[unit], UNITS_M[own or unit]
        self._is_comma = {key: self._has_decimal_comma(key) for key in self._at if key in _NUMBERS}
        self._offset = None if terms.utc_offset is None else parse_offset(terms.utc_offset)
        name = self._names[self._at["time"]]
        unix = _UNIX_NAMES.fullmatch(name)
        self._unix = unix and (unix[5] or unix[7] or "s")
        if self._offset is None and _UTC_NAMES.search(name):
            self._offset = timedelta()

    @staticmethod
    def read(path: Path, terms: LevelTerms) -> "_Table":
        """The table in a file."""
        text = _text_of(path)
        lines = [(number, line) for number, line in enumerate(_LINE_END.split(text), 1) if line.strip()]
        lines = [(number, line) for number, line in lines if not line.lstrip().startswith(_COMMENT)]
        if not lines:
            raise ConfigError(
                "no readings", where=path, got="no line but comments", expected="a header and a line for each reading"
            )
        number, head = lines[0]
        delimiter = next((each for each in _DELIMITERS if each in head), ",")
        rows = [(at, [cell.strip() for cell in _cells(line, delimiter)]) for at, line in lines]
        header = rows.pop(0)[1]
        while header and not header[-1]:
            header.pop()
        if rows and all(_USGS_WIDTHS.fullmatch(cell) for cell in rows[0][1]):
            rows.pop(0)
        return _Table(path, terms, (number, header), rows)

    def error(self, what: str, line: int | None = None, *, got: object, expected: str, hint: str = "") -> ConfigError:
        """An error that says the file and the line."""
        where = self._path if line is None else f"{self._path}, line {line}"
        return ConfigError(what, where=where, got=got, expected=expected, hint=hint)

    def level_m(self, line: int, cells: Sequence[str]) -> float | None:
        """Level of a row; None where it says that there is no reading."""
        self._check_length(line, cells)
        cell = cells[self._at["level"]]
        if cell.lower() in _NOTHING or _NO_LEVELS.fullmatch(cell):
            return None
        level_m = self._number("level", line, cells) * self._unit_m
        if not abs(level_m) <= _MOST_M:
            expected = f"{-_MOST_M:.0f} to {_MOST_M:.0f} m"
            raise self.error("an impossible level", line, got=f"{level_m:.10g} m", expected=expected)
        return level_m

    def std_m(self, line: int, cells: Sequence[str]) -> float:
        """Std of a row's reading: its own, or the one that is stated for all."""
        stated_m = READING_STD_M if self._terms.std_m is None else self._terms.std_m
        if "std" not in self._at or cells[self._at["std"]].lower() in _NOTHING:
            return stated_m
        std_m = self._number("std", line, cells) * self._std_unit_m
        if not 0 <= std_m <= _MOST_STD_M:
            expected = f"0 to {_MOST_STD_M:.0f} m"
            raise self.error("an impossible standard deviation", line, got=f"{std_m:.10g} m", expected=expected)
        return std_m

    def stamp_ns(self, line: int, cells: Sequence[str]) -> int:
        """UTC of a row."""
        text = cells[self._at["time"]]
        if "date" in self._at:
            text = f"{cells[self._at['date']]} {text}"
        if self._unix is not None or ("date" not in self._at and _UNIX.fullmatch(text)):
            stamp_ns = self._unix_ns(line, text)
        else:
            stamp_ns = self._iso_ns(line, text, self._zone(line, cells))
        if not _FIRST_NS <= stamp_ns <= _LAST_NS:
            raise self.error("an impossible time", line, got=_shown(text), expected="a time from 1970 to 2200")
        return stamp_ns

    def _unix_ns(self, line: int, text: str) -> int:
        match = _COUNT.fullmatch(text)
        if match is None:
            raise self.error("no time", line, got=_shown(text), expected="a count of seconds since 1970")
        digits = _UNIX_DIGITS[self._unix or "s"]
        return int(match[1] + (match[2] or "")[:digits].ljust(digits, "0"))

    def _iso_ns(self, line: int, text: str, offset: timedelta | None) -> int:
        iso = text.replace("/", "-") if re.match(r"\d{4}/", text) else text
        if german := _GERMAN.fullmatch(iso):
            day, month, year, clock = german.groups()
            iso = f"{year}-{month}-{day} {'0' if clock[1] == ':' else ''}{clock}"
        iso = _NO_SECONDS.sub(r"\1:00\2", iso)
        iso = _SHORT_OFFSET.sub(r"\1:00", iso) if iso.count(":") > 1 else iso
        try:
            return iso_to_unix_ns(iso, default_offset=offset)
        except ValueError as error:
            if "states no offset" in str(error):
                expected, hint = "an offset from UTC: Z or +01:00", 'or state ground.level_utc_offset = "+01:00"'
                what = "a time of an unknown zone"
                raise self.error(what, line, got=_shown(text), expected=expected, hint=hint) from None
            expected = "a time like 2026-05-01T10:15:00Z, or Unix seconds"
            raise self.error("no time", line, got=_shown(text), expected=expected) from None

    def _zone(self, line: int, cells: Sequence[str]) -> timedelta | None:
        if "zone" not in self._at:
            return self._offset
        text = cells[self._at["zone"]]
        if text.upper() in _ZONES_H:
            return timedelta(hours=_ZONES_H[text.upper()])
        try:
            return parse_offset(text)
        except ValueError:
            expected = "UTC, EST, +01:00 or the like"
            raise self.error("a time of an unknown zone", line, got=_shown(text), expected=expected) from None

    def _number(self, key: str, line: int, cells: Sequence[str]) -> float:
        text = cells[self._at[key]]
        plain = text.replace(",", ".") if self._is_comma[key] and _COMMA.fullmatch(text) else text
        if _NUMBER.fullmatch(plain) is None or not math.isfinite(value := float(plain)):
            what = "no level" if key == "level" else "no standard deviation"
            raise self.error(what, line, got=_shown(text), expected=f"a number in {self._header[self._at[key]]!r}")
        return value

    def _has_decimal_comma(self, key: str) -> bool:
        """Whether commas in a column's numbers are decimal ones.

        Raises:
            ConfigError: They may separate thousands as well, or some numbers have points.
        """
        texts = [(line, cells[self._at[key]]) for line, cells in self.rows if len(cells) > self._at[key]]
        commas = [(line, text) for line, text in texts if "," in text]
        if not commas:
            return False
        if point := next(((line, text) for line, text in texts if "." in text and _NUMBER.fullmatch(text)), None):
            got = f"{_shown(point[1])}, and {_shown(commas[0][1])} in line {commas[0][0]}"
            raise self.error("numbers with points and with commas", point[0], got=got, expected="one of the two")
        if all(_THOUSANDS.fullmatch(text) for _, text in commas):
            line, text = commas[0]
            hint = "write points, or another number of decimals"
            raise self.error(
                "an ambiguous comma", line, got=_shown(text), expected="a decimal one, or no thousands", hint=hint
            )
        return True

    def _check_length(self, line: int, cells: Sequence[str]) -> None:
        count = len(self._header)
        if len(cells) < count or any(cells[count:]):
            hint = "a decimal comma needs another separator, such as a semicolon" if len(cells) > count else ""
            expected = f"{counted(count, 'cell')}, as in the header (line {self._line})"
            got = counted(len(cells), "cell")
            raise self.error("a line of another length", line, got=got, expected=expected, hint=hint)

    def _columns(self) -> dict[str, int]:
        """Places of the columns by ``COLUMN_KEYS``."""
        stated = {key: self._stated(key, name) for key, name in (self._terms.columns or {}).items()}
        stems = [_unit_of(name)[0] for name in self._names]
        choices = {
            "level": [k for k, stem in enumerate(stems) if _LEVEL_NAMES.fullmatch(stem)],
            "std": [k for k, stem in enumerate(stems) if _STD_NAMES.fullmatch(stem)],
            "zone": [k for k, name in enumerate(self._names) if name in _ZONE_NAMES],
            "time": [
                k for k, name in enumerate(self._names) if _TIME_NAMES.fullmatch(name) or _UNIX_NAMES.fullmatch(name)
            ],
            "date": [k for k, name in enumerate(self._names) if name in ("date", "datum")],
        }
        if not choices["time"]:
            choices["time"], choices["date"] = choices["date"], []
        elif len(choices["date"]) == 1 and self._names[choices["time"][0]] not in ("time", "zeit"):
            choices["date"] = []
        if "time" in stated and "date" not in stated:
            choices["date"] = []
        found = {}
        for key, usual in choices.items():
            places = [each for each in usual if each not in stated.values()] if key not in stated else [stated[key]]
            if len(places) > 1:
                got = " and ".join(repr(self._header[each]) for each in places)
                hint = f'state ground.level_columns = {{ {key} = "..." }}'
                raise self.error(f"several columns may be the {key}", self._line, got=got, expected="one", hint=hint)
            if places:
                found[key] = places[0]
        for key, example in (("time", "time"), ("level", "level_m")):
            if key not in found:
                hint = f"name it {example}, or state ground.level_columns.{key}"
                got = ", ".join(map(_shown, self._header)) or "nothing"
                raise self.error(f"no column of the {key}", self._line, got=got, expected="a header", hint=hint)
        return found

    def _stated(self, key: str, name: str) -> int:
        names = [each.lower() for each in self._header]
        if names.count(name.strip().lower()) != 1:
            got = f'{key} = "{name}", which is {"there twice" if name.strip().lower() in names else "not there"}'
            expected = ", ".join(self._header)
            raise self.error("ground.level_columns names another column", self._line, got=got, expected=expected)
        return names.index(name.strip().lower())

    def _level_unit(self) -> str:
        """Unit of the levels, by their column's name or by the station."""
        name, stated = self._header[self._at["level"]], self._terms.unit
        plain = self._names[self._at["level"]]
        own = "ft" if _USGS_FEET.fullmatch(plain) else _unit_of(plain)[1]
        if own and stated and own != stated:
            got, expected = f'ground.level_unit = "{stated}"', f"{own}, as the column {name!r} says"
            raise self.error("two units", self._line, got=got, expected=expected)
        if own is None and stated is None:
            got, expected = f"column {name!r}", f"one of {', '.join(UNITS_M)}"
            hint = 'name it level_m or level_ft, or state ground.level_unit = "m"'
            raise self.error("levels without a unit", self._line, got=got, expected=expected, hint=hint)
        return own or stated or ""


def _text_of(path: Path) -> str:
    """The text of a file: UTF-8, UTF-16 with a byte order mark, or Latin-1."""
    expected = "a CSV of the gauge's readings"
    try:
        if path.is_file() and path.stat().st_size > _MOST_BYTES:
            raise ConfigError("too large", where=path, got=f"more than {_MOST_BYTES >> 20} MB", expected=expected)
        data = read_whole(path)
    except FileNotFoundError:
        raise ConfigError("no such file", where=path, expected=expected, hint="check ground.level") from None
    except OSError:
        raise ConfigError("cannot be read", where=path, got=looks_like(path), expected=expected) from None
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", "replace")
    if b"\0" in data or not data.strip():
        raise ConfigError("wrong type of file", where=path, got=content_looks_like(data[:512]), expected=expected)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return [line]


def _plain(name: str) -> str:
    """A column's name in lower case, words joined by underscores: ``Wasserstand [cm]`` is ``wasserstand_cm``."""
    return re.sub(r"[^0-9a-zäöüß]+", "_", name.lower()).strip("_")


def _unit_of(name: str) -> tuple[str, str | None]:
    """A plain name without its unit, and that unit; None where it has none."""
    stem, _, last = name.rpartition("_")
    return (stem, _UNIT_NAMES[last]) if stem and last in _UNIT_NAMES else (name, None)


def _shown(text: str) -> str:
    """A cell for a sentence."""
    return repr(text if len(text) <= _SHOWN else f"{text[:_SHOWN]}...")
