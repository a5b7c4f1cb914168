"""What a calibration leaves of every observation: in the image, on the ground, and without it."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.projection import project
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import Evidence, GroundPoint, Landmark, SlantRange
from aerodft.model.pose import Pose
from calibration.leave_one_out import landmarks_off_m, moves_the_lens, steps_without_each
from calibration.residuals import Problem
from calibration.solve import Solution
from calibration.state import State

_NO_IMAGE_PX: Final = 1e6  # in the plane of the camera itself, where distances in the image have no meaning


@dataclass(frozen=True, slots=True)
class Leftover:
    """One observation after the fit.

    Attributes:
        name: Its name.
        px: Distance in the image, px (2-D for landmarks); infinite where it is out of sight.
        sigma: The same in standard deviations; infinite likewise.
        ground_m: Distance on the ground, m: of a landmark's pixel from its place, of a range from what was measured;
            None for what has no place.
        left_out_ground_m: The same with a fit that has not seen it, which says how well the next one would be measured.
        is_outlier: It was left out of the fit.
    """

    name: str
    px: float
    sigma: float
    ground_m: float | None
    left_out_ground_m: float | None
    is_outlier: bool


def leftovers(problem: Problem, solution: Solution) -> tuple[Leftover, ...]:
    """All observations, in their order."""
    evidence, residuals = problem.known.evidence, solution.residuals
    steps = steps_without_each(solution)
    ground, left_out = _on_the_ground(problem, solution, np.zeros_like(steps)), _on_the_ground(problem, solution, steps)
    seen = residuals.owner >= 0
    px, sigma = (
        np.sqrt(np.bincount(residuals.owner[seen], np.square(values[seen])))
        for values in (residuals.px, residuals.values)
    )
    px[px > _NO_IMAGE_PX] = np.inf
    sigma[~np.isfinite(px)] = np.inf
    return tuple(
        map(
            Leftover,
            (each.name for each in evidence),
            px.tolist(),
            sigma.tolist(),
            ground,
            left_out,
            (~solution.kept).tolist(),
        )
    )


def _on_the_ground(problem: Problem, solution: Solution, steps: FloatArray) -> list[float | None]:
    """Ground errors of all observations, each one step ``(n,)`` away from the solution."""
    off: list[float | None] = [None] * len(steps)
    at_once = set()
    if not moves_the_lens(problem, solution):
        found = landmarks_off_m(problem, solution, steps[problem.reprojected])
        at_once = set(problem.reprojected.tolist())
        for index, value in zip(problem.reprojected.tolist(), found.tolist(), strict=True):
            off[index] = value if math.isfinite(value) else None
    for index, evidence in enumerate(problem.known.evidence):
        if index in at_once or not np.isfinite(steps[index, 0]):
            continue
        state = problem.moved(solution.state, steps[index])
        if state is not None:
            off[index] = ground_error_m(state, evidence)
    return off


def rms_px(evidence: tuple[Evidence, ...], left: tuple[Leftover, ...]) -> float | None:
    """Root mean square of the landmarks' 2-D distances, px, those apart that are outliers or out of sight.

    None without landmarks.
    """
    squares = [
        one.px**2
        for one, each in zip(left, evidence, strict=True)
        if isinstance(each, Landmark) and not one.is_outlier and math.isfinite(one.px)
    ]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def ground_error_m(state: State, evidence: Evidence) -> float | None:
    """Distance between where a pixel meets the ground and where it is known to; None where it meets none."""
    if not isinstance(evidence, Landmark | GroundPoint | SlantRange):
        return None
    elevation_m = state.elevation_m
    if isinstance(evidence, Landmark):
        if evidence.position_m[2] is None:
            return None
        elevation_m = evidence.position_m[2]
    pose = Pose(position_enu_m=state.position_m, wxyz=state.wxyz)
    ground = project(state.camera, pose, np.array([evidence.pixel]), elevation_m, state.model)
    if ground.status[0]:
        return None
    return _distance(state, evidence, ground.points_enu_m[0])


def _distance(state: State, evidence: Landmark | GroundPoint | SlantRange, point: FloatArray) -> float:
    away = point - state.position_m
    if isinstance(evidence, SlantRange):
        return abs(float(np.linalg.norm(away)) - evidence.range_m)
    if isinstance(evidence, GroundPoint):
        heading = state.value("heading")
        right, ahead = math.cos(heading), math.sin(heading)
        seen = (right * away[0] - ahead * away[1], ahead * away[0] + right * away[1])
        return math.dist(seen, evidence.xy_m)
    east, north, _ = evidence.position_m
    return math.hypot(
        0.0 if east is None else float(point[0]) - east, 0.0 if north is None else float(point[1]) - north
    )
