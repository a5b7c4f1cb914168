"""Plausibility of heights above home: against the vehicle's own vertical speed, its altitude, GPS and the ground.

A height above home is one integral of the vehicle's vertical motion. What it changes by and the vertical speed does not
explain is its *unexplained change*. This is 0 for a height that is right and stays at the size of a step or a drift.
"""

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.jit import njit
from aerodft.model import (
    FIX_3D,
    NO_CLIMB_MPS,
    BoolArray,
    ClimbTrack,
    FloatArray,
    GpsTrack,
    HeartbeatTrack,
    HeightSource,
    HeightTrack,
    IntArray,
    LandedTrack,
    PositionTrack,
    Track,
)
from aerodft.service.streams import Stream

MAX_CLIMB_MPS: Final = 12.0
"""Fastest vertical speed of a vehicle that states none; a recorded fixed wing climbs at 11.5 m/s. At half of it such
climbs are steps, at twice of it a step of 4 m at 5 Hz is a climb."""

_SPEED_BIAS_MPS: Final = 0.15  # of an EKF's vertical speed: 0.1 to 0.2; half refuses honest drifts, twice hides 0.3 m/s
_ACCELERATION_MPS2: Final = 3.0  # that the speeds of two samples do not show, in turns
_ACCELERATION_S: Final = 0.5  # of each turn, between samples at most a second apart
MIN_STD_M: Final = 0.5  # of a height against integrated speed; recorded flights differ by 0.1 to 0.3 m within 10 s
WIDENED_STDS: Final = 1.5
REFUSED_STDS: Final = 5.0
"""From this many std of unexplained change on the std of a height holds it, and from that many there is no height."""
IS_GROUNDED_STDS: Final = 1.5
"""A larger reading on the ground, in std, is an offset of the heights."""
_MAX_GAP_S: Final = 120.0  # after that the vehicle may be anywhere
_WINDOW_S: Final = 10.0  # in which a motion is compared: a bias of 0.15 m/s makes 1.5 m
_MIN_MOTION_M: Final = 2.0  # that tells whether a height follows
_MIN_MOTION_MPS: Final = 0.5  # three times the bias of the speed
_SLOPE: Final = 0.35  # a height follows from 0.65 to 1.35 of the motion
_REFERENCE_S: Final = 10.0  # averaging time of the offset between GPS altitude and height
_GPS_STD_M: Final = 5.0  # of altitudes whose accuracy is not stated
_MIN_GPS_STD_M: Final = 1.0  # of changes of altitude over minutes
_GPS_LAG_S: Final = 0.3  # of a receiver behind the estimator
_CONFIRMED_STDS, _CONTRADICTED_STDS = 2.5, 4.0  # of the difference to GPS
_MAX_CLIMB_AGE_NS: Final = SECOND_NS // 2
_MAX_GPS_AGE_NS: Final = 2 * SECOND_NS
_MAX_HEIGHT_AGE_NS: Final = SECOND_NS
_MAX_EXTRAPOLATION_NS: Final = SECOND_NS // 2
EARTH_RADIUS_M: Final = 6_371_008.8
_MAX_STATE_AGE_NS: Final = 5 * SECOND_NS  # of HEARTBEAT and EXTENDED_SYS_STATE
_MIN_FLIGHT_S: Final = 5.0  # of a log that begins in the air; EXTENDED_SYS_STATE comes once a second
_GROUNDED, _AIRBORNE = 1, -1
_AFTER_ARMING_NS: Final = SECOND_NS // 2  # a vehicle has not left the ground

# Places in the state of ``_check``.
_WITH, _AGAINST, _IMPOSSIBLE, _SIGN, _STREAK, _MOVED_M, _CHANGED_M, _WINDOW_AGE_S = range(8)
_GPS_OFFSET, _HOME_ALT, _RATE, _GROUND, _HAS_FLOWN, _FOLLOWS, _FLOWN_S = range(8, 15)
_STATE_SIZE: Final = 15


@njit
def shrink(value: float, by: float) -> float:
    """A value moved towards 0 by a tolerance."""
    if value > by:
        return value - by
    return value + by if value < -by else 0.0


@njit
def _reset(state: FloatArray) -> None:
    """Forget the history of a height that begins anew."""
    state[:] = 0.0
    state[_GPS_OFFSET] = state[_HOME_ALT] = state[_GROUND] = np.nan


@njit
def _accumulate(
    state: FloatArray, step_m: float, dt_s: float, before_mps: float, after_mps: float, std_m: float
) -> None:
    """Add what a step of the height (m) has beyond the vertical speeds at its ends."""
    fastest_mps = MAX_CLIMB_MPS
    if np.isfinite(before_mps) and np.isfinite(after_mps):
        moved_m = (before_mps + after_mps) / 2 * dt_s
        # The speed may have changed early or late, and in between.
        tolerance_m = abs(after_mps - before_mps) * dt_s / 4
        tolerance_m += _ACCELERATION_MPS2 * dt_s * min(dt_s, _ACCELERATION_S) * max(dt_s, 1.0) ** 2 / 16
        state[_WITH] += shrink(step_m - moved_m, tolerance_m)
        state[_AGAINST] += shrink(step_m + moved_m, tolerance_m)
        state[_MOVED_M] += moved_m
        fastest_mps = max(fastest_mps, 1.5 * max(abs(before_mps), abs(after_mps)))
    state[_CHANGED_M] += step_m
    state[_IMPOSSIBLE] += shrink(step_m, fastest_mps * dt_s + std_m)
    state[_WINDOW_AGE_S] += dt_s
    drift_m = _SPEED_BIAS_MPS * dt_s
    for place in (_WITH, _AGAINST):
        if abs(state[place]) <= std_m:
            state[place] = shrink(state[place], drift_m)


@njit
def _judge_window(state: FloatArray, std_m: float) -> None:
    """Learn the sign of the vertical speed, and whether the height follows it, from motions within a window."""
    moved_m, changed_m = state[_MOVED_M], state[_CHANGED_M]
    is_moved = abs(moved_m) >= max(_MIN_MOTION_M, 2 * std_m)
    if is_moved and abs(moved_m) >= _MIN_MOTION_MPS * state[_WINDOW_AGE_S]:
        sign = 0.0
        if abs(changed_m - moved_m) <= _SLOPE * abs(moved_m):
            sign = 1.0
        elif abs(changed_m + moved_m) <= _SLOPE * abs(moved_m):
            sign = -1.0
        if sign != 0.0 and state[_SIGN] == 0.0 and state[_STREAK] == sign:
            state[_SIGN] = sign
        if sign != 0.0:
            state[_STREAK] = sign
        state[_FOLLOWS] = 1.0 if sign != 0.0 and (state[_SIGN] == 0.0 or state[_SIGN] == sign) else 0.0
    elif state[_WINDOW_AGE_S] <= _WINDOW_S:
        return
    state[_MOVED_M] = state[_CHANGED_M] = state[_WINDOW_AGE_S] = 0.0


@njit
def _unexplained(state: FloatArray) -> float:
    """The unexplained change (m), by the sign of the vertical speed that is known or fits better."""
    if state[_SIGN] > 0 or (state[_SIGN] == 0 and abs(state[_WITH]) <= abs(state[_AGAINST])):
        return float(state[_WITH])
    return float(state[_AGAINST])


@njit
def _is_confirmed(state: FloatArray, unexplained_m: float, difference_m: float, gps_std_m: float, std_m: float) -> bool:
    """Whether GPS altitudes changed as the height did, and not as its vertical speed says."""
    if not np.isfinite(difference_m) or not np.isfinite(state[_GPS_OFFSET]):
        return False
    both_m = np.hypot(std_m, gps_std_m) + _GPS_LAG_S * abs(state[_RATE])
    change_m = difference_m - state[_GPS_OFFSET]
    agrees = abs(change_m) <= _CONFIRMED_STDS * both_m
    return bool(agrees and abs(change_m - unexplained_m) >= _CONTRADICTED_STDS * both_m)


@njit
def _follow_ground(state: FloatArray, ground: int, height_m: float, dt_s: float, std_m: float) -> None:
    """Note the height on the ground before the first take-off; what the height does on the ground is no motion."""
    if ground == _GROUNDED:
        state[_WITH] = state[_AGAINST] = state[_IMPOSSIBLE] = 0.0
        if state[_HAS_FLOWN] == 0.0 or abs(height_m) < abs(state[_GROUND]):
            state[_GROUND] = height_m
    elif np.isfinite(state[_GROUND]):
        if abs(height_m - state[_GROUND]) > 2 * std_m:
            state[_HAS_FLOWN] = 1.0
    elif ground == _AIRBORNE and dt_s <= _MAX_GAP_S:
        state[_FLOWN_S] += dt_s
        if state[_FLOWN_S] > _MIN_FLIGHT_S:  # the log begins in the air: where it lands is elsewhere
            state[_HAS_FLOWN] = 1.0


@njit
def _refer(state: FloatArray, home_alt_m: float, difference_m: float, dt_s: float) -> None:
    """Note how altitude and GPS differ from a height that is not in doubt."""
    state[_HOME_ALT] = home_alt_m
    if not np.isfinite(difference_m):
        return
    if not np.isfinite(state[_GPS_OFFSET]):
        state[_GPS_OFFSET] = difference_m
    else:
        state[_GPS_OFFSET] += (difference_m - state[_GPS_OFFSET]) * min(dt_s / _REFERENCE_S, 1.0)


@njit
def _correction(state: FloatArray, unexplained_m: float, home_alt_m: float, std_m: float) -> float:
    """What the height lacks (m) where the altitude has changed as the vertical speed says; else 0.

    Home has moved, or the height above it has jumped: altitude and vertical speed are two against one.
    """
    excess_m = home_alt_m - state[_HOME_ALT]
    limit_m = WIDENED_STDS * std_m
    return float(excess_m) if abs(excess_m) > limit_m and abs(unexplained_m + excess_m) <= limit_m else 0.0


@njit
def _check(columns: FloatArray, ground: IntArray, state: FloatArray, checked: FloatArray) -> None:
    """Judge heights above home in order.

    Args:
        columns: ``(10, n)``: time since the sample before (s; NaN for the first), height, the height before, altitude,
            vertical speed (m/s), the one before, std of the height, altitude by GPS, its std and age (s).
        ground: ``(n,)`` ``_GROUNDED``, ``_AIRBORNE`` or 0 where neither is known.
        state: ``(_STATE_SIZE,)`` from the samples before, updated.
        checked: ``(4, n)`` filled: correction by the altitude (m), unexplained change (m), reading on the ground (m), 1
            where the height has followed the vertical speed.
    """
    for k in range(columns.shape[1]):
        dt_s, height_m, before_m, alt_m, climb_mps, climb_before_mps, own_std_m, gps_m, gps_std_m, gps_age_s = columns[
            :, k
        ]
        std_m = max(own_std_m, MIN_STD_M)
        if not dt_s <= _MAX_GAP_S:
            _reset(state)
        else:
            _accumulate(state, height_m - before_m, dt_s, climb_before_mps, climb_mps, std_m)
            rate = (height_m - before_m) / dt_s if dt_s > 0 else 0.0
            state[_RATE] += (rate - state[_RATE]) * min(dt_s / 0.5, 1.0)
            _judge_window(state, std_m)
        _follow_ground(state, ground[k], height_m, dt_s, std_m)
        unexplained_m, correction_m = _unexplained(state), 0.0
        difference_m = height_m - gps_m - state[_RATE] * gps_age_s
        if abs(unexplained_m) <= std_m and abs(state[_IMPOSSIBLE]) <= std_m:
            _refer(state, alt_m - height_m, difference_m, dt_s)
        elif abs(unexplained_m) > WIDENED_STDS * std_m:
            correction_m = _correction(state, unexplained_m, alt_m - height_m, std_m)
            gps_std_m = max(gps_std_m, _MIN_GPS_STD_M)
            if correction_m != 0.0 or _is_confirmed(state, unexplained_m, difference_m, gps_std_m, std_m):
                unexplained_m = 0.0
        if correction_m == 0.0 and abs(state[_IMPOSSIBLE]) > abs(unexplained_m):
            unexplained_m = state[_IMPOSSIBLE]
        checked[0, k], checked[1, k] = correction_m, unexplained_m
        checked[2, k] = state[_GROUND] if np.isfinite(state[_GROUND]) else 0.0
        checked[3, k] = state[_FOLLOWS]


class HomeChecks:
    """Heights above home, and how plausible they are.

    Args:
        max_gap_ns: Longest gap of positions.

    Attributes:
        heights: Stream of heights, with ``correction_m``, ``unexplained_m``, ``ground_m`` and ``follows`` of each.
    """

    def __init__(self, max_gap_ns: int) -> None:
        self.heights, self._places = Stream(max_gap_ns), Stream(max_gap_ns)
        self._climb, self._gps = Stream(_MAX_CLIMB_AGE_NS), Stream(_MAX_GPS_AGE_NS)
        self._landed, self._armed = Stream(_MAX_STATE_AGE_NS), Stream(_MAX_STATE_AGE_NS)
        self._state = np.zeros(_STATE_SIZE)
        self._checked = 0
        self._was_armed = self._is_armed = False
        self._first = 0.0, 0.0

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be cleared or shifted with the clocks."""
        return self.heights, self._places, self._climb, self._gps, self._landed, self._armed

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None) -> None:
        """Append a track that heights above home are judged by, as ``Stream.append``; others are ignored."""
        match track:
            case PositionTrack() if len(stamps_ns):
                if self._places.is_empty:
                    self._first = float(track.lat_rad[0]), float(track.lon_rad[0])
                self._places.append(stamps_ns, row_end_by_tick, lat_rad=track.lat_rad, lon_rad=track.lon_rad)
                self._append_heights(track.height_home_m, track.alt_msl_m, track.climb_mps, stamps_ns, row_end_by_tick)
            case HeightTrack() if track.source == HeightSource.HOME:
                unknown = np.full(len(stamps_ns), np.nan)
                self._append_heights(track.value_m, unknown, None, stamps_ns, row_end_by_tick)
            case ClimbTrack():
                self._climb.append(stamps_ns, row_end_by_tick, climb_mps=track.climb_mps)
            case GpsTrack() if track.alt_msl_m is not None:
                std_m = np.where(np.isfinite(track.vertical_std_m), track.vertical_std_m, _GPS_STD_M)
                alt_msl_m = np.where(track.fix >= FIX_3D, track.alt_msl_m, np.nan)
                self._gps.append(stamps_ns, row_end_by_tick, alt_msl_m=alt_msl_m, std_m=std_m)
            case LandedTrack():
                self._landed.append(stamps_ns, row_end_by_tick, is_landed=track.is_landed.astype(np.float64))
            case HeartbeatTrack() if track.is_armed is not None and len(stamps_ns):
                self._append_armed(track.is_armed, stamps_ns, row_end_by_tick)

    def _append_heights(
        self,
        height_home_m: FloatArray,
        alt_msl_m: FloatArray,
        climb_mps: FloatArray | None,
        stamps_ns: IntArray,
        row_end_by_tick: IntArray | None,
    ) -> None:
        """Append heights above home ``(n,)``, those that are not stated left out."""
        climb_mps = np.full(len(stamps_ns), np.nan) if climb_mps is None else climb_mps
        stated = np.flatnonzero(np.isfinite(height_home_m))
        self.heights.append(
            stamps_ns[stated],
            None if row_end_by_tick is None else np.searchsorted(stated, row_end_by_tick),
            height_home_m=height_home_m[stated],
            alt_msl_m=alt_msl_m[stated],
            climb_mps=np.where(np.abs(climb_mps) < NO_CLIMB_MPS, climb_mps, np.nan)[stated],
            **dict.fromkeys(_RESULTS, np.zeros(len(stated))),
        )

    def _append_armed(self, is_armed: BoolArray, stamps_ns: IntArray, row_end_by_tick: IntArray | None) -> None:
        """Append whether the vehicle is armed, has been, and has just been."""
        if self._armed.is_empty:
            self._was_armed, self._is_armed = False, bool(is_armed[0])
        before = np.concatenate([[self._is_armed], is_armed[:-1]])
        was_armed = np.logical_or.accumulate(is_armed) | self._was_armed
        flags = {"is_armed": is_armed, "was_armed": was_armed, "is_arming": is_armed & ~before}
        self._was_armed, self._is_armed = bool(was_armed[-1]), bool(is_armed[-1])
        self._armed.append(
            stamps_ns, row_end_by_tick, **{name: each.astype(np.float64) for name, each in flags.items()}
        )

    def check(self, std_m: Callable[[IntArray, IntArray], FloatArray]) -> FloatArray:
        """Judge the heights appended since; ``std_m`` of heights above home ``(n,)`` from stamps and ticks ``(n,)``.

        Returns:
            Corrections ``(m,)`` of their heights (m).
        """
        rows, ticks = self.heights.newest_rows(self.heights.appended - self._checked)
        self._checked = self.heights.appended
        if not len(rows):
            return np.empty(0)
        stamps_ns, column = self.heights.stamps_ns[rows], self.heights.column
        before = np.maximum(rows - 1, 0)
        dt_s = np.where(rows > 0, (stamps_ns - self.heights.stamps_ns[before]) / SECOND_NS, np.nan)
        climb = column("climb_mps")
        climb[rows] = np.where(np.isnan(climb[rows]), self._climb_mps(stamps_ns, ticks), climb[rows])
        heights = column("height_home_m")
        gps_m, gps_std_m, gps_age_s = self._gps_alt(stamps_ns, ticks)
        columns = np.stack(
            [
                dt_s,
                heights[rows],
                heights[before],
                column("alt_msl_m")[rows],
                climb[rows],
                climb[before],
                std_m(stamps_ns, ticks),
                gps_m,
                gps_std_m,
                gps_age_s,
            ]
        )
        checked = np.empty((4, len(rows)))
        _check(columns, self._ground(stamps_ns, ticks), self._state, checked)
        for name, values in zip(_RESULTS, checked, strict=True):
            column(name)[rows] = values
        corrections_m: FloatArray = checked[0]
        return corrections_m

    def at(self, stamps_ns: IntArray, ticks: IntArray, std_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Heights above home ``(n,)`` at stamps from what was known by ticks, and east and north ``(n, 2)`` (m).

        Args:
            stamps_ns: ``(n,)`` UTC.
            ticks: ``(n,)`` as in ``Stream.find``.
            std_m: ``(n,)`` of the heights.

        Returns:
            Heights, extrapolated by their last change, NaN where unknown or in doubt; the last places.
        """
        rows, age_ns = _last(self.heights, stamps_ns, ticks)
        if self.heights.is_empty:
            return np.full(len(rows), np.nan), self._east_north_m(stamps_ns, ticks)
        before, column = np.maximum(rows - 1, 0), self.heights.column
        height_m = column("height_home_m") + column("correction_m")
        gap_ns = np.maximum(self.heights.stamps_ns[rows] - self.heights.stamps_ns[before], 1)
        rate_mps = (height_m[rows] - height_m[before]) / gap_ns * SECOND_NS
        extrapolated_m = rate_mps * np.minimum(age_ns, _MAX_EXTRAPOLATION_NS) / SECOND_NS
        in_doubt = np.abs(column("unexplained_m")[rows]) > WIDENED_STDS * np.maximum(std_m, MIN_STD_M)
        known = (age_ns <= _MAX_HEIGHT_AGE_NS) & ~in_doubt & (np.abs(rate_mps) <= 2 * MAX_CLIMB_MPS)
        return np.where(known, height_m[rows] + extrapolated_m, np.nan), self._east_north_m(stamps_ns, ticks)

    def _east_north_m(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Last places ``(n, 2)`` on the plane that touches the earth at the first one; 0 where there is none."""
        if self._places.is_empty:
            return np.zeros((len(stamps_ns), 2))
        rows, _ = _last(self._places, stamps_ns, ticks)
        names = zip(("lat_rad", "lon_rad"), self._first, strict=True)
        lat, lon = (self._places.column(name)[rows] - first for name, first in names)
        return EARTH_RADIUS_M * np.stack([lon * math.cos(self._first[0]), lat], axis=-1)

    def doubts(self, stamps_ns: IntArray) -> dict[str, FloatArray]:
        """Columns of ``heights`` ``(n,)`` of the samples with these stamps."""
        rows = np.minimum(np.searchsorted(self.heights.stamps_ns, stamps_ns), len(self.heights.stamps_ns) - 1)
        return {name: self.heights.column(name)[rows] for name in _RESULTS}

    def _climb_mps(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Vertical speeds ``(n,)`` by another message; NaN where there is none."""
        rows, age_ns = _last(self._climb, stamps_ns, ticks)
        known = age_ns <= _MAX_CLIMB_AGE_NS
        return (
            np.where(known, self._climb.column("climb_mps")[rows], np.nan)
            if known.any()
            else np.full(len(rows), np.nan)
        )

    def _gps_alt(self, stamps_ns: IntArray, ticks: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Altitudes by GPS ``(n,)``, NaN where there is none, their std and age (s)."""
        rows, age_ns = _last(self._gps, stamps_ns, ticks)
        known = age_ns <= _MAX_GPS_AGE_NS
        if not known.any():
            unknown = np.full(len(rows), np.nan)
            return unknown, unknown, unknown
        alt_m, std_m = (self._gps.column(name)[rows] for name in ("alt_msl_m", "std_m"))
        return np.where(known, alt_m, np.nan), std_m, np.where(known, age_ns / SECOND_NS, np.nan)

    def _ground(self, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
        """``_GROUNDED``, ``_AIRBORNE`` or 0 ``(n,)``.

        A vehicle that says whether it has landed is believed. Another one stands on the ground right after it is armed,
        and once it is disarmed again. One that has never been armed may fly: some senders never set the flag.
        """
        ground = np.zeros(len(stamps_ns), dtype=np.int64)
        rows, age_ns = _last(self._armed, stamps_ns, ticks)
        known = age_ns <= _MAX_STATE_AGE_NS
        if known.any():
            is_armed, was_armed, is_arming = (self._armed.column(name)[rows] != 0 for name in _ARMED_FLAGS)
            stands = (~is_armed & was_armed) | (is_arming & (age_ns <= _AFTER_ARMING_NS))
            ground = np.where(known, np.where(stands, _GROUNDED, np.where(is_armed, _AIRBORNE, 0)), 0)
        rows, age_ns = _last(self._landed, stamps_ns, ticks)
        known = age_ns <= _MAX_STATE_AGE_NS
        if known.any():
            ground = np.where(
                known, np.where(self._landed.column("is_landed")[rows] != 0, _GROUNDED, _AIRBORNE), ground
            )
        return ground


_RESULTS: Final = ("correction_m", "unexplained_m", "ground_m", "follows")
_ARMED_FLAGS: Final = ("is_armed", "was_armed", "is_arming")
_NEVER_NS: Final = np.iinfo(np.int64).max


def _last(stream: Stream, stamps_ns: IntArray, ticks: IntArray) -> tuple[IntArray, IntArray]:
    """Rows ``(n,)`` of the newest samples up to stamps as of ticks, and their ages (ns), ``_NEVER_NS`` without one."""
    if stream.is_empty:
        return np.zeros_like(stamps_ns), np.full(len(stamps_ns), _NEVER_NS)
    rows = stream.last_before(stamps_ns, ticks)
    return np.maximum(rows, 0), np.where(rows >= 0, stamps_ns - stream.stamps_ns[np.maximum(rows, 0)], _NEVER_NS)
