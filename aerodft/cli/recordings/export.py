"""``aerodft export``: a recording's measurements as tables, maps, one file or a video."""

import sys
from collections.abc import Iterator
from dataclasses import asdict
from enum import StrEnum
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.atomic_file import whole_file
from aerodft.cli.output import end_with_gaps, print_json, say
from aerodft.errors import NoAnswerError, UsageError, located
from replay.export import ExportFormat, export_text, merge_segments
from replay.recordings import Recording


class Format(StrEnum):
    """What a recording can be written as."""

    CSV = "csv"
    GEOJSON = "geojson"
    JSONL = "jsonl"
    PARQUET = "parquet"
    MCAP = "mcap"
    MP4 = "mp4"


_TEXT = frozenset(map(str, ExportFormat))
_OTHER_FILES = frozenset({".avi", ".bag", ".kml", ".mkv", ".mov", ".shp", ".webm", ".xlsx"})
_UNCLEAR = ".json"  # a map, or lines
_WITH_IMAGES = frozenset({Format.MCAP, Format.MP4})


def export(
    recording: Annotated[Path, typer.Argument(help="The recording's folder.")],
    form: Annotated[
        Format | None,
        typer.Option(
            "--format",
            help="Tables (csv, parquet), a map (geojson), JSON lines (jsonl), the whole recording as one file (mcap),"
            " the recorded images with what was measured in them (mp4). By default the output's ending, or csv.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File to write; without it, text goes to stdout.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file where there is one.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON; needs --output.")] = False,
) -> None:
    r"""Write a recording's measurements as a table or a map, its segments as one file, or its images as a video.

    docs/tables.md says what the columns are. One MCAP file holds all messages by time, and what lies beside the
    segments as attachments. Exit 5 where damaged or missing parts of the recording are not in it.

    \b
    Example:
      aerodft export flights/2026-11-21 -o widths.geojson
      aerodft export flights/2026-11-21 --format mp4 -o flight.mp4
    """
    form = _format_of(form, output)
    if output is None and (json or form not in _TEXT):
        what = "--json" if json else f"--format {form}"
        raise UsageError(f"{what} without --output", expected="-o FILE: stdout has room for one document")
    if output == Path("-"):
        raise UsageError("--output", got="-", expected="a file", hint="without --output, text goes to stdout")
    source = Recording(recording)
    if output is None:
        with located(recording):
            sys.stdout.writelines(export_text(_measurements(source), ExportFormat(form)))
        end_with_gaps(source.left_out())
        return
    _check_is_beside(output, recording)
    with whole_file(output, overwrite=overwrite) as partial, located(recording):
        written = _write(source, form, partial)
    left_out = source.left_out(images=form in _WITH_IMAGES)
    if json:
        print_json({"file": str(output), "format": form, **written, **left_out})
    else:
        said = ", ".join(f"{count} {what.replace('_', ' ')}" for what, count in written.items() if count)
        say(f"{output}: {said}")
    end_with_gaps(left_out)


def _format_of(form: Format | None, output: Path | None) -> Format:
    """What is asked for, or else what the output's name says.

    Raises:
        UsageError: The name says something else.
    """
    ending = "" if output is None else output.suffix.lower()
    named = next((each for each in Format if ending == f".{each}"), None)
    is_other = ending == _UNCLEAR if form is None else named not in {None, form}
    if is_other or ending in _OTHER_FILES:
        got = f"{ending} with --format {form}" if form is not None else ending
        expected = f"a name that ends with .{form}" if form is not None else f"one of .{', .'.join(Format)}"
        raise UsageError("--output", got=got, expected=expected)
    return form or named or Format.CSV


def _check_is_beside(output: Path, recording: Path) -> None:
    """Refuse a file that would be read as one of the recording's segments from then on.

    Raises:
        UsageError: It would.
    """
    if output.suffix == ".mcap" and output.resolve().parent == recording.resolve():
        what = f"{output.name} among the recording's own segments"
        raise UsageError("--output", got=what, expected="a file elsewhere", hint="it would be read as one of them")


def _write(source: Recording, form: Format, path: Path) -> dict[str, int]:
    """Write the file; returns what is in it, for people and programs."""
    if form is Format.MCAP:
        merged = merge_segments(source, path)
        return {"messages": merged.messages, "attachments": merged.attachments}
    if form is Format.MP4:
        from replay.export import write_video

        return asdict(write_video(source, path))
    payloads = _measurements(source)
    if form is Format.PARQUET:
        from replay.export import ParquetRows

        with ParquetRows(path) as rows:
            rows.add(payloads)
        return {"measurements": rows.count}
    counted = _Count(payloads)
    with path.open("w", encoding="utf-8", newline="") as file:
        file.writelines(export_text(counted, ExportFormat(form)))
    return {"measurements": counted.value}


def _measurements(source: Recording) -> Iterator[bytes]:
    """The recording's measurements.

    Raises:
        NoAnswerError: There is none.
    """
    payloads = source.measurements()
    first = next(payloads, None)
    if first is None:
        raise NoAnswerError("the recording holds no measurement", where=source.folder)
    return chain((first,), payloads)


class _Count:
    """Counts what passes."""

    def __init__(self, payloads: Iterator[bytes]) -> None:
        self._payloads = payloads
        self.value = 0

    def __iter__(self) -> Iterator[bytes]:
        for payload in self._payloads:
            self.value += 1
            yield payload
