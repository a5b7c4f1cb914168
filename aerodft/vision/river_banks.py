"""Banks and islands' shores along transects, each located by its own profile in the image."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray, IntArray
from aerodft.vision.bank_edges import Edges, locate_edges
from aerodft.vision.river_status import RiverStatus
from aerodft.vision.transects import Transects
from aerodft.vision.water_plane import WaterPlane

_WINDOWS_PX: Final = np.array([16.0, 12.0, 8.0, 6.0])  # how far a mask's outline may be off; a coarse one is off by 4
_MOTION_STD_PX: Final = 4.0  # of images of 1080p: the correlation's own blur
_STEP_M: Final = 0.5  # over which directions in the image are taken, at most
_ROOM: Final = 0.3  # of the way to the opposite bank: so far a profile may reach


@dataclass(frozen=True, slots=True, eq=False)
class Islands:
    """What is dry between the banks.

    Attributes:
        count: ``(n,)`` islands across each transect.
        dry_m: ``(n,)`` their widths together.
        std_m: ``(n,)`` how well that is known, by their shores alone.
    """

    count: IntArray
    dry_m: FloatArray
    std_m: FloatArray


def locate_banks(
    image: ImageArray, plane: WaterPlane, found: Transects, by_motion: BoolArray
) -> tuple[Edges, list[RiverStatus]]:
    """The banks of all transects ``(n, 2)``, left then right, NaN where the image ends first; and their statuses.

    Args:
        image: ``(height, width, 3)`` BGR.
        plane: The water's.
        found: The transects.
        by_motion: ``(n, 2)``: which banks are told by what moves: what looks like an edge there is another one.
    """
    count = len(found.stations_m)
    edges = Edges(*(np.full((count, 2, *tail), np.nan) for tail in ((2,), (), (), (2,))))
    status = np.full(count, "", dtype=object)
    offsets = np.stack([found.left_m, found.right_m], axis=-1)
    for side in range(2):
        rows = np.flatnonzero(np.isfinite(offsets[:, side]))
        opposite = np.nan_to_num(offsets[rows, 1 - side], nan=0.0)
        one = _located(image, plane, found, rows, (offsets[rows, side], opposite))
        moving = by_motion[rows, side] & np.isfinite(one.std_px)
        one.pixels_px[moving] = plane.pixels_px(found.places_en_m(offsets[:, side])[rows[moving]])
        one.std_px[moving] = _MOTION_STD_PX
        told = np.isfinite(one.std_px)
        status[rows[np.isnan(one.std_px)]] = RiverStatus.TOO_COARSE
        kept = rows[told]
        edges.pixels_px[kept, side], edges.std_px[kept, side] = one.pixels_px[told], one.std_px[told]
        edges.contrast[kept, side], edges.across_px[kept, side] = one.contrast[told], one.across_px[told]
    missing: list[bool] = np.any(np.isnan(edges.std_px), axis=-1).tolist()
    return edges, [
        each or (RiverStatus.OUT_OF_IMAGE if lost else RiverStatus.OK)
        for each, lost in zip(status.tolist(), missing, strict=True)
    ]


def islands_across(image: ImageArray, plane: WaterPlane, found: Transects) -> Islands:
    """The islands that transects cross; a shore whose profile cannot be told stays where the mask has it."""
    dry, variance = np.zeros(len(found.stations_m)), np.zeros(len(found.stations_m))
    count = np.bincount(found.shores, minlength=len(dry)).astype(np.int64)
    if len(found.shores):
        shores = np.empty((len(found.shores), 2))
        for side in range(2):
            here, there = found.shores_m[:, side], found.shores_m[:, 1 - side]
            # Seen from the water the island lies ahead: from its right shore to the left, from its left to the right.
            water = here + (here - there)
            edges = _located(image, plane, found, found.shores, (here, water))
            places = plane.places_en_m(edges.pixels_px)
            centres, to_left = found.centres_en_m[found.shores], found.to_left[found.shores]
            shores[:, side] = np.sum((places - centres) * to_left, axis=-1)
            moved = plane.places_en_m(edges.pixels_px + edges.across_px)
            metres = np.linalg.norm(moved - places, axis=-1) * np.where(np.isfinite(edges.std_px), edges.std_px, 4.0)
            np.add.at(variance, found.shores, np.nan_to_num(metres) ** 2)
        np.add.at(dry, found.shores, np.maximum(shores[:, 1] - shores[:, 0], 0.0))
    return Islands(count, dry, np.sqrt(variance))


def _located(
    image: ImageArray, plane: WaterPlane, found: Transects, rows: IntArray, offsets: tuple[FloatArray, FloatArray]
) -> Edges:
    """The steps at offsets of some transects, each with the offset of a place on the water's side of it.

    Their std is infinite where the image ends too soon for a profile, NaN where the river is too narrow in it.
    """
    edge_m, water_m = offsets
    centres, to_left = found.centres_en_m[rows], found.to_left[rows]
    sign = np.sign(edge_m - water_m)[:, None]
    places, inner = centres + edge_m[:, None] * to_left, centres + water_m[:, None] * to_left
    near, far = plane.pixels_px(places), plane.pixels_px(inner)
    step = np.minimum(_STEP_M, 0.02 * np.linalg.norm(places - inner, axis=-1))[:, None]
    across = _direction(plane, places, sign * to_left * step)
    along = _direction(plane, places, np.stack([-to_left[:, 1], to_left[:, 0]], axis=-1) * step)
    size = np.array([image.shape[1], image.shape[0]]) - 1
    border = np.min(np.minimum(near, size - near), axis=-1)
    room = _ROOM * np.linalg.norm(far - near, axis=-1)
    window = _window_px(np.minimum(room, border) / 2)
    edges = locate_edges(image, near, across, along, window)
    edges = locate_edges(image, edges.pixels_px, across, along, window)  # where the first look was off
    edges.std_px[(window <= 0) & (border <= room)] = np.inf
    edges.std_px[(window <= 0) & (border > room)] = np.nan
    return edges


def _window_px(limit_px: FloatArray) -> FloatArray:
    """The largest window of each limit ``(n,)``; 0 where it has none."""
    return np.asarray(np.max(np.where(limit_px[:, None] >= _WINDOWS_PX, _WINDOWS_PX, 0.0), axis=-1))


def _direction(plane: WaterPlane, places: FloatArray, step_m: FloatArray) -> FloatArray:
    """Unit vectors ``(n, 2)`` in the image of steps ``(n, 2)`` on the water."""
    moved = plane.pixels_px(places + step_m) - plane.pixels_px(places - step_m)
    with np.errstate(invalid="ignore"):
        return np.asarray(moved / np.linalg.norm(moved, axis=-1, keepdims=True))
