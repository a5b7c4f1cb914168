"""Joint least squares of a camera's intrinsics and all boards' poses, and the intrinsics' covariance.

Levenberg-Marquardt on the normal equations, with the poses eliminated (Schur's complement), as in Triggs et al.,
"Bundle adjustment: a modern synthesis" (2000). Board points are turned and moved into camera axes and projected with
``geometry.lens``, the very model that measures afterwards.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from aerodft.geometry.intrinsics import pixels_by_intrinsics
from aerodft.geometry.lens import distorted_with_jacobian
from aerodft.geometry.rotation import skew
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera, CameraStd
from calibration.lens.views import Corners

_MOST_STEPS = 100
_SETTLED = 1e-12  # share by which the sum of squares may still fall
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-12, 1e12
_EASIER, _HARDER = 0.1, 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Bundle:
    """A camera, and where it sees ``v`` boards.

    Attributes:
        camera: The camera.
        rotations: ``(v, 3, 3)`` ``cam_SO3_board``.
        translations_m: ``(v, 3)`` of the board's first corner, in camera axes.
    """

    camera: Camera
    rotations: FloatArray
    translations_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    """The normal equations: intrinsics ``(p, p)``, with poses ``(v, p, 6)``, poses ``(v, 6, 6)``, right-hand sides."""

    own: FloatArray
    mixed: FloatArray
    poses: FloatArray
    own_right: FloatArray
    poses_right: FloatArray


def intrinsics_of(camera: Camera) -> FloatArray:
    """fx, fy, cx, cy and the distortion coefficients, ``(p,)``."""
    return np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *camera.distortion])


def with_intrinsics(camera: Camera, values: FloatArray) -> Camera:
    """The camera with other intrinsics ``(p,)``, in the order of ``intrinsics_of``; no std of it is kept.

    Raises:
        ValueError: A focal length that is not above 0.
    """
    fx, fy, cx, cy, *distortion = values.tolist()
    std = CameraStd(distortion=(1.0,) * len(distortion))  # asks the geometry for derivatives by all of them
    bare = replace(camera, covariance=(), std=CameraStd())
    return replace(bare, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, distortion=tuple(distortion), std=std)


def with_coefficients(camera: Camera, count: int) -> Camera:
    """The camera with so many distortion coefficients: its own, cut short or followed by zeros."""
    distortion = (*camera.distortion[:count], *[0.0] * (count - len(camera.distortion)))
    bare = replace(camera, covariance=(), std=CameraStd(), distortion=distortion)
    return with_intrinsics(bare, intrinsics_of(bare))


def residuals_px(bundle: Bundle, corners: Corners) -> FloatArray:
    """``(n, 2)`` projected less seen; NaN where the camera cannot see the point."""
    camera = bundle.camera
    distorted, _ = distorted_with_jacobian(camera, _rays(bundle, corners)[1])
    return _pixels(camera, distorted) - corners.pixels_px


def adjust(bundle: Bundle, corners: Corners, weights: FloatArray | None = None) -> Bundle:
    """The least sum of squared residuals near a guess that sees all corners.

    Args:
        bundle: The guess; its camera says how many distortion coefficients there are.
        corners: What was seen.
        weights: ``(p,)`` of each intrinsic's own square, in px^2, to keep down what corners hardly tell; None for none.
    """
    weights = np.zeros(len(intrinsics_of(bundle.camera))) if weights is None else weights
    found, squares, damping = bundle, _squares(bundle, corners, weights), _DAMPING
    for _ in range(_MOST_STEPS):
        normal = _normal_equations(found, corners, weights)
        settled = False
        while damping < _MOST_DAMPING:
            trial = _stepped(found, normal, damping)
            trial_squares = np.inf if trial is None else _squares(trial, corners, weights)
            if trial is not None and trial_squares <= squares:
                settled = squares - trial_squares <= _SETTLED * squares
                found, squares = trial, trial_squares
                damping = max(damping * _EASIER, _LEAST_DAMPING)
                break
            damping *= _HARDER
        else:
            break
        if settled:
            break
    return found


def _squares(bundle: Bundle, corners: Corners, weights: FloatArray) -> float:
    """What is made least; NaN where the camera cannot see a corner."""
    off = residuals_px(bundle, corners)
    return float(np.sum(off * off) + weights @ intrinsics_of(bundle.camera) ** 2)


def covariance(bundle: Bundle, corners: Corners, weights: FloatArray | None = None) -> tuple[FloatArray, float]:
    """How well the intrinsics are known, the poses being unknown.

    Args:
        bundle: As adjusted.
        corners: What it was adjusted to.
        weights: With what.

    Returns:
        ``(p, p)`` in the order of ``intrinsics_of``, scaled by the residuals' variance, and their std in px (of one
        coordinate). Infinite on the diagonal where the corners do not determine them.
    """
    weights = np.zeros(len(intrinsics_of(bundle.camera))) if weights is None else weights
    normal = _normal_equations(bundle, corners, weights)
    off = residuals_px(bundle, corners)
    spare = off.size - len(normal.own) - 6 * len(normal.poses)
    variance = float(np.sum(off * off)) / spare if spare > 0 else np.inf
    reduced, _ = _reduced(normal, 0.0)
    scale = np.sqrt(np.diag(reduced))
    if not np.all(scale > 0) or np.linalg.cond(reduced / np.outer(scale, scale)) > 1 / np.finfo(np.float64).eps:
        return np.diag(np.full(len(reduced), np.inf)), float(np.sqrt(variance))
    inverse = np.linalg.inv(reduced / np.outer(scale, scale)) / np.outer(scale, scale)
    return variance * (inverse + inverse.T) / 2, float(np.sqrt(variance))


def _rays(bundle: Bundle, corners: Corners) -> tuple[FloatArray, FloatArray]:
    """Points turned into camera axes, and moved there too, ``(n, 3)`` each."""
    turned = np.einsum("nij,nj->ni", bundle.rotations[corners.view], corners.points_m)
    return turned, turned + bundle.translations_m[corners.view]


def _pixels(camera: Camera, distorted: FloatArray) -> FloatArray:
    return np.asarray(distorted * [camera.fx_px, camera.fy_px] + [camera.cx_px, camera.cy_px])


def _normal_equations(bundle: Bundle, corners: Corners, weights: FloatArray) -> _Normal:
    camera = bundle.camera
    turned, rays = _rays(bundle, corners)
    distorted, by_ray = distorted_with_jacobian(camera, rays)
    by_ray = by_ray * np.array([[camera.fx_px], [camera.fy_px]])
    by_pose = np.concatenate([-by_ray @ skew(turned), by_ray], axis=-1)
    by_own = pixels_by_intrinsics(camera, rays, distorted)
    off = _pixels(camera, distorted) - corners.pixels_px
    return _Normal(
        own=np.einsum("nip,niq->pq", by_own, by_own) + np.diag(weights),
        mixed=corners.per_view(np.swapaxes(by_own, -1, -2) @ by_pose),
        poses=corners.per_view(np.swapaxes(by_pose, -1, -2) @ by_pose),
        own_right=-np.einsum("nip,ni->p", by_own, off) - weights * intrinsics_of(camera),
        poses_right=-corners.per_view(np.einsum("nip,ni->np", by_pose, off)),
    )


def _reduced(normal: _Normal, damping: float) -> tuple[FloatArray, FloatArray]:
    """The intrinsics' equations without the poses ``(p, p)``, and what each takes from a pose, ``(v, 6, p)``."""
    poses = normal.poses + damping * normal.poses * np.eye(6)
    taken = np.linalg.solve(poses, np.swapaxes(normal.mixed, -1, -2))
    own = normal.own + damping * np.diag(np.diag(normal.own))
    return np.asarray(own - np.einsum("vpi,viq->pq", normal.mixed, taken)), np.asarray(taken)


def _stepped(bundle: Bundle, normal: _Normal, damping: float) -> Bundle | None:
    """One damped step; None where it leads to no camera."""
    try:
        reduced, taken = _reduced(normal, damping)
        right = normal.own_right - np.einsum("vip,vi->p", taken, normal.poses_right)
        scale = 1 / np.sqrt(np.diag(normal.own) + np.finfo(np.float64).tiny)
        own = scale * np.linalg.solve(reduced * np.outer(scale, scale), scale * right)
        poses = normal.poses + damping * normal.poses * np.eye(6)
        moved = np.linalg.solve(poses, normal.poses_right[..., None])[..., 0] - taken @ own
        camera = with_intrinsics(bundle.camera, intrinsics_of(bundle.camera) + own)
    except (np.linalg.LinAlgError, ValueError):
        return None
    turn = Rotation.from_rotvec(moved[:, :3]).as_matrix()
    return Bundle(camera, turn @ bundle.rotations, bundle.translations_m + moved[:, 3:])
