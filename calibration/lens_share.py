"""What a lens that is known with stds adds to the covariance of what was solved for with it.

Its parameters are considered, not estimated: they stay as the camera file has them, and what they are off by goes into
every unknown as the fit lets it (Schmidt's consider analysis; Tapley, Schutz and Born, "Statistical Orbit
Determination", 2004, section 6.4).
"""

from dataclasses import replace

import numpy as np

from aerodft.geometry.intrinsics import intrinsics_covariance
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from calibration.descent import used_rows
from calibration.residuals import Problem
from calibration.solve import Solution
from calibration.state import Unknowns, coefficient_names

_INTRINSICS = ("fx", "fy", "cx", "cy")


def with_lens(problem: Problem, solution: Solution, camera: Camera, stated: frozenset[str]) -> Solution:
    """The solution, with covariances in which the lens is as uncertain as the camera file says.

    Args:
        problem: What was fitted.
        solution: The fit, with the lens taken as exact where it was not asked for.
        camera: The camera file's, with its stds or covariance.
        stated: Unknowns that somebody stated: these are not as the camera file has them.

    Returns:
        The same values; what is undetermined stays so.
    """
    considered = [name for name in _names(camera) if not _is_told(name, {*problem.unknowns.names, *stated})]
    lens_cov = _covariance(camera, considered)
    if not np.any(lens_cov) or not np.all(np.isfinite(solution.covariance)):
        return solution
    by_lens = Unknowns(tuple(considered)).by_unknowns(solution.state)
    steps = _steps(problem, solution, by_lens)
    in_angles = problem.unknowns.to_angles(solution.state) @ steps
    moves = problem.unknowns.by_unknowns(solution.state) @ steps + by_lens
    return replace(
        solution,
        covariance=solution.covariance + in_angles @ lens_cov @ in_angles.T,
        joint=solution.joint + moves @ lens_cov @ moves.T,
    )


def _steps(problem: Problem, solution: Solution, by_lens: FloatArray) -> FloatArray:
    """``(n, p)``: what the fit makes of each considered parameter, to first order."""
    residuals = solution.residuals
    seen = residuals.owner >= 0
    by_considered = np.zeros((len(seen), by_lens.shape[1]))
    found = problem.observed(solution.state, by_lens)
    if found is not None:
        by_considered[seen] = found.by_unknowns
    used = used_rows(residuals.owner, solution.kept)
    return np.asarray(-np.linalg.pinv(residuals.by_unknowns[used]) @ by_considered[used])


def _names(camera: Camera) -> tuple[str, ...]:
    return (*_INTRINSICS, *coefficient_names(camera))


def _is_told(name: str, others: set[str]) -> bool:
    return name in others or (name in ("fx", "fy") and "focal" in others)


def _covariance(camera: Camera, considered: list[str]) -> FloatArray:
    """``(p, p)`` of these parameters, as the camera file has it."""
    every, known = _names(camera), intrinsics_covariance(camera)
    cov = np.zeros((len(every), len(every)))
    cov[: len(known), : len(known)] = known
    rows = [every.index(name) for name in considered]
    return cov[np.ix_(rows, rows)]
