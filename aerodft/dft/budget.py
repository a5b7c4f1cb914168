"""Where a measurement's uncertainty comes from, and what to do about it: first order, input by input."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.object_top import ObjectTop
from aerodft.dft.projection import DISTORTION, ELEVATION, FOCAL, PRINCIPAL_POINT, ROTATION
from aerodft.dft.seen import Seen, dependence
from aerodft.dft.values import scalar_with_gradient
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import PoseStd

_ROUNDING = 1e-12
_ADVICE = {
    "height": "measure the height better: a rangefinder, or a surveyed point",
    "position": "a better position fix",
    "tilt": "add a landmark, look more steeply down, or fly higher",
    "pan": "add a landmark",
    "roll": "add a landmark",
    "heading": "a better compass, or a landmark",
    "attitude": "add a landmark",
    "focal": "calibrate the lens",
    "principal point": "calibrate the lens",
    "distortion": "calibrate the lens",
    "correlations": "a landmark tells apart what varies together",
    "elevation": "survey the elevation of the measured plane",
    "time": "align the clocks of images and telemetry, or hold still",
    "pixels": "pick the pixels more precisely, come closer, or use more resolution",
}
_UNSETTLED_RAD: Final = math.radians(2)  # no gimbal that holds still is known worse
_ANGLES: Final = ("tilt", "pan", "roll", "attitude")
_UNSETTLED: Final = "know the attitude better: wait until the gimbal has settled, or add a landmark"


@dataclass(frozen=True, slots=True)
class Share:
    """One input's part of a measurement's variance.

    Attributes:
        source: The input.
        std: What the measurement's standard deviation would be if this input alone were uncertain; negative where
            correlations make the measurement more certain.
        share: Of the variance. What inputs that vary together add, or take away, stands under ``correlations``.
        remedy: What to do about it.
    """

    source: str
    std: float
    share: float
    remedy: str


def variance_budget(seen: Seen, std: PoseStd, top: ObjectTop | None = None) -> tuple[Share, ...]:
    """The parts of a probe's variance, the largest first; empty for a position, which has no one scalar.

    Args:
        seen: The probe as it is seen.
        std: How the pose's covariance was stated; where it does not reproduce it (a calibration's full covariance),
            tilt, pan, roll and heading are given as one ``attitude``.
        top: What the probe lies on top of; None where it lies on the ground.
    """
    if not seen.has_scalar:
        return ()
    _, by = scalar_with_gradient(seen)
    shared, own = dependence(seen, by)
    by_pixels = seen.std_px**2 * float(np.sum(own * own))
    if top is not None:
        by_pixels += (float(shared[ELEVATION]) * top.own_std_m) ** 2
        shared = top.by_errors(shared)
    pose_cov, cov = seen.pose.cov, seen.shared_cov
    motion = np.concatenate([seen.pose.velocity_enu_mps, seen.pose.rate_cam_radps])
    variances = {
        "height": shared[2] ** 2 * pose_cov[2, 2],
        "position": shared[:2] @ pose_cov[:2, :2] @ shared[:2],
        **_attitude(shared[ROTATION], seen, std),
        "time": float(shared[:6] @ motion) ** 2 * seen.pose.time_std_s**2,
        "focal": shared[FOCAL] @ cov[FOCAL, FOCAL] @ shared[FOCAL],
        "principal point": shared[PRINCIPAL_POINT] @ cov[PRINCIPAL_POINT, PRINCIPAL_POINT] @ shared[PRINCIPAL_POINT],
        "distortion": shared[DISTORTION] @ cov[DISTORTION, DISTORTION] @ shared[DISTORTION],
        "elevation": shared[ELEVATION] ** 2 * cov[ELEVATION, ELEVATION],
        "pixels": by_pixels,
    }
    total = float(shared @ cov @ shared) + float(variances["pixels"])
    if not total > 0:
        return ()
    variances["correlations"] = total - sum(map(float, variances.values()))
    parts = [
        Share(source, math.copysign(math.sqrt(abs(variance)), variance), float(variance) / total, _remedy(source, seen))
        for source, variance in variances.items()
        if abs(variance) > _ROUNDING * total
    ]
    return tuple(sorted(parts, key=lambda part: -part.share))


def advice(budget: tuple[Share, ...]) -> str:
    """One sentence on what to improve first; empty where nothing is uncertain."""
    if not budget:
        return ""
    first = budget[0]
    return f"{100 * first.share:.0f} % from {first.source}: {first.remedy}"


def _remedy(source: str, seen: Seen) -> str:
    stds_rad = np.sqrt(seen.pose.cov.diagonal()[ROTATION])
    if source in _ANGLES and stds_rad.max() > _UNSETTLED_RAD:
        return _UNSETTLED
    return _ADVICE[source]


def _attitude(by_rotation: FloatArray, seen: Seen, std: PoseStd) -> dict[str, float]:
    up_cam = matrix(seen.pose.wxyz)[2, :]
    stated = np.diag([std.tilt_rad**2, std.pan_rad**2, std.roll_rad**2]) + std.heading_rad**2 * np.outer(up_cam, up_cam)
    actual = seen.pose.cov[ROTATION, ROTATION]
    if not np.allclose(stated, actual, rtol=1e-6, atol=1e-15):
        return {"attitude": float(by_rotation @ actual @ by_rotation)}
    return {
        "tilt": float(by_rotation[0] * std.tilt_rad) ** 2,
        "pan": float(by_rotation[1] * std.pan_rad) ** 2,
        "roll": float(by_rotation[2] * std.roll_rad) ** 2,
        "heading": float(by_rotation @ up_cam * std.heading_rad) ** 2,
    }
