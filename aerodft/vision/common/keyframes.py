"""Images that others are held against: where from, their corners, and whether a later view still shows them.

How a plane's homography between two of them may be off is told as small changes of it, with their covariance. A
homography ``h`` that is off by ``d`` is ``(1 + d) h``, with ``d[2, 2] = 0``: eight numbers, in units of the lens (focal
lengths around the principal point), so that all of them are of about the same size.

Telemetry is off by more than images are, but what it is off by changes slowly; water leaves the place where it was at
its own speed. So it takes a second or two to tell whether points lie still, and until it is told they may be either.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from aerodft.geometry import Ground, in_image, matrix, rays_from_pixels
from aerodft.model import (
    BoolArray,
    Camera,
    FloatArray,
    Image,
    ImageArray,
    IntArray,
    Pose,
    PoseSample,
    Status,
    read_only,
)
from aerodft.vision.common.tracking import UndistortedView

FREE: Final = 8
"""Numbers that a homography is known by."""

_TURN_RAD: Final = 0.026  # what telemetry may be off by between two images: 1.5 degrees, ...
_MOVE_SHARE: Final = 0.05  # ... this share of the height, ...
_ZOOM_SHARE: Final = 0.01  # ... this share of the focal length; ...
_SLOPE_RAD: Final = 0.026  # ... and the plane may be that far from level, or the horizon from where it is said to be
_FLAT: Final = 1e-4  # no plane is flatter, no lens model better, in units of the lens
_EYE: Final = read_only(np.eye(3))
_LEAST_DOWN: Final = 1e-3

PoseOf = Callable[[Image], PoseSample | None]
_JITTER_RAD: Final = 0.002  # what telemetry is off by anew in every image, ...
_DRIFT_RADPS: Final = 0.0025  # ... by how much that changes in a second, ...
_DRIFT_MPS: Final = 0.1  # ... and the same of its position, ...
_DRIFT_S: Final = 12.0  # ... for no longer than this
_STAMP_OFFSET_S: Final = 0.1  # it may be early or late by so much, always by the same
_FLOW_MPS: Final = 1.0  # of water, in each direction
_COMMIT_S: Final = 1.0  # evidence of so long is remembered, and new evidence begun
_SURE: Final = 10.0  # log odds: no evidence is beyond doubt
LAND_AT_FIRST: Final = 0.85
"""Log odds that clicked points are on land, before anything has moved: 70 of 100."""
LAND_AS_BEFORE: Final = 3.0
"""Log odds, at most, that points of a new keyframe are on land because those of the one before were."""
FEWEST: Final = 12
"""Points that an image is held by, at least."""

MOST_CORNERS: Final = 160
_CELLS: Final = 8  # of the grid over which they are spread, along each side
_QUALITY: Final = 0.01
_APART_PX: Final = 6
_NEAR_PX: Final = 48.0  # of a probe ...
_MOST_NEAR: Final = 12  # ... that many in a cell
_MARGIN_PX: Final = 12.5
_SCALES: Final = (0.7, 1.45)  # a template that is seen larger or smaller than that looks different


@dataclass(frozen=True, slots=True, eq=False)
class PlanePose:
    """A camera over a plane, as telemetry has it.

    Attributes:
        lens: ``(3, 3)`` intrinsics of straight small pixels, as far as the camera is zoomed.
        rotation: ``(3, 3)`` ``enu_SO3_cam``.
        place_m: ``(3,)`` east, north, and up from the plane, which is above 0.
    """

    lens: FloatArray
    rotation: FloatArray
    place_m: FloatArray

    def from_plane(self) -> FloatArray:
        """``(3, 3)`` homography from east and north on the plane to straight small pixels."""
        plane = np.eye(3)
        plane[:, 2] = -self.place_m
        return np.asarray(self.lens @ self.rotation.T @ plane)

    def onto(self, later: "PlanePose") -> FloatArray:
        """``(3, 3)`` homography from this one's straight small pixels to those of a later one."""
        return np.asarray(later.from_plane() @ np.linalg.inv(self.from_plane()))


def predicted_cov(then: PlanePose, now: PlanePose, unit: FloatArray) -> FloatArray:
    """Covariance ``(8, 8)`` of what telemetry makes of the homography from one plane pose to another.

    Camera and plane are what they are, so a homography is off in nine ways only: turned, moved, zoomed, tilted. Few
    points along one bank tell these nearly as well as many all around tell its eight elements.

    Args:
        then: The earlier one.
        now: The later one.
        unit: ``(3, 3)`` intrinsics that the elements are in units of.
    """
    up_now, up_then = now.rotation[2], then.rotation[2]
    turned = now.rotation.T @ then.rotation
    moved = now.rotation.T @ (then.place_m - now.place_m) / then.place_m[2]
    back = np.linalg.inv(turned - np.outer(moved, up_then))
    ways = [_TURN_RAD * np.cross(_EYE, axis) for axis in _EYE]
    ways += [_MOVE_SHARE * np.outer(axis, up_now) for axis in _EYE]
    ways += [np.diag([_ZOOM_SHARE, _ZOOM_SHARE, 0.0])]
    ways += [_SLOPE_RAD * np.outer(moved, axis) @ back for axis in then.rotation[:2]]
    to_unit = np.linalg.inv(unit) @ now.lens
    columns = np.stack([_free(to_unit @ way @ np.linalg.inv(to_unit)) for way in ways], axis=-1)
    return np.asarray(columns @ columns.T + np.eye(FREE) * _FLAT**2)


def compose_cov(cov: FloatArray, by: FloatArray, unit: FloatArray) -> FloatArray:
    """Covariance ``(8, 8)`` of a homography after another one ``(3, 3)`` that is exact."""
    inside = np.linalg.inv(unit) @ by @ unit
    whole = np.kron(inside, np.linalg.inv(inside).T)  # of all nine elements, row by row
    turn = whole[:, :FREE] - np.outer(_EYE.ravel(), whole[FREE, :FREE])
    return np.asarray(turn[:FREE] @ cov @ turn[:FREE].T)


def by_elements(unit: FloatArray, at_px: FloatArray) -> FloatArray:
    """Derivatives ``(..., 2, 8)`` in pixels of where a homography carries a point to: to ``at_px (..., 2)``."""
    focal, centre = np.array([unit[0, 0], unit[1, 1]]), unit[:2, 2]
    at = (at_px - centre) / focal
    one = np.concatenate([at, np.ones((*at.shape[:-1], 1))], axis=-1)
    by = np.zeros((*at.shape[:-1], 2, FREE))
    by[..., 0, :3] = by[..., 1, 3:6] = one
    by[..., :, 6:] = -at[..., :, None] * at[..., None, :]
    return np.asarray(by * focal[:, None])


def place_cov_px2(cov: FloatArray, unit: FloatArray, at_px: FloatArray) -> FloatArray:
    """Covariance ``(..., 2, 2)`` of where a homography carries points to: to ``at_px (..., 2)``."""
    by = by_elements(unit, at_px)
    return np.asarray(by @ cov @ np.swapaxes(by, -1, -2))


def shift_cov(std_px: float, unit: FloatArray) -> FloatArray:
    """Covariance ``(8, 8)`` of a homography that is off by a common step of this std in each coordinate."""
    cov = np.zeros((FREE, FREE))
    cov[2, 2], cov[5, 5] = (std_px / unit[0, 0]) ** 2, (std_px / unit[1, 1]) ** 2
    return cov


def apply_change(homography: FloatArray, by: FloatArray, unit: FloatArray) -> FloatArray:
    """A homography ``(3, 3)`` that is off by these eight elements; in front of the camera stays in front of it."""
    change = np.append(by, 0.0).reshape(3, 3)
    moved = unit @ (_EYE + change) @ np.linalg.inv(unit) @ homography
    return np.asarray(moved / np.linalg.norm(moved))


def change_between(homography: FloatArray, other: FloatArray, unit: FloatArray) -> FloatArray:
    """Differences of eight elements between another homography and a first one."""
    ratio = np.linalg.inv(unit) @ other @ np.linalg.inv(homography) @ unit
    return _free(ratio / ratio[2, 2] - _EYE)


def _free(change: FloatArray) -> FloatArray:
    """The eight elements ``(8,)`` of a change ``(3, 3)``; what is common to all of the diagonal changes nothing."""
    return np.asarray((change - change[2, 2] * _EYE).ravel()[:FREE])


@dataclass(frozen=True, slots=True)
class ImagePose:
    """A pose, and by how much the camera is zoomed."""

    pose: Pose
    magnification: float


class PlanePoses:
    """Poses over the plane, from those in ENU.

    Args:
        camera: The camera.
        view: Its small images.
        pose_of: The pose at an image's stamp, about; None where it is not known.
        elevation_m: Of the plane above ENU 0; None until it is known.
    """

    def __init__(self, camera: Camera, view: UndistortedView, pose_of: PoseOf, elevation_m: float | None = 0.0) -> None:
        self.elevation_m = elevation_m
        self._camera, self._view, self._pose_of = camera, view, pose_of
        self._zoomed: dict[int, tuple[float, UndistortedView]] = {}

    def image_pose(self, image: Image) -> ImagePose | None:
        """Pose and magnification of an image; None where they are not known."""
        sample = self._pose_of(image)
        if sample is None or sample.pose is None or sample.status is not Status.OK:
            return None
        return ImagePose(sample.pose, 1.0 if sample.zoom is None else sample.zoom.magnification)

    def view_of(self, seen: ImagePose | None) -> UndistortedView:
        """Undistorted view at the last known zoom, where zooming changes what the lens bends."""
        if seen is not None:
            return self.zoomed(self._view, seen)
        return self._zoomed[id(self._view)][1] if id(self._view) in self._zoomed else self._view

    def zoomed(self, view: UndistortedView, seen: ImagePose) -> UndistortedView:
        """A view as the camera is zoomed."""
        known = self._zoomed.get(id(view), (1.0, view))
        if known[0] != seen.magnification:
            known = seen.magnification, view.zoomed(seen.magnification)
        self._zoomed[id(view)] = known
        return known[1]

    def plane_pose(self, seen: ImagePose | None) -> PlanePose | None:
        """Pose of an image over the plane; None where the pose, or the plane's height, is not known."""
        if seen is None or self.elevation_m is None or not seen.pose.position_enu_m[2] > self.elevation_m:
            return None
        lens = self._view.intrinsics.copy()
        lens[0, 0] *= seen.magnification
        lens[1, 1] *= seen.magnification
        place_m = seen.pose.position_enu_m - np.array([0.0, 0.0, self.elevation_m])
        return PlanePose(lens, matrix(seen.pose.wxyz), place_m)

    def find_plane(self, seen: ImagePose, pixel: FloatArray, ground: Ground | None, elevation_m: float) -> None:
        """Find the plane's height at a pixel ``(2,)``, which is on the ground or so high above it.

        It stays unknown where the pixel shows no ground, or the camera is below it.
        """
        ray = rays_from_pixels(self._camera.zoomed(seen.magnification, 0.0), pixel)
        down = ray @ matrix(seen.pose.wxyz).T
        if ground is not None:
            hit = ground.meet(seen.pose.position_enu_m, down, elevation_m)
            if hit.status:
                return
            elevation_m = float(hit.points_enu_m[2])
        elif not down[2] < -_LEAST_DOWN:
            return
        if seen.pose.position_enu_m[2] > elevation_m:
            self.elevation_m = elevation_m


@dataclass(frozen=True, slots=True, eq=False)
class GroundDrift:
    """Drift of points over the plane that they were taken to lie on.

    Attributes:
        time_s: When.
        by_m: ``(2,)`` east and north of where telemetry sees them, from where it saw them in their keyframe.
        px_by_m: ``(2, 2)`` derivative of their pixels by east and north.
        sweep_mps: ``(2,)`` how fast the line of sight there sweeps over the ground.
        focal_px: The image's focal length.
    """

    time_s: float
    by_m: FloatArray
    px_by_m: FloatArray
    sweep_mps: FloatArray
    focal_px: float

    @property
    def px(self) -> float:
        """Length of the drift in pixels."""
        return float(np.linalg.norm(self.px_by_m @ self.by_m))


class Stillness:
    """Evidence that some points of a keyframe lie still.

    Args:
        time_s: Of the keyframe.
        log_odds: That they lie still, by then.
    """

    def __init__(self, time_s: float, log_odds: float) -> None:
        self.log_odds = log_odds
        self._begun_s = time_s
        self._since_s, self._by_m = time_s, np.zeros(2)
        self._sweep_mps: FloatArray | None = None
        self._last: GroundDrift | None = None

    def again(self) -> "Stillness":
        """A fresh start for other points of the keyframe, of which nothing is known yet."""
        return Stillness(self._begun_s, LAND_AT_FIRST)

    def with_evidence(self, drift: GroundDrift) -> float:
        """The log odds that they lie still, with what an image says of them."""
        elapsed_s = drift.time_s - self._since_s
        still2 = self._still_px(drift) ** 2
        flowing2 = still2 + (_FLOW_MPS * elapsed_s) ** 2 * abs(float(np.linalg.det(drift.px_by_m)))
        step = drift.px_by_m @ (drift.by_m - self._by_m)
        gain = math.log(flowing2 / still2) - float(step @ step) / 2 * (1 / still2 - 1 / flowing2)
        return float(np.clip(self.log_odds + gain, -_SURE, _SURE))

    def remember(self, drift: GroundDrift) -> bool:
        """Take an image's evidence for good, once there is enough of it; whether there was."""
        if self._sweep_mps is None:
            self._sweep_mps = drift.sweep_mps
        self._last = drift
        if abs(drift.time_s - self._since_s) < _COMMIT_S:
            return False
        self.log_odds = self.with_evidence(drift)
        self._since_s, self._by_m, self._sweep_mps = drift.time_s, drift.by_m, drift.sweep_mps
        return True

    @property
    def is_watched(self) -> bool:
        """Whether telemetry has said anything of them yet."""
        return self._last is not None

    def unwatched_px(self, time_s: float) -> float:
        """Standard deviation of the points' drift by now, while telemetry says nothing."""
        if self._last is None:
            return 0.0
        scale = math.sqrt(abs(float(np.linalg.det(self._last.px_by_m))))
        return _FLOW_MPS * abs(time_s - self._last.time_s) * scale * math.sqrt(share_moving(self.log_odds))

    def likelihood(self, drift: GroundDrift) -> float:
        """The logarithm of how likely its points seem to have gone there if they lie still, but for a constant."""
        step = drift.px_by_m @ (drift.by_m - self._by_m)
        return -float(step @ step) / (2 * self._still_px(drift) ** 2)

    def _still_px(self, drift: GroundDrift) -> float:
        """Standard deviation, in each coordinate, of the apparent drift of points that lie still."""
        elapsed_s = abs(drift.time_s - self._since_s)
        metres = math.hypot(
            _DRIFT_MPS * min(elapsed_s, _DRIFT_S),
            0.0
            if self._sweep_mps is None
            else _STAMP_OFFSET_S * float(np.linalg.norm(drift.sweep_mps - self._sweep_mps)),
        )
        turned = math.hypot(_JITTER_RAD, _DRIFT_RADPS * min(elapsed_s, _DRIFT_S))
        return math.hypot(turned * drift.focal_px, metres * math.sqrt(abs(float(np.linalg.det(drift.px_by_m)))))


def share_moving(log_odds: float) -> float:
    """The probability that goes with log odds of lying still."""
    return 1 / (1 + math.exp(min(log_odds, 700.0)))


@dataclass(frozen=True, slots=True, eq=False)
class PlaneImage:
    """An image of the plane.

    Attributes:
        small: ``(height, width)`` grey.
        view: Of the camera as it was zoomed.
        time_s: When it was taken.
        plane_pose: Where from, by telemetry; None where that does not tell.
    """

    small: ImageArray
    view: UndistortedView
    time_s: float
    plane_pose: PlanePose | None


@dataclass(slots=True, eq=False)
class Keyframe:
    """An image that others are held against.

    Attributes:
        taken: The image.
        corners_px: ``(n, 2)`` small pixels of what can be found again.
        since_first: ``(3, 3)`` its homography since the first image.
        cov: ``(8, 8)`` of that, see ``predicted_cov``.
        std_px: What that makes of the probes' places in the first image.
        stillness: Of those of its points that were taken for land so far: of all, before any were.
        are_known: ``(n,)``: which these are.
        others_stationarity: Of the others.
    """

    plane_image: PlaneImage
    corners_px: FloatArray
    since_first: FloatArray
    cov: FloatArray
    std_px: float
    stillness: Stillness
    are_known: BoolArray
    others_stationarity: Stillness

    def stillness_of(self, rows: IntArray) -> Stillness:
        """Stillness of some points: what was found of one group says nothing of another."""
        return self.stillness if 2 * np.count_nonzero(self.are_known[rows]) >= len(rows) else self.others_stationarity

    def remember(self, rows: IntArray, drift: GroundDrift) -> None:
        """Mark points as recognised as land again."""
        if self.stillness_of(rows) is self.others_stationarity:
            self.stillness, self.others_stationarity = self.others_stationarity, self.others_stationarity.again()
            self.are_known = np.zeros_like(self.are_known)
            self.are_known[rows] = True
        if self.stillness.remember(drift):
            self.are_known = np.zeros_like(self.are_known)
            self.are_known[rows] = True

    def forget(self, rows: IntArray) -> None:
        """Leave points out."""
        self.corners_px = np.delete(self.corners_px, rows, axis=0)
        self.are_known = np.delete(self.are_known, rows)

    def seen_px(self, view: UndistortedView, onto: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Small pixels ``(n, 2)`` of its corners in a view that a homography leads to, and which are well inside."""
        there_px = view.map_from(onto, self.corners_px, self.plane_image.view)
        return there_px, in_image(view.camera, there_px, _MARGIN_PX)

    def is_shown(self, view: UndistortedView, onto: FloatArray, least_share: float) -> bool:
        """Whether at least that share of its corners is in a view that a homography leads to, in about its size."""
        if len(self.corners_px) < 2 * FEWEST:
            return False
        _, inside = self.seen_px(view, onto)
        middle = np.mean(self.corners_px, axis=0) + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        ends = view.map_from(onto, middle, self.plane_image.view)
        if np.mean(inside) < least_share or np.count_nonzero(inside) < FEWEST or not np.all(np.isfinite(ends)):
            return False
        scale = math.sqrt(abs(float(np.linalg.det(ends[1:] - ends[0]))))
        return bool(_SCALES[0] <= scale <= _SCALES[1])


def corners_of(small: ImageArray, near_px: FloatArray) -> FloatArray:
    """Corners ``(n, 2)`` of a grey image ``(height, width)``, the best of each cell of a grid; more near ``(m, 2)``."""
    strength = cv2.cornerMinEigenVal(small, 5)
    peaks = strength >= cv2.dilate(strength, np.ones((2 * _APART_PX + 1, 2 * _APART_PX + 1), dtype=np.uint8))
    rows, columns = np.nonzero(peaks & (strength > _QUALITY * float(np.quantile(strength, 0.99))))
    cells = (rows * _CELLS // small.shape[0]) * _CELLS + columns * _CELLS // small.shape[1]
    order = np.lexsort((-strength[rows, columns], cells))
    rank = np.arange(len(order)) - np.searchsorted(cells[order], cells[order])
    corners = np.stack([columns[order], rows[order]], axis=-1).astype(np.float64)
    is_near = nearest_px(corners, near_px) < _NEAR_PX
    return np.asarray(corners[rank < np.where(is_near, _MOST_NEAR, MOST_CORNERS // _CELLS**2 + 3)])


def nearest_px(points_px: FloatArray, others_px: FloatArray) -> FloatArray:
    """Distance of each of ``(n, 2)`` from the nearest of ``(m, 2)``; NaN is far."""
    apart = np.linalg.norm(points_px[:, None] - others_px, axis=-1)
    return np.asarray(np.min(np.where(np.isnan(apart), np.inf, apart), axis=1, initial=np.inf))
