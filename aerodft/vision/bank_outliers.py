"""Bank points that stand out from their neighbours: a post in front of the water, a boat, a mask that leaked."""

from typing import Final

import numpy as np

from aerodft.geometry.robust import robust_std
from aerodft.model.arrays import BoolArray, FloatArray

_REACH: Final = 4  # neighbours to either side
_LEAST: Final = 5  # neighbours without which nothing is said
_STDS: Final = 4.0
_FLOOR: Final = 0.004  # of the width: banks are no smoother


def stand_out(stations_m: FloatArray, offsets_m: FloatArray, std_m: FloatArray, width_m: float) -> BoolArray:
    """Which points of a bank are off the line through their neighbours by more than the bank's own roughness.

    Args:
        stations_m: ``(n,)`` along the river, rising.
        offsets_m: ``(n,)`` from the centreline; NaN where there is no point.
        std_m: ``(n,)`` how well each is known.
        width_m: Of the river.

    Returns:
        ``(n,)``; False where there is no point, or too few others to tell.
    """
    rough = np.full(len(offsets_m), np.nan)
    for row in np.flatnonzero(np.isfinite(offsets_m)).tolist():
        near = np.arange(max(row - _REACH, 0), min(row + _REACH + 1, len(offsets_m)))
        near = near[np.isfinite(offsets_m[near]) & (near != row)]
        if len(near) >= _LEAST:
            rough[row] = offsets_m[row] - _middle_line(stations_m[near], offsets_m[near], stations_m[row])
    told = np.isfinite(rough)
    if np.count_nonzero(told) < _LEAST:
        return np.zeros(len(offsets_m), dtype=bool)
    usual = robust_std(rough[told]) + _FLOOR * width_m
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(rough) > _STDS * np.hypot(usual, std_m))


def _middle_line(stations_m: FloatArray, offsets_m: FloatArray, at_m: float) -> float:
    """Of a few points, the line whose slope is the median of all pairs' (Theil and Sen), at one station."""
    first, second = np.triu_indices(len(stations_m), 1)
    slopes = (offsets_m[second] - offsets_m[first]) / (stations_m[second] - stations_m[first])
    slope = float(np.median(slopes))
    return float(np.median(offsets_m + slope * (at_m - stations_m)))
