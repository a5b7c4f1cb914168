"""``aerodft calibrate`` and ``calibrate-lens``: a camera's pose by what is known of a scene, its lens by a board."""

from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from aerodft.app import no_progress
from aerodft.cli.options import JsonOption, grouped
from aerodft.cli.output import check_output, print_json, progress, say, tables
from aerodft.errors import UsageError, counted
from aerodft.model import ProjectionModel

if TYPE_CHECKING:
    from aerodft.app.calibrate import CalibrationResult
    from aerodft.app.calibrate_lens import LensCalibration


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceOptions:
    """Options on what a file of evidence leaves open; named as ``app.calibrate.calibrate`` has it."""

    telemetry: Annotated[
        Path | None,
        typer.Option(help="With [[image]] in the file: log or recording that their poses are looked up in."),
    ] = None
    crs: Annotated[str | None, typer.Option(help="Of a CSV file: local, geo or an EPSG code.")] = None
    plane_elevation_m: Annotated[
        float | None,
        typer.Option(
            "--plane-elevation", help="Of a CSV file or GCP list: elevation of the measured plane, in metres."
        ),
    ] = None
    image: Annotated[
        str | None, typer.Option(help="Of a GCP list of several images: the one that the camera took.")
    ] = None
    accept_misfit: Annotated[
        bool, typer.Option("--accept-misfit", help="Take observations that contradict each other, with larger stds.")
    ] = False
    model: Annotated[ProjectionModel, typer.Option(help="Projection model.")] = ProjectionModel.PINHOLE


@grouped
def calibrate(
    observations: Annotated[
        list[Path],
        typer.Argument(help="What is known: TOML, CSV of landmarks, ODM's gcp_list.txt; with --detect, images."),
    ],
    camera: Annotated[Path, typer.Option(help="Camera file (TOML), or a photo with EXIF data.")],
    known: EvidenceOptions,
    unknowns: Annotated[
        str,
        typer.Option(help="height,tilt,roll,heading,position,focal (or fx,fy),principal_point,elevation,k1,k2,..."),
    ] = "height,tilt",
    detect: Annotated[
        Path | None, typer.Option(help="Find the surveyed ArUco or AprilTag markers of this file in the images.")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the calibration to this file.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write pictures and tables to this folder.")] = None,
    json: JsonOption = False,
) -> None:
    r"""Find a camera's pose (and lens) from landmarks, ranges, lengths, heights, verticals, lines and the horizon.

    With several images in the file, each with a pose by telemetry: what telemetry is off by, in all of them.

    \b
    Example:
      aerodft calibrate site.toml --camera cam.toml --unknowns height,tilt,roll -o calibration.toml
      aerodft calibrate flight.toml --camera cam.toml --unknowns height,tilt,heading,time --telemetry flight.tlog
    """
    from aerodft.app.calibrate import calibrate as solve

    check_output(output, [*observations, camera, *([] if detect is None else [detect])])
    if detect is None and len(observations) != 1:
        got, expected = counted(len(observations), "file"), "one; images go with --detect MARKERS"
        raise UsageError("observations", got=got, expected=expected)
    with nullcontext(no_progress) if detect is None else progress("looking for markers") as advance:
        found = solve(
            detect or observations[0],
            camera,
            [name.strip() for name in unknowns.split(",") if name.strip()],
            **asdict(known),
            images=None if detect is None else observations,
            progress=advance,
            check=False,
        )
    _finish(found, output, report, as_json=json)


def _finish(found: "CalibrationResult", output: Path | None, report: Path | None, *, as_json: bool) -> None:
    """Say what was found, and write it unless it cannot be used.

    Raises:
        AerodftError: Why it cannot.
    """
    is_saved = output is not None
    error = found.refusal(is_saved=is_saved)
    if as_json:
        print_json(found.document(is_saved=is_saved))
    elif not error:
        _print(found)
    for sentence in found.evidence.notes if error else found.notes:
        say(f"aerodft: {sentence}")
    if error:
        raise error
    if report is not None:
        say(f"wrote {found.write_report(report)}")
    if output is not None:
        found.save(output)
        say(f"wrote {output}")


def _print(found: "CalibrationResult") -> None:
    """Two tables, the unknowns and what is left of each observation, and how well it fits."""
    from rich.table import Table

    from aerodft.adapters.config.evidence import takes_degrees
    from aerodft.reports.calibration import decimals
    from calibration.pose import Result

    fit, frame = found.fit, found.evidence.frame
    table = Table("unknown", "value", "std")
    for (name, value), std in zip(found.values.items(), found.stds.values(), strict=True):
        shown = f"{value:.{decimals(std)}f}" if isinstance(fit, Result) else f"{value:.6g}"
        table.add_row(name, shown, f"{std:.3g}")
    tables().print(table)
    residuals = Table("observation", "px", "sigma", "on the ground (m)", "not having seen it (m)")
    for left in fit.left:
        ground, loo_ground = ("" if value is None else f"{value:.3f}" for value in (left.ground_m, left.loo_ground_m))
        name = f"{left.name} (left out)" if left.is_outlier else left.name
        residuals.add_row(name, f"{left.px:.2f}", f"{left.sigma:.2f}", ground, loo_ground)
    tables().print(residuals)
    rms = "" if fit.rms_px is None else f"rms {fit.rms_px:.2f} px, "
    dof = fit.solution.dof
    chi2 = f"{rms}chi-square {fit.solution.chi2:.1f} with {dof} degree{'s' * (dof != 1)} of freedom"
    if not isinstance(fit, Result):
        tables().print(f"{chi2}; {len(fit.problem.views)} images")
        return
    place = ", ".join(f"{value:.3f}" for value in frame.file_coordinates(fit.solution.state.position_m))
    tables().print(f"{chi2}; camera at {place} ({frame.crs})")
    if {"east", "north"} & set(fit.names) and takes_degrees(frame.crs):
        origin = ", ".join(f"{value:.10g}" for value in frame.origin[:2])
        tables().print(f"east_m and north_m count from {origin}")


def calibrate_lens(
    sources: Annotated[
        list[Path] | None, typer.Argument(metavar="VIDEO|IMAGES...", help="Videos, images, folders of images.")
    ] = None,
    board: Annotated[
        str,
        typer.Option(
            help="chessboard:COLSxROWS:SQUARE, inner corners, e.g. chessboard:9x6:25mm;"
            " or charuco:COLSxROWS:SQUARE:MARKER:DICT, squares; charuco alone is charuco:10x7:25mm:18mm:4X4_50."
        ),
    ] = "charuco",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Camera file to write (TOML).")] = None,
    name: Annotated[str | None, typer.Option(help="Of the camera, for its file; else the output's name.")] = None,
    lens: Annotated[Literal["brown", "rational", "fisheye"], typer.Option(help="What describes the lens.")] = "brown",
    report: Annotated[Path | None, typer.Option(help="Folder for a page with coverage and residuals.")] = None,
    print_board: Annotated[
        Path | None, typer.Option(help="Instead of calibrating: write the board as a PNG to print in true size.")
    ] = None,
    json: JsonOption = False,
) -> None:
    r"""Calibrate a lens from images of a flat board, with the covariance of everything that is found.

    A camera file belongs to one mode of a camera: size, crop, zoom, focus and stabilisation as they are in flight.

    \b
    Example:
      aerodft calibrate-lens --board charuco --print-board board.png
      aerodft calibrate-lens board.mp4 --board charuco -o cam.toml --report lens
      aerodft calibrate-lens photos --board chessboard:9x6:25mm -o cam.toml --json
    """
    from aerodft.app.calibrate_lens import calibrate_lens as calibrate

    if print_board is not None:
        for what, value in (("images", sources), ("--output", output), ("--report", report)):
            if value:
                expected = "one of the two: first print, then calibrate"
                raise UsageError(f"{what} beside --print-board", expected=expected)
        _print_board(board, print_board, as_json=json)
        return
    if not sources:
        raise UsageError(
            "no images", expected="videos, images or folders of images", hint="see --print-board for a board"
        )
    check_output(output, sources)
    with progress("looking for the board") as advance:
        found = calibrate(sources, board, lens=lens, name=name or (output.stem if output else None), progress=advance)
    files: list[Path] = []
    if output is not None:
        found.save(output)
        files.append(output)
    if report is not None:
        files += found.write_report(report)
    if json:
        print_json(found.document([str(each) for each in files]))
    else:
        _print_lens(found, files)


def _print_board(board: str, path: Path, *, as_json: bool) -> None:
    from aerodft.app.calibrate_lens import print_board
    from calibration.lens import parse_board

    document = print_board(board, path)
    width_mm, height_mm = document["size_mm"]
    on_paper = f"print it at 100 %, {width_mm:g} x {height_mm:g} mm, on something flat"
    say(f"aerodft: wrote {path}: {parse_board(board)}; {on_paper}")
    if as_json:
        print_json(document)


def _print_lens(found: "LensCalibration", files: list[Path]) -> None:
    """A table on stdout, and what to know about the lens on stderr."""
    from rich.table import Table

    from aerodft.reports.lens import parameter_rows

    camera, solution = found.camera, found.solution
    title = (
        f"{camera.name}: {camera.width_px} x {camera.height_px} px, {camera.lens},"
        f" {len(solution.views)} views of {found.images} images, {solution.rms_px:.3f} px rms"
    )
    tables().print(title, soft_wrap=True)
    table = Table("parameter", "value", "std")
    for row in parameter_rows(camera):
        table.add_row(*row)
    tables().print(table)
    for sentence in [*found.notes, *(f"wrote {file}" for file in files)]:
        say(f"aerodft: {sentence}")
