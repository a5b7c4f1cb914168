"""The vehicle's position in the station's ENU frame."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import east_north
from aerodft.model import Batch, FloatArray, GeoOrigin, IntArray, PositionTrack
from aerodft.service.settings import HeightSettings
from aerodft.service.streams import Missing, Stream

_MAX_CORRECTION_M: Final = 50.0  # of an estimator's own correction
_MAX_SPEED_MPS: Final = 150.0  # between two samples; faster is a jump


@dataclass(frozen=True, slots=True, eq=False)
class PositionBatch(Batch):
    """Vehicle positions at ``n`` stamps; NaN where missing.

    Attributes:
        east_north_m: ``(n, 2)``.
        velocity_enu_mps: ``(n, 3)``.
        lat_lon_alt: ``(n, 3)`` latitude, longitude (rad) and altitude (m MSL), NaN where the log has none.
        std_m: ``(n,)`` stated standard deviation of east and of north; NaN where the log has none.
        missing: ``(n,)`` as ``Missing``.
    """

    east_north_m: FloatArray
    velocity_enu_mps: FloatArray
    lat_lon_alt: FloatArray
    std_m: FloatArray
    missing: IntArray


class VehiclePositions:
    """Stream of the vehicle's positions, and the ENU origin.

    Attributes:
        stream: Samples of the positions.
        origin: The station's ENU origin; None before the first fix.

    Args:
        settings: Longest gap between samples, and height of home.
        origin: None takes the first fix, on the measured plane.
    """

    def __init__(self, settings: HeightSettings, origin: GeoOrigin | None) -> None:
        self.stream = Stream(settings.max_gap_ns)
        self.origin = origin
        self._home_above_plane_m = settings.home_above_plane_m

    def append(self, track: PositionTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append the positions of a step, at least one; ``row_end_by_tick`` as in ``Stream.append``."""
        columns = {name: getattr(track, name) for name in ("lat_rad", "lon_rad", "alt_msl_m", "height_home_m")}
        std_m = np.full(len(stamps_ns), np.nan) if track.std_m is None else track.std_m
        self.stream.append(stamps_ns, row_end_by_tick, **columns, std_m=std_m)
        if self.origin is None:
            plane_m = float(track.alt_msl_m[0]) - (float(track.height_home_m[0]) + self._home_above_plane_m)
            self.origin = GeoOrigin(
                lat_rad=float(track.lat_rad[0]),
                lon_rad=float(track.lon_rad[0]),
                alt_msl_m=None if math.isnan(plane_m) else plane_m,
            )

    def at(self, stamps_ns: IntArray, ticks: IntArray, watermark_ns: IntArray) -> PositionBatch:
        """Positions and velocities at stamps ``(n,)``; arguments as in ``Stream.find``."""
        count = len(stamps_ns)
        found, missing = self.stream.find(stamps_ns, ticks, watermark_ns)
        places, velocity, lat_lon_alt = (np.full((count, 2), np.nan), np.zeros((count, 3)), np.full((count, 3), np.nan))
        std_m = np.full(count, np.nan)
        if self.origin is None:
            missing = np.where(missing == Missing.NOTHING, Missing.NEVER, missing)
            return PositionBatch(places, velocity, lat_lon_alt, std_m, missing)
        rows = np.flatnonzero(missing == Missing.NOTHING)
        if not len(rows):
            return PositionBatch(places, velocity, lat_lon_alt, std_m, missing)
        found = found.rows(rows)
        names = "lat_rad", "lon_rad", "alt_msl_m", "height_home_m"
        lat, lon, alt, height_home = (self.stream.column(name) for name in names)
        height = np.where(np.isnan(alt), height_home, alt)
        before, after = (east_north(self.origin, lat[ends], lon[ends]) for ends in (found.before, found.after))
        step_m = after - before
        moves = found.gap_ns > 0
        per_s = np.where(moves, SECOND_NS / np.where(moves, found.gap_ns, 1), 0.0)
        places[rows] = before + found.weight[:, None] * step_m
        velocity[rows, :2] = step_m * per_s[:, None]
        velocity[rows, 2] = np.nan_to_num(height[found.after] - height[found.before]) * per_s
        eastward_rad = _wrap_pi(lon[found.after] - lon[found.before])  # also over the 180th meridian
        lon_rad = _wrap_pi(lon[found.before] + found.weight * eastward_rad)
        lat_lon_alt[rows] = np.column_stack([found.linear(lat), lon_rad, found.linear(alt)])
        std_m[rows] = np.maximum(*found.ends(self.stream.column("std_m")))
        is_jump = np.hypot(*step_m.T) > _MAX_CORRECTION_M + _MAX_SPEED_MPS * found.gap_ns / SECOND_NS
        missing[rows[is_jump]] = Missing.STALE
        places[rows[is_jump]] = lat_lon_alt[rows[is_jump]] = np.nan
        velocity[rows[is_jump]] = 0.0
        return PositionBatch(places, velocity, lat_lon_alt, std_m, missing)


def _wrap_pi(angle_rad: FloatArray) -> FloatArray:
    """Angles wrapped to [-pi, pi]; those within it unchanged to the last bit."""
    return np.where(
        np.abs(angle_rad) <= math.pi, angle_rad, angle_rad - 2 * math.pi * np.rint(angle_rad / (2 * math.pi))
    )
