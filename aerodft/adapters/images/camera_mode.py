"""Whether images are of the mode that a camera file belongs to: size, zoom, crop."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Final

from PIL import Image as PillowImage

from aerodft.adapters.images import still_mode
from aerodft.errors import InputError
from aerodft.model import Camera, CameraMode

_SAME: Final = 0.015  # share by which lengths of one zoom may differ: EXIF rounds them
_FILM_DIAGONAL_MM: Final = 43.27
_ROUGHLY: Final = 1.4  # factor within which a focal length that was rounded to whole millimetres of film must be
_SAID: Final = {
    "device": "",
    "focal_mm": " mm focal length",
    "focal_35mm_mm": " mm focal length for 35 mm film",
    "digital_zoom": " times digital zoom",
}
_HINT: Final = "take the camera file of the mode that the image was taken in"


def check_mode(images: Iterable[Path], camera: Camera) -> tuple[str, ...]:
    """Refuse stills of another mode than the camera file's.

    Args:
        images: Stills; other files are passed over.
        camera: The camera, with its mode where its file has one.

    Returns:
        Sentences on what EXIF makes doubtful, but not certain.

    Raises:
        InputError: Another size, device, focal length or digital zoom.
    """
    return tuple(dict.fromkeys(sentence for image in images for sentence in _checked(image, camera)))


def common_mode(images: Iterable[Path]) -> CameraMode | None:
    """The mode of all stills, of what their EXIF data say; None where they say nothing.

    Raises:
        InputError: They are of several modes.
    """
    first: tuple[Path, CameraMode] | None = None
    for image in images:
        mode, _ = still_mode(image)
        if mode == CameraMode():
            continue
        if first is None:
            first = image, mode
        elif difference := _difference(mode, first[1]):
            got, expected = difference
            raise InputError(
                "the images are not of one camera mode",
                where=image,
                got=got,
                expected=f"{expected}, as {first[0].name} has",
                hint="a camera file belongs to one size, crop and zoom: calibrate each mode by itself",
            )
    return None if first is None else first[1]


def _checked(path: Path, camera: Camera) -> Iterator[str]:
    _check_size(path, camera)
    mode, taken_px = still_mode(path)
    if camera.mode is not None and (difference := _difference(mode, camera.mode)):
        got, expected = difference
        expected = f'{expected}, the mode of camera "{camera.name}"'
        raise InputError("the image is not of this camera's mode", where=path, got=got, expected=expected, hint=_HINT)
    if taken_px not in (None, (camera.width_px, camera.height_px), (camera.height_px, camera.width_px)):
        yield (
            f"{path.name} was taken with {taken_px[0]} x {taken_px[1]} px and made {camera.width_px} x"
            f" {camera.height_px} px afterwards: the camera file must be one of images that were treated likewise"
        )
    if camera.mode is None and mode.focal_35mm_mm is not None:
        zoom = mode.digital_zoom or 1.0
        focal_px = mode.focal_35mm_mm / _FILM_DIAGONAL_MM * math.hypot(camera.width_px, camera.height_px)
        if not 1 / _ROUGHLY < focal_px / camera.fx_px < _ROUGHLY:
            yield (
                f"{path.name} was taken with {mode.focal_35mm_mm:g} mm for 35 mm film (digital zoom {zoom:g}), about"
                f' {focal_px:.0f} px, and camera "{camera.name}" has {camera.fx_px:.0f} px: is it of another zoom?'
            )


def _check_size(path: Path, camera: Camera) -> None:
    try:
        with PillowImage.open(path) as image:
            size_px = image.size
    except (OSError, SyntaxError, ValueError, PillowImage.DecompressionBombError):
        return
    refuse_other_size(size_px, camera, path)


def refuse_other_size(size_px: tuple[int, int], camera: Camera, where: object) -> None:
    """Refuse an image of another size than the camera's.

    Raises:
        InputError: It has one.
    """
    if size_px != (camera.width_px, camera.height_px):
        raise InputError(
            "the image is not of this camera's mode",
            where=where,
            got=f"{size_px[0]} x {size_px[1]} px",
            expected=f'{camera.width_px} x {camera.height_px} px, the size of camera "{camera.name}"',
            hint=_HINT,
        )


def _difference(mode: CameraMode, other: CameraMode) -> tuple[str, str] | None:
    """What the first has and what the other has, where both say it and differ."""
    others = asdict(other)
    for key, value in asdict(mode).items():
        expected = others[key]
        if value is None or expected is None:
            continue
        if isinstance(value, str):
            is_same = value.casefold() == str(expected).casefold()
        else:
            is_same = abs(value - expected) <= _SAME * expected
        if not is_same:
            return tuple(  # type: ignore[return-value]  # two of them
                f"{each}{_SAID[key]}" if isinstance(each, str) else f"{each:g}{_SAID[key]}"
                for each in (value, expected)
            )
    return None
