"""``aerodft export``: a recording's measurements as a table or a map."""

import os
import sys
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from aerodft.cli.output import print_json, say
from aerodft.errors import InputError, NoAnswerError, UsageError
from replay.export import ExportFormat, export_text
from replay.recording import Recording


def export(
    recording: Annotated[Path, typer.Argument(help="The recording's folder.")],
    form: Annotated[ExportFormat, typer.Option("--format", help="Table or map.")] = ExportFormat.CSV,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File to write; without it, stdout.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON; needs --output.")] = False,
) -> None:
    r"""Write a recording's measurements as CSV or GeoJSON.

    \b
    Example:
      aerodft export flights/2026-11-21 --format geojson -o widths.geojson
    """
    if json and output is None:
        raise UsageError("--json without --output", expected="-o FILE: stdout has room for one document")
    payloads = Recording(recording).measurements()
    first = next(payloads, None)
    if first is None:
        raise NoAnswerError("the recording holds no measurement", where=recording)
    count = _Count(chain((first,), payloads))
    pieces = export_text(count, form)
    if output is None:
        sys.stdout.writelines(pieces)
        return
    _write(output, pieces)
    if json:
        print_json({"file": str(output), "format": form, "measurements": count.value})
    else:
        say(f"{output}: {count.value} measurements")


class _Count:
    """Counts what passes."""

    def __init__(self, payloads: Iterable[bytes]) -> None:
        self._payloads = payloads
        self.value = 0

    def __iter__(self) -> Iterator[bytes]:
        for payload in self._payloads:
            self.value += 1
            yield payload


def _write(path: Path, pieces: Iterator[str]) -> None:
    """Write a file as a whole or not at all; a device or a pipe, which must stay what it is, piece by piece.

    Raises:
        InputError: It cannot be written.
    """
    target = path.resolve()
    try:
        if target.exists() and not target.is_file():
            with target.open("w", encoding="utf-8", newline="") as file:
                file.writelines(pieces)
            return
        partial = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            with partial.open("w", encoding="utf-8", newline="") as file:
                file.writelines(pieces)
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise InputError("the file cannot be written", where=path, got=error.strerror) from error
