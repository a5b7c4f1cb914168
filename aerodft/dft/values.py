"""A probe's value with its interval: first order where that is enough, drawn where it is not.

First order is enough as long as no point's slant range is less certain than ``FIRST_ORDER_LIMIT``: over 5 % the ground
runs away from the ray too fast for a straight line. The dft model has first order only.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.dft.equations import object_height
from aerodft.dft.projection import FOCAL, POSITION, PRINCIPAL_POINT, ROTATION, SHARED, GroundPoints
from aerodft.dft.quantities import SCALARS, Gradient, Sight, gradient, slant_range
from aerodft.dft.sampling import Spread, draw_sights, spread
from aerodft.dft.uncertainty import CHI2_2D_95, Z95
from aerodft.geometry.lens import rays_with_jacobian
from aerodft.geometry.rotation import camera_angles, matrix, skew
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose
from aerodft.model.probe import ProbeKind

FIRST_ORDER_LIMIT = 0.05
"""Relative standard deviation of a slant range above which errors are drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """One probe as it is seen at one pose.

    Attributes:
        kind: What is measured.
        camera: The camera.
        pose: The pose.
        model: Projection model.
        pixels_px: ``(k, 2)``.
        elevation_m: Of the measured plane.
        ground: Its ``k`` ground points.
        shared_cov: ``(10, 10)``.
        std_px: Of each pixel coordinate.
    """

    kind: ProbeKind
    camera: Camera
    pose: Pose
    model: ProjectionModel
    pixels_px: FloatArray
    elevation_m: float
    ground: GroundPoints
    shared_cov: FloatArray
    std_px: float

    @property
    def has_scalar(self) -> bool:
        """Whether there is one number to give; a position has none."""
        return self.kind is not ProbeKind.POSITION


@dataclass(frozen=True, slots=True)
class Value:
    """A scalar, its standard deviation, and its central 95 %; not symmetric where it was drawn."""

    value: float
    std: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Drawn:
    """What drawing the errors gave.

    Attributes:
        value: None for a position.
        range_spreads: Of the slant range of each point that lies on the ground.
        cov_enu_m2: ``(3, 3)`` of the first point: its 95 % ellipse holds 95 % of the draws.
    """

    value: Value | None
    range_spreads: tuple[Spread, ...]
    cov_enu_m2: FloatArray


def first_order(seen: Seen) -> Value | None:
    """Value by linear propagation; None for a position."""
    if not seen.has_scalar:
        return None
    if seen.kind is ProbeKind.HEIGHT and seen.model is ProjectionModel.DFT:
        value, std = _paper_height(seen)
    else:
        sight = sight_of(seen)
        value = float(SCALARS[seen.kind](sight))
        std = _std(seen, gradient(seen.kind, sight))
    return Value(value, std, (value - Z95 * std, value + Z95 * std))


def drawn(seen: Seen) -> Drawn:
    """Value by drawing the stated errors; pinhole only."""
    sights = draw_sights(seen.camera, seen.pose, seen.pixels_px, seen.elevation_m, seen.shared_cov, seen.std_px)
    on_ground = 1 if seen.kind is ProbeKind.HEIGHT else len(seen.pixels_px)
    ranges = tuple(
        spread(
            slant_range(Sight(sights.camera_enu_m, sights.directions_enu, sights.points_enu_m[:, index : index + 1]))
        )
        for index in range(on_ground)
    )
    value = None
    if seen.has_scalar:
        found = spread(SCALARS[seen.kind](sights))
        centre = float(SCALARS[seen.kind](sight_of(seen)))
        value = Value(centre, (found.high - found.low) / (2 * Z95), (found.low, found.high))
    return Drawn(value, ranges, _scatter(sights.points_enu_m[:, 0], seen.ground.points_enu_m[0]))


def sight_of(seen: Seen) -> Sight:
    """What is seen, without errors; directions for a height alone, nothing else looks at them."""
    if seen.kind is not ProbeKind.HEIGHT:
        return Sight(seen.pose.position_enu_m, np.zeros_like(seen.ground.points_enu_m), seen.ground.points_enu_m)
    directions = rays_with_jacobian(seen.camera, seen.pixels_px).rays_cam @ matrix(seen.pose.wxyz).T
    return Sight(seen.pose.position_enu_m, directions, seen.ground.points_enu_m)


def dependence(seen: Seen, by: Gradient) -> tuple[FloatArray, FloatArray]:
    """Derivatives of a scalar by the shared errors ``(10,)`` and by each pixel ``(k, 2)``."""
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


def _std(seen: Seen, by: Gradient) -> float:
    """Joint standard deviation: shared errors add up over points and rays before they are squared."""
    shared, own = dependence(seen, by)
    variance = float(shared @ seen.shared_cov @ shared) + seen.std_px**2 * float(np.sum(own * own))
    return math.sqrt(max(variance, 0.0))


def _direction_jacobians(seen: Seen) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the ray directions in ENU: ``(k, 3, 10)`` by the shared errors, ``(k, 3, 2)`` by the pixels."""
    rays, rotation = rays_with_jacobian(seen.camera, seen.pixels_px), matrix(seen.pose.wxyz)
    by_px = rotation @ rays.jac_px
    shared = np.zeros((len(seen.pixels_px), 3, SHARED))
    shared[..., ROTATION] = -rotation @ skew(rays.rays_cam)
    shared[..., FOCAL] = rays.jac_focal @ rotation.T
    shared[..., PRINCIPAL_POINT] = -by_px
    return shared, by_px


def _paper_height(seen: Seen) -> tuple[float, float]:
    """Eq. 8 and its standard deviation; NaN unless base and top are both seen against the ground."""
    _, _, heading = camera_angles(seen.pose.wxyz)
    ahead = np.array([math.sin(heading), math.cos(heading), 0.0])
    base, top = ((seen.ground.points_enu_m - seen.pose.position_enu_m) @ ahead).tolist()
    height = float(seen.pose.position_enu_m[2]) - seen.elevation_m
    by_points = np.stack([-height / top * ahead, height * base / top**2 * ahead])
    by_height = np.array([0.0, 0.0, 1 - base / top])
    by = Gradient(by_height - by_points.sum(axis=0), np.zeros((2, 3)), by_points - [[0, 0, 1 - base / top], [0, 0, 0]])
    return float(object_height(height, base, top)), _std(seen, by)


def _scatter(draws_enu_m: FloatArray, centre_enu_m: FloatArray) -> FloatArray:
    """Second moment ``(3, 3)`` about the measured point, scaled so that its 95 % ellipse holds 95 % of the draws.

    Its shape is that of the nearer 95 %: a few draws near the horizon would stretch it without bound.
    """
    away = (draws_enu_m - centre_enu_m)[:, :2]
    far = np.where(np.isnan(away[:, 0]), np.inf, np.hypot(away[:, 0], away[:, 1]))
    if np.count_nonzero(np.isinf(far)) > 0.05 * len(far):
        return np.full((3, 3), np.inf)  # no ellipse holds them; the point is refused for its range anyway
    near = far <= np.sort(far)[int(0.95 * len(far)) - 1]
    moment = away[near].T @ away[near] / np.count_nonzero(near)
    squared = np.einsum("ni,ij,nj->n", away, np.linalg.pinv(moment), away)
    scale = np.sort(np.where(np.isnan(squared), np.inf, squared))[int(np.ceil(0.95 * len(far))) - 1] / CHI2_2D_95
    cov = np.zeros((3, 3))
    cov[:2, :2] = moment * scale
    return cov
