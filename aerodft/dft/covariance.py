"""Joint first-order propagation: all points of one measurement share the pose's error, each has its own pixel's.

``n`` images, ``g`` scalars or points in each, ``s`` shared errors as in ``projection``.
"""

import numpy as np

from aerodft.dft.projection import ELEVATION, INTRINSICS, POSITION, Directions, GroundPoints, shared_count
from aerodft.dft.quantities import Gradient
from aerodft.geometry import intrinsics_covariance
from aerodft.model import Camera, FloatArray, FloatLike, Pose

Z95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

CHI2_2D_95 = 5.991464547107979
"""95 % quantile of chi-square with two degrees of freedom."""


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
