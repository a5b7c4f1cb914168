"""The registry of gimbal mounts: ``GIMBAL_MOUNTS``.

Reports relative to the vehicle are servo angles, whose attitude depends on which servo carries the other. A mount is an
entry: how its angles compose, and how likely it is before anything is known. One with a prior is told from the data.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.geometry import about_axis, matrix, multiply, yaw_pitch_roll
from aerodft.model import BoolArray, FloatArray, MountAxes

_NADIR_MARGIN_RAD: Final = math.radians(0.1)  # closer to nadir rounding hides which part is yaw and which roll
_LEVELLING_STEPS: Final = 20  # each leaves the tangent of the vehicle's tilt of the remaining error


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """Order of a mount's servo axes behind yaw; the base class is for angles that are aerospace Euler angles.

    Attributes:
        axes: Name in station files.
        prior: Weight among all mounts if reports are relative to the vehicle and nothing says which it has; 0 for one
            that no report shows, which the station file or the gimbal's capabilities state.
        is_euler: Whether a report's rotation is the camera's as it stands, whatever the vehicle's attitude.
    """

    axes: MountAxes
    prior: float = 0.0
    is_euler: bool = False

    def camera_wxyz(self, wxyz: FloatArray, ned_wxyz_body: FloatArray, *, yaw_in_earth: BoolArray | bool) -> FloatArray:
        """Camera rotation from servo angles that a report packs as aerospace Euler angles (yaw, pitch, roll).

        Args:
            wxyz: ``(n, 4)`` as reported.
            ned_wxyz_body: ``(n, 4)`` the vehicle's attitudes.
            yaw_in_earth: ``(n,)`` or one for all: whether yaw is relative to north, else to the vehicle's heading.

        Returns:
            ``(n, 4)`` rotations relative to the report's reference.
        """
        if self.is_euler:
            return wxyz
        return self.compose(*_servo_angles(wxyz, ned_wxyz_body, yaw_in_earth=yaw_in_earth))

    def compose(self, yaw_rad: FloatArray, pitch_rad: FloatArray, roll_rad: FloatArray) -> FloatArray:
        """Camera rotations ``(n, 4)`` by servo angles ``(n,)``."""
        raise NotImplementedError


class _RollOuter(Mount):
    def compose(self, yaw_rad: FloatArray, pitch_rad: FloatArray, roll_rad: FloatArray) -> FloatArray:
        return multiply(multiply(about_axis(2, yaw_rad), about_axis(0, roll_rad)), about_axis(1, pitch_rad))


class _TiltOnly(Mount):
    def compose(self, yaw_rad: FloatArray, pitch_rad: FloatArray, roll_rad: FloatArray) -> FloatArray:  # noqa: ARG002
        return multiply(about_axis(2, yaw_rad), about_axis(1, pitch_rad))


GIMBAL_MOUNTS: Final[dict[MountAxes, Mount]] = {
    mount.axes: mount
    for mount in (
        _RollOuter(axes=MountAxes.ROLL_OUTER, prior=0.75),
        Mount(axes=MountAxes.TILT_OUTER, prior=0.25, is_euler=True),
        _TiltOnly(axes=MountAxes.TILT_ONLY),
    )
}
"""All mounts by name."""


def _servo_angles(
    wxyz: FloatArray, ned_wxyz_body: FloatArray, *, yaw_in_earth: BoolArray | bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Yaw, pitch and roll ``(n,)`` of servos, from reports that pack them as aerospace Euler angles.

    At nadir the packed angles cannot tell yaw from roll: there the roll servo is assumed to level the camera.
    """
    yaw, pitch, roll = yaw_pitch_roll(wxyz)
    near_nadir = np.flatnonzero(np.abs(pitch) > math.pi / 2 - _NADIR_MARGIN_RAD)
    is_beyond = np.abs(roll) > math.pi / 2  # as a tilt servo turns where the nose is up and the camera straight down
    yaw, pitch, roll = np.where(is_beyond, (yaw + math.pi, math.pi - pitch, roll - math.pi), (yaw, pitch, roll))
    if len(near_nadir):
        packed, sign = matrix(wxyz[near_nadir]), -np.sign(pitch[near_nadir])
        yaw_and_roll = np.arctan2(-packed[:, 0, 1], packed[:, 1, 1])  # yaw plus signed roll
        down = matrix(ned_wxyz_body[near_nadir])[:, 2]
        yaw_is_north = np.broadcast_to(yaw_in_earth, len(wxyz))[near_nadir]
        heading = np.where(yaw_is_north, yaw_pitch_roll(ned_wxyz_body[near_nadir])[0], 0.0)
        roll_servo = np.zeros(len(near_nadir))
        for _ in range(_LEVELLING_STEPS):
            pan = yaw_and_roll - sign * roll_servo - heading
            sideways = np.cos(pan) * down[:, 1] - np.sin(pan) * down[:, 0]
            roll_servo = np.arctan2(-sideways, down[:, 2])
        yaw[near_nadir], roll[near_nadir] = yaw_and_roll - sign * roll_servo, roll_servo
    return yaw, pitch, roll
