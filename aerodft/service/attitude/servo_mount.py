"""Where a camera is whose servo angles against the vehicle a report packs as if they were Euler angles."""

import math
from typing import Final

import numpy as np

from aerodft.geometry import from_yaw_pitch_roll, matrix, multiply, yaw_pitch_roll
from aerodft.model import BoolArray, FloatArray, MountAxes

_STRAIGHT_DOWN_RAD: Final = math.radians(0.1)  # nearer to it rounding hides what is yaw and what is roll
_LEVEL_STEPS: Final = 20  # each leaves the tangent of the vehicle's lean of what was missing


def mounted_wxyz(
    wxyz: FloatArray, axes: MountAxes, ned_wxyz_body: FloatArray, *, yaw_in_earth: BoolArray | bool
) -> FloatArray:
    """Where a camera is whose servo angles a report packs as aerospace Euler angles (yaw, pitch, roll).

    Straight down a turn of the yaw servo and one of the roll servo are packed as the same: there the roll servo is
    taken to level the camera, which is what it is for.

    Args:
        wxyz: ``(n, 4)`` as reported.
        axes: Which servo carries the other.
        ned_wxyz_body: ``(n, 4)`` the vehicle's attitudes.
        yaw_in_earth: ``(n,)``, or of all: whether the yaw is against north, else against the vehicle's heading.

    Returns:
        ``(n, 4)`` rotations against what the report is against.
    """
    if axes is MountAxes.TILT_OUTER:
        return wxyz
    yaw, pitch, roll = yaw_pitch_roll(wxyz)
    steep = np.flatnonzero(np.abs(pitch) > math.pi / 2 - _STRAIGHT_DOWN_RAD)
    if len(steep):
        packed, sign = matrix(wxyz[steep]), -np.sign(pitch[steep])
        both = np.arctan2(-packed[:, 0, 1], packed[:, 1, 1])  # the yaw, and the roll with that sign
        down = matrix(ned_wxyz_body[steep])[:, 2]
        is_north = np.broadcast_to(yaw_in_earth, len(wxyz))[steep]
        heading = np.where(is_north, yaw_pitch_roll(ned_wxyz_body[steep])[0], 0.0)
        level = np.zeros(len(steep))
        for _ in range(_LEVEL_STEPS):
            pan = both - sign * level - heading
            aside = np.cos(pan) * down[:, 1] - np.sin(pan) * down[:, 0]
            level = np.arctan2(-aside, down[:, 2])
        yaw[steep], roll[steep] = both - sign * level, level
    carrier = multiply(from_yaw_pitch_roll(yaw, 0.0, 0.0), from_yaw_pitch_roll(0.0, 0.0, roll))
    return multiply(carrier, from_yaw_pitch_roll(0.0, pitch, 0.0))
