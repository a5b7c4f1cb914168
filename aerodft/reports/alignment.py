"""The figure of a video's alignment with a log: angular rates by images and by log, before and after."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aerodft.adapters.files import output_folder
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.model import FloatArray
from aerodft.reports.style import BLUE, ORANGE, save_figure, styled
from calibration.sync import Alignment

_SIZE_IN = (12.0, 8.0)
_AXES = ("x: tilt", "y: pan", "z: roll")
_BY_IMAGES, _BY_LOG = BLUE, ORANGE


@styled()
def draw_alignment(found: Alignment, folder: Path) -> Path:
    """Draw angular rates by images and log, as stamped and aligned, into a folder, which is made where it is missing.

    Returns:
        The file, ``sync.png``.

    Raises:
        InputError: The folder cannot be written to.
    """
    rates = found.rates
    times_s = (rates.stamp_ns - found.reference_ns) / 1e9
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
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
