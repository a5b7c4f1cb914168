"""``aerodft calibrate-lens``: images of a board in, a camera file with its covariance out."""

from pathlib import Path
from typing import Annotated

import typer

from aerodft.app.calibrate_lens import describe_lens, print_board_picture, run_lens, say_lens, write_camera_file
from aerodft.cli.output import check_output, print_json
from aerodft.errors import UsageError
from calibration.lens import DEFAULT_CHARUCO, LensChoice, parse_board


def calibrate_lens(
    sources: Annotated[
        list[Path] | None, typer.Argument(metavar="VIDEO|IMAGES...", help="Videos, images, folders of images.")
    ] = None,
    board: Annotated[
        str,
        typer.Option(
            help="chessboard:COLSxROWS:SQUARE, inner corners, e.g. chessboard:9x6:25mm;"
            f" or charuco:COLSxROWS:SQUARE:MARKER:DICT, squares; charuco alone is {DEFAULT_CHARUCO}."
        ),
    ] = "charuco",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Camera file to write (TOML).")] = None,
    name: Annotated[str | None, typer.Option(help="Of the camera, for its file; else the output's name.")] = None,
    lens: Annotated[LensChoice, typer.Option(help="What describes the lens.")] = LensChoice.BROWN,
    report: Annotated[Path | None, typer.Option(help="Folder for a page with coverage and residuals.")] = None,
    print_board: Annotated[
        Path | None, typer.Option(help="Instead of calibrating: write the board as a PNG to print in true size.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    r"""Calibrate a lens from images of a flat board, with the covariance of everything that is found.

    A camera file belongs to one mode of a camera: size, crop, zoom, focus and stabilisation as they are in flight.

    \b
    Example:
      aerodft calibrate-lens --board charuco --print-board board.png
      aerodft calibrate-lens board.mp4 --board charuco -o cam.toml --report lens
      aerodft calibrate-lens photos --board chessboard:9x6:25mm -o cam.toml --json
    """
    wanted = parse_board(board)
    if print_board is not None:
        _refuse_beside_print_board(sources, output, report)
        document = print_board_picture(wanted, print_board)
        if json:
            print_json(document)
        return
    if not sources:
        raise UsageError(
            "no images", expected="videos, images or folders of images", hint="see --print-board for a board"
        )
    check_output(output, sources)
    camera_name = name or (output.stem if output else f"camera of {sources[0].stem}")
    run = run_lens(sources, wanted, lens, camera_name)
    files = []
    if output is not None:
        write_camera_file(run, output)
        files.append(str(output))
    if report is not None:
        from aerodft.reports.lens import write_lens_report

        files += write_lens_report(run, report)
    if json:
        print_json(describe_lens(run, files))
    else:
        say_lens(run, files)


def _refuse_beside_print_board(sources: list[Path] | None, output: Path | None, report: Path | None) -> None:
    for what, given in (("images", sources), ("--output", output), ("--report", report)):
        if given:
            raise UsageError(f"{what} beside --print-board", expected="one of the two: first print, then calibrate")
