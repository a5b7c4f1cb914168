"""Figures 12 and 14 of the paper, as PNG."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import matplotlib as mpl

from aerodft.dft.paper_printed import FIGURE_14_ERROR_M, MAX_DEPTH_M
from aerodft.dft.paper_tables import CameraRow, DepthRow, ErrorCurve

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_SIZE_IN, _DPI = (8, 5), 110


def draw_figure_12(curves: Sequence[ErrorCurve], cameras: Sequence[CameraRow], path: Path) -> None:
    """Quantization error over depth, one curve a camera, and what the paper's text says of 150 m."""
    figure, axes = plt.subplots(figsize=_SIZE_IN)
    styles = cycle(("-", "-", "-", "-", "--"))  # the fifth curve lies on the first
    for curve, row, style in zip(curves, cameras, styles, strict=False):
        (line,) = axes.plot(curve.depth_m, curve.error_m, style, label=curve.label)
        text = row.printed.text_error_m
        if text is not None:
            middle, half = (text[0] + text[1]) / 2, (text[1] - text[0]) / 2
            axes.errorbar(MAX_DEPTH_M + 2, middle, yerr=half, fmt="x", capsize=4, color=line.get_color())
    axes.plot([], [], "kx", label="the paper's text, at 150 m")
    axes.set(xlim=(10, 155), ylim=(0, None), xlabel="depth Z (m)", ylabel="quantization error (m)")
    axes.set_title("Figure 12: quantization error, camera 10 m high")
    _save(figure, axes, path)


def draw_figure_14(curve: ErrorCurve, rows: Sequence[DepthRow], path: Path) -> None:
    """Errors of Table 2 and the Canon's quantization error over depth."""
    figure, axes = plt.subplots(figsize=_SIZE_IN)
    axes.plot([row.printed.truth_m for row in rows], [row.printed.error_m for row in rows], "o-", label="Table 2")
    seen = curve.depth_m <= MAX_DEPTH_M + 1
    axes.plot(curve.depth_m[seen], curve.error_m[seen], label="quantization error, computed")
    axes.plot([MAX_DEPTH_M], [FIGURE_14_ERROR_M], "kx", label=f"the paper's text: {FIGURE_14_ERROR_M} m at 150 m")
    axes.set(xlim=(10, 155), ylim=(0, None), xlabel="depth Z (m)", ylabel="error (m)")
    axes.set_title("Figure 14: error of Table 2, Canon 1000D 10.48 m high at 67.0 deg")
    _save(figure, axes, path)


def _save(figure: Figure, axes: Axes, path: Path) -> None:
    axes.legend(loc="upper left", fontsize="small")
    axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)
