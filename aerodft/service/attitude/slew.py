"""How far a camera may be from a gimbal's report, because the report is a demand that jumps."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import inverse, multiply, to_rotation_vector
from aerodft.jit import njit
from aerodft.model import FloatArray, IntArray

_ROUNDING_RAD: Final = 1e-6  # far more than the angle between two quaternions is off by


def step_std(
    previous_wxyz: FloatArray, before_wxyz: FloatArray, after_wxyz: FloatArray, weight: FloatArray
) -> FloatArray:
    """Standard deviations ``(n, 3)`` of interpolating between two samples when the report jumps, in gimbal axes.

    A gimbal that repeats its command shows a slew as one step, at any time between two samples: a share ``w`` into the
    gap the interpolation is then off by ``turn sqrt(w (1 - w))``. What the turn before already announced is no step.

    Args:
        previous_wxyz: ``(n, 4)`` the sample before ``before_wxyz``; NaN where there is none, and nothing is known then.
        before_wxyz: ``(n, 4)`` around the stamp.
        after_wxyz: ``(n, 4)``.
        weight: ``(n,)`` of ``after_wxyz``.
    """
    turn = to_rotation_vector(multiply(inverse(before_wxyz), after_wxyz))
    size = _length(turn)
    announced = _length(to_rotation_vector(multiply(inverse(previous_wxyz), before_wxyz)))
    share = np.maximum(0.0, 1.0 - announced / np.where(size > 0, size, 1.0)) * np.sqrt(weight * (1 - weight))
    return np.where(np.isnan(share)[:, None], 0.0, turn * share[:, None])


@dataclass(frozen=True, slots=True)
class Demands:
    """What a gimbal was told before each of ``n`` stamps, as far as it may still matter: rows of its reports.

    Attributes:
        first: ``(n,)`` the first of them.
        stop: ``(n,)`` the one behind the last.
        since_ns: ``(k,)`` when each report was replaced: when the next was seen.
        stamps_ns: ``(n,)`` less the longest time without any effect of a new demand.
    """

    first: IntArray
    stop: IntArray
    since_ns: IntArray
    stamps_ns: IntArray


def demands_before(
    samples_ns: IntArray, before: IntArray, stamps_ns: IntArray, first: IntArray, *, lag_ns: int, slew_radps: float
) -> Demands:
    """The demands that a camera may not have reached yet.

    Args:
        samples_ns: ``(k,)`` when demands were seen.
        before: ``(n,)`` rows of the last samples that are not after the stamps.
        stamps_ns: ``(n,)`` when.
        first: ``(n,)`` rows before which nothing is known.
        lag_ns: The longest time without any effect of a new demand.
        slew_radps: The least rate at which the camera turns after it.
    """
    memory_ns = lag_ns + round(math.pi / slew_radps * SECOND_NS)
    starts = np.maximum(np.searchsorted(samples_ns, stamps_ns - memory_ns), first)
    return Demands(starts, before, samples_ns[1:], stamps_ns - lag_ns)  # a demand holds until the next one is seen


def lag_std(demands: Demands, reported_wxyz: FloatArray, now_wxyz: FloatArray, slew_radps: float) -> FloatArray:
    """Standard deviations ``(n, 3)`` of cameras that follow their demands late, in gimbal axes.

    Some time after a new demand the camera may still be where the old one had it, then it turns at ``slew_radps`` or
    faster: it is anywhere on what is left of the way, with equal chances.

    Args:
        demands: What was demanded before.
        reported_wxyz: ``(k, 4)`` all demands.
        now_wxyz: ``(n, 4)`` the demands at the stamps.
        slew_radps: As in ``demands_before``.
    """
    std = np.zeros((len(now_wxyz), 3))
    found = np.empty((2, int(np.sum(np.maximum(demands.stop - demands.first, 0)))), dtype=np.int64)
    times = demands.since_ns, demands.stamps_ns
    count = _unreached(demands.first, demands.stop, times, reported_wxyz, now_wxyz, slew_radps, found)
    if not count:
        return std
    of_stamp, rows = found[:, :count]
    turns = to_rotation_vector(multiply(inverse(reported_wxyz[rows]), now_wxyz[of_stamp]))
    angles = _length(turns)
    since_ns = np.maximum(demands.stamps_ns[of_stamp] - demands.since_ns[rows], 0)
    left = np.maximum(angles - slew_radps * since_ns / SECOND_NS, 0.0)
    starts = np.flatnonzero(np.diff(of_stamp, prepend=-1))
    most = np.maximum.reduceat(left, starts)
    is_most = np.flatnonzero(left == np.repeat(most, np.diff(starts, append=len(left))))
    farthest = is_most[np.searchsorted(is_most, starts)][most > 0]  # of several the first
    std[of_stamp[farthest]] = turns[farthest] * (left[farthest] / angles[farthest] / math.sqrt(3))[:, None]
    return std


@njit
def _unreached(
    first: IntArray,
    stop: IntArray,
    times: tuple[IntArray, IntArray],
    reported_wxyz: FloatArray,
    now_wxyz: FloatArray,
    slew_radps: float,
    found: IntArray,
) -> int:
    """How many demands a camera may be farthest from: of each stamp one, or some that are nearly as far.

    In ``found (2, m)`` their stamps and rows, in order.
    """
    since_ns, stamps_ns = times
    left = np.empty(max(np.max(stop - first), 0) if len(first) else 0)
    count = 0
    for n in range(len(first)):
        most = 0.0
        for k in range(first[n], stop[n]):
            done_rad = slew_radps * max(stamps_ns[n] - since_ns[k], 0) / SECOND_NS
            along = 0.0
            for i in range(4):
                along += reported_wxyz[k, i] * now_wxyz[n, i]
            cosine = min(abs(along), 1.0)  # of half an angle whose square is no more than ten times what it lacks of 1
            left[k - first[n]] = -1.0
            if done_rad < _ROUNDING_RAD or 10.0 * (1.0 - cosine) > (done_rad - _ROUNDING_RAD) ** 2:
                left[k - first[n]] = 2 * math.acos(cosine) - done_rad + _ROUNDING_RAD
                most = max(most, left[k - first[n]])
        for k in range(first[n], stop[n]):
            if left[k - first[n]] > max(most - 2 * _ROUNDING_RAD, 0.0):
                found[0, count], found[1, count] = n, k
                count += 1
    return count


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2))
