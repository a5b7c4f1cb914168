"""First-order covariances and standard deviations of measurements, and their budget by input.

Points of one measurement share the errors of pose, lens and elevation; each pixel has its own.

``n`` images, ``g`` scalars or points in each, ``s`` shared errors as in ``projection``.
"""

import math
from dataclasses import dataclass
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
from aerodft.model import STD_NAMES, BoolArray, Camera, FloatArray, FloatLike, GimbalSource, Pose, PoseBatch, PoseSample

Z95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

CHI2_2D_95 = 5.991464547107979
"""95 % quantile of chi-square with two degrees of freedom."""
_SECOND_ORDER_TAIL: Final = 1.5
"""A square of a normal error has a longer tail than a normal one: by how much its variance counts for more."""
_NEGLIGIBLE_FRACTION = 1e-12
_REMEDIES = {
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
    "elevation": "survey the elevation of the measured plane",
    "water level": "have readings of ground.level closer to the stamp, and survey level_zero_m",
    "time": "align the clocks of images and telemetry, or hold still",
    "pixels": "pick the pixels more precisely, come closer, or use more resolution",
}
_MAX_SETTLED_STD_RAD: Final = math.radians(2)  # larger standard deviations than this only while a gimbal moves
_ATTITUDE_SOURCES: Final = ("tilt", "pan", "roll", "attitude")
_SLICES: Final = {
    "height": slice(2, 3),
    "position": slice(2),
    "attitude": ROTATION,
    "focal": FOCAL,
    "principal point": PRINCIPAL_POINT,
    "distortion": DISTORTION,
    "elevation": slice(ELEVATION, ELEVATION + 1),
}
_ROTATION_AXES: Final = np.arange(ROTATION.start, ROTATION.stop)
_ATTITUDE_STDS: Final = ("tilt_rad", "pan_rad", "roll_rad", "heading_rad")
_UNSETTLED_REMEDY: Final = "know the attitude better: wait until the gimbal has settled, or add a landmark"
_STATED_REMEDY: Final = "know the attitude better: add landmarks, and calibrate the camera's pose by them"


def shared_covariance(
    camera: Camera, pose: Pose, elevation_std_m: FloatLike, zoom: FloatArray | None = None
) -> FloatArray:
    """Covariance ``(..., s, s)`` of the errors that all points share, ordered as in ``projection``.

    An error ``dt`` of the stamp moves the pose by ``dt`` times the camera's velocity and angular rate. The covariance
    of pose and lens errors, where calibrated together, is scaled from the camera's focal lengths to the zoomed ones.

    Args:
        camera: The camera.
        pose: One pose, or ``(...)``.
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
        scales, intrinsics = _zoom_intrinsics(camera, zoom, intrinsics)
        lens_cov = lens_cov * scales[:, None] if lens_cov.shape[-1] == scales.shape[-1] else lens_cov
    cov[..., INTRINSICS, INTRINSICS] = intrinsics
    if lens_cov.shape[-1] == count - INTRINSICS.start:
        cov[..., :6, INTRINSICS] = lens_cov
        cov[..., INTRINSICS, :6] = lens_cov.swapaxes(-1, -2)
    return cov


def _zoom_intrinsics(camera: Camera, zoom: FloatArray, intrinsics_cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Scale factors ``(n, m)`` of errors of the intrinsics in zoomed images, and their covariances ``(n, m, m)``.

    Bit-identical to ``Camera.zoomed``: with equal variances the principal axes, and so the draws, depend on it.
    """
    scales, std = np.ones((len(zoom), len(intrinsics_cov))), np.zeros((len(zoom), len(intrinsics_cov)))
    scales[:, :2], std[:, :2] = zoom[:, :1], zoom[:, 1:] * [camera.fx_px, camera.fy_px]
    if camera.covariance:
        return scales, scales[:, :, None] * scales[:, None] * intrinsics_cov + std[:, :, None] * std[:, None]
    cov = np.broadcast_to(intrinsics_cov, (len(zoom), *intrinsics_cov.shape)).copy()
    magnification = zoom[:, 0]
    focal_px = np.stack([np.ones(len(zoom)), magnification * camera.fy_px / (magnification * camera.fx_px)], axis=-1)
    focal_px *= np.hypot(magnification * camera.std.focal_px, std[:, 0])[:, None]
    cov[:, :2, :2] = focal_px[:, :, None] * focal_px[:, None]
    return scales, cov


def scalar_jacobians(by: Gradient, ground: GroundPoints, rays: Directions | None) -> tuple[FloatArray, FloatArray]:
    """Derivatives of scalars ``(...)`` by the shared errors ``(..., s)`` and by their pixels ``(..., q, 2)``.

    Args:
        by: Gradient of each scalar by camera, points and directions.
        ground: The points ``(..., q)``.
        rays: Directions ``(..., q)``; None for scalars that do not depend on directions.
    """
    is_used = np.any(by.by_points != 0.0, axis=-1)
    jac_shared, jac_px = ground.jac_shared, ground.jac_px
    if not is_used.all():  # an unused ray may miss the ground, with infinite derivatives
        jac_shared = np.where(is_used[..., None, None], jac_shared, 0.0)
        jac_px = np.where(is_used[..., None, None], jac_px, 0.0)
    shared = np.einsum("...qi,...qis->...s", by.by_points, jac_shared)
    shared[..., POSITION] += by.by_camera
    px = np.einsum("...qi,...qij->...qj", by.by_points, jac_px)
    if rays is not None:
        shared += np.einsum("...qi,...qis->...s", by.by_directions, rays.jac_shared)
        px += np.einsum("...qi,...qij->...qj", by.by_directions, rays.jac_px)
    return shared, px


def elevation_jacobians(by: Gradient, ground: GroundPoints, count: int) -> FloatArray:
    """Derivatives of scalars ``(...)`` by the ``count`` elevations that their points have in turn, ``(..., count)``.

    Args:
        by: Gradient of each scalar by camera, points and directions.
        ground: The points ``(..., q)``.
        count: Number of elevations, of which ``q`` is a multiple; 0 where all points share one.
    """
    if not count:
        return np.zeros((*by.by_camera.shape[:-1], 0))
    by_point = np.sum(by.by_points * np.where(by.by_points != 0.0, ground.jac_shared[..., ELEVATION], 0.0), axis=-1)
    return np.asarray(np.sum(by_point.reshape(*by_point.shape[:-1], -1, count), axis=-2))


def standard_deviations(
    jac_shared: FloatArray, jac_px: FloatArray, shared_cov: FloatArray, elevation_var: FloatArray, pixel_var: FloatArray
) -> FloatArray:
    """First-order standard deviations ``(n, g)`` of scalars.

    Args:
        jac_shared: ``(n, g, s)`` derivatives of the scalars.
        jac_px: ``(n, g, p)`` by their pixels' coordinates.
        shared_cov: ``(n, s, s)``.
        elevation_var: ``(g,)`` of each scalar's own elevation, in addition.
        pixel_var: ``(g,)`` of each pixel coordinate.
    """
    rows = jac_shared @ shared_cov
    rows[..., ELEVATION] += elevation_var * jac_shared[..., ELEVATION]
    variance = np.einsum("ngs,ngs->ng", rows, jac_shared) + pixel_var * np.einsum("ngp,ngp->ng", jac_px, jac_px)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def point_covariances(
    jac_shared: FloatArray, jac_px: FloatArray, shared_cov: FloatArray, elevation_var: FloatArray, pixel_var: FloatArray
) -> FloatArray:
    """First-order covariances ``(n, g, 3, 3)`` of points.

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


def range_covariances(
    range_m: FloatArray,
    jac_shared: FloatArray,
    jac_px: FloatArray,
    shared_cov: FloatArray,
    elevation_var: FloatArray,
    pixel_var: FloatArray,
) -> FloatArray:
    """First-order covariances ``(n, g, k, 2, 2)`` of the two parts of relative errors of slant ranges.

    One is that of the height above the ground, the other that of the ray's slope, ``height / range``; both together are
    the range's.

    Args:
        range_m: ``(n, g, k)``.
        jac_shared: ``(n, g, k, s)`` derivatives of the ranges.
        jac_px: ``(n, g, k, 2)`` by the points' own pixels.
        shared_cov: ``(n, s, s)``.
        elevation_var: ``(g, k)`` of each point's own elevation, in addition.
        pixel_var: ``(g,)`` of each pixel coordinate.
    """
    count, _, points = range_m.shape
    by_errors, by_px = np.zeros((*range_m.shape, 2, jac_shared.shape[-1])), np.zeros((*range_m.shape, 2, 2))
    by_errors[..., 1, :], by_px[..., 1, :] = jac_shared, jac_px
    for columns in (POSITION, slice(ELEVATION, ELEVATION + 1)):
        by_errors[..., 0, columns], by_errors[..., 1, columns] = jac_shared[..., columns], 0.0
    shared, px = (each.reshape(count, -1, *each.shape[3:]) for each in (by_errors, by_px))
    cov = point_covariances(shared, px, shared_cov, elevation_var.ravel(), np.repeat(pixel_var, points))
    return np.asarray(cov.reshape(*range_m.shape, 2, 2) / np.square(range_m)[..., None, None])


def relative_range_halves(cov: FloatArray, tilt_cov: FloatArray) -> FloatArray:
    """Half widths ``(...)`` of 95 % intervals of slant ranges, relative; infinite where the ray may meet no ground.

    A range is the height over the ray's slope, whose interval has a closed form (E. C. Fieller, "Some problems in
    interval estimation", 1954): the larger any error, the wider. A tilt by an angle ``a`` changes the slope by the
    fraction ``a**2 / 2`` to second order, which is all that is left straight down: its mean square is added.

    Args:
        cov: ``(..., 2, 2)``, see ``range_covariances``.
        tilt_cov: ``(..., 3, 3)`` of the rotation without that about the vertical.
    """
    mean_square = np.square(np.trace(tilt_cov, axis1=-2, axis2=-1)) / 4 + np.sum(np.square(tilt_cov), axis=(-2, -1)) / 2
    height, slope, cross = cov[..., 0, 0], cov[..., 1, 1] + _SECOND_ORDER_TAIL * mean_square, cov[..., 0, 1]
    square = height + slope + 2 * cross - Z95**2 * (height * slope - cross * cross)
    rest = 1 - Z95**2 * slope
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(rest > 0, Z95 * np.sqrt(np.maximum(square, 0.0)) / rest, np.inf)


def ellipses95(cov_enu_m2: FloatArray) -> FloatArray:
    """95 % ellipses ``(..., 3)`` of horizontal positions: semi-major, semi-minor axis (m) and azimuth (rad).

    The azimuth is of the major axis, clockwise from north, in [0, pi).
    """
    east, north, cross = cov_enu_m2[..., 0, 0], cov_enu_m2[..., 1, 1], cov_enu_m2[..., 0, 1]
    mean, radius = (east + north) / 2, np.hypot((east - north) / 2, cross)
    axes = np.sqrt(CHI2_2D_95 * np.clip(np.stack([mean + radius, mean - radius], axis=-1), 0.0, None))
    azimuth = np.arctan2(2 * cross, north - east) / 2 % np.pi
    return np.concatenate([axes, azimuth[..., None]], axis=-1)


@dataclass(frozen=True, slots=True)
class Share:
    """One input's part of the variance of a measurement.

    Attributes:
        source: The input.
        std: Root of its part of the variance: the measurement's standard deviation if this input alone were uncertain,
            where it is independent of the others.
        share: Fraction of the variance, 0 to 1; all of a budget add up to 1. What correlated inputs add together, or
            take from each other, is divided evenly between them.
        remedy: How to reduce it.
    """

    source: str
    std: float
    share: float
    remedy: str


def variance_budgets(
    jac_shared: FloatArray,
    own_var: tuple[FloatArray, FloatArray],
    poses: PoseBatch,
    shared_cov: FloatArray,
    largest: int | None = None,
) -> list[tuple[Share, ...]]:
    """Variance budgets of scalars in ``r`` images, largest part first; empty where nothing is uncertain.

    Parts of correlated inputs are the squared CAR scores of Zuber and Strimmer (2011, equation 6): the whitened inputs
    that are closest to the standardised ones. They are never negative, add up to the variance, and are the variances
    themselves where inputs are independent.

    Args:
        jac_shared: ``(r, s)`` derivatives of the scalars.
        own_var: ``(r,)`` parts of the variances by errors of the points' own: of their pixels, of their elevations.
        poses: The ``(r,)`` poses. Where the standard deviations do not reproduce the covariance (a calibration's full
            one), tilt, pan, roll and heading become one ``attitude``.
        shared_cov: ``(r, s, s)``.
        largest: How many parts of each; None for all.
    """
    motion = np.concatenate([poses.pose.velocity_enu_mps, poses.pose.rate_cam_radps], axis=-1)
    by_motion = np.sum(jac_shared[:, :6] * motion, axis=-1)
    cov = shared_cov.copy()
    cov[:, :6, :6] = pose_cov = poses.pose.cov  # without the motion
    attitude, is_stated = _stated_attitude(jac_shared[:, ROTATION], cov[:, ROTATION], poses)
    cov[:, ROTATION, ROTATION] *= ~is_stated[:, None, None]
    parts = _variance_parts(jac_shared, cov)
    variances_by_source = {
        **{name: np.sum(parts[:, columns], axis=-1) for name, columns in _SLICES.items()},
        **attitude,
        "time": np.square(by_motion * poses.pose.time_std_s),
        "pixels": own_var[0],
    }
    variances_by_source |= _by_level(variances_by_source["elevation"], poses, shared_cov[:, ELEVATION, ELEVATION])
    variances_by_source["elevation"] = variances_by_source["elevation"] + own_var[1]
    total = np.sum(list(variances_by_source.values()), axis=0)
    is_settled = np.sqrt(pose_cov[:, _ROTATION_AXES, _ROTATION_AXES]).max(axis=-1) <= _MAX_SETTLED_STD_RAD
    variances = np.stack(list(variances_by_source.values()), axis=-1)
    sources, order = list(variances_by_source), np.argsort(-variances, axis=-1, kind="stable")[:, :largest]
    remedies = [_unsettled_remedy(poses.variants[index]) for index in poses.variant_index.tolist()]
    columns = order, np.take_along_axis(variances, order, axis=-1), total, is_settled
    return [
        tuple(
            _share(sources[source], variance, total_var, None if settled else remedy)
            for source, variance in zip(*row, strict=True)
            if variance > _NEGLIGIBLE_FRACTION * total_var > 0
        )
        for *row, total_var, settled, remedy in zip(*(column.tolist() for column in columns), remedies, strict=True)
    ]


def _by_level(elevation_var: FloatArray, poses: PoseBatch, cov: FloatArray) -> dict[str, FloatArray]:
    """The part of the shared elevation's error, split into that of the water's level and the rest.

    Args:
        elevation_var: ``(r,)`` parts of the scalars' variances.
        poses: The ``(r,)`` poses.
        cov: ``(r,)`` variances of the shared elevation, by both.
    """
    level_var = np.where(poses.has_own_height, 0.0, np.square(poses.level_std_m))
    of_level = elevation_var * np.divide(level_var, cov, out=np.zeros_like(cov), where=cov > 0)
    return {"water level": of_level, "elevation": elevation_var - of_level}


def _share(source: str, variance: float, total: float, attitude_remedy: str | None) -> Share:
    """One input's part; ``attitude_remedy`` is that of a poorly known attitude."""
    remedy = attitude_remedy if attitude_remedy and source in _ATTITUDE_SOURCES else _REMEDIES[source]
    return Share(source, math.sqrt(variance), variance / total, remedy)


def _unsettled_remedy(sample: PoseSample) -> str:
    """What to do about a poorly known attitude: only a gimbal settles."""
    is_stated = sample.attitude_source in (GimbalSource.FIXED_MOUNT, GimbalSource.MANUAL)
    return _STATED_REMEDY if is_stated else _UNSETTLED_REMEDY


def advice(budget: tuple[Share, ...]) -> str:
    """Sentence on the largest part of a budget and its remedy; empty where nothing is uncertain."""
    if not budget:
        return ""
    first = budget[0]
    return f"{100 * first.share:.0f} % from {first.source}: {first.remedy}"


def _variance_parts(jac_shared: FloatArray, cov: FloatArray) -> FloatArray:
    """Parts ``(r, s)`` of the variances ``g C g`` of scalars with gradients ``g``, which add up to them."""
    stds = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    scale = np.where(stds > 0.0, stds, 1.0)
    values, axes = np.linalg.eigh(cov / (scale[:, :, None] * scale[:, None]))
    along = np.einsum("rij,ri->rj", axes, jac_shared * stds) * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(np.square(np.einsum("rij,rj->ri", axes, along)))


def _stated_attitude(
    jac_rotation: FloatArray, rows: FloatArray, poses: PoseBatch
) -> tuple[dict[str, FloatArray], BoolArray]:
    """Parts ``(r,)`` of variances that are from an attitude's standard deviations; where these say all about it.

    Args:
        jac_rotation: ``(r, 3)`` derivatives of the scalars.
        rows: ``(r, 3, s)`` of the attitude in the covariance; parts are 0 where the stds do not reproduce them.
        poses: The ``(r,)`` poses.
    """
    up_cam = matrix(poses.pose.wxyz)[:, 2]
    tilt, pan, roll, heading = (poses.std[:, STD_NAMES.index(name)] for name in _ATTITUDE_STDS)
    stated = np.zeros(rows.shape)
    stated[..., :6] = pose_covariance(poses.pose.wxyz, poses.std)[:, ROTATION]
    is_stated = np.all(np.abs(stated - rows) <= 1e-15 + 1e-6 * np.abs(rows), axis=(1, 2))
    parts = {
        "tilt": jac_rotation[:, 0] * tilt,
        "pan": jac_rotation[:, 1] * pan,
        "roll": jac_rotation[:, 2] * roll,
        "heading": np.sum(jac_rotation * up_cam, axis=-1) * heading,
    }
    return {name: np.square(part) * is_stated for name, part in parts.items()}, is_stated
