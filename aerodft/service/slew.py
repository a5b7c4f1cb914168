"""How far a camera may be from a gimbal's report, because the report is a demand that jumps."""

import math

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.interpolation import Bracket
from aerodft.geometry.rotation import inverse, multiply, to_rotation_vector
from aerodft.model.arrays import FloatArray, IntArray


def jump_std(reported_wxyz: FloatArray, found: Bracket) -> FloatArray:
    """Standard deviation ``(3,)`` of interpolating between two samples when the report jumps, in gimbal axes.

    A gimbal that repeats its command shows a slew as one step, at any time between two samples: a share ``w`` into the
    gap the interpolation is then off by ``turn sqrt(w (1 - w))``. What the turn before already announced is no step.
    """
    turn = to_rotation_vector(multiply(inverse(reported_wxyz[found.before]), reported_wxyz[found.after]))
    if found.before == 0 or not np.any(turn):
        return turn * 0.0
    before = to_rotation_vector(multiply(inverse(reported_wxyz[found.before - 1]), reported_wxyz[found.before]))
    unannounced = max(0.0, 1.0 - float(np.linalg.norm(before)) / float(np.linalg.norm(turn)))
    return np.asarray(turn * unannounced * math.sqrt(found.weight * (1 - found.weight)))


def lag_std(
    reported_wxyz: FloatArray, stamps_ns: IntArray, found: Bracket, stamp_ns: int, *, lag_ns: int, slew_radps: float
) -> FloatArray:
    """Standard deviation ``(3,)`` of a camera that follows its demand late, in gimbal axes.

    Up to ``lag_ns`` after a new demand the camera may still be where the old one had it, then it turns at
    ``slew_radps`` or faster: it is anywhere on what is left of the way, with equal chances.

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
    earlier = reported_wxyz[first : found.before]
    turns = to_rotation_vector(multiply(inverse(earlier), found.spherical(reported_wxyz)))
    angles = np.linalg.norm(turns, axis=-1)
    replaced_ns = stamps_ns[first + 1 : found.before + 1]  # a demand holds until the next one is seen
    turned = slew_radps * np.maximum(stamp_ns - replaced_ns - lag_ns, 0) / SECOND_NS
    left = np.maximum(angles - turned, 0.0)
    if not np.any(left):
        return np.zeros(3)
    farthest = int(np.argmax(left))
    return np.asarray(turns[farthest] * (left[farthest] / angles[farthest] / math.sqrt(3)))
