"""The figure of a video's alignment with a log: angular rates by images and by log, before and after."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.output import output_folder
from aerodft.model import FloatArray
from calibration.sync import Alignment

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

_SIZE_IN, _DPI = (12.0, 8.0), 110
_AXES = ("x: tilt", "y: pan", "z: roll")
_BY_IMAGES, _BY_LOG = "tab:blue", "tab:orange"


def draw_alignment(found: Alignment, folder: Path) -> Path:
    """Draw angular rates by images and log, as stamped and aligned, into a folder, which is made where it is missing.

    Returns:
        The file, ``sync.png``.

    Raises:
        InputError: The folder cannot be written to.
    """
    rates = found.rates
    times_s = (rates.stamp_ns - found.reference_ns) / 1e9
    figure, axes = plt.subplots(3, 2, figsize=_SIZE_IN, sharex=True, sharey="row", layout="constrained")
    for row, name in enumerate(_AXES):
        by_images, stamped, aligned = (
            np.degrees(each[:, row]) for each in (rates.seen_radps, rates.said_before_radps, rates.said_radps)
        )
        _panel(axes[row, 0], times_s, by_images, stamped)
        _panel(axes[row, 1], times_s, by_images, aligned)
        axes[row, 0].set_ylabel(f"{name} (deg/s)")
        low, high = np.nanpercentile(aligned, [0, 100])
        margin = 0.3 * (high - low) + 1.0
        axes[row, 0].set_ylim(low - margin, high + margin)
    axes[0, 0].set_title("as stamped")
    axes[0, 1].set_title(f"offset {found.offset_s:+.3f} s, drift {100 * found.drift:+.3f} %, lag {found.lag_s:.3f} s")
    axes[0, 1].legend(["images", str(found.source)], loc="upper right", fontsize="small")
    for each in axes[-1]:
        each.set_xlabel(f"s since {unix_ns_to_iso(found.reference_ns)}, by the video's clock")
    file = folder / "sync.png"
    with output_folder(folder, "the plot", expected=""):
        figure.savefig(file, dpi=_DPI)
    plt.close(figure)
    return file


def _panel(axes: Axes, times_s: FloatArray, by_images: FloatArray, by_log: FloatArray) -> None:
    axes.plot(times_s, by_images, ".", markersize=3, color=_BY_IMAGES)
    order = np.argsort(times_s, kind="stable")
    axes.plot(times_s[order], by_log[order], "-", linewidth=1.2, color=_BY_LOG)
    axes.grid(alpha=0.3)
