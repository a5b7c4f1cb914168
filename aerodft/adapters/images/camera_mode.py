"""Whether images are of the mode that a camera file belongs to: size, zoom, crop."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Final

from aerodft.adapters.images.stills import facts_of_still, still_facts
from aerodft.errors import InputError
from aerodft.model import Camera, CameraMode, CameraStd

_ROUNDING: Final = 0.015  # share by which lengths of one zoom may differ: EXIF rounds them
_FILM_DIAGONAL_MM: Final = 43.27
_FILM_ROUNDING: Final = 1.4  # factor within which a focal length is that was rounded to whole millimetres of film
_FILM_STEP_STD_MM: Final = 0.29  # of lengths that are whole millimetres
_SENSORS: Final = (4 / 3, 3 / 2)  # width by height of what images are cropped from, the usual one first
_SAME_ASPECT: Final = 1.02
_OFF_CENTRE: Final = 0.005  # std of the principal point, as a share of the diagonal
_WITHIN_STDS: Final = 1.96  # that everything which may be true lies in
_UNITS: Final = {
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
    return tuple(dict.fromkeys(sentence for image in images for sentence in _doubts(image, camera)))


def common_mode(images: Iterable[Path]) -> CameraMode | None:
    """The mode of all stills by their EXIF data; None where these say nothing.

    Raises:
        InputError: They are of several modes.
    """
    first: tuple[Path, CameraMode] | None = None
    for image in images:
        facts = still_facts(image)
        mode = CameraMode() if facts is None else facts.mode
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


def camera_of_still(path: Path) -> Camera:
    """The camera that a still's EXIF data tell of: a focal length, and its principal point in the middle.

    The focal length for 35 mm film is by the diagonal of the sensor (CIPA DCG-001). An image of another aspect than 4:3
    or 3:2 is a crop of a 4:3 sensor, as wide as it; the std holds crops of the other sensors, digital zoom that the
    equivalent may or may not have in it, and its rounding to whole millimetres. Of the lens's distortion nothing is
    known: it is 0.

    Raises:
        InputError: No still, no equivalent in its EXIF data, or an image that was cropped after it was taken.
    """
    facts = facts_of_still(path)
    (width_px, height_px), mode, taken_px = facts.size_px, facts.mode, facts.taken_px
    if mode.focal_35mm_mm is None:
        raise InputError(
            "no camera can be told from it",
            where=path,
            got="no focal length for 35 mm film in its EXIF data",
            expected="FocalLengthIn35mmFilm",
            hint="write a camera file with its field of view, or calibrate the lens",
        )
    aspect = max(width_px, height_px) / min(width_px, height_px)
    if taken_px is not None and not _is_about(max(taken_px) / min(taken_px), aspect):
        got = f"{width_px} x {height_px} px, taken with {taken_px[0]} x {taken_px[1]} px"
        raise InputError("the image was cropped after it was taken", where=path, got=got, expected="all of it")
    shares = [_sensor_diagonal(aspect, sensor) for sensor in (*_SENSORS, aspect)]
    likely = next((1.0 for sensor in _SENSORS if _is_about(sensor, aspect)), shares[0])
    zoom = mode.digital_zoom or 1.0
    shares += [zoom * share for share in shares]
    crop_std = max(abs(share - likely) for share in shares) / _WITHIN_STDS / likely
    diagonal_px = math.hypot(width_px, height_px)
    focal_px = mode.focal_35mm_mm / _FILM_DIAGONAL_MM * diagonal_px * likely
    return Camera.of_focal(
        name=mode.device or path.stem,
        width_px=width_px,
        height_px=height_px,
        focal_px=focal_px,
        std=CameraStd(
            focal_px=focal_px * math.hypot(crop_std, _FILM_STEP_STD_MM / mode.focal_35mm_mm),
            principal_point_px=_OFF_CENTRE * diagonal_px,
        ),
        mode=mode,
    )


def _is_about(one: float, other: float) -> bool:
    return 1 / _SAME_ASPECT < one / other < _SAME_ASPECT


def _sensor_diagonal(aspect: float, sensor: float) -> float:
    """Diagonal of a sensor whose largest crop is an image, both by width over height, in the image's diagonals."""
    width, height = max(1.0, sensor / aspect), max(1 / aspect, 1 / sensor)
    return math.hypot(width, height) / math.hypot(1.0, 1 / aspect)


def refuse_other_size(size_px: tuple[int, int], camera: Camera, where: object) -> None:
    """Refuse an image of another size than the camera's.

    Raises:
        InputError: It has one.
    """
    if size_px != (camera.width_px, camera.height_px):
        expected = f'{camera.width_px} x {camera.height_px} px, the size of camera "{camera.name}"'
        raise _wrong_mode(where, f"{size_px[0]} x {size_px[1]} px", expected)


def _wrong_mode(where: object, got: str, expected: str) -> InputError:
    what = "the image is not of this camera's mode"
    return InputError(what, where=where, got=got, expected=expected, hint=_HINT)


def _doubts(path: Path, camera: Camera) -> Iterator[str]:
    facts = still_facts(path)
    if facts is None:
        return
    refuse_other_size(facts.size_px, camera, path)
    mode, taken_px = facts.mode, facts.taken_px
    if camera.mode is not None and (difference := _difference(mode, camera.mode)):
        got, expected = difference
        raise _wrong_mode(path, got, f'{expected}, the mode of camera "{camera.name}"')
    if taken_px not in (None, (camera.width_px, camera.height_px), (camera.height_px, camera.width_px)):
        yield (
            f"{path.name} was taken with {taken_px[0]} x {taken_px[1]} px and made {camera.width_px} x"
            f" {camera.height_px} px afterwards: the camera file must be one of images that were treated likewise"
        )
    if camera.mode is None and mode.focal_35mm_mm is not None:
        zoom = mode.digital_zoom or 1.0
        focal_px = mode.focal_35mm_mm / _FILM_DIAGONAL_MM * math.hypot(camera.width_px, camera.height_px)
        if not 1 / _FILM_ROUNDING < focal_px / camera.fx_px < _FILM_ROUNDING:
            yield (
                f"{path.name} was taken with {mode.focal_35mm_mm:g} mm for 35 mm film (digital zoom {zoom:g}), about"
                f' {focal_px:.0f} px, and camera "{camera.name}" has {camera.fx_px:.0f} px: is it of another zoom?'
            )


def _difference(mode: CameraMode, other: CameraMode) -> tuple[str, str] | None:
    """First value that differs, as each mode states it; None where none that both state does."""
    others = asdict(other)
    for key, value in asdict(mode).items():
        expected = others[key]
        if value is None or expected is None:
            continue
        unit = _UNITS[key]
        if isinstance(value, str):
            if value.casefold() != str(expected).casefold():
                return f"{value}{unit}", f"{expected}{unit}"
        elif abs(value - expected) > _ROUNDING * expected:
            return f"{value:g}{unit}", f"{expected:g}{unit}"
    return None
