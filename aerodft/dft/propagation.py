"""The hot loops from derivatives to covariances, over all points of many images.

All of them stand in this module, as in ``geometry.dense``; ``dft.loops`` says when they run. Sums run in a fixed order
and nothing is fused, so that an image's numbers are the same to the last bit whichever other images are in the batch.

``n`` images, ``k`` points in each, ``m`` intrinsics, ``s = 7 + m`` shared errors as in ``projection``.
"""

import numpy as np

from aerodft.geometry.jit import njit_late, njit_late_inline
from aerodft.model.arrays import FloatArray, IntArray

_POSITION, _ROTATION, _ELEVATION, _INTRINSICS = 0, 3, 6, 7


@njit_late
def depend(
    met: tuple[FloatArray, FloatArray, FloatArray],
    rotation: FloatArray,
    rays_cam: FloatArray,
    by_px: FloatArray,
    by_intrinsics: FloatArray,
    shared: FloatArray,
    own: FloatArray,
) -> None:
    """Derivatives of ground points by the shared errors and by their pixels.

    Args:
        met: Derivatives of the points by direction and position ``(n, k, 3, 3)``, and by elevation ``(n, k, 3)``.
        rotation: ``(n, 3, 3)`` from camera axes to ENU.
        rays_cam: ``(1, k, 3)``, or ``(n, k, 3)`` where each image has its own.
        by_px: ``(1 or n, k, 3, 2)`` of the rays.
        by_intrinsics: ``(1 or n, k, 3, m)`` of the rays.
        shared: ``(n, k, 3, s)``, written.
        own: ``(n, k, 3, 2)``, written.
    """
    by_direction, by_position, by_elevation = met
    for n in range(shared.shape[0]):
        r = n if len(rays_cam) > 1 else 0
        for k in range(shared.shape[1]):
            x, y, z = rays_cam[r, k, 0], rays_cam[r, k, 1], rays_cam[r, k, 2]
            for i in range(3):
                d0, d1, d2 = by_direction[n, k, i, 0], by_direction[n, k, i, 1], by_direction[n, k, i, 2]
                b0 = d0 * rotation[n, 0, 0] + d1 * rotation[n, 1, 0] + d2 * rotation[n, 2, 0]
                b1 = d0 * rotation[n, 0, 1] + d1 * rotation[n, 1, 1] + d2 * rotation[n, 2, 1]
                b2 = d0 * rotation[n, 0, 2] + d1 * rotation[n, 1, 2] + d2 * rotation[n, 2, 2]
                for j in range(3):
                    shared[n, k, i, _POSITION + j] = by_position[n, k, i, j]
                shared[n, k, i, _ROTATION] = y * b2 - z * b1
                shared[n, k, i, _ROTATION + 1] = z * b0 - x * b2
                shared[n, k, i, _ROTATION + 2] = x * b1 - y * b0
                shared[n, k, i, _ELEVATION] = by_elevation[n, k, i]
                for j in range(by_intrinsics.shape[3]):
                    shared[n, k, i, _INTRINSICS + j] = (
                        b0 * by_intrinsics[r, k, 0, j] + b1 * by_intrinsics[r, k, 1, j] + b2 * by_intrinsics[r, k, 2, j]
                    )
                for j in range(2):
                    own[n, k, i, j] = b0 * by_px[r, k, 0, j] + b1 * by_px[r, k, 1, j] + b2 * by_px[r, k, 2, j]


@njit_late
def spread(
    jacobians: tuple[FloatArray, FloatArray],
    errors: tuple[FloatArray, IntArray, IntArray],
    elevation_var: FloatArray,
    pixel_var: FloatArray,
    sight: FloatArray,
    cov: FloatArray,
    range_var: FloatArray,
) -> None:
    """Covariances of points, and variances of their slant ranges.

    Args:
        jacobians: What ``depend`` writes: ``(n, k, 3, s)`` and ``(n, k, 3, 2)``.
        errors: As ``loops.SharedErrors``; 0 for the elevation, which each point has its own of.
        elevation_var: ``(k,)``.
        pixel_var: ``(k,)`` of each coordinate.
        sight: ``(n, k, 3)`` unit vectors from the camera.
        cov: ``(n, k, 3, 3)``, written.
        range_var: ``(n, k)``, written.
    """
    shared, own = jacobians
    shared_cov, partners, count = errors
    cov[:], range_var[:] = 0.0, 0.0
    by = np.empty(shared.shape[3])
    for n in range(shared.shape[0]):
        of_image = shared_cov[n], partners, count
        for k in range(shared.shape[1]):
            unit = sight[n, k]
            _add_shared(shared[n, k], of_image, elevation_var[k], cov[n, k])
            for a in range(len(by)):
                by[a] = _along(shared[n, k], unit, a)
            range_var[n, k] = _range_variance(by, of_image, elevation_var[k])
            for b in range(2):
                p0, p1, p2 = own[n, k, 0, b], own[n, k, 1, b], own[n, k, 2, b]
                along = unit[0] * p0 + unit[1] * p1 + unit[2] * p2
                range_var[n, k] += pixel_var[k] * along * along
                for i in range(3):
                    cov[n, k, i, 0] += pixel_var[k] * own[n, k, i, b] * p0
                    cov[n, k, i, 1] += pixel_var[k] * own[n, k, i, b] * p1
                    cov[n, k, i, 2] += pixel_var[k] * own[n, k, i, b] * p2


@njit_late_inline
def _add_shared(
    shared: FloatArray, errors: tuple[FloatArray, IntArray, IntArray], elevation_var: float, cov: FloatArray
) -> None:
    """Add what the shared errors make of a point's covariance."""
    shared_cov, partners, count = errors
    for a in range(shared.shape[1]):
        var = elevation_var if a == _ELEVATION else 0.0
        s0, s1, s2 = var * shared[0, a], var * shared[1, a], var * shared[2, a]
        for at in range(count[a]):
            b = partners[a, at]
            c = shared_cov[a, b]
            if c != 0.0:
                s0 += c * shared[0, b]
                s1 += c * shared[1, b]
                s2 += c * shared[2, b]
        for i in range(3):
            cov[i, 0] += shared[i, a] * s0
            cov[i, 1] += shared[i, a] * s1
            cov[i, 2] += shared[i, a] * s2


@njit_late_inline
def _along(shared: FloatArray, unit: FloatArray, a: int) -> float:
    """Derivative of a slant range by one shared error; the camera's own place counts the other way."""
    by: float = unit[0] * shared[0, a] + unit[1] * shared[1, a] + unit[2] * shared[2, a]
    if a < _ROTATION:
        by -= unit[a - _POSITION]
    return by


@njit_late_inline
def _range_variance(by: FloatArray, errors: tuple[FloatArray, IntArray, IntArray], elevation_var: float) -> float:
    """Of a slant range with derivatives ``by (s,)``."""
    shared_cov, partners, count = errors
    total = 0.0
    for a in range(len(by)):
        row = 0.0
        for at in range(count[a]):
            b = partners[a, at]
            if shared_cov[a, b] != 0.0:
                row += shared_cov[a, b] * by[b]
        if a == _ELEVATION:
            row += elevation_var * by[a]
        total += by[a] * row
    return total


@njit_late
def joint_variances(
    gradient: tuple[FloatArray, FloatArray, FloatArray],
    points: tuple[FloatArray, FloatArray, IntArray],
    rays: tuple[FloatArray, FloatArray, IntArray],
    errors: tuple[FloatArray, IntArray, IntArray],
    own_var: FloatArray,
    out: FloatArray,
) -> None:
    """Variances of scalars that depend on several points and rays: shared errors add up before they are squared.

    Args:
        gradient: Derivatives of ``g`` scalars by the camera ``(n, g, 3)``, and by ``q`` directions and ``q`` points
            ``(n, g, q, 3)`` each.
        points: What ``depend`` writes of ``k`` points, ``(n, k, 3, s)`` and ``(n, k, 3, 2)``, and which of these the
            scalars depend on, ``(g, q)``.
        rays: The same of directions.
        errors: As ``loops.SharedErrors``; 0 for the elevation.
        own_var: ``(g, 2)`` of each one's elevation and pixels.
        out: ``(n, g)``, written.
    """
    by_camera, by_directions, by_points = gradient
    shared, own, columns = points
    ray_shared, ray_own, ray_columns = rays
    shared_cov, partners, count = errors
    total = np.zeros(shared.shape[3])
    for n in range(out.shape[0]):
        for g in range(out.shape[1]):
            for a in range(len(total)):
                total[a] = by_camera[n, g, a] if a < _ROTATION else 0.0
            variance = 0.0
            for q in range(by_points.shape[2]):
                k, r = columns[g, q], ray_columns[g, q]
                point = _add_along(by_points[n, g, q], shared[n, k], own[n, k], total)
                ray = _add_along(by_directions[n, g, q], ray_shared[n, r], ray_own[n, r], total)
                pixel_u, pixel_v = point[0] + ray[0], point[1] + ray[1]
                variance += own_var[g, 1] * (pixel_u * pixel_u + pixel_v * pixel_v)
            for a in range(len(total)):
                row = own_var[g, 0] * total[a] if a == _ELEVATION else 0.0
                for at in range(count[a]):
                    b = partners[a, at]
                    if shared_cov[n, a, b] != 0.0:
                        row += shared_cov[n, a, b] * total[b]
                variance += total[a] * row
            out[n, g] = variance


@njit_late_inline
def _add_along(by: FloatArray, shared: FloatArray, own: FloatArray, total: FloatArray) -> tuple[float, float]:
    """Add the shared errors' part of what depends on a point or ray; gives back the part of its own pixel."""
    pixel_u, pixel_v = 0.0, 0.0
    for i in range(3):
        if by[i] != 0.0:  # what is not used may miss the ground, with infinite derivatives
            for a in range(len(total)):
                total[a] += by[i] * shared[i, a]
            pixel_u += by[i] * own[i, 0]
            pixel_v += by[i] * own[i, 1]
    return pixel_u, pixel_v
