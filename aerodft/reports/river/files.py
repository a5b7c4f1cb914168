"""A river's folder: document, table of transects, map (GeoJSON in WGS84, or in metres) and plate."""

import csv
import errno
import io
import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
import orjson

from aerodft.adapters.files import output_folder, writable
from aerodft.geometry import lat_lon
from aerodft.model import FloatArray, ImageArray, PoseSample
from aerodft.reports.river.document import SIDES, RiverImages
from aerodft.reports.river.plate import draw_plate, draw_reach_plate
from aerodft.vision.river import Reach, River, RiverView, WaterPlane

COLUMNS: Final = (
    "station_m", "status", "width_m", "std_m", "ci95_low_m", "ci95_high_m", "bound",
    "wetted_m", "wetted_std_m", "channels", "images", "scatter_m",
    "left_lat", "left_lon", "right_lat", "right_lon",
    "left_u", "left_v", "right_u", "right_v", "left_std_px", "right_std_px",
)  # fmt: skip
"""Empty where not known: pixels are of one image, scatter is of several, places are of a known station."""

_LOG: Final = logging.getLogger(__name__)
_JSON: Final = orjson.OPT_APPEND_NEWLINE | orjson.OPT_INDENT_2
_LOCAL: Final = {"schema": "aerodft.river_local/1", "unit": "m", "axes": "east, north, as points_enu_m"}
_FACTS: Final = COLUMNS[:12]  # of a transect on the map


def map_of_still(document: dict[str, Any], found: River, view: RiverView) -> tuple[str, dict[str, Any]]:
    """Name and content of a map with centreline, banks, transects and water of one image."""
    lines = [view.plane.places_en_m(bank) for bank in found.banks_px]
    banks = [line[np.isfinite(line[:, 0])] for line in lines]
    return _map(document, found.line.places_en_m, banks, _outline(view.plane, found), view.sample)


def map_of_reach(document: dict[str, Any], found: Reach, sample: PoseSample) -> tuple[str, dict[str, Any]]:
    """Name and content of a map with centreline, banks, transects and the water between them, of many images."""
    points = found.found.widths.points_enu_m[found.found.images > 0]
    water = np.concatenate([points[:, 0, :2], points[::-1, 1, :2], points[:1, 0, :2]])
    banks = [points[:, side, :2] for side in range(2)]
    return _map(document, found.line.places_en_m, banks, [water], sample)


def _map(
    document: dict[str, Any],
    line_en_m: FloatArray,
    banks_en_m: Sequence[FloatArray],
    rings_en_m: Sequence[FloatArray],
    sample: PoseSample,
) -> tuple[str, dict[str, Any]]:
    features = [_line("centreline", _places(sample, line_en_m), _median(document["width_m"]))]
    for side, bank in zip(SIDES, banks_en_m, strict=True):
        features.append(_line(f"bank-{side}", _places(sample, bank), {}))
    for each, row in zip(document["transects"], transect_rows(document), strict=True):
        if each["points_enu_m"] is not None:
            ends = np.array(each["points_enu_m"])[:, :2]
            features.append(_line("transect", _places(sample, ends), {name: row[name] for name in _FACTS}))
    if rings_en_m:
        geometry = {"type": "Polygon", "coordinates": [_places(sample, ring) for ring in rings_en_m]}
        features.append({"type": "Feature", "properties": {"name": "water"}, "geometry": geometry})
    kept = [each for each in features if each is not None]
    if sample.origin is None:
        return "river_local.json", {**_LOCAL, "features": kept}
    return "river.geojson", {"type": "FeatureCollection", "features": kept}


def _median(width: dict[str, Any] | None) -> dict[str, Any]:
    """The median width as scalars with the names of the table; None where there is none."""
    if width is None:
        return dict.fromkeys(("width_m", "std_m", "ci95_low_m", "ci95_high_m"))
    low, high = width["ci95"]
    return {"width_m": width["median"], "std_m": width["std"], "ci95_low_m": low, "ci95_high_m": high}


def _places(sample: PoseSample, points_en_m: FloatArray) -> list[list[float]]:
    """Longitude and latitude, degrees, of points ``(n, 2)``; east and north where no place is known."""
    if sample.origin is None:
        local: list[list[float]] = points_en_m.tolist()
        return local
    places: list[list[float]] = np.degrees(lat_lon(sample.origin, points_en_m))[:, ::-1].tolist()
    return places


def _line(name: str, places: list[list[float]], properties: dict[str, Any]) -> dict[str, Any] | None:
    """A line; None where there is none to draw."""
    if len(places) < 2:  # noqa: PLR2004 - a line has two ends
        return None
    geometry = {"type": "LineString", "coordinates": places}
    return {"type": "Feature", "properties": {"name": name, **properties}, "geometry": geometry}


def _outline(plane: WaterPlane, found: River) -> list[FloatArray]:
    """The water's outline, closed, and its islands' after it, ``(n, 2)`` each, as coarse as the small copy has them."""
    mask = found.water.water.astype(np.uint8)
    outlines, levels = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    rings = []
    for index in sorted(range(len(outlines)), key=lambda index: int(levels[0][index][3] >= 0)):
        places = plane.places_en_m(found.copy.to_image(outlines[index][:, 0].astype(np.float64)))
        places = places[np.isfinite(places[:, 0])]
        if len(places) > 2:  # noqa: PLR2004 - a ring has three corners
            rings.append(np.concatenate([places, places[:1]]))
    return rings


def transect_rows(document: dict[str, Any]) -> list[dict[str, Any]]:
    """A row for each transect of a document, by ``COLUMNS``; None where something is not known."""
    return [dict(_cells(each)) for each in document["transects"]]


def _cells(transect: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    low, high = transect["ci95"] or (None, None)
    named = {"std_m": transect["std"], "ci95_low_m": low, "ci95_high_m": high, "wetted_std_m": transect["wetted_std"]}
    yield from ((name, transect.get(name)) for name in COLUMNS[:12] if name not in named)
    yield from named.items()
    for row, side in enumerate(SIDES):
        place = transect["geo"][row] if transect["geo"] else {"lat_deg": None, "lon_deg": None}
        u, v = transect[side] or (None, None)
        yield from ((f"{side}_lat", place["lat_deg"]), (f"{side}_lon", place["lon_deg"]))
        yield from ((f"{side}_u", u), (f"{side}_v", v), (f"{side}_std_px", transect["bank_std_px"][row]))


def transect_map(document: dict[str, Any], sample: PoseSample) -> dict[str, Any]:
    """The measured transects as GeoJSON lines with the columns of their rows; without a place in local metres."""
    features = []
    for each, row in zip(document["transects"], transect_rows(document), strict=True):
        if each["points_enu_m"] is not None:
            places = _places(sample, np.array(each["points_enu_m"])[:, :2])
            geometry = {"type": "LineString", "coordinates": places}
            features.append({"type": "Feature", "properties": row, "geometry": geometry})
    head = _LOCAL if sample.origin is None else {"type": "FeatureCollection"}
    return {**head, "features": features}


def write_river(folder: Path, document: dict[str, Any], found: River, view: RiverView) -> None:
    """Write result.json, transects.csv, a map, plate.png, probability.png and water.png, and name them in the document.

    Raises:
        InputError: The folder cannot be written.
    """
    image = view.pixels()
    with _writing_river(folder, document, map_of_still(document, found, view), ("probability.png", "water.png")):
        draw_plate(folder / "plate.png", document, found, image, view)
        (folder / "probability.png").write_bytes(_grey_png(found.water.probability, image))
        (folder / "water.png").write_bytes(_grey_png(found.water.water, image))


def write_reach(folder: Path, document: dict[str, Any], found: Reach, images: RiverImages) -> None:
    """Write result.json, transects.csv, a map and plate.png; enters their names into the document.

    Raises:
        InputError: The folder cannot be written, or the image of the plate cannot be read.
    """
    with _writing_river(folder, document, map_of_reach(document, found, images.views[0].sample)):
        draw_reach_plate(folder / "plate.png", document, found, images)


@contextmanager
def _writing_river(
    folder: Path, document: dict[str, Any], drawn: tuple[str, dict[str, Any]], more: tuple[str, ...] = ()
) -> Iterator[None]:
    """A folder with what every river has but for its plate, which is to be drawn, and what ``more`` names.

    Raises:
        InputError: It cannot be written.
    """
    map_name, on_map = drawn
    names = ("result.json", "transects.csv", map_name, "plate.png", *more)
    document["files"] = [str(folder / name) for name in names]
    rows = io.StringIO()
    writer = csv.DictWriter(rows, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(transect_rows(document))
    with output_folder(folder, "the river"):
        (folder / "result.json").write_bytes(orjson.dumps(document, option=_JSON))
        (folder / "transects.csv").write_text(rows.getvalue(), encoding="utf-8")
        (folder / map_name).write_bytes(orjson.dumps(on_map, option=_JSON))
        yield
    if on_map.keys() >= _LOCAL.keys():
        _LOG.warning("no `lat_deg` and `lon_deg`: the map is river_local.json, in metres, in place of river.geojson")


def check_folder(folder: Path | None) -> None:
    """Refuse a folder that cannot be written to before the work is done for nothing; makes none.

    Raises:
        InputError: It is a file, lies below one, or nobody may write there.
    """
    if folder is None:
        return
    with writable(folder, "the river"):
        there = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
        if not there.is_dir() or not os.access(there, os.W_OK):
            number = errno.EACCES if there.is_dir() else errno.ENOTDIR
            raise OSError(number, os.strerror(number))


def _grey_png(share: npt.NDArray[Any], image: ImageArray) -> bytes:
    """Grey of the image's size of a small copy's shares of water: white where it is water, black where it is land."""
    size = image.shape[1], image.shape[0]
    grey = cv2.resize(np.rint(255.0 * share).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return bytes(cv2.imencode(".png", grey)[1])
