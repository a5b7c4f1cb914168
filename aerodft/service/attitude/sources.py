"""The camera's attitude at stamps, from the first source in the configured order that has one; and a gimbal's reports.

Of each gimbal the frame of its reports is learned, and whether they are demands or measurements.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import slerp, yaw_pitch_roll
from aerodft.model import (
    Batch,
    BoolArray,
    FloatArray,
    GimbalSource,
    GimbalTrack,
    GimbalTypeTrack,
    HeadingTrack,
    IntArray,
    MountAxes,
    ReportFrame,
    Track,
    VehicleTrack,
)
from aerodft.service.attitude.cross_check import heading_doubts, source_difference
from aerodft.service.attitude.gimbal_frame import FrameDetector, FrameEvidence, gravity_samples
from aerodft.service.attitude.mounts import GIMBAL_MOUNTS
from aerodft.service.attitude.readings import AttitudeBatch, AttitudeBrackets, Readings, Resolver
from aerodft.service.attitude.slew import Demands, demands_before
from aerodft.service.batches import tick_after
from aerodft.service.gimbal_sources import is_own_statement
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import LAST, Brackets, Missing, Query, Stream, TelemetryPart

_MAX_PENDING_NS: Final = 10 * SECOND_NS  # of reports that wait for a query of their frame
_MIN_REPORTS: Final = 100
_MIN_REPORTS_TO_CONTRADICT: Final = 10  # chosen: a second of a usual stream; a stray report contradicts nobody
_MAX_REPEAT_FRACTION: Final = 0.1  # no two measurements are equal to the last bit


class Gimbal:
    """Reports of one gimbal source.

    Attributes:
        stream: Samples of the reports.
    """

    def __init__(self, settings: AttitudeSettings) -> None:
        self.stream = Stream(settings.max_gap_ns)
        self._settings = settings
        self._detector = FrameDetector()
        self._processed_ns: int | None = None
        self._last_wxyz: FloatArray | None = None
        self._initial = self._detector.evidence
        self._later: list[tuple[int, FrameEvidence]] = []  # with the whole second from which on each applies
        self._counts: IntArray = np.zeros((1, 2), dtype=np.int64)  # reports and repeats by each tick

    @property
    def has_reported(self) -> bool:
        """Whether there was any report."""
        return bool(self._counts[-1, 0] > 0)

    def append(self, track: GimbalTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append the reports of a step, as ``Stream.append``, delayed to when the camera follows them."""
        if not len(stamps_ns):
            return
        stamps_ns = stamps_ns + self._settings.delay_ns
        earth = track.yaw_in_earth.astype(np.float64)
        std_rad = np.full((len(earth), 4), np.nan) if track.std_rad is None else track.std_rad
        self.stream.append(stamps_ns, row_end_by_tick, wxyz=track.wxyz, yaw_in_earth=earth, std_rad=std_rad)
        before = track.wxyz[:1] + 1 if self._last_wxyz is None else self._last_wxyz
        same = np.diff(track.wxyz, axis=0, prepend=before) == 0
        repeats = np.concatenate([[0], np.cumsum(np.all(same, axis=-1))])
        ends = np.array([len(stamps_ns)]) if row_end_by_tick is None else row_end_by_tick
        self._counts = self._counts[-1] + np.stack([ends, repeats[ends]], axis=-1)
        self._last_wxyz = track.wxyz[-1:]

    def commit(self, vehicle: Stream) -> None:
        """End the step; process reports that have been pending too long."""
        self.stream.commit()
        self._counts = self._counts[-1:]
        self._keep_last_evidence()
        if (self.stream.last_ns or 0) - (self._processed_ns or 0) > _MAX_PENDING_NS:
            self._process_pending(vehicle)

    def _keep_last_evidence(self) -> None:
        """Drop earlier evidence: no later query is as of an earlier tick."""
        self._initial = self._detector.evidence
        self._later = []

    def clear(self) -> None:
        """Remove samples of another boot, and their evidence: the gimbal may be another one."""
        self._detector = FrameDetector()
        self._processed_ns = self._last_wxyz = None
        self._counts = np.zeros((1, 2), dtype=np.int64)
        self._keep_last_evidence()
        self.stream.clear()

    def shift(self, by_ns: int, vehicle: Stream) -> None:
        """Shift all stamps; call it before shifting the vehicle's."""
        self._process_pending(vehicle)
        self._detector.end_motion()
        self._processed_ns = None if self._processed_ns is None else self._processed_ns + by_ns
        self._keep_last_evidence()
        self.stream.shift(by_ns)

    def evidence(self, vehicle: Stream) -> FrameEvidence:
        """Evidence on the reports' frame as of the last tick."""
        evidences, evidence_index = self.evidence_at(vehicle, LAST)
        return evidences[int(evidence_index[0])]

    def evidence_at(self, vehicle: Stream, ticks: IntArray) -> tuple[list[FrameEvidence], IntArray]:
        """Evidence as of ticks ``(n,)``: a list, and the index of each tick's."""
        self._process_pending(vehicle)
        passed_ns = np.minimum(self.stream.newest_ns(ticks), vehicle.newest_ns(ticks)) // SECOND_NS * SECOND_NS
        held_from = np.array([from_ns for from_ns, _ in self._later], dtype=np.int64)
        return [self._initial, *(evidence for _, evidence in self._later)], held_from.searchsorted(passed_ns, "right")

    def is_demand(self, frame: ReportFrame | None, ticks: IntArray) -> BoolArray:
        """Whether the reports may be demands as of ticks ``(n,)``.

        Only reports that vary and are relative to the horizon are measurements.

        Args:
            frame: The frame decided by the evidence.
            ticks: As in ``Stream.find``.
        """
        counts = self._counts[ticks if len(self._counts) > 1 else np.zeros_like(ticks)]
        if self._settings.is_demand is not None:
            return np.full(len(counts), self._settings.is_demand)
        reports, repeats = counts.T
        varied = (reports >= _MIN_REPORTS) & (repeats < _MAX_REPEAT_FRACTION * reports)
        return np.asarray(~varied | ((self._settings.frame or frame) is not ReportFrame.EARTH))

    def demands(
        self, before: IntArray, stamps_ns: IntArray, ticks: IntArray, axes: MountAxes, vehicle: Stream
    ) -> tuple[Demands, FloatArray]:
        """Demands before stamps ``(n,)`` as of ticks ``(n,)``, and their attitudes ``(k, 4)``.

        Args:
            before: ``(n,)`` rows of the last samples that are not after the stamps.
            stamps_ns: ``(n,)``.
            ticks: ``(n,)`` as in ``Stream.find``.
            axes: Servo order of the reports' angles, of ``GIMBAL_MOUNTS``.
            vehicle: The vehicle's attitude.
        """
        settings, stream = self._settings, self.stream
        demands = demands_before(
            stream.stamps_ns,
            before,
            stamps_ns,
            stream.rows_known_at(ticks)[0],
            lag_ns=settings.lag_ns,
            slew_radps=settings.slew_radps,
        )
        first, stop = int(np.min(demands.first)), int(np.max(demands.stop))
        rows_used = slice(first, max(first, stop))
        wxyz, in_earth = stream.column("wxyz")[rows_used], stream.column("yaw_in_earth")[rows_used] > 0
        if not (mount := GIMBAL_MOUNTS[axes]).is_euler:
            body_rows = np.searchsorted(vehicle.stamps_ns, stream.stamps_ns[rows_used], side="right")
            bodies = vehicle.column("wxyz")[np.maximum(body_rows, 1) - 1]
            wxyz = mount.camera_wxyz(wxyz, bodies, yaw_in_earth=in_earth)
        rows = Demands(demands.first - first, demands.stop - first, demands.since_ns[rows_used], demands.stamps_ns)
        return rows, wxyz

    def _process_pending(self, vehicle: Stream) -> None:
        """Process new reports up to the last common whole second, independently of how ticks are grouped."""
        last_ns = min(self.stream.last_ns or 0, vehicle.last_ns or 0) // SECOND_NS * SECOND_NS
        if self._processed_ns is not None and last_ns <= self._processed_ns:
            return
        samples = gravity_samples(self.stream, vehicle, after_ns=self._processed_ns or 0, until_ns=last_ns)
        if samples is not None:
            for stamp_ns, evidence in self._detector.update_all(samples):
                self._later.append((tick_after(stamp_ns, SECOND_NS), evidence))
        self._processed_ns = last_ns


_DEFAULT_READING: Final = (ReportFrame.EARTH, MountAxes.TILT_OUTER)


@dataclass(frozen=True, slots=True, eq=False)
class GimbalQuery(Batch):
    """Stamps of a query for a gimbal's attitude, and the samples around them.

    Attributes:
        stamps_ns: ``(n,)`` UTC.
        ticks: ``(n,)`` as in ``Stream.find``.
        found: The gimbal's samples around the stamps, all known.
        vehicle: The vehicle's samples around the stamps.
    """

    stamps_ns: IntArray
    ticks: IntArray
    found: Brackets
    vehicle: Brackets


class _ReadingMode(NamedTuple):
    """Common properties of reports that are read together."""

    reading: tuple[ReportFrame, MountAxes]
    is_body_found: bool
    is_demand: bool
    yaw_in_earth: bool
    has_vehicle: bool


def refusal(source: GimbalSource, evidence: FrameEvidence, stated: ReportFrame | None) -> str | None:
    """Sentence on why reports are rejected as configured, or at all; None where they are not."""
    if stated is ReportFrame.EARTH and evidence.frame is ReportFrame.BODY:
        return (
            f"{source} is body-frame (against the vehicle, not the horizon): it undid {evidence.undone} of the "
            f"vehicle's {evidence.motions} motions; "
            'set telemetry.attitude.frame = "auto" or "body"'
        )
    if stated is None and evidence.contradictory:
        return (
            f"{source} is earth-frame (against the horizon) at times and body-frame (against the vehicle) at others; "
            'set telemetry.attitude.frame = "earth" or "body"'
        )
    return None


def readings_of(
    source: GimbalSource, gimbal: Gimbal, vehicle: Stream, settings: AttitudeSettings, query: GimbalQuery
) -> Iterator[tuple[IntArray, Readings]]:
    """Readings of reports, with the rows of the query that each covers.

    Args:
        source: The message.
        gimbal: Its reports.
        vehicle: The vehicle's attitude.
        settings: Configured properties of the reports.
        query: Stamps whose reports are not rejected.
    """
    in_earth, _ = query.found.ends(gimbal.stream.column("yaw_in_earth"))
    evidences, evidence_index = gimbal.evidence_at(vehicle, query.ticks)
    rows_by_mode: dict[_ReadingMode, list[IntArray]] = {}
    likely = [evidence.reading_probabilities(settings.frame, settings.axes) for evidence in evidences]
    for number in np.unique(evidence_index).tolist():
        evidence = evidences[number]
        rows = np.flatnonzero(evidence_index == number)
        likeliest = max(likely[number], key=likely[number].__getitem__)
        is_body_found = settings.frame is None and evidence.frame is ReportFrame.BODY
        is_demand = gimbal.is_demand(evidence.frame, query.ticks[rows])
        flags = is_demand, in_earth[rows] > 0, query.vehicle.is_known[rows]
        for is_demand_flag, yaw_is_north, has_vehicle in _combinations(*flags):
            reading = likeliest if has_vehicle else _DEFAULT_READING
            mode = _ReadingMode(reading, is_body_found, is_demand_flag, yaw_is_north, has_vehicle)
            is_same = np.all([bit == value for bit, value in zip(flags, mode[2:], strict=True)], axis=0)
            rows_by_mode.setdefault(mode, []).append(rows[is_same])
    for mode, parts in rows_by_mode.items():
        rows = np.concatenate(parts)
        shares = np.array([list(each.values()) for each in likely])[evidence_index[rows]]
        yield rows, _read(source, gimbal, vehicle, mode, query.rows(rows), dict(zip(likely[0], shares.T, strict=True)))


def _combinations(*bits: BoolArray) -> list[tuple[bool, ...]]:
    """Combinations that occur in columns ``(n,)``."""
    return sorted(set(zip(*(column.tolist() for column in bits), strict=True)))


def _read(
    source: GimbalSource,
    gimbal: Gimbal,
    vehicle: Stream,
    mode: _ReadingMode,
    query: GimbalQuery,
    probabilities: dict[tuple[ReportFrame, MountAxes], FloatArray],
) -> Readings:
    stream, reported, found = gimbal.stream, gimbal.stream.column("wxyz"), query.found
    has_previous = found.before > stream.rows_known_at(query.ticks)[0]
    frame, axes = mode.reading
    query_rows = found.before, query.stamps_ns, query.ticks
    return Readings(
        source=source,
        age_s=stream.ages_s(query.stamps_ns, found),
        report=AttitudeBrackets.from_brackets(reported, found),
        previous=np.where(has_previous[:, None], reported[found.before - 1], np.nan),
        vehicle=AttitudeBrackets.from_brackets(vehicle.column("wxyz"), query.vehicle) if mode.has_vehicle else None,
        frame=frame,
        axes=axes,
        yaw_in_earth=mode.yaw_in_earth,
        demands=gimbal.demands(*query_rows, axes, vehicle) if mode.is_demand else None,
        is_body_found=mode.is_body_found,
        probabilities=probabilities,
    )


def _settings_of(source: GimbalSource, settings: AttitudeSettings) -> AttitudeSettings:
    """Settings by which reports of a source are read: a camera's own statement leaves nothing to estimate."""
    if not is_own_statement(source):
        return settings
    frame, axes = ReportFrame.EARTH, MountAxes.TILT_OUTER
    return replace(settings, frame=frame, axes=axes, is_demand=False, delay_ns=0)


class AttitudeSources(TelemetryPart):
    """Attitude streams of the vehicle and its gimbals."""

    def __init__(self, settings: AttitudeSettings) -> None:
        self._settings = settings
        self._vehicle = Stream(settings.max_gap_ns)
        self._heading = Stream(settings.max_gap_ns)
        self._gimbals: dict[GimbalSource, Gimbal] = {
            source: Gimbal(_settings_of(source, settings))
            for source in settings.order
            if source != GimbalSource.FIXED_MOUNT
        }
        self._resolver = Resolver(settings)
        self._gimbal_types: dict[str, int] = {}  # by message
        self._axes = settings.axes

    def pose_streams(self) -> tuple[Stream, ...]:
        """Streams of the vehicle's and the gimbals' attitudes."""
        return (self._vehicle, *(gimbal.stream for gimbal in self._gimbals.values()))

    def streams(self) -> tuple[Stream, ...]:
        """All streams."""
        return (*self.pose_streams(), self._heading)

    def clear(self) -> None:
        """Remove all samples, and the evidence on the gimbals: they are of another boot or vehicle."""
        for gimbal in self._gimbals.values():
            gimbal.clear()
        self._vehicle.clear()
        self._heading.clear()
        self._axes = self._settings.axes

    def shift(self, by_ns: int) -> None:
        """Shift all stamps: the clock map has changed."""
        for gimbal in self._gimbals.values():
            gimbal.shift(by_ns, self._vehicle)
        self._vehicle.shift(by_ns)
        self._heading.shift(by_ns)

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append a track of attitudes, as ``Stream.append``; other tracks are ignored."""
        if isinstance(track, VehicleTrack):
            heading_rad = np.full(len(stamps_ns), np.nan) if track.heading_std_rad is None else track.heading_std_rad
            self._vehicle.append(stamps_ns, row_end_by_tick, wxyz=track.wxyz, heading_std_rad=heading_rad)
        elif isinstance(track, GimbalTrack) and track.source in self._gimbals:
            self._gimbals[track.source].append(track, stamps_ns, row_end_by_tick)
        elif isinstance(track, HeadingTrack):
            self._heading.append(stamps_ns, row_end_by_tick, heading_rad=track.heading_rad)
        elif isinstance(track, GimbalTypeTrack):
            self._follow_type(track)

    def may_append_ticks(self, track: Track) -> bool:
        """Whether a track of several ticks may be appended at once: a gimbal's type may change what came before."""
        return not isinstance(track, GimbalTypeTrack)

    def _follow_type(self, track: GimbalTypeTrack) -> None:
        """Remove samples and evidence of the gimbals where one is another from now on; follow whether it can roll."""
        if np.any(track.identity != self._gimbal_types.get(track.message, track.identity[0])):
            for gimbal in self._gimbals.values():
                gimbal.clear()
            self._axes = self._settings.axes
        self._gimbal_types[track.message] = int(track.identity[-1])
        if track.cannot_roll[-1]:
            self._axes = self._settings.axes or MountAxes.TILT_ONLY

    def commit(self) -> None:
        """End the step."""
        self._vehicle.commit()
        self._heading.commit()
        for gimbal in self._gimbals.values():
            gimbal.commit(self._vehicle)

    def evidence(self) -> dict[GimbalSource, FrameEvidence]:
        """Evidence on the frames of the gimbals that have reported."""
        reporting = {source: gimbal for source, gimbal in self._gimbals.items() if gimbal.has_reported}
        return {source: gimbal.evidence(self._vehicle) for source, gimbal in reporting.items()}

    def demands(self) -> dict[GimbalSource, bool]:
        """Whether the gimbals that have reported may report demands, not measurements."""
        return {
            source: bool(self._gimbals[source].is_demand(evidence.frame, LAST)[0])
            for source, evidence in self.evidence().items()
        }

    def vehicle_at(self, query: Query) -> tuple[FloatArray, IntArray]:
        """``ned_SO3_body (n, 4)`` at stamps, NaN where missing, and ``Missing`` ``(n,)``."""
        found, missing = self._vehicle.find(query)
        wxyz = np.full((len(query), 4), np.nan)
        rows = np.flatnonzero(missing == Missing.NOTHING)
        if len(rows):
            known = found.rows(rows)
            wxyz[rows] = slerp(*known.ends(self._vehicle.column("wxyz")), known.weight)
        return wxyz, missing

    def vehicle_before(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Last ``ned_SO3_body (n, 4)`` up to stamps as of ticks; NaN where it is older than the longest gap."""
        wxyz = np.full((len(stamps_ns), 4), np.nan)
        if not self._vehicle.is_empty:
            rows = self._vehicle.last_before(stamps_ns, ticks)
            known = (rows >= 0) & (stamps_ns - self._vehicle.stamps_ns[rows] <= self._vehicle.max_gap_ns)
            wxyz[known] = self._vehicle.column("wxyz")[rows[known]]
        return wxyz

    def at(self, query: Query) -> AttitudeBatch:
        """The camera's attitudes ``(n,)``."""
        batch = AttitudeBatch.missing_all(len(query))
        left = np.arange(len(query))
        for source in self._settings.order:
            if not len(left):
                break
            missing, attitudes = self._source_at(source, batch, left, query.rows(left))
            for rows, values in attitudes:
                batch = batch.put(left[rows], values)
            keeps = (missing == Missing.NEVER) & (batch.missing[left] == Missing.STALE)
            batch.missing[left] = np.where(keeps, Missing.STALE, missing)
            left = left[np.isin(missing, (Missing.STALE, Missing.NEVER))]
        self._hold_against_others(batch, query)
        batch.heading_std_rad[:] = self._heading_doubts(query)
        return batch

    def _heading_doubts(self, query: Query) -> FloatArray:
        """Standard deviations ``(n,)`` that cover the vehicle's heading by its attitude and by another message."""
        last = self._heading.last_before(query.stamps_ns, query.ticks)
        if not np.any(last >= 0):
            return np.zeros(len(query))
        at_ns = self._heading.stamps_ns[np.maximum(last, 0)]
        wxyz, missing = self.vehicle_at(query.at(at_ns))
        is_both = (last >= 0) & (query.stamps_ns - at_ns <= self._settings.max_gap_ns) & (missing == Missing.NOTHING)
        heading_rad = self._heading.column("heading_rad")[np.maximum(last, 0)]
        difference_rad = np.zeros(len(query))
        difference_rad[is_both] = yaw_pitch_roll(wxyz[is_both])[0] - heading_rad[is_both]
        return heading_doubts(difference_rad, self._settings)

    def _hold_against_others(self, batch: AttitudeBatch, query: Query) -> None:
        """Refuse attitudes that another gimbal source contradicts; widen those from which it differs by less.

        The two are compared at the other source's last sample up to the stamp, so that none is waited for.
        """
        reporting = [source for source, gimbal in self._gimbals.items() if not gimbal.stream.is_empty]
        if len(reporting) < 2 or not len(batch.notes):  # noqa: PLR2004 - a source and another one
            return
        used = np.array([reporting.index(note.source) if note.source in reporting else -1 for note in batch.notes])
        used_index = np.where(batch.missing == Missing.NOTHING, used[batch.note], -1)
        for number, source in enumerate(reporting):
            for other in (each for each in reporting if each is not source):
                stream = self._gimbals[other].stream
                last = stream.last_before(query.stamps_ns, query.ticks)
                at_ns = stream.stamps_ns[np.maximum(last, 0)]
                is_fresh = (last >= 0) & (query.stamps_ns - at_ns <= self._settings.max_gap_ns)
                is_fresh &= last - stream.rows_known_at(query.ticks)[0] >= _MIN_REPORTS_TO_CONTRADICT
                rows = np.flatnonzero((used_index == number) & is_fresh & (batch.missing == Missing.NOTHING))
                if len(rows):
                    both = query.at(at_ns).rows(rows)
                    self._compare(
                        batch, rows, (source, self._of_source(source, both)), (other, self._of_source(other, both))
                    )

    def _of_source(self, source: GimbalSource, query: Query) -> AttitudeBatch:
        """Attitudes ``(n,)`` of one source."""
        batch = AttitudeBatch.missing_all(len(query))
        missing, attitudes = self._source_at(source, batch, np.arange(len(query)), query)
        for rows, values in attitudes:
            batch = batch.put(rows, values)
        batch.missing[:] = missing
        return batch

    def _compare(
        self,
        batch: AttitudeBatch,
        rows: IntArray,
        first: tuple[GimbalSource, AttitudeBatch],
        second: tuple[GimbalSource, AttitudeBatch],
    ) -> None:
        """Refuse or widen rows ``(m,)`` by two sources' attitudes ``(m,)``, the first of which the batch has."""
        both = np.flatnonzero((first[1].missing == Missing.NOTHING) & (second[1].missing == Missing.NOTHING))
        if not len(both):
            return
        found = source_difference(first[1].rows(both), second[1].rows(both), self._settings)
        own = rows[both]
        angle_deg = np.degrees(np.linalg.norm(found.rotation_rad, axis=-1))
        for row, degrees in zip(own[found.is_contradiction], angle_deg[found.is_contradiction], strict=True):
            batch.missing[row] = Missing.REFUSED
            batch.refusals[int(row)] = (
                f"{first[0]} and {second[0]} contradict each other: the camera's attitudes are {degrees:.0f} deg "
                "apart; name the right one alone in telemetry.attitude.order"
            )
        wider = found.is_notable & ~found.is_contradiction
        batch.report_std_rad[own[wider]] = np.hypot(batch.report_std_rad[own[wider]], found.rotation_rad[wider])

    def _source_at(
        self, source: GimbalSource, batch: AttitudeBatch, batch_rows: IntArray, query: Query
    ) -> tuple[IntArray, Iterator[tuple[IntArray, AttitudeBatch]]]:
        """``Missing (n,)`` of a source at stamps, and the rows and attitudes that it has."""
        vehicle, vehicle_missing = self._vehicle.find(query)
        if source == GimbalSource.FIXED_MOUNT:
            if self._settings.fixed_mount is None:
                vehicle_missing = np.where(vehicle_missing == Missing.NOTHING, Missing.NEVER, vehicle_missing)
            rows = np.flatnonzero(vehicle_missing == Missing.NOTHING)
            return vehicle_missing, self._from_fixed_mount(source, rows, query.stamps_ns, vehicle) if len(
                rows
            ) else iter(())
        gimbal, configured = self._gimbals[source], _settings_of(source, self._settings).frame
        found, missing = gimbal.stream.find(query)
        rows = np.flatnonzero(missing == Missing.NOTHING)
        if not len(rows):
            return missing, iter(())
        body_missing = vehicle_missing[rows]
        evidences, evidence_index = gimbal.evidence_at(self._vehicle, query.ticks[rows])
        before, after = found.rows(rows).ends(gimbal.stream.column("yaw_in_earth"))
        frames = [configured or evidence.frame or ReportFrame.EARTH for evidence in evidences]
        is_against_earth = np.array([frame is ReportFrame.EARTH for frame in frames])[evidence_index] & (before > 0)
        refusals = [refusal(source, evidence, configured) for evidence in evidences]
        is_refused = np.array([why is not None for why in refusals])[evidence_index]
        reason = np.where((body_missing != Missing.NOTHING) & ~is_against_earth, body_missing, Missing.NOTHING)
        reason = np.where(before != after, Missing.STALE, reason)  # the references differ
        reason = np.where(is_refused, Missing.REFUSED, reason)
        missing[rows] = np.where(body_missing == Missing.PENDING, body_missing, reason)
        for row in np.flatnonzero(missing[rows] == Missing.REFUSED).tolist():
            batch.refusals[int(batch_rows[rows[row]])] = refusals[evidence_index[row]] or ""
        rows = rows[missing[rows] == Missing.NOTHING]
        of_gimbal = GimbalQuery(query.stamps_ns[rows], query.ticks[rows], found.rows(rows), vehicle.rows(rows))
        return missing, self._from_gimbal(source, rows, of_gimbal) if len(rows) else iter(())

    def _from_gimbal(
        self, source: GimbalSource, rows: IntArray, query: GimbalQuery
    ) -> Iterator[tuple[IntArray, AttitudeBatch]]:
        """Attitudes at rows from a gimbal's reports."""
        settings = _settings_of(source, replace(self._settings, axes=self._axes))
        stated_rad = np.maximum(*query.found.ends(self._gimbals[source].stream.column("std_rad")))
        for own, readings in readings_of(source, self._gimbals[source], self._vehicle, settings, query):
            yield rows[own], replace(self._resolver.attitudes(readings), stated_std_rad=stated_rad[own])

    def _from_fixed_mount(
        self, source: GimbalSource, rows: IntArray, stamps_ns: IntArray, vehicle: Brackets
    ) -> Iterator[tuple[IntArray, AttitudeBatch]]:
        """Attitudes at rows of a camera fixed to the vehicle."""
        known = vehicle.rows(rows)
        age_s = self._vehicle.ages_s(stamps_ns[rows], known)
        ends = AttitudeBrackets.from_brackets(self._vehicle.column("wxyz"), known)
        attitudes = self._resolver.attitudes(Readings(source=source, age_s=age_s, vehicle=ends))
        attitudes.stated_std_rad[:, 3] = np.fmax(*known.ends(self._vehicle.column("heading_std_rad")))
        yield rows, attitudes
