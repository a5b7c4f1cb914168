"""The folder that ``aerodft river`` writes of many images: document, table, map and plate."""

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np

from aerodft.cli.river_files import as_json, feature_collection, line_feature, places_of, writing
from aerodft.conventions import SECOND_NS
from aerodft.model.pose import PoseSample
from aerodft.vision.river_reach import Reach
from replay.table import time_utc

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

_COLUMNS: Final = ("station_m", "width_m", "std", "ci95_low", "ci95_high", "scatter_m", "images", "status")
_LEFT, _RIGHT, _ACROSS = "#ff3030", "#d0a000", "#00a0b0"
_SIZE_IN, _DPI = (12.0, 10.0), 110
_SIDES: Final = ("left", "right")


def write_flight(folder: Path, document: dict[str, Any], found: Reach, origin: PoseSample) -> None:
    """Write result.json, transects.csv, river.geojson and plate.png; enters their names into the document.

    Raises:
        InputError: The folder cannot be written.
    """
    names = ["result.json", "transects.csv", "river.geojson", "plate.png"]
    document["files"] = [str(folder / name) for name in names]
    with writing(folder):
        (folder / names[0]).write_bytes(as_json(document))
        (folder / names[1]).write_text(_table(document), encoding="utf-8")
        (folder / names[2]).write_bytes(as_json(_map(document, found, origin)))
        _draw(folder / names[3], document, found)


def _table(document: dict[str, Any]) -> str:
    lines = [",".join((*_COLUMNS, *(f"{side}_{part}" for side in _SIDES for part in ("lat", "lon"))))]
    for each in document["transects"]:
        low, high = each["ci95"] or (None, None)
        values = each | {"ci95_low": low, "ci95_high": high}
        places = each["geo"] or [{"lat": None, "lon": None}] * 2
        row = [*(values[name] for name in _COLUMNS), *(place[key] for place in places for key in ("lat", "lon"))]
        lines.append(",".join("" if value is None else str(value) for value in row))
    return "\n".join(lines) + "\n"


def _map(document: dict[str, Any], found: Reach, origin: PoseSample) -> dict[str, Any]:
    features = [line_feature("centreline", places_of(origin, found.line.places_en_m), {"width_m": document["width_m"]})]
    points = found.found.widths.points_enu_m[found.found.images > 0]
    for side, name in enumerate(_SIDES):
        features.append(line_feature(f"bank-{name}", places_of(origin, points[:, side, :2]), {}))
    water = np.concatenate([points[:, 0, :2], points[::-1, 1, :2], points[:1, 0, :2]])
    polygon = {"type": "Polygon", "coordinates": [places_of(origin, water)]}
    features.append({"type": "Feature", "properties": {"name": "water"}, "geometry": polygon})
    for each in document["transects"]:
        if each["points_enu_m"] is not None:
            facts = {key: each[key] for key in ("station_m", "width_m", "std", "ci95", "images")}
            ends = np.array(each["points_enu_m"])[:, :2]
            features.append(line_feature("transect", places_of(origin, ends), facts))
    return feature_collection(features, origin)


def _draw(path: Path, document: dict[str, Any], found: Reach) -> None:
    figure = plt.figure(figsize=_SIZE_IN, layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[1.25, 1.0])
    _from_above(figure.add_subplot(grid[0, :]), found)
    _profile(figure.add_subplot(grid[1, 0]), document)
    _drift(figure.add_subplot(grid[1, 1]), document)
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)


def _from_above(axes: Axes, found: Reach) -> None:
    points = found.found.widths.points_enu_m[found.found.images > 0]
    for ends in points:
        axes.plot(*ends[:, :2].T, color=_ACROSS, linewidth=0.6, alpha=0.6)
    for side, color in enumerate((_LEFT, _RIGHT)):
        axes.plot(*points[:, side, :2].T, color=color, linewidth=1.3, label=f"{_SIDES[side]} bank")
    axes.plot(*found.line.places_en_m.T, color="black", linewidth=0.8, linestyle="--", label="centreline")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    axes.set_title("banks and transects of all images, on the map")
    axes.legend(loc="best", fontsize="small")


def _profile(axes: Axes, document: dict[str, Any]) -> None:
    used = [each for each in document["transects"] if each["ci95"] is not None]
    rows = np.array([(each["station_m"], each["width_m"], *each["ci95"]) for each in used])
    axes.fill_between(rows[:, 0], rows[:, 2], rows[:, 3], alpha=0.3, label="95 % interval")
    axes.plot(rows[:, 0], rows[:, 1], ".-", markersize=3, linewidth=0.8, label="width")
    width = document["width_m"]
    low, high = width["ci95"]
    axes.axhline(width["median"], color="black", linewidth=0.8)
    axes.set_title(f"median {width['median']:.2f} m, {low:.2f} to {high:.2f} m (95 %)")
    axes.set_xlabel("along the river (m)")
    axes.set_ylabel("width (m)")
    axes.legend(loc="best", fontsize="small")
    axes.grid(alpha=0.3)


def _drift(axes: Axes, document: dict[str, Any]) -> None:
    known = [each for each in document["images"]["each"] if each["drift"] is not None]
    stamps = np.array([int(each["stamp_ns"]) for each in known], dtype=np.int64)
    axes.plot((stamps - stamps[0]) / SECOND_NS, [100 * each["drift"] for each in known], ".-", linewidth=0.8)
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_title("one image's widths against those of all")
    axes.set_xlabel(f"s since {time_utc(int(stamps[0]))}")
    axes.set_ylabel("larger by (%)")
    axes.grid(alpha=0.3)
