"""The map that ``aerodft river`` writes: GeoJSON in WGS84; in metres, and not called so, where no place is known."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np

from aerodft.cli.river_document import SIDES
from aerodft.dft.request import Setup
from aerodft.geometry.geodesy import lat_lon
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import PoseSample
from aerodft.vision.river import River
from aerodft.vision.river_reach import Reach
from aerodft.vision.water_plane import WaterPlane

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
