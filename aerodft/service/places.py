"""Where the vehicle is, in the station's ENU frame."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.geodesy import east_north
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.pose import GeoOrigin
from aerodft.model.telemetry import PositionTrack
from aerodft.service.settings import HeightSettings
from aerodft.service.streams import Missing, Stream

_JUMP_M: Final = 50.0  # an estimator may correct itself by that
_FASTEST_MPS: Final = 150.0  # what moves faster between two samples is none of them


@dataclass(frozen=True, slots=True)
class Place:
    """A position: metres, m/s, and latitude, longitude (rad) and altitude (m MSL)."""

    east_north_m: tuple[float, float]
    velocity_enu_mps: tuple[float, float, float]
    lat_lon_alt: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class PlaceColumns:
    """Places at ``n`` stamps; see ``Place``.

    Attributes:
        east_north_m: ``(n, 2)``.
        velocity_enu_mps: ``(n, 3)``.
        lat_lon_alt: ``(n, 3)``.
        is_known: ``(n,)`` where there is one.
    """

    east_north_m: FloatArray
    velocity_enu_mps: FloatArray
    lat_lon_alt: FloatArray
    is_known: BoolArray

    @staticmethod
    def of(place: Place) -> "PlaceColumns":
        """The one."""
        places, velocity = np.array([place.east_north_m]), np.array([place.velocity_enu_mps])
        return PlaceColumns(places, velocity, np.array([place.lat_lon_alt]), np.ones(1, dtype=np.bool_))

    def rows(self, rows: IntArray) -> "PlaceColumns":
        """Some of them."""
        numbers = self.east_north_m[rows], self.velocity_enu_mps[rows], self.lat_lon_alt[rows]
        return PlaceColumns(*numbers, self.is_known[rows])

    def row(self, row: int) -> Place:
        """One that is known."""
        numbers = self.east_north_m[row], self.velocity_enu_mps[row], self.lat_lon_alt[row]
        place, velocity, lat_lon_alt = (tuple(each.tolist()) for each in numbers)
        return Place(place, velocity, lat_lon_alt)


class Places:
    """The position stream.

    Attributes:
        stream: Its samples.
        origin: The station's ENU origin; None before the first fix.

    Args:
        settings: How far its samples may be apart, and where home is.
        origin: None takes the first fix, on the measured plane.
    """

    def __init__(self, settings: HeightSettings, origin: GeoOrigin | None) -> None:
        self.stream = Stream(settings.max_gap_ns)
        self.origin = origin
        self._home_above_plane_m = settings.home_above_plane_m

    def append(self, track: PositionTrack, stamps_ns: IntArray, edges: IntArray | None = None) -> None:
        """Take positions in, at least one; ``edges`` as in ``TrackBuffer.append``."""
        self.stream.append(stamps_ns, edges, lat_rad=track.lat_rad, lon_rad=track.lon_rad, alt_msl_m=track.alt_msl_m)
        if self.origin is None:
            above_plane = float(track.height_home_m[0]) + self._home_above_plane_m
            self.origin = GeoOrigin(
                lat_rad=float(track.lat_rad[0]),
                lon_rad=float(track.lon_rad[0]),
                alt_msl_m=float(track.alt_msl_m[0]) - above_plane,
            )

    def at(self, stamp_ns: int, watermark_ns: int) -> Place | Missing:
        """Position and velocity at the stamp; ``watermark_ns`` as in ``Stream.find``."""
        found = self.stream.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing) or self.origin is None:
            return found if isinstance(found, Missing) else Missing.NEVER
        lat, lon, alt = (self.stream.column(name) for name in ("lat_rad", "lon_rad", "alt_msl_m"))
        ends = [found.before, found.after]
        corners = np.column_stack([east_north(self.origin, lat[ends], lon[ends]), alt[ends]])
        apart = corners[1] - corners[0]
        if np.linalg.norm(apart[:2]) > _JUMP_M + _FASTEST_MPS * found.gap_ns / SECOND_NS:
            return Missing.STALE
        velocity = apart * (SECOND_NS / found.gap_ns) if found.gap_ns else np.zeros(3)
        eastward_rad = math.remainder(lon[found.after] - lon[found.before], 2 * math.pi)  # also over the 180th meridian
        return Place(
            tuple((corners[0, :2] + found.weight * apart[:2]).tolist()),
            tuple(velocity.tolist()),
            (
                float(found.linear(lat)),
                math.remainder(lon[found.before] + found.weight * eastward_rad, 2 * math.pi),
                float(found.linear(alt)),
            ),
        )

    def at_all(self, stamps_ns: IntArray, ticks: IntArray) -> PlaceColumns:
        """What ``at`` gives for stamps ``(n,)`` at ticks ``(n,)`` of those that came last, to the last bit.

        Not known where it is not that simple: unknown, a jump, or the 180th meridian.
        """
        count = len(stamps_ns)
        velocity = np.zeros((count, 3))
        if self.origin is None or self.stream.is_empty:
            return PlaceColumns(np.zeros((count, 2)), velocity, velocity, np.zeros(count, dtype=np.bool_))
        found = self.stream.find_all(stamps_ns, ticks)
        lat, lon, alt = (self.stream.all_of(name) for name in ("lat_rad", "lon_rad", "alt_msl_m"))
        before, after = (east_north(self.origin, lat[rows], lon[rows]) for rows in (found.before, found.after))
        apart, eastward_rad = after - before, lon[found.after] - lon[found.before]
        with np.errstate(divide="ignore"):
            per_s = SECOND_NS / found.gap_ns
        moves = found.gap_ns > 0
        velocity[moves, :2] = apart[moves] * per_s[moves, None]
        velocity[moves, 2] = (alt[found.after] - alt[found.before])[moves] * per_s[moves]
        lon_rad = lon[found.before] + found.weight * eastward_rad
        is_plain = found.is_known & (np.abs(eastward_rad) < math.pi) & (np.abs(lon_rad) < math.pi)
        is_plain &= np.hypot(*apart.T) < _JUMP_M  # at any speed
        lat_lon_alt = np.column_stack([found.linear(lat), lon_rad, found.linear(alt)])
        return PlaceColumns(before + found.weight[:, None] * apart, velocity, lat_lon_alt, is_plain)
