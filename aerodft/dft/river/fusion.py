"""River widths of many images fused into those of a reach: independent errors average out, shared ones do not."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.dft.river.contradiction import CAUSES, Contradiction, Residuals, image_contradiction
from aerodft.dft.river.widths import RiverWidths
from aerodft.geometry import student_weights
from aerodft.model import FloatArray, IntArray

_STUDENT_DOF: Final = 4.0  # degrees of freedom of an image's own error: a mask that ran onto the bank is far off
_ITERATIONS: Final = 10  # of the reweighting
_MIN_IMAGES: Final = 3  # images of a transect from which its scatter is estimated
_NORMAL_MAD: Final = 0.6745  # median absolute deviation of a standard normal distribution
_MIN_RELATIVE_STD: Final = 1e-4  # of a width's own error: no bank is seen better


@dataclass(frozen=True, slots=True, eq=False)
class ImageWidths:
    """Widths that one image gives of a reach's transects.

    Attributes:
        transects: ``(k,)`` indices of the transects.
        widths: Their widths, usable ones only.
    """

    transects: IntArray
    widths: RiverWidths


@dataclass(frozen=True, slots=True, eq=False)
class ReachWidths:
    """Widths of a reach's transects, fused over images.

    Attributes:
        widths: ``(n,)`` of all transects; NaN where no image has one. Shared are the errors of pose, lens and
            elevation, taken to be equal in every image, and last the error of the images' mean relative bias.
        images: ``(n,)`` number of images behind a transect's width.
        scatter_m: ``(n,)`` robust standard deviation of one image's width around it; NaN of fewer than three.
        scatter_ratio: Ratio of the images' scatter to their stated standard deviations, at least 1.
        drift: ``(images,)`` relative bias of all widths of an image; NaN where it has none.
        contradiction: How far the images are apart beyond what their stated errors explain, and the likely cause.
    """

    widths: RiverWidths
    images: IntArray
    scatter_m: FloatArray
    scatter_ratio: float
    drift: FloatArray
    contradiction: Contradiction


def fuse_widths(seen: Sequence[ImageWidths], count: int) -> ReachWidths:
    """Fuse the widths of ``count`` transects over images.

    A transect's width is the mean weighted by each image's own error; weights follow a t distribution, so that an
    image with wrong banks hardly counts. Its standard deviation has the errors shared by all images in full: a height
    that is 1 % off makes every width 1 % wrong, of however many images.
    """
    table = _WidthTable(seen, count)
    mean, weight = table.robust_means()
    ratio = table.scatter_ratio(mean)
    mean, weight = table.robust_means(ratio)
    drift = table.drift(mean, weight)
    share = weight / table.sums(weight)[table.transect]
    shared = table.sums(share[:, None] * table.shared)
    mean_drift_std = _mean_drift_std(drift)
    own_std = np.sqrt(table.sums(np.square(share * ratio * table.own_m)))
    images = np.bincount(table.transect, minlength=count)
    is_empty = images == 0
    points = table.sums(share[:, None, None] * table.points_enu_m)
    widths = RiverWidths(
        width_m=np.where(is_empty, np.nan, mean),
        shared=np.concatenate([shared, np.where(is_empty, 0.0, mean_drift_std * mean)[:, None]], axis=-1),
        own_m=np.where(is_empty, 0.0, own_std),
        relative_range_std=np.where(is_empty, np.inf, 0.0),
        points_enu_m=np.where(is_empty[:, None, None], np.nan, points),
    )
    return ReachWidths(widths, images, table.scatter_m(mean), ratio, drift, table.contradiction(mean, weight, points))


class _WidthTable:
    """Widths of all images as rows ``(r,)``, with their transect and image."""

    def __init__(self, seen: Sequence[ImageWidths], count: int) -> None:
        self._count, self._image_count = count, len(seen)
        columns = max((each.widths.shared.shape[1] for each in seen), default=0)
        self.transect: IntArray = np.concatenate([np.empty(0, dtype=np.int64), *(each.transects for each in seen)])
        self.image = np.repeat(np.arange(len(seen)), [len(each.transects) for each in seen])
        self.width_m = np.concatenate([np.empty(0), *(each.widths.width_m for each in seen)])
        self.own_m = np.concatenate([np.empty(0), *(each.widths.own_m for each in seen)])
        self.own_m = np.maximum(self.own_m, _MIN_RELATIVE_STD * self.width_m)
        shared = [np.pad(each.widths.shared, ((0, 0), (0, columns - each.widths.shared.shape[1]))) for each in seen]
        self.shared = np.concatenate([np.empty((0, columns)), *shared])
        self.points_enu_m = np.concatenate([np.empty((0, 2, 3)), *(each.widths.points_enu_m for each in seen)])
        self._shift = _stacked(seen, "shift", columns)
        self._by_cause = _stacked(seen, "by_cause", len(CAUSES))

    def sums(self, rows: FloatArray) -> FloatArray:
        """Sums of rows ``(r, ...)`` by transect ``(n, ...)``; 0 for a transect without rows."""
        total = np.zeros((self._count, *rows.shape[1:]))
        np.add.at(total, self.transect, rows)
        return total

    def robust_means(self, ratio: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Robustly weighted mean widths ``(n,)`` and their weights ``(r,)``."""
        mean = self._medians(self.width_m)
        precision = 1.0 / np.square(ratio * self.own_m)
        weight = precision
        for _ in range(_ITERATIONS):
            squared_errors = np.square(self.width_m - mean[self.transect]) * precision
            weight = precision * student_weights(squared_errors, 1, _STUDENT_DOF)
            mean = self.sums(weight * self.width_m) / np.maximum(self.sums(weight), np.finfo(np.float64).tiny)
        return mean, weight

    def scatter_ratio(self, mean: FloatArray) -> float:
        """Ratio of the images' robust scatter to their stated standard deviations, at least 1."""
        is_sampled = np.bincount(self.transect, minlength=self._count)[self.transect] >= _MIN_IMAGES
        if not is_sampled.any():
            return 1.0
        normalized_errors = np.abs(self.width_m - mean[self.transect])[is_sampled] / self.own_m[is_sampled]
        return max(1.0, float(np.median(normalized_errors)) / _NORMAL_MAD)

    def contradiction(self, mean: FloatArray, weight: FloatArray, points_enu_m: FloatArray) -> Contradiction:
        """How far the images are apart beyond what their stated errors explain.

        A transect that lies elsewhere than computed has the width of there: a river that widens does not contradict.
        """
        images = np.bincount(self.transect, minlength=self._count)[self.transect]
        rows = np.flatnonzero(images > 1)
        if not len(rows):
            return Contradiction(0.0)
        slope, spacing_m = _slope(mean, points_enu_m)
        at, share = self.transect[rows], images[rows] / (images[rows] - 1.0)
        total = np.maximum(self.sums(weight), np.finfo(np.float64).tiny)
        mean_by_cause = self.sums(weight[:, None] * self._by_cause) / total[:, None]
        return image_contradiction(
            Residuals(
                image=self.image[rows],
                transect=at,
                width_m=self.width_m[rows],
                fused_m=mean[at],
                residual_m=(self.width_m[rows] - mean[at]) * np.sqrt(share),
                own_m=self.own_m[rows],
                shared=self.shared[rows] - slope[at, None] * self._shift[rows],
                shift_m=np.linalg.norm(self._shift[rows], axis=-1),
                spacing_m=spacing_m,
                by_cause=self._by_cause[rows] - mean_by_cause[at],
            )
        )

    def scatter_m(self, mean: FloatArray) -> FloatArray:
        """Robust standard deviation ``(n,)`` of one image's width; NaN of fewer than ``_MIN_IMAGES``."""
        images = np.bincount(self.transect, minlength=self._count)
        scatter = self._medians(np.abs(self.width_m - mean[self.transect])) / _NORMAL_MAD
        return np.where(images >= _MIN_IMAGES, scatter, np.nan)

    def drift(self, mean: FloatArray, weight: FloatArray) -> FloatArray:
        """Relative bias ``(images,)`` of each image's widths, weighted."""
        relative_errors = self.width_m / mean[self.transect] - 1.0
        total = np.bincount(self.image, weight, minlength=self._image_count)
        weighted = np.bincount(self.image, weight * relative_errors, minlength=self._image_count)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(total > 0, weighted / total, np.nan))

    def _medians(self, rows: FloatArray) -> FloatArray:
        order = np.argsort(self.transect, kind="stable")
        edges = np.searchsorted(self.transect[order], np.arange(self._count + 1))
        parts = (rows[order[start:stop]] for start, stop in pairwise(edges.tolist()))
        return np.array([float(np.median(part)) if len(part) else 0.0 for part in parts])


def _stacked(seen: Sequence[ImageWidths], name: str, columns: int) -> FloatArray:
    """Rows ``(r, columns)`` of all images' optional arrays; zeros where an image has none."""
    parts = [np.empty((0, columns))]
    for each in seen:
        known = getattr(each.widths, name)
        known = np.zeros((len(each.transects), columns)) if known is None else known
        parts.append(np.pad(known, ((0, 0), (0, columns - known.shape[1]))))
    return np.concatenate(parts)


def _slope(width_m: FloatArray, points_enu_m: FloatArray) -> tuple[FloatArray, float]:
    """Change ``(n,)`` of the width per metre downstream, 0 where unknown, and the transects' spacing, m."""
    slope = np.zeros(len(width_m))
    measured = np.flatnonzero(np.isfinite(points_enu_m).all(axis=(1, 2)) & (width_m > 0))
    middle_m = points_enu_m[measured].mean(axis=1)
    step_m = np.linalg.norm(np.diff(middle_m, axis=0), axis=-1)
    if not len(step_m) or not np.all(step_m > 0):
        return slope, 1.0
    slope[measured] = np.gradient(width_m[measured], np.append(0.0, np.cumsum(step_m)))
    return slope, float(np.median(step_m / np.diff(measured)))


def _mean_drift_std(drift: FloatArray) -> float:
    """Standard deviation of the mean of the images' relative biases."""
    known = drift[np.isfinite(drift)]
    return float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else 0.0
