"""How a plane's homography between two images may be off: as small changes of it, with their covariance.

A homography ``h`` that is off by ``d`` is ``(1 + d) h``, with ``d[2, 2] = 0``: eight numbers, in units of the lens
(focal lengths around the principal point), so that all of them are of about the same size.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.geometry.ground import Ground
from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray, read_only
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.status import Status
from aerodft.vision.straight import StraightView

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


@dataclass(frozen=True, slots=True, eq=False)
class Standpoint:
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

    def onto(self, later: "Standpoint") -> FloatArray:
        """``(3, 3)`` homography from this one's straight small pixels to those of a later one."""
        return np.asarray(later.from_plane() @ np.linalg.inv(self.from_plane()))


def foretold_cov(then: Standpoint, now: Standpoint, unit: FloatArray) -> FloatArray:
    """Covariance ``(8, 8)`` of what telemetry makes of the homography from one standpoint to another.

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


def moved_on(cov: FloatArray, by: FloatArray, unit: FloatArray) -> FloatArray:
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


def changed(homography: FloatArray, by: FloatArray, unit: FloatArray) -> FloatArray:
    """A homography ``(3, 3)`` that is off by these eight elements; in front of the camera stays in front of it."""
    change = np.append(by, 0.0).reshape(3, 3)
    moved = unit @ (_EYE + change) @ np.linalg.inv(unit) @ homography
    return np.asarray(moved / np.linalg.norm(moved))


def change_between(homography: FloatArray, other: FloatArray, unit: FloatArray) -> FloatArray:
    """By which eight elements the other homography is off from the first."""
    ratio = np.linalg.inv(unit) @ other @ np.linalg.inv(homography) @ unit
    return _free(ratio / ratio[2, 2] - _EYE)


def _free(change: FloatArray) -> FloatArray:
    """The eight elements ``(8,)`` of a change ``(3, 3)``; what is common to all of the diagonal changes nothing."""
    return np.asarray((change - change[2, 2] * _EYE).ravel()[:FREE])


@dataclass(frozen=True, slots=True)
class Seen:
    """A pose, and by how much the camera is zoomed."""

    pose: Pose
    magnification: float


class Standpoints:
    """Makes standpoints of poses.

    Args:
        camera: The camera.
        view: Its small images.
        pose_of: The pose at an image's stamp, about; None where it is not known.
        elevation_m: Of the plane above ENU 0; None until it is known.
    """

    def __init__(self, camera: Camera, view: StraightView, pose_of: PoseOf, elevation_m: float | None = 0.0) -> None:
        self.elevation_m = elevation_m
        self._camera, self._view, self._pose_of = camera, view, pose_of
        self._zoomed: dict[int, tuple[float, StraightView]] = {}

    def seen(self, image: Image) -> Seen | None:
        """What an image was taken with; None where that is not known."""
        sample = self._pose_of(image)
        if sample is None or sample.pose is None or sample.status is not Status.OK:
            return None
        return Seen(sample.pose, 1.0 if sample.zoom is None else sample.zoom.magnification)

    def view_of(self, seen: Seen | None) -> StraightView:
        """Where zooming changes what the lens bends: by the last zoom that is known."""
        if seen is not None:
            return self.zoomed(self._view, seen)
        return self._zoomed[id(self._view)][1] if id(self._view) in self._zoomed else self._view

    def zoomed(self, view: StraightView, seen: Seen) -> StraightView:
        """A view as the camera is zoomed."""
        known = self._zoomed.get(id(view), (1.0, view))
        if known[0] != seen.magnification:
            known = seen.magnification, view.zoomed(seen.magnification)
        self._zoomed[id(view)] = known
        return known[1]

    def of(self, seen: Seen | None) -> Standpoint | None:
        """Where an image was taken from; None where that, or how high the plane is, is not known."""
        if seen is None or self.elevation_m is None or not seen.pose.position_enu_m[2] > self.elevation_m:
            return None
        lens = self._view.intrinsics.copy()
        lens[0, 0] *= seen.magnification
        lens[1, 1] *= seen.magnification
        place_m = seen.pose.position_enu_m - np.array([0.0, 0.0, self.elevation_m])
        return Standpoint(lens, matrix(seen.pose.wxyz), place_m)

    def find_plane(self, seen: Seen, pixel: FloatArray, ground: Ground | None, elevation_m: float) -> None:
        """How high the plane is at a pixel ``(2,)``, which is on the ground or so high above it.

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
