"""From images of a board to a lens: what ``aerodft calibrate-lens`` looks at, in order, and what it says and writes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import tomli_w
from PIL import Image as PillowImage
from rich.table import Table

from aerodft.adapters.atomic_file import write_whole
from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.images import Gathered, gather, image_files
from aerodft.adapters.images.camera_mode import common_mode
from aerodft.cli.output import progress_bar, say, tables
from aerodft.errors import InputError, NoAnswerError
from aerodft.model import Camera, LensModel
from aerodft.version import SOFTWARE
from calibration.lens import (
    Board,
    BoardFinder,
    Choice,
    LensChoice,
    LensSolution,
    View,
    choose,
    draw_board,
    intrinsics_of,
    missing,
    solve_lens,
    suggestion,
)

_PROGRESS = 1000  # parts of the whole
_ASKED_AGAIN = 5  # images in which another board is looked for, where this one is in none

_INCH_M = 0.0254
_PRINT_PX_PER_M = 12_000  # 305 dots per inch: whole pixels in every whole millimetre
_MARGIN_M = 0.01
_CAPTION_PX = 40
_BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_FISHEYE = ("k1", "k2", "k3", "k4")
_ALL_DECIMALS = 6
_KEPT_NAMES: Final = 5  # of left-out images that a sentence names


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


def parameter_names(camera: Camera) -> tuple[str, ...]:
    """fx, fy, cx, cy and the coefficients, as the camera file orders them."""
    names = _FISHEYE if camera.lens is LensModel.FISHEYE else _BROWN
    return ("fx_px", "fy_px", "cx_px", "cy_px", *names[: len(camera.distortion)])


def parameter_rows(camera: Camera) -> list[tuple[str, str, str]]:
    """Name, value and std of every intrinsic of a camera with a covariance, with as many digits as are known."""
    values = intrinsics_of(camera).tolist()
    stds = np.sqrt(np.diag(np.array(camera.covariance))).tolist()
    rows = []
    for name, value, std in zip(parameter_names(camera), values, stds, strict=True):
        decimals = max(0, 1 - math.floor(math.log10(std))) if std > 0 else _ALL_DECIMALS
        rows.append((name, f"{value:.{decimals}f}", f"{std:.{decimals}f}"))
    return rows


def describe_lens(run: LensRun, files: list[str]) -> dict[str, Any]:
    """The result as a document.

    Args:
        run: The calibration.
        files: What was written.
    """
    solution, choice = run.solution, run.choice
    stds = np.sqrt(np.diag(np.array(solution.camera.covariance)))
    names = parameter_names(solution.camera)
    return {
        "schema": "aerodft.lens/1",
        "status": "ok",
        "camera": camera_document(solution.camera),
        "std": dict(zip(names, stds.tolist(), strict=True)),
        "board": run.board.text,
        "lens": run.lens,
        "images": run.images,
        "with_board": sum(map(len, (choice.used, choice.blurred, choice.duplicates, choice.surplus))),
        "views": [
            {"name": view.name, "corners": len(view.ids), "rms_px": rms, "edge_px": view.edge_px}
            for view, rms in zip(solution.views, solution.view_rms_px.tolist(), strict=True)
        ],
        "dropped": {
            "blurred": [view.name for view in choice.blurred],
            "near_duplicate": [view.name for view in choice.duplicates],
            "surplus": [view.name for view in choice.surplus],
            "corners": solution.strays,
            "outlying": [{"name": view.name, "rms_px": rms} for view, rms in solution.left_out],
        },
        "corners": len(solution.off_px),
        "rms_px": solution.rms_px,
        "corner_std_px": solution.std_px,
        "bic_gain": solution.bic_gain,
        "missing": list(missing(solution)),
        "notes": notes(run),
        "files": files,
        "software": SOFTWARE,
    }


def notes(run: LensRun) -> list[str]:
    """What was decided on the way, in sentences."""
    solution, choice, said = run.solution, run.choice, []
    for views, why in (
        (choice.blurred, "blurred"),
        (choice.duplicates, "nearly the same as a sharper one"),
        (choice.surplus, "nothing that others do not show"),
    ):
        if views:
            said.append(f"{len(views)} dropped, {why}: {_names([view.name for view in views])}")
    said += [f"{view.name} disagrees with all others by {rms:.2f} px rms, left out" for view, rms in solution.left_out]
    if solution.strays:
        count, where = sum(solution.strays.values()), _names(list(solution.strays))
        said.append(f"{count} corner{'' if count == 1 else 's'} far off all others left out, in {where}")
    gain = solution.bic_gain
    if run.lens is LensChoice.BROWN and gain is not None:
        verb = "kept" if gain > 0 else "left out"
        said.append(f"k3 {verb}: with it the Bayesian information criterion changes by {-gain:+.1f}")
    if run.lens is LensChoice.RATIONAL and gain is not None and gain <= 0:
        said.append("brown describes this lens as well, with fewer coefficients, which are better known: --lens brown")
    return said


def _names(names: list[str]) -> str:
    more = f" and {len(names) - _KEPT_NAMES} more" if len(names) > _KEPT_NAMES else ""
    return ", ".join(names[:_KEPT_NAMES]) + more


def write_camera_file(run: LensRun, path: Path) -> None:
    """Write the camera file, with where it comes from in comments.

    Raises:
        InputError: It cannot be written.
    """
    text = camera_text(run, datetime.now(UTC))
    try:
        write_whole(path, text.encode())
    except OSError as error:
        raise InputError("the camera file cannot be written", where=path, got=error.strerror) from error


def camera_text(run: LensRun, now: datetime) -> str:
    """The camera file's text.

    Args:
        run: The calibration.
        now: UTC.
    """
    solution, (width, height) = run.solution, run.size_px
    order = ", ".join(parameter_names(solution.camera))
    said = [
        f"Lens calibration by {SOFTWARE}, {now:%Y-%m-%d %H:%M} UTC, from {run.board}.",
        f"{len(solution.views)} views of {run.images} images, {solution.rms_px:.3f} px rms.",
        f"It belongs to one mode of the camera: images of {width} x {height} px, as stored, with the crop, zoom, focus",
        "and stabilisation that the calibration's images had. Another mode is another camera file.",
        *missing(solution),
        f"covariance: of {order}, in rows.",
    ]
    head = "".join(f"# {_one_line(line)}\n" for line in said)
    keys = camera_document(solution.camera)
    rows = "".join(f"    [{', '.join(map(repr, row))}],\n" for row in keys.pop("covariance"))
    distortion = ", ".join(map(repr, keys.pop("distortion")))
    mode = f"\n{tomli_w.dumps({'mode': keys.pop('mode')})}" if "mode" in keys else ""
    return f"{head}{tomli_w.dumps(keys)}distortion = [{distortion}]\ncovariance = [\n{rows}]\n{mode}"


def _one_line(text: str) -> str:
    return "".join(each if each.isprintable() else " " for each in text)


def say_lens(run: LensRun, files: list[str]) -> None:
    """The result for a person: a table on stdout, what to know about it on stderr."""
    camera, solution = run.solution.camera, run.solution
    title = (
        f"{camera.name}: {camera.width_px} x {camera.height_px} px, {camera.lens},"
        f" {len(solution.views)} views of {run.images} images, {solution.rms_px:.3f} px rms"
    )
    tables().print(title, soft_wrap=True)
    table = Table("parameter", "value", "std")
    for row in parameter_rows(camera):
        table.add_row(*row)
    tables().print(table)
    for sentence in [*notes(run), *missing(solution)]:
        say(f"aerodft: {sentence}")
    for file in files:
        say(f"aerodft: wrote {file}")


def print_board_picture(board: Board, path: Path) -> dict[str, Any]:
    """Write a PNG of the board that prints in true size, with its name below.

    Raises:
        InputError: It cannot be written.
    """
    picture = np.pad(draw_board(board, _PRINT_PX_PER_M, _MARGIN_M), ((0, 2 * _CAPTION_PX), (0, 0)), constant_values=255)
    caption = f"{board.text} - print at 100 %, then measure a square: {board.square_m * 1e3:g} mm"
    place = (round(_MARGIN_M * _PRINT_PX_PER_M), picture.shape[0] - _CAPTION_PX)
    cv2.putText(picture, caption, place, cv2.FONT_HERSHEY_SIMPLEX, 1.2, (90,), 2, cv2.LINE_AA)
    dots = _PRINT_PX_PER_M * _INCH_M
    try:
        PillowImage.fromarray(picture).save(path, format="PNG", dpi=(dots, dots))
    except OSError as error:
        raise InputError("the board cannot be written", where=path, got=error.strerror) from error
    size_mm = [round(side / _PRINT_PX_PER_M * 1e3, 1) for side in picture.shape[::-1]]
    say(f"aerodft: wrote {path}: {board}; print it at 100 %, {size_mm[0]:g} x {size_mm[1]:g} mm, on something flat")
    return {"schema": "aerodft.board/1", "board": board.text, "size_mm": size_mm, "file": str(path)}
