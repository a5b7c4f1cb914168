"""The height above the measured plane at a stamp, from the first source in the configured order that has one."""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import HeightSource
from aerodft.model.telemetry import HeightTrack, PositionTrack, Track
from aerodft.service.settings import HeightSettings
from aerodft.service.streams import Missing, Stream

_DATUM = {
    HeightSource.RANGEFINDER: "surface",
    HeightSource.TERRAIN: "terrain",
    HeightSource.HOME: "home",
    HeightSource.MANUAL: "manual",
}


@dataclass(frozen=True, slots=True)
class Height:
    """A height above the measured plane, its standard deviation, source, datum and age.

    ``foot_m`` is east and north, from the vehicle, of the surface that was measured to: a rangefinder that is bolted to
    a vehicle which leans does not look straight down.
    """

    height_agl_m: float
    std_m: float
    source: HeightSource
    datum: str
    age_s: float
    foot_m: tuple[float, float] = (0.0, 0.0)


class HeightSources:
    """All height streams; home-relative heights come with the position."""

    def __init__(self, settings: HeightSettings) -> None:
        self._settings = settings
        measured: list[HeightSource] = [source for source in settings.order if source is not HeightSource.MANUAL]
        self._streams = {source: Stream(settings.max_gap_ns) for source in measured}

    def streams(self) -> tuple[Stream, ...]:
        """All streams, for the watermark."""
        return tuple(self._streams.values())

    def append(self, track: Track, stamps_ns: IntArray) -> None:
        """Take a track in, if it carries a height."""
        if isinstance(track, PositionTrack) and HeightSource.HOME in self._streams:
            height = track.height_home_m + self._settings.home_above_plane_m
            self._streams[HeightSource.HOME].append(
                stamps_ns, value_m=height, std_m=np.full_like(height, np.nan), slant=np.zeros_like(height)
            )
        elif isinstance(track, HeightTrack) and track.source in self._streams:
            slant = np.full_like(track.value_m, float(track.slant))
            self._streams[track.source].append(stamps_ns, value_m=track.value_m, std_m=track.std_m, slant=slant)

    def at(self, stamp_ns: int, watermark_ns: int, vehicle_wxyz: FloatArray | Missing) -> Height | Missing:
        """The height at the stamp.

        Args:
            stamp_ns: UTC.
            watermark_ns: See ``Stream.find``.
            vehicle_wxyz: ``ned_SO3_body (4,)``, which slant ranges along the body need.
        """
        worst = Missing.NEVER
        for source in self._settings.order:
            if source is HeightSource.MANUAL:
                if self._settings.manual_m is not None:
                    return Height(self._settings.manual_m, self._settings.std_m[source], source, _DATUM[source], 0.0)
                continue
            found = self._measured(source, stamp_ns, watermark_ns, vehicle_wxyz)
            if not isinstance(found, Missing) or found is Missing.PENDING:
                return found
            worst = Missing.STALE if Missing.STALE in (worst, found) else worst
        return worst

    def _measured(
        self, source: HeightSource, stamp_ns: int, watermark_ns: int, vehicle_wxyz: FloatArray | Missing
    ) -> Height | Missing:
        stream = self._streams[source]
        found = stream.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing):
            return found
        value, foot_m = float(found.linear(stream.column("value_m"))), (0.0, 0.0)
        if stream.column("slant")[found.before]:
            if isinstance(vehicle_wxyz, Missing):
                return vehicle_wxyz
            north, east, down = (value * matrix(vehicle_wxyz)[:, 2]).tolist()
            value, foot_m = down, (east, north)
        reported = float(found.linear(stream.column("std_m")))
        std = max(self._settings.std_m[source], reported) if math.isfinite(reported) else self._settings.std_m[source]
        return Height(value, std, source, _DATUM[source], stream.age_s(stamp_ns) or 0.0, foot_m)
