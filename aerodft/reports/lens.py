"""The page on a lens calibration: what it is based on, how well it fits, and what is missing; with its figures."""

import base64
import math
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np

from aerodft.app.calibrate_lens import LensRun, notes, parameter_rows
from aerodft.cli.output import output_folder
from aerodft.model import FloatArray, LensModel
from aerodft.version import SOFTWARE
from calibration.lens import covered_cells, distortion_px, missing, ray_std_px

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

_STYLE = """
body { font-family: sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; } td, th { padding: 0.2em 1em; text-align: right; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; } img { max-width: 100%; } .missing { color: #a00; }
"""
_CAPTIONS = {
    "coverage": "Where corners were seen. Outside of them the distortion is extrapolated.",
    "residuals": "Arrows that point the same way in a region say that the lens model does not fit there.",
    "views": "A view far above the others is of a bent board, or blurred by motion.",
    "distortion": "The cross is the principal point.",
    "known": "What is left of the covariance once a pose is found with this camera.",
}

_WIDTH_IN, _DPI = 9.0, 110
_COLUMNS, _ARROWS = 96, 16  # of the maps of distortion
_ARROW_SHARE = 0.02  # of the image's width: what a typical residual is drawn as
_BAR_IN, _MOST_NAMED = 0.22, 60
_NAME_LETTERS = 32

_IDEAL: Final = {LensModel.BROWN: "a pinhole", LensModel.FISHEYE: "a fisheye of equal angles"}

FIGURES: Final = ("coverage", "residuals", "views", "distortion", "known")


def write_lens_report(run: LensRun, folder: Path) -> list[str]:
    """Write the figures and a page that holds them all.

    Args:
        run: The calibration.
        folder: Made where it is not there.

    Returns:
        The files that were written.

    Raises:
        InputError: The folder cannot be written to.
    """
    with output_folder(folder, "the report", expected=""):
        figures = draw_lens(run, folder)
        page = folder / "report.html"
        page.write_text(_page(run, figures), encoding="utf-8")
    return [str(page), *map(str, figures.values())]


def _page(run: LensRun, figures: dict[str, Path]) -> str:
    solution, (width, height) = run.solution, run.size_px
    title = escape(f"Lens calibration: {solution.camera.name}")
    head = (
        f"{len(solution.views)} views of {run.images} images of {width} x {height} px, {run.board}:"
        f" {len(solution.off_px)} corners, {solution.rms_px:.3f} px rms."
        f" {SOFTWARE}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC."
    )
    lacking = missing(solution)
    said = [f'<p class="missing">Missing: {escape(sentence)}.</p>' for sentence in lacking]
    if not lacking:
        said = ["<p>Nothing is missing: corners all over the image, tilted and near boards.</p>"]
    listed = "".join(f"<li>{escape(note)}</li>" for note in notes(run))
    pictures = "".join(
        f'<figure><img alt="{name}" src="data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}">'
        f"<figcaption>{escape(_CAPTIONS[name])}</figcaption></figure>\n"
        for name, path in figures.items()
    )
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head>\n<body><h1>{title}</h1>\n<p>{escape(head)}</p>\n{''.join(said)}\n"
        f"{_table(run)}\n<ul>{listed}</ul>\n{pictures}</body></html>\n"
    )


def _table(run: LensRun) -> str:
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{value}</td><td>{std}</td></tr>"
        for name, value, std in parameter_rows(run.solution.camera)
    )
    return f"<table><tr><th>parameter</th><th>value</th><th>std</th></tr>{rows}</table>"


def draw_lens(run: LensRun, folder: Path) -> dict[str, Path]:
    """Draw all figures as PNG; their files by ``FIGURES``."""
    draw = (_coverage, _residuals, _views, _distortion, _known)
    files = {}
    for name, figure_of in zip(FIGURES, draw, strict=True):
        figure = figure_of(run)
        files[name] = folder / f"{name}.png"
        figure.savefig(files[name], dpi=_DPI, bbox_inches="tight")
        plt.close(figure)
    return files


def _image_axes(run: LensRun, title: str) -> tuple[Figure, Axes]:
    width, height = run.size_px
    figure, axes = plt.subplots(figsize=(_WIDTH_IN, 0.8 + _WIDTH_IN * 0.86 * height / width))
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="u (px)", ylabel="v (px)", title=title)
    axes.set_aspect("equal")
    return figure, axes


def _coverage(run: LensRun) -> Figure:
    views, (width, height) = run.solution.views, run.size_px
    figure, axes = _image_axes(run, f"Corners of {len(views)} views, and how many views have some in each cell")
    counts = covered_cells(views, run.size_px)
    some = np.ma.masked_equal(counts, 0)
    greens = ListedColormap(mpl.colormaps["Greens"](np.linspace(0.2, 0.9, 256)))
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    shown = axes.imshow(some, cmap=greens, vmin=0, alpha=0.6, extent=extent)
    colours = mpl.colormaps["turbo"](np.linspace(0.05, 0.95, len(views)))
    for view, colour in zip(views, colours, strict=True):
        axes.plot(*view.pixels_px.T, ".", markersize=3.5, color=colour)
    for down, across in np.argwhere(counts == 0):
        cell = ((across + 0.5) * width / counts.shape[1], (down + 0.5) * height / counts.shape[0])
        axes.text(*cell, "none", color="tab:red", ha="center", va="center", fontsize="small")
    bar = axes.inset_axes((1.02, 0.0, 0.025, 1.0))
    figure.colorbar(shown, cax=bar, label="views")
    return figure


def _residuals(run: LensRun) -> Figure:
    off, seen = run.solution.off_px, run.solution.corners.pixels_px
    typical = float(np.median(np.linalg.norm(off, axis=-1)))
    scale = _ARROW_SHARE * run.size_px[0] / max(typical, np.finfo(np.float64).tiny)
    title = f"From seen to projected corners, {scale:.0f} times as long: {run.solution.rms_px:.3f} px rms"
    figure, axes = _image_axes(run, title)
    arrows = axes.quiver(
        *seen.T, *(scale * off).T, angles="xy", scale_units="xy", scale=1, width=0.0016, color="tab:blue"
    )
    key_px = float(f"{typical:.1g}")
    axes.quiverkey(arrows, 0.93, 0.04, scale * key_px, f"{key_px:g} px", labelpos="W", coordinates="axes")
    return figure


def _views(run: LensRun) -> Figure:
    solution = run.solution
    names = [view.name for view in solution.views] + [view.name for view, _ in solution.left_out]
    values = solution.view_rms_px.tolist() + [rms for _, rms in solution.left_out]
    order = sorted(range(len(names)), key=lambda k: -values[k])[:_MOST_NAMED]
    used = len(solution.views)
    colours = ["tab:blue" if k < used else "tab:red" for k in order]
    figure, axes = plt.subplots(figsize=(_WIDTH_IN, 1.2 + _BAR_IN * len(order)))
    axes.barh(range(len(order)), [values[k] for k in order], color=colours)
    axes.set_yticks(range(len(order)), [_short(names[k]) for k in order], fontsize="small")
    axes.axvline(solution.rms_px, color="black", linewidth=1, label=f"all together: {solution.rms_px:.3f} px")
    axes.invert_yaxis()
    left_out = ", red: left out" if solution.left_out else ""
    axes.set(xlabel="rms of the residuals (px)", title=f"Residuals of each view{left_out}")
    axes.legend(loc="lower right", fontsize="small")
    return figure


def _short(name: str) -> str:
    return name if len(name) <= _NAME_LETTERS else f"...{name[3 - _NAME_LETTERS :]}"


def _grid(run: LensRun, columns: int) -> FloatArray:
    """``(rows, columns, 2)`` pixels from edge to edge of the image."""
    width, height = run.size_px
    u = np.linspace(-0.5, width - 0.5, columns)
    v = np.linspace(-0.5, height - 0.5, max(round(columns * height / width), 2))
    return np.stack(np.meshgrid(u, v), axis=-1)


def _distortion(run: LensRun) -> Figure:
    camera = run.solution.camera
    figure, axes = _image_axes(run, f"How far the lens moves a pixel from where {_IDEAL[camera.lens]} would have it")
    fine, coarse = _grid(run, _COLUMNS), _grid(run, _ARROWS)
    _draw_map(figure, axes, fine, np.linalg.norm(distortion_px(camera, fine), axis=-1), "displacement (px)")
    moved = distortion_px(camera, coarse).reshape(-1, 2)
    at = coarse.reshape(-1, 2)
    axes.quiver(*at.T, *moved.T, angles="xy", scale_units="xy", scale=_pleasant_scale(moved, run), color="white")
    axes.plot(camera.cx_px, camera.cy_px, "+", color="tab:red", markersize=12)
    return figure


def _pleasant_scale(moved: FloatArray, run: LensRun) -> float:
    """Pixels of displacement for a pixel of arrow: the longest is as long as the arrows are apart."""
    longest = float(np.nanmax(np.linalg.norm(moved, axis=-1), initial=0.0))
    return max(longest / (run.size_px[0] / _ARROWS), np.finfo(np.float64).tiny)


def _known(run: LensRun) -> Figure:
    camera = run.solution.camera
    figure, axes = _image_axes(
        run, "How well the direction of each pixel is known (1 sigma), up to a turn of the camera"
    )
    fine = _grid(run, _COLUMNS)
    std = ray_std_px(camera, np.array(camera.covariance), fine.reshape(-1, 2)).reshape(fine.shape[:2])
    _draw_map(figure, axes, fine, std, "std (px)")
    return figure


def _draw_map(figure: Figure, axes: Axes, at: FloatArray, values: FloatArray, label: str) -> None:
    shown = axes.pcolormesh(at[..., 0], at[..., 1], values, shading="gouraud", cmap="viridis")
    if math.isfinite(float(np.nanmax(values, initial=0.0))) and float(np.nanmax(values, initial=0.0)) > 0:
        lines = axes.contour(at[..., 0], at[..., 1], values, colors="white", linewidths=0.6, alpha=0.8)
        axes.clabel(lines, fmt="%g", fontsize="x-small")
    bar = axes.inset_axes((1.02, 0.0, 0.025, 1.0))
    figure.colorbar(shown, cax=bar, label=label)
