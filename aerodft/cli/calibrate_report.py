"""The folder that ``aerodft calibrate --report`` writes: the image, the residuals, tables and words."""

from pathlib import Path

import cv2

from aerodft.adapters.config.evidence import EvidenceFile
from aerodft.adapters.images.pixels import StillPixels
from aerodft.cli.calibrate_report_grid import axes_of, ground_grid
from aerodft.cli.calibrate_report_image import Picture, draw_picture
from aerodft.cli.calibrate_report_marks import rows_of
from aerodft.cli.calibrate_report_plots import draw_residuals
from aerodft.cli.calibrate_report_text import markdown, residual_table
from aerodft.cli.output import say
from aerodft.errors import InputError
from aerodft.model.arrays import ImageArray
from aerodft.model.camera import Camera
from aerodft.model.evidence import Landmark
from calibration.result import Result

_IMAGE, _RESIDUALS, _TABLE, _REPORT = "annotated.jpg", "residuals.png", "residuals.csv", "report.md"


def write_report(result: Result, found: EvidenceFile, report: Path) -> None:
    """Write annotated.jpg, residuals.png, residuals.csv and report.md, and say so.

    An image that is not there, unreadable or of another size is said, and a plain canvas takes its place.

    Args:
        result: The calibration.
        found: What it is from; its image is looked for beside its file.
        report: The folder, made where it is not there.

    Raises:
        InputError: The folder cannot be written to.
    """
    state, known = result.solution.state, result.problem.known
    rows, grid = rows_of(result), ground_grid(state, axes_of(result, found))
    image, why_not = image_of(found.image, found.path, state.camera)
    notes = [f"{why_not}: the canvas is plain."] if why_not else []
    if found.image is not None and why_not:
        say(f"aerodft: the report has no image: {why_not}")
    if grid.axes.elevation_m != state.elevation_m:
        heights = [found.frame.origin[2] + each for each in (grid.axes.elevation_m, state.elevation_m)]
        notes.append(
            f"The grid is drawn at the landmarks' middle height, {heights[0]:.2f} m: the ground at {heights[1]:.2f} m,"
            " from which heights count, is far below them. State elevation_m in the file."
        )
    is_oriented = any(isinstance(each, Landmark) for each in known.evidence) or "heading" in found.known.priors
    marks = tuple((row.mark, row.left.is_outlier) for row in rows)
    try:
        report.mkdir(parents=True, exist_ok=True)
        notes += draw_picture(Picture(state, marks, grid, image, is_oriented), report / _IMAGE)
        draw_residuals(rows, result, report / _RESIDUALS)
        (report / _TABLE).write_text(residual_table(rows), encoding="utf-8", newline="")
        words = markdown(result, found, rows, (_IMAGE, _RESIDUALS), notes)
        (report / _REPORT).write_text(words, encoding="utf-8")
    except OSError as error:
        raise InputError(
            "the report cannot be written",
            where=report,
            got=error.strerror or error,
            expected="a folder to write to",
        ) from error
    say(f"wrote {report / _REPORT}")


def image_of(name: str | None, beside: Path, camera: Camera) -> tuple[ImageArray | None, str]:
    """An image, or why there is none.

    Args:
        name: Of its file, as stated; None where none is.
        beside: What states it, and lies in the same folder.
        camera: Of which size it must be.
    """
    if name is None:
        return None, "The file states no image"
    path = beside.parent / name
    try:
        if not path.is_file():
            return None, f"{path}: no such file"
        image = StillPixels(path.read_bytes(), str(path))()
    except OSError as error:
        return None, f"{path}: {error.strerror}"
    except (InputError, cv2.error):
        return None, f"{path}: not a readable image"
    height, width = image.shape[:2]
    if (width, height) != (camera.width_px, camera.height_px):
        return None, f"{path}: {width} x {height} px, the camera has {camera.width_px} x {camera.height_px}"
    return image, ""
