"""A river in one image: its water, its banks, and its width at transects along it."""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import cv2
import numpy as np

from aerodft.dft import BankPair, RiverWidths, Setup, river_widths
from aerodft.model import BoolArray, FloatArray, ImageArray, IntArray, Pose
from aerodft.vision.river.bank_lines import bank_lines, by_direction, by_side, with_clearer_banks
from aerodft.vision.river.banks import Edges, Islands, common_bias_px, flag_outliers, islands_across, locate_banks
from aerodft.vision.river.centreline import (
    MOST_TRANSECTS,
    Centreline,
    Transects,
    centreline,
    sample_mask,
    transects,
)
from aerodft.vision.river.checks import in_doubt, like_a_road, no_water, unfit
from aerodft.vision.river.status import WHY, NoRiver, RiverStatus
from aerodft.vision.river.water import (
    STAYS,
    LaterLook,
    RiverHints,
    SmallCopy,
    WaterMask,
    WaterNetwork,
    WaterPlane,
    find_water,
    ground_of,
    hinted,
    what_stays,
    without_still,
)

_NEAR_PX: Final = np.ones((7, 7), dtype=np.uint8)  # of the small copy
_AMBIGUOUS: Final = 0.1  # of the width
_REACHES: Final = 1.6  # an interval of 95 % reaches beyond the other bank, by a quarter of the way there
_POINT_AT_LAND: Final = "most of the banks may as well be elsewhere: point at land too"
_UNMOVED: Final = "what is found there does not move from image to image: a road? If it is still water, click it"


@dataclass(frozen=True, slots=True, kw_only=True)
class RiverQuestion:
    """What is asked of one image.

    Attributes:
        hints: What a person says is water or land.
        spacing_m: Of the transects.
        flow_rad: Azimuth to which the river flows; None where it is not known.
        least_std_px: What all banks of an image are seen off by together, at the least.
        network: Says where water is.
    """

    hints: RiverHints = field(default_factory=RiverHints)
    spacing_m: float = 1.0
    flow_rad: float | None = None
    least_std_px: float = 0.03
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

    @property
    def outlines_px(self) -> list[FloatArray]:
        """The water's outlines in the image, closed lines ``(k, 2)``; what one within another surrounds is dry."""
        mask = self.water.water.astype(np.uint8)
        outlines, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_TC89_L1)
        return [self.copy.to_image(outline[:, 0].astype(np.float64)) for outline in outlines if len(outline) > 2]  # noqa: PLR2004 - an area


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
    refusal = unfit(image, plane, copy, ground, question.hints)
    water = refusal or _water_seen(image, plane, copy, ground, question, later)
    if isinstance(water, NoRiver):
        return water
    arcs = bank_lines(image, copy, water.water, ground)
    if not arcs:
        return NoRiver(RiverStatus.OUT_OF_IMAGE, "no bank is in view: the water ends where the image does")
    line = centreline(plane, copy, water)
    doubt = "" if question.hints else in_doubt(water)
    if doubt or line is None:
        status = RiverStatus.NO_CONTRAST if doubt else RiverStatus.ONE_BANK
        return NoRiver(status, doubt or WHY[status], by_direction(plane, arcs, question.flow_rad))
    river = _across(image, setup, pose, question, (copy, water, oriented(plane, line, question.flow_rad)), arcs)
    if isinstance(river, NoRiver) or question.hints.water:
        return river
    return like_a_road(copy, water.water, plane.places_en_m(river.edges.pixels_px[river.rows])) or river


def _water_seen(
    image: ImageArray,
    plane: WaterPlane,
    copy: SmallCopy,
    ground: BoolArray,
    question: RiverQuestion,
    later: LaterLook | None,
) -> WaterMask | NoRiver:
    """The water, less what a later look shows to stay as it is."""
    water = find_water(copy, question.network, question.hints, ground)
    if (refusal := no_water(water, ground)) is not None:
        return refusal
    water = with_clearer_banks(image, copy, water, hinted(copy, question.hints)[0])
    stayed = None if later is None else what_stays(image, plane, later, water.water, ground)
    if stayed is None:
        return water
    if stayed.in_water <= STAYS:
        return without_still(water, copy, stayed.still)
    return water if question.hints.water else NoRiver(RiverStatus.NO_WATER, _UNMOVED)


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


def oriented(plane: WaterPlane, line: Centreline, flow_rad: float | None) -> Centreline:
    """Downstream where that is known, which it then says; else up in the image, or right where the river crosses it."""
    ends = line.places_en_m[[0, -1]]
    if flow_rad is not None:
        along = float((ends[1] - ends[0]) @ [math.sin(flow_rad), math.cos(flow_rad)])
        return replace(line if along >= 0 else line.reversed(), is_downstream=True)
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
    stations_m = stations_along(line, question.spacing_m)
    found, *others = (
        transects(plane, copy, mask, water.ground, line, stations_m) for mask in (water.water, *water.bounds)
    )
    edges, status = locate_banks(image, plane, found, copy.scale, _by_motion(plane, copy, water, found))
    other_m = _otherwise_m(image, plane, copy.scale, edges, others)
    for row in np.flatnonzero(_unlike_neighbours(plane, found, edges, line.width_m)).tolist():
        status[row] = RiverStatus.UNLIKE_NEIGHBOURS if status[row] is RiverStatus.OK else status[row]
    seen_rows = np.flatnonzero([each is RiverStatus.OK for each in status])
    ambiguous = _ambiguous(other_m[seen_rows], line.width_m)
    for row in seen_rows[ambiguous].tolist():
        status[row] = RiverStatus.AMBIGUOUS
    rows = seen_rows[~ambiguous]
    banks_px = by_side(plane, arcs, line)
    if in_doubt(water) and not question.hints.tell_land and 2 * len(rows) < len(seen_rows):
        return NoRiver(RiverStatus.AMBIGUOUS, _POINT_AT_LAND, banks_px)
    if len(rows) == 0:
        worst = RiverStatus.TOO_COARSE if RiverStatus.TOO_COARSE in status else RiverStatus.OUT_OF_IMAGE
        return NoRiver(worst, WHY[worst], banks_px)
    pair = BankPair(
        edges.pixels_px[rows],
        edges.across_px[rows],
        edges.std_px[rows],
        max(question.least_std_px, common_bias_px(edges.std_px[rows])),
        np.where(np.isfinite(other_m[rows]), other_m[rows], 0.0) / _REACHES,
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
        islands=_islands(image, plane, copy.scale, found, others),
    )


def _otherwise_m(
    image: ImageArray, plane: WaterPlane, scale: float, edges: Edges, bounds: list[Transects]
) -> FloatArray:
    """How much wider the river is by the bound that differs most, ``(n,)``; its banks located as those of the water.

    Infinite where the lesser bound has no water: nobody can tell then.
    """
    nobody = np.zeros(edges.std_px.shape, dtype=bool)
    width_m = _width_m(plane, edges)
    least, greatest = (_width_m(plane, locate_banks(image, plane, each, scale, nobody)[0]) - width_m for each in bounds)
    least = np.where(np.isfinite(width_m) & np.isnan(least), -np.inf, np.nan_to_num(least))
    greatest = np.nan_to_num(greatest)
    return np.where(np.abs(greatest) > np.abs(least), greatest, least)


def _islands(image: ImageArray, plane: WaterPlane, scale: float, found: Transects, looks: list[Transects]) -> Islands:
    """The islands across transects; where a look has more or less of them dry, the std reaches there."""
    islands = islands_across(image, plane, found, scale)
    apart = [np.abs(islands_across(image, plane, look, scale).dry_m - islands.dry_m) for look in looks]
    return replace(islands, std_m=np.hypot(islands.std_m, np.max(apart, axis=0) / _REACHES))


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
    """Which transects ``(n,)`` another outline has far off, or nobody can tell.

    Where it has most of them far off, it is the river, and none is ambiguous for that.

    Args:
        other_m: ``(n,)``: how much wider the river is by the other outline.
        width_m: Of the river.
    """
    unknown = np.isinf(other_m)
    far = ~unknown & (np.abs(other_m) > _AMBIGUOUS * width_m)
    return unknown | (far & (2 * np.count_nonzero(far) < len(far)))


def _unlike_neighbours(plane: WaterPlane, found: Transects, edges: Edges, width_m: float) -> BoolArray:
    """Which transects ``(n,)`` have a bank that stands out."""
    places = plane.places_en_m(edges.pixels_px)
    offsets = np.sum((places - found.centres_en_m[:, None]) * found.to_left[:, None], axis=-1)
    moved = plane.places_en_m(edges.pixels_px + edges.std_px[..., None] * edges.across_px)
    std = np.linalg.norm(moved - places, axis=-1)
    sides = [flag_outliers(found.stations_m, offsets[:, side], std[:, side], width_m) for side in (0, 1)]
    return np.asarray(sides[0] | sides[1])
