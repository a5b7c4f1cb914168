"""Views of a board as arrays, and the joint least squares of a camera's intrinsics and all boards' poses.

Levenberg-Marquardt on the normal equations, with the poses eliminated (Schur's complement), as in Triggs et al.,
"Bundle adjustment: a modern synthesis" (2000). Board points are turned and moved into camera axes and projected with
``geometry.lens``, the very model that measures afterwards. A first guess needs nothing but the corners.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from aerodft.geometry import distorted_with_jacobian, pixels_by_intrinsics, rays_from_pixels, skew
from aerodft.model import Camera, CameraStd, FloatArray, IntArray, LensModel

_MAX_STEPS = 100
_SETTLED = 1e-12  # share by which the sum of squares may still fall
_DAMPING, _MIN_DAMPING, _MAX_DAMPING = 1e-3, 1e-12, 1e12
_EASIER, _HARDER = 0.1, 10.0
_FOCALS: Final = np.geomspace(0.25, 8.0, 16)
"""Focal lengths to start from, of the image's longer side: from a fisheye of 180 degrees to a tele lens of 7."""

_WIDEST: Final = np.cos(np.radians(75.0))
"""Rays farther from the axis are left out of a board's first pose: they hardly meet a plane in front of the camera."""

_MIN_CORNERS = 4  # corners that give a pose


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """The corners of a board in one image.

    Attributes:
        name: The image's.
        ids: ``(n,)`` which corners, row by row from 0.
        pixels_px: ``(n, 2)`` where they are seen.
        points_m: ``(n, 3)`` where they are on the board.
        edge_px: Width over which black turns to white; a sharp image has about 2.
    """

    name: str
    ids: IntArray
    pixels_px: FloatArray
    points_m: FloatArray
    edge_px: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """The corners of ``v`` views, one view after the other.

    Attributes:
        pixels_px: ``(n, 2)``.
        points_m: ``(n, 3)``.
        starts: ``(v,)`` where each view begins.
        view: ``(n,)`` of which view each corner is.
    """

    pixels_px: FloatArray
    points_m: FloatArray
    starts: IntArray
    view: IntArray

    @classmethod
    def from_views(cls, views: Sequence[View]) -> Self:
        """All corners of at least one view, none of them empty."""
        counts = np.array([len(view.ids) for view in views])
        return cls(
            np.concatenate([view.pixels_px for view in views]),
            np.concatenate([view.points_m for view in views]),
            np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
            np.repeat(np.arange(len(views)), counts).astype(np.int64),
        )

    def per_view(self, values: FloatArray) -> FloatArray:
        """Sums ``(v, ...)`` of ``(n, ...)`` over each view."""
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))


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
    for _ in range(_MAX_STEPS):
        normal = _normal_equations(found, corners, weights)
        settled = False
        while damping < _MAX_DAMPING:
            trial = _stepped(found, normal, damping)
            trial_squares = np.inf if trial is None else _squares(trial, corners, weights)
            if trial is not None and trial_squares <= squares:
                settled = squares - trial_squares <= _SETTLED * squares
                found, squares = trial, trial_squares
                damping = max(damping * _EASIER, _MIN_DAMPING)
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
        bundle: The adjusted bundle.
        corners: The corners that it was adjusted to.
        weights: ``(p,)`` of each intrinsic's own square in that adjustment; None for none.

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


def camera_guess(lens: LensModel, size_px: tuple[int, int], focal_px: float, coefficients: int) -> Camera:
    """An undistorted camera that looks through the image's centre, with so many coefficients of 0."""
    width, height = size_px
    camera = Camera.of_focal(name="guess", width_px=width, height_px=height, focal_px=focal_px, lens=lens)
    return with_coefficients(camera, coefficients)


def first_guesses(corners: Corners, lens: LensModel, size_px: tuple[int, int], coefficients: int) -> list[Bundle]:
    """Bundles to begin with, the best first; empty where no focal length sees all boards.

    Args:
        corners: What was seen.
        lens: Brown or fisheye.
        size_px: Width and height of the images.
        coefficients: Of the distortion; all are 0 in the guesses.
    """
    found = []
    for share in _FOCALS:
        guess = resected(camera_guess(lens, size_px, share * max(size_px), coefficients), corners)
        if guess is not None:
            found.append((float(np.sum(residuals_px(guess, corners) ** 2)), guess))
    found.sort(key=lambda each: each[0])
    return [guess for squares, guess in found if np.isfinite(squares)]


def resected(camera: Camera, corners: Corners) -> Bundle | None:
    """Where a camera sees its boards; None where it cannot see one of them."""
    rays = rays_from_pixels(camera, corners.pixels_px)
    rotations, translations = [], []
    for rows in np.split(np.arange(len(rays)), corners.starts[1:]):
        pose = _pose(rays[rows], corners.points_m[rows])
        if pose is None:
            return None
        rotations.append(pose[0])
        translations.append(pose[1])
    return Bundle(camera, np.array(rotations), np.array(translations))


def _pose(rays: FloatArray, points_m: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    ahead = rays[:, 2] > _WIDEST * np.linalg.norm(rays, axis=-1)  # no answer is not ahead either
    if np.count_nonzero(ahead) < _MIN_CORNERS:
        return None
    seen, places = rays[ahead, :2] / rays[ahead, 2:], points_m[ahead]
    middle = places.mean(axis=0)
    try:
        solved, turn, move = cv2.solvePnP(places - middle, seen, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    except cv2.error:  # corners along one line
        return None
    if not solved or not np.all(np.isfinite(turn)):
        return None
    rotation = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)
    return rotation, np.asarray(move[:, 0] - rotation @ middle, dtype=np.float64)


def reseated(bundle: Bundle, corners: Corners) -> Bundle:
    """The bundle with better poses where a board was taken for its mirror image in depth, as small ones are."""
    other = resected(bundle.camera, corners)
    if other is None:
        return bundle
    squares = [corners.per_view(np.sum(residuals_px(each, corners) ** 2, axis=-1)) for each in (bundle, other)]
    better = squares[1] < squares[0]
    return Bundle(
        bundle.camera,
        np.where(better[:, None, None], other.rotations, bundle.rotations),
        np.where(better[:, None], other.translations_m, bundle.translations_m),
    )
