"""Figures that lay one series beside another: two recordings' measurements, a video's angular rates and a log's."""

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aerodft.adapters.files import output_folder
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, IntArray
from aerodft.reports.style import BLACK, BLUE, ORANGE, RED, draw_band, save_figure, styled, with_gaps

if TYPE_CHECKING:
    from calibration.sync import Alignment
    from replay.compare import Comparison, Pairs

_MOST_PROBES: Final = 8
_MOST_POINTS: Final = 4000
_STDS: Final = np.linspace(0, 4, 41)

_ALIGNMENT_SIZE_IN = (12.0, 8.0)
_AXES = ("x: tilt", "y: pan", "z: roll")
_BY_IMAGES, _BY_LOG = BLUE, ORANGE


@styled()
def plot_comparison(comparison: "Comparison", path: Path, form: str) -> None:
    """Second minus first over time with one combined std to both sides, and how often they are how many stds apart.

    The probes that are farthest apart in stds are shown; of more pairs than a picture has columns, the farthest.

    Args:
        comparison: Two recordings.
        path: The file.
        form: Its format, see ``figure_format``.

    Raises:
        OSError: It cannot be written.
    """
    pairs = comparison.pairs
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


def _over_time(panel: Axes, pairs: "Pairs", start_ns: int) -> None:
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
    """Rows to draw: the farthest from 0 in each of as many runs as can be told apart."""
    if len(change) <= _MOST_POINTS:
        return np.arange(len(change))
    bounds = np.linspace(0, len(change), _MOST_POINTS + 1).astype(int)
    return np.array([low + np.argmax(np.abs(change[low:high])) for low, high in pairwise(bounds)])


def _histogram(panel: Axes, pairs: "Pairs") -> None:
    sigmas = pairs.deviations.sigmas[~np.isnan(pairs.deviations.sigmas)]
    top = max(_STDS[-1], float(np.ceil(sigmas.max(initial=0.0))))
    panel.hist(sigmas, bins=np.linspace(0, top, len(_STDS)).tolist())
    panel.set_ylabel("pairs")


@styled()
def draw_alignment(found: "Alignment", folder: Path) -> Path:
    """Draw angular rates by images and log, as stamped and aligned, into a folder, which is made where it is missing.

    Returns:
        The file, ``sync.png``.

    Raises:
        InputError: The folder cannot be written to.
    """
    rates = found.rates
    times_s = (rates.stamp_ns - found.reference_ns) / 1e9
    figure = Figure(figsize=_ALIGNMENT_SIZE_IN, layout="constrained")
    axes = figure.subplots(3, 2, sharex=True, sharey="row")
    for row, name in enumerate(_AXES):
        by_images, stamped, aligned = (
            np.degrees(each[:, row]) for each in (rates.seen_radps, rates.logged_before_radps, rates.logged_radps)
        )
        _panel(axes[row, 0], times_s, by_images, stamped)
        _panel(axes[row, 1], times_s, by_images, aligned)
        axes[row, 0].set_ylabel(f"{name} (deg/s)")
        low, high = np.nanpercentile(aligned, [0, 100])
        margin = 0.3 * (high - low) + 1.0
        axes[row, 0].set_ylim(low - margin, high + margin)
    axes[0, 0].set_title("as stamped")
    axes[0, 1].set_title(f"offset {found.offset_s:+.3f} s, drift {100 * found.drift:+.3f} %, lag {found.lag_s:.3f} s")
    axes[0, 1].legend(["images", str(found.source)], loc="upper right")
    for each in axes[-1]:
        each.set_xlabel(f"s since {unix_ns_to_iso(found.reference_ns)}, by the video's clock")
    file = folder / "sync.png"
    with output_folder(folder, "the plot", expected=""):
        save_figure(figure, file, "png")
    return file


def _panel(axes: Axes, times_s: FloatArray, by_images: FloatArray, by_log: FloatArray) -> None:
    axes.plot(times_s, by_images, ".", markersize=3, color=_BY_IMAGES)
    order = np.argsort(times_s, kind="stable")
    axes.plot(times_s[order], by_log[order], "-", linewidth=1.2, color=_BY_LOG)
