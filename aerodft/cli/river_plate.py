"""The plate of ``aerodft river``: the image with banks and transects, the same from above, and the width's profile."""

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from matplotlib.axes import Axes

from aerodft.cli.river_panels import (
    ACROSS,
    LEFT,
    MOST_LINES,
    RIGHT,
    as_map,
    blank_plate,
    draw_image,
    draw_profile,
    save_plate,
    value_of,
)
from aerodft.dft.orthophoto import Sampling, TopView, top_view
from aerodft.dft.request import Setup
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray
from aerodft.model.pose import PoseSample
from aerodft.vision.river import River, RiverStatus
from aerodft.vision.water_plane import WaterPlane

_HEIGHT_IN: Final = 10.0
_MOST_VIEW_PX: Final = 500_000


def draw_plate(
    path: Path, document: dict[str, Any], found: River, image: ImageArray, setup: Setup, sample: PoseSample
) -> None:
    """Draw a plate as PNG."""
    figure = blank_plate(_HEIGHT_IN)
    grid = figure.add_gridspec(2, 2, height_ratios=[1.25, 1.0])
    used = np.array([status is RiverStatus.OK for status in found.status], dtype=bool)
    picture = figure.add_subplot(grid[0, :])
    draw_image(picture, image, found.edges.pixels_px, used, [value_of(each) for each in document["transects"]])
    picture.set_title("banks and transects in the image; grey transects are not used")
    _from_above(figure.add_subplot(grid[1, 0]), found, used, image, setup, sample)
    draw_profile(figure.add_subplot(grid[1, 1]), document)
    save_plate(figure, path)


def _from_above(axes: Axes, found: River, used: BoolArray, image: ImageArray, setup: Setup, sample: PoseSample) -> None:
    assert sample.pose is not None  # noqa: S101 - what was measured has a pose, for the type checker
    plane = WaterPlane(setup.camera, sample.pose, setup.elevation_m, setup.max_range_m)
    places = found.transects.centres_en_m
    foot = sample.pose.position_enu_m[:2]
    far_m = float(np.hypot(np.linalg.norm(places - foot, axis=-1).max() + found.line.width_m, plane.height_m))
    sampling = Sampling(max_range_m=far_m, most_pixels=_MOST_VIEW_PX)
    view = top_view(image, setup.camera, sample.pose, sampling, elevation_m=setup.elevation_m)
    if view is not None:
        axes.imshow(cv2.cvtColor(view.pixels, cv2.COLOR_BGRA2RGBA), extent=_extent(view), interpolation="antialiased")
    banks = plane.places_en_m(found.edges.pixels_px)
    for row in range(0, len(banks), max(1, len(banks) // MOST_LINES)):
        if used[row]:
            axes.plot(*banks[row].T, color=ACROSS, linewidth=0.5, alpha=0.8)
    for side, color in enumerate((LEFT, RIGHT)):
        axes.plot(*banks[:, side].T, color=color, linewidth=1.2)
    axes.plot(*found.line.places_en_m.T, color="white", linewidth=0.8, linestyle="--")
    low, high = _box(banks, places)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    as_map(axes)
    axes.set_title("from above, on the water's plane")


def _extent(view: TopView) -> tuple[float, float, float, float]:
    height, width = view.pixels.shape[:2]
    east, south = view.west_m + width * view.step_m, view.north_m - height * view.step_m
    return view.west_m, east, south, view.north_m


def _box(banks: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    points = np.concatenate([banks.reshape(-1, 2), places])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    spare = 0.05 * float(np.max(high - low))
    return low - spare, high + spare
