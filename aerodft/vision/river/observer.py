"""A river in one image, over a flight, or while images come: its water, its banks, and its width at transects along it.

Over a flight every image votes for each place that it shows. What most of them hold to be water is the reach, with one
centreline; its transects are then looked up in every image, so that widths of several images are of the same places.
While images come, banks are observations: what a probe of kind ``river`` is measured from.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import cv2
import numpy as np

from aerodft.dft import Setup, zoomed
from aerodft.dft.river import BankPair, ReachWidths, RiverWidths, SeenWidths, fuse, river_widths
from aerodft.model import (
    BoolArray,
    Camera,
    FloatArray,
    Image,
    ImageArray,
    IntArray,
    Observation,
    Pose,
    PoseSample,
    Probe,
)
from aerodft.service import RiverLook
from aerodft.vision.river.banks import Edges, Islands, flag_outliers, islands_across, locate_banks
from aerodft.vision.river.centreline import (
    MOST_TRANSECTS,
    Centreline,
    Transects,
    WaterMap,
    centreline,
    middle_line,
    sample_mask,
    transects,
)
from aerodft.vision.river.checks import alternative_width_delta_m, like_a_road, likeliest_water, no_light, no_river
from aerodft.vision.river.status import WHY, NoRiver, RiverStatus
from aerodft.vision.river.water import WaterMask, WaterNetwork, with_islands
from aerodft.vision.river.water_features import WaterFeatures, WaterPlane, ground_of, water_features
from aerodft.vision.river.water_motion import STAYS, LaterLook, what_stays, without_still

_UNMOVED: Final = (
    "what is found there does not move from image to image: a road? If it is still water, click it (`seed`)"
)
_CLICKED: Final = (
    "what was clicked is as even as a road, between edges like a road's; that it is water is taken on trust"
)
_NEAR_PX: Final = np.ones((7, 7), dtype=np.uint8)  # of the small copy
_AMBIGUOUS: Final = 0.2  # of the width
_REACHES: Final = 1.6  # an interval of 95 % reaches beyond the other outline, by a quarter of the way there
_SEED_DOWN: Final = 0.75  # without a seed the water is looked for in the lower middle
_CELLS_ACROSS: Final = 24.0  # of the river's width
_MOST_CELLS: Final = 4_000_000
_PAD_CELLS: Final = 3
_OUTLINE: Final = 7  # every so many pixels of a mask tell how far it reaches
_ONCE_M: Final = 1e4  # apart: one transect tells whether there is a river
MOST_OBSERVED: Final = 32
_DECIMALS: Final = 3
_LEAST_STD_PX: Final = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class RiverQuestion:
    """What is asked of one image.

    Attributes:
        seed_px: A pixel in the water; None for the lower middle.
        spacing_m: Of the transects.
        flow_rad: Azimuth to which the river flows; None where it is not known.
        least_std_px: What a bank is seen off by at the least, all of them alike.
        network: Says where water is; None for the classical segmentation.
    """

    seed_px: tuple[float, float] | None = None
    spacing_m: float = 1.0
    flow_rad: float | None = None
    least_std_px: float = 0.15
    network: WaterNetwork | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class River:
    """A river as one image shows it.

    Attributes:
        features: The small copy that was looked at.
        water: Its water.
        line: The centreline, towards which left and right are meant.
        transects: The lines across it.
        status: ``(n,)`` of each transect.
        edges: Its banks, ``(n, 2)``: left, then right; NaN where the image ends first.
        widths: Of the transects that have both banks.
        rows: ``(k,)`` which transects those are.
        islands: What is dry between the banks, of all transects.
        remarks: What speaks against it all the same.
    """

    features: WaterFeatures
    water: WaterMask
    line: Centreline
    transects: Transects
    status: tuple[RiverStatus, ...]
    edges: Edges
    widths: RiverWidths
    rows: IntArray
    islands: Islands
    remarks: tuple[str, ...] = ()

    @property
    def used(self) -> BoolArray:
        """Which of the widths, ``(k,)``, are measured from."""
        return np.array([self.status[row] is RiverStatus.OK for row in self.rows], dtype=bool)


def find_river(
    image: ImageArray, setup: Setup, pose: Pose, question: RiverQuestion, later: LaterLook | None = None
) -> River | NoRiver:
    """Measure the river in one image.

    Args:
        image: ``(height, width, 3)`` BGR, of the camera's size.
        setup: The camera; the water's elevation and its standard deviation; how far is looked. Pinhole, level.
        pose: One pose.
        question: What is asked.
        later: A look at the same place soon afterwards: what does not move is no water, unless there is a seed.
    """
    plane = WaterPlane.from_setup(setup, pose)
    features = water_features(image)
    ground = ground_of(plane, features)
    seed = features.to_small(np.array(question.seed_px)) if question.seed_px else _default_seed(features)
    if (refusal := _unfit(image, plane, ground, seed)) is not None:
        return refusal
    start = float(seed[0]), float(seed[1])
    if question.network is None:
        water = likeliest_water(plane, features, start, ground)
    else:
        water = question.network.find_water(features, start, ground)
    if (refusal := no_river(features, water, ground)) is not None:
        return refusal
    stayed = None if later is None else what_stays(image, plane, later, water.water, ground)
    if stayed is not None and stayed.in_water > STAYS:
        if question.seed_px is None:
            return NoRiver(RiverStatus.NO_WATER, _UNMOVED)
    elif stayed is not None:  # of still water motion tells nothing
        water = without_still(water, features, start, ground, stayed.still)
    channel = with_islands(water.water, ground)
    line = centreline(plane, features, channel)
    if line is None:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, WHY[RiverStatus.OUT_OF_IMAGE])
    line = oriented(plane, line, question.flow_rad)
    found = transects(plane, features, (channel, water.water, ground), line, stations_along(line, question.spacing_m))
    seen = _measured(image, setup, pose, plane, question, (features, water, line, found))
    return seen if isinstance(seen, NoRiver) or question.network is not None else _not_a_road(seen, question)


def _not_a_road(seen: River, question: RiverQuestion) -> River | NoRiver:
    """What was found, unless it is like a road and nobody clicked it."""
    road = like_a_road(seen.features, seen.water.water, seen.widths.points_enu_m[..., :2])
    if road is None:
        return seen
    return road if question.seed_px is None else replace(seen, remarks=(_CLICKED,))


def _unfit(image: ImageArray, plane: WaterPlane, ground: BoolArray, seed_px: FloatArray) -> NoRiver | None:
    """Why no water is looked for at all."""
    if (unlit := no_light(image)) is not None:
        return unlit
    if not ground.any():
        up = "the image shows no water plane near enough: it looks too far up, or `max_range_m` is too short"
        return NoRiver(RiverStatus.ABOVE_HORIZON, up if plane.height_m > 0 else "the water would be above the camera")
    if not sample_mask(ground, seed_px):
        return NoRiver(RiverStatus.SEED_OFF_GROUND, "the seed is not on ground that is near enough to be measured")
    return None


def river_across(
    image: ImageArray, setup: Setup, pose: Pose, question: RiverQuestion, seen: River, line: Centreline
) -> River | NoRiver:
    """Measure a river that was found in an image at the transects of another line: that of a reach of many images.

    Args:
        image: ``(height, width, 3)`` BGR, of the camera's size.
        setup: As for ``find_river``.
        pose: One pose.
        question: What is asked.
        seen: What was found.
        line: The centreline, in the direction in which left and right are meant.
    """
    plane = WaterPlane.from_setup(setup, pose)
    ground = ground_of(plane, seen.features)
    masks = with_islands(seen.water.water, ground), seen.water.water, ground
    found = transects(plane, seen.features, masks, line, stations_along(line, question.spacing_m))
    return _measured(image, setup, pose, plane, question, (seen.features, seen.water, line, found))


def channel_of(plane: WaterPlane, seen: River) -> BoolArray:
    """The water with its islands, ``(height, width)`` of the small copy."""
    return with_islands(seen.water.water, ground_of(plane, seen.features))


def _default_seed(features: WaterFeatures) -> FloatArray:
    rows, columns = features.shape
    return np.array([(columns - 1) / 2, _SEED_DOWN * (rows - 1)])


def oriented(plane: WaterPlane, line: Centreline, flow_rad: float | None) -> Centreline:
    """Downstream where that is known; else up in the image, or to the right where the river runs across it."""
    ends = line.places_en_m[[0, -1]]
    if flow_rad is not None:
        return line if float((ends[1] - ends[0]) @ [math.sin(flow_rad), math.cos(flow_rad)]) >= 0 else line.reversed()
    middle = line.places_en_m[len(line.places_en_m) // 4 :: max(1, len(line.places_en_m) // 2)][:2]
    first, last = plane.pixels_px(middle)
    right, up = last[0] - first[0], first[1] - last[1]
    return line if (up > 0 if abs(up) >= abs(right) else right > 0) else line.reversed()


def stations_along(line: Centreline, spacing_m: float) -> FloatArray:
    """Where transects cross a line, ``(n,)``: so far apart, or fewer."""
    length = float(line.stations_m()[-1])
    count = min(int(length / spacing_m) + 1, MOST_TRANSECTS)
    if count == MOST_TRANSECTS:  # all of the river, more coarsely
        spacing_m = max(spacing_m, length / count)
    spare = length - (count - 1) * spacing_m
    return np.asarray(spare / 2 + spacing_m * np.arange(count), dtype=np.float64)


def _measured(
    image: ImageArray,
    setup: Setup,
    pose: Pose,
    plane: WaterPlane,
    question: RiverQuestion,
    seen: tuple[WaterFeatures, WaterMask, Centreline, Transects],
) -> River | NoRiver:
    features, water, line, found = seen
    edges, status = locate_banks(image, plane, found, _by_motion(plane, features, water, found))
    other_m = alternative_width_delta_m(plane, features, water, line, found.stations_m)
    for row in np.flatnonzero(_unlike_neighbours(plane, found, edges, line.width_m)).tolist():
        status[row] = RiverStatus.UNLIKE_NEIGHBOURS if status[row] is RiverStatus.OK else status[row]
    rows = np.flatnonzero([each is RiverStatus.OK for each in status])
    for row in rows[_ambiguous(other_m[rows], line.width_m)].tolist():
        status[row] = RiverStatus.AMBIGUOUS
    rows = np.flatnonzero([each is RiverStatus.OK for each in status])
    if len(rows) == 0:
        worst = RiverStatus.TOO_COARSE if RiverStatus.TOO_COARSE in status else RiverStatus.OUT_OF_IMAGE
        return NoRiver(worst, WHY[worst])
    other_std_m = other_m[rows] / _REACHES
    pair = BankPair(
        edges.pixels_px[rows], edges.across_px[rows], edges.std_px[rows], question.least_std_px, other_std_m
    )
    widths = river_widths(setup, pose, pair)
    for row, usable in zip(rows.tolist(), widths.usable.tolist(), strict=True):
        status[row] = RiverStatus.OK if usable else RiverStatus.ILL_CONDITIONED
    return River(
        features=features,
        water=water,
        line=line,
        transects=found,
        status=tuple(status),
        edges=edges,
        widths=widths,
        rows=rows,
        islands=islands_across(image, plane, found),
    )


def _ambiguous(other_m: FloatArray, width_m: float) -> BoolArray:
    """Which transects ``(n,)`` another outline has far off; none where it has most of them so, which is the river then.

    Args:
        other_m: ``(n,)``: how much wider the river is by the other outline.
        width_m: Of the river.
    """
    far = np.abs(other_m) > _AMBIGUOUS * width_m
    return far & (2 * np.count_nonzero(far) < len(far))


def _by_motion(plane: WaterPlane, features: WaterFeatures, water: WaterMask, found: Transects) -> BoolArray:
    """Which banks ``(n, 2)`` are where something was taken off for not moving."""
    if water.stayed is None:
        return np.zeros((len(found.stations_m), 2), dtype=bool)
    near = cv2.dilate(water.stayed.astype(np.uint8), _NEAR_PX) > 0
    sides = [plane.pixels_px(found.places_en_m(offsets)) for offsets in (found.left_m, found.right_m)]
    return np.stack([sample_mask(near, features.to_small(side)) for side in sides], axis=-1)


def _unlike_neighbours(plane: WaterPlane, found: Transects, edges: Edges, width_m: float) -> BoolArray:
    """Which transects ``(n,)`` have a bank that stands out."""
    places = plane.places_en_m(edges.pixels_px)
    offsets = np.sum((places - found.centres_en_m[:, None]) * found.to_left[:, None], axis=-1)
    moved = plane.places_en_m(edges.pixels_px + edges.std_px[..., None] * edges.across_px)
    std = np.linalg.norm(moved - places, axis=-1)
    sides = [flag_outliers(found.stations_m, offsets[:, side], std[:, side], width_m) for side in (0, 1)]
    return np.asarray(sides[0] | sides[1])


@dataclass(frozen=True, slots=True, eq=False)
class WaterView:
    """The water of one image, on its plane.

    Attributes:
        plane: As the image shows it.
        features: The small copy that the masks are of.
        channel: ``(height, width)`` the water with its islands.
        width_m: Of the channel, roughly.
    """

    plane: WaterPlane
    features: WaterFeatures
    channel: BoolArray
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
        seen = view.plane.in_view(cells, pixels)
        self._seen[rows, columns] += seen
        self._water[rows, columns] += sample_mask(view.channel, view.features.to_small(pixels)) & seen

    def water_map(self) -> WaterMap:
        """What most images hold to be water, where any looked."""
        west, north = self._west_north.tolist()
        return WaterMap(west, north, self._step_m, 2 * self._water > self._seen, self._seen > 0)

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
    places = view.plane.places_en_m(view.features.to_image(pixels))
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
        question: What is asked; its seed is of every image, where there is one.
        advance: Told after each look how many there were.
    """
    rough = replace(question, spacing_m=_ONCE_M)
    looks: list[River | NoRiver] = []
    for view in views:
        looks.append(_slim(find_river(view.pixels(), view.setup, view.pose, rough, view.later)))
        advance(len(looks))
    waters = [_water(view, look) for view, look in zip(views, looks, strict=True) if isinstance(look, River)]
    line = middle_line(_Votes(waters).water_map()) if waters else None
    if line is None:
        return _most_said([look for look in looks if isinstance(look, NoRiver)])
    line = oriented(views[0].plane, line, question.flow_rad)
    for row, view in enumerate(views):
        looks[row] = _looked_across(view, looks[row], line, question, rough)
        advance(len(views) + row + 1)
    stations = stations_along(line, question.spacing_m)
    found = fuse([_usable(look) for look in looks], len(stations))
    if not np.any(found.images):
        return _most_said([look for look in looks if isinstance(look, NoRiver)])
    islands = common_islands([look for look in looks if isinstance(look, River)], len(stations))
    return Reach(line=line, stations_m=stations, found=found, islands=islands, looks=tuple(looks))


def _slim(look: River | NoRiver) -> River | NoRiver:
    """Without what only finding the water needs: a flight has many images."""
    return look if isinstance(look, NoRiver) else replace(look, features=look.features.without_planes())


def _water(view: RiverView, look: River) -> WaterView:
    plane = view.plane
    return WaterView(plane, look.features, channel_of(plane, look), look.line.width_m)


def _looked_across(
    view: RiverView, look: River | NoRiver, line: Centreline, question: RiverQuestion, rough: RiverQuestion
) -> River | NoRiver:
    """The reach's transects in one image, whose water is looked for anew where it is not that of the reach."""
    plane, image = view.plane, view.pixels()
    seed = seed_on(line, plane)
    if seed is None:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "the image does not show the reach")
    if isinstance(look, NoRiver) or not sample_mask(look.water.water, look.features.to_small(np.array([seed])))[0]:
        look = _slim(find_river(image, view.setup, view.pose, replace(rough, seed_px=seed), view.later))
    if isinstance(look, NoRiver):
        return look
    return river_across(image, view.setup, view.pose, question, look, line)


def _usable(look: River | NoRiver) -> SeenWidths:
    if isinstance(look, NoRiver):
        nothing = RiverWidths(np.empty(0), np.empty((0, 0)), np.empty(0), np.empty(0), np.empty((0, 2, 3)))
        return SeenWidths(np.empty(0, dtype=np.int64), nothing)
    return SeenWidths(look.rows[look.used], look.widths.select(look.used))


def _most_said(refusals: Sequence[NoRiver]) -> NoRiver:
    """What most images are refused for."""
    if not refusals:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "nowhere are both banks in view")
    said = [each.status for each in refusals]
    return max(refusals, key=lambda each: said.count(each.status))


class RiverObserver:
    """Implements ``service.ports.ImageObserver``: pairs of bank pixels, left then right, for each river probe.

    Transects are laid with a pose of about the same time; widths are measured from the image's own.

    Args:
        camera: The camera.
        look: How banks are looked for.
        probes: Those of kind ``river``.
        pose_near: The pose of about an image's time; None where there is none.

    Attributes:
        misses: How many looks found no river, by status.
    """

    def __init__(
        self,
        camera: Camera,
        look: RiverLook,
        probes: tuple[Probe, ...],
        pose_near: Callable[[Image], PoseSample | None],
    ) -> None:
        self.misses: Counter[str] = Counter()
        self._camera, self._look, self._probes, self._pose_near = camera, look, probes, pose_near

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """The banks in one image; of each probe why there are none, where there is no river, or no pose yet.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        sample = self._pose_near(image)
        if sample is None or sample.pose is None:
            return tuple(
                self._missed(probe, image, "NO_POSE", "where the camera looks was not known yet")
                for probe in self._probes
            )
        seen = []
        for probe in self._probes:
            setup = Setup(camera=self._camera, elevation_m=probe.elevation_m, max_range_m=self._look.max_range_m)
            setup, sample = zoomed(setup, sample)
            assert sample.pose is not None  # noqa: S101 - as above, for the type checker
            question = RiverQuestion(seed_px=self._look.seed_px, spacing_m=self._look.spacing_m)
            found = find_river(image.pixels(), setup, sample.pose, question)
            if isinstance(found, NoRiver):
                seen.append(self._missed(probe, image, found.status, found.reason))
            elif observation := _observed(found, probe.name, image):
                seen.append(observation)
            else:
                seen.append(self._missed(probe, image, *_commonest(found)))
        return tuple(seen)

    def _missed(self, probe: Probe, image: Image, code: str, reason: str) -> Observation:
        self.misses[str(code)] += 1
        return Observation.in_image(image, probe.name, unseen=f"{code}: {reason}")


def _commonest(found: River) -> tuple[str, str]:
    """Why no transect has a width: what is said of most of them, as a code and a sentence."""
    status, _ = Counter(found.status).most_common(1)[0]
    return status, WHY[status]


def _observed(found: River, name: str, image: Image) -> Observation | None:
    rows = np.array([row for row, status in enumerate(found.status) if status is RiverStatus.OK], dtype=np.int64)
    if len(rows) == 0:
        return None
    chosen = rows[np.unique(np.rint(np.linspace(0, len(rows) - 1, min(len(rows), MOST_OBSERVED))).astype(np.int64))]
    pixels = np.round(found.edges.pixels_px[chosen].reshape(-1, 2), _DECIMALS).tolist()
    spread_px = float(np.sqrt(np.mean(np.square(found.edges.std_px[chosen]))))
    std_px = round(float(np.hypot(spread_px, _LEAST_STD_PX)), _DECIMALS)
    return Observation.in_image(image, name, tuple((u, v) for u, v in pixels), std_px=std_px)
