"""Where a measurement's standard deviation comes from: first order, jointly, and input by input.

All points of one measurement share the errors of pose, lens and elevation; each pixel has its own.

``n`` images, ``g`` scalars or points in each, ``s`` shared errors as in ``projection``.
"""

import math
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from aerodft.dft.projection import (
    DISTORTION,
    ELEVATION,
    FOCAL,
    INTRINSICS,
    POSITION,
    PRINCIPAL_POINT,
    ROTATION,
    Directions,
    GroundPoints,
    shared_count,
)
from aerodft.dft.quantities import Gradient
from aerodft.geometry import intrinsics_covariance, matrix, pose_covariance
from aerodft.model import Camera, FloatArray, FloatLike, Pose, PoseBatch, PoseStd

Z95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

CHI2_2D_95 = 5.991464547107979
"""95 % quantile of chi-square with two degrees of freedom."""
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


def shared_covariance(
    camera: Camera, pose: Pose, elevation_std_m: FloatLike, zoom: FloatArray | None = None
) -> FloatArray:
    """``(..., s, s)`` covariance of the errors that all points have in common, ordered as in ``projection``.

    A stamp that is off by ``dt`` is a pose that is off by ``dt`` times the camera's motion. Where pose and lens were
    calibrated together, the covariance of their errors is in pixels of the camera's focal lengths: it is turned into
    pixels of the zoomed ones.

    Args:
        camera: The camera.
        pose: One pose, or as many as elevations.
        elevation_std_m: ``(...)``.
        zoom: ``(n, 2)`` magnification of each of ``(n,)`` poses' images, and its standard deviation; None for 1.
    """
    motion = np.concatenate([pose.velocity_enu_mps, pose.rate_cam_radps], axis=-1)
    time_var = np.square(pose.time_std_s)
    count = shared_count(camera)
    cov = np.zeros((*np.shape(elevation_std_m), count, count))
    cov[..., :6, :6] = pose.cov + time_var[..., None, None] * motion[..., :, None] * motion[..., None, :]
    cov[..., ELEVATION, ELEVATION] = np.square(elevation_std_m)
    intrinsics, lens_cov = intrinsics_covariance(camera), pose.lens_cov
    if zoom is not None:
        scales, intrinsics = _zoomed(camera, zoom, intrinsics)
        lens_cov = lens_cov * scales[:, None] if lens_cov.shape[-1] == scales.shape[-1] else lens_cov
    cov[..., INTRINSICS, INTRINSICS] = intrinsics
    if lens_cov.shape[-1] == count - INTRINSICS.start:
        cov[..., :6, INTRINSICS] = lens_cov
        cov[..., INTRINSICS, :6] = lens_cov.swapaxes(-1, -2)
    return cov


def _zoomed(camera: Camera, zoom: FloatArray, intrinsics_cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What errors of the intrinsics ``(n, m)`` grow by in zoomed images, and their covariances ``(n, m, m)``.

    As of ``Camera.zoomed``, to the last bit: of equal variances the axes, and with these the draws, turn on that.
    """
    scales, moved = np.ones((len(zoom), len(intrinsics_cov))), np.zeros((len(zoom), len(intrinsics_cov)))
    scales[:, :2], moved[:, :2] = zoom[:, :1], zoom[:, 1:] * [camera.fx_px, camera.fy_px]
    if camera.covariance:
        return scales, scales[:, :, None] * scales[:, None] * intrinsics_cov + moved[:, :, None] * moved[:, None]
    cov = np.broadcast_to(intrinsics_cov, (len(zoom), *intrinsics_cov.shape)).copy()
    magnification = zoom[:, 0]
    focal_px = np.stack([np.ones(len(zoom)), magnification * camera.fy_px / (magnification * camera.fx_px)], axis=-1)
    focal_px *= np.hypot(magnification * camera.std.focal_px, moved[:, 0])[:, None]
    cov[:, :2, :2] = focal_px[:, :, None] * focal_px[:, None]
    return scales, cov


def scalar_jacobians(by: Gradient, ground: GroundPoints, rays: Directions | None) -> tuple[FloatArray, FloatArray]:
    """Derivatives of scalars ``(...)`` by the shared errors ``(..., s)`` and by the pixels ``(..., q, 2)``.

    Args:
        by: Of each scalar by its camera, points and directions.
        ground: The points ``(..., q)``.
        rays: Their directions ``(..., q)``; None for scalars that do not depend on these.
    """
    is_used = np.any(by.by_points != 0.0, axis=-1)
    jac_shared, jac_px = ground.jac_shared, ground.jac_px
    if not is_used.all():  # a ray that is not used may miss the ground, with infinite derivatives
        jac_shared = np.where(is_used[..., None, None], jac_shared, 0.0)
        jac_px = np.where(is_used[..., None, None], jac_px, 0.0)
    shared = np.einsum("...qi,...qis->...s", by.by_points, jac_shared)
    shared[..., POSITION] += by.by_camera
    own = np.einsum("...qi,...qij->...qj", by.by_points, jac_px)
    if rays is not None:
        shared += np.einsum("...qi,...qis->...s", by.by_directions, rays.jac_shared)
        own += np.einsum("...qi,...qij->...qj", by.by_directions, rays.jac_px)
    return shared, own


def standard_deviations(
    by_shared: FloatArray, by_px: FloatArray, shared_cov: FloatArray, elevation_var: FloatArray, pixel_var: FloatArray
) -> FloatArray:
    """Standard deviations ``(n, g)`` of scalars: shared errors add up over points before they are squared.

    Args:
        by_shared: ``(n, g, s)`` derivatives of the scalars.
        by_px: ``(n, g, p)`` by their pixels' coordinates.
        shared_cov: ``(n, s, s)``.
        elevation_var: ``(g,)`` of each scalar's own elevation, in addition.
        pixel_var: ``(g,)`` of each pixel coordinate.
    """
    rows = by_shared @ shared_cov
    rows[..., ELEVATION] += elevation_var * by_shared[..., ELEVATION]
    variance = np.einsum("ngs,ngs->ng", rows, by_shared) + pixel_var * np.einsum("ngp,ngp->ng", by_px, by_px)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def point_covariances(
    jac_shared: FloatArray, jac_px: FloatArray, shared_cov: FloatArray, elevation_var: FloatArray, pixel_var: FloatArray
) -> FloatArray:
    """``(n, g, 3, 3)`` of points.

    Args:
        jac_shared: ``(n, g, 3, s)``.
        jac_px: ``(n, g, 3, 2)``.
        shared_cov: ``(n, s, s)``.
        elevation_var: ``(g,)`` of each point's own elevation, in addition.
        pixel_var: ``(g,)`` of each pixel coordinate.
    """
    count, requests, axes, errors = jac_shared.shape
    by_errors = np.concatenate([jac_shared, jac_px], axis=-1)
    rows = np.empty(by_errors.shape)
    rows[..., :errors] = (jac_shared.reshape(count, requests * axes, errors) @ shared_cov).reshape(jac_shared.shape)
    rows[..., ELEVATION] += elevation_var[:, None] * jac_shared[..., ELEVATION]
    rows[..., errors:] = pixel_var[:, None, None] * jac_px
    return np.asarray(np.einsum("ngis,ngjs->ngij", rows, by_errors))


def ellipses95(cov_enu_m2: FloatArray) -> FloatArray:
    """Semi-major, semi-minor axis (m) and azimuth (rad) ``(..., 3)`` of the 95 % ellipses of the horizontal parts.

    The azimuth is that of the major axis, clockwise from north, in [0, pi).
    """
    east, north, both = cov_enu_m2[..., 0, 0], cov_enu_m2[..., 1, 1], cov_enu_m2[..., 0, 1]
    middle, off = (east + north) / 2, np.hypot((east - north) / 2, both)
    axes = np.sqrt(CHI2_2D_95 * np.clip(np.stack([middle + off, middle - off], axis=-1), 0.0, None))
    azimuth = np.arctan2(2 * both, north - east) / 2 % np.pi
    return np.concatenate([axes, azimuth[..., None]], axis=-1)


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
    stated = pose_covariance(poses.pose.wxyz, poses.std)[:, ROTATION, ROTATION]
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
