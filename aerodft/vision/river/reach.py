"""A river over a flight, or over a video: one reach, whose transects are measured in every image that shows them.

Every image votes for each place that it shows. What most of them hold to be water is the reach, with one centreline;
its transects are then looked up in every image, so that widths of several images are of the same places.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import cv2
import numpy as np

from aerodft.dft import ImageWidths, ReachWidths, RiverWidths, Setup, fuse_widths
from aerodft.model import BoolArray, FloatArray, ImageArray, IntArray, Pose, PoseSample
from aerodft.vision.river.banks import Islands
from aerodft.vision.river.centreline import Centreline, WaterMap, middle_line, sample_mask
from aerodft.vision.river.find import (
    River,
    RiverQuestion,
    find_river,
    oriented,
    river_across,
    stations_along,
)
from aerodft.vision.river.status import NoRiver, RiverStatus
from aerodft.vision.river.water import LaterLook, RiverHints, SmallCopy, WaterPlane, with_islands

_CELLS_ACROSS: Final = 24.0  # of the river's width
_MOST_CELLS: Final = 4_000_000
_PAD_CELLS: Final = 3
_GAP: Final = np.ones((13, 13), dtype=np.uint8)  # cells
_OUTLINE: Final = 7  # every so many pixels of a mask tell how far it reaches
_ONCE_M: Final = 1e4  # apart: one transect tells whether there is a river


@dataclass(frozen=True, slots=True, eq=False)
class WaterView:
    """The water of one image, on its plane.

    Attributes:
        plane: As the image shows it.
        copy: The small copy that the mask is of.
        channel: ``(height, width)``: the water with its islands.
        ground: ``(height, width)``: what was looked at.
        width_m: Of the channel, roughly.
    """

    plane: WaterPlane
    copy: SmallCopy
    channel: BoolArray
    ground: BoolArray
    width_m: float


class _Votes:
    """Counts, for every place, of the images that show it, and of those that show water there.

    Args:
        views: At least one; their planes in one ENU frame.
    """

    def __init__(self, views: Sequence[WaterView]) -> None:
        places = np.concatenate([_places(view) for view in views])
        low, high = places.min(axis=0), places.max(axis=0)
        extent = np.maximum(high - low, 1e-3)
        fine_m = float(np.median([view.width_m for view in views])) / _CELLS_ACROSS
        self._step_m = max(fine_m, float(np.sqrt(np.prod(extent) / _MOST_CELLS)))
        self._west_north = np.array([low[0], high[1]]) + self._step_m * _PAD_CELLS * np.array([-1.0, 1.0])
        columns, rows = (int(np.ceil(each / self._step_m)) + 2 * _PAD_CELLS for each in extent)
        self._seen: IntArray = np.zeros((rows, columns), dtype=np.int64)
        self._water: IntArray = np.zeros((rows, columns), dtype=np.int64)
        for view in views:
            self._add(view)

    def _add(self, view: WaterView) -> None:
        """Count one view, over the part of the map that it shows."""
        rows, columns = self._box(view)
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return
        east = self._west_north[0] + self._step_m * np.arange(columns.start, columns.stop)
        north = self._west_north[1] - self._step_m * np.arange(rows.start, rows.stop)
        cells = np.stack(np.broadcast_arrays(east[None], north[:, None]), axis=-1)
        pixels = view.plane.pixels_px(cells)
        small = view.copy.to_small(pixels)
        seen = view.plane.in_view(cells, pixels) & sample_mask(view.ground, small)
        self._seen[rows, columns] += seen
        self._water[rows, columns] += sample_mask(view.channel, small) & seen

    def water_map(self) -> WaterMap:
        """What most images hold to be water, where any looked, and in gaps of up to half a width between them."""
        west, north = self._west_north.tolist()
        water, seen = 2 * self._water > self._seen, self._seen > 0
        gap = (cv2.morphologyEx(water.astype(np.uint8), cv2.MORPH_CLOSE, _GAP) > 0) & ~seen
        return WaterMap(west, north, self._step_m, water | gap, seen | gap)

    def _box(self, view: WaterView) -> tuple[slice, slice]:
        places = _places(view)
        low, high = places.min(axis=0) - view.width_m, places.max(axis=0) + view.width_m
        first = np.floor((np.array([low[0], high[1]]) - self._west_north) / self._step_m * [1.0, -1.0]).astype(int)
        last = np.ceil((np.array([high[0], low[1]]) - self._west_north) / self._step_m * [1.0, -1.0]).astype(int)
        (left, top), (right, bottom) = np.maximum(first, 0).tolist(), np.maximum(last, 0).tolist()
        return slice(top, min(bottom, len(self._seen))), slice(left, min(right, self._seen.shape[1]))


def _places(view: WaterView) -> FloatArray:
    """Some places ``(n, 2)`` of a view's channel."""
    rows, columns = np.nonzero(view.channel)
    pixels = np.stack([columns, rows], axis=-1)[::_OUTLINE].astype(np.float64)
    places = view.plane.places_en_m(view.copy.to_image(pixels))
    return np.asarray(places[np.isfinite(places[:, 0])])


def seed_on(line: Centreline, plane: WaterPlane) -> tuple[float, float] | None:
    """The pixel of a reach's centreline that an image shows nearest to its middle; None where it shows none."""
    pixels = plane.pixels_px(line.places_en_m)
    shown = plane.in_view(line.places_en_m, pixels)
    if not shown.any():
        return None
    middle = np.array([plane.camera.width_px - 1, plane.camera.height_px - 1]) / 2
    near = pixels[shown][np.argmin(np.linalg.norm(pixels[shown] - middle, axis=-1))]
    return float(near[0]), float(near[1])


class _IslandSample(NamedTuple):
    """What one image shows of one transect."""

    islands: int
    dry_m: float
    std_m: float


def common_islands(looks: Sequence[River], count: int) -> Islands:
    """The islands across each of ``count`` transects, as most images that measure its width show them.

    Where images disagree on how many islands there are, that is one error of all of them, and does not average out.
    """
    samples: list[list[_IslandSample]] = [[] for _ in range(count)]
    for look in looks:
        islands = look.islands
        for row in look.rows[look.used].tolist():
            sample = _IslandSample(int(islands.count[row]), float(islands.dry_m[row]), float(islands.std_m[row]))
            samples[row].append(sample)
    common = [_common(each) for each in samples]
    counts, dry, std = (np.array(column) for column in zip(*common, strict=True))
    return Islands(counts.astype(np.int64), dry, std)


def _common(samples: Sequence[_IslandSample]) -> _IslandSample:
    """What most images show; the more islands where as many show more."""
    if not samples:
        return _IslandSample(0, 0.0, 0.0)
    counts = np.array([each.islands for each in samples])
    most = max(counts.tolist(), key=lambda one: (int(np.sum(counts == one)), one))
    agree = [each for each in samples if each.islands == most]
    dry = np.array([each.dry_m for each in agree])
    stated = np.sqrt(np.mean(np.square([each.std_m for each in agree])))
    scatter = np.std(dry, ddof=1) if len(agree) > 1 else 0.0
    others = [each.dry_m - dry.mean() for each in samples if each.islands != most]
    doubt = np.sqrt(np.sum(np.square(others)) / len(samples))
    return _IslandSample(most, float(dry.mean()), float(np.hypot(max(stated, scatter) / np.sqrt(len(agree)), doubt)))


@dataclass(frozen=True, slots=True, eq=False)
class RiverView:
    """One image that a river is looked for in.

    Attributes:
        index: Running number of the image.
        setup: As for ``find_river``; the camera zoomed as it was.
        sample: Its pose, which is ok; all views of a reach in one ENU frame.
        pixels: Reads the image, ``(height, width, 3)`` BGR.
        later: The same place soon afterwards, where there is such an image.
    """

    index: int
    setup: Setup
    sample: PoseSample
    pixels: Callable[[], ImageArray]
    later: LaterLook | None = None

    @property
    def pose(self) -> Pose:
        """The pose of the sample."""
        assert self.sample.pose is not None  # noqa: S101 - a view's own condition, for the type checker
        return self.sample.pose

    @property
    def plane(self) -> WaterPlane:
        """The water's plane."""
        return WaterPlane.from_setup(self.setup, self.pose)


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
    views: Sequence[RiverView], question: RiverQuestion, advance: Callable[[int], None] = lambda _: None
) -> Reach | NoRiver:
    """Measure a river over many images.

    Args:
        views: At least one. Each is read twice: to find the water, and then to find the banks of the transects that all
            have in common.
        question: What is asked; its hints are of the first image.
        advance: Told after each look how many there were.
    """
    rough = replace(question, spacing_m=_ONCE_M)
    looks: list[River | NoRiver] = []
    for view in views:
        looks.append(find_river(view.pixels(), view.setup, view.pose, _asked(rough, views[0], view), view.later))
        advance(len(looks))
    waters = [_water(view, look) for view, look in zip(views, looks, strict=True) if isinstance(look, River)]
    line = middle_line(_Votes(waters).water_map()) if waters else None
    if line is None:
        return _most_said([look for look in looks if isinstance(look, NoRiver)])
    if question.flow_rad is None:
        line = _directed_as(line, next(look.line for look in looks if isinstance(look, River)))
    else:
        line = oriented(views[0].plane, line, question.flow_rad)
    for row, view in enumerate(views):
        looks[row] = _looked_across(view, looks[row], line, question, rough)
        advance(len(views) + row + 1)
    stations = stations_along(line, question.spacing_m)
    found = fuse_widths([_usable(look) for look in looks], len(stations))
    if not np.any(found.images):
        return _most_said([look for look in looks if isinstance(look, NoRiver)])
    islands = common_islands([look for look in looks if isinstance(look, River)], len(stations))
    return Reach(line=line, stations_m=stations, found=found, islands=islands, looks=tuple(looks))


def _directed_as(line: Centreline, other: Centreline) -> Centreline:
    """A line, reversed where it runs against another one beside a part of it."""
    ends = other.places_en_m[[0, -1]]
    first, last = np.argmin(np.linalg.norm(line.places_en_m[:, None] - ends, axis=-1), axis=0)
    return line if last >= first else line.reversed()


def _asked(question: RiverQuestion, first: RiverView, view: RiverView) -> RiverQuestion:
    """The question of one image, with the hints of the first carried to it."""
    return question if view is first else replace(question, hints=question.hints.carried(first.plane, view.plane))


def _water(view: RiverView, look: River) -> WaterView:
    channel = with_islands(look.water.water, look.water.ground)
    return WaterView(view.plane, look.copy, channel, look.water.ground, look.line.width_m)


def _looked_across(
    view: RiverView, look: River | NoRiver, line: Centreline, question: RiverQuestion, rough: RiverQuestion
) -> River | NoRiver:
    """The reach's transects in one image, whose water is looked for anew where it is not that of the reach."""
    plane, image = view.plane, view.pixels()
    seed = seed_on(line, plane)
    if seed is None:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "the image does not show the reach")
    if isinstance(look, NoRiver) or not sample_mask(look.water.water, look.copy.to_small(np.array([seed])))[0]:
        pointed = replace(rough, hints=RiverHints([seed]))
        look = find_river(image, view.setup, view.pose, pointed, view.later)
    if isinstance(look, NoRiver):
        return look
    return river_across(image, view.setup, view.pose, question, look, line)


def _usable(look: River | NoRiver) -> ImageWidths:
    if isinstance(look, NoRiver):
        nothing = RiverWidths(np.empty(0), np.empty((0, 0)), np.empty(0), np.empty(0), np.empty((0, 2, 3)))
        return ImageWidths(np.empty(0, dtype=np.int64), nothing)
    return ImageWidths(look.rows[look.used], look.widths.rows(look.used))


def _most_said(refusals: Sequence[NoRiver]) -> NoRiver:
    """What most images are refused for."""
    if not refusals:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "nowhere are both banks in view")
    said = [each.status for each in refusals]
    return max(refusals, key=lambda each: said.count(each.status))
