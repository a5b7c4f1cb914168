"""What a photograph says of itself, before anybody interprets it: EXIF and XMP as plain numbers and texts."""

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Self

import orjson
from PIL import Image as PillowImage
from PIL.ExifTags import GPS, IFD, Base

from aerodft.adapters.files import check_is_no_pipe, looks_like
from aerodft.adapters.images import UNREADABLE, damaged_exif_said
from aerodft.adapters.photographs.xmp import parse_xmp
from aerodft.errors import InputError

_XML_PACKET: Final = 700  # TIFF's tag of XMP
_BELOW_SEA: Final = 1  # GPSAltitudeRef


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoTags:
    """EXIF and XMP values of a photograph.

    Attributes:
        name: Of its file.
        width_px: As it is stored.
        height_px: As it is stored.
        exif: Texts and numbers by EXIF's names; degrees for latitude and longitude, signed; metres for the altitude.
            Numbers that cannot be are NaN.
        xmp: As of ``parse_xmp``.
    """

    name: str
    width_px: int
    height_px: int
    exif: dict[str, float | str] = field(default_factory=dict)
    xmp: dict[str, str] = field(default_factory=dict)

    def to_json(self) -> bytes:
        """The tags as JSON, as a recording keeps them."""
        return orjson.dumps(asdict(self))

    @classmethod
    def from_json(cls, data: bytes) -> Self:
        """The tags that a recording keeps.

        Raises:
            ValueError: They are damaged.
        """
        document = orjson.loads(data)
        if not isinstance(document, dict):
            raise ValueError("tags of a photograph must be a JSON object")  # noqa: TRY004 - of data, not of arguments
        exif, xmp = document.get("exif", {}), document.get("xmp", {})
        if not (isinstance(exif, dict) and isinstance(xmp, dict)):
            raise ValueError("EXIF and XMP of a photograph must be JSON objects")  # noqa: TRY004
        return cls(
            name=str(document.get("name", "")),
            width_px=int(document["width_px"]),
            height_px=int(document["height_px"]),
            exif={
                str(key): math.nan if value is None else value if isinstance(value, str) else float(value)
                for key, value in exif.items()
            },
            xmp={str(key): str(value) for key, value in xmp.items()},
        )

    @property
    def make(self) -> str:
        """The maker in EXIF, else in XMP; lower case, empty where nobody says it."""
        return (self.text("Make") or self.xmp.get("tiff:Make", "")).strip().casefold()

    @property
    def model(self) -> str:
        """The model in EXIF, else in XMP; empty where nobody says it."""
        return self.text("Model") or self.xmp.get("tiff:Model", "").strip()

    def text(self, name: str) -> str:
        """A text of EXIF; empty where it has none."""
        value = self.exif.get(name, "")
        return value if isinstance(value, str) else ""

    def has(self, prefix: str) -> bool:
        """Whether XMP has any value of a namespace."""
        return any(key.startswith(prefix + ":") for key in self.xmp)


def photo_tags(path: Path) -> PhotoTags:
    """Read what a photograph says of itself.

    Raises:
        InputError: It is no image that can be read.
    """
    try:
        check_is_no_pipe(path)
        with damaged_exif_said(path), PillowImage.open(path) as image:
            exif = image.getexif()
            packet = image.info.get("xmp") or exif.get(_XML_PACKET)
            return PhotoTags(
                name=path.name,
                width_px=image.width,
                height_px=image.height,
                exif=_exif_values(exif),
                xmp=parse_xmp(packet.encode() if isinstance(packet, str) else packet)
                if isinstance(packet, bytes | str)
                else {},
            )
    except UNREADABLE as error:
        raise InputError("not a readable image", where=path, got=looks_like(path), expected="a photograph") from error


def _exif_values(exif: PillowImage.Exif) -> dict[str, float | str]:
    details, gps = exif.get_ifd(IFD.Exif), exif.get_ifd(IFD.GPSInfo)
    values: dict[str, float | str] = {}
    for name, found in (
        ("Make", exif.get(Base.Make)),
        ("Model", exif.get(Base.Model)),
        ("DateTimeOriginal", details.get(Base.DateTimeOriginal)),
        ("GPSDateStamp", gps.get(GPS.GPSDateStamp)),
    ):
        if isinstance(found, str) and found.strip(" \0"):
            values[name] = found.strip(" \0")
    for name, found in (
        ("ExifImageWidth", details.get(Base.ExifImageWidth)),
        ("ExifImageHeight", details.get(Base.ExifImageHeight)),
        ("GPSHPositioningError", gps.get(GPS.GPSHPositioningError)),
    ):
        if found is not None:
            values[name] = _number(found)
    if GPS.GPSLatitude in gps or GPS.GPSLongitude in gps:
        values["GPSLatitude"] = _degrees(gps.get(GPS.GPSLatitude), gps.get(GPS.GPSLatitudeRef), "N", "S")
        values["GPSLongitude"] = _degrees(gps.get(GPS.GPSLongitude), gps.get(GPS.GPSLongitudeRef), "E", "W")
    if GPS.GPSAltitude in gps:
        ref = gps.get(GPS.GPSAltitudeRef)
        below = (ref[0] if isinstance(ref, bytes) and ref else ref) == _BELOW_SEA
        values["GPSAltitude"] = _number(gps.get(GPS.GPSAltitude)) * (-1 if below else 1)
    return values


def _degrees(parts: Any, reference: Any, positive: str, negative: str) -> float:  # noqa: ANN401 - whatever Pillow found
    """Signed degrees of degrees, minutes, seconds; NaN where they cannot be, or no hemisphere is stated."""
    side = str(reference).strip(" \0").upper()
    if side not in {positive, negative} or not isinstance(parts, tuple | list) or not parts:
        return math.nan
    degrees = sum(_number(part) / 60**power for power, part in enumerate(parts[:3]))
    return float(degrees if side == positive else -degrees)


def _number(value: Any) -> float:  # noqa: ANN401 - whatever Pillow found
    """A number of EXIF; NaN for fractions by 0 and what is none."""
    try:
        return float(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return math.nan
