"""The folder of ``aerodft calibrate --report``, for one image or many: pictures, residuals, tables and words."""

import csv
import io
import math
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from aerodft.adapters.config.evidence import EvidenceFile, takes_degrees
from aerodft.adapters.images import StillPixels
from aerodft.reports.calibration.ground_grid import axes_of, ground_grid
from aerodft.reports.calibration.picture import Picture, draw_picture
from aerodft.reports.calibration.marks import Row, rows_of, rows_of_images
from aerodft.reports.calibration.residual_plots import draw_residuals
from aerodft.reports.calibration.document import decimals, document, values_of
from aerodft.cli.output import output_folder, say
from aerodft.dft import INTRINSICS
from aerodft.errors import InputError
from aerodft.model import Camera, ImageArray, Landmark, ProjectionModel
from aerodft.version import SOFTWARE
from calibration.flight import ImagesResult
from calibration.pose import LIMIT, Result, coefficient_names

_IMAGE, _RESIDUALS, _TABLE, _REPORT = "annotated.jpg", "residuals.png", "residuals.csv", "report.md"

COLUMNS: Final = (
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
    "left_out_ground_m",
    "left_out",
)
"""Of the CSV; ``u_px``, ``v_px`` is the pixel of the observation that is off most, ``off_`` from it to where it should
be; empty where there is none."""

LAST_COLUMN: Final = (
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
    with output_folder(report, "the report"):
        notes += draw_picture(Picture(state, marks, grid, image, is_oriented), report / _IMAGE)
        _write(rows, result, markdown(result, found, rows, notes), report)


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
    with output_folder(report, "the report"):
        _write(rows, result, _images_markdown(result, found, about, rows), report)


def _write(rows: Sequence[Row], result: Result | ImagesResult, words: str, report: Path) -> None:
    draw_residuals(rows, result, report / _RESIDUALS)
    (report / _TABLE).write_text(residual_table(rows), encoding="utf-8", newline="")
    (report / _REPORT).write_text(words, encoding="utf-8")
    say(f"wrote {report / _REPORT}")


def _images_markdown(result: ImagesResult, found: EvidenceFile, about: dict[str, Any], rows: Sequence[Row]) -> str:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    camera = result.solution.state.base.camera
    parts = [
        f"# Telemetry and {plain(camera.name)}: {len(about['images'])} images",
        f"From {plain(found.path.name)} (sha256 {found.sha256}), {now}, {SOFTWARE}.",
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
        *_observations(about, rows),
    ]
    return "\n\n".join(parts) + "\n"


def _observations(about: dict[str, Any], rows: Sequence[Row]) -> tuple[str, ...]:
    """What is left of each observation, with a heading."""
    left_out = f"Left out: {', '.join(plain(name) for name in about['outliers']) or 'nothing'}."
    return "## What is left of each observation", LAST_COLUMN, observation_table(rows), left_out


def _combined(names: Iterable[str]) -> str:
    """What is known worst, in words."""
    *others, last = map(plain, names)
    return f"the combination of {', '.join(others)} and {last}" if others else last


def _worst(result: ImagesResult) -> str:
    what, share = _combined(result.weakest.combination), 100 * result.weakest.std_share / LIMIT
    return f"Everything that was asked for is determined; {what} worst, to {share:.2g} % of what would be refused."


def _images(images: Sequence[dict[str, Any]]) -> str:
    head = ("image", "height (m)", "tilt (deg)", "roll (deg)", "heading (deg)", "from telemetry (sigma)")
    keys = ("height_agl_m", "tilt_deg", "roll_deg", "heading_deg", "from_telemetry_sigma")
    return table(head, [(plain(image["name"]), *(f"{image[key]:.2f}" for key in keys)) for image in images])


def residual_table(rows: Sequence[Row]) -> str:
    """The CSV."""
    file = io.StringIO(newline="")
    writer = csv.writer(file)
    writer.writerow(COLUMNS)
    for row in rows:
        seen, off = row.mark.seen_px[row.mark.worst], row.mark.off_px
        numbers = (*seen.tolist(), *off.tolist(), row.left.px, row.left.sigma, row.range_m)
        ground = (row.left.ground_m, row.left.left_out_ground_m)
        outlier = "yes" if row.left.is_outlier else "no"
        writer.writerow([row.mark.name, row.mark.kind, *map(_number, (*numbers, *ground)), outlier])
    return file.getvalue()


def _number(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.6g}"


def markdown(result: Result, found: EvidenceFile, rows: Sequence[Row], notes: Sequence[str]) -> str:
    """The report.

    Args:
        result: The calibration.
        found: What it is from.
        rows: Its observations.
        notes: Sentences on the image.
    """
    about = document(result, found, None)
    parts = [
        f"# Calibration of {plain(result.solution.state.camera.name)}",
        _provenance(result, found),
        f"![The image with observations and the ground grid]({_IMAGE})",
        *(plain(note) for note in notes),
        "## What was found",
        parameter_table(about),
        _place(about),
        *([correlation_table(about)] if len(about["order"]) > 1 else []),
        f"Taken as known: {'; '.join(_known(result, found))}.",
        "## How well it fits",
        bullets([*fit_words(result), _observability(result), *(f"{plain(note)}." for note in about["notes"])]),
        f"![Residuals]({_RESIDUALS})",
        *_observations(about, rows),
    ]
    return "\n\n".join(parts) + "\n"


def plain(text: str) -> str:
    """A text that Markdown shows as it is, on one line."""
    line = "".join(each if each.isprintable() else " " for each in text)
    return _ESCAPED.sub(r"\\\1", line)


def bullets(sentences: Sequence[str]) -> str:
    """Sentences as a Markdown list."""
    return "\n".join(f"- {sentence}" for sentence in sentences)


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1) -> str:
    """A table whose first columns are words, the others numbers."""
    rule = ["---"] * words + ["---:"] * (len(head) - words)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))


def _provenance(result: Result, found: EvidenceFile) -> str:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    model = "the paper's equations (dft)" if result.solution.state.model is ProjectionModel.DFT else "pinhole"
    return (
        f"From {plain(found.path.name)} (sha256 {found.sha256}), {now}, {SOFTWARE}, model: {model},"
        f" coordinates: {plain(found.frame.crs)}."
    )


def parameter_table(about: dict[str, Any]) -> str:
    """What was found, from a result as JSON has it."""
    rows = []
    for key, each in about["parameters"].items():
        value, std = each["value"], each["std"]
        digits = decimals(std or 0.0)
        shown = (f"{value:.{digits}f}", "unknown" if std is None else f"{std:.{digits}f}")
        low, high = ("", "") if std is None else (f"{value + sign * 1.96 * std:.{digits}f}" for sign in (-1, 1))
        rows.append((plain(key), *shown, f"{low} to {high}" if std is not None else ""))
    return table(("unknown", "value", "std", "95 % interval"), rows)


def _place(about: dict[str, Any]) -> str:
    digits = _DEGREE_DIGITS if takes_degrees(about["crs"]) else 3
    first, second, height = about["position"]
    on_map = "" if about["lat_deg"] is None else f" (WGS84: {about['lat_deg']:.7f}, {about['lon_deg']:.7f})"
    place = f"{first:.{digits}f}, {second:.{digits}f}, {height:.3f}"
    return f"The camera is at {place} in the coordinates of the file{on_map}."


def correlation_table(about: dict[str, Any]) -> str:
    """How what was found depends on each other, likewise."""
    names = about["order"]
    rows = [
        [plain(name), *("" if value is None else f"{value:.2f}" for value in row)]
        for name, row in zip(names, about["correlations"], strict=True)
    ]
    return table(["correlation", *map(plain, names)], rows)


def _known(result: Result, found: EvidenceFile) -> list[str]:
    """Everything that was not solved for, with its value, and its std where the camera file has one."""
    state, unknowns = result.solution.state, result.problem.unknowns.names
    lens = ["fx", "fy", "cx", "cy", *coefficient_names(state.camera)]
    stds = dict(zip(lens, np.sqrt(np.diag(result.solution.joint)[INTRINSICS]).tolist(), strict=True))
    asked = {*unknowns, *(("fx", "fy") if "focal" in unknowns else ())}
    others = [name for name in [*_POSE, *lens] if name not in asked]
    words = []
    for name, (key, value) in zip(others, values_of(state, others, found.frame).items(), strict=True):
        std = f" ± {stds[name]:.3g}" if stds.get(name) else ""
        why = ", as stated" if name in found.fixed else ""
        words.append(f"{plain(key)} {value:.10g}{std}{why}")
    return words


def fit_words(result: Result | ImagesResult) -> list[str]:
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
    weakest = result.weakest
    if not weakest.is_determined:
        return plain(weakest.sentence[:1].upper() + weakest.sentence[1:] + ".")
    what = _combined(weakest.combination)
    return (
        f"Everything that was asked for is determined. Known worst is {what}: to {100 * weakest.std_share:.2g} % of its"
        f" size (an angle: of a radian), where more than {100 * LIMIT:.0f} % would count as not determined."
    )


def observation_table(rows: Sequence[Row]) -> str:
    """What is left of each observation."""
    head = ("observation", "kind", "px", "sigma", "on the ground (m)", "not having seen it (m)")
    cells = []
    for row in rows:
        ground = (row.left.ground_m, row.left.left_out_ground_m)
        name = plain(row.mark.name) + (" (left out)" if row.left.is_outlier else "")
        px = f"{row.left.px:.2f}" if math.isfinite(row.left.px) else "out of sight"
        numbers = (px, f"{row.left.sigma:.2f}", *("" if each is None else f"{each:.3f}" for each in ground))
        cells.append((name, plain(row.mark.kind), *numbers))
    return table(head, cells, words=2)
