"""Widths of the same transects from many images: what is new in each averages out, what they share does not."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.dft.river.widths import RiverWidths
from aerodft.model import FloatArray, IntArray

_STUDENT: Final = 4.0  # degrees of freedom of what one image has off: a mask that ran onto the bank is far off
_ROUNDS: Final = 10
_FEWEST: Final = 3  # images of a transect that say how much they scatter
_NORMAL_MAD: Final = 0.6745  # median deviation of a normal distribution
_LEAST_OWN: Final = 1e-4  # of the width: no bank is seen better


@dataclass(frozen=True, slots=True, eq=False)
class SeenWidths:
    """What one image tells of a reach.

    Attributes:
        transects: ``(k,)`` which transects of the reach.
        widths: Of these, usable ones only.
    """

    transects: IntArray
    widths: RiverWidths


@dataclass(frozen=True, slots=True, eq=False)
class ReachWidths:
    """A reach's widths.

    Attributes:
        widths: ``(n,)`` of all transects; NaN where no image has one. Shared are the errors of pose, lens and
            elevation, taken to be the same in every image, and last what images differ by as wholes.
        images: ``(n,)`` how many images a transect's width is of.
        scatter_m: ``(n,)`` robust standard deviation of one image's width around it; NaN of fewer than three.
        scatter_ratio: What images scatter by, in what they state for themselves; 1 where they state enough.
        drift: ``(images,)`` how much larger all widths of an image are, relative; NaN where it has none.
    """

    widths: RiverWidths
    images: IntArray
    scatter_m: FloatArray
    scatter_ratio: float
    drift: FloatArray


def fuse(seen: Sequence[SeenWidths], count: int) -> ReachWidths:
    """The widths of ``count`` transects from what images tell of them.

    A transect's width is the weighted mean, by what is each image's own; weights follow a t distribution, so that an
    image whose banks are wrong hardly counts. Its standard deviation has in full what the errors shared by all images
    do to that mean: a height that is 1 % off makes every width 1 % wrong, of however many images.
    """
    table = _Table(seen, count)
    mean, weight = table.fitted()
    ratio = table.scatter_ratio(mean)
    mean, weight = table.fitted(ratio)
    drift = table.drift(mean, weight)
    part = weight / table.sums(weight)[table.transect]
    shared = table.sums(part[:, None] * table.shared)
    as_whole = _std_of_mean(drift)
    own = np.sqrt(table.sums(np.square(part * ratio * table.own_m)))
    images = np.bincount(table.transect, minlength=count)
    none = images == 0
    points = table.sums(part[:, None, None] * table.points_enu_m)
    widths = RiverWidths(
        width_m=np.where(none, np.nan, mean),
        shared=np.concatenate([shared, np.where(none, 0.0, as_whole * mean)[:, None]], axis=-1),
        own_m=np.where(none, 0.0, own),
        range_share=np.where(none, np.inf, 0.0),
        points_enu_m=np.where(none[:, None, None], np.nan, points),
    )
    return ReachWidths(widths, images, table.scatter_m(mean), ratio, drift)


class _Table:
    """All images' widths as rows: ``(r,)`` each, with their transect and image."""

    def __init__(self, seen: Sequence[SeenWidths], count: int) -> None:
        self._count, self._image_count = count, len(seen)
        most = max((each.widths.shared.shape[1] for each in seen), default=0)
        self.transect: IntArray = np.concatenate([np.empty(0, dtype=np.int64), *(each.transects for each in seen)])
        self.image = np.repeat(np.arange(len(seen)), [len(each.transects) for each in seen])
        self.width_m = np.concatenate([np.empty(0), *(each.widths.width_m for each in seen)])
        self.own_m = np.concatenate([np.empty(0), *(each.widths.own_m for each in seen)])
        self.own_m = np.maximum(self.own_m, _LEAST_OWN * self.width_m)
        spread = [np.pad(each.widths.shared, ((0, 0), (0, most - each.widths.shared.shape[1]))) for each in seen]
        self.shared = np.concatenate([np.empty((0, most)), *spread])
        self.points_enu_m = np.concatenate([np.empty((0, 2, 3)), *(each.widths.points_enu_m for each in seen)])

    def sums(self, rows: FloatArray) -> FloatArray:
        """Sums of rows ``(r, ...)`` by transect ``(n, ...)``; the least number where there is none."""
        total = np.zeros((self._count, *rows.shape[1:]))
        np.add.at(total, self.transect, rows)
        return total

    def fitted(self, ratio: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Means ``(n,)`` and the weights ``(r,)`` that they are made with."""
        mean = self._medians(self.width_m)
        precision = 1.0 / np.square(ratio * self.own_m)
        weight = precision
        for _ in range(_ROUNDS):
            squares = np.square(self.width_m - mean[self.transect]) * precision
            weight = precision * (_STUDENT + 1.0) / (_STUDENT + squares)
            mean = self.sums(weight * self.width_m) / np.maximum(self.sums(weight), np.finfo(np.float64).tiny)
        return mean, weight

    def scatter_ratio(self, mean: FloatArray) -> float:
        """How much more images scatter than they state; at least 1."""
        many = np.bincount(self.transect, minlength=self._count)[self.transect] >= _FEWEST
        if not many.any():
            return 1.0
        off = np.abs(self.width_m - mean[self.transect])[many] / self.own_m[many]
        return max(1.0, float(np.median(off)) / _NORMAL_MAD)

    def scatter_m(self, mean: FloatArray) -> FloatArray:
        """``(n,)``."""
        images = np.bincount(self.transect, minlength=self._count)
        scatter = self._medians(np.abs(self.width_m - mean[self.transect])) / _NORMAL_MAD
        return np.where(images >= _FEWEST, scatter, np.nan)

    def drift(self, mean: FloatArray, weight: FloatArray) -> FloatArray:
        """``(images,)``: weighted means of the relative differences."""
        off = self.width_m / mean[self.transect] - 1.0
        total = np.bincount(self.image, weight, minlength=self._image_count)
        part = np.bincount(self.image, weight * off, minlength=self._image_count)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(total > 0, part / total, np.nan))

    def _medians(self, rows: FloatArray) -> FloatArray:
        order = np.argsort(self.transect, kind="stable")
        edges = np.searchsorted(self.transect[order], np.arange(self._count + 1))
        parts = (rows[order[start:stop]] for start, stop in pairwise(edges.tolist()))
        return np.array([float(np.median(part)) if len(part) else 0.0 for part in parts])


def _std_of_mean(drift: FloatArray) -> float:
    """Standard deviation of the mean of what images differ by as wholes."""
    known = drift[np.isfinite(drift)]
    return float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else 0.0
