"""Where heights above the measured plane come from: a class or an entry of the table for each source.

A new source is an entry of ``HEIGHT_SOURCES``, and a telemetry decoder that gives a ``HeightTrack`` with its name. Its
name in a station's file, its standard deviation there, its datum in messages and its place in schemas follow.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from aerodft.model import FloatArray, HeightSource, HeightTrack, PositionTrack, Track

if TYPE_CHECKING:
    from aerodft.service.settings import HeightSettings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightSamples:
    """What one track says of a height.

    Attributes:
        value_m: ``(n,)`` vertical heights, or distances along the vehicle's down axis (``is_slant``).
        std_m: ``(n,)`` reported standard deviations; NaN where none is.
        lat_lon_rad: ``(n, 2)`` the place that it is the height above; None where the message says none.
        is_slant: Whether the vehicle's lean matters.
    """

    value_m: FloatArray
    std_m: FloatArray
    lat_lon_rad: FloatArray | None = None
    is_slant: bool = False


@dataclass(frozen=True, kw_only=True)
class HeightReader:
    """How one source of heights is read; as it stands here, of a sensor that comes as ``HeightTrack``.

    Attributes:
        name: In a station's file, in messages and in ``HeightTrack.source``.
        datum: What its heights are counted from, as messages say it.
        std_m: Standard deviation unless a station's file or the reports themselves say another.
        is_above_home: Whether it counts from home and comes with the position: the ground below does not matter to
            it, GPS accuracy does, and a reboot may move it. All others count from the surface below the camera.
        is_live: Whether it comes in tracks; else it is a number of the settings.
    """

    name: HeightSource
    datum: str
    std_m: float
    is_above_home: bool = False
    is_live: bool = True

    def gap_ns(self, settings: "HeightSettings") -> int:
        """Longest gap between two samples that is interpolated over."""
        return settings.max_gap_ns

    def max_distance_m(self, settings: "HeightSettings") -> float | None:  # noqa: ARG002 - other sources need them
        """How far the place of a report may be from the vehicle; None for a source whose reports name no place."""
        return None

    def samples(self, track: Track, settings: "HeightSettings") -> HeightSamples | None:  # noqa: ARG002
        """What a track says of this source's height; None where it is of something else."""
        if not isinstance(track, HeightTrack) or track.source != self.name:
            return None
        return HeightSamples(
            value_m=track.value_m, std_m=track.std_m, lat_lon_rad=track.lat_lon_rad, is_slant=track.slant
        )

    def constant_m(self, settings: "HeightSettings") -> float | None:  # noqa: ARG002
        """The height of a source that is not live; None where the settings state none."""
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
        if not isinstance(track, PositionTrack):
            return None
        height_m = track.height_home_m + settings.home_above_plane_m
        return HeightSamples(value_m=height_m, std_m=np.full_like(height_m, np.nan))


class _Stated(HeightReader):
    def constant_m(self, settings: "HeightSettings") -> float | None:
        return settings.manual_m


HEIGHT_SOURCES: Final[dict[HeightSource, HeightReader]] = {
    reader.name: reader
    for reader in (
        _Rangefinder(name=HeightSource.RANGEFINDER, datum="surface", std_m=0.2),
        _TerrainDatabase(name=HeightSource.TERRAIN, datum="terrain", std_m=3.0),
        _AboveHome(name=HeightSource.HOME, datum="home", std_m=1.0, is_above_home=True),
        _Stated(name=HeightSource.MANUAL, datum="manual", std_m=0.5, is_live=False),
    )
}
"""All sources by name, in the order in which they are believed unless a station's file says another."""
