"""What is known of a fixed camera that may be bumped: whether it still looks where it looked."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

STEADY: Final = "steady"
"""Observations of that name hold pairs of pixels: a point where the reference image has it, and where it is now."""


class Steadiness(StrEnum):
    """What the last looks come to."""

    UNCHECKED = "unchecked"  # nothing was recognised yet, or not for some looks: night, fog, a covered lens
    STEADY = "steady"  # within the limit of where it looked
    MOVED = "CAMERA_MOVED"  # beyond it, and by how much is known
    MOVING = "moving"  # beyond it a moment ago; whether and where it came to rest is not known yet
    UNKNOWN_VIEW = "unknown_view"  # what stands still does not stand where a camera that only turned would see it


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadinessEstimate:
    """A fixed camera's attitude after one look at its steady points.

    Attributes:
        stamp_ns: The stamp of the image that was looked at, UTC.
        state: What this look and those before it come to.
        turn_rad: Rotation vector of the camera about its axes x, y, z, from where it looked to where it looks:
            ``reference_SO3_now``, what poses are corrected with.
        std_rad: Standard deviations of the three, with how far single images scatter.
        look_turn_rad: Of this look alone; None where it did not tell.
        since_ns: The first look in this state.
        moved_ns: The first look that saw the camera where it rests by now; None where that is within the limit.
        points: Points found again.
        agreeing: Those that this look's turn explains.
        std_px: Of one coordinate of these; None where the look did not tell.
        calibration: What the next images' measurements name as their calibration.
    """

    stamp_ns: int
    state: Steadiness
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    look_turn_rad: tuple[float, float, float] | None = None
    since_ns: int
    moved_ns: int | None = None
    points: int = 0
    agreeing: int = 0
    std_px: float | None = None
    calibration: str | None = None
