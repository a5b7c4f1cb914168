"""Plausibility of heights above the surface below: whether they follow the vehicle's own vertical motion.

A rangefinder or a terrain database differs from the height above home by the terrain, which changes with horizontal
motion. What stays where it is while the vehicle climbs, or scatters, is no height.
"""

from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.jit import njit
from aerodft.model import FloatArray, IntArray
from aerodft.service.pose.home_checks import shrink
from aerodft.service.streams import Stream

_MAX_GAP_S: Final = 10.0  # between two readings of one motion
_FORGET_S: Final = 120.0
_WINDOW_S: Final = 10.0  # in which a motion is compared
_MIN_MOTION_M: Final = 2.5  # that tells whether a height follows: six times the noise of 0.3 m of two heights
_SLOPE: Final = 0.35  # a height follows from 0.65 to 1.35 of the motion, and stands still below 0.35
_MIN_STEP_M: Final = 2.0  # of the surface, that is no noise
_STEP_MPS: Final = 0.2  # slower, the height above home may drift
_DRIFT_MPS: Final = 0.03  # of a barometer in a hover: 0.3 m within a window
_STEP_PER_RISE: Final = 1.5  # of a step beside a climb: 1 is a height that stands still
_TRAVEL_M, _TRAVEL_PER_STEP = 1.0, 0.2  # of the point below, with which the surface may step
_REPEATS: Final = 3  # of one reading to the last digit, which has noise
_MAX_EDGE_M: Final = 20.0  # between two readings: banks, canopies and houses are lower
_NOTED_REPEAT_M: Final = 0.3  # of motion that such a reading did not follow: from here on it is in the std
_MIN_REPEAT_M: Final = 1.5  # from here on it stands still; 3.5 times the noise of two heights above home of 0.3 m
_SECOND_DIFFERENCES: Final = 11  # a bank's edge makes two of them large, a scattering sensor all
_OF_SLOPE: Final = 2  # values that a second difference needs before
_STD_OF_SECOND_DIFFERENCE: Final = 1.652  # median size of those of white noise over its std: 0.6745 sqrt(6)
_NOTED_SCATTER_STDS: Final = 2.0  # from here on noise is in the std: what is stated may be half of what is
_MAX_SCATTER_STDS: Final = 5.0  # from here on it is no height
_MAX_ODD: Final = 2  # motions in a row that a height did not follow: a bank's edge under a climb is one
_CONTRADICTION_STDS: Final = 5.0
_AGREEMENT_STDS: Final = 1.96  # of a surface with home, after it has stepped without a motion
_MIN_DOUBT_M: Final = 1.2  # of a change without a motion; twice the noise of two heights of 0.2 and 0.3 m

UNKNOWN, CREDIBLE, STUCK, ERRATIC, SCATTERED = 0.0, 1.0, -1.0, -2.0, -3.0
"""Verdicts on a height.

Unknown: nothing shows what it is. Credible: it follows vertical motion, or it agreed with home and has changed with the
place alone since. Stuck: it stands still while the vehicle climbs. Erratic: it moves otherwise than the vehicle.
Scattered: it is noise.
"""

# Places in the state of ``_check``.
_VERDICT, _IS_LINKED, _ODD, _HAS_WINDOW, _AGE_S, _TRAVELLED_M, _START_Z, _START_H, _START_X, _START_Y = range(10)
_RAW, _RUN, _RUN_H, _IS_BROKEN, _STEPPED_M, _DT, _COUNT, _HAD_HOME = range(10, 18)
_OF_HEIGHT, _OF_DIFFERENCE = 18, 18 + 2 + _SECOND_DIFFERENCES  # the last two values, and second differences
_STATE_SIZE: Final = _OF_DIFFERENCE + 2 + _SECOND_DIFFERENCES


@njit
def _start_window(state: FloatArray, z: float, h: float, x: float, y: float) -> None:
    state[_HAS_WINDOW] = 1.0
    state[_AGE_S] = state[_TRAVELLED_M] = 0.0
    state[_START_Z], state[_START_H], state[_START_X], state[_START_Y] = z, h, x, y


@njit
def _doubt(state: FloatArray) -> None:
    """Take back that the height is credible, until it follows a motion or agrees with home anew."""
    state[_VERDICT], state[_IS_LINKED], state[_IS_BROKEN] = min(state[_VERDICT], UNKNOWN), 0.0, 1.0


@njit
def _judge_window(state: FloatArray, z: float, h: float, x: float, y: float, std_m: float) -> float:
    """Judge the motion since the window's start, once it is large or old enough.

    Returns:
        What the height has changed by beyond the motion, and not with the place; 0 where noise explains it.
    """
    risen_m, changed_m = h - state[_START_H], z - state[_START_Z]
    off_m, travelled_m = changed_m - risen_m, state[_TRAVELLED_M]
    is_at_place = travelled_m < _TRAVEL_M + _TRAVEL_PER_STEP * max(abs(off_m) - _MIN_STEP_M, 0.0)
    doubt_m = abs(state[_STEPPED_M] + (off_m if is_at_place else 0.0))
    if doubt_m <= max(_MIN_DOUBT_M, _CONTRADICTION_STDS * std_m):
        doubt_m = 0.0
    is_moved = abs(risen_m) >= max(_MIN_MOTION_M, 10 * std_m)
    is_stepped = abs(off_m) > max(_MIN_STEP_M, _CONTRADICTION_STDS * std_m) + _STEP_MPS * state[_AGE_S]
    is_stepped &= abs(off_m) > _STEP_PER_RISE * abs(risen_m)  # else it may stand still
    if not (is_moved or is_stepped or state[_AGE_S] > _WINDOW_S):
        return float(doubt_m)
    if is_moved and abs(off_m) <= max(_SLOPE * abs(risen_m), 4 * std_m):
        state[_VERDICT], state[_ODD], state[_IS_BROKEN], state[_STEPPED_M] = CREDIBLE, 0.0, 0.0, 0.0
    elif is_moved and travelled_m < abs(risen_m):  # else it may be a slope
        state[_ODD] += 1
        state[_STEPPED_M] += off_m
        _doubt(state)
        if abs(changed_m) <= _SLOPE * abs(risen_m):
            state[_VERDICT] = STUCK
        elif state[_ODD] >= _MAX_ODD:
            state[_VERDICT] = ERRATIC
    elif is_at_place:
        state[_STEPPED_M] += shrink(off_m, _DRIFT_MPS * state[_AGE_S])
        if is_stepped:
            _doubt(state)
    if travelled_m >= _TRAVEL_M + _TRAVEL_PER_STEP * abs(state[_STEPPED_M]):
        state[_STEPPED_M] = 0.0
    _start_window(state, z, h, x, y)
    return float(doubt_m)


@njit
def _second_difference(state: FloatArray, at: int, value: float, dt_s: float) -> float:
    """Median second difference (m) of a series whose last values stand in the state from ``at`` on; appends a value."""
    if state[_COUNT] >= _OF_SLOPE:
        slope = (state[at] - state[at + 1]) / state[_DT]  # as if evenly spaced in time
        place = at + 2 + int(state[_COUNT] - _OF_SLOPE) % _SECOND_DIFFERENCES
        state[place] = abs(value - state[at] - slope * dt_s)
    state[at + 1], state[at] = state[at], value
    return float(np.median(state[at + 2 : at + 2 + _SECOND_DIFFERENCES]))


@njit
def _scatter_m(state: FloatArray, z: float, h: float, dt_s: float) -> float:
    """Std (m) of white noise of heights, from median second differences; 0 while there are too few.

    The vehicle's acceleration is in those of the height, the noise of the height above home in those of the difference:
    the smaller counts.
    """
    has_home = 1.0 if np.isfinite(h) else 0.0
    if has_home != state[_HAD_HOME] or not 0.5 * state[_DT] <= dt_s <= 2 * state[_DT]:
        state[_COUNT], state[_HAD_HOME] = 0.0, has_home
    noise_m = _second_difference(state, _OF_HEIGHT, z, dt_s)
    if has_home == 1.0:
        noise_m = min(noise_m, _second_difference(state, _OF_DIFFERENCE, z - h, dt_s))
    state[_DT] = dt_s
    state[_COUNT] += 1
    return noise_m / _STD_OF_SECOND_DIFFERENCE if state[_COUNT] >= _OF_SLOPE + _SECOND_DIFFERENCES else 0.0


@njit
def _judge_repeats(state: FloatArray, raw: float, h: float, std_m: float) -> float:
    """Judge readings that are equal to the last digit while the vehicle climbs or sinks; real ones have noise.

    Returns:
        The motion (m) that they did not follow; 0 where noise explains it.
    """
    if state[_RUN] == 0 or raw != state[_RAW]:
        state[_RAW], state[_RUN], state[_RUN_H] = raw, 0.0, h
    state[_RUN] += 1
    risen_m = abs(h - state[_RUN_H])
    if state[_RUN] < _REPEATS or risen_m <= max(_NOTED_REPEAT_M, 1.5 * std_m):
        return 0.0
    if risen_m > max(_MIN_REPEAT_M, _CONTRADICTION_STDS * std_m):
        state[_VERDICT] = STUCK
    return float(risen_m)


@njit
def _follow(state: FloatArray, z: float, h: float, x: float, y: float, dt_s: float) -> None:
    """Add a height to the window that motions are compared in."""
    if state[_HAS_WINDOW] == 0:
        _start_window(state, z, h, x, y)
    else:
        state[_TRAVELLED_M] = max(state[_TRAVELLED_M], np.hypot(x - state[_START_X], y - state[_START_Y]))
        state[_AGE_S] += dt_s


@njit
def _check(columns: FloatArray, state: FloatArray, checked: FloatArray) -> None:
    """Judge heights above the surface in order.

    Args:
        columns: ``(8, n)``: time since the reading before (s; NaN for the first), height, reading as sent, its std,
            height above home (NaN while it is in doubt) and its std, east and north of the point below (m).
        state: ``(_STATE_SIZE,)`` from the readings before, updated.
        checked: ``(2, n)`` filled: verdict, and what the std has to hold besides (m): white noise, or a change without
            a motion.
    """
    for k in range(columns.shape[1]):
        dt_s, z, raw, std_m, h, home_std_m, x, y = columns[:, k]
        if not dt_s <= _FORGET_S:
            state[:] = 0.0
        if not dt_s <= _MAX_GAP_S:
            state[_HAS_WINDOW] = state[_COUNT] = state[_RUN] = 0.0
        doubt_m = noise_m = _scatter_m(state, z, h, dt_s) if np.isfinite(z) else 0.0
        if noise_m <= _NOTED_SCATTER_STDS * std_m:
            doubt_m = 0.0
        if np.isfinite(z) and np.isfinite(h):
            if state[_COUNT] >= _OF_SLOPE and abs(state[_OF_DIFFERENCE] - state[_OF_DIFFERENCE + 1]) > _MAX_EDGE_M:
                _doubt(state)
            _follow(state, z, h, x, y, dt_s)
            contradiction_m = _CONTRADICTION_STDS * np.hypot(std_m, home_std_m)
            doubt_m = max(doubt_m, _judge_window(state, z, h, x, y, std_m), _judge_repeats(state, raw, h, std_m))
            agreement_m = _AGREEMENT_STDS * np.hypot(std_m, home_std_m)
            if abs(z - h) <= (agreement_m if state[_IS_BROKEN] == 1 else contradiction_m):
                state[_IS_LINKED], state[_IS_BROKEN] = 1.0, 0.0
        else:
            state[_HAS_WINDOW] = state[_RUN] = 0.0
        verdict = state[_VERDICT]
        if verdict == UNKNOWN and state[_IS_LINKED] == 1:
            verdict = CREDIBLE
        checked[0, k] = SCATTERED if noise_m > _MAX_SCATTER_STDS * std_m else verdict
        checked[1, k] = doubt_m


class SurfaceChecks:
    """Verdicts on the readings of one source of heights above the surface.

    Args:
        stream: Its readings, with columns ``value_m``, ``verdict`` and ``doubt_m``.
    """

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._state = np.zeros(_STATE_SIZE)
        self._checked = 0

    def take_new(self) -> tuple[IntArray, IntArray]:
        """Rows ``(n,)`` of the readings appended since, and the ticks from which they are known; each is given once."""
        rows, ticks = self._stream.newest_rows(self._stream.appended - self._checked)
        self._checked = self._stream.appended
        return rows, ticks

    def check(
        self,
        rows: IntArray,
        height_m: FloatArray,
        std_m: FloatArray,
        home: tuple[FloatArray, FloatArray],
        foot_m: FloatArray,
    ) -> None:
        """Judge readings.

        Args:
            rows: ``(n,)`` from ``take_new``, at least one.
            height_m: ``(n,)`` vertical heights, NaN where unknown.
            std_m: ``(n,)``.
            home: ``(n,)`` heights above home, NaN where unknown or in doubt, and their std.
            foot_m: ``(n, 2)`` east and north of the points below.
        """
        stamps_ns, before = self._stream.stamps_ns, np.maximum(rows - 1, 0)
        dt_s = np.where(rows > 0, (stamps_ns[rows] - stamps_ns[before]) / SECOND_NS, np.nan)
        raw_m = self._stream.column("value_m")[rows]
        checked = np.empty((2, len(rows)))
        _check(np.stack([dt_s, height_m, raw_m, std_m, *home, *foot_m.T]), self._state, checked)
        self._stream.column("verdict")[rows], self._stream.column("doubt_m")[rows] = checked
