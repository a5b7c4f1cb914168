"""Where a measurement's uncertainty comes from, and what to do about it: first order, input by input."""

import math
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from aerodft.dft.projection import DISTORTION, ELEVATION, FOCAL, PRINCIPAL_POINT, ROTATION
from aerodft.geometry import matrix
from aerodft.model import FloatArray, PoseBatch, PoseStd

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
_INTRINSICS: Final = {"focal": FOCAL, "principal point": PRINCIPAL_POINT, "distortion": DISTORTION}
_TURNS: Final = np.arange(ROTATION.start, ROTATION.stop)
STD_NAMES: Final = tuple(each.name for each in fields(PoseStd))
_STATED: Final = ("tilt_rad", "pan_rad", "roll_rad", "heading_rad")
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


def variance_budgets(
    by_shared: FloatArray, pixel_var: FloatArray, poses: PoseBatch, shared_cov: FloatArray
) -> list[tuple[Share, ...]]:
    """The parts of the variances of scalars in ``r`` images, the largest first; empty where nothing is uncertain.

    Args:
        by_shared: ``(r, s)`` derivatives of the scalars.
        pixel_var: ``(r,)`` what pixels add to their variances.
        poses: The ``(r,)`` poses. Where a stated standard deviation does not reproduce the covariance (a calibration's
            full one), tilt, pan, roll and heading are given as one ``attitude``.
        shared_cov: ``(r, s, s)``.
    """
    pose_cov = poses.pose.cov
    motion = np.concatenate([poses.pose.velocity_enu_mps, poses.pose.rate_cam_radps], axis=-1)
    motion = np.broadcast_to(motion, (len(by_shared), 6))

    def part(of: slice, cov: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("ri,rij,rj->r", by_shared[:, of], cov, by_shared[:, of]))

    by_motion = np.sum(by_shared[:, :6] * motion, axis=-1)
    columns = {
        "height": by_shared[:, 2] ** 2 * pose_cov[:, 2, 2],
        "position": part(slice(2), pose_cov[:, :2, :2]),
        **_attitude(by_shared[:, ROTATION], poses),
        "time": np.square(by_motion * poses.pose.time_std_s),
        **{name: part(of, shared_cov[:, of, of]) for name, of in _INTRINSICS.items()},
        "elevation": by_shared[:, ELEVATION] ** 2 * shared_cov[:, ELEVATION, ELEVATION],
        "pixels": pixel_var,
    }
    total = part(slice(None), shared_cov) + pixel_var
    columns["correlations"] = total - np.sum(list(columns.values()), axis=0)
    is_settled = np.sqrt(pose_cov[:, _TURNS, _TURNS]).max(axis=-1) <= _UNSETTLED_RAD
    variances = np.stack(list(columns.values()), axis=-1)
    return [
        _shares(dict(zip(columns, row, strict=True)), whole, is_settled=settled)
        for row, whole, settled in zip(variances.tolist(), total.tolist(), is_settled.tolist(), strict=True)
    ]


def _shares(variances: dict[str, float], total: float, *, is_settled: bool) -> tuple[Share, ...]:
    if not total > 0:
        return ()
    parts = [
        Share(
            source,
            math.copysign(math.sqrt(abs(variance)), variance),
            variance / total,
            _ADVICE[source] if is_settled or source not in _ANGLES else _UNSETTLED,
        )
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


def _attitude(by_rotation: FloatArray, poses: PoseBatch) -> dict[str, FloatArray]:
    up_cam = matrix(poses.pose.wxyz)[:, 2]
    tilt, pan, roll, heading = (poses.std[:, STD_NAMES.index(name)] for name in _STATED)
    stated = np.square(heading)[:, None, None] * up_cam[:, :, None] * up_cam[:, None]
    stated[:, [0, 1, 2], [0, 1, 2]] += np.square([tilt, pan, roll]).T
    actual = poses.pose.cov[:, ROTATION, ROTATION]
    is_stated = np.all(np.abs(stated - actual) <= 1e-15 + 1e-6 * np.abs(actual), axis=(1, 2))
    parts = {
        "attitude": np.einsum("ri,rij,rj->r", by_rotation, actual, by_rotation),
        "tilt": np.square(by_rotation[:, 0] * tilt),
        "pan": np.square(by_rotation[:, 1] * pan),
        "roll": np.square(by_rotation[:, 2] * roll),
        "heading": np.square(np.sum(by_rotation * up_cam, axis=-1) * heading),
    }
    return {name: np.where(is_stated == (name != "attitude"), part, 0.0) for name, part in parts.items()}
