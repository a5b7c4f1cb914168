"""What a page asks for, as it comes over the wire: probes and evidence, checked before anything is done."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from aerodft.adapters.config.evidence import GEO_KEYS, LOCAL, landmark_tables
from aerodft.adapters.wire.payload import as_json
from aerodft.app.measure import ImageProbe, probe
from aerodft.dft import PROBE_KINDS, probe_end
from aerodft.errors import UsageError, located
from aerodft.model import KnownPoint, ProbeKind

MOST_POINTS: Final = 256
_MOST_NAME: Final = 64
_MOST_PIXEL: Final = 64  # letters of a pixel before a point's name
_ELEVATIONS: Final = ("elevation_m", "elevation_std_m")
_MOST_EVIDENCE: Final = 256
EVIDENCE_KINDS: Final = ("landmark", "length", "height", "vertical", "horizon")
"""What a page can say of a view."""


def kinds_document() -> dict[str, dict[str, Any]]:
    """What a page must know of each kind of probe: how many pixels it takes, and whether its line is closed."""
    return {
        str(name): {"least": kind.pixels[0], "most": min(kind.pixels[1], MOST_POINTS), "closed": kind.is_closed}
        for name, kind in PROBE_KINDS.items()
    }


def probe_of(document: object, std_px: float, points: Callable[[], Mapping[str, KnownPoint]]) -> ImageProbe:
    """A probe as a page asks for it.

    Args:
        document: ``kind``, ``pixels`` as a list of ``[u, v]`` or of text that names a surveyed point, and perhaps a
            ``name`` without spaces, ``elevation_m`` and ``elevation_std_m``: a number, or one for each point without a
            name.
        std_px: Of each pixel coordinate.
        points: Gives surveyed points by name; called where one is named.

    Raises:
        UsageError: It is something else.
    """
    if not isinstance(document, Mapping) or not set(document) <= {"kind", "pixels", "name", *_ELEVATIONS}:
        raise UsageError("a probe", got=as_json(document), expected="kind, pixels and perhaps a name")
    kind, pixels, name = (document.get(key) for key in ("kind", "pixels", "name"))
    if not isinstance(kind, str) or ProbeKind(kind) not in PROBE_KINDS:
        raise UsageError("a probe's kind", got=as_json(kind), expected=f"one of {', '.join(PROBE_KINDS)}")
    if not isinstance(pixels, list) or len(pixels) > MOST_POINTS or not all(map(_is_end, pixels)):
        raise UsageError("a probe's pixels", got=as_json(pixels), expected=f"up to {MOST_POINTS} pairs of numbers")
    if name is not None and not _is_name(name):
        raise UsageError("a probe's name", got=as_json(name), expected=f"up to {_MOST_NAME} letters, no space")
    elevation_m, elevation_std_m = (document.get(key, 0.0) for key in _ELEVATIONS)
    for key, value in zip(_ELEVATIONS, (elevation_m, elevation_std_m), strict=True):
        several = value if isinstance(value, list) else [value]
        if not _are_numbers(several, len(several)):
            expected = "a number of metres, or one for each point"
            raise UsageError(f"a probe's {key}", got=as_json(value), expected=expected)
    known = {"elevation_m": elevation_m, "elevation_std_m": elevation_std_m}
    named = points() if any(isinstance(each, str) for each in pixels) else {}
    ends = [probe_end(each if isinstance(each, str) else (each[0], each[1]), named) for each in pixels]
    return probe(kind, ends, name=name, std_px=std_px, **known)


def evidence_of(document: object) -> dict[str, Any]:
    """What is known of a view, as a page asks for a calibration from it.

    Args:
        document: As a TOML file of evidence has it: tables of ``landmark``, ``length``, ``height``, ``vertical`` and
            ``horizon``, perhaps ``crs`` and ``elevation_m``. What is in a table is checked as that of a file.

    Raises:
        UsageError: It is something else.
    """
    if not isinstance(document, Mapping) or not set(document) <= {*EVIDENCE_KINDS, "crs", "elevation_m"}:
        expected = f"tables of {', '.join(EVIDENCE_KINDS)}, and perhaps crs and elevation_m"
        raise UsageError("what is known of the view", got=as_json(document), expected=expected)
    tables = {kind: document[kind] for kind in EVIDENCE_KINDS if document.get(kind)}
    for kind, rows in tables.items():
        if not isinstance(rows, list) or len(rows) > _MOST_EVIDENCE or not all(isinstance(row, dict) for row in rows):
            raise UsageError(f"the {kind}s", got=as_json(rows), expected=f"a list of up to {_MOST_EVIDENCE} tables")
        for row in rows:
            if not _is_name(row.get("name")):
                expected = f"up to {_MOST_NAME} letters, no space"
                raise UsageError(f"the name of a {kind}", got=as_json(row.get("name")), expected=expected)
    crs = document.get("crs", LOCAL)
    if not isinstance(crs, str) or len(crs) > _MOST_NAME:
        raise UsageError("the crs", got=as_json(crs), expected="local, geo or an EPSG code")
    plane_m = document.get("elevation_m")
    if plane_m is not None and not _are_numbers([plane_m], 1):
        raise UsageError("the elevation_m", got=as_json(plane_m), expected="a number of metres")
    return {"crs": crs, **({} if plane_m is None else {"elevation_m": plane_m}), **tables}


def landmarks_in(text: object) -> dict[str, Any]:
    """The landmarks of a list that somebody has: a CSV with a header, or ground control points of OpenDroneMap.

    Args:
        text: The file's text.

    Returns:
        ``crs``, and ``landmarks``: tables with ``name``, ``pixel`` and ``place``: east, north and up, or latitude,
        longitude and height, by the crs.

    Raises:
        UsageError: It is no text.
        ConfigError: It is no such list.
    """
    if not isinstance(text, str):
        raise UsageError("a list of landmarks", got=as_json(text), expected="the text of a CSV file or gcp_list.txt")
    with located("the list"):
        crs, tables = landmark_tables(text)
    places = [[row[key] for key in GEO_KEYS] if "position_m" not in row else row["position_m"] for row in tables]
    named = [
        {"name": str(row.get("name") or f"landmark-{number}").replace(" ", "-"), "pixel": row["pixel"], "place": place}
        for number, (row, place) in enumerate(zip(tables, places, strict=True), 1)
    ]
    return {"crs": crs, "landmarks": named}


def _is_name(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= _MOST_NAME and value.isprintable() and " " not in value


def _is_end(value: object) -> bool:
    return is_pixel(value) or (isinstance(value, str) and len(value) <= _MOST_NAME + _MOST_PIXEL)


def _are_numbers(value: object, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(type(each) in {int, float} for each in value)


def is_pixel(value: object) -> bool:
    """Whether it is a list of two numbers."""
    return _are_numbers(value, 2)
