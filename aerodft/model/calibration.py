"""What a calibration found: small corrections to the telemetry, or a fixed camera's whole pose; and what live ones say.

A live calibration says what it makes of the landmarks of an image, or of the steady points of a camera that may be
bumped: whether it still looks where it looked.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from aerodft.model.arrays import FloatArray
from aerodft.model.pose import HeightSource, PoseStd

BIASES: Final = ("height", "tilt", "roll", "heading", "pan", "east", "north", "time")
"""What telemetry may be off by, in the order of covariances: metres, radians, and seconds for the last."""
STEADY: Final = "steady"
"""Observations of that name hold pairs of pixels: a point where the reference image has it, and where it is now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasValues:
    """One number for each bias of the telemetry: an estimate (what is added to the telemetry), or a standard deviation.

    Attributes:
        height_m: Of the height source in use.
        east_m: Of the position, to the east.
        north_m: Of the position, to the north.
        tilt_rad: About the camera's x axis; raises the tilt.
        pan_rad: About its y axis.
        roll_rad: About its z axis.
        heading_rad: About the vertical, clockwise seen from above.
        time_s: Of images' stamps: the camera is where the telemetry says that it will be so much later.
    """

    height_m: float = 0.0
    east_m: float = 0.0
    north_m: float = 0.0
    tilt_rad: float = 0.0
    pan_rad: float = 0.0
    roll_rad: float = 0.0
    heading_rad: float = 0.0
    time_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """The result of a calibration, as ``measure``, ``serve`` and ``recompute`` take it.

    Attributes:
        id: ``sha256:...`` of the file it came from.
        bias: What is added to the telemetry, and to the images' stamps.
        bias_cov: ``(8, 8)`` covariance of the biases, as ``BIASES``; None where nothing is said of it.
        lens_cov: ``(8, m)`` covariance of the biases with the intrinsics, where one calibration found both; else no
            columns.
        noise: What is new in every image besides: standard deviations.
    """

    id: str
    bias: BiasValues = field(default_factory=BiasValues)
    bias_cov: FloatArray | None = None
    lens_cov: FloatArray | None = None
    noise: PoseStd = field(default_factory=PoseStd)


@dataclass(frozen=True, slots=True, kw_only=True)
class Innovation:
    """One observed landmark against where it was expected.

    Attributes:
        name: The landmark.
        px: Observed minus expected ``(u, v)``; None where nothing was expected.
        sigma_px: Standard deviation of each of the two, of everything that is not known.
        chi2: Their squared distance in standard deviations; of two degrees of freedom.
        reason: Why it was refused, one sentence; None where it was used.
    """

    name: str
    px: tuple[float, float] | None = None
    sigma_px: tuple[float, float] | None = None
    chi2: float | None = None
    reason: str | None = None

    @property
    def accepted(self) -> bool:
        """Whether the estimate follows it."""
        return self.reason is None


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationEstimate:
    """The biases after one image's landmarks.

    Attributes:
        stamp_ns: The stamp of the image that they were seen in, UTC.
        calibration: What the next images' measurements name as their calibration.
        height_source: Whose height ``bias.height_m`` is added to; None where there was no pose.
        bias: The estimate.
        std: Its standard deviations.
        innovations: Of the landmarks of this image, the most credible first.
        updates: Landmarks used since the start.
        refused: Landmarks refused since the start.
        restarts: How often nearly everything was refused and the estimate began anew.
    """

    stamp_ns: int
    calibration: str | None
    height_source: HeightSource | None = None
    bias: BiasValues = field(default_factory=BiasValues)
    std: BiasValues = field(default_factory=BiasValues)
    innovations: tuple[Innovation, ...] = ()
    updates: int = 0
    refused: int = 0
    restarts: int = 0


class Steadiness(StrEnum):
    """What the last looks come to."""

    UNCHECKED = "unchecked"  # nothing was recognised yet, or not for some looks: night, fog, a covered lens
    STEADY = "steady"  # within the limit of where it looked
    MOVED = "CAMERA_MOVED"  # beyond it, and by how much is known
    MOVING = "moving"  # beyond it a moment ago; whether and where it came to rest is not known yet
    UNKNOWN_VIEW = "unknown_view"  # what stands still does not stand where a camera that only turned would see it


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMotionEstimate:
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
