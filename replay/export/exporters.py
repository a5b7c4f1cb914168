"""The registry of export formats: ``EXPORTERS``.

A new format is an entry. Its name in ``--format`` and in Python, its file endings, and what it takes follow.
"""

import csv
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, TypeAlias, TypeVar

import orjson

from aerodft.adapters.files import csv_cell
from replay.export.geopackage import write_geopackage
from replay.export.kml import write_kml
from replay.export.maps import MapCrs, MapFeature, geojson_text, map_features
from replay.export.merging import merge_segments
from replay.export.parquet import ParquetRows
from replay.export.table import COLUMNS, LISTS, Item, parse_measurement, row_of
from replay.export.video import write_video
from replay.recordings import Recording

T = TypeVar("T")
Counts: TypeAlias = dict[str, int]
"""How many measurements, messages, images, features of a layer, ... a file holds."""

_MEASUREMENTS: Final = "measurements"


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """An export format of whole recordings; the base class writes nothing.

    Attributes:
        name: Name of the format.
        endings: File endings with their point; the first one alone chooses the format.
        is_text: Whether it is text that stdout can hold.
        with_images: Whether recorded images are in it.
        of_measurements: Whether a recording without a measurement is no input.
    """

    name: str
    endings: tuple[str, ...]
    is_text: bool = False
    with_images: bool = False
    of_measurements: bool = True

    def write(self, recording: Recording, path: Path, crs: MapCrs) -> Counts:
        """Write a recording to a file.

        Args:
            recording: At least one measurement, or images, are in it.
            path: The file, which is replaced.
            crs: System of a map, or local metres; other formats ignore it.

        Returns:
            The numbers of things in the file.

        Raises:
            InputError: A measurement is damaged, or an extra is missing.
            OSError: The file cannot be written.
        """
        raise NotImplementedError

    def text(self, items: Iterable[Item], crs: MapCrs) -> Iterator[str]:
        """Measurements in pieces of text; only of formats that are text.

        Raises:
            InputError: An item is no measurement.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class _WholeRecording(Exporter):
    """Segments or images as one file."""

    with_images: bool = True
    of_measurements: bool = False
    write_recording: Callable[[Recording, Path], Counts]

    def write(self, recording: Recording, path: Path, crs: MapCrs) -> Counts:  # noqa: ARG002 - it is no map
        return self.write_recording(recording, path)


@dataclass(frozen=True, kw_only=True)
class _TextTable(Exporter):
    """Measurements as text, one after the other."""

    is_text: bool = True
    lines: Callable[[Iterable[Item]], Iterator[str]]

    def write(self, recording: Recording, path: Path, crs: MapCrs) -> Counts:
        counts: Counts = {}
        with path.open("w", encoding="utf-8", newline="") as file:
            file.writelines(self.text(_counted(_items(recording), counts, lambda _: _MEASUREMENTS), crs))
        return counts

    def text(self, items: Iterable[Item], crs: MapCrs) -> Iterator[str]:  # noqa: ARG002 - it is no map
        return self.lines(items)


@dataclass(frozen=True, kw_only=True)
class MapExporter(Exporter):
    """Measurements, or a surveyed river, as a map.

    Attributes:
        write_features: Writes features to a file in a system, and counts them by layer.
        takes_crs: Whether it may be in another system than WGS84.
        takes_local: Whether it may be in metres without a place on Earth.
    """

    write_features: Callable[[Path, Iterable[MapFeature], MapCrs], Counts]
    takes_crs: bool
    takes_local: bool

    def write(self, recording: Recording, path: Path, crs: MapCrs) -> Counts:
        """Write the measurements of a recording as a map."""
        features = map_features(_items(recording), is_local=crs.is_local)
        return {_MEASUREMENTS: sum(self.write_features(path, features, crs).values())}

    def text(self, items: Iterable[Item], crs: MapCrs) -> Iterator[str]:
        """Measurements as GeoJSON, the one map that is text."""
        return geojson_text(map_features(items), crs)


def _items(recording: Recording) -> Iterator[Item]:
    return map(parse_measurement, recording.measurements())


def _counted(items: Iterable[T], counts: Counts, kind: Callable[[T], str]) -> Iterator[T]:
    """Pass items on, and count each by its kind."""
    for item in items:
        counts[kind(item)] = counts.get(kind(item), 0) + 1
        yield item


def _json_lines(items: Iterable[Item]) -> Iterator[str]:
    for item in items:
        row_of(item)  # what is no measurement is refused in every format
        yield f"{orjson.dumps(item).decode()}\n"


class _Echo:
    """Makes ``csv.writer`` return its lines."""

    def write(self, text: str) -> str:
        return text


def _csv_lines(items: Iterable[Item]) -> Iterator[str]:
    writer = csv.writer(_Echo(), lineterminator="\n")
    yield writer.writerow(COLUMNS)
    for item in items:
        row = row_of(item)
        for name in LISTS:
            value = row[name]
            row[name] = None if value is None else orjson.dumps(value).decode()
        yield writer.writerow([value if name in LISTS else csv_cell(value) for name, value in row.items()])


def _write_geojson(path: Path, features: Iterable[MapFeature], crs: MapCrs) -> Counts:
    counts: Counts = {}
    with path.open("w", encoding="utf-8") as file:
        file.writelines(geojson_text(_counted(features, counts, lambda feature: feature.layer), crs))
    return counts


def _write_parquet(recording: Recording, path: Path) -> Counts:
    with ParquetRows(path) as rows:
        rows.add(_items(recording))
    return {_MEASUREMENTS: rows.count}


def _write_mcap(recording: Recording, path: Path) -> Counts:
    merged = merge_segments(recording, path)
    return {"messages": merged.messages, "attachments": merged.attachments}


def _write_mp4(recording: Recording, path: Path) -> Counts:
    return asdict(write_video(recording, path))


def _write_kml(path: Path, features: Iterable[MapFeature], crs: MapCrs) -> Counts:  # noqa: ARG001 - always WGS84
    return write_kml(path, features)


EXPORTERS: Final[dict[str, Exporter]] = {
    exporter.name: exporter
    for exporter in (
        _TextTable(name="csv", endings=(".csv", ".txt"), lines=_csv_lines),
        MapExporter(
            name="geojson", endings=(".geojson", ".json", ".txt"), is_text=True,
            write_features=_write_geojson, takes_crs=True, takes_local=False,
        ),
        MapExporter(
            name="gpkg", endings=(".gpkg",), write_features=write_geopackage, takes_crs=True, takes_local=True
        ),
        MapExporter(name="kml", endings=(".kml",), write_features=_write_kml, takes_crs=False, takes_local=False),
        _TextTable(name="jsonl", endings=(".jsonl", ".json", ".txt"), lines=_json_lines),
        _WholeRecording(
            name="parquet", endings=(".parquet",), with_images=False, of_measurements=True,
            write_recording=_write_parquet,
        ),
        _WholeRecording(name="mcap", endings=(".mcap",), write_recording=_write_mcap),
        _WholeRecording(name="mp4", endings=(".mp4",), write_recording=_write_mp4),
    )
}  # fmt: skip
"""All formats by name; the first is the default."""
