"""A camera's pose and lens from what is known of a scene: starts, descents and outliers.

Nobody has to guess where to start from: every way in which the evidence alone places the camera is tried.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Generic, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc, chdtri, ndtri, stdtrit

from aerodft.geometry import camera_attitude, from_rotation_vector, inverse, matrix, rays_from_pixels
from aerodft.model import FloatArray, ProjectionModel
from calibration.pose.descent import Descent, Loss, Rows, RowsT_co, StateT, Task, descend, used_rows
from calibration.pose.residuals import Problem, Residuals
from calibration.pose.state import State

_MIN_LANDMARKS = 3  # landmarks that place a camera without a guess; three do so in up to four ways
_FLAT = 0.2  # thickness of a body of points, as a share of its width, below which it may be taken for its mirror image
_ONE_POSE = (
    0.005  # of rotations and of shares of a distance: two closed forms of one pose, which descents bring together
)
_WORSE, _NEAR = 30.0, 0.02  # than a better closed form, and in focal lengths: what is farther off is no mirror image
_TILTS_RAD = np.radians([8.0, 35.0, 55.0, 70.0, 82.0, 95.0])
_HEADINGS_RAD = np.radians(np.arange(0.0, 360.0, 45.0))
_HEIGHTS_M = (2.0, 6.0, 20.0, 60.0, 200.0)
_ZOOMS = (1.0, 0.5, 0.7, 1.4, 2.0)
_ANGLES = ("tilt", "roll", "heading")
End: TypeAlias = Descent[State, Residuals]

ROBUST: Final = 3.0
"""Standard deviations beyond which an observation counts less and less while outliers are looked for."""

_CHANCE: Final = 1e-5
"""An observation is an outlier if chance alone puts one in 100,000 so far off."""

_ANYWHERE, _LARGER = 17.0, 6.0
"""What it takes to believe that a number of an observation is anywhere in the image, and that all stds are larger than
stated: twice the negative logarithm of their odds."""

_BEST, _ENOUGH, _SUBSETS, _ROUNDS = 4, 3.0, 60, 10
_FORGIVABLE = 8  # observations; more that were wrongly left out would have shown in the scatter of the rest
_FEW, _FAR = 4, 50.0
_SINGULAR = 1e-13  # least eigenvalue beside a largest of about 1
_STATED_DOF: Final = 2.0
"""Residuals to spare that a stated std is worth: 95 of 100 stds that people state are right to a factor of 2.5."""

_LEAST_SCALE: Final = 0.7
"""Below which small residuals make no std smaller: they do not show errors that all observations share."""

_SAME = 1e-6  # share of the cost, and cost, that makes no difference
_AS_LIKELY, _ELSEWHERE = 14.0, 6.0  # in chi-square: one to a thousand; and standard deviations


def zooms(problem: Problem) -> tuple[float, ...]:
    """What to multiply the given focal length with, if it is unknown."""
    return _ZOOMS if {"focal", "fx"} & set(problem.unknowns.names) else (1.0,)


def closed_form_states(
    problem: Problem, known: State, zoom: float = 1.0, rows: npt.NDArray[np.int64] | None = None
) -> Iterator[State]:
    """What landmarks say in closed form of a camera with known focal length.

    Three by P3P, more by SQPnP (Terzakis and Lourakis, 2020); a plane's two poses by IPPE (Collins and Bartoli, 2014).

    Args:
        problem: The evidence.
        known: What is known or guessed.
        zoom: Of ``zooms``.
        rows: Indices of the landmarks to use; None for all.
    """
    points, pixels = problem.landmarks
    if rows is not None:
        points, pixels = points[rows], pixels[rows]
    if len(points) < _MIN_LANDMARKS or known.model is not ProjectionModel.PINHOLE:
        return
    middle = points.mean(axis=0)
    lens = replace(known.camera, fx_px=zoom * known.camera.fx_px, fy_px=zoom * known.camera.fy_px)
    rays = rays_from_pixels(lens, pixels)
    ahead = rays[:, 2] > 0.05  # noqa: PLR2004 - 3 degrees within a fisheye's half space
    if np.count_nonzero(ahead) < _MIN_LANDMARKS:
        return
    flat = np.ascontiguousarray(rays[ahead, :2] / rays[ahead, 2:])
    found: list[FloatArray] = []
    for turn, shift in _closed_forms(points[ahead] - middle, flat):
        wxyz = inverse(from_rotation_vector(turn.ravel()))
        enu_r_cam = matrix(wxyz)
        away = (enu_r_cam @ shift).ravel()
        pose = np.column_stack([enu_r_cam, away / np.linalg.norm(away), np.log(np.linalg.norm(away)) * np.ones(3)])
        is_new = all(np.max(np.abs(pose - other)) > _ONE_POSE for other in found)
        if is_new and np.all(np.isfinite(pose)):
            found.append(pose)
            yield _only_unknown(problem, known, replace(known, camera=lens), middle - away, wxyz)


def _closed_forms(points_m: FloatArray, flat: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Rotations and shifts from the world to the camera: all that fit, points of a plane may fit two."""
    ways = [cv2.SOLVEPNP_P3P] if len(flat) == _MIN_LANDMARKS else [cv2.SOLVEPNP_SQPNP]
    _, thickness, axes = np.linalg.svd(points_m, full_matrices=False)
    in_plane = points_m
    if len(flat) > _MIN_LANDMARKS and thickness[2] < _FLAT * thickness[1]:
        ways.append(cv2.SOLVEPNP_IPPE)
        in_plane = points_m - np.outer(points_m @ axes[2], axes[2])
    for way in ways:
        try:
            if way == cv2.SOLVEPNP_P3P:
                _, turns, shifts = cv2.solveP3P(points_m, flat, np.eye(3), None, way)
                errors: npt.ArrayLike = np.zeros(len(turns))
            else:
                world = in_plane if way == cv2.SOLVEPNP_IPPE else points_m
                _, turns, shifts, errors = cv2.solvePnPGeneric(world, flat, np.eye(3), None, flags=way)
        except cv2.error:  # points in a line, or all in one
            continue
        if not turns:  # without poses OpenCV gives no errors either
            continue
        off = np.asarray(errors, dtype=np.float64).ravel()
        near = off <= max(_WORSE * float(np.min(off, initial=np.inf)), _NEAR)
        for turn, shift, is_near in zip(turns, shifts, near, strict=True):
            if is_near:
                yield np.asarray(turn, dtype=np.float64), np.asarray(shift, dtype=np.float64)


def _only_unknown(problem: Problem, known: State, guess: State, eye_m: FloatArray, wxyz: FloatArray) -> State:
    """The guess, with what is known as it is known."""
    names = problem.unknowns.names
    closed_form_rad = replace(guess, wxyz=wxyz).angles_rad
    tilt, roll, heading = (
        (closed_form_rad if name in names else known.angles_rad)[index] for index, name in enumerate(_ANGLES)
    )
    position = known.position_m.copy()
    for index, name in enumerate(("east", "north", "height")):
        if name in names:
            position[index] = eye_m[index]
    position[2] = max(position[2], known.elevation_m + 0.1)
    return replace(guess, position_m=position, wxyz=camera_attitude(tilt, roll, heading))


def scattered(problem: Problem, known: State) -> Iterator[State]:
    """A net of tilts, headings and heights over everything that a camera above ground could be."""
    names, priors = set(problem.unknowns.names), problem.known.priors
    tilt, roll, heading = known.angles_rad
    free = names - set(priors)
    tilts = _TILTS_RAD if "tilt" in free else [tilt]
    headings = _HEADINGS_RAD if "heading" in free else [heading]
    heights = [known.elevation_m + height for height in _HEIGHTS_M] if "height" in free else [known.position_m[2]]
    for one_tilt, one_heading, height in itertools.product(tilts, headings, heights):
        position = np.array([*known.position_m[:2], height])
        state = replace(known, position_m=position, wxyz=camera_attitude(one_tilt, roll, one_heading))
        yield _above_landmarks(problem, state) if {"east", "north"} & free else state


def _above_landmarks(problem: Problem, state: State) -> State:
    """The state, moved to where its landmarks' middle is seen at their pixels' middle."""
    points, pixels = problem.landmarks
    if not len(points):
        return state
    ray = state.rotation @ rays_from_pixels(state.camera, pixels.mean(axis=0))
    middle = points.mean(axis=0)
    below = float(middle[2] - state.position_m[2])
    reach = min(below / ray[2], 20 * abs(below)) if below < 0 and ray[2] < 0 else 5 * max(abs(below), 1.0)
    if not math.isfinite(reach):
        return state
    position = state.position_m.copy()
    for index, name in enumerate(("east", "north")):
        if name in problem.unknowns.names:
            position[index] = middle[index] - reach * ray[index]
    return replace(state, position_m=position)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit(Generic[StateT, RowsT_co]):
    """The best fit.

    Attributes:
        state: What was found.
        residuals: At the state, of all evidence, outliers too.
        kept: ``(k,)`` whether each observation was used.
        covariance: ``(n, n)`` of the unknowns as they are named (SI units), scaled by what the residuals tell of the
            stated stds; infinite where they are not determined.
        chi2: Weighted sum of squares of what was used.
        dof: Degrees of freedom.
        p_value: Chance of so large a ``chi2`` if all stated stds were true; None without degrees of freedom.
        sigma_scale: What the stated stds are multiplied with, see :func:`goodness`.
    """

    state: StateT
    residuals: RowsT_co
    kept: np.ndarray
    covariance: FloatArray
    chi2: float
    dof: int
    p_value: float | None
    sigma_scale: float

    @property
    def misfit(self) -> float:
        """How many times as large as stated the residuals are; 1 without degrees of freedom."""
        return math.sqrt(self.chi2 / self.dof) if self.dof > 0 else 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution(Fit[State, Residuals]):
    """The best fit of one camera.

    Attributes:
        joint: ``(s, s)`` of the errors of ``dft.projection``, of which the unknowns are combinations.
        alternative: Another camera that the evidence fits as well; None where there is only one.
    """

    joint: FloatArray
    alternative: State | None = None


def solve(problem: Problem, known: State, *, guess_is_good: bool = False) -> Solution:
    """Fit the unknowns.

    Args:
        problem: Evidence and unknowns.
        known: What is known; where to start for what is not.
        guess_is_good: ``known`` is near the truth in every unknown: a start among those that the evidence gives.

    Returns:
        The best of all descents. Whether it can be trusted is for ``result.observability`` to say.
    """
    ends = _ends(problem, known, guess_is_good=guess_is_good)
    best = _cheapest(ends)
    best, kept = without_outliers(problem, best, len(problem.known.evidence), len(problem.unknowns.names))
    solution = _solution(problem, best, kept)
    return replace(solution, alternative=_alternative(problem, solution, ends))


def without_outliers(
    problem: Task[StateT, RowsT_co], robust: Descent[StateT, RowsT_co], observations: int, unknowns: int
) -> tuple[Descent[StateT, RowsT_co], np.ndarray]:
    """The fit to what agrees with it, and ``(k,)`` which of the observations that is.

    Args:
        problem: What is fitted.
        robust: Where a descent ended in which observations that stand far off counted less.
        observations: How many there are.
        unknowns: How many numbers are fitted.
    """
    best, kept = robust, np.ones(observations, dtype=bool)
    first = _kept(best.residuals, observations)
    if _tells_more(unknowns, best.residuals, first):
        kept = first
    for _ in range(_ROUNDS):
        best = descend(problem, best.state, None, kept, best.residuals)
        now = _kept(best.residuals, observations, kept)
        if np.array_equal(now, kept) or not _tells_more(unknowns, best.residuals, now):
            break
        kept = now
    return _with_forgiven(problem, best, kept)


def _with_forgiven(
    problem: Task[StateT, RowsT_co], best: Descent[StateT, RowsT_co], kept: np.ndarray
) -> tuple[Descent[StateT, RowsT_co], np.ndarray]:
    """Take back what was left out, the nearest first, where larger stds explain it better than so many outliers.

    Of few observations some always agree by chance, and the others look wrong beside them.
    """
    squares, _ = _by_owner(best.residuals)
    outliers = np.flatnonzero(~kept)
    chosen, least = (best, kept), _unlikeliness(best.residuals, kept)
    for count in range(len(outliers), 0, -1) if len(outliers) <= _FORGIVABLE else ():
        with_more = kept.copy()
        with_more[outliers[np.argsort(squares[outliers])][:count]] = True
        other = descend(problem, best.state, None, with_more)
        unlikely = _unlikeliness(other.residuals, with_more)
        if unlikely <= least:
            chosen, least = (other, with_more), unlikely
    return chosen


def _tells_more(unknowns: int, residuals: Rows, kept: np.ndarray) -> bool:
    """Whether what is kept could contradict a fit: with as many rows as unknowns, anything fits."""
    return int(np.count_nonzero(used_rows(residuals.owner, kept))) > unknowns


def _ends(problem: Problem, known: State, *, guess_is_good: bool) -> list[End]:
    """Where descents from all starts end, as many starts as it takes until one of them fits."""
    ends = [descend(problem, known, ROBUST)] if guess_is_good else []
    for zoom in zooms(problem):
        for start in closed_form_states(problem, known, zoom):
            residuals = problem.evaluate(start)
            if not (_some_fit(ends) and _is_hopeless(residuals)):
                ends.append(descend(problem, start, ROBUST, known=residuals))
        if _some_fit(ends):
            return ends
    candidates = [known, *scattered(problem, known), *_from_subsets(problem, known)]
    loss = None
    scored = []
    for candidate in candidates:
        residuals = problem.evaluate(candidate)
        loss = loss or Loss(residuals.owner, ROBUST)
        scored.append(loss.cost(residuals))
    chosen = [candidates[index] for index in np.argsort(scored)[: 2 * _BEST]]
    return ends + [descend(problem, start, ROBUST) for start in chosen]


def _cheapest(ends: list[End]) -> End:
    """The best end; of several that are as good, as in a valley, the middle one: its own ends are no place to judge."""
    least = min(end.cost for end in ends)
    as_good = [end for end in ends if end.cost <= least * (1 + _SAME) + _SAME]
    return sorted(as_good, key=lambda end: end.state.value("height"))[len(as_good) // 2]


def _from_subsets(problem: Problem, known: State) -> list[State]:
    """What four landmarks at a time say: most fours are free of outliers where few landmarks are."""
    count = len(problem.landmarks[0])
    if count <= _FEW:
        return []
    rng = np.random.default_rng(count)
    subsets = (rng.choice(count, _FEW, replace=False) for _ in range(_SUBSETS))
    return [
        state
        for rows, zoom in zip(subsets, itertools.cycle(zooms(problem)), strict=False)
        for state in itertools.islice(closed_form_states(problem, known, zoom, rows), 2)
    ]


def _some_fit(ends: list[End]) -> bool:
    return bool(ends) and _fits(min(ends, key=lambda end: end.cost).residuals)


def _is_hopeless(residuals: Residuals) -> bool:
    """Whether most of the evidence is so far off that beside a fit this is no other."""
    squares, rows = _by_owner(residuals)
    return bool(len(squares)) and float(np.median(squares / rows)) > _FAR**2


def _fits(residuals: Residuals) -> bool:
    """Whether a fit leaves nothing to be explained by another start."""
    squares, rows = _by_owner(residuals)
    return bool(np.all(squares <= _ENOUGH**2 * rows * 2)) if len(squares) else True


def _by_owner(residuals: Rows) -> tuple[FloatArray, FloatArray]:
    """Sum of squares and number of rows of each observation."""
    evidence = residuals.owner >= 0
    owner, values = residuals.owner[evidence], residuals.values[evidence]
    squares, rows = np.bincount(owner, values * values), np.bincount(owner, np.ones_like(values))
    return squares.astype(np.float64), rows.astype(np.float64)


def _kept(residuals: Rows, count: int, before: np.ndarray | None = None) -> np.ndarray:
    """Which observations are within chance of the fit, for the scatter that most of them show."""
    squares, rows = _by_owner(residuals)
    used = np.ones(count, dtype=bool) if before is None else before
    sizes, size = np.unique(rows, return_inverse=True)
    medians = chdtri(sizes, 0.5)[size]
    scatter = float(np.median(squares[used] / medians[used])) if np.count_nonzero(used) > _FEW else 1.0
    return np.asarray(squares <= max(scatter, 1.0) * chdtri(sizes, _CHANCE)[size])


def _unlikeliness(residuals: Rows, kept: np.ndarray) -> float:
    """How little to believe that what is kept is normal, as stated or with larger stds, and the rest is anywhere.

    Twice the negative logarithm of the likelihood.
    """
    used = residuals.values[used_rows(residuals.owner, kept)]
    chi2, count = float(used @ used), len(used)
    if chi2 > count:
        chi2 = min(chi2, count * (1 + math.log(chi2 / count)) + _LARGER)
    return chi2 + _ANYWHERE * (len(residuals.values) - count)


def goodness(chi2: float, dof: int) -> tuple[float | None, float]:
    """Chance of so large a chi-square, None without degrees of freedom; and what to multiply stated stds with.

    Stated stds may be wrong by a common factor, of which few residuals tell little: its square has an inverse
    chi-square distribution around 1 before these are seen, and after (Gelman et al., "Bayesian Data Analysis", 3rd ed.,
    section 3.3); around theirs where they are larger. 1.96 of the scaled stds then hold what Student's distribution
    says.
    """
    p_value = float(chdtrc(dof, chi2)) if dof > 0 else None
    seen = chi2 / dof if dof > 0 else 1.0
    known = max(dof, 0) + _STATED_DOF
    variance = max(seen, (max(dof, 0) * seen + _STATED_DOF) / known, _LEAST_SCALE**2)
    return p_value, math.sqrt(variance) * float(stdtrit(known, 0.975) / ndtri(0.975))


def _solution(problem: Problem, end: End, kept: np.ndarray) -> Solution:
    residuals = end.residuals
    used = used_rows(residuals.owner, kept)
    jac, values = residuals.by_unknowns[used], residuals.values[used]
    chi2, dof = float(values @ values), int(np.count_nonzero(used)) - len(problem.unknowns.names)
    p_value, sigma_scale = goodness(chi2, dof)
    to_angles = problem.unknowns.to_angles(end.state)
    own = covariance_of(jac.T @ jac) * sigma_scale**2
    by = problem.unknowns.by_unknowns(end.state)
    if not np.all(np.isfinite(own)):
        covariance, joint = own, np.full((len(by), len(by)), np.inf)
    else:
        covariance, joint = to_angles @ own @ to_angles.T, by @ own @ by.T
    return Solution(
        state=end.state,
        residuals=residuals,
        kept=kept,
        covariance=covariance,
        joint=joint,
        chi2=chi2,
        dof=dof,
        p_value=p_value,
        sigma_scale=sigma_scale,
    )


def _alternative(problem: Problem, solution: Solution, ends: list[End]) -> State | None:
    """Another end that chance does not tell from the solution: its mirror image, or one of three points' four."""
    names = problem.unknowns.names
    stds = np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))
    for end in ends:
        if _is_hopeless(end.residuals) or not _is_elsewhere(names, solution.state, end.state, stds):
            continue
        other = descend(problem, end.state, None, solution.kept, end.residuals)
        as_likely = 2 * other.cost - solution.chi2 < _AS_LIKELY * max(solution.sigma_scale, 1.0) ** 2
        if as_likely and _is_elsewhere(names, solution.state, other.state, stds):
            return other.state
    return None


def _is_elsewhere(names: tuple[str, ...], one: State, other: State, stds: FloatArray) -> bool:
    off = np.array([one.value(name) - other.value(name) for name in names])
    turns = np.array([name in ("roll", "heading") for name in names])
    off[turns] = (off[turns] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.any(np.abs(off) > _ELSEWHERE * stds + _SAME))


def covariance_of(normal: FloatArray) -> FloatArray:
    """The inverse of what may be singular: infinite where it is, as far as numbers can tell."""
    size = np.sqrt(np.diag(normal))
    if not np.all(size > 0):
        return np.full_like(normal, np.inf)
    scaled = normal / np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] < _SINGULAR:
        return np.full_like(normal, np.inf)
    return np.asarray(np.linalg.inv(scaled) / np.outer(size, size))
