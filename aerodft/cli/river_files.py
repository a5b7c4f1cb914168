"""The folder that ``aerodft river`` writes: document, table, map (GeoJSON in WGS84, or in metres) and plate."""

import csv
import errno
import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from aerodft.adapters.atomic_file import output_folder, writable
from aerodft.cli.output import json_bytes, say
from aerodft.cli.river_document import SIDES
from aerodft.cli.river_plate import draw_plate, draw_reach_plate
from aerodft.cli.river_views import Views
from aerodft.dft import Setup
from aerodft.geometry import lat_lon
from aerodft.model import FloatArray, ImageArray, PoseSample
from aerodft.vision.river import Reach, River, WaterPlane, ground_of, water_likeness

COLUMNS: Final = (
    "station_m", "status", "width_m", "std_m", "ci95_low_m", "ci95_high_m", "bound",
    "wetted_m", "wetted_std_m", "channels", "images", "scatter_m",
    "left_lat", "left_lon", "right_lat", "right_lon",
    "left_u", "left_v", "right_u", "right_v", "left_std_px", "right_std_px",
)  # fmt: skip
"""Empty where not known: pixels are of one image, scatter is of several, places are of a known station."""

_LOCAL: Final = {"schema": "aerodft.river_local/1", "unit": "m", "axes": "east, north, as points_enu_m"}
_FACTS: Final = ("station_m", "width_m", "std", "ci95", "wetted_m", "channels", "images")


@dataclass(frozen=True, slots=True)
class RiverMap:
    """A file for the map.

    Attributes:
        name: Of the file.
        document: What it holds.
        note: What a person should be told about it; empty for nothing.
    """

    name: str
    document: dict[str, Any]
    note: str = ""


def map_of_still(document: dict[str, Any], found: River, setup: Setup, sample: PoseSample) -> RiverMap:
    """Centreline, banks, transects and water of one image."""
    assert sample.pose is not None  # noqa: S101 - what was measured has a pose, for the type checker
    plane = WaterPlane(setup.camera, sample.pose, setup.elevation_m, setup.max_range_m)
    banks = []
    for side in range(2):
        pixels = found.edges.pixels_px[:, side]
        bank = plane.places_en_m(pixels[np.isfinite(pixels[:, 0])])
        banks.append(bank[np.isfinite(bank[:, 0])])
    return _map(document, found.line.places_en_m, banks, _outline(plane, found), sample)


def map_of_reach(document: dict[str, Any], found: Reach, sample: PoseSample) -> RiverMap:
    """Centreline, banks, transects and the water between them, of many images."""
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
) -> RiverMap:
    features = [_line("centreline", _places(sample, line_en_m), {"width_m": document["width_m"]})]
    for side, bank in zip(SIDES, banks_en_m, strict=True):
        features.append(_line(f"bank-{side}", _places(sample, bank), {}))
    for each in document["transects"]:
        if each["points_enu_m"] is not None:
            ends = np.array(each["points_enu_m"])[:, :2]
            features.append(_line("transect", _places(sample, ends), {name: each[name] for name in _FACTS}))
    if rings_en_m:
        geometry = {"type": "Polygon", "coordinates": [_places(sample, ring) for ring in rings_en_m]}
        features.append({"type": "Feature", "properties": {"name": "water"}, "geometry": geometry})
    kept = [each for each in features if each is not None]
    if sample.origin is None:
        note = "no --lat and --lon: the map is river_local.json, in metres, in place of river.geojson"
        return RiverMap("river_local.json", {**_LOCAL, "features": kept}, note)
    return RiverMap("river.geojson", {"type": "FeatureCollection", "features": kept})


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
        places = plane.places_en_m(found.features.to_image(outlines[index][:, 0].astype(np.float64)))
        places = places[np.isfinite(places[:, 0])]
        if len(places) > 2:  # noqa: PLR2004 - a ring has three corners
            rings.append(np.concatenate([places, places[:1]]))
    return rings


def table(document: dict[str, Any]) -> str:
    """A row for each transect of a document."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(dict(_cells(each)) for each in document["transects"])
    return text.getvalue()


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


def write_river(
    folder: Path, document: dict[str, Any], found: River, image: ImageArray, setup: Setup, sample: PoseSample
) -> None:
    """Write result.json, transects.csv, a map, plate.png and likeness.png; enters their names into the document.

    Raises:
        InputError: The folder cannot be written.
    """
    with _writing_river(folder, document, map_of_still(document, found, setup, sample), ("likeness.png",)):
        draw_plate(folder / "plate.png", document, found, image, setup, sample)
        (folder / "likeness.png").write_bytes(_likeness(found, setup, sample, image.shape[:2]))


def write_reach(folder: Path, document: dict[str, Any], found: Reach, views: Views) -> None:
    """Write result.json, transects.csv, a map and plate.png; enters their names into the document.

    Raises:
        InputError: The folder cannot be written, or the image of the plate cannot be read.
    """
    with _writing_river(folder, document, map_of_reach(document, found, views.views[0].sample)):
        draw_reach_plate(folder / "plate.png", document, found, views)


@contextmanager
def _writing_river(
    folder: Path, document: dict[str, Any], drawn: RiverMap, more: tuple[str, ...] = ()
) -> Iterator[None]:
    """A folder with what every river has but for its plate, which is to be drawn, and what ``more`` names.

    Raises:
        InputError: It cannot be written.
    """
    names = ("result.json", "transects.csv", drawn.name, "plate.png", *more)
    document["files"] = [str(folder / name) for name in names]
    with output_folder(folder, "the river"):
        (folder / "result.json").write_bytes(json_bytes(document))
        (folder / "transects.csv").write_text(table(document), encoding="utf-8")
        (folder / drawn.name).write_bytes(json_bytes(drawn.document))
        yield
    if drawn.note:
        say(f"aerodft: {drawn.note}")


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


def _likeness(found: River, setup: Setup, sample: PoseSample, size: tuple[int, ...]) -> bytes:
    """Grey of the image's size: white where a pixel looks like the water, black where it looks like land."""
    assert sample.pose is not None  # noqa: S101 - what was measured has a pose, for the type checker
    plane = WaterPlane(setup.camera, sample.pose, setup.elevation_m, setup.max_range_m)
    share = water_likeness(found.features.planes, found.water.water, ground_of(plane, found.features))
    grey = cv2.resize(np.rint(255 * share).astype(np.uint8), size[::-1], interpolation=cv2.INTER_NEAREST)
    return bytes(cv2.imencode(".png", grey)[1])
