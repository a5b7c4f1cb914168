"""A report that is against something which turns itself: composed as rotations, never by adding angles."""

from dataclasses import dataclass

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry.interpolation import Bracket
from aerodft.geometry.rotation import (
    from_yaw_pitch_roll,
    inverse,
    matrix,
    multiply,
    to_rotation_vector,
    yaw_pitch_roll,
)
from aerodft.model.arrays import FloatArray
from aerodft.model.telemetry import ReportFrame


@dataclass(frozen=True, slots=True)
class Turning:
    """An attitude that changes.

    Attributes:
        wxyz: ``(4,)`` ``ref_SO3_moving``.
        rate_radps: ``(3,)`` angular rate in the moving axes.
    """

    wxyz: FloatArray
    rate_radps: FloatArray

    def carrying(self, other: "Turning") -> "Turning":
        """``other``, which is against this one's moving axes, against this one's reference."""
        rate = other.rate_radps + matrix(inverse(other.wxyz)) @ self.rate_radps
        return Turning(multiply(self.wxyz, other.wxyz), rate)


def between(wxyz: FloatArray, found: Bracket) -> Turning:
    """The attitude at a stamp between two samples of ``wxyz (n, 4)``."""
    return Turning(found.spherical(wxyz), _rate(wxyz[found.before], wxyz[found.after], found.gap_ns))


def carrier(ned_wxyz_body: FloatArray, found: Bracket, frame: ReportFrame, *, yaw_in_earth: bool) -> Turning:
    """What a gimbal's report is against, in NED.

    Args:
        ned_wxyz_body: ``(n, 4)`` the vehicle's attitudes.
        found: The samples around the stamp.
        frame: What the report's roll and pitch are against.
        yaw_in_earth: Whether its yaw is against north, else against the vehicle's heading.

    Returns:
        The vehicle's heading, its attitude, or its attitude without the heading; with a rate from the two samples.
    """
    now = between(ned_wxyz_body, found)
    ends = ned_wxyz_body[[found.before, found.after]]
    before, at, after = reference_of(np.stack([ends[0], now.wxyz, ends[1]]), frame, yaw_in_earth=yaw_in_earth)
    return Turning(at, _rate(before, after, found.gap_ns))


def reference_of(ned_wxyz_body: FloatArray, frame: ReportFrame, *, yaw_in_earth: bool) -> FloatArray:
    """What a report is against ``(..., 4)`` as in ``carrier``, of attitudes ``(..., 4)``."""
    heading = heading_of(ned_wxyz_body)
    if frame is ReportFrame.EARTH:
        return multiply(heading, inverse(heading)) if yaw_in_earth else heading
    return multiply(ned_wxyz_body, inverse(heading)) if yaw_in_earth else ned_wxyz_body


def heading_of(ned_wxyz_body: FloatArray) -> FloatArray:
    """The vehicle's heading alone, as a rotation about the vertical; ``(..., 4)`` of ``(..., 4)``."""
    return from_yaw_pitch_roll(yaw_pitch_roll(ned_wxyz_body)[0], 0.0, 0.0)


def _rate(before_wxyz: FloatArray, after_wxyz: FloatArray, gap_ns: int) -> FloatArray:
    """Angular rate ``(3,)`` (rad/s) in the moving frame's own axes between two samples."""
    if gap_ns == 0:
        return np.zeros(3)
    return np.asarray(to_rotation_vector(multiply(inverse(before_wxyz), after_wxyz)) * (SECOND_NS / gap_ns))
