"""A folder of stills as a source of images."""

import io
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

from PIL import Image as PillowImage

from aerodft.adapters.filetype import looks_like
from aerodft.adapters.images.pixels import STILLS, StillPixels
from aerodft.adapters.images.still_data import UNREADABLE, NamePattern, exif_stamp_ns
from aerodft.adapters.timestamps import parse_offset
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError
from aerodft.model.image import Image

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
        time_offset_s: float = 0.0,
        decode: bool = True,
    ) -> None:
        """Read the stamps of all stills; what cannot be read is left out and logged as a warning.

        Args:
            folder: JPEG, PNG, TIFF, BMP or WebP files; other files are passed over.
            pattern: How a name tells the time (:class:`NamePattern`); None to take EXIF.
            utc_offset: Whose time it is where neither name nor EXIF says so, like ``+02:00``; None for UTC.
            time_offset_s: Added to every stamp.
            decode: False for stamps without pixels.

        Raises:
            InputError: No folder, no stills in it, or none with a stamp.
            ConfigError: The pattern makes no sense.
            ValueError: ``utc_offset`` is none.
        """
        self._offset_ns = round(time_offset_s * SECOND_NS)
        self._decode = decode
        self._stills = _scan(folder, pattern, None if utc_offset is None else parse_offset(utc_offset))

    def __len__(self) -> int:
        return len(self._stills)

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp, time offset applied."""
        return self._stills[0].stamp_ns + self._offset_ns, self._stills[-1].stamp_ns + self._offset_ns

    def events(self) -> Iterator[Image]:
        """All stills that can be read; the compressed file is kept until its pixels are asked for."""
        for index, still in enumerate(self._stills):
            pixels = _pixels(still.path) if self._decode else None
            if self._decode and pixels is None:
                continue
            stamp_ns = still.stamp_ns + self._offset_ns
            yield Image(
                index=index,
                stamp_ns=stamp_ns,
                arrival_ns=stamp_ns,
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
        text = "%s: EXIF of %d stills states no offset from UTC, UTC assumed; utc_offset says otherwise"
        _LOG.warning(text, folder, assumed)
    return sorted(stills, key=lambda still: (still.stamp_ns, still.path.name))


def _still(path: Path, pattern: NamePattern | None, utc_offset: timedelta | None) -> _Still | None:
    try:
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
    """Where a JPEG's picture data begins: behind the segments, one of which may hold a whole thumbnail."""
    at = 2
    while at + 4 <= len(data) and data[at] == _JPEG_SCAN[0] and data[at : at + 2] != _JPEG_SCAN:
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return at
