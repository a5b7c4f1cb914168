"""A river in one image: its water, its banks, and its width at transects along it."""

import math
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from aerodft.dft.request import Setup
from aerodft.dft.river_widths import BankPair, RiverWidths, river_widths
from aerodft.model.arrays import BoolArray, FloatArray, ImageArray, IntArray
from aerodft.model.pose import Pose
from aerodft.vision.river_banks import Edges, Islands, islands_across, locate_banks, stand_out
from aerodft.vision.river_checks import like_a_road, likeliest_water, no_light, no_river, otherwise_m
from aerodft.vision.river_status import WHY, NoRiver, RiverStatus
from aerodft.vision.water import WaterMask, with_islands
from aerodft.vision.water_features import WaterFeatures, water_features
from aerodft.vision.water_motion import STAYS, LaterLook, what_stays, without_still
from aerodft.vision.water_network import WaterNetwork
from aerodft.vision.water_plane import WaterPlane, ground_of
from aerodft.vision.waterway import MOST_TRANSECTS, Centreline, Transects, centreline, looked_up, transects

__all__ = [
    "WHY",
    "NoRiver",
    "River",
    "RiverQuestion",
    "RiverStatus",
    "channel_of",
    "find_river",
    "ground_of",
    "oriented",
    "river_across",
    "stations_along",
]

_UNMOVED: Final = (
    "what is found there does not move from image to image: a road? If it is still water, click it (--seed)"
)
_CLICKED: Final = (
    "what was clicked is as even as a road, between edges like a road's; that it is water is taken on trust"
)
_NEAR_PX: Final = np.ones((7, 7), dtype=np.uint8)  # of the small copy
_AMBIGUOUS: Final = 0.2  # of the width
_REACHES: Final = 1.6  # an interval of 95 % reaches beyond the other outline, by a quarter of the way there
_SEED_DOWN: Final = 0.75  # without a seed the water is looked for in the lower middle


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
    plane = WaterPlane(setup.camera, pose, setup.elevation_m, setup.max_range_m)
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
        up = "the image shows no water plane near enough: it looks too far up, or --max-range is too short"
        return NoRiver(RiverStatus.ABOVE_HORIZON, up if plane.height_m > 0 else "the water would be above the camera")
    if not looked_up(ground, seed_px):
        return NoRiver(RiverStatus.SEED_OFF_GROUND, "the seed is not on ground that is near enough to be measured")
    return None


def river_across(
    image: ImageArray, setup: Setup, pose: Pose, question: RiverQuestion, seen: River, line: Centreline
) -> River | NoRiver:
    """Measure a river that was found in an image at the transects of another line: that of a reach of many images.

    Args:
        image: As for ``find_river``; so are ``setup``, ``pose`` and ``question``.
        setup: Likewise.
        pose: Likewise.
        question: Likewise.
        seen: What was found.
        line: The centreline, in the direction in which left and right are meant.
    """
    plane = WaterPlane(setup.camera, pose, setup.elevation_m, setup.max_range_m)
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
        return line if float((ends[1] - ends[0]) @ [math.sin(flow_rad), math.cos(flow_rad)]) >= 0 else line.turned()
    middle = line.places_en_m[len(line.places_en_m) // 4 :: max(1, len(line.places_en_m) // 2)][:2]
    first, last = plane.pixels_px(middle)
    right, up = last[0] - first[0], first[1] - last[1]
    return line if (up > 0 if abs(up) >= abs(right) else right > 0) else line.turned()


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
    other_m = otherwise_m(plane, features, water, line, found.stations_m)
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
    return np.stack([looked_up(near, features.to_small(side)) for side in sides], axis=-1)


def _unlike_neighbours(plane: WaterPlane, found: Transects, edges: Edges, width_m: float) -> BoolArray:
    """Which transects ``(n,)`` have a bank that stands out."""
    places = plane.places_en_m(edges.pixels_px)
    offsets = np.sum((places - found.centres_en_m[:, None]) * found.to_left[:, None], axis=-1)
    moved = plane.places_en_m(edges.pixels_px + edges.std_px[..., None] * edges.across_px)
    std = np.linalg.norm(moved - places, axis=-1)
    sides = [stand_out(found.stations_m, offsets[:, side], std[:, side], width_m) for side in (0, 1)]
    return np.asarray(sides[0] | sides[1])
