"""The true flight: where the vehicle was and where its camera looked, at every instant."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerodft.geometry.rotation import (
    camera_from_gimbal,
    from_rotation_vector,
    inverse,
    multiply,
    slerp,
    to_rotation_vector,
    yaw_pitch_roll,
)
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import GeoOrigin, Pose


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """Samples of the true motion; between them positions are linear and attitudes turn evenly.

    Attributes:
        origin: ENU origin, on the measured plane.
        stamp_ns: ``(n,)`` ascending, host UTC.
        position_enu_m: ``(n, 3)``; up is the height above the plane, which is also the home-relative height.
        ned_wxyz_body: ``(n, 4)`` the vehicle's attitude.
        level_wxyz_gimbal: ``(n, 4)`` the gimbal against the horizon and the vehicle's heading (``ref_SO3_gimbal``).
        enu_wxyz_cam: ``(n, 4)`` the camera's attitude.
    """

    origin: GeoOrigin
    stamp_ns: IntArray
    position_enu_m: FloatArray
    ned_wxyz_body: FloatArray
    level_wxyz_gimbal: FloatArray
    enu_wxyz_cam: FloatArray

    @property
    def start_ns(self) -> int:
        """Stamp of the first sample."""
        return int(self.stamp_ns[0])

    @property
    def end_ns(self) -> int:
        """Stamp of the last sample."""
        return int(self.stamp_ns[-1])

    def shifted(self, by_ns: int) -> "Trajectory":
        """The same flight at another time."""
        return replace(self, stamp_ns=self.stamp_ns + by_ns)

    def cut(self, start_ns: int, end_ns: int) -> "Trajectory":
        """The samples in ``[start_ns, end_ns)``."""
        keep = (self.stamp_ns >= start_ns) & (self.stamp_ns < end_ns)
        return replace(
            self,
            stamp_ns=self.stamp_ns[keep],
            position_enu_m=self.position_enu_m[keep],
            ned_wxyz_body=self.ned_wxyz_body[keep],
            level_wxyz_gimbal=self.level_wxyz_gimbal[keep],
            enu_wxyz_cam=self.enu_wxyz_cam[keep],
        )

    def sampled(self, stamps_ns: npt.ArrayLike) -> "Trajectory":
        """The motion at ``stamps_ns (m,)``, which outside the flight is that of its end."""
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        after = np.clip(np.searchsorted(self.stamp_ns, stamps, side="right"), 1, len(self.stamp_ns) - 1)
        before = after - 1
        gap = self.stamp_ns[after] - self.stamp_ns[before]
        weight = np.clip((stamps - self.stamp_ns[before]) / gap, 0.0, 1.0)
        position = self.position_enu_m
        return replace(
            self,
            stamp_ns=stamps,
            position_enu_m=position[before] + weight[:, None] * (position[after] - position[before]),
            ned_wxyz_body=slerp(self.ned_wxyz_body[before], self.ned_wxyz_body[after], weight),
            level_wxyz_gimbal=slerp(self.level_wxyz_gimbal[before], self.level_wxyz_gimbal[after], weight),
            enu_wxyz_cam=slerp(self.enu_wxyz_cam[before], self.enu_wxyz_cam[after], weight),
        )

    def pose(self, stamp_ns: int) -> Pose:
        """The camera's exact pose."""
        at = self.sampled([stamp_ns])
        return Pose(position_enu_m=at.position_enu_m[0], wxyz=at.enu_wxyz_cam[0])

    def velocity_enu_mps(self) -> FloatArray:
        """``(n, 3)``, by central differences."""
        seconds = (self.stamp_ns - self.stamp_ns[0]) / 1e9
        return np.asarray(np.gradient(self.position_enu_m, seconds, axis=0))

    def body_rate_radps(self) -> FloatArray:
        """Angular rate in body axes, ``(n, 3)``, by forward differences."""
        seconds = np.diff(self.stamp_ns) / 1e9
        step = to_rotation_vector(multiply(inverse(self.ned_wxyz_body[:-1]), self.ned_wxyz_body[1:]))
        rate = step / seconds[:, None]
        return np.concatenate([rate, rate[-1:]])


def heading_wxyz(ned_wxyz_body: FloatArray) -> FloatArray:
    """The heading alone of vehicle attitudes, as a rotation about down, ``(..., 4)``."""
    yaw, _, _ = yaw_pitch_roll(ned_wxyz_body)
    return from_rotation_vector(yaw[..., None] * np.array([0.0, 0.0, 1.0]))


def camera_of(ned_wxyz_body: FloatArray, level_wxyz_gimbal: FloatArray) -> FloatArray:
    """``enu_SO3_cam`` of a gimbal whose yaw counts from the vehicle's heading, ``(..., 4)``."""
    return camera_from_gimbal(multiply(heading_wxyz(ned_wxyz_body), level_wxyz_gimbal))
