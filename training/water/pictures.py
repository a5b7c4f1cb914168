"""Labelled photographs, divided once and for all into those that are trained on and those that are judged by."""

import json
import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
SETS = ("riverdataset", "floods")
LONGER_SIDE_PX = 768
HELD_BACK = 8
"""One picture of so many is judged by, chosen by its name; near duplicates go together."""


@dataclass(frozen=True, slots=True, eq=False)
class Labelled:
    """A picture with its water.

    Attributes:
        name: Set and file.
        pixels: ``(height, width, 3)`` BGR, its longer side 768 px.
        water: ``(height, width)`` 255 where there is water, else 0.
        is_exact: Whether its outline was drawn with care, to a few pixels.
        is_from_air: Whether it shows a river or channel from the air.
    """

    name: str
    pixels: Bytes
    water: Bytes
    is_exact: bool
    is_from_air: bool = False


def read_pictures(folder: Path) -> tuple[list[Labelled], list[Labelled]]:
    """The pictures to train on, and those to judge by.

    Args:
        folder: Has a folder for each of ``SETS``, with ``images`` and ``masks`` of the same names, and
            ``near_duplicate_groups.json``: lists of pictures that show the same, and
            ``floodarea_rivers_from_air.txt``: names of flood photographs where a river is seen from the air.
    """
    groups = json.loads((folder / "near_duplicate_groups.json").read_text())
    first_of = {_key(each): _key(group[0]) for group in groups for each in group}
    from_air = set((folder / "floodarea_rivers_from_air.txt").read_text().split())
    parts: tuple[list[Labelled], list[Labelled]] = [], []
    for kind in SETS:
        for path in sorted((folder / kind / "images").iterdir()):
            picture = _read(path, kind, is_from_air=kind == "floods" and path.stem in from_air)
            chosen = zlib.crc32(first_of.get(picture.name, picture.name).encode()) % HELD_BACK == 0
            parts[chosen].append(picture)
    return parts


def _key(path: str) -> str:
    """``set/name`` of a path in the list of duplicates."""
    folder, name = path.split("/", maxsplit=1)[0], Path(path).stem
    return f"{'floods' if 'flood' in folder else 'riverdataset'}/{name}"


def _read(path: Path, kind: str, *, is_from_air: bool) -> Labelled:
    pixels = cv2.imread(str(path))
    water = cv2.imread(str(path.parent.parent / "masks" / f"{path.stem}.png"), cv2.IMREAD_GRAYSCALE)
    scale = LONGER_SIDE_PX / max(water.shape)
    size = round(water.shape[1] * scale), round(water.shape[0] * scale)
    smaller = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    wet = cv2.resize(np.where(water > 127, 255, 0).astype(np.uint8), size, interpolation=cv2.INTER_LINEAR)
    return Labelled(
        f"{kind}/{path.stem}", cv2.resize(pixels, size, interpolation=smaller), wet,
        is_exact=kind == "riverdataset", is_from_air=is_from_air,
    )  # fmt: skip
