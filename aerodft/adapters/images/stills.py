"""A folder of stills as a source of images: when each was taken, by EXIF or by its name, and how the camera was set."""

import io
import logging
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from PIL import Image as PillowImage
from PIL.ExifTags import IFD, Base

from aerodft.adapters.files import check_is_no_pipe, looks_like
from aerodft.adapters.images.pixels import STILLS, StillPixels
from aerodft.adapters.timestamps import datetime_to_unix_ns, iso_to_unix_ns, parse_offset
from aerodft.errors import ConfigError, InputError
from aerodft.model import CameraMode, Image

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
        self._offset, self._is_silent = utc_offset or timedelta(), utc_offset is None
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

    @property
    def assumes_utc(self) -> bool:
        """Whether names are taken to tell UTC because nobody says otherwise."""
        groups = self._regex.groupindex
        return self._is_silent and "zone" not in groups and not any(unit in groups for unit in _UNIX_DIGITS)

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
            offset = parse_offset(found["zone"]) if "zone" in found else self._offset
        except ValueError:
            return None
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


_MOST_PIXELS = 2 * (PillowImage.MAX_IMAGE_PIXELS or 0)  # that Pillow opens
UNREADABLE = (OSError, SyntaxError, ValueError, PillowImage.DecompressionBombError)  # all that Pillow raises


@dataclass(frozen=True, slots=True, kw_only=True)
class StillFacts:
    """Size and EXIF data of a still.

    Attributes:
        size_px: Width and height as it is stored.
        mode: How the camera was set, as far as EXIF data say.
        taken_px: Width and height when it was taken; None where EXIF does not say.
    """

    size_px: tuple[int, int]
    mode: CameraMode
    taken_px: tuple[int, int] | None


def still_facts(path: Path) -> StillFacts | None:
    """Size and EXIF data of a still; None for a file that is no still."""
    try:
        check_is_no_pipe(path)
        with PillowImage.open(path) as image:
            size_px, exif = image.size, image.getexif()
            taken, device = exif.get_ifd(IFD.Exif), exif.get(Base.Model)
    except UNREADABLE:
        return None
    width_px, height_px = (_positive(taken.get(key)) for key in (Base.ExifImageWidth, Base.ExifImageHeight))
    mode = CameraMode(
        device=_text(device) or None,
        focal_mm=_positive(taken.get(Base.FocalLength)),
        focal_35mm_mm=_positive(taken.get(Base.FocalLengthIn35mmFilm)),
        digital_zoom=_positive(taken.get(Base.DigitalZoomRatio)),
    )
    taken_px = None if width_px is None or height_px is None else (round(width_px), round(height_px))
    return StillFacts(size_px=size_px, mode=mode, taken_px=taken_px)


def facts_of_still(path: Path) -> StillFacts:
    """Size and EXIF data of a still.

    Raises:
        InputError: It is none.
    """
    found = still_facts(path)
    if found is None:
        expected = f"a whole image of at most {_MOST_PIXELS // 10**6} million pixels"
        raise InputError("not a readable image", where=path, got=looks_like(path), expected=expected)
    return found


def _positive(value: object) -> float | None:
    """A positive number; EXIF has 0, and fractions by 0, for what is not known."""
    try:
        number = float(value)  # type: ignore[arg-type]  # whatever Pillow found there
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None


_LOG = logging.getLogger(__name__)
_EXAMPLE = "IMG_%Y%m%d_%H%M%S_%f.jpg or {unix_ms}.png"
_JPEG_END = b"\xff\xd9"
_JPEG_SCAN = b"\xff\xda"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Still:
    stamp_ns: int
    path: Path
    width_px: int
    height_px: int
    assumed_utc: bool


class StillsFolderSource:
    """The stills of one folder (not of those within), in the order in which they were taken."""

    def __init__(
        self,
        folder: Path,
        *,
        pattern: str | None = None,
        utc_offset: str | None = None,
        decode: bool = True,
    ) -> None:
        """Read the stamps of all stills; what cannot be read is left out and logged as a warning.

        Args:
            folder: JPEG, PNG, TIFF, BMP or WebP files; other files are passed over.
            pattern: How a name tells the time (:class:`NamePattern`); None to take EXIF.
            utc_offset: Whose time it is where neither name nor EXIF says so, like ``+02:00``; None for UTC.
            decode: False for stamps without pixels.

        Raises:
            InputError: No folder, no stills in it, or none with a stamp.
            ConfigError: The pattern makes no sense.
            ValueError: ``utc_offset`` is none.
        """
        self._decode = decode
        self._stills = _scan(folder, pattern, None if utc_offset is None else parse_offset(utc_offset))

    def __len__(self) -> int:
        return len(self._stills)

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp."""
        return self._stills[0].stamp_ns, self._stills[-1].stamp_ns

    def events(self) -> Iterator[Image]:
        """All stills that can be read; the compressed file is kept until its pixels are asked for."""
        for index, still in enumerate(self._stills):
            pixels = _pixels(still.path) if self._decode else None
            if self._decode and pixels is None:
                continue
            yield Image(
                index=index,
                stamp_ns=still.stamp_ns,
                arrival_ns=still.stamp_ns,
                width_px=still.width_px,
                height_px=still.height_px,
                pixels=pixels,
            )


def _scan(folder: Path, pattern: str | None, utc_offset: timedelta | None) -> list[_Still]:
    if not folder.is_dir():
        got = looks_like(folder) if folder.exists() else "nothing there"
        raise InputError("no folder of stills", where=folder, got=got, expected="a folder", hint="check the path")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in STILLS and path.is_file())
    if not paths:
        raise InputError("holds no stills", where=folder, expected=f"files named {', '.join(sorted(STILLS))}")
    name_pattern = None if pattern is None else NamePattern(pattern, utc_offset)
    if name_pattern is not None and name_pattern.assumes_utc:
        text = "%s: names like %s tell no offset from UTC, UTC assumed; utc_offset or %%z in the pattern says otherwise"
        _LOG.warning(text, folder, pattern)
    stills = [still for path in paths if (still := _still(path, name_pattern, utc_offset))]
    if not stills:
        source = "EXIF dates" if pattern is None else f"names like {pattern}"
        raise InputError(
            f"none of {len(paths)} stills has a stamp",
            where=folder,
            got=f"for instance {paths[0].name}",
            expected=source,
            hint=f"give a file name pattern such as {_EXAMPLE}",
        )
    if assumed := sum(still.assumed_utc for still in stills):
        text = "%s: EXIF of %d stills states no offset from UTC, UTC assumed; `utc_offset` says otherwise"
        _LOG.warning(text, folder, assumed)
    return sorted(stills, key=lambda still: (still.stamp_ns, still.path.name))


def _still(path: Path, pattern: NamePattern | None, utc_offset: timedelta | None) -> _Still | None:
    try:
        check_is_no_pipe(path)
        with PillowImage.open(path) as image:
            width_px, height_px = image.size
            found = exif_stamp_ns(image, utc_offset) if pattern is None else None
    except UNREADABLE:
        _LOG.warning("%s: left out, not a readable image but %s", path, looks_like(path))
        return None
    stamp_ns = pattern.stamp_ns(path.name) if pattern else None
    assumed_utc = False
    if found:
        stamp_ns, assumed_utc = found
    if stamp_ns is None:
        reason = "no EXIF date" if pattern is None else f"name does not match {pattern.text}"
        _LOG.warning("%s: left out, %s", path, reason)
        return None
    return _Still(stamp_ns=stamp_ns, path=path, width_px=width_px, height_px=height_px, assumed_utc=assumed_utc)


def _pixels(path: Path) -> StillPixels | None:
    try:
        check_is_no_pipe(path)
        data = path.read_bytes()
    except OSError as error:
        _LOG.warning("%s: left out, %s", path, error.strerror)
        return None
    if not _is_whole(data):
        _LOG.warning("%s: left out, cut off or damaged", path)
        return None
    return StillPixels(data, str(path))


def _is_whole(data: bytes) -> bool:
    """Whether a still's data reaches its end; decoders fill what is missing with grey without a word."""
    if data.startswith(b"\xff\xd8"):
        return data.find(_JPEG_END, _first_scan(data)) >= 0
    try:
        with PillowImage.open(io.BytesIO(data)) as image:
            image.load()
    except UNREADABLE:
        return False
    return True


def _first_scan(data: bytes) -> int:
    """Offset of a JPEG's picture data: behind the segments, one of which may hold a whole thumbnail."""
    at = 2
    while at + 4 <= len(data) and data[at] == _JPEG_SCAN[0] and data[at : at + 2] != _JPEG_SCAN:
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return at
