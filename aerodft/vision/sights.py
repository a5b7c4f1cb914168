"""Outlines to places on the ground: each object's foot, its size, and how well that is known."""

import math
from dataclasses import dataclass, replace

import numpy as np

from aerodft.dft.judging import MAX_RELATIVE_RANGE_STD
from aerodft.dft.projection import ELEVATION, GroundPoints, project
from aerodft.dft.quantities import Sight as Rays
from aerodft.dft.quantities import upright_height
from aerodft.dft.request import Setup
from aerodft.dft.silhouette import EDGE_STD_PX
from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.observation import Observation
from aerodft.model.pose import Pose
from aerodft.service.outlined import standing_of

_TOP_STD_PX = 3.0
_HEIGHT_SHARE = 0.05  # of its height: heads bow, and sights differ by as much
_LEAST_STD_M = 0.03  # a step is longer than a shoe: where somebody stands is not better defined


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One object on the ground.

    Attributes:
        place_en_m: ``(2,)`` of its foot.
        cov_m2: ``(2, 2)``, of what is its own: no error of the camera's.
        by_px: ``(2, 2)`` derivative of the place by the foot's pixel.
        foot_px: ``(2,)``.
        top_px: ``(2,)``; the foot where it is not known.
        across_px: ``(2,)`` unit vector to the right where the vertical is down.
        height_m: NaN where it is not known.
        width_m: Likewise.
        width_px: Likewise.
    """

    place_en_m: FloatArray
    cov_m2: FloatArray
    by_px: FloatArray
    foot_px: FloatArray
    top_px: FloatArray
    across_px: FloatArray
    height_m: float = math.nan
    width_m: float = math.nan
    width_px: float = math.nan

    def blurred_aside(self, std_px: float) -> FloatArray:
        """The covariance ``(2, 2)`` where the foot may be farther aside."""
        move = self.by_px @ self.across_px * std_px
        return np.asarray(self.cov_m2 + np.outer(move, move))


def ground_at(setup: Setup, pose: Pose, pixels_px: FloatArray) -> GroundPoints:
    """Ground points of pixels ``(..., 2)``."""
    return project(setup.camera, pose, pixels_px, setup.elevation_m, setup.model, setup.ground)


def sights(setup: Setup, pose: Pose, observations: tuple[Observation, ...]) -> list[Sight]:
    """The objects of one image that stand on the ground, in a range that is known."""
    found = (_sight(setup, pose, observation) for observation in observations)
    return [sight for sight in found if sight is not None]


def below_top(setup: Setup, pose: Pose, sight: Sight, height_m: float) -> tuple[FloatArray, FloatArray] | None:
    """Where an object stands of which the top is seen: east and north ``(2,)``, and their covariance ``(2, 2)``.

    Args:
        setup: The station's circumstances.
        pose: Of the image.
        sight: Of its upper part.
        height_m: How high it is.
    """
    if not math.isfinite(height_m):
        return None
    raised = replace(setup, elevation_m=setup.elevation_m + height_m)
    top = ground_at(raised, pose, sight.top_px[None])
    if top.status[0]:
        return None
    by_px, by_height = top.jac_px[0, :2], top.jac_shared[0, :2, ELEVATION] * _HEIGHT_SHARE * height_m
    cov = by_px @ by_px.T * _TOP_STD_PX**2 + np.outer(by_height, by_height) + np.eye(2) * _LEAST_STD_M**2
    return top.points_enu_m[0, :2], cov


def _sight(setup: Setup, pose: Pose, observation: Observation) -> Sight | None:
    std_px = observation.std_px or EDGE_STD_PX
    if not observation.has_outline:
        if not observation.pixels:
            return None
        foot = np.array(observation.pixels[0])
        ground = ground_at(setup, pose, foot[None])
        cov = np.eye(2) * std_px**2
        return _placed(setup, pose, ground, cov, (foot, foot, np.array([1.0, 0.0])))
    seen = standing_of(observation, setup.camera, pose, std_px)
    ground = ground_at(setup, pose, np.stack([seen.foot_px, *seen.sides_px]))
    span = seen.sides_px[1] - seen.sides_px[0]
    width_px = float(np.linalg.norm(span))
    across = span / width_px if width_px > 0 else np.array([1.0, 0.0])
    size = _height_m(setup, pose, ground, seen.top_px), _width_m(ground), width_px
    return _placed(setup, pose, ground, seen.foot_cov_px2, (seen.foot_px, seen.top_px, across), size)


def _placed(
    setup: Setup,
    pose: Pose,
    ground: GroundPoints,
    cov_px2: FloatArray,
    pixels: tuple[FloatArray, FloatArray, FloatArray],
    size: tuple[float, float, float] = (math.nan, math.nan, math.nan),
) -> Sight | None:
    if ground.status[0]:
        return None
    by_px = ground.jac_px[0, :2]
    cov = by_px @ cov_px2 @ by_px.T + np.eye(2) * _LEAST_STD_M**2
    range_m = float(np.linalg.norm(ground.points_enu_m[0] - pose.position_enu_m))
    if setup.max_range_m is not None and range_m > setup.max_range_m:
        return None
    if not math.sqrt(float(np.max(np.linalg.eigvalsh(cov)))) <= MAX_RELATIVE_RANGE_STD * range_m:
        return None
    return Sight(ground.points_enu_m[0, :2], cov, by_px, *pixels, *size)


def _height_m(setup: Setup, pose: Pose, ground: GroundPoints, top_px: FloatArray) -> float:
    ray = rays_from_pixels(setup.camera, top_px) @ matrix(pose.wxyz).T
    foot = ground.points_enu_m[0]
    return float(upright_height(Rays(pose.position_enu_m, np.stack([ray, ray]), np.stack([foot, foot]))))


def _width_m(ground: GroundPoints) -> float:
    if ground.status[1] or ground.status[2]:
        return math.nan
    return float(np.linalg.norm((ground.points_enu_m[2] - ground.points_enu_m[1])[:2]))
