"""The ground right below a camera: what heights that are measured from there are counted from."""

from dataclasses import dataclass, replace

import numpy as np

from aerodft.geometry.ground import Ground
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose
from aerodft.model.status import CODES, Status

_ALOFT_M = 1e5  # above all ground
_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Footing:
    """Ground at one place.

    Attributes:
        status: ``BEYOND_TERRAIN`` or ``NO_ELEVATION`` where its height is unknown.
        height_m: Above ENU 0; NaN where it is unknown.
        slope: ``(2,)`` its rise per metre to the east and to the north; NaN likewise.
    """

    status: Status
    height_m: float
    slope: FloatArray

    @property
    def what(self) -> str:
        """What there is instead of ground whose height is known."""
        return "a hole in the elevation model" if self.status is Status.NO_ELEVATION else "no more elevation model"

    def carrying(self, pose: Pose) -> Pose:
        """The pose in ENU of a camera whose height, and its variance, are counted from this ground.

        Who is farther up the hill than he thinks, is higher too: errors in east and north become errors in height.

        Args:
            pose: One pose; its third component is the height above this ground.
        """
        follows = np.eye(6)
        follows[2, :2] = self.slope
        position = pose.position_enu_m + np.array([0.0, 0.0, self.height_m])
        return replace(pose, position_enu_m=position, cov=follows @ pose.cov @ follows.T)


def footing(ground: Ground, east_north_m: FloatArray) -> Footing:
    """The ground at ``east_north_m (2,)``."""
    below = ground.meet(np.array([*east_north_m, _ALOFT_M]), _DOWN, 0.0)
    normal = below.normal_enu
    return Footing(CODES[int(below.status)], float(below.points_enu_m[2]), -normal[:2] / normal[2])
