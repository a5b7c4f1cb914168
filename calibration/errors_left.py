"""What a calibration leaves of every observation: in the image, on the ground, and without it.

The fits without each of the observations come all at once, from the observations' leverages.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.projection import INTRINSICS, POSITION, project
from aerodft.geometry.ground import meet_level
from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import Evidence, GroundPoint, Landmark, SlantRange
from aerodft.model.pose import Pose
from calibration.descent import Rows, used_rows
from calibration.residuals import Problem
from calibration.solve import Solution, covariance_of
from calibration.state import State

_NOTHING_LEFT: Final = 1e-9
"""One less a leverage below which the other observations determine no fit."""
_NO_IMAGE_PX: Final = 1e6  # in the plane of the camera itself, where distances in the image have no meaning


def steps_without_each(solution: Solution) -> FloatArray:
    """Newton's steps ``(k, n)`` from the solution to the fit without each of its ``k`` observations.

    Cook and Weisberg, "Residuals and Influence in Regression" (1982), section 3.4. Zero for outliers, which the
    solution has not seen; NaN where the others determine no fit.
    """
    residuals, kept = solution.residuals, solution.kept
    steps = np.where(kept[:, None], np.nan, np.zeros((len(kept), residuals.by_unknowns.shape[1])))
    used = used_rows(residuals.owner, kept)
    jac, values = residuals.by_unknowns[used], residuals.values[used]
    cov = covariance_of(jac.T @ jac)
    if not np.all(np.isfinite(cov)):
        return steps
    settled = -cov @ (jac.T @ values)
    order = np.argsort(residuals.owner, kind="stable")
    first = np.searchsorted(residuals.owner[order], np.arange(len(kept)))
    counts = np.bincount(residuals.owner[residuals.owner >= 0], minlength=len(kept))
    for count in np.unique(counts[kept]):
        members = np.flatnonzero(kept & (counts == count))
        rows = order[first[members, None] + np.arange(count)]
        own = residuals.by_unknowns[rows]
        gain = own @ cov
        left = np.eye(count) - gain @ own.swapaxes(-1, -2)
        told = np.linalg.eigvalsh(left)[:, 0] > _NOTHING_LEFT
        off = residuals.values[rows[told]] + own[told] @ settled
        steps[members[told]] = settled + np.einsum(
            "gij,gi->gj", gain[told], np.linalg.solve(left[told], off[..., None])[..., 0]
        )
    return steps


def moves_the_lens(problem: Problem, solution: Solution) -> bool:
    """Whether intrinsics are among the unknowns."""
    return bool(np.any(problem.unknowns.by_unknowns(solution.state)[INTRINSICS]))


def landmarks_off_m(problem: Problem, solution: Solution, steps: FloatArray) -> FloatArray:
    """How far on the map ``(r,)`` the pixels of the ``r`` reprojected landmarks end from their places.

    Args:
        problem: Its unknowns do not move the lens.
        solution: The fit.
        steps: ``(r, n)``: each landmark's own step away from it.

    Returns:
        NaN where a pixel's ray does not come down to its landmark's level, and where the step is NaN.
    """
    state, unknowns = solution.state, problem.unknowns
    points, pixels = problem.landmarks
    wxyz = unknowns.turned(state, steps)
    told = np.isfinite(wxyz[:, 0]) & np.isfinite(steps[:, 0])
    turned = matrix(wxyz[told]) @ rays_from_pixels(state.camera, pixels[told])[..., None]
    position = state.position_m + steps[told] @ unknowns.by_unknowns(state)[POSITION].T
    found = meet_level(position, turned[..., 0], points[told, 2]).points_enu_m - points[told]
    off = np.full(len(points), np.nan)
    off[told] = np.hypot(found[:, 0], found[:, 1])
    return off


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
    steps = steps_without_each(solution)
    ground, left_out = _on_the_ground(problem, solution, np.zeros_like(steps)), _on_the_ground(problem, solution, steps)
    return left_of_each(problem.known.evidence, solution.residuals, solution.kept, ground, left_out)


def left_of_each(
    evidence: Sequence[Evidence],
    residuals: Rows,
    kept: np.ndarray,
    ground_m: Sequence[float | None],
    left_out_ground_m: Sequence[float | None],
) -> tuple[Leftover, ...]:
    """What is left in the image, beside what is left on the ground; as the fields of ``Leftover``."""
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
            ground_m,
            left_out_ground_m,
            (~kept).tolist(),
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
