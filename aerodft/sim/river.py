"""A river of which every bank point and every width is known in closed form."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerodft.model import FloatArray

_NEWTON_STEPS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Island:
    """A lens of land that splits the river in two.

    Attributes:
        station_m: River station of its middle.
        length_m: From tip to tip.
        width_m: At its middle.
    """

    station_m: float
    length_m: float
    width_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class River:
    """A river around a sine-shaped centreline, its width a sine too.

    River axes: ``along`` (the station) in the direction of flow, ``across`` to the left of it.

    Attributes:
        origin_en_m: East and north of station 0 on the river's straight axis.
        azimuth_rad: Direction of flow, clockwise from north.
        width_m: Mean width across the axis.
        width_swing_m: Amplitude of the width.
        width_wavelength_m: Its wavelength.
        meander_m: Amplitude of the centreline.
        meander_wavelength_m: Its wavelength.
        flow_mps: Speed of the water's texture.
        islands: Islands, not overlapping; a braided river has several.
    """

    origin_en_m: tuple[float, float] = (0.0, 0.0)
    azimuth_rad: float = math.pi / 2
    width_m: float = 22.0
    width_swing_m: float = 3.0
    width_wavelength_m: float = 90.0
    meander_m: float = 3.0
    meander_wavelength_m: float = 170.0
    flow_mps: float = 0.8
    islands: tuple[Island, ...] = ()

    def __post_init__(self) -> None:
        if not self.width_m > abs(self.width_swing_m):
            raise ValueError(f"river width {self.width_m} m swings by {self.width_swing_m} m, it must stay above 0")

    def centre_m(self, along_m: npt.ArrayLike) -> FloatArray:
        """The centreline's across coordinate, ``(...)``."""
        return self.meander_m * np.sin(2 * np.pi * np.asarray(along_m) / self.meander_wavelength_m)

    def banks_m(self, along_m: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """The across coordinates of the left and the right bank, each ``(...)``."""
        along = np.asarray(along_m, dtype=np.float64)
        half = 0.5 * (self.width_m + self.width_swing_m * np.sin(2 * np.pi * along / self.width_wavelength_m))
        centre = self.centre_m(along)
        return centre + half, centre - half

    def shores_m(self, along_m: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """The across coordinates of the islands' left and right shores, each ``(...)``; NaN where there is none."""
        along = np.asarray(along_m, dtype=np.float64)
        half = np.full(along.shape, np.nan)
        for island in self.islands:
            phase = (along - island.station_m) / island.length_m
            half = np.where(np.abs(phase) < 0.5, 0.5 * island.width_m * np.cos(np.pi * phase) ** 2, half)  # noqa: PLR2004 (from tip to tip)
        centre = self.centre_m(along)
        return centre + half, centre - half

    def enu(self, along_m: npt.ArrayLike, across_m: npt.ArrayLike) -> FloatArray:
        """River coordinates to ENU points on the plane, ``(..., 3)``."""
        along, across = np.broadcast_arrays(np.asarray(along_m, dtype=np.float64), np.asarray(across_m))
        sine, cosine = math.sin(self.azimuth_rad), math.cos(self.azimuth_rad)
        east = self.origin_en_m[0] + along * sine - across * cosine
        north = self.origin_en_m[1] + along * cosine + across * sine
        return np.stack([east, north, np.zeros_like(east)], axis=-1)

    def along_across(self, points_enu_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """ENU points ``(..., 2 or 3)`` to river coordinates, each ``(...)``."""
        east, north = points_enu_m[..., 0] - self.origin_en_m[0], points_enu_m[..., 1] - self.origin_en_m[1]
        sine, cosine = math.sin(self.azimuth_rad), math.cos(self.azimuth_rad)
        return east * sine + north * cosine, north * sine - east * cosine

    def crossing(self, stations_m: npt.ArrayLike) -> FloatArray:
        """Left and right bank points on the normal to the centreline at ``stations_m (...)``, ENU ``(..., 2, 3)``."""
        return np.stack([self._meet(stations_m, side, island=False) for side in (0, 1)], axis=-2)

    def island_crossing(self, stations_m: npt.ArrayLike) -> FloatArray:
        """As :meth:`crossing` for the islands' shores; NaN where the normal meets no island."""
        return np.stack([self._meet(stations_m, side, island=True) for side in (0, 1)], axis=-2)

    def width_at(self, stations_m: npt.ArrayLike) -> FloatArray:
        """Bank to bank along the normal to the centreline, islands included, ``(...)``."""
        points = self.crossing(stations_m)
        return np.asarray(np.linalg.norm(points[..., 0, :] - points[..., 1, :], axis=-1))

    def _meet(self, stations_m: npt.ArrayLike, side: int, *, island: bool) -> FloatArray:
        station = np.asarray(stations_m, dtype=np.float64)
        curve = self.shores_m if island else self.banks_m
        rate = 2 * np.pi / self.meander_wavelength_m
        slope = self.meander_m * rate * np.cos(rate * station)
        centre = self.centre_m(station)
        # Points of the normal are (station - slope * t, centre + t); Newton for where the curve passes through it.
        t = curve(station)[side] - centre
        for _ in range(_NEWTON_STEPS):
            along, step = station - slope * t, 1e-4
            miss = centre + t - curve(along)[side]
            derivative = 1 + slope * (curve(along + step)[side] - curve(along - step)[side]) / (2 * step)
            t = t - miss / derivative
        return self.enu(station - slope * t, centre + t)
