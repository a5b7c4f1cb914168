"""``aerodft calibrate`` with many images in its file: what telemetry is off by in all of them."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from aerodft.adapters.config.camera import write_calibration
from aerodft.adapters.config.evidence import EvidenceFile
from aerodft.reports.calibration.document import (
    fit_sentences,
    images_refusal,
    provenance,
    residual_table,
    result_document,
)
from aerodft.app.calibrate.image_poses import views_of
from aerodft.cli.output import print_json, say, tables
from aerodft.errors import AerodftError, UsageError
from aerodft.model import BIASES, BiasValues, Calibration, Camera, ProjectionModel
from calibration.flight import ImagesResult, calibrate_images, said_of_images, typical_noise
from calibration.pose import angles_deg, expanded


def calibrate_flight(
    found: EvidenceFile,
    lens: Camera,
    names: tuple[str, ...],
    model: ProjectionModel,
    telemetry: Path | None,
    camera_file: Path,
    output: Path | None,
    report: Path | None,
    *,
    as_json: bool,
) -> None:
    """Solve, say and write.

    Args:
        found: A file of evidence with images.
        lens: Their camera.
        names: What is asked for.
        model: Projection model.
        telemetry: Log or recording to take the place of the file's.
        camera_file: The camera's, for the provenance.
        output: File for the calibration; None for none.
        report: Folder for pictures and tables; None for none.
        as_json: Print one JSON document, else tables.

    Raises:
        AerodftError: An image has no pose, unknowns that there are not, or no answer.
    """
    views, priors = views_of(found, telemetry, is_time_asked="time" in expanded(names))
    try:
        result = calibrate_images(views, priors, lens, names, model)
    except ValueError as error:
        raise UsageError("--unknowns", got=str(error).removeprefix("got ")) from None
    why_not = images_refusal(result, found.path)
    if as_json:
        print_json(images_document(result, found, why_not))
    else:
        _print(result)
    for sentence in fit_sentences(result):
        say(f"aerodft: {sentence}")
    if why_not is not None:
        raise why_not
    if report is not None:
        from aerodft.reports.calibration.page import write_images_report

        write_images_report(result, found, images_document(result, found, None), report)
    if output is not None:
        lens_found = any(np.any(row) for row in result.camera.covariance)
        log = telemetry or (None if found.flight is None else found.flight.log)
        inputs = {
            "telemetry": None if log is None else log.name,
            "camera_file": camera_file.name,
            "images": len(result.problem.views),
        }
        biases, about = calibration_of(result, found), provenance(result, found, names, inputs)
        write_calibration(output, biases, result.camera if lens_found else None, model, about)
        say(f"wrote {output}")


def calibration_of(result: ImagesResult, found: EvidenceFile) -> Calibration:
    """The biases as stations take them: east and north are true ones."""
    state, count = result.solution.state, len(BIASES)
    height, tilt, roll, heading, pan, east, north, time = state.biases.tolist()
    turn = found.frame.true_heading_rad(0.0) or 0.0
    to_true = np.eye(count)
    places = [BIASES.index("east"), BIASES.index("north")]
    to_true[np.ix_(places, places)] = [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
    east, north = (to_true[np.ix_(places, places)] @ [east, north]).tolist()
    cov = to_true @ result.bias_covariance
    lens = cov[:, count:]
    return Calibration(
        id="",
        bias=BiasValues(
            height_m=height - result.ground_m,
            tilt_rad=tilt,
            roll_rad=roll,
            heading_rad=heading,
            pan_rad=pan,
            east_m=east,
            north_m=north,
            time_s=time,
        ),
        bias_cov=cov[:, :count] @ to_true.T,
        lens_cov=lens if np.any(lens) else None,
        noise=typical_noise([view.noise for view in result.problem.views]),
    )


def images_document(result: ImagesResult, found: EvidenceFile, error: AerodftError | None) -> dict[str, Any]:
    """The whole result as JSON; nothing that is not finite."""
    scales = [said_of_images(name)[1] for name in result.names]
    return {
        **result_document(result, result.named_values, scales, error),
        "images": _images(result, found),
        "position": None,
        "lat_deg": None,
        "lon_deg": None,
        "crs": found.frame.crs,
        "model": str(result.solution.state.base.model),
        "notes": [*found.notes, *fit_sentences(result)],
    }


def _images(result: ImagesResult, found: EvidenceFile) -> list[dict[str, Any]]:
    """Where each image was taken, and how far that is from the corrected telemetry in its own standard deviations."""
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
                "position": found.frame.file_coordinates(camera.position_m).tolist(),
                "from_telemetry_sigma": float(np.linalg.norm(own)),
            }
        )
    return described


def _print(result: ImagesResult) -> None:
    """Two tables: the unknowns, and what is left of each observation."""
    table = Table("unknown", "value", "std")
    stds = np.sqrt(np.maximum(np.diag(result.named_covariance), 0.0)).tolist()
    for name, (key, value), std in zip(result.names, result.named_values.items(), stds, strict=True):
        table.add_row(key, f"{value:.6g}", f"{std * said_of_images(name)[1]:.3g}")
    tables().print(table)
    tables().print(residual_table(result.left))
    rms, solution = "" if result.rms_px is None else f"rms {result.rms_px:.2f} px, ", result.solution
    fit = f"{rms}chi-square {solution.chi2:.1f} with {solution.dof} degrees of freedom"
    tables().print(f"{fit}; {len(result.problem.views)} images")
