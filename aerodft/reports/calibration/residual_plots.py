"""The residuals of a calibration as one figure: in pixels, in standard deviations, over distance; and correlations."""

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aerodft.model import FloatArray
from aerodft.reports.calibration.marks import Row
from aerodft.reports.calibration.picture import shorten
from aerodft.reports.style import BLACK, BLUE, ORANGE, RED, styled
from calibration.flight import ImagesResult
from calibration.pose import Result, correlations

PLANE_95: Final = math.sqrt(-2.0 * math.log(0.05))
"""Radius, in standard deviations, of the circle that holds 95 % of a plane's normal distribution."""

_SIZE_IN, _DPI = (15.0, 9.4), 110
_KEPT, _LINE_LIKE, _OUTLIER, _EXPECTED = BLUE, ORANGE, RED, BLACK
_MARGIN, _ROOM, _NAMED, _LOG_FROM, _MAX_BINS, _MAX_CELLS = 1.15, 1.4, 4, 8.0, 40, 9
_DARK, _RIGHT, _LETTERS = 0.6, 0.65, 24


@styled()
def draw_residuals(rows: Sequence[Row], result: Result | ImagesResult, path: Path) -> None:
    """Write the figure as PNG.

    Args:
        rows: The observations.
        result: The calibration.
        path: The file.
    """
    figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
    panels = figure.subplots(2, 3)
    sigma_scale = result.solution.sigma_scale
    _scatter_px(panels[0, 0], rows)
    _scatter_sigma(panels[0, 1], rows, sigma_scale)
    _histogram(panels[0, 2], rows, sigma_scale)
    _over_range(panels[1, 0], rows, [row.left.px for row in rows], "residual (px)")
    panels[1, 0].set_title("Residuals over distance")
    ground = [math.nan if row.left.loo_ground_m is None else row.left.loo_ground_m for row in rows]
    _over_range(panels[1, 1], rows, ground, "error on the ground, not having seen it (m)")
    panels[1, 1].set_title("How well the next point would be measured")
    _correlations(panels[1, 2], result)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names are in any script
        figure.savefig(path)


def _colour(row: Row) -> str:
    if row.left.is_outlier:
        return _OUTLIER
    return _KEPT if row.is_plane else _LINE_LIKE


def _scatter_px(axes: Axes, rows: Sequence[Row]) -> None:
    at = np.array([row.mark.off_px for row in rows])
    planes = [row for row in rows if row.is_plane and not row.left.is_outlier]
    stds = [row.left.px / row.left.sigma for row in planes if row.left.sigma > 0]
    circles = [(PLANE_95 * float(np.median(stds)), "-", f"95 % for {np.median(stds):.2g} px as stated")] if stds else []
    _scatter(axes, rows, at, circles)
    axes.set(xlabel="right (px)", ylabel="down (px)", title="From seen to calibrated")


def _scatter_sigma(axes: Axes, rows: Sequence[Row], sigma_scale: float) -> None:
    circles = [(PLANE_95, "-", "95 % as stated")]
    if sigma_scale > 1:
        circles.append((PLANE_95 * sigma_scale, "--", f"95 % with stds scaled by {sigma_scale:.2g}"))
    _scatter(axes, rows, np.array([row.sigma for row in rows]), circles)
    axes.set(xlabel="right (standard deviations)", ylabel="down (standard deviations)", title="In standard deviations")


def _scatter(axes: Axes, rows: Sequence[Row], at: FloatArray, circles: Sequence[tuple[float, str, str]]) -> None:
    """Points round zero, as large as what was kept; what lies beyond is named at the edge."""
    for colour, label in ((_KEPT, "two-dimensional"), (_LINE_LIKE, "one number only"), (_OUTLIER, "left out")):
        chosen = np.array([_colour(row) == colour for row in rows]) & np.all(np.isfinite(at), axis=-1)
        if np.any(chosen):
            axes.plot(*at[chosen].T, "o", color=colour, markersize=5, alpha=0.8, label=label)
    turn = np.linspace(0.0, 2 * math.pi, 361)
    for radius, style, label in circles:
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), style, color=_EXPECTED, linewidth=1.2, label=label)
    kept = at[[not row.left.is_outlier for row in rows]]
    reach = max([*np.abs(kept[np.isfinite(kept)]).tolist(), *(radius for radius, _, _ in circles), 1e-9]) * _ROOM
    axes.set(xlim=(-reach, reach), ylim=(reach, -reach))
    axes.set_aspect("equal")
    axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    axes.axvline(0, color="0.8", linewidth=0.8, zorder=0)
    for row, point in zip(rows, at, strict=True):
        if np.all(np.isfinite(point)) and np.any(np.abs(point) > reach):
            edge = point * 0.97 * reach / float(np.max(np.abs(point)))
            axes.plot(*edge, "x", color=_OUTLIER, markersize=7)
            side = "right" if edge[0] > 0 else "left"
            axes.annotate(
                shorten(row.mark.name, _LETTERS),
                tuple(edge.tolist()),
                color=_OUTLIER,
                fontsize="small",
                ha=side,
                va="top" if edge[1] < 0 else "bottom",
                parse_math=False,
                in_layout=False,
            )
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize="x-small", loc="upper right")


def _histogram(axes: Axes, rows: Sequence[Row], sigma_scale: float) -> None:
    kept = [row.values for row in rows if not row.left.is_outlier]
    values = np.concatenate([*kept, np.zeros(0)])
    reach = max(3.5, float(np.max(np.abs(values), initial=0.0)) * _MARGIN, PLANE_95 * sigma_scale)
    bins = int(np.clip(round(2 * math.sqrt(max(len(values), 1)) * reach / 3.5), 10, _MAX_BINS))
    edges = np.linspace(-reach, reach, bins + 1)
    axes.hist(values, edges.tolist(), color=_KEPT, alpha=0.6, label=f"{len(values)} residuals")
    x = np.linspace(-reach, reach, 401)
    width = float(edges[1] - edges[0])
    stds = [(1.0, "-", "expected as stated")]
    if sigma_scale > 1:
        stds.append((sigma_scale, "--", f"with stds scaled by {sigma_scale:.2g}"))
    for std, style, label in stds:
        density = np.exp(-0.5 * np.square(x / std)) / (std * math.sqrt(2 * math.pi))
        axes.plot(x, len(values) * width * density, style, color=_EXPECTED, label=label)
    axes.set(xlabel="residual (standard deviations)", ylabel="count", title="Beside the normal distribution")
    axes.legend(fontsize="x-small", loc="upper right")


def _over_range(axes: Axes, rows: Sequence[Row], values: Sequence[float], label: str) -> None:
    found = [
        (row.range_m, value, row)
        for row, value in zip(rows, values, strict=True)
        if math.isfinite(row.range_m) and math.isfinite(value)
    ]
    axes.set(xlabel="distance from the camera (m)", ylabel=label)
    if not found:
        axes.text(0.5, 0.5, "no observation has one", ha="center", va="center", transform=axes.transAxes, color="0.4")
        axes.set(xticks=[], yticks=[])
        return
    for range_m, value, row in found:
        axes.plot(range_m, value, "o", color=_colour(row), markersize=5, alpha=0.8)
    ranges = [range_m for range_m, _, _ in found]
    if max(ranges) > _LOG_FROM * min(ranges) > 0:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.12, y=0.12)
    for range_m, value, row in sorted(found, key=lambda each: -each[1])[:_NAMED]:
        is_right = axes.transLimits.transform(axes.transScale.transform((range_m, value)))[0] > _RIGHT
        axes.annotate(
            shorten(row.mark.name, _LETTERS),
            (range_m, value),
            (-5 if is_right else 5, 3),
            textcoords="offset points",
            fontsize="small",
            ha="right" if is_right else "left",
            color=_colour(row),
            parse_math=False,
            in_layout=False,
        )


def _correlations(axes: Axes, result: Result | ImagesResult) -> None:
    names, matrix = result.problem.unknowns.names, correlations(result.solution.covariance)
    axes.grid(visible=False)
    axes.imshow(matrix, cmap="RdBu_r", vmin=-1, vmax=1)
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(names)), names)
    axes.set_title("Correlations of what was found")
    if len(names) <= _MAX_CELLS:
        for (down, across), value in np.ndenumerate(matrix):
            colour = "white" if abs(value) > _DARK else "black"
            axes.text(across, down, f"{value:.2f}", ha="center", va="center", fontsize="small", color=colour)
