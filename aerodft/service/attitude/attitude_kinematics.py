"""A report that is against something which turns itself: composed as rotations, never by adding angles."""

from dataclasses import dataclass

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import (
    Brackets,
    from_yaw_pitch_roll,
    inverse,
    matrix,
    multiply,
    rotate,
    slerp,
    to_rotation_vector,
    yaw_pitch_roll,
)
from aerodft.model import FloatArray, IntArray, ReportFrame


@dataclass(frozen=True, slots=True)
class RotatingFrame:
    """Attitudes that change.

    Attributes:
        wxyz: ``(n, 4)`` ``ref_SO3_moving``.
        rate_radps: ``(n, 3)`` angular rates in the moving axes.
    """

    wxyz: FloatArray
    rate_radps: FloatArray

    def compose(self, other: "RotatingFrame") -> "RotatingFrame":
        """``other``, which is against this one's moving axes, against this one's reference."""
        rate = other.rate_radps + rotate(matrix(inverse(other.wxyz)), self.rate_radps)
        return RotatingFrame(multiply(self.wxyz, other.wxyz), rate)


@dataclass(frozen=True, slots=True)
class AttitudeBrackets:
    """Two samples around each of ``n`` stamps.

    Attributes:
        before: ``(n, 4)`` attitudes.
        after: ``(n, 4)``; the same where a sample is at the stamp itself.
        weight: ``(n,)`` of the later one.
        gap_ns: ``(n,)`` between the two.
    """

    before: FloatArray
    after: FloatArray
    weight: FloatArray
    gap_ns: IntArray

    @classmethod
    def of(cls, wxyz: FloatArray, found: Brackets) -> "AttitudeBrackets":
        """The samples around stamps, of a stream's ``wxyz (m, 4)`` and the brackets found in it."""
        return cls(*found.ends(wxyz), found.weight, found.gap_ns)

    def between(self) -> RotatingFrame:
        """The attitudes at the stamps."""
        return RotatingFrame(slerp(self.before, self.after, self.weight), _rate(self.before, self.after, self.gap_ns))


def reference_attitude(vehicle: AttitudeBrackets, frame: ReportFrame, *, yaw_in_earth: bool) -> RotatingFrame:
    """What gimbals' reports are against, in NED.

    Args:
        vehicle: The vehicle's attitudes ``ned_SO3_body``.
        frame: What the reports' roll and pitch are against.
        yaw_in_earth: Whether their yaw is against north, else against the vehicle's heading.

    Returns:
        The vehicle's heading, its attitude, or its attitude without the heading; with a rate from the two samples.
    """
    at_stamp = slerp(vehicle.before, vehicle.after, vehicle.weight)
    ends = np.stack([vehicle.before, at_stamp, vehicle.after])
    before, at, after = reference_wxyz(ends, frame, yaw_in_earth=yaw_in_earth)
    return RotatingFrame(at, _rate(before, after, vehicle.gap_ns))


def reference_wxyz(ned_wxyz_body: FloatArray, frame: ReportFrame, *, yaw_in_earth: bool) -> FloatArray:
    """What a report is against ``(..., 4)`` as in ``reference_attitude``, of attitudes ``(..., 4)``."""
    heading = heading_of(ned_wxyz_body)
    if frame is ReportFrame.EARTH:
        return multiply(heading, inverse(heading)) if yaw_in_earth else heading
    return multiply(ned_wxyz_body, inverse(heading)) if yaw_in_earth else ned_wxyz_body


def heading_of(ned_wxyz_body: FloatArray) -> FloatArray:
    """The vehicle's heading alone, as a rotation about the vertical; ``(..., 4)`` of ``(..., 4)``."""
    return from_yaw_pitch_roll(yaw_pitch_roll(ned_wxyz_body)[0], 0.0, 0.0)


def _rate(before_wxyz: FloatArray, after_wxyz: FloatArray, gap_ns: IntArray) -> FloatArray:
    """Angular rates ``(n, 3)`` (rad/s) in the moving frame's own axes between two samples."""
    per_s = np.where(gap_ns > 0, SECOND_NS / np.maximum(gap_ns, 1), 0.0)
    return np.asarray(to_rotation_vector(multiply(inverse(before_wxyz), after_wxyz)) * per_s[:, None])
