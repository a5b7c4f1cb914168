"""The folder of a calibration's report, for one image or many: pictures, residuals, tables and words."""

import csv
import io
import logging
import math
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from aerodft.adapters.atomic_file import output_folder
from aerodft.adapters.config.evidence import EvidenceFile, takes_degrees
from aerodft.adapters.csv_cell import csv_cell
from aerodft.adapters.images import StillPixels
from aerodft.dft import INTRINSICS
from aerodft.errors import InputError
from aerodft.model import Camera, ImageArray, Landmark, ProjectionModel
from aerodft.reports.calibration.document import calibration_document, decimals, values_of
from aerodft.reports.calibration.ground_grid import axes_of, ground_grid
from aerodft.reports.calibration.marks import Row, rows_of
from aerodft.reports.calibration.picture import Picture, draw_picture
from aerodft.reports.calibration.residual_plots import draw_residuals
from aerodft.version import SOFTWARE
from calibration.flight import ImagesResult
from calibration.pose import LIMIT, Result, coefficient_names

_LOG = logging.getLogger(__name__)
_IMAGE, _RESIDUALS, _TABLE, _REPORT = "annotated.jpg", "residuals.png", "residuals.csv", "report.md"

_COLUMNS: Final = (
    "name",
    "kind",
    "u_px",
    "v_px",
    "off_u_px",
    "off_v_px",
    "residual_px",
    "residual_sigma",
    "range_m",
    "ground_m",
    "loo_ground_m",
    "left_out",
)
"""Columns of the CSV; ``u_px``, ``v_px`` is the pixel of the observation that is off most, ``off_`` from it to where it
should be; empty where there is none."""

_LAST_COLUMN: Final = (
    "The last column is the error on the ground of a calibration that has not seen the observation: so well would the"
    " next one be measured."
)
_POSE = ("east", "north", "height", "tilt", "roll", "heading", "elevation")
_UNLIKELY, _TOO_GOOD, _TINY = 0.01, 0.99, 1e-6
_DEGREE_DIGITS = 8
_ESCAPED = re.compile(r"([\\`*_{}\[\]<>#|~$&!()])")

_SIGNS = (
    "Biases are added to what telemetry says: height, east and north in metres, tilt, pan and roll as rotations about"
    " the camera's x, y and z axes, heading clockwise about the vertical. The time offset is added to the images'"
    " stamps."
)


def write_calibration_page(result: Result | ImagesResult, evidence: EvidenceFile, folder: Path) -> Path:
    """Write report.md, residuals.png and residuals.csv, and for one image annotated.jpg.

    An image that is not there, unreadable or of another size is logged, and a plain canvas takes its place.

    Args:
        result: The calibration.
        evidence: The file that it is from; its image is looked for beside it.
        folder: The folder, made where it is not there.

    Returns:
        The page, report.md.

    Raises:
        InputError: The folder cannot be written to.
    """
    rows, page = rows_of(result), folder / _REPORT
    about = calibration_document(result, evidence, None)
    with output_folder(folder, "the report"):
        if isinstance(result, ImagesResult):
            parts = _images_page(result, evidence, about)
        else:
            notes = _draw_image(result, evidence, rows, folder / _IMAGE)
            parts = _camera_page(result, evidence, about, notes)
        draw_residuals(rows, result, folder / _RESIDUALS)
        (folder / _TABLE).write_text(_residual_table(rows), encoding="utf-8", newline="")
        outliers = f"Left out: {', '.join(map(_plain, about['outliers'])) or 'nothing'}."
        residuals = ("## What is left of each observation", _LAST_COLUMN, _observation_table(rows), outliers)
        page.write_text("\n\n".join([*parts, *residuals]) + "\n", encoding="utf-8")
    return page


def _draw_image(result: Result, evidence: EvidenceFile, rows: Sequence[Row], path: Path) -> list[str]:
    """Draw the observations and the ground's metres into the image; sentences on it."""
    state = result.solution.state
    grid = ground_grid(state, axes_of(result, evidence))
    image, why_not = _image_of(evidence, state.camera)
    notes = [f"{why_not}: the canvas is plain."] if why_not else []
    if evidence.image is not None and why_not:
        _LOG.info("the report has no image: %s", why_not)
    if grid.axes.elevation_m != state.elevation_m:
        heights = [evidence.frame.origin[2] + each for each in (grid.axes.elevation_m, state.elevation_m)]
        notes.append(
            f"The grid is drawn at the landmarks' middle height, {heights[0]:.2f} m: the ground at {heights[1]:.2f} m,"
            " from which heights count, is far below them. State elevation_m in the file."
        )
    is_oriented = any(isinstance(each, Landmark) for each in result.evidence) or "heading" in evidence.known.priors
    marks = tuple((row.mark, row.left.is_outlier) for row in rows)
    return [*notes, *draw_picture(Picture(state, marks, grid, image, is_oriented), path)]


def _image_of(evidence: EvidenceFile, camera: Camera) -> tuple[ImageArray | None, str]:
    """The image that the file states, or why there is none of the camera's size."""
    if evidence.image is None:
        return None, "The file states no image"
    path = evidence.path.parent / evidence.image
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


def _images_page(result: ImagesResult, evidence: EvidenceFile, about: dict[str, Any]) -> list[str]:
    camera, images = result.solution.state.base.camera, about["images"]
    head = ("image", "height (m)", "tilt (deg)", "roll (deg)", "heading (deg)", "from telemetry (sigma)")
    keys = ("height_agl_m", "tilt_deg", "roll_deg", "heading_deg", "from_telemetry_sigma")
    what, share = _combination(result.weakest.combination), 100 * result.weakest.std_share / LIMIT
    weakest = f"Everything that was asked for is determined; {what} worst, to {share:.2g} % of what would be refused."
    return [
        f"# Telemetry and {_plain(camera.name)}: {len(images)} images",
        f"{_source(evidence)}.",
        f"Model: {about['model']}. Coordinates: {_plain(evidence.frame.crs)}.",
        "## What was found",
        _parameter_table(about),
        _SIGNS,
        *_correlation_table(about),
        "## How well it fits",
        _bullets([*_fit_sentences(result), weakest, *_note_sentences(about)]),
        f"![Residuals]({_RESIDUALS})",
        "## The images",
        _table(head, [(_plain(image["name"]), *(f"{image[key]:.2f}" for key in keys)) for image in images]),
    ]


def _camera_page(result: Result, evidence: EvidenceFile, about: dict[str, Any], notes: Sequence[str]) -> list[str]:
    state = result.solution.state
    model = "the paper's equations (dft)" if state.model is ProjectionModel.DFT else "pinhole"
    return [
        f"# Calibration of {_plain(state.camera.name)}",
        f"{_source(evidence)}, model: {model}, coordinates: {_plain(evidence.frame.crs)}.",
        f"![The image with observations and the ground grid]({_IMAGE})",
        *map(_plain, notes),
        "## What was found",
        _parameter_table(about),
        _place(about),
        *_correlation_table(about),
        f"Taken as known: {'; '.join(_known(result, evidence))}.",
        "## How well it fits",
        _bullets([*_fit_sentences(result), _observability(result), *_note_sentences(about)]),
        f"![Residuals]({_RESIDUALS})",
    ]


def _source(evidence: EvidenceFile) -> str:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return f"From {_plain(evidence.path.name)} (sha256 {evidence.sha256}), {now}, {SOFTWARE}"


def _note_sentences(about: dict[str, Any]) -> list[str]:
    return [f"{_plain(note.removesuffix('.'))}." for note in about["notes"]]


def _combination(names: Iterable[str]) -> str:
    """What is known worst, in words."""
    *others, last = map(_plain, names)
    return f"the combination of {', '.join(others)} and {last}" if others else last


def _residual_table(rows: Sequence[Row]) -> str:
    """The CSV."""
    file = io.StringIO(newline="")
    writer = csv.writer(file)
    writer.writerow(_COLUMNS)
    for row in rows:
        seen, off = row.mark.seen_px[row.mark.worst], row.mark.off_px
        numbers = (*seen.tolist(), *off.tolist(), row.left.px, row.left.sigma, row.range_m)
        ground = (row.left.ground_m, row.left.loo_ground_m)
        outlier = "yes" if row.left.is_outlier else "no"
        writer.writerow([csv_cell(row.mark.name), row.mark.kind, *map(_number, (*numbers, *ground)), outlier])
    return file.getvalue()


def _number(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.6g}"


def _plain(text: str) -> str:
    """A text that Markdown shows as it is, on one line."""
    line = "".join(each if each.isprintable() else " " for each in text)
    return _ESCAPED.sub(r"\\\1", line)


def _bullets(sentences: Sequence[str]) -> str:
    """Sentences as a Markdown list."""
    return "\n".join(f"- {sentence}" for sentence in sentences)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1) -> str:
    """A table whose first columns are words, the others numbers."""
    rule = ["---"] * words + ["---:"] * (len(head) - words)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))


def _parameter_table(about: dict[str, Any]) -> str:
    """What was found, from a result as JSON has it."""
    rows = []
    for key, each in about["parameters"].items():
        value, std = each["value"], each["std"]
        digits = decimals(std or 0.0)
        shown = (f"{value:.{digits}f}", "unknown" if std is None else f"{std:.{digits}f}")
        low, high = ("", "") if std is None else (f"{value + sign * 1.96 * std:.{digits}f}" for sign in (-1, 1))
        rows.append((_plain(key), *shown, f"{low} to {high}" if std is not None else ""))
    return _table(("unknown", "value", "std", "95 % interval"), rows)


def _place(about: dict[str, Any]) -> str:
    digits = _DEGREE_DIGITS if takes_degrees(about["crs"]) else 3
    first, second, height = about["position"]
    on_map = "" if about["lat_deg"] is None else f" (WGS84: {about['lat_deg']:.7f}, {about['lon_deg']:.7f})"
    place = f"{first:.{digits}f}, {second:.{digits}f}, {height:.3f}"
    return f"The camera is at {place} in the coordinates of the file{on_map}."


def _correlation_table(about: dict[str, Any]) -> tuple[str, ...]:
    """How the unknowns depend on each other; nothing for a single one."""
    names = about["order"]
    if len(names) == 1:
        return ()
    rows = [
        [_plain(name), *("" if value is None else f"{value:.2f}" for value in row)]
        for name, row in zip(names, about["correlations"], strict=True)
    ]
    return (_table(["correlation", *map(_plain, names)], rows),)


def _known(result: Result, evidence: EvidenceFile) -> list[str]:
    """Everything that was not solved for, with its value, and its std where the camera file has one."""
    state = result.solution.state
    lens = ["fx", "fy", "cx", "cy", *coefficient_names(state.camera)]
    stds = dict(zip(lens, np.sqrt(np.diag(result.solution.joint)[INTRINSICS]).tolist(), strict=True))
    solved = {*result.names, *(("fx", "fy") if "focal" in result.names else ())}
    others = [name for name in [*_POSE, *lens] if name not in solved]
    words = []
    for name, (key, value) in zip(others, values_of(state, others, evidence.frame).items(), strict=True):
        std = f" ± {stds[name]:.3g}" if stds.get(name) else ""
        why = ", as stated" if name in evidence.fixed else ""
        words.append(f"{_plain(key)} {value:.10g}{std}{why}")
    return words


def _fit_sentences(result: Result | ImagesResult) -> list[str]:
    """How well a calibration fits, in sentences."""
    solution, sentences = result.solution, []
    if result.rms_px is not None:
        sentences.append(f"The landmarks are {result.rms_px:.2f} px off (root mean square), outliers apart.")
    if solution.p_value is None:
        sentences.append(
            "There are no more observations than unknowns: nothing says whether the stated stds are true, or whether"
            " an observation is wrong."
        )
        return sentences
    head = f"Chi-square is {solution.chi2:.1f} with {solution.dof} degrees of freedom:"
    if solution.p_value < _UNLIKELY:
        chance = f"{100 * solution.p_value:.2g} %" if solution.p_value > _TINY else "less than a millionth"
        verdict = f"residuals so large would come up in {chance} of all calibrations if the stated stds were true."
    elif solution.p_value > _TOO_GOOD:
        small = 100 * (1 - solution.p_value)
        verdict = f"residuals so small would come up in {small:.2g} % of all calibrations if the stated stds were true."
    else:
        verdict = f"the residuals are as large as the stated stds say (chance {100 * solution.p_value:.0f} %)."
    return [*sentences, f"{head} {verdict}"]


def _observability(result: Result) -> str:
    what, share = _combination(result.weakest.combination), 100 * result.weakest.std_share
    return (
        f"Everything that was asked for is determined. Known worst is {what}: to {share:.2g} % of its"
        f" size (an angle: of a radian), where more than {100 * LIMIT:.0f} % would count as not determined."
    )


def _observation_table(rows: Sequence[Row]) -> str:
    """What is left of each observation."""
    head = ("observation", "kind", "px", "sigma", "on the ground (m)", "not having seen it (m)")
    cells = []
    for row in rows:
        ground = (row.left.ground_m, row.left.loo_ground_m)
        name = _plain(row.mark.name) + (" (left out)" if row.left.is_outlier else "")
        px = f"{row.left.px:.2f}" if math.isfinite(row.left.px) else "out of sight"
        numbers = (px, f"{row.left.sigma:.2f}", *("" if each is None else f"{each:.3f}" for each in ground))
        cells.append((name, _plain(row.mark.kind), *numbers))
    return _table(head, cells, words=2)
