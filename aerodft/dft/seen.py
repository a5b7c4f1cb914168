"""One probe as it is seen at one pose: everything that its value and its uncertainty follow from."""

from dataclasses import dataclass

import numpy as np

from aerodft.dft.projection import POSITION, GroundPoints, dependence_of_rays
from aerodft.dft.quantities import Gradient, Sight
from aerodft.geometry.ground import Ground
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.geometry.rotation import matrix, turned
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose
from aerodft.model.probe import ProbeKind

BY_DIRECTION = (ProbeKind.HEIGHT, ProbeKind.BEARING)
"""Kinds that look at rays; the others look at points alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """One probe as it is seen at one pose.

    Attributes:
        kind: What is measured.
        camera: The camera.
        pose: The pose.
        model: Projection model.
        pixels_px: ``(k, 2)``.
        elevation_m: Of the measured surface.
        surface: What the elevation is counted from; None for the level plane at 0.
        ground: Its ``k`` ground points.
        shared_cov: ``(s, s)``, ordered as in ``projection``.
        std_px: Of each pixel coordinate.
    """

    kind: ProbeKind
    camera: Camera
    pose: Pose
    model: ProjectionModel
    pixels_px: FloatArray
    elevation_m: float
    surface: Ground | None
    ground: GroundPoints
    shared_cov: FloatArray
    std_px: float

    @property
    def has_scalar(self) -> bool:
        """Whether there is one number to give; a position has none."""
        return self.kind is not ProbeKind.POSITION

    @property
    def on_ground(self) -> int:
        """See ``on_ground_count``."""
        return on_ground_count(self.kind, len(self.pixels_px), self.model)

    @property
    def sight(self) -> Sight:
        """What is seen, without errors; directions only for kinds that look at them."""
        directions = np.zeros_like(self.ground.points_enu_m)
        if self.kind in BY_DIRECTION:
            directions = turned(matrix(self.pose.wxyz), rays_with_jacobian(self.camera, self.pixels_px).rays_cam)
        return Sight(self.pose.position_enu_m, directions, self.ground.points_enu_m)


def dependence(seen: Seen, by: Gradient) -> tuple[FloatArray, FloatArray]:
    """Derivatives of a scalar by the shared errors ``(s,)`` and by each pixel ``(k, 2)``."""
    used = np.any(by.by_points != 0, axis=-1)  # a ray that is not used may miss the ground, with infinite derivatives
    points = by.by_points[used]
    shared = np.einsum("ki,kij->j", points, seen.ground.jac_shared[used])
    shared[POSITION] += by.by_camera
    own = np.zeros((len(seen.pixels_px), 2))
    own[used] = np.einsum("ki,kij->kj", points, seen.ground.jac_px[used])
    if np.any(by.by_directions):
        rays = directions_with_jacobians(seen.camera, seen.pose, seen.pixels_px)
        shared += np.einsum("ki,kij->j", by.by_directions, rays.jac_shared)
        own += np.einsum("ki,kij->kj", by.by_directions, rays.jac_px)
    return shared, own


def on_ground_count(kind: ProbeKind, count: int, model: ProjectionModel) -> int:
    """How many of ``count`` points, from the first, have to lie on the ground.

    An object's top is measured against the vertical through its base, and one pixel's bearing by its ray: they may be
    seen above the horizon.
    """
    if model is ProjectionModel.PINHOLE and kind in BY_DIRECTION:
        return count // 2 if kind is ProbeKind.HEIGHT else 2 * (count // 2)
    return count


@dataclass(frozen=True, slots=True)
class Directions:
    """Ray directions in ENU ``(..., 3)``, and derivatives by the shared errors and by the pixels."""

    directions_enu: FloatArray
    jac_shared: FloatArray
    jac_px: FloatArray


def directions_with_jacobians(
    camera: Camera, pose: Pose, pixels_px: FloatArray, *, of_each: bool = False
) -> Directions:
    """The rays of ``pixels_px (..., 2)``; of each of the poses ``(n,)`` where there are several.

    With ``of_each`` each of them has its own of ``(n, ..., 2)``.
    """
    rays, rotation = rays_with_jacobian(camera, pixels_px), matrix(pose.wxyz)
    over = rotation.reshape(*rotation.shape[:-2], *([1] * (pixels_px.ndim - 1 - of_each)), 3, 3)
    directions = turned(over, rays.rays_cam)
    itself, none = np.zeros((*directions.shape, 3)), np.zeros((*directions.shape, 3))
    itself[..., 0, 0] = itself[..., 1, 1] = itself[..., 2, 2] = 1.0
    by = itself, none, np.zeros(directions.shape)
    return Directions(directions, *dependence_of_rays(camera, rotation, pixels_px, rays, by, of_each=of_each))
