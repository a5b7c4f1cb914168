"""The plate of ``aerodft river``: the image with banks and transects, the same from above, and the width's profile."""

from pathlib import Path
from typing import Any, Final

import cv2
import matplotlib as mpl
import numpy as np

from aerodft.dft.orthophoto import Sampling, TopView, top_view
from aerodft.dft.request import Setup
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.pose import PoseSample
from aerodft.vision.river import River, RiverStatus
from aerodft.vision.water_plane import WaterPlane

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

_WIDTH_IN, _DPI = 12.0, 110
_MOST_VIEW_PX: Final = 500_000
_LEFT, _RIGHT, _ACROSS, _UNUSED = "#ff3030", "#ffd000", "#00e5ff", "#b0b0b0"
_MOST_LINES: Final = 120  # a plate has no room for more


def draw_plate(
    path: Path, document: dict[str, Any], found: River, image: ImageArray, setup: Setup, sample: PoseSample
) -> None:
    """Draw a plate as PNG."""
    figure = plt.figure(figsize=(_WIDTH_IN, 10.0), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[1.25, 1.0])
    _annotated(figure.add_subplot(grid[0, :]), found, image)
    _from_above(figure.add_subplot(grid[1, 0]), found, image, setup, sample)
    _profile(figure.add_subplot(grid[1, 1]), document)
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)


def _annotated(axes: Axes, found: River, image: ImageArray) -> None:
    axes.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), interpolation="antialiased")
    pixels = found.edges.pixels_px
    for row in range(0, len(pixels), max(1, len(pixels) // _MOST_LINES)):
        color = _ACROSS if found.status[row] is RiverStatus.OK else _UNUSED
        axes.plot(*pixels[row].T, color=color, linewidth=0.6, alpha=0.8)
    for side, color in enumerate((_LEFT, _RIGHT)):
        axes.plot(*pixels[:, side].T, color=color, linewidth=1.4, label=("left bank", "right bank")[side])
    axes.set_xlim(-0.5, image.shape[1] - 0.5)
    axes.set_ylim(image.shape[0] - 0.5, -0.5)
    axes.legend(loc="upper right", fontsize="small")
    axes.set_title("banks and transects in the image; grey transects are not used")


def _from_above(axes: Axes, found: River, image: ImageArray, setup: Setup, sample: PoseSample) -> None:
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
    for row in range(0, len(banks), max(1, len(banks) // _MOST_LINES)):
        if found.status[row] is RiverStatus.OK:
            axes.plot(*banks[row].T, color=_ACROSS, linewidth=0.5, alpha=0.8)
    for side, color in enumerate((_LEFT, _RIGHT)):
        axes.plot(*banks[:, side].T, color=color, linewidth=1.2)
    axes.plot(*found.line.places_en_m.T, color="white", linewidth=0.8, linestyle="--")
    low, high = _box(banks, places)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
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


def _profile(axes: Axes, document: dict[str, Any]) -> None:
    used = [each for each in document["transects"] if each["status"] == "ok"]
    if used:
        rows = np.array([(each["station_m"], each["width_m"], *each["ci95"]) for each in used])
        axes.fill_between(rows[:, 0], rows[:, 2], rows[:, 3], alpha=0.3, label="95 % interval")
        axes.plot(rows[:, 0], rows[:, 1], ".-", markersize=3, linewidth=0.8, label="width")
        width = document["width_m"]
        axes.axhline(width["median"], color="black", linewidth=0.8)
        low, high = width["ci95"]
        axes.set_title(f"median {width['median']:.2f} m, {low:.2f} to {high:.2f} m (95 %)")
        axes.legend(loc="best", fontsize="small")
    axes.set_xlabel("along the river (m)")
    axes.set_ylabel("width (m)")
    axes.grid(alpha=0.3)
