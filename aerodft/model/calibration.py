"""Results of a calibration: biases of the telemetry; and the estimates of live ones.

A live calibration estimates biases from an image's landmarks, or a fixed camera's rotation from fixed points.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from aerodft.model.arrays import FloatArray
from aerodft.model.pose import HeightSource, PoseStd

BIASES: Final = ("height", "tilt", "roll", "heading", "pan", "east", "north", "time")
"""Biases of the telemetry in the order of covariances: in metres and radians, the last one in seconds."""
FIXED_POINTS: Final = "steady"
"""Name of observations whose pixels are pairs: a fixed point in the reference image, and where it is now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasValues:
    """One number for each bias of the telemetry: an estimate (added to the telemetry), or a standard deviation.

    Attributes:
        height_m: Of the height source in use.
        east_m: Of the position, to the east.
        north_m: Of the position, to the north.
        tilt_rad: About the camera's x axis; raises the tilt.
        pan_rad: About its y axis.
        roll_rad: About its z axis.
        heading_rad: About the vertical, clockwise seen from above.
        time_s: Of images' stamps: the image's pose is that of the telemetry this much after its stamp.
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
    """Biases, covariances and noise found by a calibration, as ``measure``, ``serve`` and ``recompute`` take them.

    Attributes:
        id: ``sha256:...`` of the file it came from.
        bias: Added to the telemetry, and to the images' stamps.
        bias_cov: ``(8, 8)`` covariance of the biases in the order of ``BIASES``; None where unknown.
        lens_cov: ``(8, m)`` covariance of the biases with the intrinsics, where one calibration found both; else no
            columns.
        noise: Standard deviations of errors that are independent from image to image.
    """

    id: str
    bias: BiasValues = field(default_factory=BiasValues)
    bias_cov: FloatArray | None = None
    lens_cov: FloatArray | None = None
    noise: PoseStd = field(default_factory=PoseStd)


@dataclass(frozen=True, slots=True, kw_only=True)
class Innovation:
    """An observed landmark minus its prediction.

    Attributes:
        name: The landmark.
        px: Observed minus predicted ``(u, v)``; None without a prediction.
        sigma_px: Standard deviation of each component, from all uncertainties.
        chi2: Squared Mahalanobis distance, of two degrees of freedom.
        reason: Why it was rejected, one sentence; None where it was used.
    """

    name: str
    px: tuple[float, float] | None = None
    sigma_px: tuple[float, float] | None = None
    chi2: float | None = None
    reason: str | None = None

    @property
    def accepted(self) -> bool:
        """Whether the estimate was updated with it."""
        return self.reason is None


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationEstimate:
    """The biases of the telemetry after the landmarks of one image.

    Attributes:
        stamp_ns: The image's stamp, UTC.
        calibration: Calibration id of the next images' measurements.
        height_source: Whose height ``bias.height_m`` is added to; None where there was no pose.
        bias: The estimate.
        std: Its standard deviations.
        innovations: Of the landmarks of this image, the smallest chi2 first.
        updates: Landmarks used since the start.
        refused: Landmarks rejected since the start.
        restarts: How often the filter was reset because nearly everything was rejected.
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


class MotionState(StrEnum):
    """Whether a fixed camera has moved, by its last looks."""

    UNCHECKED = "unchecked"  # no fixed points recognised yet, or not for some looks: night, fog, a covered lens
    STEADY = "steady"  # rotated by less than the limit
    MOVED = "CAMERA_MOVED"  # rotated by more than the limit, by a known angle
    MOVING = "moving"  # rotated by more than the limit in the last look; not known yet whether it has come to rest
    UNKNOWN_VIEW = "unknown_view"  # no rotation of the camera explains the fixed points


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMotionEstimate:
    """A fixed camera's rotation after one look at its fixed points.

    Attributes:
        stamp_ns: The image's stamp, UTC.
        state: By this look and those before it.
        turn_rad: Rotation vector ``reference_SO3_now`` about the camera's axes x, y, z, with which poses are corrected.
        std_rad: Standard deviations of its components, with the scatter between images.
        look_turn_rad: Rotation vector of this look alone; None where the look gave none.
        since_ns: The first look in this state.
        moved_ns: The first look at which the camera was in its present attitude; None within the limit.
        points: Points found again.
        agreeing: Inliers of this look's rotation.
        std_px: Of one coordinate of an inlier; None where the look gave no rotation.
        calibration: Calibration id of the next images' measurements.
    """

    stamp_ns: int
    state: MotionState
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    look_turn_rad: tuple[float, float, float] | None = None
    since_ns: int
    moved_ns: int | None = None
    points: int = 0
    agreeing: int = 0
    std_px: float | None = None
    calibration: str | None = None
