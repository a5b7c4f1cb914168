"""What a calibration found: small corrections to the telemetry, or a fixed camera's whole pose."""

from dataclasses import dataclass, field
from typing import Final

from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose, PoseStd

BIASES: Final = ("height", "tilt", "roll", "heading", "pan", "east", "north", "time")
"""What telemetry may be off by, in the order of covariances: metres, radians, and seconds for the last."""


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
        pan_bias_rad: Rotation about the camera's y axis.
        east_bias_m: Added to the telemetry's position.
        north_bias_m: Likewise.
        time_offset_s: Added to the images' stamps: the camera is where the telemetry says that it will be so much
            later.
        bias_cov: ``(8, 8)`` covariance of the biases, as ``BIASES``; None where nothing is said of it.
        lens_cov: ``(8, m)`` covariance of the biases with the intrinsics, where one calibration found both; else no
            columns.
        noise: What is new in every image besides: standard deviations.
    """

    id: str
    pose: Pose | None = None
    height_bias_m: float = 0.0
    tilt_bias_rad: float = 0.0
    roll_bias_rad: float = 0.0
    heading_bias_rad: float = 0.0
    pan_bias_rad: float = 0.0
    east_bias_m: float = 0.0
    north_bias_m: float = 0.0
    time_offset_s: float = 0.0
    bias_cov: FloatArray | None = None
    lens_cov: FloatArray | None = None
    noise: PoseStd = field(default_factory=PoseStd)
