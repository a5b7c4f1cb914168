"""Measurements by probe, as arrays of some 40 bytes a row, from a recording or an exported table."""

import csv
import hashlib
import math
from array import array
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import orjson

from aerodft.adapters.files import cell_text, check_is_no_pipe
from aerodft.adapters.wire.events import IMAGE_SCHEMA, decode_image
from aerodft.dft import PROBE_KINDS
from aerodft.errors import InputError, Reason, located, os_errors_as
from aerodft.model import CODE_OF, Batch, FloatArray, IntArray, ProbeKind, Status
from replay.export import LARGEST_NUMBER, Item, check_on_earth, parquet_rows, parse_measurement, row_of
from replay.recordings import Recording

NO_IMAGE: Final = -1
_TABLES: Final = frozenset({".csv", ".parquet"})
_HEAD_IMAGES = 200
_PLACE: Final = ("lat_deg", "lon_deg", "cov_east_m2", "cov_east_north_m2", "cov_north_m2", "range_m")
_USED: Final = ("name", "kind", "unit", "stamp_ns", "image", "value", "std", "status", "enu_m", *_PLACE)


class ProbeKey(NamedTuple):
    """Key of comparable probes: a width is none any more where its name stands for an area."""

    name: str
    kind: str
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProbeSeries(Batch):
    """One probe's measurements, in the order of measuring.

    Attributes:
        stamp_ns: ``(n,)``.
        image: ``(n,)``, ``NO_IMAGE`` where it is not known.
        value: ``(n,)``, NaN where there is none.
        std: ``(n,)``, NaN where there is none.
        status: ``(n,)``, indexes in ``CODES``.
        place: ``(n, 8)`` of a ``position``: latitude and longitude (deg), covariance (m2: east, both, north), range,
            east, north (m); else ``(n, 0)``.
    """

    stamp_ns: IntArray
    image: IntArray
    value: FloatArray
    std: FloatArray
    status: IntArray
    place: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonInput:
    """One of two things to be compared.

    Attributes:
        where: Its folder or file.
        series: By probe.
        digest: Of all payloads in their order, or of the file.
        images: Stamp and arrival of the first images by index; empty for a table.
        recording: What it was read from; None for a table.
    """

    where: Path
    series: dict[ProbeKey, ProbeSeries]
    digest: str
    images: dict[int, tuple[int, int]]
    recording: Recording | None

    @property
    def count(self) -> int:
        """Number of measurements."""
        return sum(len(each.stamp_ns) for each in self.series.values())


def read_input(path: Path) -> ComparisonInput:
    """Read the measurements of a recording, or of a table that ``aerodft export`` wrote (CSV, Parquet).

    Raises:
        InputError: It is neither, or it is damaged.
        NoAnswerError: The recording holds nothing.
    """
    if path.is_file() and path.suffix.lower() in _TABLES:
        return _read_table(path)
    recording = Recording(path)
    digest = hashlib.sha256()

    def rows() -> Iterator[_Row]:
        for payload in recording.measurements():
            digest.update(len(payload).to_bytes(8, "little") + payload)
            yield _row_of_payload(payload, path)

    with located(path):
        series = _series(rows(), path)
    return ComparisonInput(
        where=path,
        series=series,
        digest=f"payloads {digest.hexdigest()}",
        images=_first_images(recording),
        recording=recording,
    )


class _Row(NamedTuple):
    key: ProbeKey
    stamp_ns: int
    image: int
    value: float
    std: float
    status: str
    place: tuple[float, ...]


def _row_of_payload(payload: bytes, where: Path) -> _Row:
    item = parse_measurement(payload)
    return _row(row_of(item) if item.get("kind") == ProbeKind.POSITION else item, where)


def _row(row: Item, where: Path) -> _Row:
    """A measurement or a table's row, the numbers of which may be text.

    Raises:
        InputError: It is no measurement.
    """
    try:
        key = _key(row)
        image = row["image"]
        return _Row(
            key,
            int(row["stamp_ns"]),
            NO_IMAGE if image is None or image == "" else int(image),
            _number(row["value"]),
            _number(row["std"]),
            row["status"],
            _place(row) if key.kind == ProbeKind.POSITION else (),
        )
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        raise InputError(
            "a measurement is none", where=where, got=Reason(f"{type(error).__name__}: {error}")
        ) from error


def _key(row: Item) -> ProbeKey:
    key = ProbeKey(row["name"], row["kind"], _unit(row))
    if not all(isinstance(part, str) for part in key):
        raise TypeError(f"{key!r:.60} names no probe")
    return key


def _unit(row: Item) -> str:
    """The unit of a measurement; where early recordings have metres for want of a number, that of its kind."""
    unit: str = row["unit"]
    return PROBE_KINDS[row["kind"]].unit if row["kind"] in PROBE_KINDS and row["value"] in {None, ""} else unit


def _place(row: Item) -> tuple[float, ...]:
    points = row["enu_m"] or None
    if isinstance(points, str):
        points = orjson.loads(points)
    east_north = points[0][:2] if points else (None, None)
    place = tuple(_number(row[name]) for name in _PLACE)
    check_on_earth(dict(zip(_PLACE, place, strict=True)))
    return (*place, *map(_number, east_north))


def _number(value: object) -> float:
    """A number; NaN for nothing (null, an empty cell)."""
    number = math.nan if value is None or value == "" else float(value)  # type: ignore[arg-type]  # text or a number
    if abs(number) > LARGEST_NUMBER:
        raise ValueError(f"a number of {number:g}")
    return number


class _SeriesBuilder:
    """Collects one probe's rows in flat arrays."""

    def __init__(self) -> None:
        self._integers = array("q")  # stamp, image, status
        self._numbers = array("d")  # value, std
        self._place = array("d")

    def add(self, row: _Row) -> None:
        self._integers.extend((row.stamp_ns, row.image, CODE_OF[Status(row.status)]))
        self._numbers.extend((row.value, row.std))
        self._place.extend(row.place)

    def series(self) -> ProbeSeries:
        integers = np.frombuffer(self._integers, dtype=np.int64).reshape(-1, 3)
        numbers = np.frombuffer(self._numbers).reshape(-1, 2)
        return ProbeSeries(
            stamp_ns=integers[:, 0],
            image=integers[:, 1],
            status=integers[:, 2],
            value=numbers[:, 0],
            std=numbers[:, 1],
            place=np.frombuffer(self._place).reshape(len(integers), -1),
        )


def _series(rows: Iterable[_Row], where: Path) -> dict[ProbeKey, ProbeSeries]:
    """The rows by probe.

    Raises:
        InputError: A row cannot be kept: its status is unknown, or a number too large.
    """
    builders: defaultdict[ProbeKey, _SeriesBuilder] = defaultdict(_SeriesBuilder)
    for row in rows:
        try:
            builders[row.key].add(row)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError("a measurement is damaged", where=where, got=Reason(f"{row.key.name}: {error}")) from error
    return {key: builder.series() for key, builder in builders.items()}


def _first_images(recording: Recording) -> dict[int, tuple[int, int]]:
    """Stamp and arrival of the first images, by index."""
    messages = recording.messages(wanted=lambda channel: channel.schema == IMAGE_SCHEMA)
    images = (decode_image(message.data) for message in islice(messages, _HEAD_IMAGES))
    return {image.index: (image.stamp_ns, image.arrival_ns) for image in images}


def _read_table(path: Path) -> ComparisonInput:
    with os_errors_as("the table cannot be read", where=path), path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    rows = parquet_rows(path, _USED) if path.suffix.lower() == ".parquet" else _csv_rows(path)
    series = _series((_row(row, path) for row in rows), path)
    return ComparisonInput(where=path, series=series, digest=f"table {digest}", images={}, recording=None)


def _csv_rows(path: Path) -> Iterator[Item]:
    csv.field_size_limit(1 << 24)  # 64 points with all their digits
    try:
        check_is_no_pipe(path)
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader(file)
            missing = [name for name in _USED if name not in (rows.fieldnames or ())]
            if missing:
                hint = "tables are those that `export` writes"
                raise InputError("the table has no measurements", where=path, got=f"no column {missing[0]}", hint=hint)
            last = (rows.fieldnames or ("",))[-1]
            for row in rows:
                if None in row or row[last] is None:  # the last number may be half of what it was
                    got = "more columns" if None in row else "fewer columns"
                    where, expected = f"{path}, line {rows.line_num}", f"{len(rows.fieldnames or ())}"
                    raise InputError("a row is not whole", where=where, got=got, expected=expected)
                yield {**row, "name": cell_text(row["name"])}
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError("the table cannot be read", where=path, got=error) from error
