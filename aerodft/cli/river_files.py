"""The folder that ``aerodft river`` writes: its document, a table, maps and a plate."""

import csv
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import orjson

from aerodft.cli.river_plate import draw_plate
from aerodft.dft.points import to_ground_frame
from aerodft.dft.request import Setup
from aerodft.errors import InputError
from aerodft.geometry.geodesy import lat_lon
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.pose import PoseSample
from aerodft.vision.river import River, ground_of
from aerodft.vision.water_likeness import water_likeness
from aerodft.vision.water_plane import WaterPlane

_COLUMNS = (
    "station_m", "width_m", "std_m", "ci95_low_m", "ci95_high_m", "status", "wetted_m", "channels",
    "left_u", "left_v", "right_u", "right_v",
    "left_std_px", "right_std_px", "left_lat", "left_lon", "right_lat", "right_lon",
)  # fmt: skip


def write_river(
    folder: Path, document: dict[str, Any], found: River, image: ImageArray, setup: Setup, sample: PoseSample
) -> None:
    """Write result.json, transects.csv, river.geojson and plate.png; enters their names into the document.

    Raises:
        InputError: The folder cannot be written.
    """
    names = ["result.json", "transects.csv", "river.geojson", "plate.png", "likeness.png"]
    document["files"] = [str(folder / name) for name in names]
    with writing(folder):
        (folder / names[0]).write_bytes(as_json(document))
        (folder / names[1]).write_text(_table(document), encoding="utf-8")
        (folder / names[2]).write_bytes(as_json(_map(document, found, setup, sample)))
        draw_plate(folder / names[3], document, found, image, setup, sample)
        (folder / names[4]).write_bytes(_likeness(found, setup, sample, image.shape[:2]))


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """A folder, made, to be written to.

    Raises:
        InputError: It cannot be.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise InputError(
            "the river cannot be written", where=folder, got=error.strerror or error, expected="a folder to write to"
        ) from error


def as_json(document: dict[str, Any]) -> bytes:
    """A file's bytes."""
    return orjson.dumps(document, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)


def _likeness(found: River, setup: Setup, sample: PoseSample, size: tuple[int, ...]) -> bytes:
    """Grey of the image's size: white where a pixel looks like the water, black where it looks like land."""
    assert sample.pose is not None  # noqa: S101 - what was measured has a pose, for the type checker
    plane = WaterPlane(setup.camera, sample.pose, setup.elevation_m, setup.max_range_m)
    share = water_likeness(found.features.planes, found.water.water, ground_of(plane, found.features))
    grey = cv2.resize(np.rint(255 * share).astype(np.uint8), size[::-1], interpolation=cv2.INTER_NEAREST)
    return bytes(cv2.imencode(".png", grey)[1])


def _table(document: dict[str, Any]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for each in document["transects"]:
        places = each["geo"] or [{"lat": None, "lon": None}] * 2
        ends = [*(each["left"] or (None, None)), *(each["right"] or (None, None))]
        interval = each["ci95"] or (None, None)
        row = [
            each["station_m"],
            each["width_m"],
            each["std"],
            *interval,
            each["status"],
            each["wetted_m"],
            each["channels"],
            *ends,
            *each["bank_std_px"],
        ]
        writer.writerow([*row, *(place[key] for place in places for key in ("lat", "lon"))])
    return text.getvalue()


def _map(document: dict[str, Any], found: River, setup: Setup, sample: PoseSample) -> dict[str, Any]:
    """GeoJSON in WGS84 where the place is known, else in the ground frame."""
    assert sample.pose is not None  # noqa: S101 - what was measured has a pose, for the type checker
    plane = WaterPlane(setup.camera, sample.pose, setup.elevation_m, setup.max_range_m)
    features = [line_feature("centreline", places_of(sample, found.line.places_en_m), {"width_m": document["width_m"]})]
    for index, side in enumerate(("left", "right")):
        pixels = found.edges.pixels_px[:, index]
        bank = plane.places_en_m(pixels[np.isfinite(pixels[:, 0])])
        features.append(line_feature(f"bank-{side}", places_of(sample, bank[np.isfinite(bank[:, 0])]), {}))
    for each in document["transects"]:
        if each["status"] == "ok":
            points = np.array(each["points_enu_m"])[:, :2]
            facts = {key: each[key] for key in ("station_m", "width_m", "std", "ci95")}
            features.append(line_feature("transect", places_of(sample, points), facts))
    features.append(_water(plane, found, sample))
    return feature_collection(features, sample)


def feature_collection(features: Sequence[dict[str, Any] | None], sample: PoseSample) -> dict[str, Any]:
    """A GeoJSON document; says where its coordinates are not WGS84."""
    document = {"type": "FeatureCollection", "features": [each for each in features if each is not None]}
    if sample.origin is None:
        document["coordinates"] = "ground frame: X right, Y ahead of the camera, m"
    return document


def places_of(sample: PoseSample, points_en_m: FloatArray) -> list[list[float]]:
    """Longitude and latitude, degrees, of points ``(n, 2)``; the camera's ground frame where no place is known."""
    if sample.origin is not None:
        places: list[list[float]] = np.degrees(lat_lon(sample.origin, points_en_m))[:, ::-1].tolist()
        return places
    assert sample.pose is not None  # noqa: S101 - what was measured has a pose, for the type checker
    points = np.concatenate([points_en_m, np.zeros((len(points_en_m), 1))], axis=-1)
    local: list[list[float]] = to_ground_frame(sample.pose, points)[:, :2].tolist()
    return local


def line_feature(name: str, places: list[list[float]], properties: dict[str, Any]) -> dict[str, Any] | None:
    """A GeoJSON line; None where there is none to draw."""
    if len(places) < 2:  # noqa: PLR2004 - a line has two ends
        return None
    geometry = {"type": "LineString", "coordinates": places}
    return {"type": "Feature", "properties": {"name": name, **properties}, "geometry": geometry}


def _water(plane: WaterPlane, found: River, sample: PoseSample) -> dict[str, Any] | None:
    """The water's outline with its islands as holes, as coarse as the small copy has it."""
    mask = found.water.water.astype(np.uint8)
    outlines, levels = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    rings: list[list[list[float]]] = []
    order = sorted(range(len(outlines)), key=lambda index: int(levels[0][index][3] >= 0))
    for index in order:
        places = plane.places_en_m(found.features.to_image(outlines[index][:, 0].astype(np.float64)))
        places = places[np.isfinite(places[:, 0])]
        if len(places) > 2:  # noqa: PLR2004 - a ring has three corners
            ring = places_of(sample, places)
            rings.append([*ring, ring[0]])
    if not rings:
        return None
    geometry = {"type": "Polygon", "coordinates": rings}
    return {"type": "Feature", "properties": {"name": "water"}, "geometry": geometry}
