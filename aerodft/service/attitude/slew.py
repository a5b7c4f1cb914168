"""Uncertainty of a camera's attitude where the gimbal's report is a demand that jumps."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import inverse, multiply, to_rotation_vector
from aerodft.jit import njit
from aerodft.model import FloatArray, IntArray

_ROUNDING_RAD: Final = 1e-6  # far more than the rounding error of the angle between two quaternions


def step_std(
    previous_wxyz: FloatArray, before_wxyz: FloatArray, after_wxyz: FloatArray, weight: FloatArray
) -> FloatArray:
    """Standard deviations ``(n, 3)`` of interpolation between two samples of a report that jumps, in gimbal axes.

    A gimbal that repeats its command shows a slew as one step at any time between two samples: at the fraction ``w`` of
    the gap interpolation then has the error ``rotation sqrt(w (1 - w))``. The rotation before it reduces the step.

    Args:
        previous_wxyz: ``(n, 4)`` the sample before ``before_wxyz``; NaN where there is none, with a result of 0.
        before_wxyz: ``(n, 4)`` around the stamp.
        after_wxyz: ``(n, 4)``.
        weight: ``(n,)`` of ``after_wxyz``.
    """
    rotation = to_rotation_vector(multiply(inverse(before_wxyz), after_wxyz))
    angle = _norms(rotation)
    previous_angle = _norms(to_rotation_vector(multiply(inverse(previous_wxyz), before_wxyz)))
    scale = np.maximum(0.0, 1.0 - previous_angle / np.where(angle > 0, angle, 1.0)) * np.sqrt(weight * (1 - weight))
    return np.where(np.isnan(scale)[:, None], 0.0, rotation * scale[:, None])


@dataclass(frozen=True, slots=True)
class Demands:
    """Rows of a gimbal's demands before each of ``n`` stamps that may still matter.

    Attributes:
        first: ``(n,)`` first row.
        stop: ``(n,)`` end of the rows.
        since_ns: ``(k,)`` stamp at which each demand was replaced by the next.
        stamps_ns: ``(n,)`` stamps less the longest dead time after a new demand.
    """

    first: IntArray
    stop: IntArray
    since_ns: IntArray
    stamps_ns: IntArray


def demands_before(
    samples_ns: IntArray, before: IntArray, stamps_ns: IntArray, first: IntArray, *, lag_ns: int, slew_radps: float
) -> Demands:
    """Demands that a camera may not have reached yet.

    Args:
        samples_ns: ``(k,)`` stamps of the demands.
        before: ``(n,)`` rows of the last samples that are not after the stamps.
        stamps_ns: ``(n,)``.
        first: ``(n,)`` first known rows.
        lag_ns: Longest dead time after a new demand.
        slew_radps: Lowest rate at which the camera turns after it.
    """
    memory_ns = lag_ns + round(math.pi / slew_radps * SECOND_NS)
    starts = np.maximum(np.searchsorted(samples_ns, stamps_ns - memory_ns), first)
    return Demands(starts, before, samples_ns[1:], stamps_ns - lag_ns)  # a demand holds until the next one is seen


def lag_std(demands: Demands, reported_wxyz: FloatArray, now_wxyz: FloatArray, slew_radps: float) -> FloatArray:
    """Standard deviations ``(n, 3)`` of cameras that lag behind their demands, in gimbal axes.

    After a dead time the camera turns from an old demand to the new one at ``slew_radps`` or faster: its attitude is
    uniformly distributed over the remaining angle.

    Args:
        demands: Earlier demands.
        reported_wxyz: ``(k, 4)`` all demands.
        now_wxyz: ``(n, 4)`` the demands at the stamps.
        slew_radps: As in ``demands_before``.
    """
    std = np.zeros((len(now_wxyz), 3))
    candidates = np.empty((2, int(np.sum(np.maximum(demands.stop - demands.first, 0)))), dtype=np.int64)
    times = demands.since_ns, demands.stamps_ns
    count = _farthest_candidates(demands.first, demands.stop, times, reported_wxyz, now_wxyz, slew_radps, candidates)
    if not count:
        return std
    of_stamp, rows = candidates[:, :count]
    rotations = to_rotation_vector(multiply(inverse(reported_wxyz[rows]), now_wxyz[of_stamp]))
    angles = _norms(rotations)
    since_ns = np.maximum(demands.stamps_ns[of_stamp] - demands.since_ns[rows], 0)
    remaining = np.maximum(angles - slew_radps * since_ns / SECOND_NS, 0.0)
    starts = np.flatnonzero(np.diff(of_stamp, prepend=-1))
    farthest_rad = np.maximum.reduceat(remaining, starts)
    is_farthest = np.flatnonzero(remaining == np.repeat(farthest_rad, np.diff(starts, append=len(remaining))))
    farthest = is_farthest[np.searchsorted(is_farthest, starts)][farthest_rad > 0]  # the first of several
    std[of_stamp[farthest]] = rotations[farthest] * (remaining[farthest] / angles[farthest] / math.sqrt(3))[:, None]
    return std


@njit
def _farthest_candidates(
    first: IntArray,
    stop: IntArray,
    times: tuple[IntArray, IntArray],
    reported_wxyz: FloatArray,
    now_wxyz: FloatArray,
    slew_radps: float,
    candidates: IntArray,
) -> int:
    """Number of candidates for the demand farthest from the camera: one per stamp, or some that are nearly as far.

    Their stamps and rows are written to ``candidates (2, m)``, in order.
    """
    since_ns, stamps_ns = times
    remaining = np.empty(max(np.max(stop - first), 0) if len(first) else 0)
    count = 0
    for n in range(len(first)):
        farthest_rad = 0.0
        for k in range(first[n], stop[n]):
            turned_rad = slew_radps * max(stamps_ns[n] - since_ns[k], 0) / SECOND_NS
            dot = 0.0
            for i in range(4):
                dot += reported_wxyz[k, i] * now_wxyz[n, i]
            cosine = min(abs(dot), 1.0)  # of half an angle, whose square is at most ten times 1 - cosine
            remaining[k - first[n]] = -1.0
            if turned_rad < _ROUNDING_RAD or 10.0 * (1.0 - cosine) > (turned_rad - _ROUNDING_RAD) ** 2:
                remaining[k - first[n]] = 2 * math.acos(cosine) - turned_rad + _ROUNDING_RAD
                farthest_rad = max(farthest_rad, remaining[k - first[n]])
        for k in range(first[n], stop[n]):
            if remaining[k - first[n]] > max(farthest_rad - 2 * _ROUNDING_RAD, 0.0):
                candidates[0, count], candidates[1, count] = n, k
                count += 1
    return count


def _norms(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2))
