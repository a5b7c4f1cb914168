"""A river's plates: images with banks and transects, the river from above, and the width's profile."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import matplotlib as mpl
import numpy as np

from aerodft.dft.maps import Sampling, TopView, top_view
from aerodft.model import BoolArray, FloatArray, ImageArray
from aerodft.reports.river.document import SIDES, RiverImages, water_confidence
from aerodft.reports.style import BANKS, GREY, OUTLINED, SKY, as_map, draw_widths, second_utc, styled
from aerodft.vision.river import Centreline, Reach, River, RiverStatus, RiverView

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

_HEIGHT_IN: Final = 10.0
_MOST_VIEW_PX: Final = 500_000

ACROSS, UNUSED = SKY, GREY
MOST_LINES: Final = 120
"""Transects that are drawn at the most: a plate has no room for more."""
_VALUE_SHARE: Final = (0.18, 0.055)  # of the image's width and height, that a value takes
_WIDTH_IN, _DPI = 12.0, 110
_FINE_M: Final = 0.05  # half an interval, below which centimetres are shown

_REACH_HEIGHT_IN: Final = 14.0
_FIRST_UTC_NS: Final = 10**17  # a stamp below it counts from something else


def _save_plate(figure: Figure, path: Path) -> None:
    """Write a plate as PNG, and forget it."""
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)


def _draw_image(
    axes: Axes, image: ImageArray, banks_px: FloatArray, used: BoolArray, values: Sequence[str], line: Centreline
) -> None:
    """An image with its banks and transects.

    Args:
        axes: Where to.
        image: ``(height, width, 3)`` BGR.
        banks_px: ``(n, 2, 2)``: left, then right end of each transect; NaN where the image ends first.
        used: ``(n,)``: which transects are measured from; others are grey.
        values: Of each transect, to stand beside it where there is room.
        line: The centreline, which says whether left and right are those of the flow.
    """
    told_by = "by the flow" if line.is_downstream else "guessed: no flow stated"
    axes.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), interpolation="antialiased")
    axes.grid(visible=False)
    for row in range(0, len(banks_px), max(1, len(banks_px) // MOST_LINES)):
        axes.plot(*banks_px[row].T, color=ACROSS if used[row] else UNUSED, linewidth=0.6, alpha=0.8)
    for side, color in enumerate(BANKS):
        label = f"{SIDES[side]} bank, {told_by}"
        axes.plot(*banks_px[:, side].T, color=color, linewidth=1.4, label=label, path_effects=OUTLINED)
    height, width = image.shape[:2]
    for row, end, is_at_right in _with_room(banks_px, used, width, height):
        aside, towards = (6, "left") if is_at_right else (-6, "right")
        box = {"facecolor": "black", "alpha": 0.6, "edgecolor": "none", "pad": 1.5}
        axes.annotate(
            values[row], end, (aside, 0), textcoords="offset points", color="white", fontsize=7, ha=towards,
            va="center", bbox=box, annotation_clip=True,
        )  # fmt: skip
    axes.set_xlim(-0.5, image.shape[1] - 0.5)
    axes.set_ylim(image.shape[0] - 0.5, -0.5)
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, -0.06), ncols=len(BANKS), fontsize="small")  # below the image


def _with_room(
    banks_px: FloatArray, used: BoolArray, width_px: int, height_px: int
) -> Iterator[tuple[int, tuple[float, float], bool]]:
    """Used transects beside which there is room for a value in an image of that size, from the first.

    Yields:
        The transect's index, its end that is farther to the right, and whether the value stands at the right of that:
        at the left where it would leave the image.
    """
    wide, high = _VALUE_SHARE[0] * width_px, _VALUE_SHARE[1] * height_px
    middles: list[tuple[float, float]] = []
    for row in np.flatnonzero(used & np.isfinite(banks_px).all(axis=(1, 2))).tolist():
        u, v = max(banks_px[row].tolist())
        is_at_right = u + wide <= width_px
        middle = u + (wide if is_at_right else -wide) / 2, v
        if all(abs(middle[0] - other) > wide or abs(v - beside) > high for other, beside in middles):
            middles.append(middle)
            yield row, (u, v), is_at_right


def _value_of(transect: dict[str, Any]) -> str:
    """A transect's width with half its 95 % interval; empty where it has none."""
    if transect["ci95"] is None:
        return ""
    low, high = transect["ci95"]
    digits = 1 if high - low >= 2 * _FINE_M else 2
    return f"{transect['width_m']:.{digits}f} ± {(high - low) / 2:.{digits}f} m (95 %)"


def _draw_profile(axes: Axes, document: dict[str, Any]) -> None:
    """Widths along the river with their 95 % band and their median."""
    width = document["width_m"]
    if not width:
        axes.set_title("no transect has a width")
        axes.set_axis_off()
        return
    draw_widths(axes, document["transects"])
    axes.axhline(width["median"], color="black", linewidth=0.8)
    low, high = width["ci95"]
    axes.set_title(f"median {width['median']:.2f} m, {low:.2f} to {high:.2f} m (95 %)")


def _title(view: RiverView, *, is_utc: bool) -> str:
    """Where and when a river was seen, as far as that is known."""
    lat_rad, lon_rad, _ = view.sample.lat_lon_alt
    parts = ["River widths"]
    if lat_rad is not None and lon_rad is not None:
        parts.append(f"camera at {math.degrees(lat_rad):.5f}°, {math.degrees(lon_rad):.5f}° (WGS84)")
    if is_utc:
        parts.append(f"{second_utc(view.sample.stamp_ns)} UTC")
    return ", ".join(parts)


@styled()
def draw_plate(path: Path, document: dict[str, Any], found: River, image: ImageArray, view: RiverView) -> None:
    """Draw a plate as PNG."""
    figure = plt.figure(figsize=(_WIDTH_IN, _HEIGHT_IN), layout="constrained")
    figure.suptitle(_title(view, is_utc=view.sample.stamp_ns >= _FIRST_UTC_NS))
    grid = figure.add_gridspec(2, 2, height_ratios=[1.25, 1.0])
    used = np.array([status is RiverStatus.OK for status in found.status], dtype=bool)
    picture = figure.add_subplot(grid[0, :])
    values = [_value_of(each) for each in document["transects"]]
    _draw_image(picture, image, found.edges.pixels_px, used, values, found.line)
    picture.set_title("banks and transects in the image; grey transects are not used")
    _from_above(figure.add_subplot(grid[1, 0]), found, used, image, view)
    _draw_profile(figure.add_subplot(grid[1, 1]), document)
    _save_plate(figure, path)


def _from_above(axes: Axes, found: River, used: BoolArray, image: ImageArray, view: RiverView) -> None:
    plane, places = view.plane, found.transects.centres_en_m
    foot = view.pose.position_enu_m[:2]
    far_m = float(np.hypot(np.linalg.norm(places - foot, axis=-1).max() + found.line.width_m, plane.height_m))
    sampling = Sampling(max_range_m=far_m, max_pixels=_MOST_VIEW_PX)
    above = top_view(image, view.setup.camera, view.pose, sampling, elevation_m=view.setup.elevation_m)
    if above is not None:
        axes.imshow(cv2.cvtColor(above.pixels, cv2.COLOR_BGRA2RGBA), extent=_extent(above), interpolation="antialiased")
    banks = plane.places_en_m(found.edges.pixels_px)
    for row in range(0, len(banks), max(1, len(banks) // MOST_LINES)):
        if used[row]:
            axes.plot(*banks[row].T, color=ACROSS, linewidth=0.5, alpha=0.8)
    for side, color in enumerate(BANKS):
        axes.plot(*banks[:, side].T, color=color, linewidth=1.2, path_effects=OUTLINED)
    line_en_m = found.line.places_en_m
    is_seen = plane.in_view(line_en_m, plane.pixels_px(line_en_m))
    axes.plot(*np.where(is_seen[:, None], line_en_m, np.nan).T, color="white", linewidth=0.8, path_effects=OUTLINED)
    as_map(axes, [banks.reshape(-1, 2), places])
    axes.set_title("from above, on the water's plane")


def _extent(view: TopView) -> tuple[float, float, float, float]:
    height, width = view.pixels.shape[:2]
    east, south = view.west_m + width * view.step_m, view.north_m - height * view.step_m
    return view.west_m, east, south, view.north_m


@styled()
def draw_reach_plate(path: Path, document: dict[str, Any], found: Reach, images: RiverImages) -> None:
    """Draw the plate of many images as PNG."""
    figure = plt.figure(figsize=(_WIDTH_IN, _REACH_HEIGHT_IN), layout="constrained")
    figure.suptitle(_title(images.views[0], is_utc=images.is_utc))
    grid = figure.add_gridspec(3, 2, height_ratios=[1.4, 1.1, 0.9])
    _best_image(figure.add_subplot(grid[0, :]), document, found, images)
    _reach_from_above(figure.add_subplot(grid[1, :]), found)
    _draw_profile(figure.add_subplot(grid[2, 0]), document)
    _drift(figure.add_subplot(grid[2, 1]), document, images)
    _save_plate(figure, path)


def _best_image(axes: Axes, document: dict[str, Any], found: Reach, images: RiverImages) -> None:
    """The image that tells most transects; its banks, and the widths that all images tell."""
    rivers = [(row, look) for row, look in enumerate(found.looks) if isinstance(look, River)]
    row, look = max(rivers, key=lambda each: (np.count_nonzero(each[1].used), water_confidence(each[1].water)))
    used = np.zeros(len(found.stations_m), dtype=bool)
    used[look.rows[look.used]] = True
    values = [_value_of(each) for each in document["transects"]]
    _draw_image(axes, images.views[row].pixels(), look.edges.pixels_px, used, values, found.line)
    axes.set_title(
        f"image {images.views[row].index} tells {np.count_nonzero(used)} of {len(used)} transects; the widths beside"
        f" them are of all {document['images']['used']} images"
    )


def _reach_from_above(axes: Axes, found: Reach) -> None:
    points = found.found.widths.points_enu_m[found.found.images > 0]
    for ends in points:
        axes.plot(*ends[:, :2].T, color=ACROSS, linewidth=0.6, alpha=0.6)
    for side, color in enumerate(BANKS):
        axes.plot(*points[:, side, :2].T, color=color, linewidth=1.3, path_effects=OUTLINED)
    axes.plot(*found.line.places_en_m.T, color="black", linewidth=0.8, linestyle="--", label="centreline")
    as_map(axes, [points[..., :2].reshape(-1, 2), found.line.places_en_m])
    axes.set_title("banks and transects of all images, from above")
    axes.legend(loc="best", fontsize="small")


def _drift(axes: Axes, document: dict[str, Any], images: RiverImages) -> None:
    known = [each for each in document["images"]["each"] if each["drift"] is not None]
    axes.plot([each["since_s"] for each in known], [100 * each["drift"] for each in known], ".-", linewidth=0.8)
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_title("one image's widths against those of all")
    axes.xaxis.set_major_locator(MaxNLocator(7))
    start = f"{second_utc(images.views[0].sample.stamp_ns)} UTC" if images.is_utc else "the first image"
    axes.set_xlabel(f"s since {start}")
    axes.set_ylabel("larger by (%)")
    axes.grid(alpha=0.3)
