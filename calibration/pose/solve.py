"""Fit of a camera's pose and lens: starts, descents and outliers.

No initial guess is needed: descents start wherever the evidence alone places the camera.
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
from calibration.descent import LeastSquares, LocalMinimum, Loss, Residuals, StateT, covariance_of, descend, used_rows
from calibration.pose.residuals import Problem
from calibration.pose.state import State

_MIN_LANDMARKS = 3  # for a closed form; three landmarks give up to four poses
_MAX_FLATNESS = 0.2  # thickness over width of points that may be taken for their mirror image
_SAME_POSE = 0.005  # difference of rotations and relative distances of closed forms of one pose
_ERROR_RATIO, _MAX_ERROR = 30.0, 0.02  # of a mirror image: over the best form's error, or in focal lengths
_TILTS_RAD = np.radians([8.0, 35.0, 55.0, 70.0, 82.0, 95.0])
_HEADINGS_RAD = np.radians(np.arange(0.0, 360.0, 45.0))
_HEIGHTS_M = (2.0, 6.0, 20.0, 60.0, 200.0)
_ZOOMS = (1.0, 0.5, 0.7, 1.4, 2.0)
_ANGLES = ("tilt", "roll", "heading")
Minimum: TypeAlias = LocalMinimum[State]

ROBUST: Final = 3.0
"""Scale of the robust loss, in standard deviations, while outliers are looked for."""

_OUTLIER_P_VALUE: Final = 1e-5
"""p-value of an observation below which it is an outlier."""

_OUTLIER_PENALTY, _SCALE_PENALTY = 17.0, 6.0
"""Twice the negative log odds that a coordinate is anywhere in the image; that all stds are larger than stated."""

_MAX_STARTS, _GOOD_FIT_STDS, _MAX_SUBSETS, _MAX_ROUNDS = 4, 3.0, 60, 10
_MAX_READMITTED = 8  # more wrong outliers would show in the scatter of the inliers
_SUBSET_SIZE, _HOPELESS_STDS = 4, 50.0
_PRIOR_DOF: Final = 2.0
"""Degrees of freedom that a stated std is worth: 95 of 100 stated stds are right to a factor of 2.5."""

_MIN_SCALE: Final = 0.7
"""Smallest scale of stds: small residuals do not show errors that all observations share."""

_USUAL_SCALE, _UNUSUAL_P_VALUE = 1.5, 1e-3
"""Factor by which people state stds too small without a look for the cause; the chance of a larger residual then."""

_COST_TOLERANCE = 1e-6  # relative and absolute
_HEAD_DOWN: Final = 0.5  # nearer to straight down a camera merely looks back
_MAX_CHI2_INCREASE, _MIN_DISTANCE_STDS = 14.0, 6.0  # odds of one to a thousand; standard deviations


def zooms(problem: Problem) -> tuple[float, ...]:
    """Factors of the given focal length to start from; 1 alone where it is known."""
    return _ZOOMS if {"focal", "fx"} & set(problem.unknowns.names) else (1.0,)


def closed_form_states(
    problem: Problem, known: State, zoom: float = 1.0, rows: npt.NDArray[np.int64] | None = None
) -> Iterator[State]:
    """Closed-form states from landmarks for a camera of known focal length.

    Three by P3P, more by SQPnP (Terzakis and Lourakis, 2020); a plane's two poses by IPPE (Collins and Bartoli, 2014).

    Args:
        problem: The evidence.
        known: Known and guessed values.
        zoom: One of ``zooms``.
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
    in_front = rays[:, 2] > 0.05  # noqa: PLR2004 - 3 degrees within a fisheye's half space
    if np.count_nonzero(in_front) < _MIN_LANDMARKS:
        return
    normalized = np.ascontiguousarray(rays[in_front, :2] / rays[in_front, 2:])
    poses: list[FloatArray] = []
    for rotation, translation in _closed_forms(points[in_front] - middle, normalized):
        wxyz = inverse(from_rotation_vector(rotation.ravel()))
        enu_r_cam = matrix(wxyz)
        away = (enu_r_cam @ translation).ravel()
        pose = np.column_stack([enu_r_cam, away / np.linalg.norm(away), np.log(np.linalg.norm(away)) * np.ones(3)])
        is_new = all(np.max(np.abs(pose - other)) > _SAME_POSE for other in poses)
        if is_new and np.all(np.isfinite(pose)):
            poses.append(pose)
            yield _with_known_values(problem, known, replace(known, camera=lens), middle - away, wxyz)


def _closed_forms(points_m: FloatArray, normalized: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Rotations and translations from the world to the camera that fit; points of a plane may have two."""
    methods = [cv2.SOLVEPNP_P3P] if len(normalized) == _MIN_LANDMARKS else [cv2.SOLVEPNP_SQPNP]
    _, thickness, axes = np.linalg.svd(points_m, full_matrices=False)
    in_plane = points_m
    if len(normalized) > _MIN_LANDMARKS and thickness[2] < _MAX_FLATNESS * thickness[1]:
        methods.append(cv2.SOLVEPNP_IPPE)
        in_plane = points_m - np.outer(points_m @ axes[2], axes[2])
    for method in methods:
        try:
            if method == cv2.SOLVEPNP_P3P:
                _, rotations, translations = cv2.solveP3P(points_m, normalized, np.eye(3), None, method)
                errors: npt.ArrayLike = np.zeros(len(rotations))
            else:
                world = in_plane if method == cv2.SOLVEPNP_IPPE else points_m
                _, rotations, translations, errors = cv2.solvePnPGeneric(
                    world, normalized, np.eye(3), None, flags=method
                )
        except cv2.error:  # points in a line, or all in one
            continue
        if not rotations:  # without poses OpenCV gives no errors either
            continue
        px_errors = np.asarray(errors, dtype=np.float64).ravel()
        is_accepted = px_errors <= max(_ERROR_RATIO * float(np.min(px_errors, initial=np.inf)), _MAX_ERROR)
        for rotation, translation, accepted in zip(rotations, translations, is_accepted, strict=True):
            if accepted:
                yield np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)


def _with_known_values(problem: Problem, known: State, guess: State, eye_m: FloatArray, wxyz: FloatArray) -> State:
    """The guess with known values replaced by their values."""
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


def grid_states(problem: Problem, known: State) -> Iterator[State]:
    """States on a grid of tilts, headings and heights that covers all cameras above ground."""
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
    """The state moved to where the landmarks' centroid projects to their pixels' centroid."""
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
class Fit(Generic[StateT]):
    """The best fit.

    Attributes:
        state: The fitted state.
        residuals: At the state, of all evidence, outliers too.
        kept: ``(k,)`` whether each observation was used.
        covariance: ``(n, n)`` of the unknowns by name (SI units), scaled by ``sigma_scale`` squared; infinite where
            they are not determined.
        chi2: Weighted sum of squares of the used rows.
        dof: Degrees of freedom.
        p_value: Probability of a larger ``chi2`` if all stated stds are true; None without degrees of freedom.
        sigma_scale: Factor of the stated stds, see :func:`goodness`.
    """

    state: StateT
    residuals: Residuals
    kept: np.ndarray
    covariance: FloatArray
    chi2: float
    dof: int
    p_value: float | None
    sigma_scale: float

    @property
    def misfit(self) -> float:
        """Root mean square of the normalised residuals per degree of freedom; 1 without degrees of freedom."""
        return math.sqrt(self.chi2 / self.dof) if self.dof > 0 else 1.0

    @property
    def is_explained(self) -> bool:
        """Whether stds that are half as large again as stated explain the residuals, one time in a thousand."""
        return self.dof <= 0 or self.chi2 <= _USUAL_SCALE**2 * float(chdtri(self.dof, _UNUSUAL_P_VALUE))

    @property
    def neg_log_likelihood(self) -> float:
        """Twice the negative log likelihood of all observations, outliers too, but for a constant."""
        return _neg_log_likelihood(self.residuals, self.kept)

    @property
    def neg_log_likelihood_of_kept(self) -> float:
        """Twice the negative log likelihood of the observations used alone."""
        rejected = len(self.residuals.values) - int(np.count_nonzero(used_rows(self.residuals.owner, self.kept)))
        return self.neg_log_likelihood - _OUTLIER_PENALTY * rejected


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution(Fit[State]):
    """The best fit of one camera.

    Attributes:
        joint: ``(s, s)`` covariance of the errors of ``dft.projection``, of which the unknowns are combinations.
        alternative: Another state that fits as well; None if there is only one.
    """

    joint: FloatArray
    alternative: State | None = None


def solve(problem: Problem, known: State, *, guess_is_good: bool = False, is_quick: bool = False) -> Solution:
    """Fit the unknowns.

    Args:
        problem: Evidence and unknowns.
        known: Known values, and first values of the unknowns.
        guess_is_good: Whether ``known`` is near the truth in every unknown: then it is one of the starts.
        is_quick: Start from the closed forms of all landmarks alone, where there are any: for evidence that fits as a
            whole or not at all.

    Returns:
        The best of all minima. ``result.observability`` says whether it is determined.
    """
    minima = _descend_from_starts(problem, known, guess_is_good=guess_is_good, is_quick=is_quick)
    best = _best_minimum(minima)
    best, kept = without_outliers(problem, best, len(problem.known.evidence), len(problem.unknowns.names))
    solution = _solution(problem, best, kept)
    return replace(solution, alternative=_alternative(problem, solution, minima))


def without_outliers(
    problem: LeastSquares[StateT], robust: LocalMinimum[StateT], observations: int, unknowns: int
) -> tuple[LocalMinimum[StateT], np.ndarray]:
    """The fit to the inliers, and whether each observation ``(k,)`` is one.

    Args:
        problem: The problem.
        robust: Minimum of a descent with a robust loss.
        observations: Number of observations.
        unknowns: Number of unknowns.
    """
    best, kept = robust, np.ones(observations, dtype=bool)
    first = _find_inliers(best.residuals, observations)
    if _is_overdetermined(unknowns, best.residuals, first):
        kept = first
    for _ in range(_MAX_ROUNDS):
        best = descend(problem, best.state, None, kept, best.residuals)
        inliers = _find_inliers(best.residuals, observations, kept)
        if np.array_equal(inliers, kept) or not _is_overdetermined(unknowns, best.residuals, inliers):
            break
        kept = inliers
    return _readmit_outliers(problem, best, kept)


def _readmit_outliers(
    problem: LeastSquares[StateT], best: LocalMinimum[StateT], kept: np.ndarray
) -> tuple[LocalMinimum[StateT], np.ndarray]:
    """Readmit outliers, nearest first, where larger stds are more likely than so many outliers.

    Among few observations some agree by chance, so that the others look like outliers.
    """
    squares, _ = _by_owner(best.residuals)
    outliers = np.flatnonzero(~kept)
    chosen, smallest = (best, kept), _neg_log_likelihood(best.residuals, kept)
    for count in range(len(outliers), 0, -1) if len(outliers) <= _MAX_READMITTED else ():
        candidate = kept.copy()
        candidate[outliers[np.argsort(squares[outliers])][:count]] = True
        other = descend(problem, best.state, None, candidate)
        penalty = _neg_log_likelihood(other.residuals, candidate)
        if penalty <= smallest:
            chosen, smallest = (other, candidate), penalty
    return chosen


def _is_overdetermined(unknowns: int, residuals: Residuals, kept: np.ndarray) -> bool:
    """Whether the kept rows outnumber the unknowns: otherwise anything fits."""
    return int(np.count_nonzero(used_rows(residuals.owner, kept))) > unknowns


def _descend_from_starts(problem: Problem, known: State, *, guess_is_good: bool, is_quick: bool) -> list[Minimum]:
    """Ends of descents from as many starts as it takes until one fits."""
    minima = [descend(problem, known, ROBUST)] if guess_is_good else []
    for zoom in zooms(problem):
        for start in closed_form_states(problem, known, zoom):
            residuals = problem.evaluate(start)
            if not (_has_fit(minima) and _is_hopeless(residuals)):
                minima.append(descend(problem, start, ROBUST, known=residuals))
        if _has_fit(minima):
            return minima
    if is_quick and minima:
        return minima
    candidates = [known, *grid_states(problem, known), *_states_from_subsets(problem, known)]
    loss = None
    scored = []
    for candidate in candidates:
        residuals = problem.evaluate(candidate)
        loss = loss or Loss(residuals.owner, ROBUST)
        scored.append(loss.cost(residuals))
    chosen = [candidates[index] for index in np.argsort(scored)[: 2 * _MAX_STARTS]]
    return minima + [descend(problem, start, ROBUST) for start in chosen]


def _best_minimum(minima: list[Minimum]) -> Minimum:
    """The minimum of least cost; of equal ones along a valley the middle one."""
    costs = [_likelihood_cost(minimum) for minimum in minima]
    least = min(costs)
    most = least + _COST_TOLERANCE * (1 + abs(least))
    equal = [minimum for minimum, cost in zip(minima, costs, strict=True) if cost <= most]
    return sorted(equal, key=lambda minimum: minimum.state.value("height"))[len(equal) // 2]


def _likelihood_cost(minimum: Minimum) -> float:
    """Minus the logarithm of the (robust) likelihood, but for a constant.

    The standard deviations count beside the cost: right before the camera an error of a landmark's place is thousands
    of pixels, which would explain any residual.
    """
    return minimum.cost + float(np.sum(minimum.residuals.log_std))


def _states_from_subsets(problem: Problem, known: State) -> list[State]:
    """Closed-form states of four landmarks at a time: few landmarks have mostly subsets without outliers."""
    count = len(problem.landmarks[0])
    if count <= _SUBSET_SIZE:
        return []
    rng = np.random.default_rng(count)
    subsets = (rng.choice(count, _SUBSET_SIZE, replace=False) for _ in range(_MAX_SUBSETS))
    return [
        state
        for rows, zoom in zip(subsets, itertools.cycle(zooms(problem)), strict=False)
        for state in itertools.islice(closed_form_states(problem, known, zoom, rows), 2)
    ]


def _has_fit(minima: list[Minimum]) -> bool:
    return bool(minima) and _fits(min(minima, key=_likelihood_cost).residuals)


def _is_hopeless(residuals: Residuals) -> bool:
    """Whether most of the evidence is too far off for an alternative to a fit."""
    squares, rows = _by_owner(residuals)
    return bool(len(squares)) and float(np.median(squares / rows)) > _HOPELESS_STDS**2


def _fits(residuals: Residuals) -> bool:
    """Whether the residuals are good enough to try no other start."""
    squares, rows = _by_owner(residuals)
    return bool(np.all(squares <= _GOOD_FIT_STDS**2 * rows * 2)) if len(squares) else True


def _by_owner(residuals: Residuals) -> tuple[FloatArray, FloatArray]:
    """Sum of squares and number of rows of each observation."""
    evidence = residuals.owner >= 0
    owner, values = residuals.owner[evidence], residuals.values[evidence]
    squares, rows = np.bincount(owner, values * values), np.bincount(owner, np.ones_like(values))
    return squares.astype(np.float64), rows.astype(np.float64)


def _find_inliers(residuals: Residuals, count: int, before: np.ndarray | None = None) -> np.ndarray:
    """Whether each observation is within chance of the fit, given the scatter of most of them."""
    squares, rows = _by_owner(residuals)
    used = np.ones(count, dtype=bool) if before is None else before
    sizes, size = np.unique(rows, return_inverse=True)
    medians = chdtri(sizes, 0.5)[size]
    scatter = float(np.median(squares[used] / medians[used])) if np.count_nonzero(used) > _SUBSET_SIZE else 1.0
    return np.asarray(squares <= max(scatter, 1.0) * chdtri(sizes, _OUTLIER_P_VALUE)[size])


def _neg_log_likelihood(residuals: Residuals, kept: np.ndarray) -> float:
    """Twice the negative log likelihood of normal inliers (stds as stated, or larger) and outliers anywhere."""
    rows = used_rows(residuals.owner, kept)
    used = residuals.values[rows]
    chi2, count = float(used @ used), len(used)
    if chi2 > count:
        chi2 = min(chi2, count * (1 + math.log(chi2 / count)) + _SCALE_PENALTY)
    return chi2 + 2 * float(np.sum(residuals.log_std[rows])) + _OUTLIER_PENALTY * (len(residuals.values) - count)


def goodness(chi2: float, dof: int) -> tuple[float | None, float]:
    """The p-value of a chi-square, None without degrees of freedom; and the factor of the stated stds.

    Stated stds may be wrong by a common factor, whose square has an inverse chi-square prior around 1 and posterior
    (Gelman et al., "Bayesian Data Analysis", 3rd ed., section 3.3), but is at least the residuals' variance. 1.96
    scaled stds are then Student's 95 %: of ``dof`` residuals that are as large as stated the factor is
    ``t(dof + 2) / 1.96``, 1.62 for one, 1.42 for two, 1.14 for eight.
    """
    p_value = float(chdtrc(dof, chi2)) if dof > 0 else None
    residual_variance = chi2 / dof if dof > 0 else 1.0
    posterior_dof = max(dof, 0) + _PRIOR_DOF
    variance = max(residual_variance, (max(dof, 0) * residual_variance + _PRIOR_DOF) / posterior_dof, _MIN_SCALE**2)
    return p_value, math.sqrt(variance) * float(stdtrit(posterior_dof, 0.975) / ndtri(0.975))


def _solution(problem: Problem, minimum: Minimum, kept: np.ndarray) -> Solution:
    residuals = minimum.residuals
    used = used_rows(residuals.owner, kept)
    jac, values = residuals.jac_unknowns[used], residuals.values[used]
    chi2, dof = float(values @ values), int(np.count_nonzero(used)) - len(problem.unknowns.names)
    p_value, sigma_scale = goodness(chi2, dof)
    to_angles = problem.unknowns.to_angles(minimum.state)
    covariance_of_steps = covariance_of(jac.T @ jac) * sigma_scale**2
    by = problem.unknowns.jac_unknowns(minimum.state)
    if not np.all(np.isfinite(covariance_of_steps)):
        covariance, joint = covariance_of_steps, np.full((len(by), len(by)), np.inf)
    else:
        covariance, joint = to_angles @ covariance_of_steps @ to_angles.T, by @ covariance_of_steps @ by.T
    return Solution(
        state=minimum.state,
        residuals=residuals,
        kept=kept,
        covariance=covariance,
        joint=joint,
        chi2=chi2,
        dof=dof,
        p_value=p_value,
        sigma_scale=sigma_scale,
    )


def _alternative(problem: Problem, solution: Solution, minima: list[Minimum]) -> State | None:
    """Another minimum of nearly the same likelihood: a mirror image, or one of the four poses of three landmarks.

    None that stands on its head where the best does not: few cameras do, and of those that do the roll is stated.
    """
    names = problem.unknowns.names
    stds = np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))
    used = used_rows(solution.residuals.owner, solution.kept)
    for minimum in minima:
        if _is_hopeless(minimum.residuals) or not _is_different(names, solution.state, minimum.state, stds):
            continue
        other = descend(problem, minimum.state, None, solution.kept, minimum.residuals)
        wider = float(np.sum((other.residuals.log_std - solution.residuals.log_std)[used]))
        increase = 2 * other.cost - solution.chi2 + 2 * wider
        as_likely = increase < _MAX_CHI2_INCREASE * max(solution.sigma_scale, 1.0) ** 2
        on_its_head = _uprightness(other.state) < -_HEAD_DOWN and _uprightness(solution.state) > 0
        if as_likely and not on_its_head and _is_different(names, solution.state, other.state, stds):
            return other.state
    return None


def _uprightness(state: State) -> float:
    """Sine of the angle by which an image's lower edge points down: 1 upright, 0 straight down, -1 on its head."""
    return math.sin(state.value("tilt")) * math.cos(state.value("roll"))


def _is_different(names: tuple[str, ...], one: State, other: State, stds: FloatArray) -> bool:
    differences = np.array([one.value(name) - other.value(name) for name in names])
    is_angle = np.array([name in ("roll", "heading") for name in names])
    differences[is_angle] = (differences[is_angle] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.any(np.abs(differences) > _MIN_DISTANCE_STDS * stds + _COST_TOLERANCE))
