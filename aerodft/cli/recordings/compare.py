"""``aerodft compare``: two recordings side by side."""

from collections.abc import Mapping
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Final

import matplotlib as mpl
import numpy as np
import typer
from rich.table import Table

from aerodft.adapters.atomic_file import whole_file
from aerodft.cli.output import check_output, print_json, say, tables
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError, UsageError
from aerodft.model import FloatArray, IntArray
from replay.compare import WITHIN_S, Comparison, ComparisonRun, Difference, PairBy, Pairs, parse_tolerance

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

_DIFFERENT = 5

_MOST_PROBES: Final = 8
_MOST_POINTS: Final = 4000
_GAP_STEPS: Final = 5  # usual steps from one pair to the next
_FORMATS: Final = frozenset({"png", "svg", "pdf"})
_STDS: Final = np.linspace(0, 4, 41)


def compare(
    first: Annotated[Path, typer.Argument(help="A recording's folder, or a CSV or Parquet file exported from one.")],
    second: Annotated[Path, typer.Argument(help="Another.")],
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            help="What counts as equal: 0.01m, 0.1deg (of values and of stds), 0.5std (combined), 1% (of the first"
            " value), 0.01 (in each one's unit). Several, with commas or repeated: each holds. None: 0."
        ),
    ] = None,
    pair: Annotated[
        PairBy,
        typer.Option(help="What makes a pair: auto is image where both are of the same images, else stamp."),
    ] = PairBy.AUTO,
    within: Annotated[
        float, typer.Option(help="Stamps of a pair are at most so far apart, s, where stamps make pairs.", min=0)
    ] = WITHIN_S,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Plot the differences: PNG, SVG or PDF, by its ending.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the plot where there is one.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    r"""Compare two recordings measurement by measurement; docs/compare.md says what the figures are.

    Exit code 0: equal within the tolerance. 5: something is farther apart, missing in one, or of another status. 3: not
    readable. 4: no measurement in either.

    \b
    Example:
      aerodft compare flights/2026-11-21 recomputed --tolerance 0.01m,0.5std
      aerodft compare flights/2026-11-21 expected.parquet --tolerance 1e-9 --json
    """
    limits = parse_tolerance(tolerance or ())
    check_output(output, (first, second))
    comparing = ComparisonRun(first, second, by=pair, within_s=within)
    if comparing.is_empty:
        raise NoAnswerError("no measurements in either recording", where=f"{first}, {second}")
    comparison = comparing.comparison(limits)
    if output is not None:
        with whole_file(output, overwrite=overwrite) as partial:
            plot_differences(comparing.pairs, comparison, partial, output.suffix)
    if json:
        print_json(_document(first, second, comparison))
    else:
        _show(comparison)
    if comparison.differs:
        raise typer.Exit(_DIFFERENT)


def _document(first: Path, second: Path, comparison: Comparison) -> dict[str, object]:
    total = asdict(comparison.total)
    return {
        "first": str(first),
        "second": str(second),
        "differs": comparison.differs,
        "paired_by": comparison.paired_by,
        "shift_s": comparison.shift_s,
        "common": total["paired"],
        **{name: total[name] for name in ("only_first", "only_second", "status_changes", "beyond")},
        "total": total,
        "probes": {name: asdict(each) for name, each in comparison.probes.items()},
        "identical": comparison.is_identical,
        "same_input": comparison.is_same_input,
    }


def _show(comparison: Comparison) -> None:
    table = Table("probe", "pairs", "mean", "median", "95 %", "max", "rms", "max std change", "in stds: median", "max")
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


def _changes(difference: Difference) -> list[str]:
    """What else changed of one probe."""
    lines = [f"status {change}: {count}" for change, count in difference.status_changes.items()]
    counts = (
        (difference.only_first, "in the first alone"),
        (difference.only_second, "in the second alone"),
        (difference.beyond, f"of {difference.count} past the tolerance"),
    )
    return lines + [f"{count} {what}" for count, what in counts if count]


def _sentences(comparison: Comparison) -> list[str]:
    shift = "" if not comparison.shift_s else f"; the second's stamps are {comparison.shift_s:+.6f} s off the first's"
    what = "image" if comparison.paired_by is PairBy.IMAGE else "stamp"
    sentences = [f"paired by {what}{shift}"]
    total = comparison.total
    if total.max_sigmas is not None:
        sentences.append("stds are combined as if the two were independent (root of the summed variances)")
    if comparison.is_same_input and total.max_abs != 0 and total.median_shared_sigmas is not None:
        sentences.append(
            "both are of the same pixels and telemetry: with shared errors the differences are"
            f" {total.median_shared_sigmas:.3g} stds in the median, {total.p95_shared_sigmas:.3g} at 95 %"
        )
    if not total.paired:
        sentences.append("nothing is paired: --pair image takes the same index, --within more time between stamps")
    sentences.append(
        f"{total.paired} in both, {total.only_first} in the first alone,"
        f" {total.only_second} in the second alone: {_verdict(comparison)}"
    )
    return sentences


def _verdict(comparison: Comparison) -> str:
    if comparison.is_identical:
        return "identical to the byte"
    return "different" if comparison.differs else "equal within the tolerance"


def _cells(difference: Difference) -> tuple[str, ...]:
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


def plot_differences(pairs: Mapping[str, Pairs], comparison: Comparison, path: Path, suffix: str) -> None:
    """Second minus first over time with one combined std to both sides, and how often they are how many stds apart.

    The probes that are farthest apart in stds are shown; of more pairs than a picture has columns, the farthest.

    Args:
        pairs: By probe.
        comparison: Their figures.
        path: The file.
        suffix: Says the format: ``.png``, ``.svg``, ``.pdf``.

    Raises:
        UsageError: It says another.
        OSError: It cannot be written.
    """
    form = suffix.lower().lstrip(".") or "png"
    if form not in _FORMATS:
        raise UsageError("--output", got=suffix, expected=" or ".join(sorted(f".{each}" for each in _FORMATS)))
    shown = sorted(pairs, key=lambda name: (-(comparison.probes[name].max_sigmas or 0.0), name))[:_MOST_PROBES]
    figure, panels = plt.subplots(
        len(shown),
        2,
        figsize=(11, 0.8 + 2.4 * len(shown)),
        squeeze=False,
        sharex="col",
        width_ratios=(3, 1),
        layout="constrained",
    )
    start_ns = min((int(each.stamp_ns[0]) for each in pairs.values() if len(each.stamp_ns)), default=0)
    for (left, right), name in zip(panels, shown, strict=True):
        _over_time(left, pairs[name], start_ns)
        left.set_ylabel(f"{name} ({comparison.probes[name].unit})")
        _histogram(right, pairs[name])
    panels[-1, 0].set_xlabel("time since the first measurement (s)")
    panels[-1, 1].set_xlabel("combined stds")
    more = "" if len(shown) == len(pairs) else f" (the {len(shown)} of {len(pairs)} probes farthest apart)"
    figure.suptitle(f"Second minus first, {comparison.total.paired} pairs by {comparison.paired_by}{more}")
    figure.savefig(path, format=form, dpi=110, metadata={"Date": None} if form == "svg" else None)
    plt.close(figure)


def _over_time(panel: Axes, pairs: Pairs, start_ns: int) -> None:
    known = ~np.isnan(pairs.apart.change)
    seconds = (pairs.stamp_ns[known] - start_ns) / SECOND_NS
    change, combined = pairs.apart.change[known], pairs.apart.combined[known]
    rows = _thinned(change)
    panel.axhline(0, color="black", linewidth=0.8)
    at_s, std = with_gaps(seconds[rows], combined[rows])
    panel.fill_between(at_s, -std, std, alpha=0.25, linewidth=0, label="1 combined std")
    panel.plot(seconds[rows], change[rows], ".", markersize=3, label="difference")
    panel.grid(alpha=0.3)
    if len(rows):
        panel.legend(loc="upper right", fontsize="small")
    else:
        panel.text(0.5, 0.6, "no two numbers to compare", ha="center", transform=panel.transAxes)


def with_gaps(seconds: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times and values ``(n,)`` with NaN where nothing was measured for long: no band is drawn across that."""
    steps = np.diff(seconds)
    behind = np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) + 1 if len(steps) else np.zeros(0, dtype=np.int64)
    return np.insert(seconds, behind, seconds[behind]), np.insert(values, behind, np.nan)


def _thinned(change: FloatArray) -> IntArray:
    """Of more rows than can be told apart, the farthest from 0 in each of as many runs."""
    if len(change) <= _MOST_POINTS:
        return np.arange(len(change))
    bounds = np.linspace(0, len(change), _MOST_POINTS + 1).astype(int)
    return np.array([low + np.argmax(np.abs(change[low:high])) for low, high in pairwise(bounds)])


def _histogram(panel: Axes, pairs: Pairs) -> None:
    sigmas = pairs.apart.sigmas[~np.isnan(pairs.apart.sigmas)]
    top = max(_STDS[-1], float(np.ceil(sigmas.max(initial=0.0))))
    panel.hist(sigmas, bins=np.linspace(0, top, len(_STDS)).tolist())
    panel.set_ylabel("pairs")
    panel.grid(alpha=0.3)
