"""Views of a board as arrays, and the joint least squares of a camera's intrinsics and all boards' poses.

The poses are eliminated from the normal equations (Schur's complement), as in Triggs et al., "Bundle adjustment: a
modern synthesis" (2000). Board points are turned and moved into camera axes and projected with
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
from calibration.descent import Residuals, covariance_of, descend

_POSE: Final = 6  # numbers of a board's pose
_FOCALS: Final = np.geomspace(0.25, 8.0, 16)
"""Focal lengths to start from, of the image's longer side: from a fisheye of 180 degrees to a tele lens of 7."""

_WIDEST: Final = np.cos(np.radians(75.0))
"""Rays farther from the axis are left out of a board's first pose: they hardly meet a plane in front of the camera."""

_MIN_CORNERS = 4  # corners that give a pose


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoardView:
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
    def from_views(cls, views: Sequence[BoardView]) -> Self:
        """The corners of all views, at least one view, none of them empty."""
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
    return descend(_Adjustment(bundle, corners, weights), bundle).state


class _Adjustment:
    """A task: corners, and weights of the intrinsics' squares, see ``adjust``."""

    def __init__(self, bundle: Bundle, corners: Corners, weights: FloatArray | None) -> None:
        self._corners = corners
        self._roots = np.zeros(len(intrinsics_of(bundle.camera))) if weights is None else np.sqrt(weights)
        ends = [*(2 * corners.starts).tolist(), 2 * len(corners.view)]
        self._views = tuple(map(slice, ends[:-1], ends[1:]))

    def evaluate(self, bundle: Bundle) -> Residuals:
        """Residuals in pixels, by the intrinsics and by each view's pose (its turn, its move)."""
        camera, count = bundle.camera, len(self._roots)
        turned, rays = _rays(bundle, self._corners)
        distorted, by_ray = distorted_with_jacobian(camera, rays)
        by_ray = by_ray * np.array([[camera.fx_px], [camera.fy_px]])
        by_own = pixels_by_intrinsics(camera, rays, distorted)
        by = np.concatenate([by_own, -by_ray @ skew(turned), by_ray], axis=-1).reshape(-1, count + _POSE)
        off = (_pixels(camera, distorted) - self._corners.pixels_px).ravel()
        values = np.append(off, self._roots * intrinsics_of(camera))
        by = np.concatenate([by, np.eye(count, count + _POSE) * self._roots[:, None]])
        return Residuals(values, by, np.full(len(values), -1), values, np.zeros(len(values)), self._views, _POSE)

    def moved(self, bundle: Bundle, step: FloatArray) -> Bundle | None:
        """The bundle after a step; None where it leads to no camera."""
        count = len(self._roots)
        poses = step[count:].reshape(-1, _POSE)
        try:
            camera = with_intrinsics(bundle.camera, intrinsics_of(bundle.camera) + step[:count])
        except ValueError:
            return None
        turn = Rotation.from_rotvec(poses[:, :3]).as_matrix()
        return Bundle(camera, turn @ bundle.rotations, bundle.translations_m + poses[:, 3:])


def covariance(bundle: Bundle, corners: Corners, weights: FloatArray | None = None) -> tuple[FloatArray, float]:
    """Covariance of the intrinsics, the poses being unknown.

    Args:
        bundle: The adjusted bundle.
        corners: The corners that it was adjusted to.
        weights: ``(p,)`` of each intrinsic's own square in that adjustment; None for none.

    Returns:
        ``(p, p)`` in the order of ``intrinsics_of``, scaled by the residuals' variance, and their std in px (of one
        coordinate). Infinite where the corners do not determine them.
    """
    rows = _Adjustment(bundle, corners, weights).evaluate(bundle)
    off = residuals_px(bundle, corners)
    spare = off.size - rows.jac_unknowns.shape[1] + _POSE - _POSE * len(rows.images)
    variance = float(np.sum(off * off)) / spare if spare > 0 else np.inf
    inverse = covariance_of(rows.normal(np.ones(len(rows.values))).reduced())
    return variance * (inverse + inverse.T) / 2, float(np.sqrt(variance))


def _rays(bundle: Bundle, corners: Corners) -> tuple[FloatArray, FloatArray]:
    """Points turned into camera axes, and moved there too, ``(n, 3)`` each."""
    turned = np.einsum("nij,nj->ni", bundle.rotations[corners.view], corners.points_m)
    return turned, turned + bundle.translations_m[corners.view]


def _pixels(camera: Camera, distorted: FloatArray) -> FloatArray:
    return np.asarray(distorted * [camera.fx_px, camera.fy_px] + [camera.cx_px, camera.cy_px])


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
        guess = resect_boards(camera_guess(lens, size_px, share * max(size_px), coefficients), corners)
        if guess is not None:
            found.append((float(np.sum(residuals_px(guess, corners) ** 2)), guess))
    found.sort(key=lambda each: each[0])
    return [guess for squares, guess in found if np.isfinite(squares)]


def resect_boards(camera: Camera, corners: Corners) -> Bundle | None:
    """Boards' poses in a camera; None where it cannot see one of them."""
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


def resolve_mirrored_boards(bundle: Bundle, corners: Corners) -> Bundle:
    """The bundle with better poses where a board was taken for its mirror image in depth, as small ones are."""
    other = resect_boards(bundle.camera, corners)
    if other is None:
        return bundle
    squares = [corners.per_view(np.sum(residuals_px(each, corners) ** 2, axis=-1)) for each in (bundle, other)]
    better = squares[1] < squares[0]
    return Bundle(
        bundle.camera,
        np.where(better[:, None, None], other.rotations, bundle.rotations),
        np.where(better[:, None], other.translations_m, bundle.translations_m),
    )
