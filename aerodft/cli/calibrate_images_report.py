"""The folder that ``aerodft calibrate --report`` writes for many images: residuals, tables and words."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from aerodft import __version__
from aerodft.adapters.config.evidence import EvidenceFile
from aerodft.cli.calibrate_report_marks import Row, rows_of_images
from aerodft.cli.calibrate_report_plots import draw_residuals
from aerodft.cli.calibrate_report_text import (
    LAST_COLUMN,
    bullets,
    correlation_table,
    fit_words,
    observation_table,
    parameter_table,
    plain,
    residual_table,
    table,
)
from aerodft.cli.output import say
from aerodft.errors import InputError
from calibration.images_result import ImagesResult
from calibration.observability import LIMIT

_RESIDUALS, _TABLE, _REPORT = "residuals.png", "residuals.csv", "report.md"
_SIGNS = (
    "Biases are added to what telemetry says: height, east and north in metres, tilt, pan and roll as rotations about"
    " the camera's x, y and z axes, heading clockwise about the vertical. The time offset is added to the images'"
    " stamps."
)


def write_images_report(result: ImagesResult, found: EvidenceFile, about: dict[str, Any], report: Path) -> None:
    """Write residuals.png, residuals.csv and report.md, and say so.

    Args:
        result: The calibration.
        found: What it is from.
        about: The same as JSON has it.
        report: The folder, made where it is not there.

    Raises:
        InputError: The folder cannot be written to.
    """
    rows = rows_of_images(result)
    try:
        report.mkdir(parents=True, exist_ok=True)
        draw_residuals(rows, result, report / _RESIDUALS)
        (report / _TABLE).write_text(residual_table(rows), encoding="utf-8", newline="")
        (report / _REPORT).write_text(_markdown(result, found, about, rows), encoding="utf-8")
    except OSError as error:
        what, expected = "the report cannot be written", "a folder to write to"
        raise InputError(what, where=report, got=error.strerror or error, expected=expected) from error
    say(f"wrote {report / _REPORT}")


def _markdown(result: ImagesResult, found: EvidenceFile, about: dict[str, Any], rows: Sequence[Row]) -> str:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    camera = result.solution.state.base.camera
    parts = [
        f"# Telemetry and {plain(camera.name)}: {len(about['images'])} images",
        f"From {plain(found.path.name)} (sha256 {found.sha256}), {now}, aerodft {__version__}.",
        f"Model: {about['model']}. Coordinates: {plain(found.frame.crs)}.",
        "## What was found",
        parameter_table(about),
        _SIGNS,
        *([correlation_table(about)] if len(about["order"]) > 1 else []),
        "## How well it fits",
        bullets([*fit_words(result), _worst(result), *(f"{plain(note)}." for note in about["notes"])]),
        f"![Residuals]({_RESIDUALS})",
        "## The images",
        _images(about["images"]),
        "## What is left of each observation",
        LAST_COLUMN,
        observation_table(rows),
        f"Left out: {', '.join(plain(name) for name in about['outliers']) or 'nothing'}.",
    ]
    return "\n\n".join(parts) + "\n"


def _worst(result: ImagesResult) -> str:
    *others, last = (plain(name) for name in result.weakest.combination)
    what = f"the combination of {', '.join(others)} and {last}" if others else last
    share = 100 * result.weakest.std_share / LIMIT
    return f"Everything that was asked for is determined; {what} worst, to {share:.2g} % of what would be refused."


def _images(images: Sequence[dict[str, Any]]) -> str:
    head = ("image", "height (m)", "tilt (deg)", "roll (deg)", "heading (deg)", "from telemetry (sigma)")
    keys = ("height_agl_m", "tilt_deg", "roll_deg", "heading_deg", "from_telemetry_sigma")
    return table(head, [(plain(image["name"]), *(f"{image[key]:.2f}" for key in keys)) for image in images])
