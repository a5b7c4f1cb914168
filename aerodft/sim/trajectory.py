"""The true motion of the vehicle and its camera, by samples or from waypoints.

Waypoints become a smooth motion, from which the vehicle's attitude follows.
"""

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from aerodft.geometry import (
    camera_from_gimbal,
    from_rotation_vector,
    from_yaw_pitch_roll,
    inverse,
    multiply,
    slerp,
    to_rotation_vector,
    yaw_pitch_roll,
)
from aerodft.model import FloatArray, GeoOrigin, IntArray, Pose
from aerodft.sim.world import River


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """Samples of the true motion; linear positions and slerped attitudes between them.

    Attributes:
        origin: ENU origin, on the measured plane.
        stamp_ns: ``(n,)`` ascending, host UTC.
        position_enu_m: ``(n, 3)``; up is the height above the plane, which is also the home-relative height.
        ned_wxyz_body: ``(n, 4)`` the vehicle's attitude.
        level_wxyz_gimbal: ``(n, 4)`` the gimbal relative to the horizon and the vehicle's heading (``ref_SO3_gimbal``).
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
        """The trajectory delayed by ``by_ns``."""
        return replace(self, stamp_ns=self.stamp_ns + by_ns)

    def cut(self, start_ns: int, end_ns: int) -> "Trajectory":
        """The samples in ``[start_ns, end_ns)``."""
        keep = (self.stamp_ns >= start_ns) & (self.stamp_ns < end_ns)
        return replace(
            self, **{each.name: getattr(self, each.name)[keep] for each in fields(self) if each.name != "origin"}
        )

    def at(self, stamps_ns: npt.ArrayLike) -> "Trajectory":
        """The motion at ``stamps_ns (m,)``; outside the flight that of its nearer end."""
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
        """The camera's true pose."""
        interpolated_sample = self.at([stamp_ns])
        return Pose(position_enu_m=interpolated_sample.position_enu_m[0], wxyz=interpolated_sample.enu_wxyz_cam[0])

    def velocity_enu_mps(self) -> FloatArray:
        """Velocities ``(n, 3)`` by central differences."""
        seconds = (self.stamp_ns - self.stamp_ns[0]) / 1e9
        return np.asarray(np.gradient(self.position_enu_m, seconds, axis=0))

    def body_rate_radps(self) -> FloatArray:
        """Angular rates ``(n, 3)`` in body axes by forward differences."""
        seconds = np.diff(self.stamp_ns) / 1e9
        step = to_rotation_vector(multiply(inverse(self.ned_wxyz_body[:-1]), self.ned_wxyz_body[1:]))
        rate = step / seconds[:, None]
        return np.concatenate([rate, rate[-1:]])


def heading_wxyz(ned_wxyz_body: FloatArray) -> FloatArray:
    """Headings ``(..., 4)`` of vehicle attitudes, as rotations about down."""
    yaw, _, _ = yaw_pitch_roll(ned_wxyz_body)
    return from_rotation_vector(yaw[..., None] * np.array([0.0, 0.0, 1.0]))


def camera_attitude_from_gimbal(ned_wxyz_body: FloatArray, level_wxyz_gimbal: FloatArray) -> FloatArray:
    """``enu_SO3_cam (..., 4)`` from a gimbal whose yaw is relative to the vehicle's heading."""
    return camera_from_gimbal(multiply(heading_wxyz(ned_wxyz_body), level_wxyz_gimbal))


GRAVITY_MPS2 = 9.80665
SAMPLE_S = 0.01
ROUNDING_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Waypoint:
    """Position, heading and gimbal angles at ``time_s``.

    ``gimbal_pitch_rad`` is relative to the horizon (negative downwards), ``gimbal_yaw_rad`` to the vehicle's heading;
    headings may exceed a full turn, they are interpolated as numbers.
    """

    time_s: float
    east_m: float
    north_m: float
    height_m: float
    heading_rad: float
    gimbal_pitch_rad: float
    gimbal_yaw_rad: float = 0.0
    gimbal_roll_rad: float = 0.0


def fly(waypoints: tuple[Waypoint, ...], *, origin: GeoOrigin, start_ns: int = 0) -> Trajectory:
    """Trajectory through ``waypoints``, corners of the motion smoothed over ``ROUNDING_S``.

    Horizontally the path is a spline, all else is monotone interpolation; equal waypoints at the start are a wait. The
    vehicle tilts by its acceleration as a multicopter; the gimbal keeps its angles relative to the horizon.

    Raises:
        ValueError: Fewer than two waypoints, or times that do not increase.
    """
    knots = np.array([w.time_s for w in waypoints])
    if len(waypoints) < 2 or np.any(np.diff(knots) <= 0):  # noqa: PLR2004 (a path has two ends)
        raise ValueError("a plan needs two or more waypoints with increasing times")
    times = knots[0] + SAMPLE_S * np.arange(round((knots[-1] - knots[0]) / SAMPLE_S) + 1)
    path = np.array([(w.east_m, w.north_m) for w in waypoints])
    wait = int(np.argmax(np.any(path[1:] != path[:-1], axis=1)))
    spline = CubicSpline(knots[wait:], path[wait:], bc_type="clamped")
    others = PchipInterpolator(
        knots,
        [(w.height_m, w.heading_rad, w.gimbal_pitch_rad, w.gimbal_yaw_rad, w.gimbal_roll_rad) for w in waypoints],
    )(times)
    horizontal = _smooth(spline(np.maximum(times, knots[wait])))
    height, heading, pitch, yaw, roll = _smooth(others).T
    body = _attitude(np.gradient(np.gradient(horizontal, SAMPLE_S, axis=0), SAMPLE_S, axis=0), heading)
    gimbal = from_yaw_pitch_roll(yaw, pitch, roll)
    return Trajectory(
        origin=origin,
        stamp_ns=start_ns + np.round((times - knots[0]) * 1e9).astype(np.int64),
        position_enu_m=np.column_stack([horizontal, height]),
        ned_wxyz_body=body,
        level_wxyz_gimbal=gimbal,
        enu_wxyz_cam=camera_attitude_from_gimbal(body, gimbal),
    )


def _smooth(values: FloatArray) -> FloatArray:
    """Values ``(n, k)`` smoothed along time."""
    return np.asarray(gaussian_filter1d(values, ROUNDING_S / SAMPLE_S, axis=0, mode="nearest"))


def _attitude(acceleration_en_mps2: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """``ned_SO3_body`` of a multicopter from horizontal acceleration ``(n, 2)`` and heading ``(n,)``."""
    east, north = acceleration_en_mps2.T
    forward = north * np.cos(heading_rad) + east * np.sin(heading_rad)
    right = east * np.cos(heading_rad) - north * np.sin(heading_rad)
    pitch = -np.arctan2(forward, GRAVITY_MPS2)
    roll = np.arctan2(right * np.cos(pitch), GRAVITY_MPS2)
    return from_yaw_pitch_roll(heading_rad, pitch, roll)


# time (fraction), along (m) and across (fraction from home to the centreline) the river, height (fraction), heading
# relative to the river's direction, gimbal pitch, yaw and roll (deg)
_SURVEY = (
    (0.00, 0.0, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.10, 0.0, 0.00, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.20, 0.0, 0.20, 0.6, 0.0, -60.0, 0.0, 0.0),
    (0.30, 1.0, 0.75, 1.0, 0.0, -60.0, 0.0, 0.0),
    (0.40, 8.0, 1.00, 1.0, 0.0, -60.0, 0.0, 0.0),
    (0.50, 18.0, 1.00, 1.0, 0.0, -60.0, 8.0, 0.0),
    (0.60, 28.0, 0.95, 0.95, 25.0, -45.0, -10.0, 2.0),
    (0.70, 34.0, 0.80, 0.9, 100.0, -75.0, 0.0, 0.0),
    (0.80, 30.0, 0.85, 0.9, 165.0, -90.0, 0.0, 0.0),
    (0.90, 21.0, 0.95, 0.9, 180.0, -90.0, 0.0, 0.0),
    (1.00, 16.0, 1.00, 0.9, 180.0, -50.0, 0.0, 0.0),
)


def survey(
    river: River, *, origin: GeoOrigin, duration_s: float = 20.0, height_m: float = 40.0, start_ns: int = 0
) -> Trajectory:
    """A survey flight: take off beside the river, fly down it at gimbal pitch -60, turn, come back over it at -90.

    The gimbal pans and rolls a little. The flight takes ``duration_s``, the first tenth on the ground; in less than
    15 s it is harder than a real vehicle could fly.
    """
    home_along, home_across = river.along_across(np.zeros(2))
    axis = river.azimuth_rad
    waypoints = []
    for fraction, along, across, height, heading, pitch, yaw, roll in _SURVEY:
        target = float(river.centre_m(home_along + along))
        east, north, _ = river.enu(home_along + along, home_across + across * (target - home_across))
        waypoints.append(
            Waypoint(
                time_s=fraction * duration_s,
                east_m=float(east),
                north_m=float(north),
                height_m=height * height_m,
                heading_rad=axis + math.radians(heading),
                gimbal_pitch_rad=math.radians(pitch),
                gimbal_yaw_rad=math.radians(yaw),
                gimbal_roll_rad=math.radians(roll),
            )
        )
    return fly(tuple(waypoints), origin=origin, start_ns=start_ns)
