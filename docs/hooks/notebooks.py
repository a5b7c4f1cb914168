"""Notebooks of the site: Python files in the percent format, executed as they are built, with what they print and draw.

A cell begins with ``# %%``, one of text with ``# %% [markdown]``: editors and Jupyter (by Jupytext) open such files.
"""

import ast
import base64
import contextlib
import io
import os
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import orjson
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs/notebooks"
IN_HERE = ("configs", "samples")
"""What of the repository a notebook finds beside it."""

_CELL = re.compile(r"^# %%(?P<text> \[markdown\])?.*\n", re.MULTILINE)
_DPI = 110


@dataclass
class Cell:
    """A part of a notebook.

    Attributes:
        source: Markdown, or Python.
        is_text: Whether it is Markdown.
        line: Of the file, above it.
        said: What it printed, and its last value.
        pictures: What it drew, as PNG.
    """

    source: str
    is_text: bool
    line: int
    said: str = ""
    pictures: list[bytes] = field(default_factory=list)


def cells_of(text: str) -> list[Cell]:
    """The cells of a file."""
    marks = list(_CELL.finditer(text))
    ends = [*(mark.start() for mark in marks[1:]), len(text)]
    found = []
    for mark, end in zip(marks, ends, strict=True):
        source = text[mark.end() : end].strip("\n")
        if mark["text"]:
            source = re.sub(r"^# ?", "", source, flags=re.MULTILINE)
        found.append(Cell(source, is_text=bool(mark["text"]), line=text.count("\n", 0, mark.end())))
    return found


def executed(path: Path) -> list[Cell]:
    """The cells of a notebook with what they print and draw, run in an empty folder; what they raise is raised."""
    cells, names = cells_of(path.read_text(encoding="utf-8")), dict[str, Any](__name__="__main__")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name in IN_HERE:
            Path(name).symlink_to(ROOT / name)
        for cell in cells:
            if not cell.is_text:
                _run(cell, names, path)
    return cells


def _run(cell: Cell, names: dict[str, Any], path: Path) -> None:
    """Run a cell, and show the value of its last line as Jupyter does."""
    tree, said = ast.parse(cell.source, str(path)), io.StringIO()
    ast.increment_lineno(tree, cell.line)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(said):
        exec(compile(tree, path, "exec"), names)  # noqa: S102 - a notebook of this repository
        value = None if last is None else eval(compile(ast.Expression(last.value), path, "eval"), names)  # noqa: S307
        if picture := _picture(value):
            cell.pictures.append(picture)
        elif value is not None:
            print(repr(value))  # noqa: T201 - into the page
    cell.said = said.getvalue()


def _picture(value: object) -> bytes | None:
    """A figure, or what says itself how it looks as PNG."""
    if isinstance(value, Figure):
        data = io.BytesIO()
        value.savefig(data, format="png", dpi=_DPI)
        return data.getvalue()
    show = getattr(value, "_repr_png_", None)
    return None if show is None else bytes(show())


def pages() -> Iterator[tuple[str, str | bytes]]:
    """Pages, pictures and notebooks to download, by their path in the site."""
    os.environ["MPLBACKEND"] = "Agg"
    for path in sorted(FOLDER.glob("*.py")):
        cells, stem = executed(path), path.stem
        parts = []
        for number, cell in enumerate(cells):
            parts.append(cell.source if cell.is_text else f"```python\n{cell.source}\n```")
            if cell.said:
                parts.append(f"```text\n{cell.said.rstrip()}\n```")
            for at, picture in enumerate(cell.pictures):
                name = f"{stem}-{number}-{at}.png"
                parts.append(f"[![What the lines above draw]({name})]({name})")
                yield f"notebooks/{name}", picture
        title, *rest = parts
        note = f"Executed when this page was built; [{stem}.ipynb]({stem}.ipynb) is the notebook to run yourself."
        yield f"notebooks/{stem}.md", "\n\n".join([title, note, *rest]) + "\n"
        yield f"notebooks/{stem}.ipynb", _document(cells)


def _document(cells: list[Cell]) -> bytes:
    """The notebook as Jupyter keeps it, with what its cells print and draw."""
    found: list[dict[str, Any]] = []
    for number, cell in enumerate(cells):
        common = {"id": f"cell-{number}", "metadata": {}, "source": cell.source}
        if cell.is_text:
            found.append({"cell_type": "markdown", **common})
            continue
        outputs: list[dict[str, Any]] = []
        if cell.said:
            outputs.append({"output_type": "stream", "name": "stdout", "text": cell.said})
        for picture in cell.pictures:
            data = {"image/png": base64.b64encode(picture).decode()}
            outputs.append({"output_type": "display_data", "metadata": {}, "data": data})
        found.append({"cell_type": "code", "execution_count": None, "outputs": outputs, **common})
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return orjson.dumps({"nbformat": 4, "nbformat_minor": 5, "metadata": kernel, "cells": found})
