"""How far a camera may be from a gimbal's report, because the report is a demand that jumps."""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.interpolation import Bracket
from aerodft.geometry.rotation import inverse, multiply, to_rotation_vector
from aerodft.model.arrays import FloatArray, IntArray


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
    """What a gimbal was told before a stamp, as far as it may still matter.

    Attributes:
        wxyz: ``(k, 4)``.
        replaced_ns: ``(k,)`` from the stamp back to when the next demand was seen, less the lag; not below 0.
    """

    wxyz: FloatArray
    replaced_ns: IntArray


def demands_before(
    reported_wxyz: FloatArray, stamps_ns: IntArray, found: Bracket, stamp_ns: int, *, lag_ns: int, slew_radps: float
) -> Demands:
    """The demands that a camera may not have reached yet.

    Args:
        reported_wxyz: ``(n, 4)`` demands.
        stamps_ns: ``(n,)`` theirs.
        found: The samples around ``stamp_ns``.
        stamp_ns: When.
        lag_ns: The longest time without any effect of a new demand.
        slew_radps: The least rate at which the camera turns after it.
    """
    memory_ns = lag_ns + round(math.pi / slew_radps * SECOND_NS)
    first = int(np.searchsorted(stamps_ns, stamp_ns - memory_ns))
    replaced_ns = stamps_ns[first + 1 : found.before + 1]  # a demand holds until the next one is seen
    return Demands(reported_wxyz[first : found.before], np.maximum(stamp_ns - replaced_ns - lag_ns, 0))


def lag_std(demands: list[Demands], now_wxyz: FloatArray, slew_radps: float) -> FloatArray:
    """Standard deviations ``(n, 3)`` of cameras that follow their demands late, in gimbal axes.

    Some time after a new demand the camera may still be where the old one had it, then it turns at ``slew_radps`` or
    faster: it is anywhere on what is left of the way, with equal chances.

    Args:
        demands: ``n`` times what was demanded before.
        now_wxyz: ``(n, 4)`` the demands at the stamps.
        slew_radps: As in ``demands_before``.
    """
    counts = np.array([len(each.wxyz) for each in demands])
    std = np.zeros((len(demands), 3))
    if not np.any(counts):
        return std
    earlier = np.concatenate([each.wxyz for each in demands])
    turns = to_rotation_vector(multiply(inverse(earlier), np.repeat(now_wxyz, counts, axis=0)))
    angles = _length(turns)
    since_ns = np.concatenate([each.replaced_ns for each in demands])
    left = np.maximum(angles - slew_radps * since_ns / SECOND_NS, 0.0)
    stop = 0
    for row, count in enumerate(counts.tolist()):
        start, stop = stop, stop + count
        farthest = start + int(np.argmax(left[start:stop])) if count else 0
        if count and left[farthest] > 0:
            std[row] = turns[farthest] * (left[farthest] / angles[farthest] / math.sqrt(3))
    return std


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2))
