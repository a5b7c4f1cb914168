"""What a calibration found: small corrections to the telemetry, or a fixed camera's whole pose."""

from dataclasses import dataclass

from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """The result of a calibration, as ``measure``, ``serve`` and ``recompute`` take it.

    Attributes:
        id: ``sha256:...`` of the file it came from.
        pose: A fixed camera's pose; None where only biases are given.
        height_bias_m: Added to the telemetry's height.
        tilt_bias_rad: Rotation about the camera's x axis, applied to the telemetry's attitude; raises the tilt.
        roll_bias_rad: Rotation about the camera's z axis.
        heading_bias_rad: Rotation about the vertical, clockwise seen from above.
        bias_cov: ``(4, 4)`` covariance of the four biases, in the order above.
    """

    id: str
    pose: Pose | None = None
    height_bias_m: float = 0.0
    tilt_bias_rad: float = 0.0
    roll_bias_rad: float = 0.0
    heading_bias_rad: float = 0.0
    bias_cov: FloatArray | None = None
