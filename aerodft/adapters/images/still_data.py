"""What a still says of itself: when it was taken, by EXIF or by its name, and how the camera was set."""

import math
import re
from datetime import datetime, timedelta
from pathlib import Path

from PIL import Image as PillowImage
from PIL.ExifTags import IFD, Base

from aerodft.adapters.timestamps import datetime_to_unix_ns, iso_to_unix_ns, parse_offset
from aerodft.errors import ConfigError
from aerodft.model.camera import CameraMode

_FIELDS = {
    "%Y": r"(?P<year>\d{4})",
    "%m": r"(?P<month>\d{2})",
    "%d": r"(?P<day>\d{2})",
    "%H": r"(?P<hour>\d{2})",
    "%M": r"(?P<minute>\d{2})",
    "%S": r"(?P<second>\d{2})",
    "%f": r"(?P<fraction>\d{1,9})",
    "%z": r"(?P<zone>[zZ]|[+-]\d{2}:?\d{2})",
    "%%": "%",
    "{unix_ns}": r"(?P<unix_ns>\d{1,19})",
    "{unix_ms}": r"(?P<unix_ms>\d{1,13})",
    "{unix_s}": r"(?P<unix_s>\d{1,10}(?:\.\d{1,9})?)",
    "*": ".*?",
}
_TOKEN = re.compile(r"%.|\{[^}]*\}|\*|[^%{*]+|\{")
_UNIX_DIGITS = {"unix_ns": 0, "unix_ms": 6, "unix_s": 9}
_CALENDAR = ("year", "month", "day")


class NamePattern:
    """A file name that tells the time.

    ``%Y %m %d %H %M %S`` as in strptime, ``%f`` a fraction of a second with 1 to 9 digits, ``%z`` an offset from UTC,
    ``{unix_s}`` (with or without decimals), ``{unix_ms}``, ``{unix_ns}`` time since 1970, ``*`` anything. A pattern
    without a dot at its end part is held against the name without its suffix. Examples: ``IMG_%Y%m%d_%H%M%S_%f.jpg``,
    ``cam1-{unix_ns}``.
    """

    def __init__(self, text: str, utc_offset: timedelta | None = None) -> None:
        """Compile a pattern.

        Args:
            text: The pattern.
            utc_offset: Whose time the names tell, where they have no ``%z``; None for UTC.

        Raises:
            ConfigError: An unknown field, one twice, or no complete date or time since 1970 in it.
        """
        self.text = text
        self._offset = utc_offset or timedelta()
        known = ", ".join(field for field in _FIELDS if field != "%%")
        parts = []
        for token in _TOKEN.findall(text):
            if token[0] in "%{" and token not in _FIELDS:
                raise ConfigError("pattern of file names", where=text, got=token, expected=f"one of {known}")
            parts.append(_FIELDS.get(token, re.escape(token)))
        try:
            self._regex = re.compile("".join(parts), re.IGNORECASE)
        except re.error:
            raise ConfigError("pattern of file names", where=text, got="a field twice", expected="each once") from None
        groups = self._regex.groupindex
        if not any(name in groups for name in _UNIX_DIGITS) and not all(name in groups for name in _CALENDAR):
            raise ConfigError(
                "pattern of file names", where=text, got="no date", expected="%Y, %m and %d, or one of {unix_s}, ..."
            )

    def stamp_ns(self, name: str) -> int | None:
        """UTC by a file's name; None where the pattern does not match it, or the date is impossible."""
        match = self._regex.fullmatch(name) or self._regex.fullmatch(name.rpartition(".")[0])
        if match is None:
            return None
        found = match.groupdict()
        for unit, digits in _UNIX_DIGITS.items():
            if unit in found:
                whole, _, decimals = found[unit].partition(".")
                return int(whole + decimals.ljust(digits, "0") if digits else whole)
        return self._calendar_ns(found)

    def _calendar_ns(self, found: dict[str, str]) -> int | None:
        date = "-".join(found[key] for key in _CALENDAR)
        clock = ":".join(found.get(key, "00") for key in ("hour", "minute", "second"))
        try:
            local = datetime.fromisoformat(f"{date}T{clock}+00:00")
        except ValueError:
            return None
        offset = parse_offset(found["zone"]) if "zone" in found else self._offset
        return datetime_to_unix_ns(local - offset) + int(found.get("fraction", "0").ljust(9, "0"))


def exif_stamp_ns(image: PillowImage.Image, utc_offset: timedelta | None) -> tuple[int, bool] | None:
    """UTC by EXIF's DateTimeOriginal, SubSecTimeOriginal and OffsetTimeOriginal.

    Args:
        image: An opened image.
        utc_offset: Whose time it is where EXIF states no offset; None for UTC.

    Returns:
        The stamp, and whether UTC had to be assumed; None where there is no usable date.
    """
    details = image.getexif().get_ifd(IFD.Exif)
    date = _text(details.get(Base.DateTimeOriginal))
    zone = _text(details.get(Base.OffsetTimeOriginal)) or _text(details.get(Base.OffsetTime))
    fraction = _text(details.get(Base.SubsecTimeOriginal))
    text = date.replace(":", "-", 2) + (f".{fraction[:9]}" if fraction.isdigit() else "")
    try:
        return iso_to_unix_ns(text + zone, default_offset=utc_offset or timedelta()), not zone and utc_offset is None
    except ValueError:
        return None


def _text(value: object) -> str:
    return value.strip(" \0") if isinstance(value, str) else ""


UNREADABLE = (OSError, SyntaxError, ValueError, PillowImage.DecompressionBombError)  # all that Pillow raises


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
    except UNREADABLE:
        return CameraMode(), None
    size = (_positive(taken.get(Base.ExifImageWidth)), _positive(taken.get(Base.ExifImageHeight)))
    mode = CameraMode(
        device=(device.strip("\0 ") or None) if isinstance(device, str) else None,
        focal_mm=_positive(taken.get(Base.FocalLength)),
        focal_35mm_mm=_positive(taken.get(Base.FocalLengthIn35mmFilm)),
        digital_zoom=_positive(taken.get(Base.DigitalZoomRatio)),
    )
    return mode, None if size[0] is None or size[1] is None else (round(size[0]), round(size[1]))


def _positive(value: object) -> float | None:
    """A positive number; EXIF has 0, and fractions by 0, for what is not known."""
    try:
        number = float(value)  # type: ignore[arg-type]  # whatever Pillow found there
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None
