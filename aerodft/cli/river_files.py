"""The folder that ``aerodft river`` writes: its document, a table, maps and a plate."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import orjson

from aerodft.cli.output import say
from aerodft.cli.river_map import RiverMap, map_of_still
from aerodft.cli.river_plate import draw_plate
from aerodft.cli.river_table import table
from aerodft.dft.request import Setup
from aerodft.errors import InputError
from aerodft.model.arrays import ImageArray
from aerodft.model.pose import PoseSample
from aerodft.vision.river import River, ground_of
from aerodft.vision.water_features import water_likeness
from aerodft.vision.water_plane import WaterPlane


def write_river(
    folder: Path, document: dict[str, Any], found: River, image: ImageArray, setup: Setup, sample: PoseSample
) -> None:
    """Write result.json, transects.csv, a map, plate.png and likeness.png; enters their names into the document.

    Raises:
        InputError: The folder cannot be written.
    """
    with writing_river(folder, document, map_of_still(document, found, setup, sample), ("likeness.png",)):
        draw_plate(folder / "plate.png", document, found, image, setup, sample)
        (folder / "likeness.png").write_bytes(_likeness(found, setup, sample, image.shape[:2]))


@contextmanager
def writing_river(
    folder: Path, document: dict[str, Any], drawn: RiverMap, more: tuple[str, ...] = ()
) -> Iterator[None]:
    """A folder with what every river has but for its plate, which is to be drawn, and what ``more`` names.

    Raises:
        InputError: It cannot be written.
    """
    names = ("result.json", "transects.csv", drawn.name, "plate.png", *more)
    document["files"] = [str(folder / name) for name in names]
    with _writing(folder):
        (folder / "result.json").write_bytes(_as_json(document))
        (folder / "transects.csv").write_text(table(document), encoding="utf-8")
        (folder / drawn.name).write_bytes(_as_json(drawn.document))
        yield
    if drawn.note:
        say(f"aerodft: {drawn.note}")


def check_folder(folder: Path | None) -> None:
    """Refuse a folder that cannot be written to before the work is done for nothing; makes none.

    Raises:
        InputError: It is a file, lies below one, or nobody may write there.
    """
    if folder is None:
        return
    with _said(folder):
        there = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
        if not there.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        if not os.access(there, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """A folder, made, to be written to.

    Raises:
        InputError: It cannot be.
    """
    with _said(folder):
        folder.mkdir(parents=True, exist_ok=True)
        yield


@contextmanager
def _said(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            "the river cannot be written", where=folder, got=error.strerror or error, expected="a folder to write to"
        ) from error


def _as_json(document: dict[str, Any]) -> bytes:
    """A file's bytes."""
    return orjson.dumps(document, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)


def _likeness(found: River, setup: Setup, sample: PoseSample, size: tuple[int, ...]) -> bytes:
    """Grey of the image's size: white where a pixel looks like the water, black where it looks like land."""
    assert sample.pose is not None  # noqa: S101 - what was measured has a pose, for the type checker
    plane = WaterPlane(setup.camera, sample.pose, setup.elevation_m, setup.max_range_m)
    share = water_likeness(found.features.planes, found.water.water, ground_of(plane, found.features))
    grey = cv2.resize(np.rint(255 * share).astype(np.uint8), size[::-1], interpolation=cv2.INTER_NEAREST)
    return bytes(cv2.imencode(".png", grey)[1])
