"""One probe as it is seen at one pose: everything that its value and its uncertainty follow from."""

from dataclasses import dataclass

import numpy as np

from aerodft.dft.projection import INTRINSICS, POSITION, ROTATION, GroundPoints
from aerodft.dft.quantities import Gradient, Sight
from aerodft.geometry.ground import Ground
from aerodft.geometry.intrinsics import rays_by_intrinsics
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.geometry.rotation import matrix, skew
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose
from aerodft.model.probe import ProbeKind

_BY_DIRECTION = (ProbeKind.HEIGHT, ProbeKind.BEARING)  # others look at points alone


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
        """How many of the points, from the first, have to lie on the ground.

        An object's top is measured against the vertical through its base, and one pixel's bearing by its ray: they may
        be seen above the horizon.
        """
        if self.model is ProjectionModel.PINHOLE and self.kind in _BY_DIRECTION:
            return len(self.pixels_px) // 2 if self.kind is ProbeKind.HEIGHT else 2 * (len(self.pixels_px) // 2)
        return len(self.pixels_px)

    @property
    def sight(self) -> Sight:
        """What is seen, without errors; directions only for kinds that look at them."""
        directions = np.zeros_like(self.ground.points_enu_m)
        if self.kind in _BY_DIRECTION:
            directions = rays_with_jacobian(self.camera, self.pixels_px).rays_cam @ matrix(self.pose.wxyz).T
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
        ray_shared, ray_own = _direction_jacobians(seen)
        shared += np.einsum("ki,kij->j", by.by_directions, ray_shared)
        own += np.einsum("ki,kij->kj", by.by_directions, ray_own)
    return shared, own


def _direction_jacobians(seen: Seen) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the ray directions in ENU: ``(k, 3, s)`` by the shared errors, ``(k, 3, 2)`` by the pixels."""
    rays, rotation = rays_with_jacobian(seen.camera, seen.pixels_px), matrix(seen.pose.wxyz)
    shared = np.zeros(seen.ground.jac_shared.shape)
    shared[..., ROTATION] = -rotation @ skew(rays.rays_cam)
    shared[..., INTRINSICS] = rotation @ rays_by_intrinsics(seen.camera, seen.pixels_px)
    return shared, rotation @ rays.jac_px
