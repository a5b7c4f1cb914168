"""Heights above the measured plane, from the first source in the configured order that has one."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final, TypeAlias

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import matrix
from aerodft.model import (
    FIX_3D,
    Batch,
    BoolArray,
    FloatArray,
    GpsTrack,
    HeightDifference,
    HeightSource,
    HeightSwitch,
    IntArray,
    LevelSeries,
    Selection,
    Track,
)
from aerodft.service.height_sources import HEIGHT_SOURCES, HeightSettings
from aerodft.service.pose.home_checks import (
    EARTH_RADIUS_M,
    IS_GROUNDED_STDS,
    MIN_STD_M,
    REFUSED_STDS,
    WIDENED_STDS,
    HomeChecks,
)
from aerodft.service.pose.surface_checks import CREDIBLE, ERRATIC, SCATTERED, STUCK, SurfaceChecks
from aerodft.service.streams import END_OF_TIME, LAST, Brackets, Missing, Query, Stream, TelemetryPart


class VerticalAccuracy:
    """Vertical accuracy reported by a GPS receiver.

    The last report holds while the receiver is silent or reports no accuracy, and after clocks restart. Without a 3D
    fix the standard deviation is never less than with the last fix.
    """

    def __init__(self) -> None:
        self.stream = Stream(0)  # never interpolated
        self._before_m = self._newest_m = self._with_fix_m = 0.0

    def may_append_ticks(self, track: GpsTrack) -> bool:
        """Whether reports of several ticks may be appended at once: not before the first accuracy."""
        return not self.stream.is_empty or not np.any(np.isfinite(track.vertical_std_m))

    def append(self, track: GpsTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append the reports of a step; ``row_end_by_tick`` as in ``Stream.append``."""
        is_stated = np.flatnonzero(np.isfinite(track.vertical_std_m))
        if self.stream.is_empty:
            self._before_m = self._newest_m
        std_m = track.vertical_std_m[is_stated]
        for row, has_fix in enumerate(track.fix[is_stated] >= FIX_3D):
            if has_fix:
                self._with_fix_m = float(std_m[row])
            std_m[row] = self._newest_m = max(float(std_m[row]), self._with_fix_m)
        ends = None if row_end_by_tick is None else np.searchsorted(is_stated, row_end_by_tick)
        self.stream.append(stamps_ns[is_stated], ends, std_m=std_m)

    def std_m(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Standard deviations at stamps ``(n,)`` as of ticks ``(n,)``; 0 if never reported."""
        if self.stream.is_empty:
            return np.full(len(stamps_ns), self._newest_m)
        rows = self.stream.last_before(stamps_ns, ticks)
        return np.where(rows >= 0, self.stream.column("std_m")[rows], self._before_m)


VehicleAt: TypeAlias = Callable[[Query], tuple[FloatArray, IntArray]]
"""``ned_SO3_body (n, 4)`` and ``Missing (n,)`` from stamps, ticks and watermarks ``(n,)``."""

_MAX_CLIMB_MPS: Final = 10.0  # faster between two samples is a step


@dataclass(frozen=True, slots=True, eq=False)
class HeightBatch(Batch):
    """Heights above the measured plane at ``n`` stamps; NaN where missing.

    Attributes:
        height_agl_m: ``(n,)``.
        std_m: ``(n,)`` standard deviations.
        age_s: ``(n,)`` time to the nearest sample.
        foot_m: ``(n, 2)`` east and north from the vehicle to the measured surface: a rangefinder fixed to a tilted
            vehicle does not look straight down.
        source: ``(n,)`` indices into ``order``; -1 where missing.
        missing: ``(n,)`` as ``Missing``.
        reasons: By row, sentences on sources that disagree or were skipped.
        refusals: By row without a height, sentences on sources that are not believed.
        order: The sources in order of preference.
    """

    height_agl_m: FloatArray
    std_m: FloatArray
    age_s: FloatArray
    foot_m: FloatArray
    source: IntArray
    missing: IntArray
    reasons: dict[int, tuple[str, ...]]
    refusals: dict[int, tuple[str, ...]]
    order: tuple[HeightSource, ...]

    @property
    def is_above_home(self) -> BoolArray:
        """Whether each height ``(n,)`` is above home, not above the surface below."""
        is_above_home = [HEIGHT_SOURCES[source].is_above_home for source in self.order]
        return np.array([*is_above_home, False])[self.source]

    @property
    def senses_water(self) -> BoolArray:
        """Whether each height ``(n,)`` was measured to the water as it is."""
        return np.array([*(HEIGHT_SOURCES[source].senses_water for source in self.order), False])[self.source]

    def rows(self, rows: Selection) -> "HeightBatch":
        """Heights ``(m,)`` of a selection."""
        old_rows = np.arange(len(self.source))[rows].tolist()
        sentences = [
            {new: by_row[old] for new, old in enumerate(old_rows) if old in by_row}
            for by_row in (self.reasons, self.refusals)
        ]
        return replace(Batch.rows(self, rows), reasons=sentences[0], refusals=sentences[1])


@dataclass(frozen=True, slots=True, eq=False)
class _SourceHeights:
    """Heights of one source at ``n`` stamps, as in ``HeightBatch``.

    Attributes:
        is_far: ``(n,)`` whether its reports are of places too far.
        is_credible: ``(n,)`` whether it has been seen to be a height: its std holds beside another source.
        remarks: By row, sentences on why it is not believed (``Missing.REFUSED``), or is less certain.
    """

    height_m: FloatArray
    std_m: FloatArray
    age_s: FloatArray
    foot_m: FloatArray
    missing: IntArray
    is_far: BoolArray
    is_credible: BoolArray
    remarks: dict[int, tuple[str, ...]]


class HeightSources(TelemetryPart):
    """Streams of all height sources in a station's order.

    Args:
        settings: Sources, stds and limits.
        level: The water's level, by which heights to the water and above home differ; None where it is always 0.
    """

    def __init__(self, settings: HeightSettings, level: LevelSeries | None = None) -> None:
        self._settings = settings
        self._level = level
        self._streams: dict[HeightSource, Stream] = {
            source: Stream(HEIGHT_SOURCES[source].gap_ns(settings))
            for source in settings.order
            if HEIGHT_SOURCES[source].is_live
        }
        self._gps_accuracy = VerticalAccuracy()
        self._home = HomeChecks(settings.max_gap_ns)
        self._surfaces = {
            source: SurfaceChecks(stream)
            for source, stream in self._streams.items()
            if not HEIGHT_SOURCES[source].is_above_home
        }

    def pose_streams(self) -> tuple[Stream, ...]:
        """Streams of the sources."""
        return tuple(self._streams.values())

    def streams(self) -> tuple[Stream, ...]:
        """All streams: also those that the sources are held against."""
        return (*self.pose_streams(), self._gps_accuracy.stream, *self._home.streams())

    def may_append_ticks(self, track: Track) -> bool:
        """Whether a track of several ticks may be appended at once."""
        return not isinstance(track, GpsTrack) or self._gps_accuracy.may_append_ticks(track)

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append a track with heights or their accuracy, as ``Stream.append``; other tracks are ignored."""
        self._home.append(track, stamps_ns, row_end_by_tick)
        if isinstance(track, GpsTrack):
            self._gps_accuracy.append(track, stamps_ns, row_end_by_tick)
            return
        for source, stream in self._streams.items():
            samples = HEIGHT_SOURCES[source].samples(track, self._settings)
            if samples is None:
                continue
            places = samples.lat_lon_rad
            stated = np.flatnonzero(np.isfinite(samples.value_m))
            ends = None if row_end_by_tick is None else np.searchsorted(stated, row_end_by_tick)
            stream.append(
                stamps_ns[stated],
                ends,
                value_m=samples.value_m[stated],
                std_m=samples.std_m[stated],
                slant=np.full(len(stated), float(samples.is_slant)),
                lat_lon_rad=np.full((len(stated), 2), np.nan) if places is None else places[stated],
                verdict=np.zeros(len(stated)),
                doubt_m=np.zeros(len(stated)),
            )

    def check(self, vehicle_before: Callable[[IntArray, IntArray], FloatArray]) -> None:
        """Judge the heights appended since, all tracks of the step being appended.

        Args:
            vehicle_before: The last ``ned_SO3_body (n, 4)`` up to stamps as of ticks, NaN where unknown.
        """
        correction_m = self._home.check(self._home_std_m)
        for source, stream in self._streams.items():
            if HEIGHT_SOURCES[source].is_above_home and np.any(correction_m):
                stream.column("value_m")[-len(correction_m) :] += correction_m
        for source, checks in self._surfaces.items():
            rows, ticks = checks.take_new()
            if not len(rows):
                continue
            stream = self._streams[source]
            stamps_ns, value_m = stream.stamps_ns[rows], stream.column("value_m")[rows]
            reported_m = stream.column("std_m")[rows]
            std_m = np.where(np.isfinite(reported_m), reported_m, self._stated_std_m(source))
            foot_m, down = np.zeros((len(rows), 2)), np.ones(len(rows))
            if np.any(stream.column("slant")[rows]):
                axis = matrix(vehicle_before(stamps_ns, ticks))[:, :, 2]
                foot_m, down = value_m[:, None] * axis[:, [1, 0]], axis[:, 2]
            home_std_m = self._home_std_m(stamps_ns, ticks)
            home_m, east_north_m = self._home.at(stamps_ns, ticks, home_std_m)
            home_m = home_m + self._settings.home_above_plane_m
            if HEIGHT_SOURCES[source].senses_water and self._level is not None:
                home_m = home_m - self._level.elevation_m(stamps_ns)
            home_std_m = np.hypot(home_std_m, self._settings.home_above_plane_std_m)
            checks.check(rows, value_m * down, std_m, (home_m, home_std_m), east_north_m + foot_m)

    def _home_std_m(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Standard deviations ``(n,)`` of heights above home."""
        return np.maximum(self._stated_std_m(HeightSource.HOME), self._gps_accuracy.std_m(stamps_ns, ticks))

    def at(
        self,
        query: Query,
        vehicle_at: VehicleAt,
        lat_lon_rad: FloatArray,
        ground_m: FloatArray | None = None,
    ) -> HeightBatch:
        """Heights ``(n,)``.

        Args:
            query: When, and as of which ticks.
            vehicle_at: The vehicle's attitude, for slant ranges along its down axis.
            lat_lon_rad: ``(n, 2)`` the vehicle's position, for its distance to the places of reports; NaN if unknown.
            ground_m: ``(n,)`` elevation of the ground below the vehicle, by which heights above home and above the
                surface differ; NaN if unknown, None for the level plane.
        """
        self.check(lambda stamps_ns, ticks: vehicle_at(Query.final(stamps_ns, ticks))[0])
        heights = self._missing_all(len(query))
        left = np.arange(len(query))
        remarks: dict[int, list[str]] = {}
        is_credible = np.full(len(query), fill_value=False)
        for source in self._settings.order:
            if not len(left):
                break
            values = self._heights_of(source, query.rows(left), vehicle_at, lat_lon_rad[left])
            for row in left[values.is_far].tolist():
                limit_m = HEIGHT_SOURCES[source].max_distance_m(self._settings)
                sentence = f"{source} is of a place more than {limit_m:g} m away, and is not taken"
                remarks.setdefault(row, []).append(sentence)
            for row, said in values.remarks.items():
                remarks.setdefault(int(left[row]), []).extend(said)
            is_credible[left] = values.is_credible
            _write_values(heights, left, values, source)
            left = left[np.isin(values.missing, (Missing.STALE, Missing.NEVER, Missing.REFUSED))]
        known = np.flatnonzero(heights.missing == Missing.NOTHING)
        ground_m = np.zeros(len(query)) if ground_m is None else ground_m
        differences = self._disagreements(query, heights, known, vehicle_at, ground_m)
        for row, found in differences.items():
            remarks.setdefault(row, []).extend(_remarks(found))
            if not is_credible[row]:
                heights.std_m[row] = max(heights.std_m[row], *(abs(each.step_m) for each in found))
                others = " and ".join(str(each.other) for each in found)
                source = heights.order[heights.source[row]]
                remarks[row].append(f"nothing shows whether {source} or {others} is right: the std holds both")
        for row, sentences in sorted(remarks.items()):
            if heights.missing[row] == Missing.NOTHING:
                heights.reasons[row] = tuple(sentences)
            elif heights.missing[row] == Missing.REFUSED:
                heights.refusals[row] = tuple(sentences)
        return heights

    def latest_differences(self, stamp_ns: int, vehicle_at: VehicleAt) -> list[HeightDifference]:
        """Differences between all pairs of sources at the time of their last reports up to a stamp."""
        pairs = combinations(self._settings.order, 2)
        found = (self._one_difference(first, second, stamp_ns, LAST, vehicle_at) for first, second in pairs)
        return [each for each in found if each is not None]

    def switch(
        self, before: HeightSource, after: HeightSource, stamp_ns: int, tick: IntArray, vehicle_at: VehicleAt
    ) -> HeightSwitch:
        """Change of source at a stamp, with the step between the sources at their last common time.

        ``tick (1,)`` as in ``Stream.find``.
        """
        step = self._one_difference(before, after, stamp_ns, tick, vehicle_at, max_age_ns=END_OF_TIME)
        if step is None and before in self._streams:
            reverse = self._one_difference(after, before, stamp_ns, tick, vehicle_at, max_age_ns=END_OF_TIME)
            step = None if reverse is None else reverse.reversed()
        return HeightSwitch(stamp_ns=stamp_ns, before=before, after=after, step=step)

    def _missing_all(self, count: int) -> HeightBatch:
        height_m, std_m, age_s = np.full((3, count), np.nan)
        source, missing = np.full(count, -1), np.full(count, int(Missing.NEVER))
        foot_m, order = np.zeros((count, 2)), self._settings.order
        return HeightBatch(height_m, std_m, age_s, foot_m, source, missing, {}, {}, order)

    def _heights_of(
        self,
        source: HeightSource,
        query: Query,
        vehicle_at: VehicleAt,
        lat_lon_rad: FloatArray,
    ) -> _SourceHeights:
        """Heights ``(n,)`` of a source."""
        count = len(query)
        height_m, std_m, age_s = np.full((3, count), np.nan)
        foot_m, (is_far, is_credible) = np.zeros((count, 2)), np.full((2, count), fill_value=False)
        remarks: dict[int, tuple[str, ...]] = {}
        if source not in self._streams:
            constant_m = HEIGHT_SOURCES[source].constant_m(self._settings)
            if constant_m is not None:
                height_m[:], std_m[:], age_s[:] = constant_m, self._stated_std_m(source), 0.0
            missing = np.where(np.isnan(height_m), Missing.NEVER, Missing.NOTHING)
            return _SourceHeights(height_m, std_m, age_s, foot_m, missing, is_far, is_credible, remarks)
        stream = self._streams[source]
        found, missing = stream.find(query)
        rows = np.flatnonzero(missing == Missing.NOTHING)
        if len(rows):
            is_far[rows] = self._is_far(source, found.rows(rows), lat_lon_rad[rows])
            missing[is_far] = Missing.STALE
            rows = rows[~is_far[rows]]
            near = query.rows(rows)
            vertical = self._vertical(source, found.rows(rows), near, vehicle_at)
            height_m[rows], std_m[rows], foot_m[rows], missing[rows] = vertical
            age_s[rows] = stream.ages_s(near.stamps_ns, found.rows(rows))
            std_m[rows] = np.maximum(std_m[rows], self._gps_std_m(source, near))
            known = np.flatnonzero(missing[rows] == Missing.NOTHING)
            rows, ends = rows[known], found.rows(rows[known])
            judge = self._judge_home if HEIGHT_SOURCES[source].is_above_home else self._judge_surface
            std_m[rows], is_credible[rows], sentences = judge(source, ends, height_m[rows], std_m[rows])
            for k, (is_refused, sentence) in sentences.items():
                remarks[int(rows[k])] = sentence
                missing[rows[k]] = Missing.REFUSED if is_refused else Missing.NOTHING
            if HEIGHT_SOURCES[source].is_above_home:
                std_m[rows] = np.hypot(std_m[rows], self._settings.home_above_plane_std_m)
        return _SourceHeights(height_m, std_m, age_s, foot_m, missing, is_far, is_credible, remarks)

    def _judge_home(self, source: HeightSource, ends: Brackets, height_m: FloatArray, std_m: FloatArray) -> "_Verdicts":
        """Stds ``(n,)``, credibility and remarks of heights above home between two samples."""
        doubts = [self._home.doubts(stamps_ns) for stamps_ns in ends.ends(self._streams[source].stamps_ns)]
        unexplained_m, ground_m, correction_m = (
            _larger(*(each[name] for each in doubts)) for name in ("unexplained_m", "ground_m", "correction_m")
        )
        least_m = np.maximum(std_m, MIN_STD_M)
        is_refused = np.abs(unexplained_m) > REFUSED_STDS * least_m
        is_unexplained = np.abs(unexplained_m) > WIDENED_STDS * least_m
        is_offset = np.abs(ground_m) > IS_GROUNDED_STDS * least_m
        wide_m = np.hypot(np.where(is_unexplained, unexplained_m, 0.0), np.where(is_offset, ground_m, 0.0))
        sentences: dict[int, tuple[bool, tuple[str, ...]]] = {}
        for k in np.flatnonzero(is_unexplained | is_offset | (correction_m != 0)).tolist():
            said = []
            if correction_m[k]:
                said.append(
                    f"the altitude and the vertical speed say that {source} jumped by {-correction_m[k]:.2f} m: it is"
                    f" corrected to {height_m[k]:.2f} m"
                )
            if is_unexplained[k]:
                what = "is not believed" if is_refused[k] else "is less certain"
                said.append(
                    f"{source} {what}: it says {height_m[k]:.2f} m where the vehicle's own vertical motion makes it"
                    f" {height_m[k] - unexplained_m[k]:.2f} m, {abs(unexplained_m[k]):.2f} m apart, its std is"
                    f" {std_m[k]:.2f} m"
                )
            if is_offset[k]:
                said.append(f"{source} said {ground_m[k]:.2f} m on the ground: its std holds this offset")
            sentences[k] = bool(is_refused[k]), tuple(said)
        follows = np.minimum(*(each["follows"] for each in doubts)) > 0
        return np.hypot(std_m, wide_m), follows, sentences

    def _judge_surface(
        self, source: HeightSource, ends: Brackets, height_m: FloatArray, std_m: FloatArray
    ) -> "_Verdicts":
        """Stds ``(n,)``, credibility and remarks of heights above the surface between two samples."""
        stream = self._streams[source]
        verdict = np.minimum(*ends.ends(stream.column("verdict")))
        doubt_m = np.maximum(*ends.ends(stream.column("doubt_m")))
        sentences: dict[int, tuple[bool, tuple[str, ...]]] = {}
        for k in np.flatnonzero(verdict <= STUCK).tolist():
            why = _SURFACE_FAULTS[float(verdict[k])].format(doubt_m=doubt_m[k])
            sentences[k] = True, (f"{source} says {height_m[k]:.2f} m and is not believed: {why}",)
        return np.hypot(std_m, doubt_m), verdict >= CREDIBLE, sentences

    def _stated_std_m(self, source: HeightSource) -> float:
        return self._settings.std_m.get(source, HEIGHT_SOURCES[source].std_m)

    def _gps_std_m(self, source: HeightSource, query: Query) -> FloatArray:
        """Vertical accuracy ``(n,)`` by GPS for a source above home; else 0."""
        is_above_home = HEIGHT_SOURCES[source].is_above_home
        return self._gps_accuracy.std_m(query.stamps_ns, query.ticks) if is_above_home else np.zeros(len(query))

    def _vertical(
        self, source: HeightSource, found: Brackets, query: Query, vehicle_at: VehicleAt
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Vertical heights ``(n,)`` between two samples, their std, feet ``(n, 2)``, and ``Missing``.

        Each slant range is rotated by the vehicle's attitude at its own time (at the stamp where that is unknown), so
        that over level ground a swaying vehicle keeps its height.
        """
        stream, count = self._streams[source], len(query)
        values_m, std_m = stream.column("value_m"), self._std_m(source, found)
        missing, foot_m = np.full(count, int(Missing.NOTHING)), np.zeros((count, 2))
        if not np.any(stream.column("slant")[found.before]):
            return found.linear(values_m), std_m, foot_m, missing
        at_stamp, missing = vehicle_at(query)
        slant_vectors = []
        for ends in (found.before, found.after):
            at_sample, lacks = vehicle_at(query.at(stream.stamps_ns[ends]))
            missing = np.where((missing == Missing.NOTHING) & (lacks == Missing.PENDING), lacks, missing)
            attitude = np.where((lacks == Missing.NOTHING)[:, None], at_sample, at_stamp)
            slant_vectors.append(values_m[ends, None] * matrix(attitude)[:, :, 2])
        north, east, down = (slant_vectors[0] + found.weight[:, None] * (slant_vectors[1] - slant_vectors[0])).T
        missing = np.where((missing == Missing.NOTHING) & ~(down > 0), Missing.STALE, missing)  # it looks up
        with np.errstate(invalid="ignore"):
            horizontal_m = np.hypot(north, east)
            cosine = down / np.hypot(horizontal_m, down)
            tilted_std_m = np.hypot(cosine * std_m, horizontal_m * self._settings.lean_std_rad)
        height_m = np.where(missing == Missing.NOTHING, down, np.nan)
        return height_m, tilted_std_m, np.stack([east, north], axis=-1), missing

    def _std_m(self, source: HeightSource, found: Brackets) -> FloatArray:
        """Reported standard deviations, else the configured one, increased by steps between two samples.

        A step faster than any climb (an edge below, a correction) happened at any time between the two: at the fraction
        ``w`` of the gap interpolation then has the error ``step sqrt(w (1 - w))``.
        """
        stream = self._streams[source]
        reported_m, (before_m, after_m) = found.linear(stream.column("std_m")), found.ends(stream.column("value_m"))
        known_m = np.where(np.isfinite(reported_m), reported_m, self._stated_std_m(source))
        step_m = np.maximum(0.0, np.abs(after_m - before_m) - _MAX_CLIMB_MPS * found.gap_ns / SECOND_NS)
        return np.asarray(np.hypot(known_m, step_m * np.sqrt(found.weight * (1 - found.weight))))

    def _is_far(self, source: HeightSource, found: Brackets, lat_lon_rad: FloatArray) -> BoolArray:
        """Whether one of two samples is of a place too far from the vehicle; unknown places are not."""
        is_far, limit_m = (
            np.full(len(lat_lon_rad), fill_value=False),
            HEIGHT_SOURCES[source].max_distance_m(self._settings),
        )
        if limit_m is None:
            return is_far
        for ends in found.ends(self._streams[source].column("lat_lon_rad")):
            away = np.remainder(ends - lat_lon_rad + math.pi, 2 * math.pi) - math.pi  # over 180 degrees of longitude
            away[:, 1] *= np.cos(lat_lon_rad[:, 0])
            is_far |= EARTH_RADIUS_M * np.hypot(*away.T) > limit_m
        return is_far

    def _disagreements(
        self,
        query: Query,
        heights: HeightBatch,
        known: IntArray,
        vehicle_at: VehicleAt,
        ground_m: FloatArray,
    ) -> dict[int, list[HeightDifference]]:
        """Differences, by row, to sources that are believed and disagree with the heights at rows ``known``."""
        disagreeing: dict[int, list[HeightDifference]] = {}
        for source in self._settings.order:
            rows = known[heights.source[known] == self._settings.order.index(source)]
            for other, stream in self._streams.items():
                if other == source or stream.is_empty or not len(rows):
                    continue
                pair, own = (source, other), query.rows(rows)
                for row, found in self._differences(pair, own, vehicle_at, ground_m[rows], only_disagreeing=True):
                    disagreeing.setdefault(int(rows[row]), []).append(found)
        return disagreeing

    def _is_refused(self, source: HeightSource, found: Brackets, std_m: FloatArray) -> BoolArray:
        """Whether samples ``(n,)`` of a source are not believed."""
        if not HEIGHT_SOURCES[source].is_above_home:
            return np.asarray(self._streams[source].column("verdict")[found.after] <= STUCK)
        unexplained_m = self._home.doubts(self._streams[source].stamps_ns[found.after])["unexplained_m"]
        return np.asarray(np.abs(unexplained_m) > REFUSED_STDS * np.maximum(std_m, MIN_STD_M))

    def _one_difference(
        self,
        source: HeightSource,
        other: HeightSource,
        stamp_ns: int,
        tick: IntArray,
        vehicle_at: VehicleAt,
        max_age_ns: int | None = None,
    ) -> HeightDifference | None:
        """Difference at one stamp as of a tick ``(1,)``; None if unknown."""
        query = Query.final(np.array([stamp_ns]), tick)
        found = self._differences((source, other), query, vehicle_at, np.zeros(1), max_age_ns=max_age_ns)
        return found[0][1] if found else None

    def _differences(
        self,
        pair: tuple[HeightSource, HeightSource],
        query: Query,
        vehicle_at: VehicleAt,
        ground_m: FloatArray,
        *,
        max_age_ns: int | None = None,
        only_disagreeing: bool = False,
    ) -> list[tuple[int, HeightDifference]]:
        """Differences ``other`` minus ``source`` of a pair at the last report of ``other`` before each stamp, by row.

        ``ground_m (n,)`` is the elevation of the ground below the vehicle.

        Rows are left out where that report is too old, or where ``source`` is missing at its time; with
        ``only_disagreeing`` also where one of the two is not believed.
        """
        (source, other), stamps_ns, ticks = pair, query.stamps_ns, query.ticks
        if source == other or other not in self._streams or self._streams[other].is_empty:
            return []
        stream = self._streams[other]
        last, limit_ns = stream.last_before(stamps_ns, ticks), stream.max_gap_ns if max_age_ns is None else max_age_ns
        rows = np.flatnonzero((last >= 0) & (stamps_ns - stream.stamps_ns[last] <= limit_ns))
        last = last[rows]
        when_ns = stream.stamps_ns[last]
        reported = Query.final(when_ns, ticks[rows])
        exact = Brackets(last, last, np.zeros(len(rows)), np.zeros_like(last), np.full(len(rows), fill_value=True))
        other_m, other_std_m, _, other_missing = self._vertical(other, exact, reported, vehicle_at)
        other_std_m = np.maximum(other_std_m, self._gps_std_m(other, reported))
        unknown_place = np.full((len(rows), 2), np.nan)
        source_heights = self._heights_of(source, reported, vehicle_at, unknown_place)
        source_m, std_m = source_heights.height_m, np.hypot(source_heights.std_m, other_std_m)
        source_m = source_m - HEIGHT_SOURCES[source].is_above_home * ground_m[rows]
        other_m = other_m - HEIGHT_SOURCES[other].is_above_home * ground_m[rows]
        if self._level is not None:
            elevation_m = self._level.elevation_m(when_ns)
            source_m = source_m - (not HEIGHT_SOURCES[source].senses_water) * elevation_m
            other_m = other_m - (not HEIGHT_SOURCES[other].senses_water) * elevation_m
        is_known = (other_missing == Missing.NOTHING) & np.isfinite(source_m)
        if only_disagreeing:
            is_known &= source_heights.missing == Missing.NOTHING
            is_known &= HeightDifference.is_step_significant(other_m - source_m, std_m)
            is_known &= ~self._is_refused(other, exact, other_std_m)
        return [
            (
                int(rows[k]),
                HeightDifference(
                    stamp_ns=int(when_ns[k]),
                    source=source,
                    other=other,
                    height_m=float(source_m[k]),
                    other_m=float(other_m[k]),
                    std_m=float(std_m[k]),
                ),
            )
            for k in np.flatnonzero(is_known).tolist()
        ]


_Verdicts: TypeAlias = tuple[FloatArray, BoolArray, dict[int, tuple[bool, tuple[str, ...]]]]
"""Stds ``(n,)``, whether heights are credible, and by row whether they are refused, with sentences."""

_SURFACE_FAULTS: Final = {
    STUCK: "it stood still while the vehicle climbed or sank",
    ERRATIC: "it does not follow the vehicle's vertical motion",
    SCATTERED: "it scatters by {doubt_m:.2f} m",
}


def _larger(first: FloatArray, second: FloatArray) -> FloatArray:
    """The larger in size of two values ``(n,)`` each."""
    return np.where(np.abs(first) >= np.abs(second), first, second)


def _write_values(found: HeightBatch, rows: IntArray, values: _SourceHeights, source: HeightSource) -> None:
    """Write a source's heights at rows into the batch; ``REFUSED`` goes before ``STALE``, that before ``NEVER``."""
    is_known = values.missing == Missing.NOTHING
    known_rows = rows[is_known]
    found.height_agl_m[known_rows], found.std_m[known_rows] = values.height_m[is_known], values.std_m[is_known]
    found.age_s[known_rows], found.foot_m[known_rows] = values.age_s[is_known], values.foot_m[is_known]
    found.source[known_rows] = found.order.index(source)
    before = found.missing[rows]
    keeps = (values.missing == Missing.NEVER) & (before == Missing.STALE)
    keeps |= np.isin(values.missing, (Missing.NEVER, Missing.STALE)) & (before == Missing.REFUSED)
    found.missing[rows] = np.where(keeps, before, values.missing)


def _remarks(differences: list[HeightDifference]) -> tuple[str, ...]:
    """Sentences on disagreeing sources."""
    sentences = [each.sentence() for each in differences]
    for first, second in combinations(differences, 2):
        between_m = abs(first.step_m - second.step_m)
        if between_m <= min(abs(first.step_m), abs(second.step_m)):
            sentences.append(f"{first.source} is alone: {first.other} and {second.other} are {between_m:.2f} m apart")
    return tuple(sentences)
