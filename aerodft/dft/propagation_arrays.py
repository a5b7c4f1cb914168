"""The loops of ``propagation`` over whole arrays, for who does without the compiler: the same to the last bit.

Every sum runs in the order in which the loops add it up, and what they leave out is left as it was.
"""

import numpy as np

from aerodft.model.arrays import FloatArray, IntArray

_ROTATION, _ELEVATION, _INTRINSICS = 3, 6, 7


def depend(
    met: tuple[FloatArray, FloatArray, FloatArray],
    rotation: FloatArray,
    rays_cam: FloatArray,
    by_px: FloatArray,
    by_intrinsics: FloatArray,
    shared: FloatArray,
    own: FloatArray,
) -> None:
    """As ``propagation.depend``."""
    by_direction, by_position, by_elevation = met
    with np.errstate(all="ignore"):  # points that miss the ground have infinite derivatives
        turned = _along(by_direction[..., None], rotation[:, None, None])
        shared[..., :_ROTATION] = by_position
        for axis in range(3):
            one, other = (axis + 1) % 3, (axis + 2) % 3
            crossed = rays_cam[..., one, None] * turned[..., other] - rays_cam[..., other, None] * turned[..., one]
            shared[..., _ROTATION + axis] = crossed
        shared[..., _ELEVATION] = by_elevation
        shared[..., _INTRINSICS:] = _along(turned[..., None], by_intrinsics[..., None, :, :])
        own[:] = _along(turned[..., None], by_px[..., None, :, :])


def spread(
    jacobians: tuple[FloatArray, FloatArray],
    errors: tuple[FloatArray, IntArray, IntArray],
    elevation_var: FloatArray,
    pixel_var: FloatArray,
    sight: FloatArray,
    cov: FloatArray,
    range_var: FloatArray,
) -> None:
    """As ``propagation.spread``."""
    (shared, own), (shared_cov, _, _) = jacobians, errors
    cov[:], range_var[:] = 0.0, 0.0
    by_error = np.ascontiguousarray(np.moveaxis(shared, -1, 0))  # (s, n, k, 3)
    with np.errstate(all="ignore"):
        rows = 0.0 * by_error
        rows[_ELEVATION] = elevation_var[:, None] * by_error[_ELEVATION]
        for values, row in zip(by_error, _added(rows, shared_cov, by_error), strict=True):
            cov += values[..., None] * row[..., None, :]
        by = _along(sight[..., None], shared)
        by[..., :_ROTATION] -= sight
        by = np.ascontiguousarray(np.moveaxis(by, -1, 0))
        rows = _added(np.zeros(by.shape), shared_cov, by)
        rows[_ELEVATION] += elevation_var * by[_ELEVATION]
        for values, row in zip(by, rows, strict=True):
            range_var += values * row
        along = _along(sight[..., None], own)
        for b in range(2):
            range_var += pixel_var * along[..., b] * along[..., b]
            cov += (pixel_var[:, None] * own[..., b])[..., None] * own[..., None, :, b]


def joint_variances(
    gradient: tuple[FloatArray, FloatArray, FloatArray],
    points: tuple[FloatArray, FloatArray, IntArray],
    rays: tuple[FloatArray, FloatArray, IntArray],
    errors: tuple[FloatArray, IntArray, IntArray],
    own_var: FloatArray,
    out: FloatArray,
) -> None:
    """As ``propagation.joint_variances``."""
    by_camera, by_directions, by_points = gradient
    shared, own = points[0][:, points[2]], points[1][:, points[2]]
    ray_shared, ray_own = rays[0][:, rays[2]], rays[1][:, rays[2]]
    (shared_cov, _, _), (elevation_var, pixel_var) = errors, own_var.T
    total = np.zeros((*out.shape, shared.shape[4]))
    total[..., :_ROTATION] = by_camera
    out[:] = 0.0
    with np.errstate(all="ignore"):
        for q in range(by_points.shape[2]):
            pixel = _add_along(by_points[:, :, q], shared[:, :, q], own[:, :, q], total)
            pixel = pixel + _add_along(by_directions[:, :, q], ray_shared[:, :, q], ray_own[:, :, q], total)
            out += pixel_var * (pixel[..., 0] * pixel[..., 0] + pixel[..., 1] * pixel[..., 1])
        by = np.ascontiguousarray(np.moveaxis(total, -1, 0))
        rows = np.zeros(by.shape)
        rows[_ELEVATION] = elevation_var * by[_ELEVATION]
        for values, row in zip(by, _added(rows, shared_cov, by), strict=True):
            out += values * row


def _along(vector: FloatArray, matrix: FloatArray) -> FloatArray:
    """Sums over the first axis of matrices ``(..., 3, j)``, weighted by vectors ``(..., 3, 1)``."""
    return (
        vector[..., 0, :] * matrix[..., 0, :]
        + vector[..., 1, :] * matrix[..., 1, :]
        + vector[..., 2, :] * matrix[..., 2, :]
    )


def _added(rows: FloatArray, cov: FloatArray, by_error: FloatArray) -> FloatArray:
    """Rows ``(s, n, ...)`` and what errors ``(s, n, ...)`` add to them by covariances ``(n, s, s)``, but for zeros."""
    weights = np.moveaxis(cov, 0, -1).reshape(*cov.shape[1:], -1, *[1] * (rows.ndim - 2))  # (s, s, n, 1, ...)
    used = weights != 0.0
    for b, values in enumerate(by_error):
        more = rows + weights[:, b] * values
        rows = more if used[:, b].all() else np.where(used[:, b], more, rows)
    return rows


def _add_along(by: FloatArray, shared: FloatArray, own: FloatArray, total: FloatArray) -> FloatArray:
    """Add the shared errors' part of what depends on points ``(n, g)``; gives back that of their own pixels."""
    pixel = np.zeros((*by.shape[:-1], 2))
    for i in range(3):
        weight = by[..., i, None]
        used = weight != 0.0  # what is not used may miss the ground, with infinite derivatives
        np.copyto(total, total + weight * shared[..., i, :], where=used)
        np.copyto(pixel, pixel + weight * own[..., i, :], where=used)
    return pixel
