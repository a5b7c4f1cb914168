"""The folder that ``aerodft river`` writes of many images: document, table, map and plate."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from aerodft.cli.river_document import SIDES, outline_confidence
from aerodft.cli.river_files import writing_river
from aerodft.cli.river_map import map_of_reach
from aerodft.cli.river_panels import (
    ACROSS,
    LEFT,
    RIGHT,
    as_map,
    blank_plate,
    draw_image,
    draw_profile,
    save_plate,
    value_of,
)
from aerodft.cli.river_views import Views
from aerodft.vision.river import River
from aerodft.vision.river_reach import Reach
from replay.table import time_utc

_HEIGHT_IN: Final = 14.0
_TO_SECONDS: Final = 19  # characters of a time in ISO 8601


def write_flight(folder: Path, document: dict[str, Any], found: Reach, views: Views) -> None:
    """Write result.json, transects.csv, a map and plate.png; enters their names into the document.

    Raises:
        InputError: The folder cannot be written, or the image of the plate cannot be read.
    """
    with writing_river(folder, document, map_of_reach(document, found, views.views[0].sample)):
        _draw(folder / "plate.png", document, found, views)


def _draw(path: Path, document: dict[str, Any], found: Reach, views: Views) -> None:
    figure = blank_plate(_HEIGHT_IN)
    grid = figure.add_gridspec(3, 2, height_ratios=[1.4, 1.1, 0.9])
    _best_image(figure.add_subplot(grid[0, :]), document, found, views)
    _from_above(figure.add_subplot(grid[1, :]), found)
    draw_profile(figure.add_subplot(grid[2, 0]), document)
    _drift(figure.add_subplot(grid[2, 1]), document, views)
    save_plate(figure, path)


def _best_image(axes: Axes, document: dict[str, Any], found: Reach, views: Views) -> None:
    """The image that tells most transects; its banks, and the widths that all images tell."""
    rivers = [(row, look) for row, look in enumerate(found.looks) if isinstance(look, River)]
    row, look = max(rivers, key=lambda each: (np.count_nonzero(each[1].used), outline_confidence(each[1].water)))
    used = np.zeros(len(found.stations_m), dtype=bool)
    used[look.rows[look.used]] = True
    values = [value_of(each) for each in document["transects"]]
    draw_image(axes, views.views[row].pixels(), look.edges.pixels_px, used, values)
    axes.set_title(
        f"image {views.views[row].index} tells {np.count_nonzero(used)} of {len(used)} transects; the widths beside"
        f" them are of all {document['images']['used']} images"
    )


def _from_above(axes: Axes, found: Reach) -> None:
    points = found.found.widths.points_enu_m[found.found.images > 0]
    for ends in points:
        axes.plot(*ends[:, :2].T, color=ACROSS, linewidth=0.6, alpha=0.6)
    for side, color in enumerate((LEFT, RIGHT)):
        axes.plot(*points[:, side, :2].T, color=color, linewidth=1.3, label=f"{SIDES[side]} bank")
    axes.plot(*found.line.places_en_m.T, color="black", linewidth=0.8, linestyle="--", label="centreline")
    axes.set_aspect("equal", adjustable="datalim")
    as_map(axes)
    axes.set_title("banks and transects of all images, from above")
    axes.legend(loc="best", fontsize="small")


def _drift(axes: Axes, document: dict[str, Any], views: Views) -> None:
    known = [each for each in document["images"]["each"] if each["drift"] is not None]
    axes.plot([each["since_s"] for each in known], [100 * each["drift"] for each in known], ".-", linewidth=0.8)
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_title("one image's widths against those of all")
    axes.xaxis.set_major_locator(MaxNLocator(7))
    start = f"{time_utc(views.views[0].sample.stamp_ns)[:_TO_SECONDS]} UTC" if views.is_utc else "the first image"
    axes.set_xlabel(f"s since {start}")
    axes.set_ylabel("larger by (%)")
    axes.grid(alpha=0.3)
