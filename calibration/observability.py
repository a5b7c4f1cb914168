"""Which unknown, or which combination of them, the evidence does not determine, and what to add."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.model.arrays import FloatArray
from calibration.descent import used_rows
from calibration.residuals import Problem
from calibration.solve import Solution
from calibration.state import State

LIMIT: Final = 0.5
"""An unknown whose standard deviation is more than this share of its natural size is not determined."""

_PART, _ALONE = 0.25, 0.97  # of a combination: below which an unknown has no part in it, and beyond which it is all
_LENS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_POSE = {"east", "north", "height", "tilt", "roll", "heading"}
_ADD: Final = (
    ({"height", "focal"}, "add a landmark at another distance or a known length"),
    ({"tilt", "focal"}, "add a landmark nearer or farther, or the horizon"),
    ({"height", "tilt"}, "add landmarks or ranges at other distances"),
    ({"height", "elevation"}, "state one of them: only their difference is seen"),
    ({"tilt", "cy"}, "state the principal point, or add the horizon"),
    ({"roll", "heading"}, "state one of them: straight down they turn about one axis"),
    ({"heading", "east"}, "add a second landmark, far from the first"),
    ({"heading", "north"}, "add a second landmark, far from the first"),
    ({"focal"}, "add a known length, or landmarks at several distances"),
    ({"height"}, "add a known length, a range or a landmark"),
    ({"tilt"}, "add landmarks at several distances, or the horizon"),
    ({"roll"}, "add landmarks to the left and to the right, a vertical or the horizon"),
    ({"heading"}, "add a landmark whose place is known"),
    ({"east"}, "add a landmark whose place is known"),
    ({"north"}, "add a landmark whose place is known"),
    ({"elevation"}, "add landmarks of known height"),
)


@dataclass(frozen=True, slots=True)
class Observability:
    """How well the weakest combinations of unknowns are determined.

    Attributes:
        combination: Their unknowns with the parts that they have in them, the largest first.
        std_share: Standard deviation of the weakest as a share of the unknowns' natural sizes; infinite where nothing
            tells.
        advice: What to add; empty where all is determined.
        apart: Each unknown is undetermined by itself, not only together with others.
    """

    combination: dict[str, float]
    std_share: float
    advice: str
    apart: bool = False

    @property
    def is_determined(self) -> bool:
        """Whether every unknown is."""
        return self.std_share <= LIMIT

    @property
    def sentence(self) -> str:
        """What cannot be told; empty where everything can."""
        if self.is_determined:
            return ""
        names = list(self.combination)
        if len(names) == 1:
            return f"{names[0]} cannot be told: {self.advice}"
        apart = "" if self.apart else " apart"
        return f"{', '.join(names[:-1])} and {names[-1]} cannot be told{apart}: {self.advice}"


def observability(problem: Problem, solution: Solution) -> Observability:
    """The weakest combinations of a solution's unknowns: all that are undetermined, or else the worst.

    Columns of the Jacobian are scaled by natural sizes (a height by itself, an angle by a radian, a focal length by
    itself, a place by the camera's height), so that its singular values say how many standard deviations of the
    evidence a whole size makes. A camera that turns freely is judged by rotations about its own axes: straight down,
    where roll and heading are anything, its attitude is known all the same.
    """
    names = problem.unknowns.names
    jac = solution.residuals.by_unknowns[used_rows(solution.residuals.owner, solution.kept)]
    above_m = _above(problem, solution.state)
    sizes = np.array([natural_size(name, solution.state, above_m) for name in names])
    _, singular, directions = np.linalg.svd(np.linalg.qr(jac * sizes, mode="r"))
    strengths = np.append(singular, np.zeros(len(names) - len(singular)))
    with np.errstate(divide="ignore"):
        shares = solution.scaled / strengths
    weak = directions[shares > LIMIT] if shares[-1] > LIMIT else directions[-1:]
    weak = (weak * sizes) @ problem.unknowns.to_angles(solution.state).T / sizes
    return combined(names, weak, float(shares[-1]), lambda parts: _advice(parts, jac.shape))


def combined(
    names: tuple[str, ...], weak: FloatArray, share: float, advice: Callable[[set[str]], str]
) -> Observability:
    """Weak directions ``(k, n)`` in the space of the unknowns, in their natural sizes, in words.

    Args:
        names: The unknowns.
        weak: All that are undetermined, or else the worst.
        share: Standard deviation along the weakest.
        advice: What to add where these cannot be told.
    """
    weak = weak / np.linalg.norm(weak, axis=-1, keepdims=True)
    each = np.minimum(np.linalg.norm(weak, axis=0), 1.0)
    parts = {names[index]: float(each[index]) for index in np.argsort(-each, kind="stable") if each[index] > _PART}
    apart = len(parts) == len(weak) and min(parts.values()) > _ALONE
    return Observability(parts, share, "" if share <= LIMIT else advice(set(parts)), apart)


def _above(problem: Problem, state: State) -> float:
    """Height above the landmarks, or above the ground where there are none."""
    points, _ = problem.landmarks
    below = float(np.median(points[:, 2])) if len(points) else state.elevation_m
    return max(abs(state.value("height") - below), 1e-3)


def natural_size(name: str, state: State, above_m: float) -> float:
    """What an uncertainty of an unknown is a share of; ``above_m`` is the camera's height above what it sees."""
    if name in ("height", "east", "north", "elevation"):
        return above_m
    if name in ("focal", "fx", "fy"):
        return state.value(name)
    if name in ("cx", "cy"):
        return float(state.camera.width_px if name == "cx" else state.camera.height_px)
    return 1.0


def _advice(names: set[str], shape: tuple[int, ...]) -> str:
    numbers, unknowns = shape
    if numbers < unknowns:
        few = "1 number" if numbers == 1 else f"{numbers} numbers"
        return f"the observations are {few} for {unknowns} unknowns, add some"
    for wanted, advice in _ADD:
        if wanted == names:
            return advice
    if len(names & _POSE) > 2:  # noqa: PLR2004 - the camera may swing about a line of landmarks
        return "add landmarks elsewhere, not in one line with the others"
    for wanted, advice in _ADD:
        if wanted <= names:
            return advice
    return "add landmarks near the corners of the image" if names & set(_LENS) else "add landmarks"


def correlations(covariance: FloatArray) -> FloatArray:
    """``(n, n)`` correlation coefficients of a covariance; 0 beside what is exact, NaN where it is infinite."""
    std = np.sqrt(np.diag(covariance))
    size = np.where(std > 0, std, 1.0)
    known = np.isfinite(covariance)
    return np.where(known, np.where(known, covariance, 0.0) / np.outer(size, size), np.nan)
