"""The figure of a comparison: deviations of paired measurements over time, and how many are how many stds apart."""

from itertools import pairwise
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.errors import UsageError
from aerodft.model import FloatArray, IntArray
from replay.compare import Comparison, Pairs

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

_MOST_PROBES: Final = 8
_MOST_POINTS: Final = 4000
_GAP_STEPS: Final = 5  # usual steps from one pair to the next
_FORMATS: Final = frozenset({"png", "svg", "pdf"})
_STDS: Final = np.linspace(0, 4, 41)


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
    pairs, form = comparison.pairs, suffix.lower().lstrip(".") or "png"
    if form not in _FORMATS:
        raise UsageError("`output`", got=suffix, expected=" or ".join(sorted(f".{each}" for each in _FORMATS)))
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
    known = ~np.isnan(pairs.deviations.change)
    seconds = (pairs.stamp_ns[known] - start_ns) / SECOND_NS
    change, combined = pairs.deviations.change[known], pairs.deviations.combined[known]
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
    sigmas = pairs.deviations.sigmas[~np.isnan(pairs.deviations.sigmas)]
    top = max(_STDS[-1], float(np.ceil(sigmas.max(initial=0.0))))
    panel.hist(sigmas, bins=np.linspace(0, top, len(_STDS)).tolist())
    panel.set_ylabel("pairs")
    panel.grid(alpha=0.3)
