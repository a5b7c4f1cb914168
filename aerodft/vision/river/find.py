"""A river in one image: its water, its banks, and its width at transects along it."""

import math
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np

from aerodft.dft import Setup
from aerodft.dft.river import BankPair, RiverWidths, river_widths
from aerodft.model import BoolArray, FloatArray, ImageArray, IntArray, Pose
from aerodft.vision.river.bank_lines import bank_lines, by_direction, by_side
from aerodft.vision.river.banks import Edges, Islands, flag_outliers, islands_across, locate_banks
from aerodft.vision.river.centreline import (
    MOST_TRANSECTS,
    Centreline,
    Transects,
    centreline,
    sample_mask,
    transects,
)
from aerodft.vision.river.hints import RiverHints
from aerodft.vision.river.status import WHY, NoRiver, RiverStatus
from aerodft.vision.river.water import WaterMask, find_water, with_islands
from aerodft.vision.river.water_motion import STAYS, LaterLook, what_stays, without_still
from aerodft.vision.river.water_network import WaterNetwork
from aerodft.vision.river.water_plane import SmallCopy, WaterPlane, ground_of

_NIGHT: Final = 20.0  # grey levels: where all but the brightest twentieth is darker, colours are noise
_WHITE: Final = 250  # grey levels, of the darkest channel
_MOST_BURNT: Final = 0.4  # of an image; rivers that glare have up to 0.25
_EVERY: Final = 8  # of the pixels is looked at for that
_LEAST_WATER: Final = 0.004  # of what is looked at
_LEAST_LAND: Final = 0.01  # likewise
_AGREEMENT: Final = 0.5  # overlap of two looks: below, nobody can tell
_NEAR_PX: Final = np.ones((7, 7), dtype=np.uint8)  # of the small copy
_AMBIGUOUS: Final = 0.2  # of the width
_REACHES: Final = 1.6  # an interval of 95 % reaches beyond the other bank, by a quarter of the way there
_UNMOVED: Final = "what is found there does not move from image to image: a road? If it is still water, click it"


@dataclass(frozen=True, slots=True, kw_only=True)
class RiverQuestion:
    """What is asked of one image.

    Attributes:
        hints: What a person says is water or land.
        spacing_m: Of the transects.
        flow_rad: Azimuth to which the river flows; None where it is not known.
        least_std_px: What a bank is seen off by at the least, all of them alike.
        network: Says where water is.
    """

    hints: RiverHints = field(default_factory=RiverHints)
    spacing_m: float = 1.0
    flow_rad: float | None = None
    least_std_px: float = 0.15
    network: WaterNetwork = field(default_factory=WaterNetwork.shipped)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class River:
    """A river between two banks, as one image shows it.

    Attributes:
        copy: The small copy that was looked at.
        water: Its water.
        line: The centreline, towards which left and right are meant.
        transects: The lines across it.
        status: ``(n,)`` of each transect.
        edges: Its banks at the transects, ``(n, 2)``: left, then right; NaN where the image ends first.
        banks_px: Left and right bank as lines ``(k, 2)`` along the water's outline, of the image.
        widths: Of the transects that have both banks.
        rows: ``(k,)`` which transects those are.
        islands: What is dry between the banks, of all transects.
    """

    copy: SmallCopy
    water: WaterMask
    line: Centreline
    transects: Transects
    status: tuple[RiverStatus, ...]
    edges: Edges
    banks_px: tuple[FloatArray, FloatArray]
    widths: RiverWidths
    rows: IntArray
    islands: Islands

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
        later: A look at the same place soon afterwards: what does not move is no water, unless a person says so.

    Raises:
        InputError: The network does not take the image, or the hints' mask is not of its size.
    """
    plane = WaterPlane.from_setup(setup, pose)
    copy = SmallCopy.of_image(image)
    ground = ground_of(plane, copy)
    if (refusal := _unfit(image, plane, copy, ground, question.hints)) is not None:
        return refusal
    water = find_water(copy, question.network, question.hints, ground)
    if (refusal := _no_water(water, ground, question.hints)) is not None:
        return refusal
    stayed = None if later is None else what_stays(image, plane, later, water.water, ground)
    if stayed is not None and stayed.in_water > STAYS:
        if not question.hints.water:
            return NoRiver(RiverStatus.NO_WATER, _UNMOVED)
    elif stayed is not None:  # of still water motion tells nothing
        water = without_still(water, copy, ground, stayed.still)
    arcs = bank_lines(image, copy, water.water, ground)
    if not arcs:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "no bank is in view: the water ends where the image does")
    line = centreline(plane, copy, with_islands(water.water, ground))
    if line is None:
        return NoRiver(RiverStatus.ONE_BANK, WHY[RiverStatus.ONE_BANK], by_direction(plane, arcs, question.flow_rad))
    return _across(image, setup, pose, question, (copy, water, oriented(plane, line, question.flow_rad)), arcs)


def _unfit(
    image: ImageArray, plane: WaterPlane, copy: SmallCopy, ground: BoolArray, hints: RiverHints
) -> NoRiver | None:
    """Why no water is looked for at all."""
    few = np.ascontiguousarray(image[::_EVERY, ::_EVERY])
    if float(np.percentile(cv2.cvtColor(few, cv2.COLOR_BGR2GRAY), 95)) < _NIGHT:
        return NoRiver(RiverStatus.TOO_DARK, "the image is too dark: night, or a covered lens")
    if float(np.mean(np.min(few, axis=-1) >= _WHITE)) > _MOST_BURNT:
        return NoRiver(RiverStatus.TOO_BRIGHT, "the image is burnt out: glare, or the exposure is too long")
    if not ground.any():
        up = "the image shows no water plane near enough: it looks too far up, or `max_range_m` is too short"
        return NoRiver(RiverStatus.ABOVE_HORIZON, up if plane.height_m > 0 else "the water would be above the camera")
    for stroke in hints.water:
        if not np.all(sample_mask(ground, copy.to_small(stroke))):
            where = "the water is pointed at where there is no ground near enough to be measured"
            return NoRiver(RiverStatus.SEED_OFF_GROUND, where)
    return None


def _no_water(water: WaterMask, ground: BoolArray, hints: RiverHints) -> NoRiver | None:
    """Why what the network sees is no river."""
    looked_at, wet = np.count_nonzero(ground), np.count_nonzero(water.water)
    if wet < _LEAST_WATER * looked_at:
        return NoRiver(RiverStatus.NO_WATER, "no water is seen; if there is some, point at it")
    if np.count_nonzero(ground & ~with_islands(water.water, ground)) < _LEAST_LAND * looked_at:
        return NoRiver(RiverStatus.ALL_WATER, "no bank is in view: all of the image looks like water")
    if water.agreement < _AGREEMENT and not hints:
        share = f"two looks at the image share {100 * water.agreement:.0f} % of the water"
        return NoRiver(RiverStatus.NO_CONTRAST, f"water and land cannot be told apart: {share}; point at either")
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
    return _across(image, setup, pose, question, (seen.copy, seen.water, line), list(seen.banks_px))


def channel_of(plane: WaterPlane, seen: River) -> BoolArray:
    """The water with its islands, ``(height, width)`` of the small copy."""
    return with_islands(seen.water.water, ground_of(plane, seen.copy))


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


def _across(
    image: ImageArray,
    setup: Setup,
    pose: Pose,
    question: RiverQuestion,
    seen: tuple[SmallCopy, WaterMask, Centreline],
    arcs: list[FloatArray],
) -> River | NoRiver:
    """The transects of a line with their banks and widths."""
    copy, water, line = seen
    plane = WaterPlane.from_setup(setup, pose)
    ground, stations_m = ground_of(plane, copy), stations_along(line, question.spacing_m)
    found, *others = (
        transects(plane, copy, (with_islands(mask, ground), mask, ground), line, stations_m)
        for mask in (water.water, *water.looks)
    )
    edges, status = locate_banks(image, plane, found, copy.scale, _by_motion(plane, copy, water, found))
    other_m = _otherwise_m(image, plane, copy.scale, edges, others)
    for row in np.flatnonzero(_unlike_neighbours(plane, found, edges, line.width_m)).tolist():
        status[row] = RiverStatus.UNLIKE_NEIGHBOURS if status[row] is RiverStatus.OK else status[row]
    rows = np.flatnonzero([each is RiverStatus.OK for each in status])
    for row in rows[_ambiguous(other_m[rows], line.width_m)].tolist():
        status[row] = RiverStatus.AMBIGUOUS
    rows = np.flatnonzero([each is RiverStatus.OK for each in status])
    banks_px = by_side(plane, arcs, line)
    if len(rows) == 0:
        worst = RiverStatus.TOO_COARSE if RiverStatus.TOO_COARSE in status else RiverStatus.OUT_OF_IMAGE
        return NoRiver(worst, WHY[worst], banks_px)
    pair = BankPair(
        edges.pixels_px[rows],
        edges.across_px[rows],
        edges.std_px[rows],
        question.least_std_px,
        other_m[rows] / _REACHES,
    )
    widths = river_widths(setup, pose, pair)
    for row, usable in zip(rows.tolist(), widths.usable.tolist(), strict=True):
        status[row] = RiverStatus.OK if usable else RiverStatus.ILL_CONDITIONED
    return River(
        copy=copy,
        water=water,
        line=line,
        transects=found,
        status=tuple(status),
        edges=edges,
        banks_px=banks_px,
        widths=widths,
        rows=rows,
        islands=islands_across(image, plane, found, copy.scale),
    )


def _otherwise_m(
    image: ImageArray, plane: WaterPlane, scale: float, edges: Edges, looks: list[Transects]
) -> FloatArray:
    """How much wider the river is by the look that differs most, ``(n,)``; its banks located as those of all looks."""
    nobody = np.zeros(edges.std_px.shape, dtype=bool)
    width_m = _width_m(plane, edges)
    most = np.zeros(len(width_m))
    for look in looks:
        other, _ = locate_banks(image, plane, look, scale, nobody)
        wider = np.nan_to_num(_width_m(plane, other) - width_m)
        most = np.where(np.abs(wider) > np.abs(most), wider, most)
    return most


def _width_m(plane: WaterPlane, edges: Edges) -> FloatArray:
    left, right = np.moveaxis(plane.places_en_m(edges.pixels_px), 1, 0)
    return np.asarray(np.linalg.norm(left - right, axis=-1))


def _by_motion(plane: WaterPlane, copy: SmallCopy, water: WaterMask, found: Transects) -> BoolArray:
    """Which banks ``(n, 2)`` are where something was taken off for not moving."""
    if water.stayed is None:
        return np.zeros((len(found.stations_m), 2), dtype=bool)
    near = cv2.dilate(water.stayed.astype(np.uint8), _NEAR_PX) > 0
    sides = [plane.pixels_px(found.places_en_m(offsets)) for offsets in (found.left_m, found.right_m)]
    return np.stack([sample_mask(near, copy.to_small(side)) for side in sides], axis=-1)


def _ambiguous(other_m: FloatArray, width_m: float) -> BoolArray:
    """Which transects ``(n,)`` another outline has far off; none where it has most of them so, which is the river then.

    Args:
        other_m: ``(n,)``: how much wider the river is by the other outline.
        width_m: Of the river.
    """
    far = np.abs(other_m) > _AMBIGUOUS * width_m
    return far & (2 * np.count_nonzero(far) < len(far))


def _unlike_neighbours(plane: WaterPlane, found: Transects, edges: Edges, width_m: float) -> BoolArray:
    """Which transects ``(n,)`` have a bank that stands out."""
    places = plane.places_en_m(edges.pixels_px)
    offsets = np.sum((places - found.centres_en_m[:, None]) * found.to_left[:, None], axis=-1)
    moved = plane.places_en_m(edges.pixels_px + edges.std_px[..., None] * edges.across_px)
    std = np.linalg.norm(moved - places, axis=-1)
    sides = [flag_outliers(found.stations_m, offsets[:, side], std[:, side], width_m) for side in (0, 1)]
    return np.asarray(sides[0] | sides[1])
