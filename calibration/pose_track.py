"""Where telemetry says that the camera was, around one image's stamp."""

from dataclasses import dataclass

import numpy as np

from aerodft.geometry.rotation import from_rotation_vector, inverse, multiply, slerp, to_rotation_vector
from aerodft.model.arrays import FloatArray

_APART_S = 0.02  # over twice this, motion is seen as even: about an interval between two attitudes


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A camera's pose and motion.

    Attributes:
        position_m: ``(3,)`` east, north, up.
        wxyz: ``(4,)`` from camera axes to east, north, up.
        velocity_mps: ``(3,)`` east, north, up.
        rate_cam_radps: ``(3,)`` angular rate in camera axes.
    """

    position_m: FloatArray
    wxyz: FloatArray
    velocity_mps: FloatArray
    rate_cam_radps: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PoseTrack:
    """Poses before and after an image's stamp; in between, they are interpolated.

    Attributes:
        offset_s: ``(k,)`` ascending, from the stamp; 0 is among them or between them.
        position_m: ``(k, 3)`` east, north, up.
        wxyz: ``(k, 4)`` from camera axes to east, north, up.
    """

    offset_s: FloatArray
    position_m: FloatArray
    wxyz: FloatArray

    @classmethod
    def steady(cls, moment: Moment, reach_s: float) -> "PoseTrack":
        """Even motion through a pose, for so long before and after it; with a reach of 0 the pose alone."""
        offset_s = np.array([-reach_s, 0.0, reach_s] if reach_s > 0 else [0.0])
        turns = from_rotation_vector(offset_s[:, None] * moment.rate_cam_radps)
        return cls(
            offset_s,
            moment.position_m + offset_s[:, None] * moment.velocity_mps,
            multiply(moment.wxyz, turns),
        )

    def at(self, offset_s: float) -> Moment:
        """Pose and motion so long after the stamp.

        Raises:
            ValueError: Nothing is known of that time.
        """
        position, wxyz = self.pose(offset_s)
        first, last = float(self.offset_s[0]), float(self.offset_s[-1])
        before, after = max(offset_s - _APART_S, first), min(offset_s + _APART_S, last)
        if before == after:
            return Moment(position, wxyz, np.zeros(3), np.zeros(3))
        (start_m, start), (end_m, end) = self.pose(before), self.pose(after)
        turn = to_rotation_vector(multiply(inverse(start), end))
        return Moment(position, wxyz, (end_m - start_m) / (after - before), turn / (after - before))

    def pose(self, offset_s: float) -> tuple[FloatArray, FloatArray]:
        """Position and attitude so long after the stamp.

        Raises:
            ValueError: Nothing is known of that time.
        """
        first, last = float(self.offset_s[0]), float(self.offset_s[-1])
        if not first <= offset_s <= last:
            raise ValueError(f"got {offset_s:g} s, expected {first:g} to {last:g}")
        if len(self.offset_s) == 1:
            return self.position_m[0], self.wxyz[0]
        after = int(np.clip(np.searchsorted(self.offset_s, offset_s), 1, len(self.offset_s) - 1))
        low, high = self.offset_s[after - 1 : after + 1].tolist()
        weight = (offset_s - low) / (high - low)
        position = (1 - weight) * self.position_m[after - 1] + weight * self.position_m[after]
        return position, slerp(self.wxyz[after - 1], self.wxyz[after], weight)
