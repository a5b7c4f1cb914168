"""What a calibration leaves of every observation: in the image, on the ground, and without it."""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.dft.projection import project
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import Evidence, GroundPoint, Landmark, SlantRange
from aerodft.model.pose import Pose
from calibration.residuals import Problem
from calibration.solve import Solution
from calibration.state import State


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
    residuals = solution.residuals
    found = []
    for index, evidence in enumerate(problem.known.evidence):
        rows = residuals.owner == index
        kept = bool(solution.kept[index])
        without = _without(problem, solution, rows) if kept else solution.state
        px = float(np.linalg.norm(residuals.px[rows]))
        found.append(
            Leftover(
                name=evidence.name,
                px=px,
                sigma=float(np.linalg.norm(residuals.values[rows])) if math.isfinite(px) else math.inf,
                ground_m=ground_error_m(solution.state, evidence),
                left_out_ground_m=None if without is None else ground_error_m(without, evidence),
                is_outlier=not kept,
            )
        )
    return tuple(found)


def rms_px(evidence: tuple[Evidence, ...], left: tuple[Leftover, ...]) -> float | None:
    """Root mean square of the landmarks' 2-D distances, px, outliers apart; None without landmarks."""
    squares = [
        one.px**2 for one, each in zip(left, evidence, strict=True) if isinstance(each, Landmark) and not one.is_outlier
    ]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def _without(problem: Problem, solution: Solution, rows: np.ndarray) -> State | None:
    """The state one Newton step after an observation was taken away; None where the others determine none."""
    residuals = solution.residuals
    kept = (residuals.owner < 0) | solution.kept[np.maximum(residuals.owner, 0)]
    jac, values = residuals.by_unknowns[kept & ~rows], residuals.values[kept & ~rows]
    normal = jac.T @ jac
    size = np.sqrt(np.diag(normal))
    if not np.all(size > 0) or np.linalg.cond(normal / np.outer(size, size)) > 1e13:  # noqa: PLR2004 - singular
        return None
    try:
        return problem.unknowns.moved(solution.state, -np.linalg.solve(normal, jac.T @ values).astype(np.float64))
    except ValueError:
        return None


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
