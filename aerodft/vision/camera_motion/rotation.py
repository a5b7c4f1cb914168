"""How a camera over a plane turned from one image to the next, from points that are tracked between them.

Points are spread over an image and followed to the next one, as rays without distortion. The points of a plane move by
a homography, ``H ~ R + s n'``: the rotation, and the translation over the distance times the plane's normal (Hartley
and Zisserman, Multiple View Geometry, 13.1). Who knows the normal, from telemetry, reads the rotation off it without
the usual two-fold ambiguity. The homography with its covariance is all that is kept of an image pair, so that the
rotation can be asked for again under another normal.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import cv2
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import (
    from_rotation_vector,
    inverse,
    matrix,
    multiply,
    rays_with_jacobian,
    robust_std,
    skew,
    student_weights,
    to_rotation_vector,
    weighted_step,
)
from aerodft.model import Batch, BoolArray, Camera, FloatArray, ImageArray, IntArray
from aerodft.vision.common import UndistortedView, consensus_homography, track_lk

_WIDEST_TANGENT = 2.0  # farther from the axis a pixel says little about a plane ahead
_CELLS = (6, 8)  # rows and columns of the grid over which points are spread
_PER_CELL = 8
_QUALITY, _APART_PX = 0.005, 7
_PAUSE_NS = 19 * SECOND_NS // 100  # between images, long enough for what moves by itself to show
_MOVED = 0.06  # of the width: a view that moves by more in this time is looked at more often
FREE = 8
"""Parameters of a homography of which the last element is 1, row by row."""

_ITERATIONS = 5
FEWEST = 30
"""Points that a homography is made of, at least."""

STRAY_PX = 0.5
"""A point that is farther off lies on something else: water that flows, a tree, a walker."""

_NOISE_PX = 0.05  # what tracking is never better than
_DRAWS, _CONFIDENCE = 500, 0.999
_ROUNDS = 4
_STUDENT = 5.0  # degrees of freedom of the residuals' t distribution
_LAYERS = 2
_NEAR_PX = 0.6  # of what a motion foretells: water that flows by a pixel is told from land
_LAYER_DRAWS = 150
_LEAST_SHARE = 0.2  # of a pair's points: smaller groups are strays
_POINTS = 3  # that give a motion
_LAYER_ROUNDS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matches(Batch):
    """Points matched between two images, as rays of both.

    Attributes:
        earlier: ``(n, 2)`` rays at unit depth in the earlier camera's axes.
        later: ``(n, 2)`` rays of these points in the later camera's axes.
        px: ``(n,)`` size of a tracked pixel in the later one, in the same unit.
    """

    earlier: FloatArray
    later: FloatArray
    px: FloatArray

    def __len__(self) -> int:
        return len(self.px)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImagePair:
    """Two images by their stamps, and the points that were followed from one to the other."""

    start_ns: int
    end_ns: int
    matches: Matches


def matches_of(camera: Camera, earlier_px: FloatArray, later_px: FloatArray, shrink: float = 1.0) -> Matches:
    """Pixels ``(n, 2)`` of both images as matches; those far from the axis are left out.

    Args:
        camera: The camera.
        earlier_px: In the earlier image.
        later_px: In the later one.
        shrink: How many pixels make one of the images in which they were tracked.
    """
    rays = rays_with_jacobian(camera, np.stack([earlier_px, later_px]))
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = rays.rays_cam[..., 2]
        flat = rays.rays_cam[..., :2] / depth[..., None]
        jac_px = (rays.jac_px[..., :2, :] - flat[..., None] * rays.jac_px[..., 2:, :]) / depth[..., None, None]
        usable = np.all((depth > 0) & (np.linalg.norm(flat, axis=-1) < _WIDEST_TANGENT), axis=0)
    px = np.sqrt(np.abs(np.linalg.det(jac_px[1][usable]))) * shrink
    return Matches(earlier=flat[0][usable], later=flat[1][usable], px=px)


class PlaneTracker:
    """Matches between successive images.

    Args:
        camera: The camera whose images come.
    """

    def __init__(self, camera: Camera) -> None:
        self.pairs: list[ImagePair] = []
        self._camera = camera
        self._view = UndistortedView(camera)
        self._last: tuple[int, ImageArray] | None = None
        self._pause_ns = _PAUSE_NS

    def add(self, stamp_ns: int, pixels: Callable[[], ImageArray]) -> None:
        """Follow points into this image, if it is time for one.

        Args:
            stamp_ns: Its stamp, after that of the one before.
            pixels: Gives ``(h, w, 3)`` uint8 BGR.
        """
        if self._last is not None and stamp_ns - self._last[0] < self._pause_ns:
            return
        grey = self._view.small(pixels())
        if self._last is not None:
            self._follow(*self._last, stamp_ns, grey)
        self._last = (stamp_ns, grey)

    def _follow(self, start_ns: int, before: ImageArray, end_ns: int, after: ImageArray) -> None:
        corners = _corners(before)
        there, found = track_lk(before, after, corners, corners)
        earlier, later = corners[found], there[found]
        moved_px = float(np.median(np.linalg.norm(later - earlier, axis=-1))) if len(later) else np.inf
        share = moved_px / (_MOVED * before.shape[1]) * (_PAUSE_NS / (end_ns - start_ns))
        self._pause_ns = round(_PAUSE_NS / max(share, 1.0))
        earlier_px, later_px = self._view.to_full(earlier), self._view.to_full(later)
        matches = matches_of(self._camera, earlier_px, later_px, self._view.shrink)
        self.pairs.append(ImagePair(start_ns=start_ns, end_ns=end_ns, matches=matches))


def _corners(grey: ImageArray) -> FloatArray:
    """Corners ``(n, 2)``, the best of each cell of a grid."""
    rows, columns = (
        np.linspace(0, side, n + 1).astype(int).tolist() for side, n in zip(grey.shape, _CELLS, strict=True)
    )
    found = [np.empty((0, 2))]
    for (top, bottom), (left, right) in product(pairwise(rows), pairwise(columns)):
        corners = cv2.goodFeaturesToTrack(grey[top:bottom, left:right], _PER_CELL, _QUALITY, _APART_PX)
        if corners is not None:
            found.append(np.asarray(corners[:, 0], dtype=np.float64) + [left, top])
    return np.concatenate(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaneMotion:
    """Homographies between pairs of images, of rays in camera axes.

    Attributes:
        start_ns: ``(n,)`` stamps of the pairs' earlier images.
        end_ns: ``(n,)`` stamps of the later ones.
        homography: ``(n, 3, 3)``: from rays in the earlier camera to rays in the later one; last element 1.
        cov: ``(n, 8, 8)`` covariance of the other elements, row by row.
    """

    start_ns: IntArray
    end_ns: IntArray
    homography: FloatArray
    cov: FloatArray

    def __len__(self) -> int:
        return len(self.start_ns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turns:
    """Rotations of a camera from image to image.

    Attributes:
        rotvec_rad: ``(n, 3)`` ``earlier_SO3_later``: angular rate in camera axes times the time between the images.
        cov_rad2: ``(n, 3, 3)``.
        chi2: ``(n,)`` misfit of the homography to a plane with this normal; 2 degrees of freedom.
    """

    rotvec_rad: FloatArray
    cov_rad2: FloatArray
    chi2: FloatArray


def turns_over_plane(motion: PlaneMotion, normal_cam: FloatArray, guess_rotvec_rad: FloatArray) -> Turns:
    """The rotation of each pair, by Gauss-Newton, whatever the translation was.

    Args:
        motion: ``n`` pairs.
        normal_cam: ``(n, 3)`` the plane's unit normal in the earlier camera's axes.
        guess_rotvec_rad: ``(n, 3)`` where to start; zeros will do for what a camera turns between two images.
    """
    seen = motion.homography.reshape(-1, 9)[:, :FREE]
    information = np.asarray(np.linalg.inv(motion.cov), dtype=np.float64)
    turn = from_rotation_vector(guess_rotvec_rad)
    shift = np.zeros((len(motion), 3))
    for _ in range(_ITERATIONS):
        back = matrix(inverse(turn))
        whole = back + shift[:, :, None] * normal_cam[:, None, :]
        jac = _derivatives(whole, back, normal_cam)
        off = seen - (whole.reshape(-1, 9) / whole[:, 2, 2, None])[:, :FREE]
        weighted = np.swapaxes(jac, -1, -2) @ information
        step = np.asarray(np.linalg.solve(weighted @ jac, weighted @ off[..., None]), dtype=np.float64)[..., 0]
        turn = multiply(turn, from_rotation_vector(step[:, :3]))
        shift = shift + step[:, 3:]
    left = off - np.einsum("nij,nj->ni", jac, step)
    return Turns(
        rotvec_rad=to_rotation_vector(turn),
        cov_rad2=np.asarray(np.linalg.inv(weighted @ jac), dtype=np.float64)[:, :3, :3],
        chi2=np.einsum("ni,nij,nj->n", left, information, left),
    )


def _derivatives(whole: FloatArray, back: FloatArray, normal_cam: FloatArray) -> FloatArray:
    """``(n, 8, 6)`` of the free elements, by a turn in the later camera's axes and by the shift."""
    by = np.zeros((len(whole), 3, 3, 6))
    by[..., :3] = np.swapaxes(skew(np.swapaxes(back, -1, -2)), 1, 2)
    for axis in range(3):
        by[:, axis, :, 3 + axis] = normal_cam
    last = whole[:, 2, 2, None, None, None]
    scaled = by / last - whole[..., None] * by[:, 2, 2, None, None, :] / last**2
    return scaled.reshape(-1, 9, 6)[:, :FREE]


def plane_motion(pairs: Iterable[ImagePair]) -> PlaneMotion:
    """The homography that most points of each pair follow; pairs without one are left out."""
    fits = []
    for pair in pairs:
        start = _consensus(pair.matches)
        if start is not None:
            near = _off_px(start, pair.matches) < 2 * STRAY_PX
            if np.count_nonzero(near) >= FEWEST:
                fits.append((pair, pair.matches.rows(near), start))
    return motion_of(fits)


def motion_of(fits: Sequence[tuple[ImagePair, Matches, FloatArray]]) -> PlaneMotion:
    """Maximum-likelihood homographies, under t-distributed errors.

    Args:
        fits: Pairs, those of their points that move together, and about what homography they follow.
    """
    found = [_refine_homography(start, matches) for _, matches, start in fits]
    return PlaneMotion(
        start_ns=np.array([pair.start_ns for pair, _, _ in fits], dtype=np.int64),
        end_ns=np.array([pair.end_ns for pair, _, _ in fits], dtype=np.int64),
        homography=np.array([homography for homography, _ in found]).reshape(-1, 3, 3),
        cov=np.array([cov for _, cov in found]).reshape(-1, FREE, FREE),
    )


def _consensus(matches: Matches) -> FloatArray | None:
    if len(matches) < FEWEST:
        return None
    stray = STRAY_PX * float(np.median(matches.px))
    consensus = consensus_homography(matches.earlier, matches.later, stray, _DRAWS, _CONFIDENCE)
    return None if consensus is None else consensus[0]


def _off_px(homography: FloatArray, matches: Matches) -> FloatArray:
    at, _ = _apply_with_jacobian(homography, matches.earlier)
    return np.asarray(np.linalg.norm(at - matches.later, axis=-1) / matches.px)


def _refine_homography(h: FloatArray, matches: Matches) -> tuple[FloatArray, FloatArray]:
    """The homography ``(3, 3)``, and the covariance ``(8, 8)`` of its free elements."""
    for _ in range(_ROUNDS):
        at, by = _apply_with_jacobian(h, matches.earlier)
        off_px = (matches.later - at) / matches.px[:, None]
        std_px = max(robust_std(off_px), _NOISE_PX)
        weight = student_weights(np.sum(off_px**2, axis=-1) / std_px**2, 2, _STUDENT)
        step, information = weighted_step(by / matches.px[:, None, None], off_px, weight)
        h = h + np.append(step, 0.0).reshape(3, 3)
    return h, np.asarray(np.linalg.inv(information), dtype=np.float64) * std_px**2


def _apply_with_jacobian(h: FloatArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points ``(n, 2)`` under a homography, and their derivatives ``(n, 2, 8)`` by its free elements."""
    one = np.column_stack([xy, np.ones(len(xy))])
    moved = one @ h.T
    at = moved[:, :2] / moved[:, 2:]
    by = np.zeros((len(xy), 2, 9))
    by[:, 0, :3] = by[:, 1, 3:6] = one / moved[:, 2:]
    by[:, :, 6:] = -at[:, :, None] * (one / moved[:, 2:])[:, None, :]
    return at, by[..., :FREE]


def layered_motion(pairs: Sequence[ImagePair], rotvec_rad: FloatArray, normal_cam: FloatArray) -> PlaneMotion:
    """Homographies of one or two layers that move alike in each pair; none where nothing does.

    Args:
        pairs: ``n`` image pairs.
        rotvec_rad: ``(n, 3)`` about how the camera turned, ``earlier_SO3_later``.
        normal_cam: ``(n, 3)`` the plane's normal in the earlier camera's axes.
    """
    draws = np.random.default_rng(0)
    fits: list[tuple[ImagePair, Matches, FloatArray]] = []
    for pair, turn, normal in zip(pairs, rotvec_rad, normal_cam, strict=True):
        back = matrix(inverse(from_rotation_vector(turn)))
        left = pair.matches
        fewest = max(FEWEST, _LEAST_SHARE * len(left))
        for _ in range(_LAYERS):
            found = _layer(left, back, normal, draws) if len(left) >= fewest else None
            if found is None or np.count_nonzero(found[0]) < fewest:
                break
            fits.append((pair, left.rows(found[0]), found[1]))
            left = left.rows(~found[0])
    return motion_of(fits)


def _layer(
    matches: Matches, back: FloatArray, normal_cam: FloatArray, draws: np.random.Generator
) -> tuple[BoolArray, FloatArray] | None:
    """The largest group that one motion explains ``(n,)``, and its homography ``(3, 3)``."""
    jac, off = _equations(matches, back, normal_cam)
    picks = draws.integers(0, len(matches), (_LAYER_DRAWS, _POINTS))
    system, right = jac[picks].reshape(_LAYER_DRAWS, 6, 6), off[picks].reshape(_LAYER_DRAWS, 6, 1)
    whole = np.abs(np.linalg.det(system)) > 0
    if not np.any(whole):
        return None
    motions = np.linalg.solve(system[whole], right[whole])[..., 0]
    misfit = np.einsum("pij,dj->dpi", jac, motions) - off
    near = np.sum(misfit**2, axis=-1) < _NEAR_PX**2
    best = int(np.argmax(np.sum(near, axis=1)))
    group, motion = near[best], motions[best]
    for _ in range(_LAYER_ROUNDS):
        if np.count_nonzero(group) < FEWEST:
            return None
        motion = np.linalg.lstsq(jac[group].reshape(-1, 6), off[group].ravel(), rcond=None)[0]
        group = np.sum((jac @ motion - off) ** 2, axis=-1) < _NEAR_PX**2
    homography = (np.eye(3) - skew(motion[:3])) @ back + np.outer(motion[3:], normal_cam)
    return group, homography / homography[2, 2]


def _equations(matches: Matches, back: FloatArray, normal_cam: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``(n, 2, 6)`` and ``(n, 2)``, in pixels: linear in a turn in the later camera's axes, and in the shift."""
    one = np.ones(len(matches))
    rays = np.column_stack([matches.earlier, one])
    turned = rays @ back.T
    by = np.concatenate([skew(turned), (rays @ normal_cam)[:, None, None] * np.eye(3)], axis=-1)
    scale = (matches.px * turned[:, 2])[:, None]
    jac = (by[:, :2] - matches.later[..., None] * by[:, 2:]) / scale[..., None]
    return jac, (matches.later * turned[:, 2:] - turned[:, :2]) / scale
