"""One height source's samples, and the vertical height that they come to."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.interpolation import Bracket
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import HeightSource
from aerodft.service.settings import HeightSettings
from aerodft.service.streams import Missing, Stream

_EARTH_M: Final = 6_371_008.8
_CLIMB_MPS: Final = 10.0  # faster is no flight of a vehicle that measures


@dataclass(frozen=True, slots=True)
class Vertical:
    """A height, its standard deviation, and the foot of the beam: east and north, all in metres."""

    height_m: float
    std_m: float
    foot_m: tuple[float, float] = (0.0, 0.0)


class HeightSamples:
    """The samples of one source."""

    def __init__(self, settings: HeightSettings, source: HeightSource) -> None:
        self.stream = Stream(settings.gap_ns(source))
        self._lean_std_rad = settings.lean_std_rad
        self._max_distance_m = settings.terrain_max_distance_m
        self._default_std_m = settings.std_m[source]

    def append(
        self,
        stamps_ns: IntArray,
        value_m: FloatArray,
        std_m: FloatArray,
        edges: IntArray | None = None,
        *,
        is_slant: bool = False,
        lat_lon_rad: FloatArray | None = None,
    ) -> None:
        """Take in values ``(n,)``; ``edges`` as in ``TrackBuffer.append``.

        Slant ones are along the vehicle's down axis; places ``(n, 2)`` are what they are of.
        """
        places = np.full((len(value_m), 2), np.nan) if lat_lon_rad is None else lat_lon_rad
        slant = np.full_like(value_m, float(is_slant))
        self.stream.append(stamps_ns, edges, value_m=value_m, std_m=std_m, slant=slant, lat_lon_rad=places)

    def is_far(self, found: Bracket, lat_lon_rad: tuple[float, float]) -> bool:
        """Whether one of the samples is of another place than the vehicle's; unknown places are not far."""
        ends = self.stream.column("lat_lon_rad")[[found.before, found.after]]
        apart = np.remainder(ends - lat_lon_rad + math.pi, 2 * math.pi) - math.pi  # also over 180 degrees of longitude
        apart *= 1.0, math.cos(lat_lon_rad[0])
        return bool(np.any(_EARTH_M * np.linalg.norm(apart, axis=-1) > self._max_distance_m))

    def vertical(
        self, found: Bracket, stamp_ns: int, vehicle_at: Callable[[int], FloatArray | Missing]
    ) -> Vertical | Missing:
        """The vertical height between two samples.

        Each slant range is turned by the vehicle's attitude of its own moment (of ``stamp_ns`` where that one is not
        known), so that over level ground a swaying vehicle keeps its height.
        """
        value_m, std_m = self.stream.column("value_m"), self._std_m(found)
        if not self.stream.column("slant")[found.before]:
            return Vertical(float(found.linear(value_m)), std_m)
        now = vehicle_at(stamp_ns)
        if isinstance(now, Missing):
            return now
        beams = np.empty((2, 3))
        for end, row in enumerate((found.before, found.after)):
            then = vehicle_at(int(self.stream.stamps_ns[row]))
            if then is Missing.PENDING:
                return then
            beams[end] = value_m[row] * matrix(now if isinstance(then, Missing) else then)[:, 2]
        north, east, down = (beams[0] + found.weight * (beams[1] - beams[0])).tolist()
        if down <= 0:
            return Missing.STALE  # it looks up
        level_m = math.hypot(north, east)
        upright = down / math.hypot(level_m, down)
        return Vertical(down, math.hypot(upright * std_m, level_m * self._lean_std_rad), (east, north))

    def level_at_all(self, stamps_ns: IntArray, ticks: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Heights, standard deviations and ages (s) at stamps ``(n,)`` at ticks ``(n,)`` of those that came last.

        What ``vertical`` gives, to the last bit; NaN where it is not that simple: unknown, along the body, of a place,
        or with a step between the two samples.
        """
        found = self.stream.find_all(stamps_ns, ticks)
        values_m, reported_m = self.stream.all_of("value_m"), found.linear(self.stream.all_of("std_m"))
        before, after = found.ends(values_m)
        is_plain = found.is_known & (np.abs(after - before) <= _CLIMB_MPS * found.gap_ns / SECOND_NS)
        is_plain &= self.stream.all_of("slant")[found.before] == 0
        is_plain &= np.all(np.isnan([row[:, 0] for row in found.ends(self.stream.all_of("lat_lon_rad"))]), axis=0)
        std_m = np.where(np.isfinite(reported_m), reported_m, self._default_std_m)
        height_m = np.where(is_plain, found.linear(values_m), np.nan)
        return height_m, std_m, self.stream.ages_s(stamps_ns, found)

    def _std_m(self, found: Bracket) -> float:
        """What the message says of itself, else the stated one; and what a step between two samples adds.

        Whatever no vehicle climbs, an edge below or a correction, happened at any time between the two: a share ``w``
        into the gap the interpolation is then off by ``step sqrt(w (1 - w))``.
        """
        reported_m, value_m = float(found.linear(self.stream.column("std_m"))), self.stream.column("value_m")
        known_m = reported_m if math.isfinite(reported_m) else self._default_std_m
        climb_m = _CLIMB_MPS * found.gap_ns / SECOND_NS
        step_m = max(0.0, abs(float(value_m[found.after] - value_m[found.before])) - climb_m)
        return math.hypot(known_m, step_m * math.sqrt(found.weight * (1 - found.weight)))
