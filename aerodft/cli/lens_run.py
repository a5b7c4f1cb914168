"""From images of a board to a lens: what ``aerodft calibrate-lens`` looks at, in order."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from aerodft.adapters.images.gathering import Gathered, gather, image_files
from aerodft.cli.camera_mode import common_mode
from aerodft.cli.output import progress_bar
from aerodft.errors import InputError, NoAnswerError
from calibration.lens.adjustment import View
from calibration.lens.board import Board
from calibration.lens.coverage import Choice, choose
from calibration.lens.detection import BoardFinder, suggestion
from calibration.lens.solution import LensChoice, LensSolution, solve_lens

_PROGRESS = 1000  # parts of the whole
_ASKED_AGAIN = 5  # images in which another board is looked for, where this one is in none


@dataclass(frozen=True, slots=True, kw_only=True)
class LensRun:
    """One lens calibration, from its images to its answer.

    Attributes:
        board: The board.
        lens: What the lens was to be described by.
        size_px: Width and height of all images.
        images: How many were looked at.
        choice: Which of those that show the board were used.
        solution: The lens.
    """

    board: Board
    lens: LensChoice
    size_px: tuple[int, int]
    images: int
    choice: Choice
    solution: LensSolution


def run_lens(sources: Sequence[Path], board: Board, lens: LensChoice, name: str) -> LensRun:
    """Find the board in all images, choose views, and solve.

    Args:
        sources: Videos, images, folders of images.
        board: What to look for.
        lens: What to describe the lens by.
        name: The camera's.

    Raises:
        InputError: A source cannot be read, images differ in size or mode, or none shows the board.
        NoAnswerError: Views are too few or too similar.
    """
    mode = common_mode(image_files(sources))
    images, size_px, views = _look(sources, board)
    choice = choose(views, size_px)
    try:
        solution = solve_lens(choice.used, size_px, lens, name=name)
    except NoAnswerError as error:
        seen = f"{images} image{'' if images == 1 else 's'}, {len(views)} with the board"
        if dropped := len(views) - len(choice.used):
            seen += f", {dropped} of these blurred or nearly the same as others"
        raise NoAnswerError(error.what, where=seen, got=error.got, expected=error.expected, hint=error.hint) from None
    solution = replace(solution, camera=replace(solution.camera, mode=mode))
    return LensRun(board=board, lens=lens, size_px=size_px, images=images, choice=choice, solution=solution)


def _look(sources: Sequence[Path], board: Board) -> tuple[int, tuple[int, int], list[View]]:
    """How many images there are, their size, and what those that show the board show of it."""
    finder, views = BoardFinder(board), []
    first: Gathered | None = None
    count = 0
    with progress_bar("looking for the board", 0, _PROGRESS) as advance:
        for image in gather(sources):
            first = first or image
            _check_size(image, first)
            count += 1
            view = finder.find(image.pixels, image.name)
            if view is not None:
                views.append(view)
            advance(round(_PROGRESS * image.done))
    if first is None:
        raise InputError("no image could be read", where=sources[0], expected="videos, images or folders of images")
    if not views:
        raise _no_board(sources, board, count)
    height, width = first.pixels.shape[:2]
    return count, (width, height), views


def _check_size(image: Gathered, first: Gathered) -> None:
    (height, width), (rows, columns) = image.pixels.shape[:2], first.pixels.shape[:2]
    if (width, height) != (columns, rows):
        raise InputError(
            "the images are not of one camera mode",
            where=image.name,
            got=f"{width} x {height} px",
            expected=f"{columns} x {rows} px, as {first.name} has",
            hint="a camera file belongs to one size, crop and zoom: calibrate each mode by itself",
        )


def _no_board(sources: Sequence[Path], board: Board, count: int) -> InputError:
    hint = ""
    for index, image in enumerate(gather(sources)):
        if index == _ASKED_AGAIN or hint:
            break
        hint = suggestion(image.pixels, board)
    where = sources[0] if len(sources) == 1 else f"{sources[0]} and {len(sources) - 1} more"
    got = f"{count} image{'' if count == 1 else 's'} without it"
    general = "is it whole in the image, flat, evenly lit, with a white margin, and are its counts right?"
    return InputError("no board found", where=where, got=got, expected=str(board), hint=hint or general)
