"""Poses above the water of their own time, from poses above the station's elevation 0."""

from dataclasses import replace
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import STD_NAMES, LevelSeries, PoseBatch, PoseSample, Status, WaterLevel
from aerodft.service.height_sources import HEIGHT_SOURCES
from aerodft.service.pose.composition import raised

_HEIGHT: Final = STD_NAMES.index("height_agl_m")


def over_water(poses: PoseBatch, series: LevelSeries | None) -> PoseBatch:
    """Poses whose heights count from the water at their stamps.

    Args:
        poses: ``(n,)`` with heights above the station's elevation 0.
        series: The water's level; None where it is always there.

    Returns:
        The poses with the level that they were lowered by; ``NO_LEVEL`` where there is none.
    """
    if series is None:
        return poses
    level_m, std_m = series.at(poses.stamp_ns)
    is_unknown = np.isnan(level_m)
    origin = WaterLevel(level_m=np.nan, std_m=np.nan, zero_m=series.zero_m, datum=series.datum, source=series.source)

    def with_level(sample: PoseSample, is_unknown: bool) -> PoseSample:  # noqa: FBT001 - a value of a column
        if is_unknown and sample.status is Status.OK:
            return replace(sample, status=Status.NO_LEVEL, reasons=(_no_level(series),))
        reader = None if sample.height_source is None else HEIGHT_SOURCES.get(sample.height_source)
        is_own = reader is not None and reader.senses_water
        return replace(sample, level=None if is_unknown else replace(origin, is_height_own=is_own))

    poses = poses.with_variants(is_unknown.tolist(), with_level)
    poses = raised(replace(poses, level=np.stack([level_m, std_m], axis=-1)), np.nan_to_num(series.zero_m - level_m))
    std = poses.std.copy()
    std[:, _HEIGHT] = np.hypot(std[:, _HEIGHT], np.where(poses.has_own_height, 0.0, poses.level_std_m))
    return replace(poses, std=std)


def _no_level(series: LevelSeries) -> str:
    """Reason for a stamp without a level."""
    gap_s = (series.max_gap_ns or 0) / SECOND_NS
    return f"no reading of the water's level in {series.source} around the stamp: gaps are bridged up to {gap_s:g} s"
