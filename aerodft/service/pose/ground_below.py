"""The ground right below a camera: what heights that are measured from there are counted from."""

from dataclasses import dataclass, replace

import numpy as np

from aerodft.geometry import Ground
from aerodft.model import CODES, FloatArray, IntArray, Pose, Status

_ALOFT_M = 1e5  # above all ground
_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, slots=True, eq=False)
class GroundBelow:
    """Ground at ``n`` places.

    Attributes:
        status: ``(n,)`` indices into ``CODES``: ``BEYOND_TERRAIN`` or ``NO_ELEVATION`` where its height is unknown.
        height_m: ``(n,)`` above ENU 0; NaN where it is unknown.
        slope: ``(n, 2)`` its rise per metre to the east and to the north; NaN where it is unknown.
    """

    status: IntArray
    height_m: FloatArray
    slope: FloatArray

    @staticmethod
    def what(code: int) -> str:
        """What there is instead of ground whose height is known, by a status's index."""
        return "a hole in the elevation model" if CODES[code] is Status.NO_ELEVATION else "no more elevation model"


def ground_below(ground: Ground, east_north_m: FloatArray) -> GroundBelow:
    """The ground at ``east_north_m (n, 2)``."""
    aloft = np.column_stack([east_north_m, np.full(len(east_north_m), _ALOFT_M)])
    below = ground.meet(aloft, np.broadcast_to(_DOWN, aloft.shape).copy(), np.zeros(len(aloft)))
    slope = -below.normal_enu[:, :2] / below.normal_enu[:, 2:]
    return GroundBelow(below.status.astype(np.int64), below.points_enu_m[:, 2], slope)


def raised_by_ground(pose: Pose, height_m: FloatArray, slope: FloatArray) -> Pose:
    """Poses ``(n,)`` in ENU of cameras whose height, and its variance, are counted from ground below them.

    Who is farther up the hill than he thinks, is higher too: errors in east and north become errors in height.

    Args:
        pose: The third component of its positions is the height above that ground.
        height_m: ``(n,)`` of the ground.
        slope: ``(n, 2)`` of the ground.
    """
    follows = np.broadcast_to(np.eye(6), (len(height_m), 6, 6)).copy()
    follows[:, 2, :2] = slope
    position = pose.position_enu_m.copy()
    position[:, 2] += height_m
    return replace(pose, position_enu_m=position, cov=follows @ pose.cov @ follows.swapaxes(-1, -2))
