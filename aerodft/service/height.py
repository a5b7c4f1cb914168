"""The height above the measured plane at a stamp, from the first source in the configured order that has one."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from aerodft.geometry.interpolation import Bracket
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.health import GpsTrack
from aerodft.model.height import HeightDifference, HeightSwitch
from aerodft.model.pose import HeightSource
from aerodft.model.telemetry import HeightTrack, PositionTrack, Track
from aerodft.service.height_samples import HeightSamples
from aerodft.service.receiver import VerticalAccuracy
from aerodft.service.settings import HeightSettings
from aerodft.service.streams import END_OF_TIME, Missing, Stream

VehicleAt = Callable[[int], FloatArray | Missing]
"""``ned_SO3_body (4,)`` at a stamp."""

DATUM: Final = {
    HeightSource.RANGEFINDER: "surface",
    HeightSource.TERRAIN: "terrain",
    HeightSource.HOME: "home",
    HeightSource.MANUAL: "manual",
}


@dataclass(frozen=True, slots=True)
class Height:
    """A height above the measured plane, its standard deviation, source, datum and age.

    ``foot_m`` is east and north, from the vehicle, of the surface that was measured to: a rangefinder that is bolted to
    a vehicle which leans does not look straight down. ``reasons`` say which other sources it disagrees with.
    """

    height_agl_m: float
    std_m: float
    source: HeightSource
    datum: str
    age_s: float
    foot_m: tuple[float, float] = (0.0, 0.0)
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Heights of one source at ``n`` stamps, as columns; see ``Height``. NaN where there is none."""

    height_agl_m: FloatArray
    std_m: FloatArray
    age_s: FloatArray
    source: HeightSource
    datum: str
    reasons: tuple[str, ...] = ()

    @staticmethod
    def of(height: Height) -> "Heights":
        """The one."""
        height_m, std_m, age_s = np.array([[height.height_agl_m], [height.std_m], [height.age_s]])
        return Heights(height_m, std_m, age_s, height.source, height.datum, height.reasons)

    @property
    def is_known(self) -> BoolArray:
        """``(n,)`` where there is one."""
        return ~(np.isnan(self.height_agl_m) | np.isnan(self.std_m))

    def rows(self, rows: IntArray) -> "Heights":
        """Some of them."""
        return replace(self, height_agl_m=self.height_agl_m[rows], std_m=self.std_m[rows], age_s=self.age_s[rows])

    def row(self, row: int) -> Height:
        """One that is known."""
        height_m, std_m, age_s = (float(column[row]) for column in (self.height_agl_m, self.std_m, self.age_s))
        return Height(height_m, std_m, self.source, self.datum, age_s, reasons=self.reasons)


class HeightSources:
    """All height streams; home-relative heights come with the position."""

    def __init__(self, settings: HeightSettings) -> None:
        self._settings = settings
        self._samples = {
            source: HeightSamples(settings, source) for source in settings.order if source is not HeightSource.MANUAL
        }
        self._receiver = VerticalAccuracy()

    def streams(self) -> tuple[Stream, ...]:
        """The streams of the sources, for the watermark."""
        return tuple(samples.stream for samples in self._samples.values())

    def remarks(self) -> tuple[Stream, ...]:
        """Streams that nothing waits for."""
        return (self._receiver.stream,)

    def may_come_together(self, track: Track) -> bool:
        """Whether several ticks of a track may be taken in at once."""
        return (
            not isinstance(track, GpsTrack)
            or self._receiver.has_begun()
            or not np.any(np.isfinite(track.vertical_std_m))
        )

    def append(self, track: Track, stamps_ns: IntArray, edges: IntArray | None = None) -> None:
        """Take a track in, if it carries a height, or how good one is; ``edges`` as in ``TrackBuffer.append``."""
        if isinstance(track, GpsTrack):
            self._receiver.append(track, stamps_ns, edges)
        elif isinstance(track, PositionTrack) and HeightSource.HOME in self._samples:
            height = track.height_home_m + self._settings.home_above_plane_m
            self._samples[HeightSource.HOME].append(stamps_ns, height, np.full_like(height, np.nan), edges)
        elif isinstance(track, HeightTrack) and track.source in self._samples:
            self._samples[track.source].append(
                stamps_ns, track.value_m, track.std_m, edges, is_slant=track.slant, lat_lon_rad=track.lat_lon_rad
            )

    def at(
        self,
        stamp_ns: int,
        watermark_ns: int,
        vehicle_at: VehicleAt,
        lat_lon_rad: tuple[float, float] | None = None,
    ) -> Height | Missing:
        """The height at the stamp.

        Args:
            stamp_ns: UTC.
            watermark_ns: See ``Stream.find``.
            vehicle_at: The vehicle's attitude, which slant ranges along the body need.
            lat_lon_rad: Where the vehicle is, for the distance to what a terrain report is about; None skips that.
        """
        worst = Missing.NEVER
        passed_over: list[str] = []
        for source in self._settings.order:
            found = self._found(source, stamp_ns, watermark_ns, vehicle_at, lat_lon_rad)
            if isinstance(found, Height):
                against = [self._difference(source, other, stamp_ns, vehicle_at) for other in self._samples]
                remarks = _remarks([each for each in against if each is not None])
                return replace(found, reasons=(*passed_over, *remarks))
            if self._is_far(source, stamp_ns, watermark_ns, lat_lon_rad):
                limit_m = self._settings.terrain_max_distance_m
                passed_over.append(f"{source} is of a place more than {limit_m:g} m away, and is not taken")
            if found is Missing.PENDING:
                return found
            worst = Missing.STALE if Missing.STALE in (worst, found) else worst
        return worst

    def at_all(self, stamps_ns: IntArray, ticks: IntArray) -> Heights:
        """What ``at`` gives for stamps ``(n,)`` at ticks ``(n,)`` of those that came last, to the last bit.

        None is known where it is not that simple: another source than home has ever spoken, or home itself has nothing
        plain.
        """
        home: Final = HeightSource.HOME
        first = next((source for source in self._settings.order if self._has_spoken(source)), None)
        if first is not home or sum(not each.stream.is_empty for each in self._samples.values()) > 1:
            nothing = np.full(len(stamps_ns), np.nan)
            return Heights(nothing, nothing, nothing, home, DATUM[home])
        height_m, std_m, age_s = self._samples[home].level_at_all(stamps_ns, ticks)
        return Heights(height_m, np.maximum(std_m, self._receiver.stds_m(stamps_ns, ticks)), age_s, home, DATUM[home])

    def _has_spoken(self, source: HeightSource) -> bool:
        if source is HeightSource.MANUAL:
            return self._settings.manual_m is not None
        return self._samples[source].stream.has_begun

    def differences(self, stamp_ns: int, vehicle_at: VehicleAt) -> list[HeightDifference]:
        """What every two sources said last, by a stamp, where both spoke of the same time."""
        pairs = combinations(self._settings.order, 2)
        found = (self._difference(first, second, stamp_ns, vehicle_at) for first, second in pairs)
        return [each for each in found if each is not None]

    def switch(self, before: HeightSource, after: HeightSource, stamp_ns: int, vehicle_at: VehicleAt) -> HeightSwitch:
        """That one source follows another at a stamp, with the step between the two when both last spoke."""
        step = self._difference(before, after, stamp_ns, vehicle_at, max_age_ns=END_OF_TIME)
        if step is None and before in self._samples:
            turned = self._difference(after, before, stamp_ns, vehicle_at, max_age_ns=END_OF_TIME)
            step = None if turned is None else turned.turned()
        return HeightSwitch(stamp_ns=stamp_ns, before=before, after=after, step=step)

    def _found(
        self,
        source: HeightSource,
        stamp_ns: int,
        watermark_ns: int,
        vehicle_at: VehicleAt,
        lat_lon_rad: tuple[float, float] | None,
    ) -> Height | Missing:
        if source is HeightSource.MANUAL:
            manual_m = self._settings.manual_m
            std_m = self._settings.std_m[source]
            return Missing.NEVER if manual_m is None else Height(manual_m, std_m, source, DATUM[source], 0.0)
        samples = self._samples[source]
        found = samples.stream.find(stamp_ns, watermark_ns)
        if isinstance(found, Missing):
            return found
        if self._is_far(source, stamp_ns, watermark_ns, lat_lon_rad):
            return Missing.STALE
        vertical = samples.vertical(found, stamp_ns, vehicle_at)
        if isinstance(vertical, Missing):
            return vertical
        height = self._height(vertical.height_m, vertical.std_m, source, stamp_ns)
        return replace(height, age_s=samples.stream.age_s(stamp_ns) or 0.0, foot_m=vertical.foot_m)

    def _is_far(
        self, source: HeightSource, stamp_ns: int, watermark_ns: int, lat_lon_rad: tuple[float, float] | None
    ) -> bool:
        """Whether what a source says at a stamp is about a place too far away."""
        if lat_lon_rad is None or source not in self._samples:
            return False
        samples = self._samples[source]
        found = samples.stream.find(stamp_ns, watermark_ns)
        return not isinstance(found, Missing) and samples.is_far(found, lat_lon_rad)

    def _height(self, value_m: float, std_m: float, source: HeightSource, stamp_ns: int) -> Height:
        """With the receiver's own opinion, where a height comes with the position and it is the worse one."""
        receivers_m = self._receiver.std_m(stamp_ns) if source is HeightSource.HOME else 0.0
        return Height(value_m, max(std_m, receivers_m), source, DATUM[source], 0.0)

    def _difference(
        self,
        source: HeightSource,
        other: HeightSource,
        stamp_ns: int,
        vehicle_at: VehicleAt,
        max_age_ns: int | None = None,
    ) -> HeightDifference | None:
        """``other`` against ``source`` when ``other`` last spoke; None: long ago, or the source was silent."""
        if source is other or other is HeightSource.MANUAL:
            return None
        stream = self._samples[other].stream
        row = int(np.searchsorted(stream.stamps_ns, stamp_ns, side="right")) - 1
        limit_ns = stream.max_gap_ns if max_age_ns is None else max_age_ns
        if row < 0 or stamp_ns - int(stream.stamps_ns[row]) > limit_ns:
            return None
        when_ns = int(stream.stamps_ns[row])
        vertical = self._samples[other].vertical(Bracket(row, row, 0.0, 0), when_ns, vehicle_at)
        own = self._found(source, when_ns, END_OF_TIME, vehicle_at, None)
        if isinstance(vertical, Missing) or isinstance(own, Missing):
            return None
        theirs = self._height(vertical.height_m, vertical.std_m, other, when_ns)
        return HeightDifference(
            stamp_ns=when_ns,
            source=source,
            other=other,
            height_m=own.height_agl_m,
            other_m=theirs.height_agl_m,
            std_m=math.hypot(own.std_m, theirs.std_m),
        )


def _remarks(differences: list[HeightDifference]) -> tuple[str, ...]:
    """Which sources a height disagrees with, in sentences."""
    beyond = [each for each in differences if each.is_beyond]
    sentences = [each.sentence() for each in beyond]
    for first, second in combinations(beyond, 2):
        between_m = abs(first.step_m - second.step_m)
        if between_m <= min(abs(first.step_m), abs(second.step_m)):
            sentences.append(f"{first.source} is alone: {first.other} and {second.other} are {between_m:.2f} m apart")
    return tuple(sentences)
