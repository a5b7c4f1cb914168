"""How a camera was set when it took a still, from the still's EXIF data."""

import math
from pathlib import Path

from PIL import Image as PillowImage
from PIL.ExifTags import IFD, Base

from aerodft.model.camera import CameraMode

_UNREADABLE = (OSError, SyntaxError, ValueError, PillowImage.DecompressionBombError)  # all that Pillow raises


def still_mode(path: Path) -> tuple[CameraMode, tuple[int, int] | None]:
    """A still's mode, and the size that it was taken in.

    Args:
        path: Any file; what is no still, or has no EXIF data, has a mode of which nothing is known.

    Returns:
        The mode; and width and height in pixels when it was taken, None where EXIF does not say.
    """
    try:
        with PillowImage.open(path) as image:
            exif = image.getexif()
            taken = exif.get_ifd(IFD.Exif)
            device = exif.get(Base.Model)
    except _UNREADABLE:
        return CameraMode(), None
    size = (_number(taken.get(Base.ExifImageWidth)), _number(taken.get(Base.ExifImageHeight)))
    mode = CameraMode(
        device=(device.strip("\0 ") or None) if isinstance(device, str) else None,
        focal_mm=_number(taken.get(Base.FocalLength)),
        focal_35mm_mm=_number(taken.get(Base.FocalLengthIn35mmFilm)),
        digital_zoom=_number(taken.get(Base.DigitalZoomRatio)),
    )
    return mode, None if size[0] is None or size[1] is None else (round(size[0]), round(size[1]))


def _number(value: object) -> float | None:
    """A positive number; EXIF has 0, and fractions by 0, for what is not known."""
    try:
        number = float(value)  # type: ignore[arg-type]  # whatever Pillow found there
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None
