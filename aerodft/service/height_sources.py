"""The registry of height sources, ``HEIGHT_SOURCES``, and their settings.

A new source is an entry of ``HEIGHT_SOURCES`` and a telemetry decoder that gives a ``HeightTrack`` with its name. Its
name and standard deviation in station files, its datum in messages and its place in schemas follow.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.model import FloatArray, HeightSource, HeightTrack, PositionTrack, Track


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightSamples:
    """Heights in one track.

    Attributes:
        value_m: ``(n,)`` vertical heights, or distances along the vehicle's down axis (``is_slant``); NaN where the
            track has none.
        std_m: ``(n,)`` reported standard deviations; NaN where none is reported.
        lat_lon_rad: ``(n, 2)`` the point on the ground below; None where the message has none.
        is_slant: Whether the vehicle's roll and pitch matter.
    """

    value_m: FloatArray
    std_m: FloatArray
    lat_lon_rad: FloatArray | None = None
    is_slant: bool = False


@dataclass(frozen=True, kw_only=True)
class HeightReader:
    """Reader of one height source; the base class is for sensors that come as ``HeightTrack``.

    Attributes:
        name: Name in station files, messages and ``HeightTrack.source``.
        datum: Datum of its heights in messages.
        std_m: Standard deviation unless the station file or the reports have another.
        is_above_home: Whether heights are above home and come with the position: independent of the ground below,
            subject to GPS accuracy and to reboots. Other heights are above the surface below the camera.
        is_live: Whether it comes in tracks; else it is a number in the settings.
        senses_water: Whether heights are measured to the water as it is, whatever its level; other heights count from
            something that the water does not move.
    """

    name: HeightSource
    datum: str
    std_m: float
    is_above_home: bool = False
    is_live: bool = True
    senses_water: bool = True

    def gap_ns(self, settings: "HeightSettings") -> int:
        """Longest gap between two samples that is interpolated over."""
        return settings.max_gap_ns

    def max_distance_m(self, settings: "HeightSettings") -> float | None:  # noqa: ARG002 - other sources need them
        """Maximum distance of a report's place from the vehicle; None if reports have no place."""
        return None

    def samples(self, track: Track, settings: "HeightSettings") -> HeightSamples | None:  # noqa: ARG002
        """Heights of this source in a track; None in other tracks."""
        if not isinstance(track, HeightTrack) or track.source != self.name:
            return None
        return HeightSamples(
            value_m=track.value_m, std_m=track.std_m, lat_lon_rad=track.lat_lon_rad, is_slant=track.slant
        )

    def constant_m(self, settings: "HeightSettings") -> float | None:  # noqa: ARG002
        """Height of a source that is not live; None where the settings have none."""
        return None


class _Rangefinder(HeightReader):
    def gap_ns(self, settings: "HeightSettings") -> int:
        return settings.rangefinder_gap_ns


class _TerrainDatabase(HeightReader):
    def gap_ns(self, settings: "HeightSettings") -> int:
        return settings.terrain_gap_ns

    def max_distance_m(self, settings: "HeightSettings") -> float | None:
        return settings.terrain_max_distance_m


class _AboveHome(HeightReader):
    def samples(self, track: Track, settings: "HeightSettings") -> HeightSamples | None:
        if isinstance(track, PositionTrack):
            height_m = track.height_home_m + settings.home_above_plane_m
            return HeightSamples(value_m=height_m, std_m=np.full_like(height_m, np.nan))
        samples = super().samples(track, settings)
        return samples and replace(samples, value_m=samples.value_m + settings.home_above_plane_m)


class _ManualHeight(HeightReader):
    def constant_m(self, settings: "HeightSettings") -> float | None:
        return settings.manual_m


HEIGHT_SOURCES: Final[dict[HeightSource, HeightReader]] = {
    reader.name: reader
    for reader in (
        _Rangefinder(name=HeightSource.RANGEFINDER, datum="surface", std_m=0.2),
        _TerrainDatabase(name=HeightSource.TERRAIN, datum="terrain", std_m=3.0, senses_water=False),
        _AboveHome(name=HeightSource.HOME, datum="home", std_m=1.0, is_above_home=True, senses_water=False),
        _ManualHeight(name=HeightSource.MANUAL, datum="manual", std_m=0.5, is_live=False, senses_water=False),
    )
}
"""All sources by name, in the default order of preference."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSettings:
    """Height sources in order of preference, and their accuracy.

    Attributes:
        order: The first source with a value at the stamp wins.
        std_m: Standard deviation per source, unless messages have one (rangefinder) or a larger one (GPS).
        home_above_plane_m: Height of the home point above the measured plane; added to home-relative heights.
        home_above_plane_std_m: Its standard deviation.
        manual_m: The height, where ``manual`` is in the order.
        min_m: Below it the status is ``BELOW_MIN_HEIGHT``.
        max_gap_ns: Longest gap between two samples that is interpolated over, of positions and home-relative heights.
        rangefinder_gap_ns: Longest gap of a rangefinder.
        terrain_gap_ns: Longest gap of a terrain database.
        terrain_max_distance_m: Maximum distance from the vehicle to the place of a terrain report.
        lean_std_rad: Standard deviation of the vehicle's roll and pitch, and of the rangefinder on it.
    """

    order: tuple[HeightSource, ...] = tuple(name for name, reader in HEIGHT_SOURCES.items() if reader.is_live)
    std_m: dict[HeightSource, float] = field(
        default_factory=lambda: {name: reader.std_m for name, reader in HEIGHT_SOURCES.items()}
    )
    home_above_plane_m: float = 0.0
    home_above_plane_std_m: float = 0.0
    manual_m: float | None = None
    min_m: float = 1.0
    max_gap_ns: int = 2 * SECOND_NS
    rangefinder_gap_ns: int = SECOND_NS
    terrain_gap_ns: int = 5 * SECOND_NS
    terrain_max_distance_m: float = 150.0
    lean_std_rad: float = math.radians(0.2)
