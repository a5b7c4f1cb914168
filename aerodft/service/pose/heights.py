"""Heights above the measured plane, each from the first source in the configured order that has one."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import Final, TypeAlias

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import Brackets, matrix
from aerodft.model import (
    FIX_3D,
    BoolArray,
    FloatArray,
    GpsTrack,
    HeightDifference,
    HeightSource,
    HeightSwitch,
    IntArray,
    Track,
)
from aerodft.service.height_sources import HEIGHT_SOURCES
from aerodft.service.settings import HeightSettings
from aerodft.service.streams import END_OF_TIME, LAST, Missing, Stream


class VerticalAccuracy:
    """What a receiver last said of its vertical accuracy; nothing that it loses makes a height better known.

    It counts until the receiver says something else: while it is silent, while it states no accuracy, and after clocks
    started anew. Without a 3D fix it is never less than it was with the last one.
    """

    def __init__(self) -> None:
        self.stream = Stream(0)  # nothing is interpolated
        self._before_m = self._newest_m = self._with_fix_m = 0.0

    def may_append_ticks(self, track: GpsTrack) -> bool:
        """Whether reports of several ticks can be told apart by tick: a first accuracy counts from its own tick on."""
        return not self.stream.is_empty or not np.any(np.isfinite(track.vertical_std_m))

    def append(self, track: GpsTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take in the reports of a step; ``row_end_by_tick`` as in ``Stream.append``."""
        stated = np.flatnonzero(np.isfinite(track.vertical_std_m))
        if self.stream.is_empty:
            self._before_m = self._newest_m
        std_m = track.vertical_std_m[stated]
        for row, has_fix in enumerate(track.fix[stated] >= FIX_3D):
            if has_fix:
                self._with_fix_m = float(std_m[row])
            std_m[row] = self._newest_m = max(float(std_m[row]), self._with_fix_m)
        ends = None if row_end_by_tick is None else np.searchsorted(stated, row_end_by_tick)
        self.stream.append(stamps_ns[stated], ends, std_m=std_m)

    def std_m(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Standard deviations by stamps ``(n,)`` as of ticks ``(n,)``; 0 where none was ever stated."""
        if self.stream.is_empty:
            return np.full(len(stamps_ns), self._newest_m)
        rows = self.stream.last_before(stamps_ns, ticks)
        return np.where(rows >= 0, self.stream.column("std_m")[rows], self._before_m)


VehicleAt: TypeAlias = Callable[[IntArray, IntArray, IntArray], tuple[FloatArray, IntArray]]
"""``ned_SO3_body (n, 4)`` at stamps as of ticks, by watermarks ``(n,)`` each; and why there is none, as ``Missing``."""

_EARTH_M: Final = 6_371_008.8
_CLIMB_MPS: Final = 10.0  # faster is no flight of a vehicle that measures


@dataclass(frozen=True, slots=True, eq=False)
class HeightBatch:
    """Heights above the measured plane at ``n`` stamps; NaN where there is none.

    Attributes:
        height_agl_m: ``(n,)``.
        std_m: ``(n,)`` standard deviations.
        age_s: ``(n,)`` distance in time to the nearest sample.
        foot_m: ``(n, 2)`` east and north, from the vehicle, of the surface that was measured to: a rangefinder that is
            bolted to a vehicle which leans does not look straight down.
        source: ``(n,)`` indices into ``order``; -1 where there is none.
        missing: ``(n,)`` why there is none, as ``Missing``.
        reasons: By row, which other sources it disagrees with and which were passed over, in sentences.
        order: The sources.
    """

    height_agl_m: FloatArray
    std_m: FloatArray
    age_s: FloatArray
    foot_m: FloatArray
    source: IntArray
    missing: IntArray
    reasons: dict[int, tuple[str, ...]]
    order: tuple[HeightSource, ...]

    @property
    def is_above_home(self) -> BoolArray:
        """``(n,)`` whether each counts from home, not from the surface below."""
        is_above_home = [HEIGHT_SOURCES[source].is_above_home for source in self.order]
        return np.array([*is_above_home, False])[self.source]

    def rows(self, rows: IntArray) -> "HeightBatch":
        """Heights by their indices ``(m,)``."""
        numbers = self.height_agl_m[rows], self.std_m[rows], self.age_s[rows], self.foot_m[rows], self.source[rows]
        reasons = {new: self.reasons[old] for new, old in enumerate(rows.tolist()) if old in self.reasons}
        return HeightBatch(*numbers, self.missing[rows], reasons, self.order)


@dataclass(frozen=True, slots=True, eq=False)
class _Values:
    """What one source says at ``n`` stamps, as in ``HeightBatch``; and whether its reports are of a place too far."""

    height_m: FloatArray
    std_m: FloatArray
    age_s: FloatArray
    foot_m: FloatArray
    missing: IntArray
    is_far: BoolArray


class HeightSources:
    """The samples of all sources of a station's order, and the height that the first of them has at a stamp."""

    def __init__(self, settings: HeightSettings) -> None:
        self._settings = settings
        self._streams: dict[HeightSource, Stream] = {
            source: Stream(HEIGHT_SOURCES[source].gap_ns(settings))
            for source in settings.order
            if HEIGHT_SOURCES[source].is_live
        }
        self._gps_accuracy = VerticalAccuracy()

    def streams(self) -> tuple[Stream, ...]:
        """The streams of the sources, for the watermark."""
        return tuple(self._streams.values())

    def remarks(self) -> tuple[Stream, ...]:
        """Streams that nothing waits for."""
        return (self._gps_accuracy.stream,)

    def may_append_ticks(self, track: Track) -> bool:
        """Whether a track of several ticks may be appended at once."""
        return not isinstance(track, GpsTrack) or self._gps_accuracy.may_append_ticks(track)

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take a track of a step in, if it carries a height, or how good one is; as ``Stream.append``."""
        if isinstance(track, GpsTrack):
            self._gps_accuracy.append(track, stamps_ns, row_end_by_tick)
            return
        for source, stream in self._streams.items():
            samples = HEIGHT_SOURCES[source].samples(track, self._settings)
            if samples is None:
                continue
            places = samples.lat_lon_rad
            stream.append(
                stamps_ns,
                row_end_by_tick,
                value_m=samples.value_m,
                std_m=samples.std_m,
                slant=np.full_like(samples.value_m, float(samples.is_slant)),
                lat_lon_rad=np.full((len(samples.value_m), 2), np.nan) if places is None else places,
            )

    def at(
        self,
        stamps_ns: IntArray,
        ticks: IntArray,
        watermark_ns: IntArray,
        vehicle_at: VehicleAt,
        lat_lon_rad: FloatArray,
    ) -> HeightBatch:
        """Heights at stamps.

        Args:
            stamps_ns: ``(n,)`` UTC.
            ticks: ``(n,)`` as in ``Stream.find``.
            watermark_ns: ``(n,)`` as in ``Stream.find``.
            vehicle_at: The vehicle's attitude, which slant ranges along the body need.
            lat_lon_rad: ``(n, 2)`` where the vehicle is, for the distance to what a terrain report is about; NaN where
                that is unknown.
        """
        found = self._nothing(len(stamps_ns))
        left = np.arange(len(stamps_ns))
        far: dict[int, list[str]] = {}
        for source in self._settings.order:
            if not len(left):
                break
            at = stamps_ns[left], ticks[left], watermark_ns[left]
            values = self._values(source, *at, vehicle_at, lat_lon_rad[left])
            for row in left[values.is_far].tolist():
                limit_m = HEIGHT_SOURCES[source].max_distance_m(self._settings)
                far.setdefault(row, []).append(f"{source} is of a place more than {limit_m:g} m away, and is not taken")
            _take_values(found, left, values, source)
            left = left[np.isin(values.missing, (Missing.STALE, Missing.NEVER))]
        known = np.flatnonzero(found.missing == Missing.NOTHING)
        disagreements = self._disagreements(stamps_ns, ticks, found, known, vehicle_at)
        for row in sorted(far.keys() | disagreements.keys()):
            if found.missing[row] == Missing.NOTHING:
                found.reasons[row] = (*far.get(row, ()), *disagreements.get(row, ()))
        return found

    def latest_differences(self, stamp_ns: int, vehicle_at: VehicleAt) -> list[HeightDifference]:
        """What every two sources said last, by a stamp, where both spoke of the same time."""
        pairs = combinations(self._settings.order, 2)
        found = (self._one_difference(first, second, stamp_ns, LAST, vehicle_at) for first, second in pairs)
        return [each for each in found if each is not None]

    def switch(
        self, before: HeightSource, after: HeightSource, stamp_ns: int, tick: IntArray, vehicle_at: VehicleAt
    ) -> HeightSwitch:
        """That one source follows another at a stamp, with the step between the two when both last spoke.

        ``tick (1,)`` as in ``Stream.find``.
        """
        step = self._one_difference(before, after, stamp_ns, tick, vehicle_at, max_age_ns=END_OF_TIME)
        if step is None and before in self._streams:
            reverse = self._one_difference(after, before, stamp_ns, tick, vehicle_at, max_age_ns=END_OF_TIME)
            step = None if reverse is None else reverse.reversed()
        return HeightSwitch(stamp_ns=stamp_ns, before=before, after=after, step=step)

    def _nothing(self, count: int) -> HeightBatch:
        height_m, std_m, age_s = np.full((3, count), np.nan)
        source, missing = np.full(count, -1), np.full(count, int(Missing.NEVER))
        foot_m, order = np.zeros((count, 2)), self._settings.order
        return HeightBatch(height_m, std_m, age_s, foot_m, source, missing, {}, order)

    def _values(
        self,
        source: HeightSource,
        stamps_ns: IntArray,
        ticks: IntArray,
        watermark_ns: IntArray,
        vehicle_at: VehicleAt,
        lat_lon_rad: FloatArray,
    ) -> _Values:
        """What a source says at stamps ``(n,)``."""
        count = len(stamps_ns)
        height_m, std_m, age_s = np.full((3, count), np.nan)
        foot_m, is_far = np.zeros((count, 2)), np.full(count, fill_value=False)
        if source not in self._streams:
            constant_m = HEIGHT_SOURCES[source].constant_m(self._settings)
            if constant_m is not None:
                height_m[:], std_m[:], age_s[:] = constant_m, self._stated_std_m(source), 0.0
            missing = np.where(np.isnan(height_m), Missing.NEVER, Missing.NOTHING)
            return _Values(height_m, std_m, age_s, foot_m, missing, is_far)
        stream = self._streams[source]
        found, missing = stream.find(stamps_ns, ticks, watermark_ns)
        rows = np.flatnonzero(missing == Missing.NOTHING)
        if len(rows):
            is_far[rows] = self._is_far(source, found.rows(rows), lat_lon_rad[rows])
            missing[is_far] = Missing.STALE
            rows = rows[~is_far[rows]]
            own = stamps_ns[rows], ticks[rows]
            vertical = self._vertical(source, found.rows(rows), *own, watermark_ns[rows], vehicle_at)
            height_m[rows], std_m[rows], foot_m[rows], missing[rows] = vertical
            age_s[rows] = stream.ages_s(stamps_ns[rows], found.rows(rows))
            std_m[rows] = np.maximum(std_m[rows], self._gps_std_m(source, *own))
        return _Values(height_m, std_m, age_s, foot_m, missing, is_far)

    def _stated_std_m(self, source: HeightSource) -> float:
        return self._settings.std_m.get(source, HEIGHT_SOURCES[source].std_m)

    def _gps_std_m(self, source: HeightSource, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Vertical accuracy ``(n,)`` by the GPS receiver, where a height comes with the position; else 0."""
        is_above_home = HEIGHT_SOURCES[source].is_above_home
        return self._gps_accuracy.std_m(stamps_ns, ticks) if is_above_home else np.zeros(len(stamps_ns))

    def _vertical(
        self,
        source: HeightSource,
        found: Brackets,
        stamps_ns: IntArray,
        ticks: IntArray,
        watermark_ns: IntArray,
        vehicle_at: VehicleAt,
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Vertical heights ``(n,)`` between two samples, standard deviations, feet ``(n, 2)`` and what is missing.

        Each slant range is turned by the vehicle's attitude of its own moment (of the stamp where that one is not
        known), so that over level ground a swaying vehicle keeps its height.
        """
        stream, count = self._streams[source], len(stamps_ns)
        values_m, std_m = stream.column("value_m"), self._std_m(source, found)
        missing, foot_m = np.full(count, int(Missing.NOTHING)), np.zeros((count, 2))
        if not np.any(stream.column("slant")[found.before]):
            return found.linear(values_m), std_m, foot_m, missing
        at_stamp, missing = vehicle_at(stamps_ns, ticks, watermark_ns)
        beams = []
        for ends in (found.before, found.after):
            at_sample, lost = vehicle_at(stream.stamps_ns[ends], ticks, watermark_ns)
            missing = np.where((missing == Missing.NOTHING) & (lost == Missing.PENDING), lost, missing)
            attitude = np.where((lost == Missing.NOTHING)[:, None], at_sample, at_stamp)
            beams.append(values_m[ends, None] * matrix(attitude)[:, :, 2])
        north, east, down = (beams[0] + found.weight[:, None] * (beams[1] - beams[0])).T
        missing = np.where((missing == Missing.NOTHING) & ~(down > 0), Missing.STALE, missing)  # it looks up
        with np.errstate(invalid="ignore"):
            level_m = np.hypot(north, east)
            upright = down / np.hypot(level_m, down)
            leaning_m = np.hypot(upright * std_m, level_m * self._settings.lean_std_rad)
        height_m = np.where(missing == Missing.NOTHING, down, np.nan)
        return height_m, leaning_m, np.stack([east, north], axis=-1), missing

    def _std_m(self, source: HeightSource, found: Brackets) -> FloatArray:
        """What the message says of itself, else the stated one; and what a step between two samples adds.

        Whatever no vehicle climbs, an edge below or a correction, happened at any time between the two: a share ``w``
        into the gap the interpolation is then off by ``step sqrt(w (1 - w))``.
        """
        stream = self._streams[source]
        reported_m, (before_m, after_m) = found.linear(stream.column("std_m")), found.ends(stream.column("value_m"))
        known_m = np.where(np.isfinite(reported_m), reported_m, self._stated_std_m(source))
        step_m = np.maximum(0.0, np.abs(after_m - before_m) - _CLIMB_MPS * found.gap_ns / SECOND_NS)
        return np.asarray(np.hypot(known_m, step_m * np.sqrt(found.weight * (1 - found.weight))))

    def _is_far(self, source: HeightSource, found: Brackets, lat_lon_rad: FloatArray) -> BoolArray:
        """Whether one of two samples is of another place than the vehicle's; unknown places are not far."""
        is_far, limit_m = (
            np.full(len(lat_lon_rad), fill_value=False),
            HEIGHT_SOURCES[source].max_distance_m(self._settings),
        )
        if limit_m is None:
            return is_far
        for ends in found.ends(self._streams[source].column("lat_lon_rad")):
            apart = np.remainder(ends - lat_lon_rad + math.pi, 2 * math.pi) - math.pi  # over 180 degrees of longitude
            apart[:, 1] *= np.cos(lat_lon_rad[:, 0])
            is_far |= _EARTH_M * np.hypot(*apart.T) > limit_m
        return is_far

    def _disagreements(
        self, stamps_ns: IntArray, ticks: IntArray, heights: HeightBatch, known: IntArray, vehicle_at: VehicleAt
    ) -> dict[int, tuple[str, ...]]:
        """By row, which sources the heights at some rows ``known`` disagree with, in sentences."""
        beyond: dict[int, list[HeightDifference]] = {}
        for source in self._settings.order:
            rows = known[heights.source[known] == self._settings.order.index(source)]
            for other, stream in self._streams.items():
                if other == source or stream.is_empty or not len(rows):
                    continue
                at = stamps_ns[rows], ticks[rows]
                for row, found in self._differences(source, other, *at, vehicle_at, only_beyond=True):
                    beyond.setdefault(int(rows[row]), []).append(found)
        return {row: _remarks(differences) for row, differences in beyond.items()}

    def _one_difference(
        self,
        source: HeightSource,
        other: HeightSource,
        stamp_ns: int,
        tick: IntArray,
        vehicle_at: VehicleAt,
        max_age_ns: int | None = None,
    ) -> HeightDifference | None:
        """The difference at one stamp, as of a tick ``(1,)``."""
        found = self._differences(source, other, np.array([stamp_ns]), tick, vehicle_at, max_age_ns=max_age_ns)
        return found[0][1] if found else None

    def _differences(
        self,
        source: HeightSource,
        other: HeightSource,
        stamps_ns: IntArray,
        ticks: IntArray,
        vehicle_at: VehicleAt,
        *,
        max_age_ns: int | None = None,
        only_beyond: bool = False,
    ) -> list[tuple[int, HeightDifference]]:
        """``other`` against ``source`` when ``other`` last spoke before each of the stamps ``(n,)``, by row.

        Left out is what was said too long ago, or while the source was silent.
        """
        if source == other or other not in self._streams or self._streams[other].is_empty:
            return []
        stream = self._streams[other]
        last, limit_ns = stream.last_before(stamps_ns, ticks), stream.max_gap_ns if max_age_ns is None else max_age_ns
        rows = np.flatnonzero((last >= 0) & (stamps_ns - stream.stamps_ns[last] <= limit_ns))
        last, ticks = last[rows], ticks[rows]
        when_ns, end = stream.stamps_ns[last], np.full(len(rows), END_OF_TIME)
        exact = Brackets(last, last, np.zeros(len(rows)), np.zeros_like(last), np.full(len(rows), fill_value=True))
        other_m, other_std_m, _, lost = self._vertical(other, exact, when_ns, ticks, end, vehicle_at)
        other_std_m = np.maximum(other_std_m, self._gps_std_m(other, when_ns, ticks))
        nowhere = np.full((len(rows), 2), np.nan)
        own = self._values(source, when_ns, ticks, end, vehicle_at, nowhere)
        std_m = np.hypot(own.std_m, other_std_m)
        is_known = (lost == Missing.NOTHING) & (own.missing == Missing.NOTHING)
        if only_beyond:
            is_known &= HeightDifference.is_step_beyond(other_m - own.height_m, std_m)
        return [
            (
                int(rows[k]),
                HeightDifference(
                    stamp_ns=int(when_ns[k]),
                    source=source,
                    other=other,
                    height_m=float(own.height_m[k]),
                    other_m=float(other_m[k]),
                    std_m=float(std_m[k]),
                ),
            )
            for k in np.flatnonzero(is_known).tolist()
        ]


def _take_values(found: HeightBatch, rows: IntArray, values: _Values, source: HeightSource) -> None:
    """Write what a source says at some rows into heights; of what is missing, stale outlasts never."""
    is_known = values.missing == Missing.NOTHING
    at = rows[is_known]
    found.height_agl_m[at], found.std_m[at] = values.height_m[is_known], values.std_m[is_known]
    found.age_s[at], found.foot_m[at] = values.age_s[is_known], values.foot_m[is_known]
    found.source[at] = found.order.index(source)
    keeps = (values.missing == Missing.NEVER) & (found.missing[rows] == Missing.STALE)
    found.missing[rows] = np.where(keeps, found.missing[rows], values.missing)


def _remarks(beyond: list[HeightDifference]) -> tuple[str, ...]:
    """Which sources a height disagrees with, in sentences."""
    sentences = [each.sentence() for each in beyond]
    for first, second in combinations(beyond, 2):
        between_m = abs(first.step_m - second.step_m)
        if between_m <= min(abs(first.step_m), abs(second.step_m)):
            sentences.append(f"{first.source} is alone: {first.other} and {second.other} are {between_m:.2f} m apart")
    return tuple(sentences)
