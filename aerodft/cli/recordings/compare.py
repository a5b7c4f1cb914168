"""``aerodft compare``: two recordings side by side."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.table import Table

from aerodft.adapters.files import whole_file
from aerodft.cli.options import JsonOption, OverwriteOption
from aerodft.cli.output import LOSS, check_output, print_json, say, tables

if TYPE_CHECKING:
    from replay.compare import Comparison, Difference


def compare(
    first: Annotated[Path, typer.Argument(help="A recording's folder, or a CSV or Parquet file exported from one.")],
    second: Annotated[Path, typer.Argument(help="Recording or table to compare with.")],
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            help="What counts as equal: 0.01m, 0.1deg (of values and of stds), 0.5std (combined), 1% (of the first"
            " value), 0.01 (in each one's unit). Several, with commas or repeated: each holds. None: 0."
        ),
    ] = None,
    pair: Annotated[
        Literal["auto", "image", "stamp"],
        typer.Option(help="What makes a pair: auto is image where both are of the same images, else stamp."),
    ] = "auto",
    max_stamp_gap: Annotated[
        float, typer.Option(help="Stamps of a pair are at most so far apart, s, where stamps make pairs.", min=0)
    ] = 0.01,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Plot the differences: PNG, SVG or PDF, by its ending.")
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    r"""Compare two recordings measurement by measurement; docs/compare.md says what the figures are.

    Exit code 0: equal within the tolerance. 5: something is farther apart, missing in one, or of another status. 3: not
    readable. 4: no measurement in either.

    \b
    Example:
      aerodft compare flights/2026-11-21 recomputed --tolerance 0.01m,0.5std
      aerodft compare flights/2026-11-21 expected.parquet --tolerance 1e-9 --json
    """
    from aerodft.app.recordings import compare as compare_recordings
    from aerodft.reports.comparison import plot_comparison
    from aerodft.reports.style import figure_format

    check_output(output, (first, second))
    comparison = compare_recordings(
        first, second, tolerance=tolerance or (), pair_by=pair, max_stamp_gap_s=max_stamp_gap
    )
    if output is not None:
        with whole_file(output, overwrite=overwrite) as partial:
            plot_comparison(comparison, partial, figure_format(output))
    if json:
        print_json(comparison.to_dict())
    else:
        _show(comparison, f"{second} minus {first}")
    if comparison.differs:
        raise typer.Exit(LOSS)


def _show(comparison: "Comparison", title: str) -> None:
    """A row of differences for each probe, what else changed, and the sentences on them."""
    names = (
        "probe",
        "pairs",
        "mean",
        "median",
        "95 %",
        "max",
        "rms",
        "max std change",
        "in stds: median",
        "in stds: max",
    )
    table = Table(*names, title=title, title_justify="left")
    for name, difference in comparison.probes.items():
        table.add_row(name, *_cells(difference))
    table.add_row("all", *_cells(comparison.total))
    console = tables()
    console.print(table)
    for name, difference in comparison.probes.items():
        for line in _changes(difference):
            console.print(f"{name}: {line}")
    for sentence in _sentences(comparison):
        say(sentence)


def _changes(difference: "Difference") -> list[str]:
    """Lines on other changes of one probe: statuses, and measurements of one side alone."""
    lines = [f"status {change}: {count}" for change, count in difference.status_changes.items()]
    counts = (
        (difference.only_first, "in the first alone"),
        (difference.only_second, "in the second alone"),
        (difference.beyond, f"of {difference.count} past the tolerance"),
    )
    return lines + [f"{count} {what}" for count, what in counts if count]


def _sentences(comparison: "Comparison") -> list[str]:
    shift = "" if not comparison.shift_s else f"; the second's stamps are {comparison.shift_s:+.6f} s off the first's"
    sentences = [f"paired by {comparison.paired_by}{shift}"]
    total = comparison.total
    if total.max_sigmas is not None:
        sentences.append("stds are combined as if the two were independent (root of the summed variances)")
    if comparison.is_same_input and total.max_abs != 0 and total.median_shared_sigmas is not None:
        sentences.append(
            "both are of the same pixels and telemetry: with shared errors the differences are"
            f" {total.median_shared_sigmas:.3g} stds in the median, {total.p95_shared_sigmas:.3g} at 95 %"
        )
    if not total.paired:
        sentences.append(
            "nothing is paired: --pair image takes the same index, --max-stamp-gap more time between stamps"
        )
    verdict = "different" if comparison.differs else "equal within the tolerance"
    if comparison.is_identical:
        verdict = "identical to the byte"
    sentences.append(
        f"{total.paired} in both, {total.only_first} in the first alone,"
        f" {total.only_second} in the second alone: {verdict}"
    )
    return sentences


def _cells(difference: "Difference") -> tuple[str, ...]:
    def shown(value: float | None, unit: str = "") -> str:
        return "" if value is None else f"{value:.4g}{unit and ' ' + unit}"

    in_units = (difference.mean, difference.median_abs, difference.p95_abs, difference.max_abs, difference.rms)
    return (
        str(difference.count),
        *(shown(value, difference.unit) for value in in_units),
        shown(difference.max_std_abs, difference.unit),
        shown(difference.median_sigmas),
        shown(difference.max_sigmas),
    )
