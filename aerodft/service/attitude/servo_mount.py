"""Camera attitude from servo angles that a report packs as if they were Euler angles."""

import math
from typing import Final

import numpy as np

from aerodft.geometry import from_yaw_pitch_roll, matrix, multiply, yaw_pitch_roll
from aerodft.model import BoolArray, FloatArray, MountAxes

_NADIR_MARGIN_RAD: Final = math.radians(0.1)  # closer to nadir rounding hides which part is yaw and which roll
_LEVELLING_STEPS: Final = 20  # each leaves the tangent of the vehicle's tilt of the remaining error


def mounted_wxyz(
    wxyz: FloatArray, axes: MountAxes, ned_wxyz_body: FloatArray, *, yaw_in_earth: BoolArray | bool
) -> FloatArray:
    """Camera rotation from servo angles that a report packs as aerospace Euler angles (yaw, pitch, roll).

    At nadir the packed angles cannot tell yaw from roll: there the roll servo is assumed to level the camera.

    Args:
        wxyz: ``(n, 4)`` as reported.
        axes: Order of the servo axes.
        ned_wxyz_body: ``(n, 4)`` the vehicle's attitudes.
        yaw_in_earth: ``(n,)`` or one for all: whether yaw is relative to north, else to the vehicle's heading.

    Returns:
        ``(n, 4)`` rotations relative to the report's reference.
    """
    if axes is MountAxes.TILT_OUTER:
        return wxyz
    yaw, pitch, roll = yaw_pitch_roll(wxyz)
    near_nadir = np.flatnonzero(np.abs(pitch) > math.pi / 2 - _NADIR_MARGIN_RAD)
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
    carrier = multiply(from_yaw_pitch_roll(yaw, 0.0, 0.0), from_yaw_pitch_roll(0.0, 0.0, roll))
    return multiply(carrier, from_yaw_pitch_roll(0.0, pitch, 0.0))
