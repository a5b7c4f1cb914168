"""Recordings read by people: opened as tables, exported, compared, recovered."""

import logging
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cached_property
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final

from aerodft.adapters.atomic_file import whole_file
from aerodft.adapters.recording.recover import Recovery, is_recording, recordings_in, recover_folder
from aerodft.app.assembly import recorded_station
from aerodft.app.incomplete_input import left_out_document
from aerodft.errors import InputError, NoAnswerError, UsageError, located
from replay.compare import MAX_STAMP_GAP_S, Comparison, PairBy, compare_measurements, parse_tolerance
from replay.export import (
    COLUMNS,
    TEXT_FORMATS,
    ExportFormat,
    Kind,
    ParquetRows,
    arrow_table,
    export_text,
    merge_segments,
    parsed,
    row_of,
    write_video,
)
from replay.recordings import LeftOut, Recording

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from aerodft.model import Probe

_WITH_IMAGES: Final = frozenset({ExportFormat.MCAP, ExportFormat.MP4})
_ANY_TEXT: Final = ".txt"
_AMBIGUOUS_SUFFIX: Final = ".json"  # a map, or lines

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
                yield row_of(parsed(payload))

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
        types = {Kind.INTEGER: "Int64", Kind.NUMBER: "float64"}
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

    Example:
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
        """What was measured in every image, by the station file.

        Raises:
            InputError: There is no station file, or one that this version cannot read.
        """
        return recorded_station(self.reader).pipeline.probes

    def measurements(self) -> Measurements:
        """All measurements, in the order in which they were made."""
        return Measurements(self.reader)


def open_recording(path: str | Path) -> StationRecording:
    """Open a recording.

    Args:
        path: Its folder, or one MCAP file that its segments were put together in.

    Raises:
        InputError: There is no recording, or it cannot be read.
        NoAnswerError: It holds nothing.

    Example:
        >>> import aerodft as ad
        >>> recording = ad.open_recording("tests/cli/frozen-0.1")
        >>> (recording.end_ns - recording.start_ns) / 1e9
        8.05
    """
    return StationRecording(Path(path), Recording(Path(path)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportSummary:
    """What ``export`` wrote.

    Attributes:
        file: The file.
        format: Its format.
        counts: How many measurements, messages, images, ... are in it.
        left_out: What the recording lacks.
    """

    file: Path
    format: ExportFormat
    counts: dict[str, int]
    left_out: LeftOut

    def to_dict(self) -> dict[str, object]:
        """The JSON document of ``aerodft export --json``."""
        return {"file": str(self.file), "format": self.format, **self.counts, **left_out_document(self.left_out)}


def export(
    recording: str | Path | StationRecording,
    path: str | Path,
    *,
    form: ExportFormat | str | None = None,
    overwrite: bool = False,
) -> ExportSummary:
    """Write a recording's measurements as a table or a map, its segments as one file, or its images as a video.

    Args:
        recording: An open recording, or its path.
        path: The file.
        form: ``csv``, ``parquet``, ``geojson``, ``jsonl``, ``mcap`` or ``mp4``; None for the file's ending, or csv.
        overwrite: Whether a file that exists is replaced.

    Raises:
        UsageError: The file's ending says another format, or it would be one of the recording's segments.
        InputError: The recording is damaged, the file exists or cannot be written, or an extra is not installed.
        NoAnswerError: The recording holds no measurement, or for a video no image.

    Example:
        >>> import aerodft as ad
        >>> ad.export("tests/cli/frozen-0.1", "widths.geojson").counts
        {'measurements': 118}
    """
    opened = recording if isinstance(recording, StationRecording) else open_recording(recording)
    path, form = Path(path), export_format(form, Path(path))
    if path.suffix == ".mcap" and path.resolve().parent == opened.path.resolve():
        got = f"{path.name} among the recording's own segments"
        raise UsageError("`path`", got=got, expected="a file elsewhere", hint="it would be read as one of them")
    with whole_file(path, overwrite=overwrite) as partial, located(opened.path):
        counts = _write(opened.reader, form, partial)
    left_out = opened.reader.left_out(images=form in _WITH_IMAGES)
    return ExportSummary(file=path, format=form, counts=counts, left_out=left_out)


def export_format(form: ExportFormat | str | None, path: Path | None) -> ExportFormat:
    """The format that was chosen, or else what the file's ending says.

    Raises:
        UsageError: The ending says another.
    """
    chosen, ending = None if form is None else ExportFormat(form), "" if path is None else path.suffix.lower()
    named = next((each for each in ExportFormat if ending == f".{each}"), None)
    is_json = ending == _AMBIGUOUS_SUFFIX and chosen in {ExportFormat.GEOJSON, ExportFormat.JSONL}
    is_text = ending == _ANY_TEXT and chosen in TEXT_FORMATS
    if ending and not is_json and not is_text and (named is None or chosen not in {None, named}):
        got = f"{ending} with `form` {chosen}" if chosen is not None else ending
        expected = f"a name that ends with .{chosen}" if chosen is not None else f"one of .{', .'.join(ExportFormat)}"
        raise UsageError("`path`", got=got, expected=expected)
    return chosen or named or ExportFormat.CSV


def exported_text(recording: StationRecording, form: ExportFormat) -> Iterator[str]:
    """A recording's measurements as text, piece by piece.

    Raises:
        InputError: A measurement is damaged.
        NoAnswerError: There is none.
    """
    with located(recording.path):
        yield from export_text(_payloads(recording.reader), form)


def _write(recording: Recording, form: ExportFormat, path: Path) -> dict[str, int]:
    """Write the file, and count what is in it."""
    if form is ExportFormat.MCAP:
        merged = merge_segments(recording, path)
        return {"messages": merged.messages, "attachments": merged.attachments}
    if form is ExportFormat.MP4:
        return asdict(write_video(recording, path))
    payloads = _payloads(recording)
    if form is ExportFormat.PARQUET:
        with ParquetRows(path) as rows:
            rows.add(payloads)
        return {"measurements": rows.count}
    count = 0

    def counted() -> Iterator[bytes]:
        nonlocal count
        for count, payload in enumerate(payloads, 1):  # noqa: B007 - read below
            yield payload

    with path.open("w", encoding="utf-8", newline="") as file:
        file.writelines(export_text(counted(), form))
    return {"measurements": count}


def _payloads(recording: Recording) -> Iterator[bytes]:
    """The payloads of a recording's measurements.

    Raises:
        NoAnswerError: There is none.
    """
    payloads = recording.measurements()
    first = next(payloads, None)
    if first is None:
        raise NoAnswerError("the recording holds no measurement", where=recording.folder)
    return chain((first,), payloads)


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

    Example:
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

    Example:
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
