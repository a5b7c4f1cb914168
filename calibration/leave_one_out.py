"""A fit without each of its observations in turn, all of them at once from the observations' leverages."""

from typing import Final

import numpy as np

from aerodft.dft.projection import INTRINSICS, POSITION
from aerodft.geometry.ground import meet_level
from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray
from calibration.descent import used_rows
from calibration.residuals import Problem
from calibration.solve import Solution, inverse

_NOTHING_LEFT: Final = 1e-9
"""One less a leverage below which the other observations determine no fit."""


def steps_without_each(solution: Solution) -> FloatArray:
    """Newton's steps ``(k, n)`` from the solution to the fit without each of its ``k`` observations.

    Cook and Weisberg, "Residuals and Influence in Regression" (1982), section 3.4. Zero for outliers, which the
    solution has not seen; NaN where the others determine no fit.
    """
    residuals, kept = solution.residuals, solution.kept
    steps = np.where(kept[:, None], np.nan, np.zeros((len(kept), residuals.by_unknowns.shape[1])))
    used = used_rows(residuals.owner, kept)
    jac, values = residuals.by_unknowns[used], residuals.values[used]
    cov = inverse(jac.T @ jac)
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
