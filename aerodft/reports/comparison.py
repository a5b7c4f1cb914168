"""The figure of a comparison: deviations of paired measurements over time, and how many are how many stds apart."""

from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, IntArray
from aerodft.reports.style import BLACK, BLUE, RED, draw_band, figure_format, save_figure, styled, with_gaps
from replay.compare import Comparison, Pairs

_MOST_PROBES: Final = 8
_MOST_POINTS: Final = 4000
_STDS: Final = np.linspace(0, 4, 41)


@styled()
def plot_comparison(comparison: Comparison, path: Path, suffix: str) -> None:
    """Second minus first over time with one combined std to both sides, and how often they are how many stds apart.

    The probes that are farthest apart in stds are shown; of more pairs than a picture has columns, the farthest.

    Args:
        comparison: Two recordings.
        path: The file.
        suffix: Says the format: ``.png``, ``.svg``, ``.pdf``.

    Raises:
        UsageError: It says another.
        OSError: It cannot be written.
    """
    pairs, form = comparison.pairs, figure_format(suffix)
    shown = sorted(pairs, key=lambda name: (-(comparison.probes[name].max_sigmas or 0.0), name))[:_MOST_PROBES]
    figure = Figure(figsize=(11, 0.8 + 2.4 * len(shown)), layout="constrained")
    panels = figure.subplots(len(shown), 2, squeeze=False, sharex="col", width_ratios=(3, 1))
    start_ns = min((int(each.stamp_ns[0]) for each in pairs.values() if len(each.stamp_ns)), default=0)
    for (left, right), name in zip(panels, shown, strict=True):
        _over_time(left, pairs[name], start_ns)
        left.set_ylabel(f"{name} ({comparison.probes[name].unit})")
        _histogram(right, pairs[name])
    panels[0, 0].legend(loc="upper right")
    panels[-1, 0].set_xlabel("time since the first measurement (s)")
    panels[-1, 1].set_xlabel("combined stds")
    more = "" if len(shown) == len(pairs) else f" (the {len(shown)} of {len(pairs)} probes farthest apart)"
    figure.suptitle(f"Second minus first, {comparison.total.paired} pairs by {comparison.paired_by}{more}")
    save_figure(figure, path, form)


def _over_time(panel: Axes, pairs: Pairs, start_ns: int) -> None:
    known = ~np.isnan(pairs.deviations.change)
    seconds = (pairs.stamp_ns[known] - start_ns) / SECOND_NS
    change, combined = pairs.deviations.change[known], pairs.deviations.combined[known]
    rows = _thinned(change)
    panel.axhline(0, color=BLACK, linewidth=0.8)
    at_s, std = with_gaps(seconds[rows], combined[rows])
    draw_band(panel, at_s, -std, std, BLUE, label="1 combined std")
    panel.plot(seconds[rows], change[rows], ".", color=RED, markersize=3, label="difference")
    if not len(rows):
        panel.text(0.5, 0.6, "no two numbers to compare", ha="center", transform=panel.transAxes)


def _thinned(change: FloatArray) -> IntArray:
    """Of more rows than can be told apart, the farthest from 0 in each of as many runs."""
    if len(change) <= _MOST_POINTS:
        return np.arange(len(change))
    bounds = np.linspace(0, len(change), _MOST_POINTS + 1).astype(int)
    return np.array([low + np.argmax(np.abs(change[low:high])) for low, high in pairwise(bounds)])


def _histogram(panel: Axes, pairs: Pairs) -> None:
    sigmas = pairs.deviations.sigmas[~np.isnan(pairs.deviations.sigmas)]
    top = max(_STDS[-1], float(np.ceil(sigmas.max(initial=0.0))))
    panel.hist(sigmas, bins=np.linspace(0, top, len(_STDS)).tolist())
    panel.set_ylabel("pairs")
