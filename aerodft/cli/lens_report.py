"""The page on a lens calibration: what it is based on, how well it fits, and what is missing."""

import base64
from datetime import UTC, datetime
from html import escape
from pathlib import Path

from aerodft import __version__
from aerodft.cli.lens_figures import draw_lens
from aerodft.cli.lens_output import notes, parameter_rows
from aerodft.cli.lens_run import LensRun
from aerodft.errors import InputError
from calibration.lens.coverage import missing

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
    try:
        folder.mkdir(parents=True, exist_ok=True)
        figures = draw_lens(run, folder)
        page = folder / "report.html"
        page.write_text(_page(run, figures), encoding="utf-8")
    except OSError as error:
        raise InputError("the report cannot be written", where=folder, got=error.strerror or error) from error
    return [str(page), *map(str, figures.values())]


def _page(run: LensRun, figures: dict[str, Path]) -> str:
    solution, (width, height) = run.solution, run.size_px
    title = escape(f"Lens calibration: {solution.camera.name}")
    head = (
        f"{len(solution.views)} views of {run.images} images of {width} x {height} px, {run.board}:"
        f" {len(solution.off_px)} corners, {solution.rms_px:.3f} px rms."
        f" aerodft {__version__}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC."
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
