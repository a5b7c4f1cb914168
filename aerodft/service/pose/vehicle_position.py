"""The vehicle's position in the station's ENU frame."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import east_north
from aerodft.model import Batch, BoolArray, FloatArray, GeoOrigin, IntArray, PositionTrack, ReceiverTrack, Track
from aerodft.service.height_sources import HeightSettings
from aerodft.service.streams import Missing, Query, Stream, TelemetryPart

CONTRADICTION_STDS: Final = 5.0
"""Combined standard deviations beyond which the receiver's position contradicts the estimator's."""
_NOTABLE_STDS: Final = 2.0  # of the difference from which on the position's std covers it: 6 m where both are good
_MIN_RECEIVER_STD_M: Final = 2.0  # of a receiver that states none, or a better one: 2.5 m CEP is what data sheets say
_RECEIVER_DELAY_S: Final = 0.2  # of a fix behind its place, as ArduPilot assumes (GPS_DELAY_MS)
_MAX_CORRECTION_M: Final = 50.0  # of an estimator's own correction
_MAX_SPEED_MPS: Final = 150.0  # between two samples; faster is a jump


@dataclass(frozen=True, slots=True, eq=False)
class PositionBatch(Batch):
    """Vehicle positions at ``n`` stamps; NaN where missing.

    Attributes:
        east_north_m: ``(n, 2)``.
        velocity_enu_mps: ``(n, 3)``.
        lat_lon_alt: ``(n, 3)`` latitude, longitude (rad) and altitude (m MSL), NaN where the log has none.
        std_m: ``(n,)`` stated standard deviation of east and of north; NaN where the log has none.
        missing: ``(n,)`` as ``Missing``.
        horizontal_std_m: ``(n,)`` in addition to the settings': the receiver's position differs by that.
        is_contradicted: ``(n,)`` whether a position is missing because the receiver's contradicts it.
    """

    east_north_m: FloatArray
    velocity_enu_mps: FloatArray
    lat_lon_alt: FloatArray
    std_m: FloatArray
    missing: IntArray
    horizontal_std_m: FloatArray
    is_contradicted: BoolArray

    @staticmethod
    def missing_all(missing: IntArray) -> "PositionBatch":
        """A batch without positions, for these reasons ``(n,)``."""
        count = len(missing)
        places, velocity, lat_lon_alt = np.full((count, 2), np.nan), np.zeros((count, 3)), np.full((count, 3), np.nan)
        is_contradicted = np.full(count, fill_value=False)
        std_m = np.full(count, np.nan)
        return PositionBatch(places, velocity, lat_lon_alt, std_m, missing, np.zeros(count), is_contradicted)

    def remove(self, rows: IntArray) -> None:
        """Make the positions of rows stale."""
        self.missing[rows] = Missing.STALE
        self.east_north_m[rows] = self.lat_lon_alt[rows] = np.nan
        self.velocity_enu_mps[rows] = self.horizontal_std_m[rows] = 0.0


class VehiclePositions(TelemetryPart):
    """Stream of the vehicle's positions, and the ENU origin.

    Attributes:
        stream: Samples of the positions.
        receiver: Samples of the receiver's own positions, which these are held against.
        origin: The station's ENU origin; None before the first fix, without altitude before home's is known.

    Args:
        settings: Longest gap between samples, and height of home.
        origin: None takes the first fix, on the measured plane.
        horizontal_std_m: Standard deviation of a position.
    """

    def __init__(self, settings: HeightSettings, origin: GeoOrigin | None, horizontal_std_m: float = 0.0) -> None:
        self.stream = Stream(settings.max_gap_ns)
        self.receiver = Stream(settings.max_gap_ns)
        self.origin = origin
        self._std_m = horizontal_std_m
        self._last_received: FloatArray | None = None
        self._home_above_plane_m = settings.home_above_plane_m
        self._awaits_altitude = False

    def pose_streams(self) -> tuple[Stream, ...]:
        """The stream of positions."""
        return (self.stream,)

    def streams(self) -> tuple[Stream, ...]:
        """All streams: also of what positions are held against."""
        return (self.stream, self.receiver)

    def may_append_ticks(self, track: Track) -> bool:
        """Whether a track of several ticks may be appended at once: the first position makes the origin.

        So does the first one from which its altitude is known.
        """
        if not isinstance(track, PositionTrack) or (self.origin is not None and not self._awaits_altitude):
            return True
        return self.origin is not None and not np.isfinite(self._planes_msl_m(track)).any()

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append positions, the vehicle's or the receiver's own, as ``Stream.append``; other tracks are ignored."""
        if isinstance(track, PositionTrack) and len(stamps_ns):
            self._append_positions(track, stamps_ns, row_end_by_tick)
        elif isinstance(track, ReceiverTrack):
            self._append_receiver(track, stamps_ns, row_end_by_tick)

    def _append_positions(self, track: PositionTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None) -> None:
        columns = {name: getattr(track, name) for name in ("lat_rad", "lon_rad", "alt_msl_m", "height_home_m")}
        std_m = np.full(len(stamps_ns), np.nan) if track.std_m is None else track.std_m
        self.stream.append(stamps_ns, row_end_by_tick, **columns, std_m=std_m)
        if self.origin is None:
            self.origin = GeoOrigin(lat_rad=float(track.lat_rad[0]), lon_rad=float(track.lon_rad[0]), alt_msl_m=None)
            self._awaits_altitude = True
        if self._awaits_altitude:
            planes_m = self._planes_msl_m(track)
            planes_m = planes_m[np.isfinite(planes_m)]
            if len(planes_m):
                self.origin = replace(self.origin, alt_msl_m=float(planes_m[0]))
                self._awaits_altitude = False

    def _planes_msl_m(self, track: PositionTrack) -> FloatArray:
        """Altitude of the measured plane ``(n,)`` by home's altitude; NaN where that is not known."""
        planes_m: FloatArray = track.alt_msl_m - (track.height_home_m + self._home_above_plane_m)
        if track.home_alt_msl_m is None:
            return planes_m
        return np.where(np.isnan(planes_m), track.home_alt_msl_m - self._home_above_plane_m, planes_m)

    def at(self, query: Query) -> PositionBatch:
        """Positions and velocities ``(n,)``."""
        found, missing = self.stream.find(query)
        if self.origin is None:
            missing = np.where(missing == Missing.NOTHING, Missing.NEVER, missing)
        batch = PositionBatch.missing_all(missing)
        rows = np.flatnonzero(missing == Missing.NOTHING)
        if self.origin is None or not len(rows):
            return batch
        found = found.rows(rows)
        names = "lat_rad", "lon_rad", "alt_msl_m", "height_home_m"
        lat, lon, alt, height_home = (self.stream.column(name) for name in names)
        height = np.where(np.isnan(alt), height_home, alt)
        before, after = (east_north(self.origin, lat[ends], lon[ends]) for ends in (found.before, found.after))
        step_m = after - before
        moves = found.gap_ns > 0
        per_s = np.where(moves, SECOND_NS / np.where(moves, found.gap_ns, 1), 0.0)
        batch.east_north_m[rows] = before + found.weight[:, None] * step_m
        batch.velocity_enu_mps[rows, :2] = step_m * per_s[:, None]
        batch.velocity_enu_mps[rows, 2] = np.nan_to_num(height[found.after] - height[found.before]) * per_s
        eastward_rad = _wrap_pi(lon[found.after] - lon[found.before])  # also over the 180th meridian
        lon_rad = _wrap_pi(lon[found.before] + found.weight * eastward_rad)
        batch.lat_lon_alt[rows] = np.column_stack([found.linear(lat), lon_rad, found.linear(alt)])
        batch.std_m[rows] = np.maximum(*found.ends(self.stream.column("std_m")))
        is_jump = np.hypot(*step_m.T) > _MAX_CORRECTION_M + _MAX_SPEED_MPS * found.gap_ns / SECOND_NS
        batch.remove(rows[is_jump])
        self._hold_against_receiver(batch, self.origin, query.stamps_ns, query.ticks)
        return batch

    def _append_receiver(self, track: ReceiverTrack, stamps_ns: IntArray, row_end_by_tick: IntArray | None) -> None:
        """Append the receiver's positions.

        A position that repeats the one before to the last digit is none: receivers are noisy, and what stands still
        contradicts nobody.
        """
        before = track.lat_lon_rad[:1] if self._last_received is None else self._last_received
        is_new = np.any(np.diff(track.lat_lon_rad, axis=0, prepend=before) != 0, axis=-1)
        self._last_received = track.lat_lon_rad[-1:] if len(stamps_ns) else self._last_received
        self.receiver.append(
            stamps_ns, row_end_by_tick, lat_lon_rad=track.lat_lon_rad, std_m=np.where(is_new, track.std_m, np.inf)
        )

    def _hold_against_receiver(
        self, batch: PositionBatch, origin: GeoOrigin, stamps_ns: IntArray, ticks: IntArray
    ) -> None:
        """Remove positions that the receiver's contradict; widen those from which they differ by less.

        The receiver's last one up to the stamp is moved on by the velocity, so that none is waited for. How late it is
        is not known: as much as it is moved on is in its std.
        """
        last = self.receiver.last_before(stamps_ns, ticks)
        rows = np.flatnonzero((last >= 0) & (batch.missing == Missing.NOTHING))
        if not len(rows):
            return
        own = last[rows]
        late_s = (stamps_ns[rows] - self.receiver.stamps_ns[own]) / SECOND_NS + _RECEIVER_DELAY_S
        is_fresh = late_s <= self.receiver.max_gap_ns / SECOND_NS
        moved_m = batch.velocity_enu_mps[rows, :2] * late_s[:, None]
        expected_m = east_north(origin, *self.receiver.column("lat_lon_rad")[own].T) + moved_m
        apart_m = np.hypot(*(batch.east_north_m[rows] - expected_m).T)
        stated_m = np.fmax(self.receiver.column("std_m")[own], _MIN_RECEIVER_STD_M)
        own_m = np.fmax(batch.std_m[rows], self._std_m)
        stds = apart_m / np.sqrt(own_m**2 + stated_m**2 + np.sum(moved_m**2, axis=-1))
        is_wider = is_fresh & (stds > _NOTABLE_STDS)
        batch.horizontal_std_m[rows[is_wider]] = apart_m[is_wider]
        contradicted = rows[is_fresh & (stds > CONTRADICTION_STDS)]
        batch.is_contradicted[contradicted] = True
        batch.remove(contradicted)


def _wrap_pi(angle_rad: FloatArray) -> FloatArray:
    """Angles wrapped to [-pi, pi]; those within it unchanged to the last bit."""
    return np.where(
        np.abs(angle_rad) <= math.pi, angle_rad, angle_rad - 2 * math.pi * np.rint(angle_rad / (2 * math.pi))
    )
