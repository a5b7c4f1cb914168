"""A river over a flight: found in every image, put together on the map, measured where it stays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.dft.reach_widths import ReachWidths, SeenWidths, fuse
from aerodft.dft.request import Setup
from aerodft.dft.river_widths import RiverWidths
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.pose import Pose
from aerodft.vision.reach import WaterView, reach_line, seed_on
from aerodft.vision.reach_islands import common_islands
from aerodft.vision.river import (
    NoRiver,
    River,
    RiverQuestion,
    RiverStatus,
    channel_of,
    find_river,
    oriented,
    river_across,
    stations_along,
)
from aerodft.vision.river_banks import Islands
from aerodft.vision.water_motion import LaterLook
from aerodft.vision.water_plane import WaterPlane
from aerodft.vision.waterway import Centreline, looked_up

_ONCE_M: Final = 1e4  # apart: one transect tells whether there is a river


@dataclass(frozen=True, slots=True, eq=False)
class ReachView:
    """One image of a flight, or of a fixed camera.

    Attributes:
        setup: As for ``find_river``.
        pose: Its pose; all views in one ENU frame.
        pixels: Reads the image, ``(height, width, 3)`` BGR.
        later: The same place soon afterwards, where there is such an image.
    """

    setup: Setup
    pose: Pose
    pixels: Callable[[], ImageArray]
    later: LaterLook | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """A river as all images show it.

    Attributes:
        line: Its centreline, in the direction in which left and right are meant.
        stations_m: ``(n,)`` of its transects, along the line.
        found: Their widths.
        islands: What is dry between their banks.
        looks: What each view tells of the transects, or why it tells nothing.
    """

    line: Centreline
    stations_m: FloatArray
    found: ReachWidths
    islands: Islands
    looks: tuple[River | NoRiver, ...]


def measure_reach(
    views: Sequence[ReachView], question: RiverQuestion, advance: Callable[[int], None] = lambda _: None
) -> Reach | NoRiver:
    """Measure a river over many images.

    Args:
        views: At least one. Each is read twice: to find the water, and then to find the banks of the transects that all
            have in common.
        question: What is asked; its seed is of every image, where there is one.
        advance: Told after each look how many there were.
    """
    rough = replace(question, spacing_m=_ONCE_M)
    looks: list[River | NoRiver] = []
    for view in views:
        looks.append(_slim(find_river(view.pixels(), view.setup, view.pose, rough, view.later)))
        advance(len(looks))
    waters = [_water(view, look) for view, look in zip(views, looks, strict=True) if isinstance(look, River)]
    line = reach_line(waters) if waters else None
    if line is None:
        return _most_said([look for look in looks if isinstance(look, NoRiver)])
    line = oriented(_plane(views[0]), line, question.flow_rad)
    for row, view in enumerate(views):
        looks[row] = _looked_across(view, looks[row], line, question, rough)
        advance(len(views) + row + 1)
    stations = stations_along(line, question.spacing_m)
    found = fuse([_usable(look) for look in looks], len(stations))
    if not np.any(found.images):
        return _most_said([look for look in looks if isinstance(look, NoRiver)])
    islands = common_islands([look for look in looks if isinstance(look, River)], len(stations))
    return Reach(line=line, stations_m=stations, found=found, islands=islands, looks=tuple(looks))


def _plane(view: ReachView) -> WaterPlane:
    return WaterPlane(view.setup.camera, view.pose, view.setup.elevation_m, view.setup.max_range_m)


def _slim(look: River | NoRiver) -> River | NoRiver:
    """Without what only finding the water needs: a flight has many images."""
    return look if isinstance(look, NoRiver) else replace(look, features=look.features.without_planes())


def _water(view: ReachView, look: River) -> WaterView:
    plane = _plane(view)
    return WaterView(plane, look.features, channel_of(plane, look), look.line.width_m)


def _looked_across(
    view: ReachView, look: River | NoRiver, line: Centreline, question: RiverQuestion, rough: RiverQuestion
) -> River | NoRiver:
    """The reach's transects in one image, whose water is looked for anew where it is not that of the reach."""
    plane, image = _plane(view), view.pixels()
    seed = seed_on(line, plane)
    if seed is None:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "the image does not show the reach")
    if isinstance(look, NoRiver) or not looked_up(look.water.water, look.features.to_small(np.array([seed])))[0]:
        look = _slim(find_river(image, view.setup, view.pose, replace(rough, seed_px=seed), view.later))
    if isinstance(look, NoRiver):
        return look
    return river_across(image, view.setup, view.pose, question, look, line)


def _usable(look: River | NoRiver) -> SeenWidths:
    if isinstance(look, NoRiver):
        nothing = RiverWidths(np.empty(0), np.empty((0, 0)), np.empty(0), np.empty(0), np.empty((0, 2, 3)))
        return SeenWidths(np.empty(0, dtype=np.int64), nothing)
    return SeenWidths(look.rows[look.used], look.widths.taken(look.used))


def _most_said(refusals: Sequence[NoRiver]) -> NoRiver:
    """What most images are refused for."""
    if not refusals:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "nowhere are both banks in view")
    said = [each.status for each in refusals]
    return max(refusals, key=lambda each: said.count(each.status))
