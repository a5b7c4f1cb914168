"""``aerodft compare``: two recordings side by side."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from aerodft.cli.output import print_json, say, tables
from aerodft.errors import NoAnswerError
from replay.compare import Comparison, Difference, compare_recordings
from replay.recording import Recording

_DIFFERENT = 5


def compare(
    first: Annotated[Path, typer.Argument(help="A recording's folder.")],
    second: Annotated[Path, typer.Argument(help="Another recording's folder.")],
    tolerance: Annotated[
        float, typer.Option(help="Largest difference of values and stds that counts as equal, in their unit.", min=0)
    ] = 0.0,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    r"""Compare two recordings measurement by measurement; exit 5 where they differ.

    \b
    Example:
      aerodft compare flights/2026-11-21 recomputed --tolerance 0.01
    """
    comparison = compare_recordings(Recording(first), Recording(second))
    if not (comparison.common or comparison.only_first or comparison.only_second):
        raise NoAnswerError("no measurements in either recording", where=f"{first}, {second}")
    differs = comparison.differs(tolerance)
    if json:
        document = asdict(comparison)
        document["identical"] = document.pop("is_identical")
        print_json({"first": str(first), "second": str(second), "differs": differs, **document})
    else:
        _show(comparison, differs=differs)
    if differs:
        raise typer.Exit(_DIFFERENT)


def _show(comparison: Comparison, *, differs: bool) -> None:
    table = Table("probe", "pairs", "max", "median", "max std change", "max in stds", "median in stds")
    for name, difference in comparison.probes.items():
        table.add_row(name, *_cells(difference))
    table.add_row("all", *_cells(comparison.total))
    console = tables()
    console.print(table)
    for change, count in comparison.status_changes.items():
        console.print(f"status {change}: {count}")
    say(
        f"{comparison.common} in both, {comparison.only_first} in the first alone,"
        f" {comparison.only_second} in the second alone: {_verdict(comparison, differs=differs)}"
    )


def _verdict(comparison: Comparison, *, differs: bool) -> str:
    if comparison.is_identical:
        return "identical to the byte"
    return "different" if differs else "equal within the tolerance"


def _cells(difference: Difference) -> tuple[str, ...]:
    def shown(value: float | None, unit: str = "") -> str:
        return "" if value is None else f"{value:.6g}{unit and ' ' + unit}"

    return (
        str(difference.count),
        shown(difference.max_abs, difference.unit),
        shown(difference.median_abs, difference.unit),
        shown(difference.max_std_abs, difference.unit),
        shown(difference.max_sigmas),
        shown(difference.median_sigmas),
    )
