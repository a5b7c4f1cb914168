"""Writes photographs as drones write them: small images with EXIF and XMP of each dialect, for tests alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from PIL import Image
from PIL.ExifTags import GPS, IFD, Base
from PIL.TiffImagePlugin import IFDRational

NAMESPACES = {
    "drone-dji": "http://www.dji.com/drone-dji/1.0/",
    "drone-skydio": "https://www.skydio.com/drone-skydio/1.0/",
    "drone-parrot": "http://www.parrot.com/drone-parrot/1.0/",
    "Camera": "http://pix4d.com/camera/1.0",
    "exif": "http://ns.adobe.com/exif/1.0/",
    "tiff": "http://ns.adobe.com/tiff/1.0/",
    "xmp": "http://ns.adobe.com/xap/1.0/",
}

Values = Mapping[str, "str | float | Mapping[str, float]"]


def packet(values: Values, *, about: str = "", as_elements: bool = False, padding: int = 200) -> bytes:
    """An XMP packet of ``prefix:Name`` values; a mapping is a structure, written as Skydio does."""
    prefixes = sorted({key.partition(":")[0] for key in values})
    spaces = "".join(f" xmlns:{each}={quoteattr(NAMESPACES[each])}" for each in prefixes)
    simple = {key: str(value) for key, value in values.items() if not isinstance(value, Mapping)}
    attributes = "" if as_elements else "".join(f"\n  {key}={quoteattr(value)}" for key, value in simple.items())
    inside = "".join(f"<{key}>{value}</{key}>" for key, value in simple.items()) if as_elements else ""
    for key, fields in values.items():
        if isinstance(fields, Mapping):
            prefix = key.partition(":")[0]
            parts = "".join(f"<{prefix}:{name}>{value}</{prefix}:{name}>" for name, value in fields.items())
            inside += f'<{key} rdf:parseType="Resource">{parts}</{key}>'
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f"<rdf:Description rdf:about={quoteattr(about)}{spaces}{attributes}>{inside}</rdf:Description>"
        f'</rdf:RDF></x:xmpmeta>{" " * padding}<?xpacket end="w"?>'
    ).encode()


def exif(
    *,
    make: str = "",
    model: str = "",
    date: str = "2026:06:01 10:00:00",
    focal_35mm_mm: float | None = None,
    place_deg: tuple[float, float] | None = None,
    altitude_m: float | None = None,
) -> Image.Exif:
    """EXIF with what a drone's camera states."""
    found = Image.Exif()
    if make:
        found[Base.Make] = make
    if model:
        found[Base.Model] = model
    details = found.get_ifd(IFD.Exif)
    if date:
        details[Base.DateTimeOriginal] = date
        details[Base.OffsetTimeOriginal] = "+00:00"
    if focal_35mm_mm is not None:
        details[Base.FocalLengthIn35mmFilm] = round(focal_35mm_mm)
    if place_deg is not None:
        gps = found.get_ifd(IFD.GPSInfo)
        names = ((GPS.GPSLatitude, GPS.GPSLatitudeRef, "NS"), (GPS.GPSLongitude, GPS.GPSLongitudeRef, "EW"))
        for value, (key, reference, sides) in zip(place_deg, names, strict=True):
            minutes, seconds = divmod(abs(value) * 3600, 60)
            degrees, minutes = divmod(minutes, 60)
            gps[key] = (int(degrees), int(minutes), IFDRational(round(seconds * 10**6), 10**6))
            gps[reference] = sides[value < 0]
        if altitude_m is not None:
            gps[GPS.GPSAltitude] = IFDRational(round(abs(altitude_m) * 1000), 1000)
            gps[GPS.GPSAltitudeRef] = b"\x01" if altitude_m < 0 else b"\x00"
    return found


def write_photo(
    path: Path,
    xmp: bytes | None,
    info: Image.Exif,
    *,
    size_px: tuple[int, int] = (64, 48),
    pixels: np.ndarray | None = None,
) -> Path:
    """A JPEG or TIFF, by its ending, of these pixels (RGB), else of grey ones."""
    image = Image.new("RGB", size_px, (90, 110, 90)) if pixels is None else Image.fromarray(pixels)
    is_tiff = path.suffix.lower() in {".tif", ".tiff"}
    more: dict[str, Any] = {} if is_tiff else {"quality": 80}
    if xmp is not None:
        more |= {"tiffinfo": {700: xmp}} if is_tiff else {"xmp": xmp}
    image.save(path, exif=info, **more)
    return path


def dji(
    yaw_deg: float = 40.0,
    pitch_deg: float = -60.0,
    roll_deg: float = 0.0,
    *,
    relative_m: float = 39.9,
    place_deg: tuple[float, float] = (46.8428646, -91.9936967),
    **more: str | float,
) -> dict[str, str | float]:
    """DJI's tags of a pose."""
    own = {
        "AbsoluteAltitude": "+198.41",
        "RelativeAltitude": f"{relative_m:+.2f}",
        "GpsLatitude": f"{place_deg[0]:.7f}",
        "GpsLongitude": f"{place_deg[1]:.7f}",
        "GimbalRollDegree": f"{roll_deg:+.2f}",
        "GimbalYawDegree": f"{yaw_deg:+.2f}",
        "GimbalPitchDegree": f"{pitch_deg:+.2f}",
        "FlightRollDegree": "+3.00",
        "FlightYawDegree": "+106.00",
        "FlightPitchDegree": "-5.00",
    }
    return {f"drone-dji:{name}": value for name, value in {**own, **more}.items()}


def dji_photo(path: Path, *, size_px: tuple[int, int] = (64, 48), **tags: Any) -> Path:
    """A photograph of a DJI drone with a 24 mm lens; ``tags`` as for ``dji``."""
    info = exif(make="DJI", model="FC0000", focal_35mm_mm=24)
    return write_photo(path, packet(dji(**tags)), info, size_px=size_px)
