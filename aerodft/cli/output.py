"""What commands print: JSON or tables on stdout, progress and words on stderr."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import orjson
import typer
from rich.cells import cell_len
from rich.console import Console
from rich.progress import Progress as ProgressBar
from rich.table import Table
from rich.text import Text

from aerodft.app import Progress
from aerodft.cli.interrupts import end_if_signalled
from aerodft.cli.options import as_typed
from aerodft.errors import InputError, UsageError, printable

if TYPE_CHECKING:
    from replay.recordings import LeftOut

_SAY_EVERY_S = 10.0
_FILE_WIDTH = 132
"""Columns of a table that goes to a pipe or a file, where nothing says how wide it may be."""

LOSS: Final = 5
"""Exit code of what is done, and not whole."""


def end_with_gaps(left_out: "LeftOut") -> None:
    """Say what of the input could not be read.

    Raises:
        Exit: With 5, where there is such.
    """
    if left_out:
        say(f"aerodft: {left_out.sentence}")
        raise typer.Exit(LOSS)


def json_bytes(document: object) -> bytes:
    """A JSON document for people and programs, as it is printed and written to files."""
    return orjson.dumps(document, option=orjson.OPT_APPEND_NEWLINE | orjson.OPT_INDENT_2)


def print_json(document: object) -> None:
    """One JSON document on stdout."""
    data = json_bytes(document)
    if sys.stdout.isatty():  # JSON escapes some control characters, a terminal obeys others too
        text = data.decode()
        data = "".join(each if each.isprintable() or each == "\n" else json.dumps(each)[1:-1] for each in text).encode()
    sys.stdout.buffer.write(data)
    sys.stdout.flush()


class _PrintableConsole(Console):
    """A console that shows control characters in texts as what they are, and obeys none."""

    def render_str(self, text: str, **options: Any) -> Text:  # noqa: ANN401 - the library's own
        """A text that is to be shown."""
        return super().render_str("\n".join(map(printable, text.split("\n"))), **options)

    def print(self, *objects: Any, **options: Any) -> None:  # noqa: ANN401 - the library's own
        """Print tables and texts; no word and no number of a table is cut, however narrow the terminal."""
        super().print(*(_fitted(each, self.width) if isinstance(each, Table) else each for each in objects), **options)


def _fitted(table: Table, width: int) -> Table | str:
    """A table whose columns are as wide as their longest words; a paragraph for each row where these have no room."""
    columns = [[str(cell) for cell in (column.header, *column.cells)] for column in table.columns]
    longest = [max((cell_len(word) for cell in cells for word in cell.split()), default=0) for cells in columns]
    spare = width - sum(longest) - 3 * len(columns) - 1
    if spare >= 0:
        for column, cells, least in zip(table.columns, columns, longest, strict=True):
            column.width = min(least + spare, max(cell_len(line) for cell in cells for line in f"{cell}\n".split("\n")))
            spare -= column.width - least
        return table
    lines = [] if table.title is None else [str(table.title)]
    _, *names = [" ".join(cells[0].split()) for cells in columns]
    for name, *values in zip(*(cells[1:] for cells in columns), strict=True):
        lines += [name, *(f"  {key}: {value}" for key, value in zip(names, values, strict=True) if value)]
    return "\n".join(lines)


def tables() -> Console:
    """A console for tables on stdout; names from files are shown as they are, not as markup."""
    is_file = not sys.stdout.isatty() and "COLUMNS" not in os.environ
    return _PrintableConsole(markup=False, emoji=False, highlight=False, width=_FILE_WIDTH if is_file else None)


def check_output(output: Path | None, inputs: Iterable[Path]) -> None:
    """Refuse a file to write that cannot be one, before the work is done for nothing.

    Args:
        output: The file; None for none.
        inputs: Files that it must not replace.

    Raises:
        UsageError: It is one of the inputs.
        InputError: It is a folder, or its folder is missing.
    """
    if output is None:
        return
    for each in inputs:
        if output.exists() and each.exists() and output.samefile(each):
            hint = "write to another file"
            raise UsageError("--output", got=f"{output}, which is read", expected="a file of its own", hint=hint)
    if output.is_dir():
        raise InputError("--output", where=output, got="a folder", expected="a file to write to")
    if not output.absolute().parent.is_dir():
        raise InputError("--output", where=output, got="a folder that is missing", hint="make the folder first")


def say(text: str) -> None:
    """A sentence for a person, on stderr."""
    lines = "\n".join(map(printable, text.split("\n")))
    print(as_typed(lines), file=sys.stderr, flush=True)  # noqa: T201 - the command line speaks on stderr


@contextmanager
def progress(what: str, clock: Callable[[], float] = time.monotonic) -> Iterator[Progress]:
    """Progress of a use case on stderr: a bar on a terminal, elsewhere a line every 10 s.

    Args:
        what: Is done.
        clock: Seconds.

    Yields:
        What the use case calls with how much is done, and of how much.
    """
    console = Console(stderr=True)
    said_s = clock()

    def line(done: int, total: int) -> None:
        nonlocal said_s
        end_if_signalled()
        if clock() - said_s >= _SAY_EVERY_S:
            said_s = clock()
            say(f"aerodft: {what}: {100 * done // max(total, 1)} %")

    if not console.is_terminal:
        yield line
        return
    with ProgressBar(console=console, transient=True) as bar:
        task = bar.add_task(what, total=None)

        def show(done: int, total: int) -> None:
            end_if_signalled()
            bar.update(task, completed=done, total=max(total, 1))

        yield show
