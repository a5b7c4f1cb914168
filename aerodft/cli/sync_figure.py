"""The picture of an alignment: what images and log say of the camera's turning, before and after."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from aerodft.adapters.atomic_file import output_folder
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.cli.sync_run import SyncRun
from aerodft.model import FloatArray

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

_SIZE_IN, _DPI = (12.0, 8.0), 110
_AXES = ("x: tilt", "y: pan", "z: roll")
_SEEN, _SAID = "tab:blue", "tab:orange"


def draw_sync(run: SyncRun, folder: Path) -> str:
    """Draw ``sync.png`` into a folder, which is made where it is not there.

    Returns:
        The file.

    Raises:
        InputError: The folder cannot be written to.
    """
    found, rates = run.alignment, run.alignment.rates
    times_s = (rates.stamp_ns - found.reference_ns) / 1e9
    figure, axes = plt.subplots(3, 2, figsize=_SIZE_IN, sharex=True, sharey="row", layout="constrained")
    for row, name in enumerate(_AXES):
        seen = np.degrees(rates.seen_radps[:, row])
        _panel(axes[row, 0], times_s, seen, np.degrees(rates.logged_before_radps[:, row]))
        _panel(axes[row, 1], times_s, seen, np.degrees(rates.logged_radps[:, row]))
        axes[row, 0].set_ylabel(f"{name} (deg/s)")
        low, high = np.nanpercentile(np.degrees(rates.logged_radps[:, row]), [0, 100])
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
    return str(file)


def _panel(axes: Axes, times_s: FloatArray, seen: FloatArray, said: FloatArray) -> None:
    axes.plot(times_s, seen, ".", markersize=3, color=_SEEN)
    order = np.argsort(times_s, kind="stable")
    axes.plot(times_s[order], said[order], "-", linewidth=1.2, color=_SAID)
    axes.grid(alpha=0.3)
