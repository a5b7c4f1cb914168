"""A lens from images of a board, as a camera file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli_w
from PIL import Image as PillowImage

from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.files import check_ending, write_whole
from aerodft.adapters.images import NamedImage, common_mode, image_files, named_images
from aerodft.app import Progress, no_progress
from aerodft.errors import InputError, NoAnswerError, counted, os_errors_as
from aerodft.model import Camera
from aerodft.reports.lens import lens_document, lens_notes, parameter_names, write_lens_page
from aerodft.version import SOFTWARE
from calibration.lens import (
    Board,
    BoardFinder,
    BoardView,
    LensChoice,
    LensFit,
    choose,
    draw_board,
    missing,
    parse_board,
    solve_lens,
    suggestion,
)

_PROGRESS = 1000  # parts of the whole
_MAX_SEARCHED = 5  # images in which another board is looked for, where this one is in none

_INCH_M = 0.0254
_PRINT_PX_PER_M = 12_000  # 305 dots per inch: whole pixels in every whole millimetre
_MARGIN_M = 0.01
_CAPTION_PX = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class LensCalibration(LensFit):
    """Result of a lens calibration."""

    @property
    def camera(self) -> Camera:
        """The camera with its lens, and the covariance of its intrinsics."""
        return self.solution.camera

    @property
    def notes(self) -> list[str]:
        """Sentences on decisions of the calibration, and on what would make it better."""
        return [*lens_notes(self), *missing(self.solution)]

    def document(self, files: Sequence[str] = ()) -> dict[str, Any]:
        """Everything as ``aerodft calibrate-lens --json`` prints it, with the files that were written."""
        return lens_document(self, files)

    def save(self, path: Path | str) -> None:
        """Write the camera file, with where it comes from in comments.

        Args:
            path: The TOML file; one that is there is replaced.

        Raises:
            InputError: It cannot be written.
        """
        with os_errors_as("the camera file cannot be written", where=path):
            write_whole(Path(path), self._text().encode())

    def write_report(self, folder: Path | str) -> list[Path]:
        """Write a page with its figures.

        Args:
            folder: The folder, made where it is not there.

        Returns:
            The page, ``report.html``, and its figures.

        Raises:
            InputError: The folder cannot be written to.
        """
        return write_lens_page(self, Path(folder))

    def _text(self) -> str:
        solution, size = self.solution, " x ".join(map(str, self.size_px))
        lines = [
            f"Lens calibration by {SOFTWARE}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC, from {self.board}.",
            f"{len(solution.views)} views of {self.images} images, {solution.rms_px:.3f} px rms.",
            f"It belongs to one mode of the camera: images of {size} px, as stored, with the crop, zoom, focus",
            "and stabilisation that the calibration's images had. Another mode is another camera file.",
            *missing(solution),
            f"covariance: of {', '.join(parameter_names(solution.camera))}, in rows.",
        ]
        head = "".join(f"# {''.join(each if each.isprintable() else ' ' for each in line)}\n" for line in lines)
        keys = camera_document(solution.camera)
        rows = "".join(f"    [{', '.join(map(repr, row))}],\n" for row in keys.pop("covariance"))
        distortion = ", ".join(map(repr, keys.pop("distortion")))
        mode = f"\n{tomli_w.dumps({'mode': keys.pop('mode')})}" if "mode" in keys else ""
        return f"{head}{tomli_w.dumps(keys)}distortion = [{distortion}]\ncovariance = [\n{rows}]\n{mode}"


def calibrate_lens(
    sources: Sequence[Path | str],
    board: str = "charuco",
    *,
    lens: LensChoice | str = LensChoice.BROWN,
    name: str | None = None,
    progress: Progress = no_progress,
) -> LensCalibration:
    """Calibrate a lens from images of a flat board, with the covariance of everything that is found.

    Args:
        sources: Videos, images, folders of images.
        board: ``chessboard:COLSxROWS:SQUARE`` (inner corners, such as ``chessboard:9x6:25mm``),
            ``charuco:COLSxROWS:SQUARE:MARKER:DICT`` (squares), or ``charuco`` alone.
        lens: What describes the lens: brown, rational or fisheye.
        name: The camera's; else after the first source.
        progress: Called with how many thousandths of the images are done, and 1000.

    Returns:
        The lens; ``save`` writes its camera file.

    Raises:
        UsageError: The board is none.
        InputError: A source cannot be read, images differ in size or mode, or none shows the board.
        NoAnswerError: Views are too few or too similar.

    Examples:
        >>> import aerodft as ad
        >>> ad.print_board("charuco", "board.png")["size_mm"]
        [270.0, 201.7]
        >>> ad.calibrate_lens(["board.png"])  # doctest: +IGNORE_EXCEPTION_DETAIL
        Traceback (most recent call last):
        aerodft.errors.NoAnswerError: too few views to determine the lens
    """
    paths, parsed, lens_choice = [Path(each) for each in sources], parse_board(board), LensChoice(lens)
    mode = common_mode(image_files(paths))
    images, size_px, views = _look(paths, parsed, progress)
    choice = choose(views, size_px)
    camera_name = name or f"camera of {paths[0].stem}"
    try:
        solution = solve_lens(choice.used, size_px, lens_choice, name=camera_name)
    except NoAnswerError as error:
        seen = f"{images} image{'' if images == 1 else 's'}, {len(views)} with the board"
        if dropped := len(views) - len(choice.used):
            seen += f", {dropped} of these blurred or nearly the same as others"
        raise NoAnswerError(error.what, where=seen, got=error.got, expected=error.expected, hint=error.hint) from None
    solution = replace(solution, camera=replace(solution.camera, mode=mode))
    return LensCalibration(
        board=parsed, lens=lens_choice, size_px=size_px, images=images, choice=choice, solution=solution
    )


def _look(paths: Sequence[Path], board: Board, progress: Progress) -> tuple[int, tuple[int, int], list[BoardView]]:
    """Number and size of the images, and the board's corners in those that show it."""
    finder, views = BoardFinder(board), []
    first: NamedImage | None = None
    count = 0
    for image in named_images(paths):
        first = first or image
        _check_size(image, first)
        count += 1
        view = finder.find(image.pixels, image.name)
        if view is not None:
            views.append(view)
        progress(round(_PROGRESS * image.done), _PROGRESS)
    if first is None:
        raise InputError("no image could be read", where=paths[0], expected="videos, images or folders of images")
    if not views:
        raise _no_board(paths, board, count)
    height, width = first.pixels.shape[:2]
    return count, (width, height), views


def _check_size(image: NamedImage, first: NamedImage) -> None:
    (height, width), (rows, columns) = image.pixels.shape[:2], first.pixels.shape[:2]
    if (width, height) != (columns, rows):
        raise InputError(
            "the images are not of one camera mode",
            where=image.name,
            got=f"{width} x {height} px",
            expected=f"{columns} x {rows} px, as {first.name} has",
            hint="a camera file belongs to one size, crop and zoom: calibrate each mode by itself",
        )


def _no_board(paths: Sequence[Path], board: Board, count: int) -> InputError:
    hint = ""
    for index, image in enumerate(named_images(paths)):
        if index == _MAX_SEARCHED or hint:
            break
        hint = suggestion(image.pixels, board)
    where = paths[0] if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"
    got = f"{counted(count, 'image')} without it"
    general = "is it whole in the image, flat, evenly lit, with a white margin, and are its counts right?"
    return InputError("no board found", where=where, got=got, expected=str(board), hint=hint or general)


def print_board(board: str, path: Path | str) -> dict[str, Any]:
    """Write a PNG of a board that prints in true size, with its name below.

    Args:
        board: As ``calibrate_lens`` takes it.
        path: The file.

    Returns:
        The document that ``aerodft calibrate-lens --print-board --json`` prints: ``board`` by its full name, its
        ``size_mm`` on paper, and the ``file``.

    Raises:
        UsageError: The board is none, or the file's ending says another format.
        InputError: The file cannot be written.

    Examples:
        >>> import aerodft as ad
        >>> ad.print_board("chessboard:9x6:25mm", "board.png")["size_mm"]
        [270.0, 201.7]
    """
    check_ending(Path(path), ".png")
    parsed = parse_board(board)
    picture = np.pad(
        draw_board(parsed, _PRINT_PX_PER_M, _MARGIN_M), ((0, 2 * _CAPTION_PX), (0, 0)), constant_values=255
    )
    caption = f"{parsed.text} - print at 100 %, then measure a square: {parsed.square_m * 1e3:g} mm"
    place = (round(_MARGIN_M * _PRINT_PX_PER_M), picture.shape[0] - _CAPTION_PX)
    cv2.putText(picture, caption, place, cv2.FONT_HERSHEY_SIMPLEX, 1.2, (90,), 2, cv2.LINE_AA)
    dots = _PRINT_PX_PER_M * _INCH_M
    with os_errors_as("the board cannot be written", where=path):
        PillowImage.fromarray(picture).save(path, format="PNG", dpi=(dots, dots))
    size_mm = [round(side / _PRINT_PX_PER_M * 1e3, 1) for side in picture.shape[::-1]]
    return {"schema": "aerodft.board/1", "board": parsed.text, "size_mm": size_mm, "file": str(path)}
