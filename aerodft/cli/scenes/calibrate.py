"""``aerodft calibrate``: a camera's height and angles, and more, from what people know about a scene."""

import hashlib
import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aerodft.adapters.config.camera import FixedPose, load_camera, write_calibration
from aerodft.adapters.config.evidence import EvidenceFile, check_against, load_evidence
from calibration.diagnosis.likely_mistakes import Asked, cause_of_misfit
from aerodft.app.calibrate.unknowns import check_unknowns, names_from, unstated
from aerodft.reports.calibration.document import document, print_result, provenance, refusal, sentences
from aerodft.adapters.images.camera_mode import check_mode
from aerodft.cli.output import check_output, print_json, say
from aerodft.errors import UsageError
from aerodft.model import Camera, PoseStd, ProjectionModel
from calibration.pose import Result, angles_deg
from calibration.pose import calibrate as solve_for


def calibrate(
    observations: Annotated[
        list[Path],
        typer.Argument(help="What is known: TOML, or CSV with a row for each landmark; with --detect, images."),
    ],
    camera: Annotated[Path, typer.Option(help="Camera file (TOML).")],
    unknowns: Annotated[
        str,
        typer.Option(help="height,tilt,roll,heading,position,focal (or fx,fy),principal_point,elevation,k1,k2,..."),
    ] = "height,tilt",
    model: Annotated[ProjectionModel, typer.Option(help="Projection model.")] = ProjectionModel.PINHOLE,
    detect: Annotated[
        Path | None, typer.Option(help="Find the surveyed ArUco or AprilTag markers of this file in the images.")
    ] = None,
    telemetry: Annotated[
        Path | None,
        typer.Option(help="With [[image]] in the file: log or recording that their poses are looked up in."),
    ] = None,
    crs: Annotated[str | None, typer.Option(help="Of a CSV file: local, geo or an EPSG code.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the calibration to this file.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write pictures and tables to this folder.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    r"""Find a camera's pose (and lens) from landmarks, ranges, lengths, heights, verticals, lines and the horizon.

    With several images in the file, each with a pose by telemetry: what telemetry is off by, in all of them.

    \b
    Example:
      aerodft calibrate site.toml --camera cam.toml --unknowns height,tilt,roll -o calibration.toml
      aerodft calibrate flight.toml --camera cam.toml --unknowns height,tilt,heading,time --telemetry flight.tlog
    """
    lens = load_camera(camera)
    names = names_from(unknowns)
    check_output(output, [*observations, camera, *([] if detect is None else [detect])])
    found = _evidence(observations, detect, crs, lens, names, model)
    check_against(found, lens)
    if found.flight is not None:
        from aerodft.app.calibrate.flight import calibrate_flight

        calibrate_flight(found, lens, names, model, telemetry, camera, output, report, as_json=json)
        return
    if telemetry is not None:
        raise UsageError("--telemetry", got="a file without [[image]]", expected="images whose poses are looked up")
    check_unknowns(names, found.known, lens, model)
    result = solve_for(found.known, lens, names, model)
    asked = Asked(found, lens, names, model, result)
    missing = unstated(result, found.known, found.path, is_written=output is not None)
    why_not = cause_of_misfit(asked) or missing or refusal(result, found)
    if json:
        print_json(document(result, found, why_not))
    else:
        print_result(result, found)
    for sentence in sentences(result, found):
        say(f"aerodft: {sentence}")
    if why_not is not None:
        raise why_not
    _write(asked, camera, output, report)


def _evidence(
    given: list[Path],
    detect: Path | None,
    crs: str | None,
    lens: Camera,
    names: tuple[str, ...],
    model: ProjectionModel,
) -> EvidenceFile:
    if detect is not None:
        if crs is not None:
            raise UsageError("--crs beside --detect", expected="it in the file of markers")
        from aerodft.app.calibrate.markers import detected_evidence

        return detected_evidence(detect, given, lens, names, model)
    if len(given) != 1:
        raise UsageError("observations", got=f"{len(given)} files", expected="one; images go with --detect MARKERS")
    found = load_evidence(given[0], crs)
    return found.with_notes(*check_mode(found.image_paths, lens))


def _write(asked: Asked, camera: Path, output: Path | None, report: Path | None) -> None:
    result, found = asked.result, asked.found
    if report is not None:
        from aerodft.reports.calibration.page import write_report

        write_report(result, found, report)
    if output is not None:
        inputs = {
            "images_sha256": {each.name: _sha256(each) for each in found.image_paths} or None,
            "camera_file": camera.name,
            "camera_sha256": _sha256(camera),
        }
        lens_found = any(np.any(row) for row in result.camera.covariance)
        lens = replace(result.camera, mode=asked.camera.mode) if lens_found else None
        about = provenance(result, found, asked.names, inputs)
        write_calibration(output, fixed_pose(result, found), lens, result.solution.state.model, about)
        say(f"wrote {output}")


def _sha256(path: Path) -> str:
    """Of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def fixed_pose(result: Result, found: EvidenceFile) -> FixedPose:
    """The pose as stations take it: on the map with true north where the file's coordinates are on one."""
    state, cov, lens = result.solution.state, result.pose_covariance.copy(), result.lens_covariance.copy()
    tilt_deg, roll_deg, heading_deg = angles_deg(state)
    place, heading_rad = found.frame.wgs84(state.position_m), math.radians(heading_deg)
    true_rad = found.frame.true_heading_rad(heading_rad)
    if true_rad is not None:
        turn = true_rad - heading_rad
        from_grid = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
        cov[:2] = from_grid @ cov[:2]
        cov[:, :2] = cov[:, :2] @ from_grid.T
        lens[:2] = from_grid @ lens[:2]
        heading_rad = true_rad
    stds = np.sqrt(np.maximum(np.diag(cov), 0.0))
    names, named = result.problem.unknowns.names, np.sqrt(np.maximum(np.diag(result.named_covariance), 0.0))
    by_name = dict(zip(names, named.tolist(), strict=True))
    here_m = state.position_m if place is not None else found.frame.file_coordinates(state.position_m)
    return FixedPose(
        height_agl_m=float(state.position_m[2]) - state.elevation_m,
        tilt_rad=math.radians(tilt_deg),
        roll_rad=math.radians(roll_deg),
        heading_rad=heading_rad,
        lat_rad=None if place is None else float(place[0]),
        lon_rad=None if place is None else float(place[1]),
        alt_msl_m=None if place is None else float(place[2]),
        std=PoseStd(
            height_agl_m=by_name.get("height", 0.0),
            horizontal_m=float(np.hypot(*stds[:2])) / math.sqrt(2),
            tilt_rad=by_name.get("tilt", 0.0),
            roll_rad=by_name.get("roll", 0.0),
            heading_rad=by_name.get("heading", 0.0),
        ),
        covariance=tuple(map(tuple, cov.tolist())),
        lens_covariance=tuple(map(tuple, lens.tolist())) if np.any(lens) else (),
        east_m=float(here_m[0]),
        north_m=float(here_m[1]),
    )
