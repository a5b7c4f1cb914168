"""Images of one camera out of files: stills, folders of stills, and videos, one after the other."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2

from aerodft.adapters.images.pixels import STILLS, read_still
from aerodft.adapters.images.video import VideoFileSource
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model import ImageArray

MOST_OF_A_VIDEO: Final = 300
"""Images that are taken of one video."""

_LEAST_STEP_NS = SECOND_NS // 10
_LOOKED_AT = 3  # images of each stretch of a video that are compared for sharpness
_COMPARED_PX = 480  # longer side of the picture that sharpness is compared in
_LINEAR = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedImage:
    """An image out of a file.

    Attributes:
        name: Its file's, with its folder where several are called the same, for images of a video followed by ``#`` and
            its number; no two are called the same.
        pixels: ``(h, w, 3)`` uint8 BGR, as stored.
        done: Share of all sources that has been read.
    """

    name: str
    pixels: ImageArray
    done: float


def named_images(paths: Sequence[Path]) -> Iterator[NamedImage]:
    """The images of files, a video's sampled: the sharpest of each short stretch.

    Args:
        paths: Stills, folders (their stills, not those of folders within), videos.

    Raises:
        InputError: A path is missing or unreadable, or a folder holds no stills; checked before the first image.
    """
    return _read(image_files(paths))


def image_files(paths: Sequence[Path]) -> list[Path]:
    """All stills and videos, each once, with folders' stills in place of folders.

    Raises:
        InputError: A path is missing, or a folder holds no stills.
    """
    return list(dict.fromkeys(item for path in paths for item in _files(path)))


def _files(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError("no such file", where=path, expected="images, folders of images, or videos")
    if not path.is_dir():
        return [path]
    found = sorted(each for each in path.iterdir() if each.suffix.lower() in STILLS and each.is_file())
    if not found:
        raise InputError("holds no stills", where=path, expected=f"files named {', '.join(STILLS)}")
    return found


def _read(files: list[Path]) -> Iterator[NamedImage]:
    called = Counter(path.name for path in files)
    for index, path in enumerate(files):
        name = path.name if called[path.name] == 1 else str(path)
        if path.suffix.lower() in STILLS:
            yield NamedImage(name=name, pixels=read_still(path), done=(index + 1) / len(files))
        else:
            for number, pixels, share in _of_video(path):
                yield NamedImage(name=f"{name}#{number}", pixels=pixels, done=(index + share) / len(files))


def _of_video(path: Path) -> Iterator[tuple[int, ImageArray, float]]:
    """Number, pixels and share of the video; of each stretch the sharpest image."""
    source = VideoFileSource(path, start_ns=0)
    length_ns = source.info.duration_ns or 0
    stretch_ns = max(_LEAST_STEP_NS, length_ns // MOST_OF_A_VIDEO)
    per_stretch = stretch_ns * (source.info.images or 0) / length_ns if length_ns else 0.0
    step = max(1, round(per_stretch / _LOOKED_AT))
    best: tuple[float, int, ImageArray] | None = None
    current = 0
    for image in source.events():
        if image.pixels is None or image.index % step:
            continue
        stretch = image.stamp_ns // stretch_ns
        if best is not None and stretch != current:
            yield best[1], best[2], min(image.stamp_ns / max(length_ns, 1), 1.0)
            best = None
        current = stretch
        pixels = image.pixels()
        sharpness = _sharpness(pixels)
        if best is None or sharpness > best[0]:
            best = (sharpness, image.index, pixels)
    if best is not None:
        yield best[1], best[2], 1.0


def _sharpness(pixels: ImageArray) -> float:
    """Sharpness: variance of the Laplacian; comparable among images of one scene only."""
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    scale = _COMPARED_PX / max(grey.shape)
    if scale < _LINEAR:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(grey, cv2.CV_64F).var())
