"""Stills by their EXIF data: when each of a folder was taken, and whether it is of the mode of a camera file."""

import io
import logging
import math
import re
import warnings
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

from PIL import Image as PillowImage
from PIL.ExifTags import IFD, Base

from aerodft.adapters.files import check_is_no_pipe, looks_like, read_whole
from aerodft.adapters.images.pixels import STILLS, StillPixels
from aerodft.adapters.timestamps import datetime_to_unix_ns, iso_to_unix_ns, parse_offset
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, InputError
from aerodft.model import Camera, CameraMode, CameraStd, Image

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


_FIRST_YEAR: Final = 1990
"""No camera wrote EXIF before 1995; an earlier date is of a clock that was never set and counts from 1970 or 1980."""


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
    if date[:4].isdigit() and int(date[:4]) < _FIRST_YEAR:
        return None
    text = date.replace(":", "-", 2) + (f".{fraction[:9]}" if fraction.isdigit() else "")
    try:
        return iso_to_unix_ns(text + zone, default_offset=utc_offset or timedelta()), not zone and utc_offset is None
    except ValueError:
        return None


def _text(value: object) -> str:
    return value.strip(" \0") if isinstance(value, str) else ""


_LOG: Final = logging.getLogger(__name__)
_INCH: Final = 2  # as EXIF counts units
_RESOLUTION_UNITS_MM: Final = {_INCH: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_TURNED: Final = range(2, 9)  # EXIF's orientations but the plain one
_MOST_PIXELS = 2 * (PillowImage.MAX_IMAGE_PIXELS or 0)  # that Pillow opens
UNREADABLE = (OSError, SyntaxError, ValueError, PillowImage.DecompressionBombError)  # all that Pillow raises


@contextmanager
def damaged_exif_said(path: Path) -> Iterator[None]:
    """Turn Pillow's warnings on damaged EXIF data into one sentence on the file."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        yield
    if said:
        _LOG.warning("%s: its EXIF data are damaged: what of them can be read is used", path)


@dataclass(frozen=True, slots=True, kw_only=True)
class StillFacts:
    """Size and EXIF data of a still.

    Attributes:
        size_px: Width and height as it is stored.
        mode: How the camera was set, as far as EXIF data say.
        taken_px: Width and height when it was taken; None where EXIF does not say.
        sensor_px_per_mm: Pixels of that size on a millimetre of the sensor; None where EXIF does not say.
        is_turned: Whether viewers show it turned or mirrored.
    """

    size_px: tuple[int, int]
    mode: CameraMode
    taken_px: tuple[int, int] | None
    sensor_px_per_mm: float | None
    is_turned: bool


def still_facts(path: Path) -> StillFacts | None:
    """Size and EXIF data of a still; None for a file that is no still."""
    try:
        check_is_no_pipe(path)
        with damaged_exif_said(path), PillowImage.open(path) as image:
            size_px, exif = image.size, image.getexif()
            taken, device, turn = exif.get_ifd(IFD.Exif), exif.get(Base.Model), exif.get(Base.Orientation)
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
    per_unit = _positive(taken.get(Base.FocalPlaneXResolution))
    unit_mm = _RESOLUTION_UNITS_MM.get(taken.get(Base.FocalPlaneResolutionUnit, _INCH))
    return StillFacts(
        size_px=size_px,
        mode=mode,
        taken_px=taken_px,
        sensor_px_per_mm=None if per_unit is None or unit_mm is None else per_unit / unit_mm,
        is_turned=turn in _TURNED,
    )


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


_EXAMPLE = "IMG_%Y%m%d_%H%M%S_%f.jpg or {unix_ms}.png"
_UNDATED_NS: Final = 946_684_800 * SECOND_NS  # 2000-01-01, which no drone's photograph was taken on
_NO_STAMP: Final = -1
_BURST_STEP_NS: Final = 1_000_000  # far below what EXIF resolves, far above what floats of seconds lose
_JPEG_END = b"\xff\xd9"
_JPEG_SCAN = b"\xff\xda"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Still:
    stamp_ns: int  # _NO_STAMP where nothing says it
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
        unique_stamps: bool = False,
        among: Container[Path] | None = None,
    ) -> None:
        """Read the stamps of all stills; what cannot be read is left out and logged as a warning.

        Args:
            folder: JPEG, PNG, TIFF, BMP or WebP files; other files are passed over.
            pattern: How a name tells the time (:class:`NamePattern`); None to take EXIF.
            utc_offset: Whose time it is where neither name nor EXIF says so, like ``+02:00``; None for UTC.
            decode: False for stamps without pixels.
            unique_stamps: For stills that say their own poses, and need no telemetry of the same time: each has a stamp
                of its own. Those of one whole second follow each other by a millisecond; where none has a stamp, all
                get one in the order of their names. A single file is taken as well.
            among: Files to keep of those in the folder; None for all.

        Raises:
            InputError: No folder, no stills in it, or none with a stamp.
            ConfigError: The pattern makes no sense.
            ValueError: ``utc_offset`` is none.
        """
        self._decode = decode
        offset = None if utc_offset is None else parse_offset(utc_offset)
        stills = _scan(folder, pattern, offset, unique=unique_stamps)
        self._stills = stills if among is None else [still for still in stills if still.path in among]

    def __len__(self) -> int:
        return len(self._stills)

    @property
    def stamped(self) -> tuple[tuple[int, Path], ...]:
        """Stamp and file of each."""
        return tuple((still.stamp_ns, still.path) for still in self._stills)

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


def depend_on_zone(folder: Path, pattern: str | None = None) -> bool:
    """Whether the stamps of a folder's stills are those of ``utc_offset``: neither EXIF nor names state a zone.

    Raises:
        InputError: As for ``StillsFolderSource``.
        ConfigError: As for ``StillsFolderSource``.
    """
    zones = ("+00:00", "+01:00")
    return len({StillsFolderSource(folder, pattern=pattern, utc_offset=zone).span_ns for zone in zones}) > 1


def _scan(folder: Path, pattern: str | None, utc_offset: timedelta | None, *, unique: bool) -> list[_Still]:
    is_still = unique and folder.is_file() and folder.suffix.lower() in STILLS
    if not folder.is_dir() and not is_still:
        got = looks_like(folder) if folder.exists() else "nothing there"
        raise InputError("no folder of stills", where=folder, got=got, expected="a folder", hint="check the path")
    inside = [folder] if is_still else folder.iterdir()
    paths = sorted(path for path in inside if path.suffix.lower() in STILLS and path.is_file())
    if not paths:
        raise InputError("holds no stills", where=folder, expected=f"files named {', '.join(sorted(STILLS))}")
    name_pattern = None if pattern is None else NamePattern(pattern, utc_offset)
    if name_pattern is not None and name_pattern.assumes_utc:
        text = "%s: names like %s tell no offset from UTC, UTC assumed; utc_offset or %%z in the pattern says otherwise"
        _LOG.warning(text, folder, pattern)
    found = [_still(path, name_pattern, utc_offset) for path in paths]
    stills = [still for still in found if still is not None and still.stamp_ns != _NO_STAMP]
    undated = [still for still in found if still is not None and still.stamp_ns == _NO_STAMP]
    if unique and not stills and undated:
        _LOG.warning("%s: no still has a date: they are stamped in the order of their names, from 2000 on", folder)
        return [replace(still, stamp_ns=_UNDATED_NS + n * SECOND_NS) for n, still in enumerate(undated)]
    reason = f"name does not match {pattern}" if pattern else "no EXIF date, or one of a clock that was never set"
    for still in undated:
        _LOG.warning("%s: left out, %s", still.path, reason)
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
    stills.sort(key=lambda still: (still.stamp_ns, still.path.name))
    return _with_unique_stamps(stills) if unique else stills


def _with_unique_stamps(stills: list[_Still]) -> list[_Still]:
    """Sorted stills with a stamp each: those of one whole second follow each other by a millisecond."""
    apart: list[_Still] = []
    for still in stills:
        earliest_ns = apart[-1].stamp_ns + _BURST_STEP_NS if apart else still.stamp_ns
        apart.append(replace(still, stamp_ns=earliest_ns) if still.stamp_ns < earliest_ns else still)
    return apart


def _still(path: Path, pattern: NamePattern | None, utc_offset: timedelta | None) -> _Still | None:
    try:
        check_is_no_pipe(path)
        with damaged_exif_said(path), PillowImage.open(path) as image:
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
        stamp_ns = _NO_STAMP
    return _Still(stamp_ns=stamp_ns, path=path, width_px=width_px, height_px=height_px, assumed_utc=assumed_utc)


def _pixels(path: Path) -> StillPixels | None:
    try:
        data = read_whole(path)
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


_ROUNDING: Final = 0.015  # share by which lengths of one zoom may differ: EXIF rounds them
_FILM_DIAGONAL_MM: Final = 43.27
_FILM_ROUNDING: Final = 1.4  # factor within which a focal length is that was rounded to whole millimetres of film
_FILM_STEP_STD_MM: Final = 0.29  # of lengths that are whole millimetres
_SENSORS: Final = (4 / 3, 3 / 2)  # width by height of what images are cropped from, the usual one first
_SAME_ASPECT: Final = 1.02
_OFF_CENTRE: Final = 0.005  # std of the principal point, as a share of the diagonal
_WIDEST: Final = 2.4  # width by height of what is no panorama
_FILM_MM: Final = (4.0, 5000.0)  # focal lengths for 35 mm film that there are
_MOST_ZOOM: Final = 100.0
_MAX_STD_SHARE: Final = 1.0  # of a focal length; chosen: a digital zoom of 2 (0.58) is kept, one of 3 (1.15) is refused
_NO_FOCAL: Final = "the photo does not state its focal length"
_GIVE_CAMERA: Final = "give `camera` or calibrate the lens"
_NOMINAL: Final = 0.03  # std of a stated focal length and sensor, as a share
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
    or 3:2 is a crop of a 4:3 sensor, as wide as it; the std is that of anything up to crops of the other sensors and
    digital zoom that the equivalent may or may not have in it, with its rounding to whole millimetres. Without an
    equivalent, it is the focal length by the sensor's pixels on a millimetre. Of the lens's distortion nothing is
    known: it is 0.

    Raises:
        InputError: No still, no focal length in its EXIF data, one that does not exist or that a digital zoom leaves
            open by itself, or an image that was cropped or joined after it was taken.
    """
    facts = facts_of_still(path)
    (width_px, height_px), mode, taken_px = facts.size_px, facts.mode, facts.taken_px
    aspect = max(width_px, height_px) / min(width_px, height_px)
    as_taken = aspect if taken_px is None else max(taken_px) / min(taken_px)
    if not _is_about(as_taken, aspect) or aspect > _WIDEST:
        got = f"{width_px} x {height_px} px" + (
            "" if taken_px is None else f", taken with {taken_px[0]} x {taken_px[1]} px"
        )
        expected = "one image, and all of it"
        raise InputError("the image was cropped or joined after it was taken", where=path, got=got, expected=expected)
    diagonal_px = math.hypot(width_px, height_px)
    if mode.focal_35mm_mm is not None:
        share, std_share = _diagonal_share(aspect, min(max(mode.digital_zoom or 1.0, 1.0), _MOST_ZOOM))
        if std_share >= _MAX_STD_SHARE:
            got = f"a digital zoom of {mode.digital_zoom:g}, which its {mode.focal_35mm_mm:g} mm may include or not"
            raise InputError(_NO_FOCAL, where=path, got=got, hint=_GIVE_CAMERA)
        film_mm, std_share = share * mode.focal_35mm_mm, math.hypot(std_share, _FILM_STEP_STD_MM / mode.focal_35mm_mm)
    elif mode.focal_mm is not None and facts.sensor_px_per_mm is not None:
        sensor_mm = math.hypot(*(taken_px or facts.size_px)) / facts.sensor_px_per_mm
        film_mm, std_share = _FILM_DIAGONAL_MM * mode.focal_mm / sensor_mm, _NOMINAL
    else:
        raise InputError(
            _NO_FOCAL,
            where=path,
            got="no focal length for 35 mm film in its EXIF data",
            expected="FocalLengthIn35mmFilm, or FocalLength and FocalPlaneXResolution",
            hint=_GIVE_CAMERA,
        )
    if not _FILM_MM[0] <= film_mm <= _FILM_MM[1]:
        what, got = "no camera can be told from it", f"a focal length of {film_mm:g} mm for 35 mm film in its EXIF data"
        raise InputError(what, where=path, got=got, expected=f"{_FILM_MM[0]:g} to {_FILM_MM[1]:g} mm")
    focal_px = film_mm / _FILM_DIAGONAL_MM * diagonal_px
    return Camera.of_focal(
        name=mode.device or path.stem,
        width_px=width_px,
        height_px=height_px,
        focal_px=focal_px,
        std=CameraStd(focal_px=std_share * focal_px, principal_point_px=_OFF_CENTRE * diagonal_px),
        mode=mode,
    )


def _diagonal_share(aspect: float, zoom: float) -> tuple[float, float]:
    """Likely diagonal of the sensor, in the image's, and its std as a share: as anything up to the farthest is."""
    shares = [_sensor_diagonal(aspect, sensor) for sensor in (*_SENSORS, aspect)]
    likely = next((1.0 for sensor in _SENSORS if _is_about(sensor, aspect)), shares[0])
    shares += [zoom * share for share in shares]
    return likely, max(abs(share - likely) for share in shares) / likely / math.sqrt(3)


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
    if facts.is_turned:
        yield f"{path.name} is shown turned by viewers: pixels count in it as it is stored, {facts.size_px[0]} px wide"
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
