"""``aerodft calibrate-lens``: images of a board in, a camera file with its covariance out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from aerodft.cli.options import JsonOption
from aerodft.cli.output import check_output, print_json, progress, say, tables
from aerodft.errors import UsageError

if TYPE_CHECKING:
    from aerodft.app.calibrate_lens import LensCalibration


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
        _print(found, files)


def _print_board(board: str, path: Path, *, as_json: bool) -> None:
    from aerodft.app.calibrate_lens import print_board
    from calibration.lens import parse_board

    document = print_board(board, path)
    width_mm, height_mm = document["size_mm"]
    on_paper = f"print it at 100 %, {width_mm:g} x {height_mm:g} mm, on something flat"
    say(f"aerodft: wrote {path}: {parse_board(board)}; {on_paper}")
    if as_json:
        print_json(document)


def _print(found: "LensCalibration", files: list[Path]) -> None:
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
