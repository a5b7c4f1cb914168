"""A calibration as a JSON document and as a page in a folder, with what a person should know of it in sentences."""

import csv
import io
import logging
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from aerodft.adapters.config.evidence import EvidenceFile, LocalFrame, takes_degrees
from aerodft.adapters.files import csv_cell, output_folder, read_whole
from aerodft.adapters.images import StillPixels
from aerodft.dft import INTRINSICS
from aerodft.errors import AerodftError, InputError, NoAnswerError
from aerodft.model import Camera, FloatArray, ImageArray, Landmark, ProjectionModel
from aerodft.reports.calibration.ground_grid import axes_of, ground_grid
from aerodft.reports.calibration.marks import Row, rows_of
from aerodft.reports.calibration.picture import Picture, draw_picture
from aerodft.reports.calibration.residual_plots import draw_residuals
from aerodft.reports.rendering import render_markdown
from aerodft.reports.style import NORMAL_95
from aerodft.version import SOFTWARE
from calibration.flight import ImagesResult
from calibration.pose import (
    LIMIT,
    ObservationResidual,
    Result,
    State,
    angles_deg,
    coefficient_names,
    correlations,
    display_unit,
)

_UNLIKELY_P = 0.01
_NOTICED = 1.2  # of what stds are multiplied with
_SUSPICIOUS_P = 1e-4
_TELLING_DOF = 6  # numbers to spare, from which on two more unknowns leave some
_MAX_DECIMALS = 6


def calibration_notes(result: Result | ImagesResult, evidence: EvidenceFile) -> list[str]:
    """Sentences worth knowing: doubts about images, rejected observations, and whether stated stds are true."""
    solution, notes = result.solution, list(evidence.notes)
    for each, left in zip(result.evidence, result.left, strict=True):
        if math.isfinite(left.px):
            where = f"it is {left.px:.0f} px from where the estimated camera would see it"
        elif isinstance(each, Landmark):
            where = "it lies behind the estimated camera"
        else:
            where = "the estimated camera does not see the ground there"
        if left.is_outlier:
            notes.append(f"Rejected {left.name}: {where}.")
    if solution.dof == 0:
        notes.append("there is no observation to spare: a wrong one would not be noticed, add one")
    spare = f"{solution.dof} numbers to spare" if solution.dof != 1 else "1 number to spare"
    if solution.p_value is not None and solution.p_value < _UNLIKELY_P:
        notes.append(
            f"the residuals are {solution.misfit:.3g} times as large as the stated stds ({spare}): all stds are"
            f" multiplied by {solution.sigma_scale:.3g}{_lens_hint(result)}"
        )
    elif solution.sigma_scale > _NOTICED:
        notes.append(
            f"all stds are multiplied by {solution.sigma_scale:.2g}: with {spare}, residuals tell little of whether"
            " the stated ones are true"
        )
    elif solution.p_value is not None and solution.p_value > 1 - _SUSPICIOUS_P:
        notes.append("the residuals are much smaller than the stated stds: these may be too large")
    if isinstance(result, Result) and (guesses := sorted(evidence.fixed & set(result.names))):
        keys = ", ".join(display_unit(name)[0] for name in guesses)
        notes.append(f"{keys} has no std in the file: taken as a first guess only")
    return notes


def _lens_hint(result: Result | ImagesResult) -> str:
    """What may explain large residuals of a camera whose distortion nobody knows, where they tell it."""
    is_known = any(result.camera.distortion) or "k1" in result.names
    if is_known or result.solution.dof < _TELLING_DOF:
        return ""
    return "; a lens that bends straight lines is told by k1 and k2 in `unknowns`"


def calibration_document(
    result: Result | ImagesResult, evidence: EvidenceFile, error: AerodftError | None
) -> dict[str, Any]:
    """The whole result as JSON; nothing that is not finite.

    Args:
        result: The calibration.
        evidence: The file that it is from.
        error: Why it is refused; None where it holds.
    """
    frame, solution = evidence.frame, result.solution
    covariance, stds = displayed_covariance(result)
    fitted: dict[str, Any] = {
        "schema": "aerodft.calibration/1",
        "status": "ok" if error is None else "ILL_CONDITIONED",
        "reasons": [] if error is None else [error.got if isinstance(error, NoAnswerError) else str(error)],
        "parameters": {
            key: {"value": value, "std": _finite(std)}
            for (key, value), std in zip(displayed_values(result, frame).items(), stds.tolist(), strict=True)
        },
        "order": list(result.display_units),
        "covariance": _rows(covariance),
        "correlations": _rows(correlations(covariance)),
        "rms_px": result.rms_px,
        "chi2": solution.chi2,
        "degrees_of_freedom": solution.dof,
        "p_value": solution.p_value,
        "misfit": solution.misfit,
        "sigma_scale": solution.sigma_scale,
        "residuals": list(map(_residual, result.left)),
        "outliers": [left.name for left in result.left if left.is_outlier],
        "observability": _observability(result, frame),
    }
    if isinstance(result, ImagesResult):
        fitted["images"] = _images(result, frame)
        position, place, model = None, None, result.solution.state.base.model
    else:
        state = result.solution.state
        fitted["origin"] = list(frame.origin)
        position, place, model = (
            frame.file_coordinates(state.position_m).tolist(),
            frame.wgs84(state.position_m),
            state.model,
        )
    return {
        **fitted,
        "position": position,
        "lat_deg": None if place is None else math.degrees(place[0]),
        "lon_deg": None if place is None else math.degrees(place[1]),
        "crs": frame.crs,
        "model": str(model),
        "notes": calibration_notes(result, evidence),
    }


def _residual(left: ObservationResidual) -> dict[str, Any]:
    return {
        "name": left.name,
        "px": _finite(left.px),
        "sigma": _finite(left.sigma),
        "ground_m": left.ground_m,
        "loo_ground_m": left.loo_ground_m,
        "outlier": left.is_outlier,
    }


def _observability(result: Result | ImagesResult, frame: LocalFrame) -> dict[str, Any]:
    other = result.solution.alternative if isinstance(result, Result) else None
    return {
        "determined": result.weakest.is_determined,
        "weakest": result.weakest.combination,
        "std_share": _finite(result.weakest.std_share),
        "sentence": result.weakest.sentence,
        "rival": None if other is None else values_of(other, result.names, frame),
    }


def displayed_values(result: Result | ImagesResult, frame: LocalFrame) -> dict[str, float]:
    """Fitted values by the names that people see (``tilt_deg``), in the order of the unknowns."""
    if isinstance(result, ImagesResult):
        return result.named_values
    return values_of(result.solution.state, result.names, frame)


def displayed_covariance(result: Result | ImagesResult) -> tuple[FloatArray, FloatArray]:
    """The covariance ``(n, n)`` and standard deviations ``(n,)`` of what was found, in the units that people see."""
    scales = list(result.display_units.values())
    covariance = result.named_covariance * np.outer(scales, scales)
    return covariance, np.sqrt(np.maximum(np.diag(covariance), 0.0))


def values_of(state: State, names: Sequence[str], frame: LocalFrame) -> dict[str, float]:
    """A camera's values by the names that people see, in the order of the unknowns.

    Heights are above the ground; east, north and the ground's elevation are in the file's coordinates, but where these
    are degrees east and north count from the frame's origin.
    """
    places_m = dict(zip(("east", "north"), frame.file_coordinates(state.position_m).tolist(), strict=False))
    own = {"height": state.value("height") - state.elevation_m, "elevation": state.elevation_m + frame.origin[2]}
    own |= {} if takes_degrees(frame.crs) else places_m
    return {display_unit(name)[0]: display_unit(name)[1] * own.get(name, state.value(name)) for name in names}


def decimals(std: float) -> int:
    """Places after the point that a value with this std deserves: those of the std's two leading digits."""
    if not 0 < std < math.inf:
        return _MAX_DECIMALS
    return max(0, 1 - math.floor(math.log10(std)))


def _images(result: ImagesResult, frame: LocalFrame) -> list[dict[str, Any]]:
    """Place of each image, and its distance from the corrected telemetry in standard deviations."""
    described = []
    for view, camera, own in zip(result.problem.views, result.solution.cameras, result.solution.state.own, strict=True):
        tilt_deg, roll_deg, heading_deg = angles_deg(camera)
        described.append(
            {
                "name": view.name,
                "height_agl_m": float(camera.position_m[2]) - camera.elevation_m,
                "tilt_deg": tilt_deg,
                "roll_deg": roll_deg,
                "heading_deg": heading_deg,
                "position": frame.file_coordinates(camera.position_m).tolist(),
                "from_telemetry_sigma": float(np.linalg.norm(own)),
            }
        )
    return described


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _rows(matrix: FloatArray) -> list[list[float | None]]:
    return [[_finite(value) for value in row] for row in matrix.tolist()]


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

_POSE = ("east", "north", "height", "tilt", "roll", "heading", "elevation")
_TOO_GOOD, _TINY = 0.99, 1e-6
_DEGREE_DIGITS = 8


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
    values = _page_values(result, evidence, rows)
    with output_folder(folder, "the report"):
        if isinstance(result, ImagesResult):
            text = render_markdown("images", **values)
        else:
            notes = _draw_image(result, evidence, rows, folder / _IMAGE)
            text = render_markdown("camera", **values, **_camera_values(result, evidence), image_notes=notes)
        draw_residuals(rows, result, folder / _RESIDUALS)
        (folder / _TABLE).write_text(_residual_table(rows), encoding="utf-8", newline="")
        page.write_text(text, encoding="utf-8")
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
        image = StillPixels(read_whole(path), str(path))()
    except OSError as error:
        return None, f"{path}: {error.strerror}"
    except (InputError, cv2.error):
        return None, f"{path}: not a readable image"
    height, width = image.shape[:2]
    if (width, height) != (camera.width_px, camera.height_px):
        return None, f"{path}: {width} x {height} px, the camera has {camera.width_px} x {camera.height_px}"
    return image, ""


def _page_values(result: Result | ImagesResult, evidence: EvidenceFile, rows: Sequence[Row]) -> dict[str, Any]:
    """Values that the page of every calibration shows."""
    is_of_images = isinstance(result, ImagesResult)
    about = calibration_document(result, evidence, None)
    share = result.weakest.std_share / LIMIT if is_of_images else result.weakest.std_share
    return {
        "camera": (
            result.solution.state.base if isinstance(result, ImagesResult) else result.solution.state
        ).camera.name,
        "images": about.get("images"),
        "source": {"name": evidence.path.name, "sha256": evidence.sha256},
        "written_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": SOFTWARE,
        "model": about["model"],
        "crs": about["crs"],
        "parameters": _parameter_rows(about),
        "correlations": list(zip(about["order"], about["correlations"], strict=True)),
        "fit": _fit_sentences(result),
        "weakest_names": list(result.weakest.combination),
        "weakest_percent": f"{100 * share:.2g}",
        "sentences": about["notes"],
        "residuals_file": _RESIDUALS,
        "observations": _observation_rows(rows),
        "outliers": about["outliers"],
    }


def _camera_values(result: Result, evidence: EvidenceFile) -> dict[str, Any]:
    """Values that the page of one camera shows besides."""
    about, state = calibration_document(result, evidence, None), result.solution.state
    digits = _DEGREE_DIGITS if takes_degrees(about["crs"]) else 3
    first, second, height = about["position"]
    return {
        "is_dft": state.model is ProjectionModel.DFT,
        "image_file": _IMAGE,
        "place": (f"{first:.{digits}f}", f"{second:.{digits}f}", f"{height:.3f}"),
        "lat_deg": about["lat_deg"],
        "lon_deg": about["lon_deg"],
        "known": _known(result, evidence),
        "limit_percent": f"{100 * LIMIT:.0f}",
    }


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


def _parameter_rows(about: dict[str, Any]) -> list[dict[str, str]]:
    """Each fitted parameter with its std and interval, which are empty where they are unknown."""
    rows = []
    for key, each in about["parameters"].items():
        value, std = each["value"], each["std"]
        digits = decimals(std or 0.0)
        row = {"key": key, "value": f"{value:.{digits}f}", "std": "", "low": "", "high": ""}
        if std is not None:
            low, high = (f"{value + sign * NORMAL_95 * std:.{digits}f}" for sign in (-1, 1))
            row |= {"std": f"{std:.{digits}f}", "low": low, "high": high}
        rows.append(row)
    return rows


def _known(result: Result, evidence: EvidenceFile) -> list[dict[str, Any]]:
    """Everything that was not solved for, with its value, and its std where the camera file has one."""
    state = result.solution.state
    lens = ["fx", "fy", "cx", "cy", *coefficient_names(state.camera)]
    stds = dict(zip(lens, np.sqrt(np.diag(result.solution.joint)[INTRINSICS]).tolist(), strict=True))
    solved = {*result.names, *(("fx", "fy") if "focal" in result.names else ())}
    others = [name for name in [*_POSE, *lens] if name not in solved]
    return [
        {
            "key": key,
            "value": f"{value:.10g}",
            "std": f"{stds[name]:.3g}" if stds.get(name) else "",
            "is_stated": name in evidence.fixed,
        }
        for name, (key, value) in zip(others, values_of(state, others, evidence.frame).items(), strict=True)
    ]


def _fit_sentences(result: Result | ImagesResult) -> list[str]:
    """Sentences in Markdown on how well a calibration fits; no word in them is from a file."""
    solution, sentences = result.solution, []
    if result.rms_px is not None:
        sentences.append(f"The landmarks are {result.rms_px:.2f} px off (root mean square), outliers apart.")
    if solution.p_value is None:
        sentences.append(
            "There are no more observations than unknowns: nothing says whether the stated stds are true, or whether"
            " an observation is wrong."
        )
        return sentences
    head = f"Chi-square is {solution.chi2:.1f} with {solution.dof} degree{'s' * (solution.dof != 1)} of freedom:"
    if solution.p_value < _UNLIKELY_P:
        chance = f"{100 * solution.p_value:.2g} %" if solution.p_value > _TINY else "less than a millionth"
        verdict = f"residuals so large would come up in {chance} of all calibrations if the stated stds were true."
    elif solution.p_value > _TOO_GOOD:
        small = 100 * (1 - solution.p_value)
        verdict = f"residuals so small would come up in {small:.2g} % of all calibrations if the stated stds were true."
    else:
        verdict = f"the residuals are as large as the stated stds say (chance {100 * solution.p_value:.0f} %)."
    return [*sentences, f"{head} {verdict}"]


def _observation_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Each observation's residuals."""
    return [
        {
            "name": row.mark.name,
            "is_outlier": row.left.is_outlier,
            "kind": row.mark.kind,
            "px": f"{row.left.px:.2f}" if math.isfinite(row.left.px) else "out of sight",
            "sigma": f"{row.left.sigma:.2f}",
            "ground_m": "" if row.left.ground_m is None else f"{row.left.ground_m:.3f}",
            "loo_ground_m": "" if row.left.loo_ground_m is None else f"{row.left.loo_ground_m:.3f}",
        }
        for row in rows
    ]
