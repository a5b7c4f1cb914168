"""A lens calibration as JSON and as a page: what it is based on, how well it fits, what is missing, and figures."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.files import output_folder
from aerodft.geometry import LENS_MODELS
from aerodft.model import Camera, FloatArray
from aerodft.reports.calibration import decimals
from aerodft.reports.rendering import image_source, render_html
from aerodft.reports.style import BLUE, RED, styled
from aerodft.version import SOFTWARE
from calibration.lens import LensChoice, LensFit, covered_cells, distortion_px, intrinsics_of, missing, ray_std_px
from calibration.pose import coefficient_names

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
_BAR_IN, _MAX_BARS = 0.22, 60
_NAME_LETTERS = 32

_MAX_NAMED: Final = 5  # of dropped images that a sentence names


def lens_document(fit: LensFit, files: Sequence[str]) -> dict[str, Any]:
    """A lens calibration as JSON.

    Args:
        fit: The calibration.
        files: What was written.
    """
    solution, choice = fit.solution, fit.choice
    stds = np.sqrt(np.diag(np.array(solution.camera.covariance)))
    names = parameter_names(solution.camera)
    return {
        "schema": "aerodft.lens/1",
        "status": "ok",
        "camera": camera_document(solution.camera),
        "std": dict(zip(names, stds.tolist(), strict=True)),
        "board": fit.board.text,
        "lens": fit.lens,
        "images": fit.images,
        "with_board": sum(map(len, (choice.used, choice.blurred, choice.duplicates, choice.surplus))),
        "views": [
            {"name": view.name, "corners": len(view.ids), "rms_px": rms, "edge_px": view.edge_px}
            for view, rms in zip(solution.views, solution.view_rms_px.tolist(), strict=True)
        ],
        "dropped": {
            "blurred": [view.name for view in choice.blurred],
            "near_duplicate": [view.name for view in choice.duplicates],
            "surplus": [view.name for view in choice.surplus],
            "corners": solution.strays,
            "outlying": [{"name": view.name, "rms_px": rms} for view, rms in solution.rejected],
        },
        "corners": len(solution.off_px),
        "rms_px": solution.rms_px,
        "corner_std_px": solution.std_px,
        "bic_gain": solution.bic_gain,
        "missing": list(missing(solution)),
        "notes": lens_notes(fit),
        "files": list(files),
        "software": SOFTWARE,
    }


def lens_notes(fit: LensFit) -> list[str]:
    """Sentences on the views left out and the lens model chosen."""
    solution, choice, notes = fit.solution, fit.choice, []
    for views, why in (
        (choice.blurred, "blurred"),
        (choice.duplicates, "nearly the same as a sharper one"),
        (choice.surplus, "nothing that others do not show"),
    ):
        if views:
            notes.append(f"{len(views)} dropped, {why}: {_names([view.name for view in views])}")
    notes += [f"{view.name} disagrees with all others by {rms:.2f} px rms, left out" for view, rms in solution.rejected]
    if solution.strays:
        count, where = sum(solution.strays.values()), _names(list(solution.strays))
        notes.append(f"{count} corner{'' if count == 1 else 's'} far off all others left out, in {where}")
    gain = solution.bic_gain
    if fit.lens is LensChoice.BROWN and gain is not None:
        verb = "kept" if gain > 0 else "left out"
        notes.append(f"k3 {verb}: with it the Bayesian information criterion changes by {-gain:+.1f}")
    if fit.lens is LensChoice.RATIONAL and gain is not None and gain <= 0:
        notes.append("brown describes this lens as well, with fewer coefficients, which are better known: `lens` brown")
    return notes


def _names(names: list[str]) -> str:
    more = f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else ""
    return ", ".join(names[:_MAX_NAMED]) + more


def parameter_names(camera: Camera) -> tuple[str, ...]:
    """fx, fy, cx, cy and the coefficients, as the camera file orders them."""
    return ("fx_px", "fy_px", "cx_px", "cy_px", *coefficient_names(camera))


def parameter_rows(camera: Camera) -> list[tuple[str, str, str]]:
    """Name, value and std of every intrinsic of a camera with a covariance, with as many digits as are known."""
    stds = np.sqrt(np.diag(np.array(camera.covariance))).tolist()
    return [
        (name, f"{value:.{decimals(std)}f}", f"{std:.{decimals(std)}f}")
        for name, value, std in zip(parameter_names(camera), intrinsics_of(camera).tolist(), stds, strict=True)
    ]


def write_lens_page(fit: LensFit, folder: Path) -> list[Path]:
    """Write the figures and a page that holds them all, ``report.html``.

    Args:
        fit: The calibration.
        folder: Made where it is not there.

    Returns:
        The page and the figures.

    Raises:
        InputError: The folder cannot be written to.
    """
    draw = {"coverage": _coverage, "residuals": _residuals, "views": _views, "distortion": _distortion, "known": _known}
    figures = {name: folder / f"{name}.png" for name in draw}
    with output_folder(folder, "the report", expected=""):
        for name, path in figures.items():
            with styled():
                figure = draw[name](fit)
            figure.savefig(path, dpi=_DPI, bbox_inches="tight")
        page = folder / "report.html"
        page.write_text(_page(fit, figures), encoding="utf-8")
    return [page, *figures.values()]


def _page(fit: LensFit, figures: dict[str, Path]) -> str:
    solution = fit.solution
    return render_html(
        "lens",
        name=solution.camera.name,
        view_count=len(solution.views),
        image_count=fit.images,
        size_px=fit.size_px,
        board=fit.board,
        corner_count=len(solution.off_px),
        rms_px=solution.rms_px,
        software=SOFTWARE,
        written_at=f"{datetime.now(UTC):%Y-%m-%d %H:%M}",
        missing=missing(solution),
        parameters=parameter_rows(solution.camera),
        notes=lens_notes(fit),
        figures=[(image_source(path.read_bytes(), "png"), _CAPTIONS[name]) for name, path in figures.items()],
    )


def _image_axes(fit: LensFit, title: str) -> tuple[Figure, Axes]:
    width, height = fit.size_px
    figure = Figure(figsize=(_WIDTH_IN, 0.8 + _WIDTH_IN * 0.86 * height / width))
    axes = figure.subplots()
    axes.grid(visible=False)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="u (px)", ylabel="v (px)", title=title)
    axes.set_aspect("equal")
    return figure, axes


def _coverage(fit: LensFit) -> Figure:
    views, (width, height) = fit.solution.views, fit.size_px
    figure, axes = _image_axes(fit, f"Corners of {len(views)} views, and how many views have some in each cell")
    counts = covered_cells(views, fit.size_px)
    some = np.ma.masked_equal(counts, 0)
    greys = ListedColormap(mpl.colormaps["Greys"](np.linspace(0.1, 0.6, 256)))
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    shown = axes.imshow(some, cmap=greys, vmin=0, alpha=0.6, extent=extent)
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.95, len(views)))
    for view, colour in zip(views, colours, strict=True):
        axes.plot(*view.pixels_px.T, ".", markersize=3.5, color=colour)
    for down, across in np.argwhere(counts == 0):
        cell = ((across + 0.5) * width / counts.shape[1], (down + 0.5) * height / counts.shape[0])
        axes.text(*cell, "none", color=RED, ha="center", va="center", fontsize="small")
    bar = axes.inset_axes((1.02, 0.0, 0.025, 1.0))
    figure.colorbar(shown, cax=bar, label="views")
    return figure


def _residuals(fit: LensFit) -> Figure:
    off, seen = fit.solution.off_px, fit.solution.corners.pixels_px
    typical = float(np.median(np.linalg.norm(off, axis=-1)))
    scale = _ARROW_SHARE * fit.size_px[0] / max(typical, np.finfo(np.float64).tiny)
    title = f"From seen to projected corners, {scale:.0f} times as long: {fit.solution.rms_px:.3f} px rms"
    figure, axes = _image_axes(fit, title)
    arrows = axes.quiver(*seen.T, *(scale * off).T, angles="xy", scale_units="xy", scale=1, width=0.0016, color=BLUE)
    key_px = float(f"{typical:.1g}")
    axes.quiverkey(arrows, 0.93, 0.04, scale * key_px, f"{key_px:g} px", labelpos="W", coordinates="axes")
    return figure


def _views(fit: LensFit) -> Figure:
    solution = fit.solution
    names = [view.name for view in solution.views] + [view.name for view, _ in solution.rejected]
    values = solution.view_rms_px.tolist() + [rms for _, rms in solution.rejected]
    order = sorted(range(len(names)), key=lambda k: -values[k])[:_MAX_BARS]
    used = len(solution.views)
    colours = [BLUE if k < used else RED for k in order]
    figure = Figure(figsize=(_WIDTH_IN, 1.2 + _BAR_IN * len(order)))
    axes = figure.subplots()
    axes.barh(range(len(order)), [values[k] for k in order], color=colours)
    axes.set_yticks(range(len(order)), [_short(names[k]) for k in order], fontsize="small")
    axes.axvline(solution.rms_px, color="black", linewidth=1, label=f"all together: {solution.rms_px:.3f} px")
    axes.invert_yaxis()
    rejected = ", orange: left out" if solution.rejected else ""
    axes.set(xlabel="rms of the residuals (px)", title=f"Residuals of each view{rejected}")
    axes.legend(loc="lower right", fontsize="small")
    return figure


def _short(name: str) -> str:
    return name if len(name) <= _NAME_LETTERS else f"...{name[3 - _NAME_LETTERS :]}"


def _grid(fit: LensFit, columns: int) -> FloatArray:
    """``(rows, columns, 2)`` pixels from edge to edge of the image."""
    width, height = fit.size_px
    u = np.linspace(-0.5, width - 0.5, columns)
    v = np.linspace(-0.5, height - 0.5, max(round(columns * height / width), 2))
    return np.stack(np.meshgrid(u, v), axis=-1)


def _distortion(fit: LensFit) -> Figure:
    camera = fit.solution.camera
    figure, axes = _image_axes(
        fit, f"How far the lens moves a pixel from where {LENS_MODELS[camera.lens].ideal} would have it"
    )
    fine, coarse = _grid(fit, _COLUMNS), _grid(fit, _ARROWS)
    _draw_map(figure, axes, fine, np.linalg.norm(distortion_px(camera, fine), axis=-1), "displacement (px)")
    moved = distortion_px(camera, coarse).reshape(-1, 2)
    at = coarse.reshape(-1, 2)
    axes.quiver(*at.T, *moved.T, angles="xy", scale_units="xy", scale=_pleasant_scale(moved, fit), color="white")
    axes.plot(camera.cx_px, camera.cy_px, "+", color=RED, markersize=12)
    return figure


def _pleasant_scale(moved: FloatArray, fit: LensFit) -> float:
    """Pixels of displacement for a pixel of arrow: the longest is as long as the arrows are apart."""
    longest = float(np.nanmax(np.linalg.norm(moved, axis=-1), initial=0.0))
    return max(longest / (fit.size_px[0] / _ARROWS), np.finfo(np.float64).tiny)


def _known(fit: LensFit) -> Figure:
    camera = fit.solution.camera
    figure, axes = _image_axes(
        fit, "How well the direction of each pixel is known (1 sigma), up to a turn of the camera"
    )
    fine = _grid(fit, _COLUMNS)
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
