"""Lists of ground control points as OpenDroneMap takes them (``gcp_list.txt``).

The first line is the projection; each of the others ``geo_x geo_y geo_z im_x im_y image_name [gcp_name] [extras]``
(https://docs.opendronemap.org/gcp/). Pixel (0, 0) is the centre of the top-left one.
"""

import re
from collections import Counter
from pathlib import Path

from pyproj import CRS
from pyproj.exceptions import CRSError

from aerodft.adapters.config.evidence.evidence_tables import GEO_KEYS, UNKNOWN
from aerodft.adapters.config.evidence.local_frame import checked_crs, takes_degrees
from aerodft.errors import ConfigError

_PROJECTION = re.compile(r"\s*(epsg:|\+proj|\+init|wgs84\s+utm)", re.IGNORECASE)
_UTM = re.compile(r"wgs84\s+utm\s+(\d{1,2})\s*([ns])", re.IGNORECASE)
_LEAST, _NAME = 6, 6  # columns of a line, and where a point's name is
_CONFIDENCE = 25  # of PROJ that a projection is a code's: it has no names to compare
_MOST_NAMES = 6


def is_gcp_list(text: str) -> bool:
    """Whether a text begins with a projection, as no CSV file does."""
    return _PROJECTION.match(text) is not None


def gcp_rows(text: str, image: str | None, where: str) -> tuple[str, str, list[tuple[str, dict[str, object]]]]:
    """The points of one image.

    Args:
        text: The list.
        image: Name of the image whose points are wanted; None where the list has one image only.
        where: The file's name in messages.

    Returns:
        The coordinate reference system; the image's name; and of each point its line in words, and it as a landmark's
        table.

    Raises:
        ConfigError: A projection without an EPSG code, a line that is none, or several images and none of them named.
    """
    head, *lines = text.splitlines()
    crs = _crs(head.strip(), where)
    in_degrees = takes_degrees(crs)
    by_image: dict[str, list[tuple[str, dict[str, object]]]] = {}
    for number, line in enumerate(lines, start=2):
        cells = line.split()
        if not cells or cells[0].startswith("#"):
            continue
        if len(cells) < _LEAST:
            expected = "geo_x geo_y geo_z im_x im_y image_name"
            raise ConfigError(f"line {number}", where=where, got=f"{len(cells)} columns", expected=expected)
        x, y, height, u, v = (_number(cell, number, where) for cell in cells[: _LEAST - 1])
        place = dict(zip(GEO_KEYS, (y, x, height), strict=True)) if in_degrees else {"position_m": [x, y, height]}
        name = {"name": cells[_NAME]} if len(cells) > _NAME else {}
        row: dict[str, object] = {**name, "pixel": [u, v], **place}
        by_image.setdefault(cells[_LEAST - 1], []).append((f"line {number}", row))
    chosen = _chosen(Counter({name: len(rows) for name, rows in by_image.items()}), image, where)
    return crs, chosen, by_image[chosen]


def _crs(head: str, where: str) -> str:
    utm = _UTM.match(head)
    if utm is not None:
        return checked_crs(f"EPSG:{32600 + 100 * (utm[2].lower() == 's') + int(utm[1])}", where)
    if head.lower().startswith("epsg:"):
        return checked_crs(head, where)
    try:
        code = CRS.from_user_input(head).to_epsg(min_confidence=_CONFIDENCE)
    except CRSError:
        code = None
    if code is None:
        hint = "write the EPSG code of the projection into its first line"
        raise ConfigError("line 1", where=where, got=f'"{head}"', expected="a projection like EPSG:32633", hint=hint)
    return checked_crs(f"EPSG:{code}", where)


def _number(cell: str, number: int, where: str) -> float | str:
    if cell.lower() == "nan":
        return UNKNOWN
    try:
        return float(cell)
    except ValueError:
        raise ConfigError(f"line {number}", where=where, got=f'"{cell}"', expected="a number") from None


def _chosen(counts: Counter[str], image: str | None, where: str) -> str:
    if not counts:
        raise ConfigError("holds no points", where=where, got="a projection only", expected="a line for each point")
    listed = ", ".join(f"{name} ({count})" for name, count in counts.most_common(_MOST_NAMES))
    more = ", ..." if len(counts) > _MOST_NAMES else ""
    if image is None and len(counts) > 1:
        hint = "name the one whose camera is meant by `image`"
        raise ConfigError(
            "points of several images", where=where, got=f"{listed}{more}", expected="one image", hint=hint
        )
    chosen = next(iter(counts)) if image is None else Path(image).name
    if chosen not in counts:
        raise ConfigError("image", where=where, got=f'"{chosen}"', expected=f"one of {listed}{more}")
    return chosen
