"""The camera's attitude at stamps, from the first source in the configured order that has one."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from aerodft.geometry import Brackets, slerp
from aerodft.model import (
    BoolArray,
    FloatArray,
    GimbalSource,
    GimbalTrack,
    IntArray,
    MountAxes,
    ReportFrame,
    Track,
    VehicleTrack,
)
from aerodft.service.attitude.gimbal_frame import FrameEvidence
from aerodft.service.attitude.gimbal_reports import Gimbal
from aerodft.service.attitude.readings import AttitudeBatch, AttitudeBrackets, Readings, Resolver
from aerodft.service.settings import AttitudeSettings
from aerodft.service.streams import LAST, Missing, Stream

_DEFAULT_READING: Final = (ReportFrame.EARTH, MountAxes.TILT_OUTER)


@dataclass(frozen=True, slots=True)
class GimbalQuery:
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

    def rows(self, rows: IntArray) -> "GimbalQuery":
        """The query at stamps ``(m,)`` by their indices."""
        return GimbalQuery(self.stamps_ns[rows], self.ticks[rows], self.found.rows(rows), self.vehicle.rows(rows))


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


class AttitudeSources:
    """Attitude streams of the vehicle and its gimbals."""

    def __init__(self, settings: AttitudeSettings) -> None:
        self._settings = settings
        self._vehicle = Stream(settings.max_gap_ns)
        self._gimbals: dict[GimbalSource, Gimbal] = {
            source: Gimbal(settings) for source in settings.order if source is not GimbalSource.FIXED_MOUNT
        }
        self._resolver = Resolver(settings)

    def streams(self) -> tuple[Stream, ...]:
        """All streams, for the watermark."""
        return (self._vehicle, *(gimbal.stream for gimbal in self._gimbals.values()))

    def clear(self) -> None:
        """Remove all samples, and the evidence on the gimbals: they are of another boot or vehicle."""
        for gimbal in self._gimbals.values():
            gimbal.clear()
        self._vehicle.clear()

    def shift(self, by_ns: int) -> None:
        """Shift all stamps: the clock map has changed."""
        for gimbal in self._gimbals.values():
            gimbal.shift(by_ns, self._vehicle)
        self._vehicle.shift(by_ns)

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append a track of attitudes, as ``Stream.append``; other tracks are ignored."""
        if isinstance(track, VehicleTrack):
            self._vehicle.append(stamps_ns, row_end_by_tick, wxyz=track.wxyz)
        elif isinstance(track, GimbalTrack) and track.source in self._gimbals:
            self._gimbals[track.source].append(track, stamps_ns, row_end_by_tick)

    def commit(self) -> None:
        """End the step."""
        self._vehicle.commit()
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

    def vehicle_at(self, stamps_ns: IntArray, ticks: IntArray, watermark_ns: IntArray) -> tuple[FloatArray, IntArray]:
        """``ned_SO3_body (n, 4)`` at stamps, NaN where missing, and ``Missing`` ``(n,)``."""
        found, missing = self._vehicle.find(stamps_ns, ticks, watermark_ns)
        wxyz = np.full((len(stamps_ns), 4), np.nan)
        rows = np.flatnonzero(missing == Missing.NOTHING)
        if len(rows):
            known = found.rows(rows)
            wxyz[rows] = slerp(*known.ends(self._vehicle.column("wxyz")), known.weight)
        return wxyz, missing

    def at(self, stamps_ns: IntArray, ticks: IntArray, watermark_ns: IntArray) -> AttitudeBatch:
        """The camera's attitudes at stamps ``(n,)``; arguments as in ``Stream.find``."""
        batch = AttitudeBatch.missing_all(len(stamps_ns))
        left = np.arange(len(stamps_ns))
        for source in self._settings.order:
            if not len(left):
                break
            missing, attitudes = self._source_at(source, batch, left, stamps_ns[left], ticks[left], watermark_ns[left])
            for rows, values in attitudes:
                batch = batch.put(left[rows], values)
            keeps = (missing == Missing.NEVER) & (batch.missing[left] == Missing.STALE)
            batch.missing[left] = np.where(keeps, Missing.STALE, missing)
            left = left[np.isin(missing, (Missing.STALE, Missing.NEVER))]
        return batch

    def _source_at(
        self,
        source: GimbalSource,
        batch: AttitudeBatch,
        batch_rows: IntArray,
        stamps_ns: IntArray,
        ticks: IntArray,
        watermark_ns: IntArray,
    ) -> tuple[IntArray, Iterator[tuple[IntArray, AttitudeBatch]]]:
        """``Missing (n,)`` of a source at stamps, and the rows and attitudes that it has."""
        vehicle, vehicle_missing = self._vehicle.find(stamps_ns, ticks, watermark_ns)
        if source is GimbalSource.FIXED_MOUNT:
            if self._settings.fixed_mount is None:
                vehicle_missing = np.where(vehicle_missing == Missing.NOTHING, Missing.NEVER, vehicle_missing)
            rows = np.flatnonzero(vehicle_missing == Missing.NOTHING)
            return vehicle_missing, self._from_fixed_mount(source, rows, stamps_ns, vehicle) if len(rows) else iter(())
        gimbal, configured = self._gimbals[source], self._settings.frame
        found, missing = gimbal.stream.find(stamps_ns, ticks, watermark_ns)
        rows = np.flatnonzero(missing == Missing.NOTHING)
        if not len(rows):
            return missing, iter(())
        body_missing = vehicle_missing[rows]
        evidences, evidence_index = gimbal.evidence_at(self._vehicle, ticks[rows])
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
        query = GimbalQuery(stamps_ns[rows], ticks[rows], found.rows(rows), vehicle.rows(rows))
        return missing, self._from_gimbal(source, rows, query) if len(rows) else iter(())

    def _from_gimbal(
        self, source: GimbalSource, rows: IntArray, query: GimbalQuery
    ) -> Iterator[tuple[IntArray, AttitudeBatch]]:
        """Attitudes at rows from a gimbal's reports."""
        for own, readings in readings_of(source, self._gimbals[source], self._vehicle, self._settings, query):
            yield rows[own], self._resolver.attitudes(readings)

    def _from_fixed_mount(
        self, source: GimbalSource, rows: IntArray, stamps_ns: IntArray, vehicle: Brackets
    ) -> Iterator[tuple[IntArray, AttitudeBatch]]:
        """Attitudes at rows of a camera fixed to the vehicle."""
        known = vehicle.rows(rows)
        age_s = self._vehicle.ages_s(stamps_ns[rows], known)
        ends = AttitudeBrackets.from_brackets(self._vehicle.column("wxyz"), known)
        yield rows, self._resolver.attitudes(Readings(source=source, age_s=age_s, vehicle=ends))
