"""The picture of a depth map: colours for ranges, with a bar that says which, and the horizon."""

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np

from aerodft.dft.depth_map import DepthMap, Z
from aerodft.geometry.dense import Float32Array
from aerodft.model.arrays import FloatArray

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import MaxNLocator

_WIDTH_IN, _DPI = 10.0, 120
_MOST_PX = 2000  # columns that are drawn; a picture has no room for more
_CONTOURS = 8  # of the ground's height, at most
_LOG_FROM: Final = 8.0  # ratio of the ranges' ends from which equal factors, not equal metres, get equal colours


def draw_depth(seen: DepthMap, horizon_px: tuple[FloatArray, ...], title: str, path: Path) -> None:
    """Draw slant ranges, misses in grey, with the horizon's polylines."""
    height, width = seen.range_m.shape
    step = max(1, width // _MOST_PX)
    range_m = seen.range_m[::step, ::step]
    near, far = float(np.nanmin(range_m)), float(np.nanmax(range_m))
    norm = LogNorm(near, far) if far > _LOG_FROM * near else Normalize(near, far)
    colours = mpl.colormaps["viridis_r"].with_extremes(bad="0.8")
    figure, axes = plt.subplots(figsize=(_WIDTH_IN, 1.0 + 0.82 * _WIDTH_IN * height / width))
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    drawn = axes.imshow(range_m, cmap=colours, norm=norm, extent=extent, interpolation="nearest")
    if len(seen.planes) > Z:
        _draw_heights(axes, seen.z_m[::step, ::step], step)
    for line in horizon_px:
        axes.plot(line[:, 0], line[:, 1], color="tab:red", linewidth=1.5, label="horizon")
    if horizon_px:
        axes.legend(handles=axes.lines[:1], loc="lower right", fontsize="small")
    axes.set(xlabel="u (px)", ylabel="v (px)", title=title, xlim=extent[:2], ylim=extent[2:])
    bar = axes.inset_axes((1.02, 0.0, 0.025, 1.0))
    figure.colorbar(drawn, cax=bar, label="slant range (m)", format="{x:g}")
    figure.savefig(path, dpi=_DPI, bbox_inches="tight")
    plt.close(figure)


def _draw_heights(axes: Axes, z_m: Float32Array, step: int) -> None:
    """Contour lines of the ground's height, at round numbers; along the top of what hides lower ground they meet."""
    low, high = float(np.nanmin(z_m)), float(np.nanmax(z_m))
    levels = [level for level in MaxNLocator(_CONTOURS).tick_values(low, high) if low < level < high]
    if levels:
        rows, columns = (step * np.arange(count) for count in z_m.shape)
        lines = axes.contour(columns, rows, z_m, levels=levels, colors="black", linewidths=0.6, alpha=0.6)
        axes.clabel(lines, fmt="%g m", fontsize="x-small")
