"""Recordings read by people: opened as tables, exported, compared, recovered."""

import logging
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import tomli_w

from aerodft.adapters.config.station import parse_station, resolved_toml
from aerodft.adapters.files import check_ending, whole_file
from aerodft.adapters.recording.recover import Recovery, is_recording, recordings_in, recover_folder
from aerodft.app.assembly import recorded_station
from aerodft.errors import AerodftError, InputError, NoAnswerError, UsageError, located
from aerodft.reports.river_folder import is_river_folder, read_river_folder
from replay.compare import MAX_STAMP_GAP_S, Comparison, PairBy, compare_measurements, parse_tolerance
from replay.export import (
    COLUMNS,
    EXPORTERS,
    ColumnType,
    Exporter,
    MapCrs,
    MapExporter,
    arrow_table,
    best_image,
    parse_measurement,
    row_of,
)
from replay.recordings import LeftOut, Recording

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from aerodft.model import Probe

T = TypeVar("T")

_TELLING: Final = ("camera", "pose", "telemetry", "ground", "limits")  # tables that numbers follow from
_REQUIRED: Final = ("station", "camera", "pose")  # tables without which there is no station
_NAMES: Final = frozenset({"name", "lens", "model"})
_OF_LINKS: Final = frozenset({"baud"})

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Measurements:
    """A recording's measurements as a table, read anew by each method; iterates over rows.

    A row is a dict with the columns of ``aerodft export`` in their order (docs/tables.md): numbers, texts, lists of
    numbers, and None where nothing is known. Iteration raises ``InputError`` where a measurement is damaged.
    """

    _recording: Recording

    def __iter__(self) -> Iterator[dict[str, object]]:
        with located(self._recording.folder):
            for payload in self._recording.measurements():
                yield row_of(parse_measurement(payload))

    def to_arrow(self) -> "pa.Table":
        """The rows as a ``pyarrow.Table``, typed as in a Parquet file.

        Raises:
            InputError: The extra ``parquet`` is not installed, or a measurement is damaged.
        """
        return arrow_table(self)

    def to_pandas(self) -> "pd.DataFrame":
        """The rows as a ``pandas.DataFrame``: times with their zone, whole numbers as ``Int64``, others as float64.

        Raises:
            InputError: The extra ``pandas`` is not installed, or a measurement is damaged.
        """
        try:
            pandas = import_module("pandas")
        except ImportError as error:
            raise InputError("a data frame needs pandas", hint="install aerodft[pandas]") from error
        frame = pandas.DataFrame.from_records(list(self), columns=list(COLUMNS))
        types = {ColumnType.INTEGER: "Int64", ColumnType.NUMBER: "float64"}
        frame = frame.astype({name: types[kind] for name, kind in COLUMNS.items() if kind in types})
        frame["stamp_ns"] = frame["stamp_ns"].astype("int64")  # every measurement has one
        frame["time_utc"] = pandas.to_datetime(frame["stamp_ns"], unit="ns", utc=True)
        return frame


@dataclass(frozen=True)
class StationRecording:
    """A station's recording, open for reading; holds no file open.

    Attributes:
        path: Folder or file.
        reader: Its messages, images and segments.

    Examples:
        >>> import aerodft as ad
        >>> recording = ad.open_recording("tests/cli/frozen-0.1")
        >>> recording.station, [probe.name for probe in recording.probes]
        ('frozen', ['width-a', 'width-b', 'centre', 'field', 'near'])
        >>> widths = [row["value"] for row in recording.measurements() if row["name"] == "width-a"]
        >>> frame = recording.measurements().to_pandas()  # as a table; needs the extra pandas
        >>> len(frame), len(widths)
        (118, 12)
    """

    path: Path
    reader: Recording = field(repr=False)

    @property
    def station(self) -> str:
        """Name of the station that made it."""
        return self.reader.station

    @property
    def start_ns(self) -> int:
        """UTC of the earliest message, ns."""
        return self.reader.start_ns

    @property
    def end_ns(self) -> int:
        """UTC of the latest message, ns."""
        return self.reader.end_ns

    @property
    def is_whole(self) -> bool:
        """Whether every segment was finished; else a recorder was killed, and ``recover`` completes it."""
        return self.reader.is_whole

    @cached_property
    def config(self) -> str | None:
        """The station file that it was made with, as text; None where there is none."""
        return self.reader.text("config.toml")

    @cached_property
    def probes(self) -> "tuple[Probe, ...]":
        """Probes of the recorded station file, measured in every image.

        Raises:
            InputError: There is no station file, or one that this version cannot read.
        """
        return recorded_station(self.reader).pipeline.probes

    @property
    def unmeasured(self) -> dict[str, int]:
        """Images that came and were never measured, by cause (``damaged``, ``dropped``, ...)."""
        return self.reader.unmeasured

    def measurements(self) -> Measurements:
        """All measurements, in the order of measuring."""
        return Measurements(self.reader)

    def plot(self, path: str | Path, probes: Iterable[str] = (), *, overwrite: bool = False) -> tuple[str, ...]:
        """Draw values with their 95 % intervals over time, heights by source, tilt, statuses and events.

        Args:
            path: The figure: ``.png``, ``.svg`` or ``.pdf``.
            probes: Names of those to draw; none for those with most answers, as many as have room.
            overwrite: Whether a file that exists is replaced.

        Returns:
            The names of the probes that are drawn.

        Raises:
            UsageError: The file's ending says another format, or there is no such probe.
            InputError: The recording is damaged, or the file exists or cannot be written.
            NoAnswerError: The recording holds neither measurements nor poses.
        """
        from aerodft.reports import recording_plot, recording_series, style  # figures load slowly

        path, wanted = Path(path), tuple(probes)
        form = style.figure_format(path)
        found = recording_series.read_series(self.reader)
        drawn = recording_plot.chosen_probes(found, wanted)
        with whole_file(path, overwrite=overwrite) as partial:
            recording_plot.write_recording_plot(found, drawn, self.station, partial, form)
        return tuple(each.name for each in drawn)


def open_recording(path: str | Path) -> StationRecording:
    """Open a recording.

    Args:
        path: Its folder, or one MCAP file that its segments were put together in.

    Raises:
        InputError: There is no recording, or it cannot be read.
        NoAnswerError: It holds nothing.

    Examples:
        >>> import aerodft as ad
        >>> recording = ad.open_recording("tests/cli/frozen-0.1")
        >>> (recording.end_ns - recording.start_ns) / 1e9
        8.05
    """
    return StationRecording(Path(path), Recording(Path(path)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportSummary:
    """The file that ``export`` wrote, and counts of its contents.

    Attributes:
        file: The file.
        format: Name of its format.
        counts: How many measurements, messages, images, ... are in it.
        left_out: What the recording lacks.
    """

    file: Path
    format: str
    counts: dict[str, int]
    left_out: LeftOut

    def to_dict(self) -> dict[str, object]:
        """The JSON document of ``aerodft export --json``."""
        return {"file": str(self.file), "format": self.format, **self.counts, **self.left_out.document()}


def export(
    recording: str | Path | StationRecording,
    path: str | Path,
    *,
    form: str | None = None,
    crs: str | None = None,
    overwrite: bool = False,
) -> ExportSummary:
    """Write a recording's measurements as a table or a map, its segments as one file, or its images as a video.

    A GeoPackage has a layer for each kind of thing and a style that QGIS takes up. Where nobody said where the camera
    stands it is in local metres, and says so; KML has no such thing, and features of GeoJSON then have no geometry.

    Args:
        recording: An open recording or its path; or for a map a river's folder, as ``RiverSurvey.save`` writes it.
        path: The file.
        form: ``csv``, ``parquet``, ``geojson``, ``gpkg``, ``kml``, ``jsonl``, ``mcap`` or ``mp4``; None for the file's
            ending, or csv.
        crs: Of a GeoPackage or GeoJSON: a number of EPSG, such as ``EPSG:25832``; None for WGS84.
        overwrite: Whether a file that exists is replaced.

    Raises:
        UsageError: The file's ending says another format, it would be one of the recording's segments, or ``crs`` is
            none, of no map, or of what has no place.
        InputError: The recording is damaged, the file exists or cannot be written, or an extra is not installed.
        NoAnswerError: The recording holds no measurement, or for a video no image.

    Examples:
        >>> import aerodft as ad
        >>> ad.export("tests/cli/frozen-0.1", "widths.geojson").counts
        {'measurements': 118}
    """
    path = Path(path)
    exporter = choose_exporter(form, path, crs)
    if isinstance(recording, str | Path) and is_river_folder(Path(recording)):
        return _export_river(Path(recording), path, exporter, crs=crs, overwrite=overwrite)
    opened = recording if isinstance(recording, StationRecording) else open_recording(recording)
    if path.suffix == ".mcap" and path.resolve().parent == opened.path.resolve():
        got = f"{path.name} among the recording's own segments"
        raise UsageError("`path`", got=got, expected="a file elsewhere", hint="it would be read as one of them")
    with whole_file(path, overwrite=overwrite) as partial, located(opened.path):
        counts = exporter.write(opened.reader, partial, _crs_of_recording(opened.reader, exporter, crs))
    left_out = opened.reader.left_out(images=exporter.with_images)
    return ExportSummary(file=path, format=exporter.name, counts=counts, left_out=left_out)


def _export_river(folder: Path, path: Path, exporter: Exporter, *, crs: str | None, overwrite: bool) -> ExportSummary:
    """Write the map of a river's folder."""
    if not isinstance(exporter, MapExporter):
        endings = sorted(each.endings[0] for each in EXPORTERS.values() if isinstance(each, MapExporter))
        expected = f"a map: {', '.join(endings)}"
        hint = "transects.csv is its table"
        raise UsageError("`form` of a river's folder", got=exporter.name, expected=expected, hint=hint)
    river = read_river_folder(folder)
    if river.is_local and not exporter.takes_local:
        hint = "write .gpkg, or say `lat_deg` and `lon_deg` to the survey"
        what = f"{exporter.name} of a river in local metres"
        raise UsageError(what, where=folder, expected="a place on Earth", hint=hint)
    system = _map_crs(crs, exporter, folder, is_local=river.is_local)
    with whole_file(path, overwrite=overwrite) as partial:
        counts = exporter.write_features(partial, river.features, system)
    return ExportSummary(file=path, format=exporter.name, counts=counts, left_out=LeftOut())


def report(what: str | Path | StationRecording, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write one page about a recording or a river: HTML that needs no other file and no network.

    It says what was measured and how surely, with picture, map, plots and table, what was stated and what assumed, and
    what it was made of: files with their hashes, software.

    Args:
        what: An open recording or its path; or a river's folder, as ``RiverSurvey.save`` writes it.
        path: The page.
        overwrite: Whether a file that exists is replaced.

    Returns:
        The page.

    Raises:
        UsageError: The file's ending says another format.
        InputError: What it is about is damaged, or the file exists or cannot be written.
        NoAnswerError: The recording holds neither measurements nor poses.

    Examples:
        >>> import aerodft as ad
        >>> page = ad.report("tests/cli/frozen-0.1", "report.html")
        >>> "width-a" in page.read_text()
        True
    """
    from aerodft.reports import page, recording_plot, recording_series, style  # figures load slowly

    path = Path(path)
    check_ending(path, ".html", ".htm")
    if isinstance(what, str | Path) and is_river_folder(Path(what)):
        text = page.river_page(read_river_folder(Path(what)))
    else:
        opened = what if isinstance(what, StationRecording) else open_recording(what)
        found = recording_series.read_series(opened.reader)
        best = best_image(opened.reader, style.colours_of(each.name for each in found.probes.values()))
        lacks = [sentence] if (sentence := opened.reader.left_out(images=True).sentence) else []
        causes = [f"{number} {cause}" for cause, number in opened.unmeasured.items() if number]
        lacks += [f"images that were never measured: {', '.join(causes)}"] if causes else []
        facts = page.RecordingFacts(
            path=opened.path,
            station=opened.station,
            start_ns=opened.start_ns,
            end_ns=opened.end_ns,
            settings=_settings(opened),
            lacks=lacks,
            best=None if best is None else (best[0].index, best[1]),
        )
        text = page.recording_page(found, recording_plot.chosen_probes(found, ()), facts)
    with whole_file(path, overwrite=overwrite) as partial:
        partial.write_text(text, encoding="utf-8")
    return path


def _settings(recording: StationRecording) -> list[tuple[str, str, bool]]:
    """Numbers and names of a recording's station file by key; whether each is what the software assumes by itself.

    Addresses, paths and keys of links are none of a reader's business.
    """
    if recording.config is None:
        return []
    stated = tomllib.loads(recording.config)
    least: dict[str, Any] = {name: stated[name] for name in _REQUIRED if name in stated}
    if "telemetry" in stated:
        height = stated["telemetry"].get("height", {})
        least["telemetry"] = {"height": {key: height[key] for key in ("order", "manual_m") if key in height}}
    try:
        where = str(recording.path)
        by_default = parse_station(tomli_w.dumps(least).encode(), where=where, folder=recording.path)
        defaults = dict(_flat(tomllib.loads(resolved_toml(by_default))))
    except AerodftError:
        defaults = {}
    required = dict(_flat(least))
    return [
        (key, value, key not in required and defaults.get(key) == value)
        for key, value in _flat({name: stated[name] for name in _TELLING if name in stated})
    ]


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """The values of a TOML table and of those in it by their paths; lists in one line, texts only where they name."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        elif isinstance(value, list) and not any(isinstance(each, dict | list) for each in value):
            yield f"{prefix}{key}", ", ".join(map(str, value))
        elif (isinstance(value, int | float) and key not in _OF_LINKS) or key in _NAMES:
            yield f"{prefix}{key}", str(value)


def choose_exporter(form: str | None, path: Path | None, crs: str | None = None) -> Exporter:
    """Choose an export format by its name, else by the file's ending, else the first one.

    Raises:
        UsageError: There is no such format, the ending is of another one, or a ``crs`` is given to a format in WGS84.
    """
    if form is not None and form not in EXPORTERS:
        raise UsageError("`form`", got=form, expected=f"one of {', '.join(EXPORTERS)}")
    ending = "" if path is None else path.suffix.lower()
    chosen = None if form is None else EXPORTERS[form]
    named = next((each for each in EXPORTERS.values() if ending == each.endings[0]), None)
    if chosen is None and ending and named is None:
        endings = ", ".join(each.endings[0] for each in EXPORTERS.values())
        raise UsageError("`path`", got=ending, expected=f"one of {endings}")
    if chosen is not None and ending and ending not in chosen.endings:
        expected = f"a name that ends with {chosen.endings[0]}"
        raise UsageError("`path`", got=f"{ending} with `form` {form}", expected=expected)
    exporter = chosen or named or next(iter(EXPORTERS.values()))
    if crs is not None:
        _check_takes_crs(exporter)
        MapCrs.from_epsg(crs)
    return exporter


def _check_takes_crs(exporter: Exporter) -> None:
    if isinstance(exporter, MapExporter) and exporter.takes_crs:
        return
    is_map = isinstance(exporter, MapExporter)
    why = f"{exporter.name.upper()} is in WGS84" if is_map else "a table's latitudes and longitudes are of WGS84"
    raise UsageError(f"`crs` for {exporter.name}", expected="a GeoPackage or GeoJSON", hint=why)


def exported_text(recording: StationRecording, exporter: Exporter, crs: str | None = None) -> Iterator[str]:
    """A recording's measurements as text, piece by piece.

    Raises:
        UsageError: The ``crs`` is none, or nothing in the recording has a place.
        InputError: A measurement is damaged.
        NoAnswerError: There is none.
    """
    reader = recording.reader
    with located(recording.path):
        system = _crs_of_recording(reader, exporter, crs)
        yield from exporter.text(map(parse_measurement, reader.measurements()), system)


def _crs_of_recording(recording: Recording, exporter: Exporter, crs: str | None) -> MapCrs:
    """Choose the coordinate system of a recording's map; WGS84 for other formats.

    Raises:
        UsageError: There is no such ``crs``, or the map needs a place and nothing in the recording has one.
        NoAnswerError: The recording holds no measurement.
    """
    if exporter.of_measurements and next(recording.measurements(), None) is None:
        raise NoAnswerError("the recording holds no measurement", where=recording.folder)
    if not isinstance(exporter, MapExporter):
        return MapCrs.wgs84()
    is_local = _is_local(map(parse_measurement, recording.measurements()))
    if is_local and exporter.is_text and crs is None:
        _log.warning("%s: no place is known, and GeoJSON has no metres: write .gpkg for a map", recording.folder)
        return MapCrs.wgs84()
    return _map_crs(crs, exporter, recording.folder, is_local=is_local)


def _is_local(items: Iterable[Mapping[str, Any]]) -> bool:
    """Whether points of measurements are known in metres of the station's origin only."""
    has_metres = False
    for item in items:
        if item.get("geo"):
            return False
        has_metres = has_metres or bool(item.get("enu_m"))
    return has_metres


def _map_crs(crs: str | None, exporter: MapExporter, where: Path, *, is_local: bool) -> MapCrs:
    """Choose the stated system, else WGS84; local metres where no place is known.

    Raises:
        UsageError: The map needs a place and none is known.
    """
    if is_local and (crs is not None or not exporter.takes_local):
        what = "`crs`" if crs is not None else exporter.name.upper()
        hint = "nobody said where the camera stands; write .gpkg without `crs`, in local metres"
        raise UsageError(f"{what} for local metres", where=where, hint=hint)
    if is_local:
        return MapCrs.local()
    return MapCrs.wgs84() if crs is None else MapCrs.from_epsg(crs)


def compare(
    first: str | Path,
    second: str | Path,
    *,
    tolerance: str | Iterable[str] = (),
    pair_by: PairBy | str = PairBy.AUTO,
    max_stamp_gap_s: float = MAX_STAMP_GAP_S,
) -> Comparison:
    """Compare two recordings measurement by measurement; docs/compare.md says what the figures are.

    Args:
        first: A recording's folder, or a CSV or Parquet file exported from one.
        second: What it is compared with.
        tolerance: What counts as equal: ``0.01m``, ``0.1deg`` (of values and of stds), ``0.5std`` (combined), ``1%``
            (of the first value), ``0.01`` (in each one's unit). Of several each holds; none means 0.
        pair_by: What makes a pair: ``auto`` is ``image`` where both are of the same images, else ``stamp``.
        max_stamp_gap_s: How far apart stamps of a pair may be, where stamps make pairs.

    Raises:
        UsageError: The tolerance cannot be read.
        InputError: One of them is neither a recording nor a table, or damaged.
        NoAnswerError: There is no measurement in either.

    Examples:
        >>> import aerodft as ad
        >>> ad.compare("tests/cli/frozen-0.1", "tests/cli/frozen-0.1").is_identical
        True
    """
    limits = parse_tolerance([tolerance] if isinstance(tolerance, str) else tolerance)
    comparison = compare_measurements(
        Path(first), Path(second), limits, by=PairBy(pair_by), max_stamp_gap_s=max_stamp_gap_s
    )
    if comparison.is_empty:
        raise NoAnswerError("no measurements in either recording", where=f"{first}, {second}")
    return comparison


def recover(folder: str | Path) -> list[Recovery]:
    """Complete unfinished segments of recordings in place, and leave out what is damaged; sound ones are not touched.

    Args:
        folder: A recording; or a folder of recordings, of which those are recovered that were not finished and that
            nobody is writing.

    Returns:
        One for each recording, with its segments, their states and what is lost of them.

    Raises:
        InputError: There is no recording, or it is being written.

    Examples:
        >>> import shutil
        >>> import aerodft as ad
        >>> copy = shutil.copytree("tests/cli/frozen-0.1", "copy")
        >>> [segment.state for recovery in ad.recover(copy) for segment in recovery.segments]
        ['sound', 'sound']
    """
    folder = Path(folder)
    below = {} if is_recording(folder) else recordings_in(folder)
    return _recover_unfinished(below) if below else [recover_folder(folder)]


def _recover_unfinished(is_finished: Mapping[Path, bool]) -> list[Recovery]:
    recoveries = []
    for folder in (each for each, is_done in is_finished.items() if not is_done):
        try:
            recoveries.append(recover_folder(folder))
        except InputError as error:  # being written, of another tool: the others are recovered all the same
            _log.warning("%s", error)
    return recoveries


@contextmanager
def recovering_beside(root: Path) -> Iterator[None]:
    """Recover what is unfinished in a folder of recordings, in a process of its own that does not outlive the block."""
    try:
        is_needed = not all(recordings_in(root).values())
    except InputError:  # the recorder will say what is wrong with the folder
        is_needed = False
    if not is_needed:
        yield
        return
    line = [sys.executable, "-m", "aerodft", "recover", str(root.absolute())]
    with subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:  # noqa: S603 - our own
        try:
            yield
        finally:
            process.terminate()  # which costs nothing: no copy takes a segment's name before it is whole
