"""A reach of a river as many images show it: one map of its water, one centreline, transects that stay where they are.

Every image votes for each place that it shows. What most of them hold to be water is the reach; its transects are then
looked up in every image, so that widths of several images are of the same places.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.vision.water_features import WaterFeatures
from aerodft.vision.water_plane import WaterPlane
from aerodft.vision.waterway import Centreline, WaterMap, looked_up, middle_line

_CELLS_ACROSS: Final = 24.0  # of the river's width
_MOST_CELLS: Final = 4_000_000
_PAD_CELLS: Final = 3
_OUTLINE: Final = 7  # every so many pixels of a mask tell how far it reaches


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


def reach_line(views: Sequence[WaterView]) -> Centreline | None:
    """The centreline of the water that most views show; None where it has no bank on either side.

    Args:
        views: At least one; their planes in one ENU frame.
    """
    votes = _Votes(views)
    for view in views:
        votes.add(view)
    return middle_line(votes.water_map())


class _Votes:
    """Counts, for every place, of the images that show it, and of those that show water there."""

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

    def add(self, view: WaterView) -> None:
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
        self._water[rows, columns] += looked_up(view.channel, view.features.to_small(pixels)) & seen

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
