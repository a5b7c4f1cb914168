"""Files of evidence: what people know about a scene, for a calibration.

A TOML file (``configs/calibration/`` has one with every key explained), a CSV file with a row for each landmark, or
OpenDroneMap's list of ground control points.
"""

import codecs
import csv
import hashlib
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aerodft.adapters.config.evidence.cross_checks import (
    Stated,
    check_datums,
    check_degrees,
    check_duplicates,
    check_is_map,
    check_names,
    check_pixels,
    check_tilt,
    check_together,
    frame_around,
)
from aerodft.adapters.config.evidence.evidence_tables import (
    GEO_KEYS,
    UNKNOWN,
    CameraPriorTable,
    EvidenceTable,
    HorizonTable,
    LandmarkTable,
    ObservationTable,
    priors_from,
)
from aerodft.adapters.config.evidence.gcp_list import gcp_rows, is_gcp_list
from aerodft.adapters.config.evidence.images import Flight, FlightDocument, flight_from, read_flight
from aerodft.adapters.config.evidence.local_frame import LocalFrame, checked_crs, takes_degrees
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import GEO, LOCAL, si_value
from aerodft.adapters.file_kind import content_looks_like
from aerodft.errors import ConfigError
from aerodft.model import Camera, Evidence, EvidenceSet, Landmark

_CSV_SUFFIXES = {".csv", ".tsv", ".txt"}
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
_FIRST_PRINTED = 0x20
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")
_FIELDS = {"range": "ranges"}
_MOST_NAMES = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceFile:
    """What a file says.

    Attributes:
        known: Observations and priors, in metres of ``frame`` and radians.
        frame: Where these metres are. Its zero is the stated elevation of the ground; where none is stated, the file's
            own zero for local coordinates (up to 100 km), and otherwise the middle one of the landmarks' heights.
        fixed: Names of the priors that are stated without a std: taken as exact (their std is 0).
        stated: The observations as they stand in the file, for messages; in the order of ``known.evidence``.
        image: File name of the image, as stated.
        image_size_px: Its width and height, as stated.
        sha256: Of the file's bytes, hexadecimal.
        path: The file.
        flight: Many images, with what is known in each; None for a file of one image.
        notes: What a person should know of how the observations were made, sentence by sentence.
        image_paths: Files of the images that the observations were made in, as far as they are there.
    """

    known: EvidenceSet
    frame: LocalFrame
    fixed: frozenset[str]
    stated: tuple[Stated, ...]
    image: str | None
    image_size_px: tuple[int, int] | None
    sha256: str
    path: Path
    flight: Flight | None = None
    notes: tuple[str, ...] = ()
    image_paths: tuple[Path, ...] = ()

    def with_notes(self, *notes: str) -> "EvidenceFile":
        """The file with further notes."""
        return replace(self, notes=(*self.notes, *notes))


@dataclass(frozen=True, slots=True)
class _Row:
    kind: str
    label: str
    table: LandmarkTable | ObservationTable

    @property
    def stated(self) -> Stated:
        table = self.table
        if isinstance(table, LandmarkTable):
            return Stated(self.label, (table.pixel,), table.place, is_geo=table.is_geo, image=table.image)
        may_be_outside = isinstance(table, HorizonTable)
        return Stated(self.label, _pixels_of(table), may_be_outside=may_be_outside, image=table.image)


@dataclass(frozen=True, slots=True)
class _File:
    table: EvidenceTable
    rows: list[_Row]
    flight: FlightDocument | None = None
    is_table: bool = False


def load_evidence(
    path: Path, crs: str | None = None, plane_elevation_m: float | None = None, image: str | None = None
) -> EvidenceFile:
    """Read a file of evidence.

    Args:
        path: A TOML file; or, by its ending ``.csv``, ``.tsv`` or ``.txt``, a CSV file with a header, or a list of
            ground control points as OpenDroneMap takes it.
        crs: What the places of a CSV file are in: ``local`` metres, ``geo`` or an EPSG code. Other files say it.
        plane_elevation_m: Of the measured plane, in the heights of the landmarks. TOML files say it.
        image: Of a list of ground control points: the image whose points are meant, where it has several.

    Raises:
        ConfigError: Missing or unreadable, a syntax error, an unknown key or column, an impossible value, or
            observations that cannot all be true.
    """
    where, data = str(path), read_bytes(path)
    is_table = path.suffix.lower() in _CSV_SUFFIXES
    if not is_table:
        _refuse_in_file("crs", crs, f'write crs = "{crs}" in it', where)
        hint = f"write elevation_m = {plane_elevation_m} in it"
        _refuse_in_file("plane_elevation_m", plane_elevation_m, hint, where)
    text = _text(data, where) if is_table else ""
    if is_gcp_list(text):
        _refuse_in_file("crs", crs, "its first line says it", where)
        file = _from_gcp_list(text, plane_elevation_m, image, path)
    elif image is not None:
        expected = "a list of ground control points of several images"
        raise ConfigError("image", where=where, got=f'"{image}"', expected=expected)
    elif is_table:
        file = _from_csv(data, crs, plane_elevation_m, where)
    else:
        file = _from_document(parse_toml(data, where), where)
    return _check_and_resolve(file, path, hashlib.sha256(data).hexdigest())


def _refuse_in_file(key: str, value: object, hint: str, where: str) -> None:
    """Refuse what the file itself says."""
    if value is not None:
        raise ConfigError(
            f"`{key}`", where=where, got=f"{value} beside this file", expected="it in the file", hint=hint
        )


def evidence_from(document: dict[str, Any], path: Path, sha256: str) -> EvidenceFile:
    """Evidence from what a TOML file has, perhaps with more that was found otherwise.

    Args:
        document: Plain values from TOML.
        path: The file, for messages.
        sha256: Of its bytes, hexadecimal.

    Raises:
        ConfigError: An unknown key, an impossible value, or observations that cannot all be true.
    """
    return _check_and_resolve(_from_document(document, str(path)), path, sha256)


def _check_and_resolve(file: _File, path: Path, sha256: str) -> EvidenceFile:
    table, rows, where, size_px = file.table, file.rows, str(path), _size(file)
    stated = tuple(row.stated for row in rows)
    crs = checked_crs(table.crs, where)
    for camera in _cameras(file):
        check_datums(stated, camera, crs, where)
    names = _names(rows)
    check_names(names, stated, where)
    check_pixels(stated, size_px, where)
    check_duplicates(stated, where)
    if takes_degrees(crs):
        check_degrees(stated, where)
    frame = frame_around(stated, table.model_copy(update={"camera": _cameras(file)[0]}), crs, where)
    check_together(stated, frame, where)
    notes = (*check_is_map(stated, crs), *_plane_note(file, frame))
    priors, fixed = priors_from(table, frame)
    evidence = tuple(_observation(row.table, name, frame) for row, name in zip(rows, names, strict=True))
    return EvidenceFile(
        known=EvidenceSet(evidence=evidence, priors=priors),
        frame=frame,
        fixed=fixed,
        stated=stated,
        image=table.image.file,
        image_size_px=size_px,
        sha256=sha256,
        path=path,
        flight=None if file.flight is None else _flight(file.flight, stated, evidence, frame, path),
        notes=notes,
        image_paths=tuple(each for each in _image_paths(file, path) if each.is_file()),
    )


def _plane_note(file: _File, frame: LocalFrame) -> Iterator[str]:
    """What elevation heights count from, where the file does not say it."""
    is_middle = frame.crs != LOCAL or frame.origin != (0.0, 0.0, 0.0)
    key = "`plane_elevation_m`" if file.is_table else "elevation_m in the file"
    if file.table.elevation_m is not None:
        if file.is_table:
            yield f"heights count from the measured plane at {frame.origin[2]:.10g} m, as stated"
    elif is_middle and any(row.stated.place for row in file.rows):
        zero = f"{frame.origin[2]:.10g} m, the middle one of the landmarks' heights"
        yield f"heights count from the measured plane, taken to be at {zero}; {key} states another"
    elif file.is_table:
        yield f"heights count from the measured plane, taken to be at 0 of the landmarks' heights; {key} states another"


def _image_paths(file: _File, path: Path) -> Iterator[Path]:
    """Where the images that the file names would be."""
    named = (file.table.image,) if file.flight is None else file.flight.entries
    yield from (path.parent / each.file for each in named if each.file is not None)


def _cameras(file: _File) -> tuple[CameraPriorTable, ...]:
    """What the file says of where a camera is."""
    return (file.table.camera,) if file.flight is None else file.flight.entries


def _flight(
    tables: FlightDocument, stated: tuple[Stated, ...], evidence: tuple[Evidence, ...], frame: LocalFrame, path: Path
) -> Flight:
    by_image: dict[str, list[Evidence]] = {}
    for each, known in zip(stated, evidence, strict=True):
        by_image.setdefault(each.image or "", []).append(known)
    return flight_from(tables, by_image, frame, path)


def check_against(found: EvidenceFile, camera: Camera) -> None:
    """Refuse evidence that cannot be this camera's.

    Args:
        found: The evidence.
        camera: The camera that is said to have taken the image.

    Raises:
        ConfigError: The image has another size, a pixel is outside of it (a horizon's may be), pixels and places or
            u and v are interchanged, or the tilt was given in radians.
    """
    size_px = (camera.width_px, camera.height_px)
    if found.image_size_px not in (None, size_px):
        got = "{} x {} pixels".format(*found.image_size_px or ())
        expected = f'{size_px[0]} x {size_px[1]}, the size of camera "{camera.name}"'
        hint = "take the camera file of the mode that the image was taken in"
        raise ConfigError("image", where=found.path, got=got, expected=expected, hint=hint)
    check_pixels(found.stated, size_px, str(found.path))
    check_tilt(found.known, camera, found.path)


def _from_document(document: dict[str, Any], where: str) -> _File:
    flight, document = read_flight(document, where)
    table = validated(EvidenceTable, document, where)
    kinds = [key for key, value in document.items() if isinstance(value, list)]
    rows = [
        _Row(kind, f"{kind}[{index}]", each)
        for kind in kinds
        for index, each in enumerate(getattr(table, _FIELDS.get(kind, kind)))
    ]
    if not rows:
        expected = "[[landmark]], [[range]], [[length]] or another observation"
        raise ConfigError("no observations", where=where, expected=expected)
    for row in rows:
        _check_image(row, flight, where)
    return _File(table, rows, flight)


def _check_image(row: _Row, flight: FlightDocument | None, where: str) -> None:
    """Refuse an observation of which nobody knows what image it is in."""
    image, names = row.table.image, () if flight is None else flight.names
    if image is not None and flight is None:
        raise ConfigError(f"{row.label}.image", where=where, got="it without [[image]]", expected="one image alone")
    if flight is not None and image not in names:
        got = "nothing" if image is None else f'"{image}"'
        expected = f"one of {', '.join(names[:_MOST_NAMES])}{', ...' if len(names) > _MOST_NAMES else ''}"
        raise ConfigError(f"{row.label}.image", where=where, got=got, expected=expected)


def landmark_tables(text: str, where: str) -> tuple[str, list[dict[str, Any]]]:
    """The landmarks of a CSV file or of a list of ground control points in one image.

    Args:
        text: The file's.
        where: Its name in messages.

    Returns:
        The coordinate reference system, and of each landmark its table as a TOML file has it.

    Raises:
        ConfigError: As ``load_evidence``.
    """
    if is_gcp_list(text):
        crs, _, lines = gcp_rows(text, None, where)
    else:
        is_geo, lines = _landmark_rows(text.encode(), where)
        crs = GEO if is_geo else LOCAL
    return crs, [row for _, row in lines]


def _from_csv(data: bytes, crs: str | None, plane_elevation_m: float | None, where: str) -> _File:
    is_geo, lines = _landmark_rows(data, where)
    return _from_rows(lines, {"crs": crs or (GEO if is_geo else LOCAL)}, plane_elevation_m, where)


def _from_gcp_list(text: str, plane_elevation_m: float | None, image: str | None, path: Path) -> _File:
    crs, name, lines = gcp_rows(text, image, str(path))
    folders = (Path(), Path("images"))
    file = next((folder / name for folder in folders if (path.parent / folder / name).is_file()), Path(name))
    return _from_rows(lines, {"crs": crs, "image": {"file": str(file)}}, plane_elevation_m, str(path))


def _from_rows(
    lines: list[tuple[str, dict[str, object]]], keys: dict[str, Any], plane_elevation_m: float | None, where: str
) -> _File:
    """Landmarks of a table, with what else its file or somebody says."""
    if plane_elevation_m is not None:
        keys = {**keys, "elevation_m": plane_elevation_m}
    rows = [_Row("landmark", label, validated(LandmarkTable, row, where, f"{label}, ")) for label, row in lines]
    return _File(validated(EvidenceTable, keys, where), list(rows), is_table=True)


def _pixels_of(table: ObservationTable) -> tuple[tuple[float, float], ...]:
    found = np.array([pixel for key in ("pixel", "pixels", "base", "top", "lines") for pixel in _flat(table, key)])
    return tuple((float(u), float(v)) for u, v in found)


def _flat(table: ObservationTable, key: str) -> list[list[float]]:
    value = getattr(table, key, None)
    return [] if value is None else np.reshape(value, (-1, 2)).tolist()


def _size(file: _File) -> tuple[int, int] | None:
    """Of the image; where there are several, of the first: one camera's mode has one size."""
    if file.flight is not None:
        return next(iter(file.flight.sizes_px), None)
    width_px, height_px = file.table.image.width_px, file.table.image.height_px
    return None if width_px is None or height_px is None else (width_px, height_px)


def _names(rows: Sequence[_Row]) -> list[str]:
    """Each one's own name, or its kind and number in the file; after its image's, where there are several."""
    count: dict[str, int] = {}
    names = []
    for row in rows:
        count[row.kind] = count.get(row.kind, 0) + 1
        image = "" if row.table.image is None else f"{row.table.image}/"
        names.append(f"{image}{row.table.name or f'{row.kind}-{count[row.kind]}'}")
    return names


def _observation(table: LandmarkTable | ObservationTable, name: str, frame: LocalFrame) -> Evidence:
    """An observation in the frame; on a landmark's way there, the frame's zero stands in for what is not known."""
    if not isinstance(table, LandmarkTable):
        return table.observation(name)
    place = table.place
    whole = [zero if value is None else value for value, zero in zip(place, frame.origin, strict=True)]
    axes = (1, 0, 2) if table.is_geo else (0, 1, 2)
    local_m = zip(axes, frame.local_m(whole).tolist(), strict=True)
    east_m, north_m, up_m = (None if place[axis] is None else each_m for axis, each_m in local_m)
    return si_value(Landmark, table, name=name, position_m=(east_m, north_m, up_m))


@dataclass(frozen=True, slots=True)
class _Columns:
    """Which columns of a row say what, by their place in it."""

    pixel: tuple[int, ...]
    place: tuple[int, ...]
    is_geo: bool
    name: int | None
    stds: dict[str, int]


def _landmark_rows(data: bytes, where: str) -> tuple[bool, list[tuple[str, dict[str, object]]]]:
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
            raise ConfigError("too many rows", where=where, got="more", expected=expected, hint="take some of its rows")
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


def _columns(header: list[str], where: str) -> _Columns:
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
    return _Columns(pixel, place, is_geo, name, stds)


def _find(names: list[str], way: tuple[str, ...]) -> tuple[int, ...]:
    return tuple(names.index(each) for each in way) if set(way) <= set(names) else ()


def _landmark(header: list[str], columns: _Columns, cells: list[str], number: int, where: str) -> dict[str, object]:
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
