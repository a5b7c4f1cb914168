"""By how much a camera has turned between two images, from points that stand still and from some that do not.

RANSAC over pairs of bearings (Fischler and Bolles 1981; two bearings fix a rotation, as in TRIAD, Black 1964), then
least squares in pixels over what agrees. How far the points are does not matter to a camera that only turns.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.geometry.lens import distorted_with_jacobian, rays_by_intrinsics, rays_from_pixels
from aerodft.geometry.robust import robust_std
from aerodft.geometry.rotation import from_rotation_vector, matrix, multiply, skew
from aerodft.model import BoolArray, Camera, FloatArray

LEAST_POINTS: Final = 6

_TRIALS: Final = 400  # with half of all points strays, one trial in four is of two good ones
_STEPS: Final = 12
_STILL_RAD: Final = 1e-10
_CLOSE: Final = 0.02  # sine of the angle between two bearings that fix no roll
_CUT: Final = 3.5  # robust standard deviations of a coordinate
_LEAST_STD_PX: Final = 0.05  # no tracker is better on real images
_CUT_FLOOR_PX: Final = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """By how much a camera turned between two images, and how well that is known.

    Attributes:
        wxyz: ``(4,)`` ``later_SO3_earlier``: bearings in the earlier image, in camera axes, to those in the later one.
        cov: ``(3, 3)`` of a small rotation about the later camera's axes, from what is left of the points (rad^2).
        by_intrinsics: ``(3, m)``: that small rotation by errors of the intrinsics, see ``intrinsics_covariance``.
        agreeing: ``(n,)``: the points that it explains.
        off_px: ``(n, 2)`` seen minus explained; NaN where the camera should not see the point.
        std_px: Of one coordinate of an agreeing point.
    """

    wxyz: FloatArray
    cov: FloatArray
    by_intrinsics: FloatArray
    agreeing: BoolArray
    off_px: FloatArray
    std_px: float


def find_turn(
    camera: Camera, earlier_px: FloatArray, later_px: FloatArray, *, tolerance_px: float = 2.0
) -> Turn | None:
    """The rotation that explains most points; a function of its arguments alone.

    Args:
        camera: The camera.
        earlier_px: ``(n, 2)``.
        later_px: ``(n, 2)``, the same points.
        tolerance_px: What is farther off than this is no point that stands still.

    Returns:
        None where fewer than ``LEAST_POINTS`` agree on one, or they do not fix it.
    """
    earlier, later = _bearings(camera, earlier_px), _bearings(camera, later_px)
    usable = np.isfinite(earlier[:, 0] + later[:, 0])
    if np.count_nonzero(usable) < LEAST_POINTS:
        return None
    wxyz = _consensus(earlier[usable], later[usable], tolerance_px / camera.fx_px)
    if wxyz is None:
        return None
    return _refined(camera, earlier, np.where(usable[:, None], later_px, np.nan), wxyz, tolerance_px)


def rotated_pixels(camera: Camera, wxyz: FloatArray, pixels_px: FloatArray) -> FloatArray:
    """Where points seen at ``pixels_px (n, 2)`` are after ``later_SO3_earlier``; NaN where they are out of view.

    Args:
        camera: The camera.
        wxyz: ``(4,)``; or ``(k, 4)`` for ``(k, n, 2)`` pixels.
        pixels_px: In the earlier image.
    """
    return _expected(camera, _bearings(camera, pixels_px), wxyz)[0]


def _bearings(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    rays = rays_from_pixels(camera, pixels_px)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def _consensus(earlier: FloatArray, later: FloatArray, tolerance_rad: float) -> FloatArray | None:
    """The trial that leaves least, each point counting at most as much as the tolerance (MSAC)."""
    rng = np.random.default_rng(len(earlier))
    first = rng.integers(len(earlier), size=_TRIALS)
    second = (first + rng.integers(1, len(earlier), size=_TRIALS)) % len(earlier)
    frames = [_frame(side[first], side[second]) for side in (earlier, later)]
    apart = np.linalg.norm(np.cross(earlier[first], earlier[second]), axis=-1) > _CLOSE
    trials = frames[1] @ np.swapaxes(frames[0], -1, -2)
    left = np.sum(np.square(np.einsum("kij,nj->kni", trials, earlier) - later), axis=-1)
    cost = np.where(apart, np.sum(np.minimum(left, tolerance_rad**2), axis=-1), np.inf)
    best = int(np.argmin(cost))
    return _quaternion(trials[best]) if np.isfinite(cost[best]) else None


def _frame(first: FloatArray, second: FloatArray) -> FloatArray:
    """``(k, 3, 3)``: columns are orthonormal axes laid through two bearings, their middle first."""
    middle, across = first + second, np.cross(first, second)
    with np.errstate(invalid="ignore", divide="ignore"):  # twice the same bearing: its trial does not count
        middle = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
        across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    return np.asarray(np.nan_to_num(np.stack([middle, across, np.cross(middle, across)], axis=-1)))


def _quaternion(rotation: FloatArray) -> FloatArray:
    """Of a rotation matrix ``(3, 3)`` (Bar-Itzhack 2000: the largest eigenvector, regular everywhere)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    form = np.array([
        [xx + yy + zz, zy - yz, xz - zx, yx - xy],
        [zy - yz, xx - yy - zz, xy + yx, xz + zx],
        [xz - zx, xy + yx, yy - xx - zz, yz + zy],
        [yx - xy, xz + zx, yz + zy, zz - xx - yy],
    ])  # fmt: skip
    return np.asarray(np.linalg.eigh(form)[1][:, -1])


def _refined(
    camera: Camera, earlier: FloatArray, later_px: FloatArray, wxyz: FloatArray, tolerance_px: float
) -> Turn | None:
    """Gauss-Newton over the agreeing points, which are chosen anew at each step."""
    agreeing = np.zeros(len(earlier), dtype=np.bool_)
    for _ in range(_STEPS):
        expected_px, by_turn = _expected(camera, earlier, wxyz)
        agreeing = _agreeing(later_px - expected_px, tolerance_px)
        if np.count_nonzero(agreeing) < LEAST_POINTS:
            return None
        step = np.linalg.pinv(by_turn[agreeing].reshape(-1, 3)) @ (later_px - expected_px)[agreeing].ravel()
        wxyz = multiply(from_rotation_vector(np.asarray(step)), wxyz)
        if np.linalg.norm(step) < _STILL_RAD:
            break
    return _turn_of(camera, earlier, later_px, wxyz / np.linalg.norm(wxyz), agreeing)


def _turn_of(
    camera: Camera, earlier: FloatArray, later_px: FloatArray, wxyz: FloatArray, agreeing: BoolArray
) -> Turn | None:
    expected_px, by_turn = _expected(camera, earlier, wxyz)
    off_px, by = later_px - expected_px, by_turn[agreeing].reshape(-1, 3)
    variance = float(np.sum(np.square(off_px[agreeing]))) / (len(by) - 3)
    std_px = max(variance**0.5, _LEAST_STD_PX)
    information = by.T @ by
    if np.linalg.cond(information) > 1 / np.finfo(np.float64).eps:
        return None
    cov = std_px**2 * np.linalg.inv(information)
    by_lens = _by_intrinsics(camera, earlier[agreeing], wxyz)
    return Turn(wxyz, cov, -np.linalg.pinv(by) @ by_lens.reshape(len(by), -1), agreeing, off_px, std_px)


def _agreeing(off_px: FloatArray, tolerance_px: float) -> BoolArray:
    """What is no farther off than most; at most the tolerance."""
    distance = np.nan_to_num(np.max(np.abs(off_px), axis=-1), nan=np.inf)
    near = distance <= tolerance_px
    if not np.any(near):
        return np.asarray(near)
    spread = robust_std(off_px[near])
    return np.asarray(distance <= min(max(_CUT * spread, _CUT_FLOOR_PX), tolerance_px))


def _expected(camera: Camera, earlier: FloatArray, wxyz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels ``(..., 2)`` of bearings after a turn, and by a small further one ``(..., 2, 3)``."""
    rays = earlier @ np.swapaxes(matrix(wxyz), -1, -2)
    distorted, by_ray = distorted_with_jacobian(camera, rays)
    focal = np.array([camera.fx_px, camera.fy_px])
    by_turn = focal[:, None] * (by_ray @ -skew(rays))
    return distorted * focal + [camera.cx_px, camera.cy_px], by_turn


def _by_intrinsics(camera: Camera, earlier: FloatArray, wxyz: FloatArray) -> FloatArray:
    """Expected pixels by the intrinsics ``(n, 2, m)``, of points that were seen where they were: then, and now."""
    earlier_px = _expected(camera, earlier, np.array([1.0, 0.0, 0.0, 0.0]))[0]
    later_px = _expected(camera, earlier, wxyz)[0]
    rays_then, rays_now = rays_from_pixels(camera, earlier_px), rays_from_pixels(camera, later_px)
    rays = rays_then @ matrix(wxyz).T
    scale = np.linalg.norm(rays, axis=-1) / np.linalg.norm(rays_now, axis=-1)
    moved = matrix(wxyz) @ rays_by_intrinsics(camera, earlier_px)
    moved = moved - scale[:, None, None] * rays_by_intrinsics(camera, later_px)
    by_ray = distorted_with_jacobian(camera, rays)[1]
    return np.asarray(np.array([[camera.fx_px], [camera.fy_px]]) * (by_ray @ moved))
