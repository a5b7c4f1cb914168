"""How far a camera may be from a gimbal's report, because the report is a demand that jumps."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.rotation import inverse, multiply, to_rotation_vector
from aerodft.model.arrays import FloatArray, IntArray

_ROUNDING_RAD: Final = 1e-6  # far more than the angle between two quaternions is off by


def jump_std(
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
    """What a gimbal was told before each of ``n`` stamps, as far as it may still matter.

    Attributes:
        rows: ``(m,)`` of the demands: those of the first stamp, then those of the second, and so on.
        replaced_ns: ``(m,)`` from the stamp back to when the next demand was seen, less the lag; not below 0.
        counts: ``(n,)`` how many of them are of each stamp.
    """

    rows: IntArray
    replaced_ns: IntArray
    counts: IntArray


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
    counts = np.maximum(before - starts, 0)
    within = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    rows = np.repeat(starts, counts) + within
    replaced_ns = samples_ns[rows + 1]  # a demand holds until the next one is seen
    return Demands(rows, np.maximum(np.repeat(stamps_ns, counts) - replaced_ns - lag_ns, 0), counts)


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
    of_stamp = np.repeat(np.arange(len(now_wxyz)), demands.counts)
    done_rad = slew_radps * demands.replaced_ns / SECOND_NS
    along = np.abs(np.einsum("ij,ij->i", reported_wxyz[demands.rows], now_wxyz[of_stamp]))
    unreached = np.flatnonzero(2 * np.arccos(np.minimum(along, 1.0)) > done_rad - _ROUNDING_RAD)  # most are reached
    if not len(unreached):
        return std
    of_stamp = of_stamp[unreached]
    turns = to_rotation_vector(multiply(inverse(reported_wxyz[demands.rows[unreached]]), now_wxyz[of_stamp]))
    angles = _length(turns)
    left = np.maximum(angles - done_rad[unreached], 0.0)
    starts = np.flatnonzero(np.diff(of_stamp, prepend=-1))
    most = np.maximum.reduceat(left, starts)
    is_most = np.flatnonzero(left == np.repeat(most, np.diff(starts, append=len(left))))
    farthest = is_most[np.searchsorted(is_most, starts)][most > 0]  # of several the first
    std[of_stamp[farthest]] = turns[farthest] * (left[farthest] / angles[farthest] / math.sqrt(3))[:, None]
    return std


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2))
