"""What the plates of ``aerodft river`` have in common: an image with banks and transects, and the width's profile."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import matplotlib as mpl
import numpy as np

from aerodft.cli.river_document import SIDES
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

LEFT, RIGHT, ACROSS, UNUSED = "#ff3030", "#ffd000", "#00e5ff", "#b0b0b0"
MOST_LINES: Final = 120
"""Transects that are drawn at the most: a plate has no room for more."""
_MOST_TICKS: Final = 4
_APART: Final = 0.055  # of the image's height, between two values
_WIDTH_IN, _DPI = 12.0, 110
_FINE_M: Final = 0.05  # half an interval, below which centimetres are shown


def blank_plate(height_in: float) -> Figure:
    """A plate to draw on."""
    return plt.figure(figsize=(_WIDTH_IN, height_in), layout="constrained")


def save_plate(figure: Figure, path: Path) -> None:
    """Write a plate as PNG, and forget it."""
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)


def draw_image(axes: Axes, image: ImageArray, banks_px: FloatArray, used: BoolArray, values: Sequence[str]) -> None:
    """An image with its banks and transects.

    Args:
        axes: Where to.
        image: ``(height, width, 3)`` BGR.
        banks_px: ``(n, 2, 2)``: left, then right end of each transect; NaN where the image ends first.
        used: ``(n,)``: which transects are measured from; others are grey.
        values: Of each transect, to stand beside it where there is room.
    """
    axes.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), interpolation="antialiased")
    for row in range(0, len(banks_px), max(1, len(banks_px) // MOST_LINES)):
        axes.plot(*banks_px[row].T, color=ACROSS if used[row] else UNUSED, linewidth=0.6, alpha=0.8)
    for side, color in enumerate((LEFT, RIGHT)):
        axes.plot(*banks_px[:, side].T, color=color, linewidth=1.4, label=f"{SIDES[side]} bank")
    for row in _with_room(banks_px, used, _APART * image.shape[0]):
        end = max(banks_px[row].tolist())  # the one that is farther to the right
        box = {"facecolor": "black", "alpha": 0.6, "edgecolor": "none", "pad": 1.5}
        axes.annotate(
            values[row], end, (6, 0), textcoords="offset points", color="white", fontsize=7, va="center", bbox=box,
            annotation_clip=True,
        )  # fmt: skip
    axes.set_xlim(-0.5, image.shape[1] - 0.5)
    axes.set_ylim(image.shape[0] - 0.5, -0.5)
    axes.legend(loc="upper right", fontsize="small")


def _with_room(banks_px: FloatArray, used: BoolArray, apart_px: float) -> list[int]:
    """Which transects' values do not stand on each other's."""
    rows: list[int] = []
    ends = [max(each) for each in np.nan_to_num(banks_px, nan=-np.inf).tolist()]
    for row in np.flatnonzero(used).tolist():
        if all(np.hypot(ends[row][0] - ends[one][0], ends[row][1] - ends[one][1]) >= apart_px for one in rows):
            rows.append(row)
    return rows


def value_of(transect: dict[str, Any]) -> str:
    """A transect's width with half its 95 % interval; empty where it has none."""
    if transect["ci95"] is None:
        return ""
    low, high = transect["ci95"]
    digits = 1 if high - low >= 2 * _FINE_M else 2
    return f"{transect['width_m']:.{digits}f} ± {(high - low) / 2:.{digits}f} m"


def draw_profile(axes: Axes, document: dict[str, Any]) -> None:
    """Widths along the river with their 95 % band."""
    used = [each for each in document["transects"] if each["ci95"] is not None]
    if used:
        rows = np.array([(each["station_m"], each["width_m"], *each["ci95"]) for each in used])
        axes.fill_between(rows[:, 0], rows[:, 2], rows[:, 3], alpha=0.3, label="95 % interval")
        axes.plot(rows[:, 0], rows[:, 1], ".-", markersize=3, linewidth=0.8, label="width")
        if any(each["channels"] > 1 for each in used):
            wetted = [each["wetted_m"] for each in used]
            axes.plot(rows[:, 0], wetted, linewidth=0.8, linestyle=":", color="black", label="wetted, without islands")
        width = document["width_m"]
        axes.axhline(width["median"], color="black", linewidth=0.8)
        low, high = width["ci95"]
        axes.set_title(f"median {width['median']:.2f} m, {low:.2f} to {high:.2f} m (95 %)")
        axes.legend(loc="best", fontsize="small")
    axes.set_xlabel("along the river (m)")
    axes.set_ylabel("width (m)")
    axes.grid(alpha=0.3)


def as_map(axes: Axes) -> None:
    """Axes in metres east and north, as long as each other; numbers stand in full, however far the origin is."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(_MOST_TICKS))
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
