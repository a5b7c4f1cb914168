"""Rotation of a camera between two images from tracked points, robust against points that move.

RANSAC over pairs of bearings (Fischler and Bolles 1981; two bearings fix a rotation, as in TRIAD, Black 1964), then
least squares in pixels over the inliers. The points' distances do not matter to a camera that only rotates.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.geometry.lens import distorted_with_jacobian, rays_by_intrinsics, rays_from_pixels
from aerodft.geometry.robust import robust_std
from aerodft.geometry.rotation import from_rotation_vector, matrix, multiply, skew
from aerodft.model import BoolArray, Camera, FloatArray

MIN_POINTS: Final = 6

_RANSAC_TRIALS: Final = 400  # with half of all points outliers, one pair in four is of two inliers
_MAX_ITERATIONS: Final = 12
_CONVERGED_RAD: Final = 1e-10
_MIN_BEARING_SINE: Final = 0.02  # two bearings closer than this do not fix the roll
_INLIER_STDS: Final = 3.5  # robust standard deviations of a coordinate
_MIN_STD_PX: Final = 0.05  # no tracker is better on real images
_MIN_INLIER_PX: Final = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class RelativeRotation:
    """Rotation of a camera between two images, with its covariance.

    Attributes:
        wxyz: ``(4,)`` ``later_SO3_earlier``: bearings in the earlier image, in camera axes, to those in the later one.
        cov: ``(3, 3)`` of a small rotation about the later camera's axes (rad^2), from the residuals.
        jac_intrinsics: ``(3, m)`` Jacobian of that small rotation by the intrinsics, see ``intrinsics_covariance``.
        inliers: ``(n,)`` whether the rotation explains the point.
        residual_px: ``(n, 2)`` observed minus predicted; NaN where the prediction is out of view.
        std_px: Of one coordinate of an inlier.
    """

    wxyz: FloatArray
    cov: FloatArray
    jac_intrinsics: FloatArray
    inliers: BoolArray
    residual_px: FloatArray
    std_px: float


def find_rotation(
    camera: Camera, earlier_px: FloatArray, later_px: FloatArray, *, tolerance_px: float = 2.0
) -> RelativeRotation | None:
    """The rotation with the most inliers; deterministic.

    Args:
        camera: The camera.
        earlier_px: ``(n, 2)``.
        later_px: ``(n, 2)``, the same points.
        tolerance_px: Largest residual of an inlier.

    Returns:
        None with fewer than ``MIN_POINTS`` inliers, or with inliers that do not determine the rotation.
    """
    earlier, later = _bearings(camera, earlier_px), _bearings(camera, later_px)
    visible = np.isfinite(earlier[:, 0] + later[:, 0])
    if np.count_nonzero(visible) < MIN_POINTS:
        return None
    wxyz = _best_trial(earlier[visible], later[visible], tolerance_px / camera.fx_px)
    if wxyz is None:
        return None
    return _refine(camera, earlier, np.where(visible[:, None], later_px, np.nan), wxyz, tolerance_px)


def rotated_pixels(camera: Camera, wxyz: FloatArray, pixels_px: FloatArray) -> FloatArray:
    """Pixels of points at ``pixels_px (n, 2)`` after the rotation ``later_SO3_earlier``; NaN where out of view.

    Args:
        camera: The camera.
        wxyz: ``(4,)``; or ``(k, 4)`` for ``(k, n, 2)`` pixels.
        pixels_px: In the earlier image.
    """
    return _predict(camera, _bearings(camera, pixels_px), wxyz)[0]


def _bearings(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    rays = rays_from_pixels(camera, pixels_px)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def _best_trial(earlier: FloatArray, later: FloatArray, tolerance_rad: float) -> FloatArray | None:
    """Quaternion of the trial with the least truncated squared error (MSAC); None if no pair fixes one."""
    rng = np.random.default_rng(len(earlier))
    first = rng.integers(len(earlier), size=_RANSAC_TRIALS)
    second = (first + rng.integers(1, len(earlier), size=_RANSAC_TRIALS)) % len(earlier)
    frames = [_frame(side[first], side[second]) for side in (earlier, later)]
    is_wide = np.linalg.norm(np.cross(earlier[first], earlier[second]), axis=-1) > _MIN_BEARING_SINE
    trials = frames[1] @ np.swapaxes(frames[0], -1, -2)
    residual = np.sum(np.square(np.einsum("kij,nj->kni", trials, earlier) - later), axis=-1)
    cost = np.where(is_wide, np.sum(np.minimum(residual, tolerance_rad**2), axis=-1), np.inf)
    best = int(np.argmin(cost))
    return _quaternion(trials[best]) if np.isfinite(cost[best]) else None


def _frame(first: FloatArray, second: FloatArray) -> FloatArray:
    """Orthonormal axes as columns ``(k, 3, 3)`` from two bearings, their bisector first."""
    middle, across = first + second, np.cross(first, second)
    with np.errstate(invalid="ignore", divide="ignore"):  # twice the same bearing: its trial does not count
        middle = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
        across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    return np.asarray(np.nan_to_num(np.stack([middle, across, np.cross(middle, across)], axis=-1)))


def _quaternion(rotation: FloatArray) -> FloatArray:
    """Quaternion of a rotation matrix ``(3, 3)`` (Bar-Itzhack 2000: the largest eigenvector, regular everywhere)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    form = np.array([
        [xx + yy + zz, zy - yz, xz - zx, yx - xy],
        [zy - yz, xx - yy - zz, xy + yx, xz + zx],
        [xz - zx, xy + yx, yy - xx - zz, yz + zy],
        [yx - xy, xz + zx, yz + zy, zz - xx - yy],
    ])  # fmt: skip
    return np.asarray(np.linalg.eigh(form)[1][:, -1])


def _refine(
    camera: Camera, earlier: FloatArray, later_px: FloatArray, wxyz: FloatArray, tolerance_px: float
) -> RelativeRotation | None:
    """Gauss-Newton over the inliers, which are chosen again at each step."""
    inliers = np.zeros(len(earlier), dtype=np.bool_)
    for _ in range(_MAX_ITERATIONS):
        predicted_px, by_turn = _predict(camera, earlier, wxyz)
        inliers = _find_inliers(later_px - predicted_px, tolerance_px)
        if np.count_nonzero(inliers) < MIN_POINTS:
            return None
        step = np.linalg.pinv(by_turn[inliers].reshape(-1, 3)) @ (later_px - predicted_px)[inliers].ravel()
        wxyz = multiply(from_rotation_vector(np.asarray(step)), wxyz)
        if np.linalg.norm(step) < _CONVERGED_RAD:
            break
    return _turn_from_inliers(camera, earlier, later_px, wxyz / np.linalg.norm(wxyz), inliers)


def _turn_from_inliers(
    camera: Camera, earlier: FloatArray, later_px: FloatArray, wxyz: FloatArray, inliers: BoolArray
) -> RelativeRotation | None:
    predicted_px, by_turn = _predict(camera, earlier, wxyz)
    residual_px, by = later_px - predicted_px, by_turn[inliers].reshape(-1, 3)
    variance = float(np.sum(np.square(residual_px[inliers]))) / (len(by) - 3)
    std_px = max(variance**0.5, _MIN_STD_PX)
    information = by.T @ by
    if np.linalg.cond(information) > 1 / np.finfo(np.float64).eps:
        return None
    cov = std_px**2 * np.linalg.inv(information)
    by_lens = _by_intrinsics(camera, earlier[inliers], wxyz)
    return RelativeRotation(wxyz, cov, -np.linalg.pinv(by) @ by_lens.reshape(len(by), -1), inliers, residual_px, std_px)


def _find_inliers(residual_px: FloatArray, tolerance_px: float) -> BoolArray:
    """Inliers: within some robust standard deviations of the points within the tolerance, and within it."""
    distance = np.nan_to_num(np.max(np.abs(residual_px), axis=-1), nan=np.inf)
    within = distance <= tolerance_px
    if not np.any(within):
        return np.asarray(within)
    std_px = robust_std(residual_px[within])
    return np.asarray(distance <= min(max(_INLIER_STDS * std_px, _MIN_INLIER_PX), tolerance_px))


def _predict(camera: Camera, earlier: FloatArray, wxyz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Predicted pixels ``(..., 2)`` of bearings after a rotation; Jacobian ``(..., 2, 3)`` by a further small one."""
    rays = earlier @ np.swapaxes(matrix(wxyz), -1, -2)
    distorted, by_ray = distorted_with_jacobian(camera, rays)
    focal = np.array([camera.fx_px, camera.fy_px])
    by_turn = focal[:, None] * (by_ray @ -skew(rays))
    return distorted * focal + [camera.cx_px, camera.cy_px], by_turn


def _by_intrinsics(camera: Camera, earlier: FloatArray, wxyz: FloatArray) -> FloatArray:
    """Jacobian ``(n, 2, m)`` of predicted pixels by the intrinsics, which both images have in common."""
    earlier_px = _predict(camera, earlier, np.array([1.0, 0.0, 0.0, 0.0]))[0]
    later_px = _predict(camera, earlier, wxyz)[0]
    rays_then, rays_now = rays_from_pixels(camera, earlier_px), rays_from_pixels(camera, later_px)
    rays = rays_then @ matrix(wxyz).T
    scale = np.linalg.norm(rays, axis=-1) / np.linalg.norm(rays_now, axis=-1)
    moved = matrix(wxyz) @ rays_by_intrinsics(camera, earlier_px)
    moved = moved - scale[:, None, None] * rays_by_intrinsics(camera, later_px)
    by_ray = distorted_with_jacobian(camera, rays)[1]
    return np.asarray(np.array([[camera.fx_px], [camera.fy_px]]) * (by_ray @ moved))
